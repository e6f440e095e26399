//! `gable work`.

use crate::http::serve::stop_on_signals;
use crate::service::{Service, Work};
use crate::store::Store;
use anyhow::{Context as _, bail};
use clap::Args;

use super::Settings;
use super::worker::crew;

const EXAMPLES: &str = "\
Examples:
  gable work --database-url postgres://gable@db/gable --objects-url s3://flights/gable --data /var/lib/gable
      Orients what services with this database accept (`gable serve --database-url … --no-work`), with one process for \
      each core. The data folder holds copies of pictures.

  gable work --workers 2 --listen 0.0.0.0:9090
      Two processes; health and figures of this machine at http://…:9090/health/ready and /metrics.";

/// Orient images for services on other machines
///
/// Takes orientations from the queue in PostgreSQL, and hands back what it has not finished when it is told to end.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct WorkCommand {
    /// Address and port of health and figures. [env: GABLE_LISTEN] [default: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDRESS:PORT")]
    listen: Option<String>,
    /// Images oriented at a time. [env: GABLE_WORKERS] [default: one for each core]
    #[arg(long, value_name = "N")]
    workers: Option<String>,
    #[command(flatten)]
    settings: Settings,
}

impl WorkCommand {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let configuration = self.settings.gather(&[("listen", self.listen), ("workers", self.workers)])?;
        if configuration.database_url.is_none() {
            bail!("`gable work` needs a PostgreSQL (--database-url); with SQLite `gable serve` orients by itself");
        }
        let store = Store::connect(&configuration.place()).await?;
        let stop = stop_on_signals().context("signals cannot be caught")?;
        let crew = crew(&configuration)?;
        Service::begin_work(store, configuration).await?.run(Work::InProcesses(crew), stop).await;
        Ok(())
    }
}
