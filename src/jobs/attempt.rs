//! One attempt at one orientation: from the row to the row.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::watch;
use uuid::Uuid;

use super::active::ActiveError;
use super::camera_model::{CameraModelError, camera_model};
use super::feed::{Change, Told};
use super::request::{CameraModel, Prepared, Work};
use super::scenes::ControlNear;
use super::watcher::{Signal, Watcher};
use super::{Inner, Orient};
use crate::classifiers::Record;
use crate::control::ControlError;
use crate::diagnosis::Verdict;
use crate::features::{Picture as _, PictureError};
use crate::geometry::{Camera, CrsError};
use crate::imagery::{self, ImageFile, ImageryError, Limits};
use crate::orientation::ControlPoint;
use crate::pipeline::{ControlKind, ControlPointResult, Fault, FilmOutcome, Observer, Outcome, orient_film};
use crate::report::drawing::Drawing;
use crate::report::interior::InteriorResult;
use crate::report::result::{DiagnosisReport, ReasonReport};
use crate::report::{self, OrientationResult};
use crate::store::StoreError;
use crate::store::images::INCOMING;
use crate::store::orientations::{
    self, Claim, DiagnosisInShort, Failure, Finished, Orientation, ReasonInShort, Status,
};
use crate::store::sightings::Sighting;

/// How often the progress of an attempt is written to its row.
const NOTE_INTERVAL: Duration = Duration::from_millis(500);
/// How often an attempt says that it goes on; its lease is several times as long.
const HEARTBEAT: Duration = Duration::from_secs(5);
/// Tries to write a row once the service is ending.
const LAST_TRIES: usize = 8;
/// After the database has failed, before it is tried again; doubled each time, up to the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(10);

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
    /// There is no classifier to decide.
    #[error(transparent)]
    Classifier(#[from] ActiveError),
    /// Stored JSON cannot be read, or a result not be written.
    #[error("JSON of an orientation: {0}")]
    Json(#[from] serde_json::Error),
    /// The camera cannot be used.
    #[error(transparent)]
    Camera(#[from] CameraModelError),
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
            Self::Classifier(ActiveError::Unreadable { .. }) => failure("classifier_unreadable", self.to_string()),
            _ => None,
        }
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
) -> Result<Oriented, AttemptError> {
    let picture = ImageFile::open(path, limits)?;
    let (outcome, interior) = match &work.camera {
        CameraModel::Digital(camera) => (of_digital(orient, &picture, control, work, camera, observer)?, None),
        CameraModel::Film(camera) => {
            let wanted = prepared.scan.wanted(imagery::probe(path, limits)?.pixel_size_um);
            let task = work.film_task(camera.clone(), wanted);
            let FilmOutcome { interior, outcome } = orient_film(&**orient, &picture, control, &task, observer)?;
            (outcome, Some(InteriorResult::of(&interior, &camera.plate, picture.size_px())))
        }
    };
    told(&outcome, interior, control, (prepared, work))
}

/// What is told of an outcome, and kept.
pub(super) fn told(
    outcome: &Outcome,
    interior: Option<InteriorResult>,
    control: &[ControlPoint],
    (prepared, work): (&Prepared, &Work),
) -> Result<Oriented, AttemptError> {
    let (approximation, warnings) = (prepared.approximation.clone(), prepared.warnings.clone());
    let mut result = report::result(outcome, &work.frame, &work.output, approximation, warnings, work.decides.clone())?;
    result.interior_orientation = interior;
    let accepted = outcome.diagnosis.verdict == Verdict::Green;
    // of buildings only: a scene may have the name of one
    let buildings = outcome.control_points.iter().filter(|point| point.kind == ControlKind::Lines);
    let sightings = buildings.filter(|_| accepted).map(sighting).collect();
    let drawing = Drawing::of(outcome, control, &work.frame, &prepared.approximation.position)?;
    Ok(Oriented { result, drawing, record: Record::of(outcome), sightings })
}

fn of_digital(
    orient: &Orient,
    picture: &ImageFile,
    control: &[ControlPoint],
    work: &Work,
    camera: &Camera,
    observer: &dyn Observer,
) -> Result<Outcome, AttemptError> {
    check_size(picture, camera)?;
    Ok(orient(picture, control, &work.task(*camera), observer)?)
}

pub(super) fn check_size(picture: &ImageFile, camera: &Camera) -> Result<(), PictureError> {
    let [width, height] = picture.size_px();
    if [width, height] == [camera.width_px, camera.height_px] {
        return Ok(());
    }
    let detail = format!("the picture has {width} x {height} px, which is not what its header says");
    Err(PictureError { detail })
}

/// All that is kept of an oriented image.
#[derive(Debug, Clone, PartialEq)]
pub struct Oriented {
    /// The answer.
    pub result: OrientationResult,
    /// What the overlay shows.
    pub drawing: Drawing,
    /// What the verdict rested on.
    pub record: Record,
    /// What an accepted image says of the buildings among its control points.
    pub sightings: Vec<(String, Sighting)>,
}

fn sighting(point: &ControlPointResult) -> (String, Sighting) {
    let contradicts = point.sensitivity.is_some_and(|sensitivity| sensitivity.contradicts);
    let sighting = match point.used {
        false => Sighting::Missed,
        true if contradicts => Sighting::Contradicts,
        true => Sighting::Found,
    };
    (point.name.clone(), sighting)
}

/// What lists show of a diagnosis.
fn in_short(diagnosis: &DiagnosisReport) -> DiagnosisInShort {
    let DiagnosisReport { score, probability_correct, reasons, .. } = diagnosis;
    let reason = |reason: &ReasonReport| ReasonInShort { code: reason.code.to_owned(), detail: reason.detail.clone() };
    DiagnosisInShort {
        score: *score,
        probability_correct: *probability_correct,
        reasons: reasons.iter().map(reason).collect(),
    }
}

/// All that an attempt needs from the database.
pub(super) struct Loaded {
    pub(super) path: PathBuf,
    pub(super) prepared: Prepared,
    pub(super) work: Work,
    pub(super) control: ControlNear,
}

/// What is written to the row at the end of an attempt.
#[derive(Debug)]
enum Ending {
    /// The result.
    Finished(Finished),
    /// That there will be none.
    GivenUp(Failure),
    /// That it waits again; whether the attempt counts.
    Again { counted: bool },
    /// Nothing: it was cancelled, and its row says so already.
    Cancelled,
}

impl Ending {
    fn name(&self) -> &'static str {
        match self {
            Self::Finished(_) => "finished",
            Self::GivenUp(_) => "given_up",
            Self::Again { .. } => "again",
            Self::Cancelled => "cancelled",
        }
    }
}

impl Inner {
    /// Takes an orientation as far as it goes. Whatever happens, its row says so afterwards.
    pub(super) async fn attempt(self: Arc<Self>, id: Uuid) {
        let signal = Signal::new(self.settings.timeout);
        // before the row says that it is running, so that a cancel finds it
        if self.running().insert(id, signal.clone()).is_some() {
            tracing::error!(%id, "the queue has delivered an orientation twice at a time");
        }
        // whoever ends the service from now on finds the signal
        if self.stopping.is_cancelled() {
            self.let_be().push(id);
        } else {
            self.clone().under_signal(id, signal).await;
        }
        self.running().remove(&id);
    }

    async fn under_signal(self: Arc<Self>, id: Uuid, signal: Arc<Signal>) {
        let claim = Claim { id, lease: Uuid::now_v7() };
        let Some(Some(orientation)) = self.insist(id, || self.store.begin_attempt(claim, self.worker)).await else {
            return;
        };
        let ending = if orientation.attempts > self.settings.max_attempts {
            self.too_often(orientation.fate.as_deref())
        } else {
            let begun = Change::to(id, Status::Running);
            self.teller.tell(Told::Change(begun.clone()));
            self.tell_others(&begun).await;
            let began = Instant::now();
            let worked = self.clone().work(&orientation, claim, signal.clone()).await;
            let ending = worked.map_or_else(|error| self.ending(&orientation, &error, &signal), Ending::Finished);
            let (outcome, seconds) = (ending.name().into(), began.elapsed().as_secs_f64());
            self.teller.tell(Told::Attempt { outcome, seconds });
            ending
        };
        self.insist(id, || self.write(claim, &orientation, &ending)).await;
    }

    /// Tries until the database does it: it may be full or busy for a while. `None` if the service ends before; then
    /// the next start takes it up.
    async fn insist<T, F: Future<Output = Result<T, StoreError>>>(&self, id: Uuid, step: impl Fn() -> F) -> Option<T> {
        let mut pause = FIRST_PAUSE;
        while !self.stopping.is_cancelled() {
            match step().await {
                Ok(done) => return Some(done),
                Err(error) => tracing::error!(%id, %error, "the row of an orientation cannot be written; trying again"),
            }
            let _ = tokio::time::timeout(pause, self.stopping.cancelled()).await;
            pause = (2 * pause).min(LONGEST_PAUSE);
        }
        // a few last times, quickly: what has come out should not be lost to a service that ends in order while another
        // connection holds the database
        for _ in 1..LAST_TRIES {
            match step().await {
                Ok(done) => return Some(done),
                Err(error) => tracing::warn!(%id, %error, "the row of an orientation cannot be written while ending"),
            }
            tokio::time::sleep(FIRST_PAUSE).await;
        }
        step().await.ok()
    }

    async fn work(
        self: Arc<Self>,
        orientation: &Orientation,
        claim: Claim,
        signal: Arc<Signal>,
    ) -> Result<Finished, AttemptError> {
        let Loaded { path, prepared, work, control } = self.load(orientation).await?;
        let [buildings, scenes] = control.counts();
        tracing::info!(id = %orientation.id, attempt = orientation.attempts, buildings, scenes, "orienting");
        let (watcher, noted) = Watcher::new(orientation.id, signal.clone(), self.teller.clone());
        let (orient, limits) = (self.orient.clone(), self.settings.limits.clone());
        let incoming = self.store.folder().join(INCOMING);
        let mut blocking = tokio::task::spawn_blocking(move || {
            let control = control.read(&work.frame, &incoming, &limits);
            let oriented = oriented(&orient, &path, &limits, &control, (&prepared, &work), &watcher);
            watcher.end();
            oriented
        });
        let joined = tokio::select! {
            joined = &mut blocking => joined,
            // ends when the watcher is dropped with the blocking task
            () = self.note(noted, claim, &signal) => blocking.await,
        };
        let Oriented { result, drawing, record, sightings } = joined.map_err(panicked)??;
        Ok(Finished {
            record: serde_json::to_string(&record)?,
            sightings,
            verdict: result.diagnosis.verdict.to_owned(),
            diagnosis: in_short(&result.diagnosis),
            result: serde_json::to_string(&result)?,
            drawing: serde_json::to_string(&drawing)?,
        })
    }

    pub(super) async fn load(&self, orientation: &Orientation) -> Result<Loaded, AttemptError> {
        let image = self.store.image(orientation.image_id).await?.ok_or(AttemptError::Missing { what: "image" })?;
        let camera = camera_model(&self.store, &orientation.camera_id.to_string()).await?;
        let camera = camera.ok_or(AttemptError::Missing { what: "camera" })?;
        let prepared: Prepared = serde_json::from_str(&orientation.prepared)?;
        let mut work = prepared.work(camera, &self.active.get(&self.store).await?)?;
        let control = ControlNear::find(self.store.database(), &work, self.settings.reach, &prepared.wanted()).await?;
        work.check = control.check();
        Ok(Loaded { path: self.store.image_file(&image.sha256).await?, prepared, work, control })
    }

    /// Writes the progress to the row, now and then, which keeps the lease; and interrupts an attempt that is nobody's any
    /// more: it was cancelled, or given to another process.
    async fn note(&self, mut noted: watch::Receiver<(&'static str, f64)>, claim: Claim, signal: &Signal) {
        let mut kept = Instant::now();
        // an end of the channel is the end of the attempt
        while noted.has_changed().is_ok() {
            let news = noted.has_changed().unwrap_or_default();
            let held = if news || kept.elapsed() >= HEARTBEAT {
                kept = Instant::now();
                let (stage, fraction) = *noted.borrow_and_update();
                let held = self.store.note_progress(claim, stage, fraction).await;
                let change = Change::to(claim.id, Status::Running);
                self.tell_others(&Change { stage: Some(stage.into()), progress: fraction, ..change }).await;
                held
            } else {
                self.store.holds(claim).await
            };
            match held {
                Ok(true) => {}
                Ok(false) => signal.interrupt(),
                Err(error) => tracing::warn!(id = %claim.id, %error, "progress could not be noted"),
            }
            tokio::time::sleep(NOTE_INTERVAL).await;
        }
    }

    /// What becomes of an orientation after an attempt without a result.
    fn ending(&self, orientation: &Orientation, error: &AttemptError, signal: &Signal) -> Ending {
        let interrupted = matches!(error, AttemptError::Interrupted);
        if interrupted && signal.is_late() {
            let seconds = self.settings.timeout.as_secs();
            let detail = format!("the attempt has taken longer than {seconds} s (set by `job_timeout_s`)");
            return Ending::GivenUp(Failure { code: "timeout".to_owned(), detail });
        }
        if interrupted && signal.is_interrupted() {
            return if self.stopping.is_cancelled() { Ending::Again { counted: false } } else { Ending::Cancelled };
        }
        if let Some(failure) = error.failure() {
            return Ending::GivenUp(failure);
        }
        tracing::error!(id = %orientation.id, attempt = orientation.attempts, %error, "an attempt has failed");
        if orientation.attempts >= self.settings.max_attempts {
            let detail = "the service has made a mistake; its log says more under this id".to_owned();
            return Ending::GivenUp(Failure { code: "internal".to_owned(), detail });
        }
        Ending::Again { counted: true }
    }

    fn too_often(&self, fate: Option<&str>) -> Ending {
        let (attempts, fate) = (self.settings.max_attempts, fate.unwrap_or("perhaps together with the service"));
        let detail = format!("given up: {attempts} attempts have ended without a result: {fate}");
        Ending::GivenUp(Failure { code: "given_up".to_owned(), detail })
    }

    async fn write(&self, claim: Claim, orientation: &Orientation, ending: &Ending) -> Result<(), StoreError> {
        let id = claim.id;
        match ending {
            Ending::Finished(finished) => {
                if self.store.finish(claim, finished).await? {
                    tracing::info!(%id, verdict = finished.verdict, "oriented");
                    self.ended(id, Status::Succeeded, Some(&finished.verdict)).await;
                }
            }
            Ending::GivenUp(failure) => {
                if self.store.fail(claim, failure).await? {
                    tracing::warn!(%id, code = failure.code, detail = failure.detail, "failed");
                    self.ended(id, Status::Failed, None).await;
                }
            }
            Ending::Again { counted } => {
                let mut transaction = self.store.begin_write().await?;
                if orientations::release(&mut transaction, claim, *counted).await? {
                    self.queue.push(&mut transaction, id, orientation.turn).await?;
                    transaction.commit().await?;
                    if self.stopping.is_cancelled() {
                        // this process may take it out of the queue once more
                        self.let_be().push(id);
                    }
                    self.call_workers().await;
                }
            }
            Ending::Cancelled => {}
        }
        self.gauge_queue(self.store.queued().await? as usize);
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
