//! What all handlers share.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::body::Bytes;
use tokio::sync::Semaphore;

use super::rate::Rates;
use uuid::Uuid;

use crate::configuration::Configuration;
use crate::control::near::Reach;
use crate::jobs::pictures::Pictures;
use crate::jobs::retention::{self, Retention};
use crate::jobs::{Jobs, Orient, Settings};
use crate::pipeline;
use crate::store::recent::Recent;
use crate::store::{Store, StoreError};

/// Imports hold their body in memory, and the database takes one writer at a time anyway.
const IMPORTS: usize = 2;

/// What all handlers share. Cheap to clone.
#[derive(Debug, Clone)]
pub struct AppState {
    /// Cameras, images, keys; and the database for other rooms.
    pub store: Store,
    /// The settings.
    pub configuration: Arc<Configuration>,
    /// Whether the service can do its work.
    pub readiness: Readiness,
    /// Orientations: accepted, worked on, followed.
    pub jobs: Jobs,
    /// Images that are looked at.
    pub pictures: Pictures,
    /// Imports of control points at a time.
    pub imports: Arc<Semaphore>,
    /// Scans looked at a time for their interior orientation.
    pub scans: Arc<Semaphore>,
    /// How often each caller may ask.
    pub rates: Rates,
    /// How often each account and client address may fail to log in.
    pub failed_logins: Rates,
    /// Answers of orientations that have ended, as they were a moment ago.
    pub ended: Arc<Recent<Uuid, Bytes>>,
    key_was_made: Arc<AtomicBool>,
    uses_noted: Arc<Mutex<HashMap<String, Instant>>>,
}

/// Failed logins of one account or client address: so many at once, and then so many a second.
const FAILED_LOGINS: (f64, f64) = (20.0, 20.0 / 60.0);
/// How often the use of one key or session is noted.
const USE_NOTED_EVERY: Duration = Duration::from_secs(60);
/// Keys and sessions whose use was noted lately, before those are forgotten for whom that is long ago.
const USES_KEPT: usize = 1000;

impl AppState {
    /// The state of a service over `store`.
    #[must_use]
    pub fn new(store: Store, configuration: Configuration) -> Self {
        Self::with_pipeline(store, configuration, Arc::new(pipeline::orient))
    }

    /// The state of a service that orients images by another pipeline.
    #[must_use]
    pub fn with_pipeline(store: Store, configuration: Configuration, orient: Orient) -> Self {
        let settings = job_settings(&configuration);
        let scans = settings.workers;
        let (cache_bytes, reserve_bytes) = (configuration.viewer_cache_bytes, configuration.disk_reserve_bytes);
        let pictures = Pictures::new(store.clone(), &configuration.image_limits(), cache_bytes, reserve_bytes);
        let rates = Rates::new(configuration.rate_per_s, configuration.rate_burst);
        Self {
            jobs: Jobs::new(store.clone(), settings, orient),
            pictures,
            store,
            configuration: Arc::new(configuration),
            readiness: Readiness::default(),
            imports: Arc::new(Semaphore::new(IMPORTS)),
            scans: Arc::new(Semaphore::new(scans)),
            rates,
            failed_logins: Rates::new(FAILED_LOGINS.1, FAILED_LOGINS.0),
            ended: Arc::default(),
            key_was_made: Arc::default(),
            uses_noted: Arc::default(),
        }
    }

    /// Whether only programs on this machine can reach the service.
    #[must_use]
    pub fn listens_on_loopback(&self) -> bool {
        self.configuration.listen.ip().is_loopback()
    }

    /// How long things are kept.
    #[must_use]
    pub fn retention(&self) -> Retention {
        Retention {
            images_days: self.configuration.keep_images_days,
            green_days: self.configuration.keep_orientations_green_days,
            yellow_days: self.configuration.keep_orientations_yellow_days,
            red_days: self.configuration.keep_orientations_red_days,
        }
    }

    /// Removes what is not kept any longer, every hour, for ever.
    pub async fn keep_sweeping(&self) {
        retention::keep_sweeping(self.store.clone(), self.retention()).await;
    }

    /// Notes the use of a key or session beside the request, at most once a minute: nobody waits for it, and if it fails,
    /// so be it.
    pub fn note_use<F>(&self, of: String, note: impl FnOnce(Store) -> F + Send + 'static)
    where
        F: Future<Output = Result<(), StoreError>> + Send + 'static,
    {
        let now = Instant::now();
        let mut noted = self.uses_noted.lock().unwrap_or_else(PoisonError::into_inner);
        if noted.get(&of).is_some_and(|at| now - *at < USE_NOTED_EVERY) {
            return;
        }
        if noted.len() >= USES_KEPT {
            noted.retain(|_, at| now - *at < USE_NOTED_EVERY);
        }
        noted.insert(of, now);
        drop(noted);
        let noting = note(self.store.clone());
        tokio::spawn(async move {
            if let Err(error) = noting.await {
                tracing::debug!(%error, "the use of a key or session was not noted");
            }
        });
    }

    /// Whether a key or an account was ever made, also by another process a moment ago.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn any_key(&self) -> Result<bool, StoreError> {
        if self.key_was_made.load(Ordering::Relaxed) {
            return Ok(true);
        }
        let made = self.store.any_key().await?;
        self.key_was_made.fetch_or(made, Ordering::Relaxed);
        Ok(made)
    }
}

/// The bounds on the work that the settings say.
#[must_use]
pub fn job_settings(configuration: &Configuration) -> Settings {
    Settings {
        workers: configuration.worker_count(),
        queue_max: configuration.queue_max_jobs,
        max_attempts: configuration.job_max_attempts,
        timeout: Duration::from_secs(configuration.job_timeout_s),
        limits: configuration.image_limits(),
        reach: Reach::default(),
    }
}

/// What keeps the service from doing its work, part by part. Cheap to clone; all clones are the same.
#[derive(Debug, Clone, Default)]
pub struct Readiness(Arc<Mutex<BTreeMap<&'static str, String>>>);

impl Readiness {
    /// A part cannot do its work, and why.
    pub fn block(&self, part: &'static str, reason: impl Into<String>) {
        self.parts().insert(part, reason.into());
    }

    /// A part can do its work again.
    pub fn clear(&self, part: &str) {
        self.parts().remove(part);
    }

    /// The parts that cannot do their work, with the reasons.
    #[must_use]
    pub fn blocked(&self) -> BTreeMap<&'static str, String> {
        self.parts().clone()
    }

    fn parts(&self) -> std::sync::MutexGuard<'_, BTreeMap<&'static str, String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
