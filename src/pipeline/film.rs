//! A scan of film: its interior orientation first, then the exterior one with the camera that comes out of it.

use std::sync::Arc;

use super::{Fault, Judge, Observer, Outcome, Stage, Task, Tolerance};
use crate::diagnosis::{Reason, Verdict, not_oriented};
use crate::features::Picture;
use crate::geometry::{Camera, PixelFromPlate};
use crate::interior::{FilmCamera, InteriorOrientation, Laying, Wanted, interior_orientation};
use crate::orientation::ControlPoint;
use crate::orientation::predict::Approximation;

/// A scan to orient.
#[derive(Debug, Clone)]
pub struct FilmTask {
    /// The camera.
    pub camera: Arc<FilmCamera>,
    /// What is known of the scan.
    pub wanted: Wanted,
    /// The approximate orientation, of the plate's axes.
    pub approximation: Approximation,
    /// Buildings that the orientation is checked with, and never found by.
    pub check: Arc<[ControlPoint]>,
    /// What the verdict is about.
    pub tolerance: Tolerance,
    /// Who decides about it.
    pub judge: Judge,
}

/// What became of a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmOutcome {
    /// The interior orientation that the other rests on.
    pub interior: InteriorOrientation,
    /// The exterior orientation.
    pub outcome: Outcome,
}

/// What orients an image with a known camera: [`super::orient`], or what stands for it.
pub type OrientFn<'a> = &'a dyn Fn(&dyn Picture, &[ControlPoint], &Task, &dyn Observer) -> Result<Outcome, Fault>;

/// The content of the image must speak so much more for one laying than for the next, as log odds, that it decides.
const AHEAD: f64 = 10.0;

/// Orients a scan. A red interior orientation ends it, with its reasons; a yellow one leaves a yellow result at best.
/// Where the marks leave several layings open, all are tried, and what the image shows decides.
///
/// # Errors
/// [`Fault`] if the picture cannot be read or the observer cancels.
pub fn orient_film(
    orient: OrientFn,
    picture: &dyn Picture,
    control: &[ControlPoint],
    task: &FilmTask,
    observer: &dyn Observer,
) -> Result<FilmOutcome, Fault> {
    observer.progress(Stage::Interior, 0.0);
    let interior = interior_orientation(picture, &task.camera.plate, &task.wanted)?;
    if observer.cancelled() {
        return Err(Fault::Cancelled);
    }
    if interior.verdict == Verdict::Red {
        return Ok(stopped(interior));
    }
    let one = |interior: InteriorOrientation| one_laying(orient, picture, control, task, observer, interior);
    let open = open_layings(&interior);
    if open.len() < 2 {
        return one(interior);
    }
    let under = |laying| interior.under(&task.camera.plate, laying, task.wanted.kind);
    let tried: Vec<FilmOutcome> = open.into_iter().filter_map(under).map(one).collect::<Result<_, _>>()?;
    Ok(by_content(&interior, tried))
}

/// The layings that the interior orientation has left open.
fn open_layings(interior: &InteriorOrientation) -> Vec<Laying> {
    let candidates = interior.decision.iter().flat_map(|d| &d.candidates[..d.open]);
    candidates.map(|candidate| candidate.laying).collect()
}

/// With one laying, whatever the others are.
fn one_laying(
    orient: OrientFn,
    picture: &dyn Picture,
    control: &[ControlPoint],
    task: &FilmTask,
    observer: &dyn Observer,
    interior: InteriorOrientation,
) -> Result<FilmOutcome, Fault> {
    let Some(camera) = scan_camera(picture.size_px(), task, &interior) else { return Ok(stopped(interior)) };
    let FilmTask { approximation, check, tolerance, judge, .. } = task.clone();
    let exterior = Task { camera, approximation, check, tolerance, judge };
    let mut outcome = orient(picture, control, &exterior, observer)?;
    if interior.verdict != Verdict::Green {
        hold_at_yellow(&mut outcome, &interior.reasons);
    }
    Ok(FilmOutcome { interior, outcome })
}

/// The camera of one scan, with what is not known of it.
fn scan_camera(size_px: [u32; 2], task: &FilmTask, interior: &InteriorOrientation) -> Option<Camera> {
    let transformation = interior.transformation.as_ref()?;
    let pixel_from_plate = PixelFromPlate::new(&transformation.matrix())?;
    let camera = Camera::of_scan(size_px, &task.camera.film, &pixel_from_plate).ok()?;
    let scale = transformation.sigma0().max(1.0).powi(2);
    Some(camera.with_interior_covariance(&(transformation.covariance_of_affine() * scale)))
}

/// No exterior orientation, for the reasons of the interior one.
fn stopped(interior: InteriorOrientation) -> FilmOutcome {
    let detail = match interior.reasons.first() {
        Some(reason) if interior.verdict == Verdict::Red => reason.detail.clone(),
        _ => "the marks give no camera with which an image can be oriented".to_owned(),
    };
    let diagnosis = not_oriented("interior_orientation_red", format!("interior orientation: {detail}"));
    FilmOutcome { interior, outcome: Outcome::without_orientation(diagnosis) }
}

/// A yellow interior orientation allows no green exterior one.
pub fn hold_at_yellow(outcome: &mut Outcome, reasons: &[Reason]) {
    let detail = reasons.first().map_or("", |reason| reason.detail.as_str());
    let reason = Reason { code: "interior_orientation_doubtful", detail: format!("interior orientation: {detail}") };
    let diagnosis = &mut outcome.diagnosis;
    if diagnosis.verdict == Verdict::Green {
        diagnosis.verdict = Verdict::Yellow;
        diagnosis.reasons.insert(0, reason);
    } else {
        diagnosis.reasons.push(reason);
    }
}

/// The laying under which the image shows the control; where another one does nearly as well, the doubt stays. At least
/// one was tried: that which the interior orientation itself is given for.
fn by_content(open: &InteriorOrientation, mut tried: Vec<FilmOutcome>) -> FilmOutcome {
    let weight = |tried: &FilmOutcome| tried.outcome.evidence.as_ref().map_or(0.0, |evidence| evidence.log_odds);
    tried.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
    let ahead = weight(&tried[0]) - tried.get(1).map_or(0.0, weight);
    let mut best = tried.swap_remove(0);
    if ahead > AHEAD {
        best.interior.decided_by_content(open);
    } else {
        best.interior.left_open(open);
        hold_at_yellow(&mut best.outcome, &best.interior.reasons);
    }
    best
}
