//! The queue and the workers: an orientation that was accepted comes to its end, once, whatever happens in between.
//!
//! The row of an orientation is the truth (`store::orientations`). A worker that begins an attempt gets a lease; only
//! its holder may write a result, so a late or doubled attempt changes nothing. What was running when the process died
//! waits again after the next start, but not for ever: an orientation that has taken the process down with it three
//! times is given up.

pub mod active;
mod attempt;
mod blocks;
pub mod camera_model;
pub mod crew;
pub mod desks;
pub mod drift;
pub mod exports;
mod feed;
pub mod film_camera;
pub mod interior;
pub mod pictures;
mod queue;
pub mod request;
pub mod retention;
pub mod scenes;
#[cfg(test)]
mod tests;
pub mod training;
mod watcher;
pub mod worker;

use std::collections::HashMap;
use std::fmt;
use std::sync::atomic::AtomicUsize;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::{Notify, Semaphore, broadcast, mpsc};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use uuid::Uuid;

pub use attempt::{AttemptError, Oriented, oriented};
pub use feed::Change;

use active::ActiveClassifier;
use desks::Desks;

use crate::control::near::Reach;
use crate::features::Picture;
use crate::imagery::{ImageFile, Limits};
use crate::orientation::ControlPoint;
use crate::pipeline::{Fault, Observer, Outcome, Task};
use crate::report::drawing::Drawing;
use crate::report::overlay;
use crate::store::orientations::{self, Abandoned, NewOrientation, Orientation, Status};
use crate::store::{Store, StoreError};
use feed::{Teller, Told};
use queue::{Handler, Queue};
use watcher::Signal;

/// What is run for each image: [`crate::pipeline::orient`], or something simpler in tests.
pub type Orient =
    Arc<dyn Fn(&dyn Picture, &[ControlPoint], &Task, &dyn Observer) -> Result<Outcome, Fault> + Send + Sync>;

/// How often it is looked for attempts whose lease has run out.
const LOOK_INTERVAL: Duration = Duration::from_secs(2);
/// So many looks are between two times that the queue is tidied, and its figures are told.
const TIDY_EVERY: u32 = 5;
/// So many looks are between two times that the drift is measured.
const DRIFT_EVERY: u32 = 300;
/// How often one who waits for an orientation looks at its row, should nobody tell him.
const WAIT_INTERVAL: Duration = Duration::from_secs(1);

/// Bounds on the work.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Images oriented at a time.
    pub workers: usize,
    /// Orientations that may wait.
    pub queue_max: u32,
    /// How often an orientation is tried.
    pub max_attempts: u32,
    /// How long one attempt may take.
    pub timeout: Duration,
    /// What is read of pictures.
    pub limits: Limits,
    /// How far control points are looked for.
    pub reach: Reach,
}

/// Why an orientation was not accepted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SubmitError {
    /// Too many are waiting.
    #[error("{queue_max} orientations are waiting already")]
    QueueFull {
        /// How many may wait.
        queue_max: u32,
    },
    /// The database refused.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// The jobs. Cheap to clone.
#[derive(Clone)]
pub struct Jobs(Arc<Inner>);

struct Inner {
    /// Of this process.
    worker: Uuid,
    store: Store,
    settings: Settings,
    orient: Orient,
    queue: Queue,
    teller: Teller,
    /// To worker processes.
    work_added: broadcast::Sender<()>,
    workers_wanted: AtomicUsize,
    workers_alive: AtomicUsize,
    running: Mutex<HashMap<Uuid, Arc<Signal>>>,
    /// What this process has handed back while it was ending, and what the queue has handed out then.
    let_be: Mutex<Vec<Uuid>>,
    stopping: CancellationToken,
    drawing: Arc<Semaphore>,
    desks: Desks,
    active: ActiveClassifier,
    to_train: Notify,
}

impl fmt::Debug for Jobs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Jobs").field("settings", &self.0.settings).finish_non_exhaustive()
    }
}

impl Jobs {
    /// The jobs over a store. Nothing runs before [`Self::run`].
    #[must_use]
    pub fn new(store: Store, settings: Settings, orient: Orient) -> Self {
        Self::made(store, settings, orient, Uuid::now_v7(), Teller::new(None))
    }

    /// The jobs of a worker process.
    fn of_worker(
        store: Store,
        settings: Settings,
        orient: Orient,
        worker: Uuid,
        parent: mpsc::UnboundedSender<Told>,
    ) -> Self {
        Self::made(store, settings, orient, worker, Teller::new(Some(parent)))
    }

    fn made(store: Store, settings: Settings, orient: Orient, worker: Uuid, teller: Teller) -> Self {
        Self(Arc::new(Inner {
            worker,
            queue: Queue::new(store.database().clone()),
            store,
            teller,
            work_added: broadcast::channel(1).0,
            workers_wanted: AtomicUsize::new(0),
            workers_alive: AtomicUsize::new(0),
            running: Mutex::default(),
            let_be: Mutex::default(),
            stopping: CancellationToken::new(),
            drawing: Arc::new(Semaphore::new(settings.workers.max(1))),
            desks: Desks::default(),
            settings,
            orient,
            active: ActiveClassifier::default(),
            to_train: Notify::new(),
        }))
    }

    /// Takes up again what a former process has left. With a shared database others may be at work: there it is found by
    /// its leases.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn prepare(&self) -> Result<(), StoreError> {
        if self.0.store.database().is_shared() {
            return Ok(());
        }
        let mut transaction = self.0.store.begin_write().await?;
        self.0.queue.clear(&mut transaction).await?;
        orientations::recover(&mut transaction, Abandoned::All, "together with the service").await?;
        let waiting = orientations::waiting(&mut transaction).await?;
        for (id, turn) in &waiting {
            self.0.queue.push(&mut transaction, *id, *turn).await?;
        }
        transaction.commit().await?;
        if !waiting.is_empty() {
            tracing::info!(orientations = waiting.len(), "took up what was waiting");
        }
        self.0.gauge_queue(waiting.len());
        Ok(())
    }

    /// Works in this process until `stop`, and looks after the queue.
    pub async fn run(&self, stop: CancellationToken) {
        tokio::join!(self.work(stop.clone()), self.tend(stop));
    }

    /// Works until `stop`. Then attempts under way are interrupted, and wait again.
    pub(crate) async fn work(&self, stop: CancellationToken) {
        // attempts are tasks of their own: the queue may drop what it has handed out when it ends
        let attempts = TaskTracker::new();
        let quiet = CancellationToken::new();
        let (inner, spawner) = (self.0.clone(), attempts.clone());
        let handler = Handler::new(move |id| {
            let attempt = spawner.spawn(inner.clone().attempt(id));
            Box::pin(async move {
                if let Err(error) = attempt.await {
                    tracing::error!(%id, %error, "an attempt has panicked");
                }
            })
        });
        let interrupt = async {
            stop.cancelled().await;
            self.0.stopping.cancel();
            for signal in self.0.running().values() {
                signal.interrupt();
            }
            // the queue goes last: dropped while it writes, it can leave the database locked, and those under way
            // could not write where they stand. What it still hands out is let be, see `attempt`
            attempts.close();
            attempts.wait().await;
            quiet.cancel();
        };
        let deliver = self.0.queue.deliver(self.0.settings.workers, handler, quiet.clone());
        tokio::join!(deliver, interrupt);
        attempts.wait().await;
        if let Err(error) = self.0.give_back().await {
            tracing::error!(%error, "what the queue has handed out at the end could not be given back");
        }
    }

    /// Looks after the queue until `stop`: attempts that nobody ends any more, trainings, figures, and what other
    /// services tell.
    pub async fn tend(&self, stop: CancellationToken) {
        let ending = async {
            stop.cancelled().await;
            self.0.stopping.cancel();
        };
        let training = tokio::spawn(self.0.clone().train());
        tokio::select! {
            () = ending => {}
            () = self.tidy() => {}
            () = self.0.listen() => {}
        }
        if let Err(error) = training.await {
            tracing::error!(%error, "the training of classifiers has panicked");
        }
    }

    async fn tidy(&self) {
        for look in 0_u32.. {
            if let Err(error) =
                self.0.recover(Abandoned::Late, "nothing was heard of it for longer than its lease").await
            {
                tracing::warn!(%error, "it could not be looked for abandoned attempts");
            }
            if look.is_multiple_of(TIDY_EVERY)
                && let Err(error) = self.0.tidy_queue().await
            {
                tracing::warn!(%error, "the queue could not be tidied");
            }
            if look.is_multiple_of(DRIFT_EVERY) {
                self.0.gauge_drift().await;
            }
            tokio::time::sleep(LOOK_INTERVAL).await;
        }
    }

    /// Accepts an orientation: when this returns, it will come to its end.
    ///
    /// # Errors
    /// [`SubmitError`]; then nothing was accepted.
    pub async fn submit(&self, new: &NewOrientation) -> Result<(), SubmitError> {
        let mut transaction = self.0.store.begin_write().await?;
        // the second try of a request that was accepted already is no new one
        if self.submit_all(&mut transaction, std::slice::from_ref(new)).await? > 0 {
            transaction.commit().await.map_err(StoreError::from)?;
            self.announce(std::slice::from_ref(new)).await;
        }
        Ok(())
    }

    /// Says that a classifier waits to be trained.
    pub fn announce_training(&self) {
        self.0.to_train.notify_one();
    }

    /// The classifier that decides at present.
    ///
    /// # Errors
    /// [`ActiveError`](active::ActiveError).
    pub async fn active_classifier(&self) -> Result<active::NamedClassifier, active::ActiveError> {
        self.0.active.get(&self.0.store).await
    }

    /// Cancels an orientation that has not ended; `false` if it has, or if there is none.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn cancel(&self, id: Uuid) -> Result<bool, StoreError> {
        let cancelled = self.0.store.cancel(id).await?;
        if cancelled {
            if let Some(signal) = self.0.running().get(&id) {
                signal.interrupt();
            }
            self.0.ended(id, Status::Cancelled, None).await;
        }
        Ok(cancelled)
    }

    /// What happens from now on, to all orientations.
    #[must_use]
    pub fn subscribe(&self) -> broadcast::Receiver<Change> {
        self.0.teller.subscribe()
    }

    /// The orientation, as soon as it has ended, or as it stands after `patience` or when the service ends.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn wait(&self, id: Uuid, patience: Duration) -> Result<Option<Orientation>, StoreError> {
        // first listen, then look: nothing can happen unnoticed in between
        let mut changes = self.subscribe();
        let until = Instant::now() + patience;
        loop {
            let now = self.0.store.orientation(id).await?;
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() || now.as_ref().is_none_or(|orientation| orientation.status.is_final()) {
                return Ok(now);
            }
            let ended = async {
                loop {
                    match changes.recv().await {
                        Ok(change) if change.id == id && change.status.is_final() => return,
                        Ok(_) => {}
                        // some were missed: look
                        Err(_) => return,
                    }
                }
            };
            tokio::select! {
                () = ended => {}
                () = tokio::time::sleep(left.min(WAIT_INTERVAL)) => {}
                () = self.0.stopping.cancelled() => return self.0.store.orientation(id).await,
            }
        }
    }

    /// The overlay of an orientation that has succeeded, as a file. No more are drawn at a time than images are oriented:
    /// each needs the whole picture.
    ///
    /// # Errors
    /// [`AttemptError`] if the picture cannot be read any more.
    pub async fn overlay(
        &self,
        orientation: &Orientation,
        widest_px: u32,
        format: overlay::Format,
    ) -> Result<Vec<u8>, AttemptError> {
        let image = self.0.store.image(orientation.image_id).await?.ok_or(AttemptError::Missing { what: "image" })?;
        let drawing: Drawing = Drawing::kept(orientation.drawing.as_deref())?;
        let (path, limits) = (self.0.store.image_file(&image.sha256).await?, self.0.settings.limits.clone());
        let permit = self.0.drawing.clone().acquire_owned().await;
        let draw = move || {
            let _permit = permit;
            let picture = ImageFile::open(&path, &limits)?;
            Ok(overlay::overlay(&picture, &drawing, widest_px, format)?)
        };
        tokio::task::spawn_blocking(draw).await.map_err(attempt::panicked)?
    }

    /// Cancelled when the service begins to end.
    #[must_use]
    pub fn stopping(&self) -> &CancellationToken {
        &self.0.stopping
    }
}

impl Inner {
    fn running(&self) -> MutexGuard<'_, HashMap<Uuid, Arc<Signal>>> {
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn let_be(&self) -> MutexGuard<'_, Vec<Uuid>> {
        self.let_be.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn ended(&self, id: Uuid, status: Status, verdict: Option<&str>) {
        let verdict = verdict.map(str::to_owned);
        let change = Change { verdict: verdict.clone(), ..Change::to(id, status) };
        self.teller.tell(Told::Change(change.clone()));
        self.teller.tell(Told::Ended { status, verdict });
        self.tell_others(&change).await;
    }

    /// What was handed out at the end is done for the queue, or held by it for this process, but waits still: it goes back,
    /// for others. It may well be what this process has handed back a moment before. That it may be in the queue twice
    /// does no harm.
    async fn give_back(&self) -> Result<(), StoreError> {
        let let_be = std::mem::take(&mut *self.let_be());
        if let_be.is_empty() {
            return Ok(());
        }
        let mut transaction = self.store.begin_write().await?;
        for (id, turn) in orientations::waiting(&mut transaction).await? {
            if let_be.contains(&id) {
                self.queue.push(&mut transaction, id, turn).await?;
            }
        }
        transaction.commit().await.map_err(StoreError::from)?;
        self.call_workers().await;
        Ok(())
    }

    /// Makes abandoned attempts wait again.
    async fn recover(&self, abandoned: Abandoned, fate: &str) -> Result<(), StoreError> {
        if abandoned == Abandoned::Late && !self.store.any_late().await? {
            return Ok(());
        }
        let mut transaction = self.store.begin_write().await?;
        let waiting = orientations::recover(&mut transaction, abandoned, fate).await?;
        for (id, turn) in &waiting {
            self.queue.push(&mut transaction, *id, *turn).await?;
        }
        transaction.commit().await.map_err(StoreError::from)?;
        if !waiting.is_empty() {
            tracing::warn!(orientations = waiting.len(), fate, "abandoned attempts wait again");
            self.call_workers().await;
        }
        Ok(())
    }

    async fn tidy_queue(&self) -> Result<(), StoreError> {
        self.queue.forget_done().await?;
        self.gauge_queue(self.store.queued().await? as usize);
        let oldest_s = self.store.oldest_wait().await?.unwrap_or_default().as_secs_f64();
        metrics::gauge!("gable_queue_oldest_seconds").set(oldest_s);
        Ok(())
    }

    fn gauge_queue(&self, waiting: usize) {
        metrics::gauge!("gable_queue_depth").set(waiting as f64);
    }
}
