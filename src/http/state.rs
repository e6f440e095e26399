//! What all handlers share.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::Semaphore;

use crate::configuration::Configuration;
use crate::control::near::Reach;
use crate::jobs::retention::{self, Retention};
use crate::jobs::{Jobs, Orient, Settings};
use crate::pipeline;
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
    /// Imports of control points at a time.
    pub imports: Arc<Semaphore>,
    /// Scans looked at a time for their interior orientation.
    pub scans: Arc<Semaphore>,
    key_was_made: Arc<AtomicBool>,
}

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
        Self {
            jobs: Jobs::new(store.clone(), settings, orient),
            store,
            configuration: Arc::new(configuration),
            readiness: Readiness::default(),
            imports: Arc::new(Semaphore::new(IMPORTS)),
            scans: Arc::new(Semaphore::new(scans)),
            key_was_made: Arc::default(),
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

    /// Whether a key was ever made, also by another process a moment ago.
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
