//! The service as a whole, from its data folder to its end.

use std::net::SocketAddr;
use std::time::Duration;

use axum::Router;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use crate::configuration::Configuration;
use crate::http::{self, AppState};
use crate::jobs::crew::Crew;
use crate::store::{FolderLock, Store, StoreError};
use crate::webhooks::{self, SecretError, Sender};

/// Why the service cannot begin.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServiceError {
    /// The data folder cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Everybody could do everything.
    #[error(
        "listen is {listen}, which other machines can reach, but there is no key; make one with `gable key new --role \
         admin`, or listen on 127.0.0.1"
    )]
    NoKey {
        /// The setting.
        listen: SocketAddr,
    },
    /// The address cannot be had.
    #[error("cannot listen on {listen}: {source}")]
    Listen {
        /// The setting.
        listen: SocketAddr,
        /// The cause.
        source: std::io::Error,
    },
    /// There is nothing to sign webhooks with.
    #[error("the secret of the webhooks: {0}")]
    WebhookSecret(#[from] SecretError),
    /// The OpenAPI document cannot be written.
    #[error("the contract cannot be written: {0}")]
    Contract(#[from] serde_json::Error),
}

/// Where images are oriented.
pub enum Work {
    /// In this process.
    Here,
    /// In processes of their own.
    InProcesses(Crew),
    /// By others that share the database.
    Elsewhere,
}

/// A service that has its data folder and its address. It answers as soon as it is run.
#[derive(Debug)]
pub struct Service {
    state: AppState,
    app: Router,
    listener: TcpListener,
    address: SocketAddr,
    webhooks: Option<Sender>,
    _lock: FolderLock,
}

/// Orientations under way are told to end when the service is, and heed it between small pieces of work.
const JOBS_END_PATIENCE: Duration = Duration::from_secs(4);

/// What still holds a connection by then was cut off.
const CLOSE_PATIENCE: Duration = Duration::from_secs(1);

impl Service {
    /// Takes the data folder and the address, and tidies up what a former service has left.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub async fn begin(store: Store, configuration: Configuration) -> Result<Self, ServiceError> {
        let listen = configuration.listen;
        let any_key = store.any_key().await?;
        if !listen.ip().is_loopback() && !any_key {
            return Err(ServiceError::NoKey { listen });
        }
        let service = Self::begin_with(store, configuration, http::router).await?;
        if !any_key {
            tracing::warn!("no key is made yet: every program on this machine is let in as admin");
        }
        Ok(service)
    }

    /// The same for a service that only works, and answers nothing but whether it does.
    ///
    /// # Errors
    /// [`ServiceError`].
    pub async fn begin_work(store: Store, configuration: Configuration) -> Result<Self, ServiceError> {
        Self::begin_with(store, configuration, |state| Ok(http::monitoring(state))).await
    }

    async fn begin_with(
        store: Store,
        configuration: Configuration,
        router: impl FnOnce(AppState) -> Result<Router, serde_json::Error>,
    ) -> Result<Self, ServiceError> {
        let listen = configuration.listen;
        let lock = store.lock()?;
        let fails = |source| ServiceError::Listen { listen, source };
        let listener = TcpListener::bind(listen).await.map_err(fails)?;
        let address = listener.local_addr().map_err(fails)?;
        if !store.database().is_shared() {
            store.release_all_idempotency().await?;
        }
        let swept = store.sweep_uploads().await?;
        if swept > 0 {
            tracing::info!(files = swept, "removed what unfinished uploads had left behind");
        }
        let state = AppState::new(store, configuration);
        state.jobs.prepare().await?;
        let webhooks = sender(&state).await?;
        let app = router(state.clone())?;
        tracing::info!("listening on http://{address}, data in {}", state.store.folder().display());
        Ok(Self { state, app, listener, address, webhooks, _lock: lock })
    }

    /// Where it listens; the port is a real one even if the configuration says 0.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What its handlers share.
    #[must_use]
    pub fn state(&self) -> &AppState {
        &self.state
    }

    /// Answers and works until `stop` is cancelled, and ends in time.
    pub async fn run(self, work: Work, stop: CancellationToken) {
        let (jobs, stop_jobs) = (self.state.jobs.clone(), stop.clone());
        let working = tokio::spawn(async move {
            match work {
                Work::Here => jobs.run(stop_jobs).await,
                Work::InProcesses(crew) => jobs.run_in_processes(crew, stop_jobs).await,
                Work::Elsewhere => jobs.tend(stop_jobs).await,
            }
        });
        let watching = tokio::spawn(http::health::watch(self.state.clone(), stop.clone()));
        let telling =
            self.webhooks.map(|sender| tokio::spawn(webhooks::run(self.state.store.clone(), sender, stop.clone())));
        let state = self.state.clone();
        let sweeping = tokio::spawn(async move { state.keep_sweeping().await });
        http::serve::serve(self.listener, self.app, &self.state, stop).await;
        watching.abort();
        sweeping.abort();
        if tokio::time::timeout(JOBS_END_PATIENCE, working).await.is_err() {
            tracing::warn!("orientations under way do not end; they are taken up at the next start");
        }
        if let Some(telling) = telling
            && tokio::time::timeout(JOBS_END_PATIENCE, telling).await.is_err()
        {
            tracing::warn!("webhooks under way do not end; they are sent again after the next start");
        }
        if tokio::time::timeout(CLOSE_PATIENCE, self.state.store.close()).await.is_err() {
            tracing::warn!("the database is still in use; what was not acknowledged is rolled back");
        }
    }
}

/// What tells webhooks; none on a machine that knows no authorities, where they wait.
async fn sender(state: &AppState) -> Result<Option<Sender>, ServiceError> {
    let configuration = &state.configuration;
    let secret = webhooks::secret(&state.store, configuration.webhook_secret.as_deref()).await?;
    let sender = Sender::new(configuration.webhook_policy(), secret, webhooks::by_the_system());
    Ok(sender.inspect_err(|error| tracing::error!(%error, "webhooks cannot be sent")).ok())
}
