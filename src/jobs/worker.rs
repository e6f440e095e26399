//! A worker process: it orients one image at a time and tells its parent about it.

use std::time::Duration;

use tokio::io::{AsyncWriteExt as _, BufReader, Lines, Stdin};
use tokio::sync::mpsc::{self, UnboundedReceiver};
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use super::feed::Told;
use super::{Jobs, Orient, Settings};
use crate::store::Store;

/// How long after its deadline an attempt that does not heed it may go on before the process ends itself.
const OVERTIME: Duration = Duration::from_secs(15);

/// The standard input of a worker process, of which the first line was read already.
pub type Calls = Lines<BufReader<Stdin>>;

/// Works as `worker` until `stop`, or until the parent closes the standard input.
pub async fn work(
    store: Store,
    settings: Settings,
    orient: Orient,
    worker: Uuid,
    calls: Calls,
    stop: CancellationToken,
) {
    let (parent, told) = mpsc::unbounded_channel();
    let settings = Settings { workers: 1, ..settings };
    let jobs = Jobs::of_worker(store, settings, orient, worker, parent);
    watch_over(jobs.clone());
    let listening = tokio::spawn(heed(jobs.clone(), calls, stop.clone()));
    let telling = tokio::spawn(pass_on(told));
    tokio::select! {
        () = jobs.work(stop) => {}
        () = jobs.0.listen() => {}
    }
    listening.abort();
    jobs.0.store.close().await;
    // the last that is told is that the work is handed back
    drop(jobs);
    let _ = tokio::time::timeout(Duration::from_secs(1), telling).await;
}

/// Does what the parent says; that it says nothing more ends the work.
async fn heed(jobs: Jobs, mut calls: Calls, stop: CancellationToken) {
    while let Ok(Some(_call)) = calls.next_line().await {
        jobs.0.queue.announce();
    }
    stop.cancel();
}

async fn pass_on(mut told: UnboundedReceiver<Told>) {
    let mut output = tokio::io::stdout();
    while let Some(told) = told.recv().await {
        let Ok(line) = serde_json::to_string(&told) else { continue };
        if output.write_all(format!("{line}\n").as_bytes()).await.is_err() || output.flush().await.is_err() {
            return;
        }
    }
}

/// A computation that hangs heeds no deadline: then the process ends, and the attempt counts.
fn watch_over(jobs: Jobs) {
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_secs(1));
            if jobs.0.running().values().any(|signal| signal.is_later_than(OVERTIME)) {
                tracing::error!("an attempt goes on long after its time limit: ending the process");
                std::process::abort();
            }
        }
    });
}
