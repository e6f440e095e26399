//! One attempt at one orientation: from the row to the row.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::{broadcast, watch};
use uuid::Uuid;

use super::request::{Prepared, Work};
use super::{Change, Inner, Orient};
use crate::control::{self, ControlError};
use crate::features::{Picture as _, PictureError};
use crate::geometry::CrsError;
use crate::imagery::{ImageFile, ImageryError, Limits};
use crate::orientation::ControlPoint;
use crate::pipeline::{Fault, Observer, Stage};
use crate::report::overlay::Drawing;
use crate::report::{self, OrientationResult};
use crate::store::StoreError;
use crate::store::orientations::{self, Failure, Finished, Orientation, Status};

/// How often the progress of an attempt is written to its row.
const NOTE_INTERVAL: Duration = Duration::from_millis(500);

/// Why an attempt has no result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AttemptError {
    /// The picture cannot be used.
    #[error(transparent)]
    Imagery(#[from] ImageryError),
    /// The picture is damaged.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// It was interrupted, by a cancel, by its time limit, or by the end of the service.
    #[error("interrupted")]
    Interrupted,
    /// The result cannot be given in the CRS that was asked for.
    #[error("the result cannot be given in the output CRS: {0}")]
    Crs(#[from] CrsError),
    /// The control points cannot be read.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Stored JSON cannot be read, or a result not be written.
    #[error("JSON of an orientation: {0}")]
    Json(#[from] serde_json::Error),
    /// The row refers to something that is not there.
    #[error("the {what} of the orientation is not there any more")]
    Missing {
        /// What.
        what: &'static str,
    },
    /// The pipeline panicked.
    #[error("the pipeline has panicked: {detail}")]
    Panic {
        /// Its last words.
        detail: String,
    },
}

impl From<Fault> for AttemptError {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Picture(error) => Self::Picture(error),
            Fault::Cancelled => Self::Interrupted,
        }
    }
}

impl AttemptError {
    /// What the client is told if it is for good; `None` if another attempt may succeed.
    fn failure(&self) -> Option<Failure> {
        let failure = |code: &str, detail: String| Some(Failure { code: code.to_owned(), detail });
        match self {
            Self::Imagery(ImageryError::Read { .. }) => None,
            Self::Imagery(error) => failure("image_unusable", error.to_string()),
            Self::Picture(error) => failure("image_unusable", error.to_string()),
            Self::Crs(_) => failure("output_crs", self.to_string()),
            Self::Missing { .. } => failure("missing", self.to_string()),
            _ => None,
        }
    }
}

/// Ends an attempt early, from outside.
#[derive(Debug)]
pub(super) struct Signal {
    interrupted: AtomicBool,
    deadline: Instant,
}

impl Signal {
    pub(super) fn interrupt(&self) {
        self.interrupted.store(true, Ordering::Relaxed);
    }

    fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    fn is_late(&self) -> bool {
        Instant::now() >= self.deadline
    }
}

/// Listens to the pipeline: passes on where it is, measures its stages, and tells it to end.
struct Watcher {
    id: Uuid,
    signal: Arc<Signal>,
    changes: broadcast::Sender<Change>,
    notes: watch::Sender<(&'static str, f64)>,
    stage: Mutex<Option<(Stage, Instant)>>,
}

impl Observer for Watcher {
    fn progress(&self, stage: Stage, fraction: f64) {
        self.measure(Some(stage));
        let change = Change { id: self.id, status: Status::Running, stage: Some(stage.name()), progress: fraction };
        let _ = self.changes.send(change);
        self.notes.send_replace((stage.name(), fraction));
    }

    fn cancelled(&self) -> bool {
        self.signal.is_interrupted() || self.signal.is_late()
    }
}

impl Watcher {
    /// Records how long the last stage has taken when another one begins.
    fn measure(&self, stage: Option<Stage>) {
        let mut current = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        if current.map(|(stage, _)| stage) == stage {
            return;
        }
        if let Some((ended, began)) = current.take() {
            let seconds = began.elapsed().as_secs_f64();
            metrics::histogram!("gable_stage_duration_seconds", "stage" => ended.name()).record(seconds);
        }
        *current = stage.map(|stage| (stage, Instant::now()));
    }
}

/// Orients one picture file: what the service does for an orientation, without the service.
///
/// # Errors
/// [`AttemptError`] if the file cannot be used or the observer interrupts.
pub fn oriented(
    orient: &Orient,
    path: &Path,
    limits: &Limits,
    control: &[ControlPoint],
    (prepared, work): (&Prepared, &Work),
    observer: &dyn Observer,
) -> Result<(OrientationResult, Drawing), AttemptError> {
    let picture = ImageFile::open(path, limits)?;
    let camera = &work.task.camera;
    if picture.size_px() != [camera.width_px, camera.height_px] {
        let [width, height] = picture.size_px();
        let detail = format!("the picture has {width} x {height} px, which is not what its header says");
        return Err(PictureError { detail }.into());
    }
    let outcome = orient(&picture, control, &work.task, observer)?;
    let (approximation, warnings) = (prepared.approximation.clone(), prepared.warnings.clone());
    let result = report::result(&outcome, &work.frame, &work.output, approximation, warnings)?;
    Ok((result, Drawing::of(&outcome)))
}

/// All that an attempt needs from the database.
struct Loaded {
    path: PathBuf,
    prepared: Prepared,
    work: Work,
    control: Vec<ControlPoint>,
}

impl Inner {
    /// Takes an orientation as far as it goes. Whatever happens, its row says so afterwards.
    pub(super) async fn attempt(self: Arc<Self>, id: Uuid) {
        if let Err(error) = self.clone().attempted(id).await {
            // the row stays as it is, and is taken up again at the next start
            tracing::error!(%id, %error, "the outcome of an attempt could not be written");
        }
    }

    async fn attempted(self: Arc<Self>, id: Uuid) -> Result<(), StoreError> {
        let deadline = Instant::now() + self.settings.timeout;
        let signal = Arc::new(Signal { interrupted: AtomicBool::new(false), deadline });
        // before the row says that it is running, so that a cancel finds it
        if self.running().insert(id, signal.clone()).is_some() {
            tracing::error!(%id, "the queue has delivered an orientation twice at a time");
        }
        let result = match self.stopping.is_cancelled() {
            true => Ok(()),
            false => self.clone().under_signal(id, signal).await,
        };
        self.running().remove(&id);
        result
    }

    async fn under_signal(self: Arc<Self>, id: Uuid, signal: Arc<Signal>) -> Result<(), StoreError> {
        let lease = Uuid::now_v7();
        let Some(orientation) = self.store.begin_attempt(id, lease).await? else {
            return Ok(());
        };
        self.count_queue().await?;
        let max_attempts = self.settings.max_attempts;
        if orientation.attempts > max_attempts {
            let detail = format!(
                "given up: {max_attempts} attempts have ended without a result, perhaps together with the service"
            );
            return self.give_up(lease, id, &Failure { code: "given_up".to_owned(), detail }).await;
        }
        let _ = self.changes.send(Change { id, status: Status::Running, stage: None, progress: 0.0 });
        let began = Instant::now();
        let worked = self.clone().work(&orientation, lease, signal.clone()).await;
        metrics::histogram!("gable_orientation_duration_seconds").record(began.elapsed().as_secs_f64());
        match worked {
            Ok(finished) => self.finish(lease, id, &finished).await,
            Err(error) => self.unfinished(lease, &orientation, &error, &signal).await,
        }
    }

    async fn work(
        self: Arc<Self>,
        orientation: &Orientation,
        lease: Uuid,
        signal: Arc<Signal>,
    ) -> Result<Finished, AttemptError> {
        let Loaded { path, prepared, work, control } = self.load(orientation).await?;
        tracing::info!(id = %orientation.id, attempt = orientation.attempts, control_points = control.len(), "orienting");
        let (notes, noted) = watch::channel(("", 0.0));
        let watcher =
            Watcher { id: orientation.id, signal, changes: self.changes.clone(), notes, stage: Mutex::default() };
        let (orient, limits) = (self.orient.clone(), self.settings.limits.clone());
        let mut blocking = tokio::task::spawn_blocking(move || {
            let oriented = oriented(&orient, &path, &limits, &control, (&prepared, &work), &watcher);
            watcher.measure(None);
            oriented
        });
        let joined = tokio::select! {
            joined = &mut blocking => joined,
            // ends when the watcher is dropped with the blocking task
            () = self.note(noted, lease, orientation.id) => blocking.await,
        };
        let (result, drawing) = joined.map_err(panicked)??;
        Ok(Finished {
            verdict: result.diagnosis.verdict.to_owned(),
            result: serde_json::to_string(&result)?,
            drawing: serde_json::to_string(&drawing)?,
        })
    }

    async fn load(&self, orientation: &Orientation) -> Result<Loaded, AttemptError> {
        let image = self.store.image(orientation.image_id).await?.ok_or(AttemptError::Missing { what: "image" })?;
        let camera = self.store.camera(&orientation.camera_id.to_string()).await?;
        let camera = camera.ok_or(AttemptError::Missing { what: "camera" })?.camera;
        let prepared: Prepared = serde_json::from_str(&orientation.prepared)?;
        let work = prepared.work(camera)?;
        let pool = self.store.pool();
        let control =
            control::around(pool, &work.frame, &camera, &work.task.approximation, self.settings.reach).await?;
        Ok(Loaded { path: self.store.image_path(&image.sha256), prepared, work, control })
    }

    /// Writes the progress to the row, now and then.
    async fn note(&self, mut noted: watch::Receiver<(&'static str, f64)>, lease: Uuid, id: Uuid) {
        while noted.changed().await.is_ok() {
            let (stage, fraction) = *noted.borrow_and_update();
            if let Err(error) = self.store.note_progress(lease, id, stage, fraction).await {
                tracing::warn!(%id, %error, "progress could not be noted");
            }
            tokio::time::sleep(NOTE_INTERVAL).await;
        }
    }

    async fn finish(&self, lease: Uuid, id: Uuid, finished: &Finished) -> Result<(), StoreError> {
        if self.store.finish(lease, id, finished).await? {
            tracing::info!(%id, verdict = finished.verdict, "oriented");
            self.ended(id, Status::Succeeded, Some(&finished.verdict));
        }
        Ok(())
    }

    async fn give_up(&self, lease: Uuid, id: Uuid, failure: &Failure) -> Result<(), StoreError> {
        if self.store.fail(lease, id, failure).await? {
            tracing::warn!(%id, code = failure.code, detail = failure.detail, "failed");
            self.ended(id, Status::Failed, None);
        }
        Ok(())
    }

    /// What becomes of an orientation after an attempt without a result.
    async fn unfinished(
        &self,
        lease: Uuid,
        orientation: &Orientation,
        error: &AttemptError,
        signal: &Signal,
    ) -> Result<(), StoreError> {
        let id = orientation.id;
        let interrupted = matches!(error, AttemptError::Interrupted);
        if interrupted && signal.is_late() {
            let seconds = self.settings.timeout.as_secs();
            let detail = format!("the attempt has taken longer than {seconds} s (set by `job_timeout_s`)");
            return self.give_up(lease, id, &Failure { code: "timeout".to_owned(), detail }).await;
        }
        let interrupted = interrupted && signal.is_interrupted();
        if interrupted && !self.stopping.is_cancelled() {
            // cancelled: its row has said so since, and keeps its word
            return Ok(());
        }
        if let Some(failure) = error.failure() {
            return self.give_up(lease, id, &failure).await;
        }
        if !interrupted {
            tracing::error!(%id, attempt = orientation.attempts, %error, "an attempt has failed");
        }
        if !interrupted && orientation.attempts >= self.settings.max_attempts {
            let detail = "the service has made a mistake; its log says more under this id".to_owned();
            return self.give_up(lease, id, &Failure { code: "internal".to_owned(), detail }).await;
        }
        let mut transaction = self.store.begin_write().await?;
        if orientations::release(&mut transaction, lease, id, !interrupted).await? {
            self.queue.push(&mut transaction, id).await?;
            transaction.commit().await?;
            self.queue.announce();
        }
        Ok(())
    }

    async fn count_queue(&self) -> Result<(), StoreError> {
        let mut transaction = self.store.pool().begin().await?;
        self.gauge_queue(orientations::queued(&mut transaction).await? as usize);
        Ok(())
    }
}

/// A blocking task that has not come to its end.
pub(super) fn panicked(error: tokio::task::JoinError) -> AttemptError {
    let detail = match error.try_into_panic() {
        Ok(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("of an unknown kind").to_owned()
        }
        Err(error) => error.to_string(),
    };
    AttemptError::Panic { detail }
}
