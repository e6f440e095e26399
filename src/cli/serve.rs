//! `gable serve`.

use crate::configuration::{Configuration, ConfigurationError, Setting};
use crate::http::serve::stop_on_signals;
use crate::service::{Service, Work};
use crate::store::Store;
use crate::store::keys::Role;
use anyhow::Context as _;
use clap::Args;

use super::worker::crew;
use super::{Settings, note};

const BOOTSTRAP_KEY: &str = "GABLE_BOOTSTRAP_KEY";
const BOOTSTRAP_KEY_MIN_CHARACTERS: usize = 32;

const EXAMPLES: &str = "\
Examples:
  gable serve
      Serves on http://127.0.0.1:8080 with everything in ./gable-data. Programs on this machine need no key as long as \
      none is made. Look at http://127.0.0.1:8080 in a browser; the API is told in /docs.

  gable key new --role admin --data /srv/gable && gable serve --listen 0.0.0.0:8080 --data /srv/gable
      Serves the network, which needs a key.

  GABLE_LOG_FORMAT=json GABLE_UPLOAD_MAX_BYTES=500000000 gable serve --config /etc/gable.toml
      Every setting is a line `name = value` in the file, or GABLE_NAME in the environment, which counts more.";

/// Serve the HTTP API
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{EXAMPLES}\n\n{}", settings()))]
pub(crate) struct Serve {
    /// Address and port. [env: GABLE_LISTEN] [default: 127.0.0.1:8080]
    #[arg(long, value_name = "ADDRESS:PORT")]
    listen: Option<String>,
    /// Leave the orienting to `gable work` on other machines; needs a PostgreSQL. [env: GABLE_WORK=false]
    #[arg(long)]
    no_work: bool,
    /// Images oriented at a time. [env: GABLE_WORKERS] [default: one for each core]
    #[arg(long, value_name = "N")]
    workers: Option<String>,
    #[command(flatten)]
    settings: Settings,
}

fn settings() -> String {
    let line = |setting: Setting| {
        let about = setting.about.split_whitespace().collect::<Vec<_>>().join(" ");
        format!("  {} = {}\n      {about}", setting.name, setting.default)
    };
    let lines: Vec<_> = Configuration::settings().into_iter().map(line).collect();
    format!("Settings:\n{}", lines.join("\n"))
}

impl Serve {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let no_work = self.no_work.then(|| "false".to_owned());
        let flags = [("listen", self.listen), ("workers", self.workers), ("work", no_work)];
        let configuration = self.settings.gather(&flags)?;
        let store = Store::connect(&configuration.place()).await?;
        make_bootstrap_key(&store).await?;
        let stop = stop_on_signals().context("signals cannot be caught")?;
        let work = if configuration.work { Work::InProcesses(crew(&configuration)?) } else { Work::Elsewhere };
        Service::begin(store, configuration).await?.run(work, stop).await;
        Ok(())
    }
}

/// The first key may come from the environment, for installations without a terminal. Once a key was made, it is
/// ignored: a revoked key must not come back with the next start.
async fn make_bootstrap_key(store: &Store) -> anyhow::Result<()> {
    let Some(secret) = std::env::var_os(BOOTSTRAP_KEY).filter(|secret| !secret.is_empty()) else {
        return Ok(());
    };
    let unreadable = |detail: String| ConfigurationError::Unreadable { detail };
    let secret = secret.into_string().map_err(|_| unreadable(format!("{BOOTSTRAP_KEY} is not text")))?;
    if secret.chars().count() < BOOTSTRAP_KEY_MIN_CHARACTERS || !secret.chars().all(|c| c.is_ascii_graphic()) {
        let detail = format!(
            "{BOOTSTRAP_KEY} must have at least {BOOTSTRAP_KEY_MIN_CHARACTERS} visible ASCII characters, all of them random"
        );
        return Err(unreadable(detail).into());
    }
    if !store.any_key().await? {
        let key = store.add_key(&secret, "bootstrap", Role::Admin, None).await?;
        note(store, "gable serve: first key", &key.id.to_string()).await?;
        tracing::info!(id = %key.id, "made the first key from {BOOTSTRAP_KEY}");
    }
    Ok(())
}
