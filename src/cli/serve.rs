//! `gable serve`.

use std::time::Duration;

use anyhow::Context as _;
use clap::Args;
use gable::configuration::{Configuration, ConfigurationError, Setting};
use gable::http::{self, AppState};
use gable::store::Store;
use gable::store::keys::Role;
use tokio::net::TcpListener;

use super::Settings;

const BOOTSTRAP_KEY: &str = "GABLE_BOOTSTRAP_KEY";
const BOOTSTRAP_KEY_MIN_CHARACTERS: usize = 32;

/// Orientations under way are told to end when the service is, and heed it between small pieces of work.
const JOBS_END_PATIENCE: Duration = Duration::from_secs(3);

const EXAMPLES: &str = "\
Examples:
  gable serve
      Serves on http://127.0.0.1:8080 with everything in ./gable-data. Programs on this machine need no key as long as
      none is made. Look at http://127.0.0.1:8080/docs.

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
        let configuration = self.settings.gather(&[("listen", self.listen)])?;
        let listen = configuration.listen;
        let store = Store::open(&configuration.data).await?;
        let _lock = store.lock()?;
        make_bootstrap_key(&store).await?;
        let loopback = listen.ip().is_loopback();
        let any_key = store.any_key().await?;
        if !loopback && !any_key {
            let detail = format!(
                "listen is {listen}, which other machines can reach, but there is no key; make one with `gable key new \
                 --role admin`, or listen on 127.0.0.1"
            );
            return Err(ConfigurationError::Unreadable { detail }.into());
        }
        store.release_all_idempotency().await?;
        let swept = store.sweep_uploads().await?;
        if swept > 0 {
            tracing::info!(files = swept, "removed what unfinished uploads had left behind");
        }
        let stop = http::serve::stop_on_signals().context("signals cannot be caught")?;
        let listener = TcpListener::bind(listen).await.with_context(|| format!("cannot listen on {listen}"))?;
        let address = listener.local_addr()?;
        let state = AppState::new(store, configuration);
        let app = http::router(state.clone())?;
        state.jobs.prepare().await?;
        let (jobs, stop_jobs) = (state.jobs.clone(), stop.clone());
        let working = tokio::spawn(async move { jobs.run(stop_jobs).await });
        tracing::info!("listening on http://{address}, data in {}", state.store.folder().display());
        if !any_key {
            tracing::warn!("no key is made yet: every program on this machine is let in as admin");
        }
        http::serve::serve(listener, app, &state, stop).await;
        if tokio::time::timeout(JOBS_END_PATIENCE, working).await.is_err() {
            tracing::warn!("orientations under way do not end; they are taken up at the next start");
        }
        state.store.close().await;
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
        let key = store.add_key(&secret, "bootstrap", Role::Admin).await?;
        tracing::info!(id = %key.id, "made the first key from {BOOTSTRAP_KEY}");
    }
    Ok(())
}
