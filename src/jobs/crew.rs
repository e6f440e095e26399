//! The worker processes of a service. Each orients one image at a time, so that a picture that kills its process (out of
//! memory, or a fault of a decoder) takes nothing else along: the process is started anew, its orientation waits again, and
//! is given up when that has happened too often.

use std::path::PathBuf;
use std::process::{ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use tokio::io::{AsyncBufReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::process::{Child, ChildStdin, ChildStdout, Command};
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use super::feed::Told;
use super::{Inner, Jobs};
use crate::store::orientations::Abandoned;

/// How a worker process is started.
#[derive(Clone)]
pub struct Crew {
    /// The program.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// The first line that it reads from its standard input, for the worker of this id.
    pub order: Arc<dyn Fn(Uuid) -> String + Send + Sync>,
    /// How many there are.
    pub workers: usize,
}

/// What a worker process is told, a line each.
pub(super) const CALL: &str = "work";
/// How long a process may take to hand back its work when it is told to end.
const END_PATIENCE: Duration = Duration::from_secs(3);
/// A process that has lived so long did not die of its start.
const GOOD_START: Duration = Duration::from_secs(2);
/// Before a process is started again that died of its start; doubled each time, up to the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(10);

impl Jobs {
    /// Works in processes of their own until `stop`, and looks after the queue; see [`Self::run`].
    pub async fn run_in_processes(&self, crew: Crew, stop: CancellationToken) {
        self.0.workers_wanted.store(crew.workers, Ordering::Relaxed);
        let mut places = JoinSet::new();
        for _ in 0..crew.workers {
            places.spawn(self.0.clone().place(crew.clone(), stop.clone()));
        }
        self.tend(stop.clone()).await;
        while places.join_next().await.is_some() {}
    }

    /// What is wrong with the worker processes, if anything is.
    #[must_use]
    pub fn crew_fault(&self) -> Option<String> {
        let (wanted, alive) =
            (self.0.workers_wanted.load(Ordering::Relaxed), self.0.workers_alive.load(Ordering::Relaxed));
        (wanted > 0 && alive == 0).then(|| format!("none of {wanted} processes is alive"))
    }
}

impl Inner {
    /// One place for a process: there is always one, until `stop`.
    async fn place(self: Arc<Self>, crew: Crew, stop: CancellationToken) {
        let mut pause = FIRST_PAUSE;
        while !stop.is_cancelled() {
            let (worker, began) = (Uuid::now_v7(), Instant::now());
            self.count_workers(1);
            let fate = self.process(&crew, worker, &stop).await;
            self.count_workers(-1);
            let fate = fate.unwrap_or_else(|error| format!("it could not be started: {error}"));
            self.take_back(worker, &fate).await;
            if stop.is_cancelled() {
                return;
            }
            metrics::counter!("gable_worker_crashes_total").increment(1);
            tracing::error!(fate, "a worker process has ended and is started anew");
            pause = if began.elapsed() > GOOD_START { FIRST_PAUSE } else { (2 * pause).min(LONGEST_PAUSE) };
            let _ = tokio::time::timeout(pause, stop.cancelled()).await;
        }
    }

    fn count_workers(&self, more: isize) {
        let alive = self.workers_alive.fetch_add(more.cast_unsigned(), Ordering::Relaxed).wrapping_add_signed(more);
        metrics::gauge!("gable_workers").set(alive as f64);
    }

    /// A process from its start to its end: how it ended.
    async fn process(&self, crew: &Crew, worker: Uuid, stop: &CancellationToken) -> std::io::Result<String> {
        let mut child = Command::new(&crew.program)
            .args(&crew.arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .kill_on_drop(true)
            .spawn()?;
        let missing = || std::io::Error::other("it has no pipes");
        let mut input = child.stdin.take().ok_or_else(missing)?;
        let output = child.stdout.take().ok_or_else(missing)?;
        input.write_all(format!("{}\n", (crew.order)(worker)).as_bytes()).await?;
        let status = tokio::select! {
            () = self.hear(output) => child.wait().await?,
            () = self.pass_on(&mut input) => child.wait().await?,
            () = stop.cancelled() => {
                // the end of its input tells it to end
                drop(input);
                return ended(&mut child).await;
            }
        };
        Ok(describe(status))
    }

    /// Takes in what the process tells, until its end.
    async fn hear(&self, output: ChildStdout) {
        let mut lines = BufReader::new(output).lines();
        while let Ok(Some(line)) = lines.next_line().await {
            match serde_json::from_str::<Told>(&line) {
                // of a shared database all services hear of it
                Ok(Told::Change(_)) if self.store.database().is_shared() => {}
                Ok(told) => self.teller.tell(told),
                Err(error) => tracing::warn!(%error, line, "a worker process has said something strange"),
            }
        }
    }

    /// Calls the process to new work, until it does not listen any more.
    async fn pass_on(&self, input: &mut ChildStdin) {
        let mut calls = self.work_added.subscribe();
        loop {
            // one that was missed is one that another call stands for
            let _ = calls.recv().await;
            if input.write_all(format!("{CALL}\n").as_bytes()).await.is_err() {
                return;
            }
        }
    }

    /// Makes what the process had under way wait again.
    async fn take_back(&self, worker: Uuid, fate: &str) {
        if let Err(error) = self.recover(Abandoned::By(worker), fate).await {
            tracing::error!(%error, "the work of an ended process waits for its lease to run out");
        }
    }
}

async fn ended(child: &mut Child) -> std::io::Result<String> {
    match tokio::time::timeout(END_PATIENCE, child.wait()).await {
        Ok(status) => Ok(describe(status?)),
        Err(_) => {
            child.kill().await?;
            Ok("it did not end in time and was killed".to_owned())
        }
    }
}

fn describe(status: ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt as _;
    match (status.signal(), status.code()) {
        (Some(9), _) => "the worker process was killed, as happens where memory runs out".to_owned(),
        (Some(signal), _) => format!("the worker process was ended by signal {signal}"),
        (None, Some(code)) => format!("the worker process ended with status {code}"),
        (None, None) => "the worker process ended".to_owned(),
    }
}
