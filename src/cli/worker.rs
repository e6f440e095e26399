//! `gable worker`: a process of the service, started by `gable serve` and `gable work`, not by people.

use std::sync::Arc;

use crate::configuration::Configuration;
use crate::http::serve::stop_on_signals;
use crate::http::state::job_settings;
use crate::jobs::crew::Crew;
use crate::jobs::worker;
use crate::pipeline;
use crate::store::Store;
use anyhow::{Context as _, bail};
use clap::Args;
use rustix::process::{Resource, Rlimit, setrlimit};
use serde::{Deserialize, Serialize};
use tokio::io::{AsyncBufReadExt as _, BufReader};
use uuid::Uuid;

use super::{begin_log, install_geoids};

/// Orient images for the service that has started this
#[derive(Debug, Args)]
pub(crate) struct Worker;

/// The first line that a worker process reads: settings can hold secrets, which arguments and variables would show.
#[derive(Serialize, Deserialize)]
struct Order {
    worker: Uuid,
    configuration: Configuration,
}

/// The worker processes of a service with these settings.
pub(super) fn crew(configuration: &Configuration) -> anyhow::Result<Crew> {
    let program = std::env::current_exe().context("the program does not find itself")?;
    let workers = configuration.worker_count();
    let configuration = configuration.clone();
    let order = move |worker| {
        let order = Order { worker, configuration: configuration.clone() };
        // settings that were read can be written
        serde_json::to_string(&order).unwrap_or_default()
    };
    Ok(Crew { program, arguments: vec!["worker".to_owned()], order: Arc::new(order), workers })
}

impl Worker {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let mut calls = BufReader::new(tokio::io::stdin()).lines();
        let Some(order) = calls.next_line().await? else { bail!("this is started by `gable serve` and `gable work`") };
        let Order { worker, configuration } =
            serde_json::from_str(&order).context("this is started by `gable serve` and `gable work`")?;
        begin_log(&configuration)?;
        install_geoids(configuration.geoid_folder());
        bound(&configuration)?;
        let stop = stop_on_signals().context("signals cannot be caught")?;
        let store = Store::connect(&configuration.place()).await?;
        let (settings, orient) = (job_settings(&configuration), Arc::new(pipeline::orient));
        worker::work(store, settings, orient, worker, calls, stop).await;
        Ok(())
    }
}

/// A picture that wants too much memory ends this process and no other: by its own limit, and as the first that the
/// system takes where memory runs out.
fn bound(configuration: &Configuration) -> anyhow::Result<()> {
    let most = configuration.worker_memory_max_bytes;
    if most > 0 {
        let limit = Rlimit { current: Some(most), maximum: Some(most) };
        // not the address space, of which the allocator reserves 64 MiB for every thread without using it
        setrlimit(Resource::Data, limit).context("the memory of the worker cannot be limited")?;
    }
    if let Err(error) = std::fs::write("/proc/self/oom_score_adj", "500") {
        tracing::debug!(%error, "the worker is not the first to go where memory runs out");
    }
    let threads = configuration.worker_threads;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    pool.context("the threads of the worker cannot be started")
}
