//! Images that somebody looks at and corrects: each lies on a desk, a thread that keeps its picture, its control and its
//! line segments, so that an adjustment with another correction takes no longer than a look. Desks that nobody uses are
//! cleared.

use std::path::PathBuf;
use std::sync::PoisonError;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use tokio::sync::{Mutex, OwnedSemaphorePermit, oneshot};
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use super::attempt::{AttemptError, Loaded, Oriented, check_size, told};
use super::request::CameraModel;
use super::{Inner, Jobs};
use crate::diagnosis::{Reason, Verdict};
use crate::features::Picture as _;
use crate::imagery::{self, ImageFile, Limits};
use crate::orientation::ControlPoint;
use crate::pipeline::desk::{Correction, Desk, Neighbourhood};
use crate::pipeline::{
    FilmOutcome, FilmTask, Observer, OrientFn, Outcome, Stage, Task, hold_at_yellow, orient, orient_film,
};
use crate::report::interior::InteriorResult;
use crate::store::images::INCOMING;
use crate::store::orientations::Orientation;

/// Desks at a time: each holds a picture, decoded if it has no tiles.
const MOST_DESKS: usize = 4;
/// After so long without a call a desk is cleared.
const IDLE: Duration = Duration::from_secs(600);

/// A desk is made for a call that follows at once.
const FIRST_CALL: Duration = Duration::from_secs(5);

/// Why an image cannot be corrected.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DeskError {
    /// It cannot be oriented at all.
    #[error(transparent)]
    Attempt(#[from] AttemptError),
    /// The correction speaks of a control point that the orientation does not know.
    #[error("{name:?} is not among the control points that may be in view of this image")]
    UnknownControlPoint {
        /// Its name.
        name: String,
    },
    /// A scan without an interior orientation.
    #[error("the interior orientation of this scan has failed: there is no camera that could be oriented")]
    NoCamera,
    /// The desk was cleared in between, or its thread has ended by a fault.
    #[error("the image could not be kept at hand")]
    Cleared,
}

/// An adjustment by hand.
#[derive(Debug)]
pub struct Tried {
    /// All that would be kept of it.
    pub oriented: Oriented,
    /// How long the adjustment took.
    pub seconds: f64,
}

type Answer<T> = oneshot::Sender<Result<T, DeskError>>;

enum Call {
    Correct(Correction, Answer<Tried>),
    LookAround(String, Answer<Option<Neighbourhood>>),
}

/// The desks of a process.
#[derive(Default)]
pub(super) struct Desks(Mutex<Vec<Open>>);

struct Open {
    orientation: Uuid,
    calls: Sender<Call>,
}

impl Jobs {
    /// Adjusts an orientation again, with a correction. The first time takes as long as orienting the image; then it is at
    /// hand.
    ///
    /// # Errors
    /// [`DeskError`].
    pub async fn corrected(&self, orientation: &Orientation, correction: Correction) -> Result<Tried, DeskError> {
        let (answer, answered) = oneshot::channel();
        self.0.call(orientation, Call::Correct(correction, answer)).await?;
        answered.await.unwrap_or(Err(DeskError::Cleared))
    }

    /// The neighbourhood of a control point in the image of an orientation; `None` if it cannot be seen there.
    ///
    /// # Errors
    /// [`DeskError`].
    pub async fn neighbourhood(
        &self,
        orientation: &Orientation,
        name: String,
    ) -> Result<Option<Neighbourhood>, DeskError> {
        let (answer, answered) = oneshot::channel();
        self.0.call(orientation, Call::LookAround(name, answer)).await?;
        answered.await.unwrap_or(Err(DeskError::Cleared))
    }
}

impl Inner {
    async fn call(&self, orientation: &Orientation, call: Call) -> Result<(), DeskError> {
        let mut desks = self.desks.0.lock().await;
        let place = desks.iter().position(|open| open.orientation == orientation.id);
        let call = match place.map(|place| desks.remove(place)) {
            None => call,
            Some(open) => match open.calls.send(call) {
                Ok(()) => {
                    desks.push(open);
                    return Ok(());
                }
                // it was cleared in the meantime
                Err(error) => error.0,
            },
        };
        let calls = self.laid(orientation).await?;
        let sent = calls.send(call);
        // those that were not used for the longest time stand first
        let surplus = (desks.len() + 1).saturating_sub(MOST_DESKS);
        desks.drain(..surplus);
        desks.push(Open { orientation: orientation.id, calls });
        sent.map_err(|_| DeskError::Cleared)
    }

    /// Begins a desk.
    async fn laid(&self, orientation: &Orientation) -> Result<Sender<Call>, DeskError> {
        let loaded = self.load(orientation).await?;
        let permit = self.drawing.clone().acquire_owned().await.map_err(|_| DeskError::Cleared)?;
        let (calls, called) = channel();
        let sheet = Sheet {
            loaded,
            incoming: self.store.folder().join(INCOMING),
            limits: self.settings.limits.clone(),
            stopping: self.stopping.clone(),
        };
        let thread = std::thread::Builder::new().name("desk".to_owned());
        let spawned = thread.spawn(move || sheet.work(&called, permit));
        spawned.map_err(|error| {
            tracing::error!(%error, "a desk has no thread");
            DeskError::Cleared
        })?;
        Ok(calls)
    }
}

/// What a desk begins with.
struct Sheet {
    loaded: Loaded,
    incoming: PathBuf,
    limits: Limits,
    stopping: CancellationToken,
}

/// Gives up when the service ends.
struct Quiet(CancellationToken);

impl Observer for Quiet {
    fn progress(&self, _: Stage, _: f64) {}

    fn cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// The image with its camera.
struct Laid {
    task: Task,
    interior: Option<InteriorResult>,
    /// Why the interior orientation allows no green verdict.
    doubts: Option<Vec<Reason>>,
}

impl Sheet {
    /// Works on what is called, until nobody calls any more.
    fn work(self, called: &Receiver<Call>, permit: OwnedSemaphorePermit) {
        let Self { loaded: Loaded { path, prepared, work, control }, incoming, limits, stopping } = self;
        let observer = Quiet(stopping);
        let control = control.read(&work.frame, &incoming, &limits);
        let opened = || -> Result<(ImageFile, Laid), DeskError> {
            let picture = ImageFile::open(&path, &limits).map_err(AttemptError::from)?;
            let laid = match &work.camera {
                CameraModel::Digital(camera) => {
                    check_size(&picture, camera).map_err(AttemptError::from)?;
                    Laid { task: work.task(*camera), interior: None, doubts: None }
                }
                CameraModel::Film(camera) => {
                    let probe = imagery::probe(&path, &limits).map_err(AttemptError::from)?;
                    let wanted = prepared.scan.wanted(probe.pixel_size_um);
                    let task = work.film_task(camera.clone(), wanted);
                    let (task, film) = laid_film(&picture, &control, &task, &observer)?;
                    let interior = InteriorResult::of(&film.interior, &camera.plate, picture.size_px());
                    let doubtful = film.interior.verdict != Verdict::Green;
                    Laid { task, interior: Some(interior), doubts: doubtful.then_some(film.interior.reasons) }
                }
            };
            Ok((picture, laid))
        };
        let (picture, image) = match opened() {
            Ok(opened) => opened,
            Err(error) => return refuse(called, error),
        };
        let mut desk = match Desk::lay(&picture, &control, &image.task, &observer) {
            Ok(desk) => desk,
            Err(fault) => return refuse(called, AttemptError::from(fault).into()),
        };
        drop(permit);
        while let Ok(call) = called.recv_timeout(IDLE) {
            match call {
                Call::Correct(correction, answer) => {
                    let tried = corrected(&mut desk, &correction, &image).and_then(|(outcome, seconds)| {
                        let oriented = told(&outcome, image.interior.clone(), &control, (&prepared, &work))?;
                        Ok(Tried { oriented, seconds })
                    });
                    // who has called may have gone
                    let _ = answer.send(tried);
                }
                Call::LookAround(name, answer) => {
                    let seen = desk.neighbourhood(&name).map_err(|fault| AttemptError::from(fault).into());
                    let _ = answer.send(seen);
                }
            }
        }
    }
}

fn corrected(desk: &mut Desk, correction: &Correction, image: &Laid) -> Result<(Outcome, f64), DeskError> {
    let names = correction.off.iter().chain(correction.moved.iter().map(|(name, _)| name));
    for name in names {
        if !desk.control().iter().any(|point| point.name == *name) {
            return Err(DeskError::UnknownControlPoint { name: name.clone() });
        }
    }
    let began = Instant::now();
    let nothing = correction.off.is_empty() && correction.moved.is_empty();
    let corrected = if nothing { Ok(desk.outcome().clone()) } else { desk.corrected(correction) };
    let mut outcome = corrected.map_err(AttemptError::from)?;
    if let Some(doubts) = &image.doubts {
        hold_at_yellow(&mut outcome, doubts);
    }
    Ok((outcome, began.elapsed().as_secs_f64()))
}

/// The interior orientation of a scan, and the task with the camera that comes out of it.
fn laid_film(
    picture: &ImageFile,
    control: &[ControlPoint],
    task: &FilmTask,
    observer: &dyn Observer,
) -> Result<(Task, FilmOutcome), DeskError> {
    let tried = std::sync::Mutex::new(Vec::<(Task, Outcome)>::new());
    let remembering: OrientFn = &|picture, control, task, observer| {
        let outcome = orient(picture, control, task, observer)?;
        tried.lock().unwrap_or_else(PoisonError::into_inner).push((task.clone(), outcome.clone()));
        Ok(outcome)
    };
    let film = orient_film(remembering, picture, control, task, observer).map_err(AttemptError::from)?;
    // of several layings the one that was decided for
    let mut tried = tried.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter();
    let chosen = tried.find(|(_, outcome)| outcome.estimate == film.outcome.estimate);
    let (task, _) = chosen.ok_or(DeskError::NoCamera)?;
    Ok((task, film))
}

/// Tells all that have called, and will call, why there is no desk.
fn refuse(called: &Receiver<Call>, error: DeskError) {
    let mut error = Some(error);
    // the first call comes when the thread has begun
    let first = called.recv_timeout(FIRST_CALL).into_iter();
    for call in first.chain(std::iter::from_fn(|| called.try_recv().ok())) {
        let error = error.take().unwrap_or(DeskError::Cleared);
        match call {
            Call::Correct(_, answer) => drop(answer.send(Err(error))),
            Call::LookAround(_, answer) => drop(answer.send(Err(error))),
        }
    }
}
