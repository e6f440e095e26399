//! Correcting by hand: an image that was oriented stays on the desk, with its line segments, and is adjusted again and
//! again with what staff say of its control points.

use nalgebra::{Rotation3, Vector2, Vector3};

use super::outcome::{control_point_result, edges_of};
use super::run::{Attempt, Run, Searched, Solution, attempt};
use super::{Fault, Observer, Outcome, Task};
use crate::estimation::{PointObservation, resect};
use crate::features::{Picture, PixelRect};
use crate::geometry::{Camera, ExteriorOrientation, Segment2};
use crate::orientation::ControlPoint;
use crate::orientation::adjust::Adjustment;
use crate::orientation::by_hand::{ByHand, SIGMA_BY_HAND_PX, SeenScene};
use crate::orientation::collect::seen_scenes;
use crate::orientation::gate::Located;
use crate::orientation::locate::{Peak, ShiftMap};
use crate::orientation::predict::{Approximation, Prediction};
use crate::orientation::search::{Hypothesis, Search};

/// What staff say of the control points of an image.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Correction {
    /// Those that are not to be used.
    pub off: Vec<String>,
    /// Where the reference points of others are, in pixels of the file.
    pub moved: Vec<(String, Vector2<f64>)>,
}

/// If an orientation has all places that were pointed at within this, it is corrected; else it is wrong, and all begins
/// anew from those places.
const CORRECTED_WITHIN_PX: f64 = 60.0;
/// How well the control points of an adjustment are located for the orientation with points.
const SIGMA_LOCATED_PX: f64 = 3.0;
/// Candidates that are shown of a window.
const PEAKS_SHOWN: usize = 5;

/// An image on the desk.
pub struct Desk<'a> {
    run: Run<'a>,
    attempt: Attempt<'a>,
    /// The scenes that were found.
    scenes: Vec<SeenScene>,
}

/// The neighbourhood of a control point. Pixels of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Neighbourhood {
    /// The part of the picture that holds it all.
    pub rect: PixelRect,
    /// Where its reference point is expected.
    pub predicted_px: Vector2<f64>,
    /// Where the orientation has found it.
    pub located_px: Option<Vector2<f64>>,
    /// Its edges there.
    pub edges_px: Vec<Segment2>,
    /// The line segments of the image.
    pub segments_px: Vec<Segment2>,
    /// How much the segments speak for each shift of the edges; none for a scene.
    pub accumulator: Option<Accumulator>,
}

/// A map of shifts with its best places. Pixels of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Accumulator {
    /// The map, in reduced pixels.
    pub map: ShiftMap,
    /// The best places first.
    pub peaks: Vec<(Vector2<f64>, f64)>,
}

impl<'a> Desk<'a> {
    /// Orients an image, as [`super::orient`] does, and keeps it.
    ///
    /// # Errors
    /// [`Fault`] if the picture cannot be read or the observer cancels.
    pub fn lay(
        picture: &'a dyn Picture,
        control: &[ControlPoint],
        task: &'a Task,
        observer: &'a dyn Observer,
    ) -> Result<Self, Fault> {
        let run = Run { picture, task, observer, done: 0.0 };
        let mut attempt = attempt(run, control)?;
        let mut scenes = Vec::new();
        if let Some(Searched { control, approximation, extraction, best: Some(best), .. }) = &mut attempt.searched {
            let search = Search::new(&task.camera, control, approximation);
            scenes = seen_scenes(&search, &best.adjustment, extraction)?;
        }
        Ok(Self { run, attempt, scenes })
    }

    /// As it was oriented.
    #[must_use]
    pub fn outcome(&self) -> &Outcome {
        &self.attempt.outcome
    }

    /// The control points that the orientation could use.
    #[must_use]
    pub fn control(&self) -> &[ControlPoint] {
        self.attempt.searched.as_ref().map_or(&[], |searched| &searched.control)
    }

    /// The outcome with a correction. Names that are not among [`Self::control`] change nothing.
    ///
    /// # Errors
    /// [`Fault`] if the picture cannot be read where it was not read yet.
    pub fn corrected(&mut self, correction: &Correction) -> Result<Outcome, Fault> {
        let Some(searched) = &mut self.attempt.searched else { return Ok(self.attempt.outcome.clone()) };
        let Searched { control, approximation, extraction, best, seen } = searched;
        let camera = &self.run.task.camera;
        let mut by_hand = by_hand(control, camera, correction);
        let agreeing = best.as_ref().filter(|best| agrees(camera, control, best, &by_hand));
        by_hand.scenes = agreeing.map(|_| self.scenes.clone());
        let believed = believed(camera, control, approximation, &by_hand);
        let search = Search::with(camera, control, &believed, by_hand);
        let mut trials = Vec::new();
        let found = best.as_ref().map(|best| best.adjustment.orientation);
        let solution = match agreeing.map_or_else(|| anew(&search, found), |best| going_on(&search, best)) {
            Some(start) => self.run.solve(&search, &start, extraction, &mut trials)?,
            None => None,
        };
        let Some(solution) = solution else { return Ok(self.run.not_found(&search, &[])) };
        let rivals = self.run.rivals(&search, &solution, seen, trials);
        let mut outcome = self.run.outcome(&search, extraction, &solution, rivals);
        outcome.cost = self.attempt.outcome.cost;
        outcome.check_points = self.run.check_points(&solution.adjustment, extraction)?;
        show_unused(&mut outcome, &search, &solution.adjustment);
        Ok(outcome)
    }

    /// The neighbourhood of a control point under the orientation that was found or, without one, the approximate one;
    /// `None` if there is no such control point, or it cannot be seen.
    ///
    /// # Errors
    /// [`Fault`] if the picture cannot be read there.
    pub fn neighbourhood(&mut self, name: &str) -> Result<Option<Neighbourhood>, Fault> {
        let Some(searched) = &mut self.attempt.searched else { return Ok(None) };
        let camera = &self.run.task.camera;
        let Searched { control, approximation, extraction, best, .. } = searched;
        let Some(index) = control.iter().position(|point| point.name == name) else { return Ok(None) };
        // no scene need be looked for
        let by_hand = ByHand { scenes: Some(Vec::new()), ..ByHand::default() };
        let search = Search::with(camera, control, approximation, by_hand);
        let prior = approximation.prior(&approximation.orientation);
        let approximate = || {
            let prior = prior?;
            Some(Prediction { orientation: prior.orientation, covariance: prior.information.try_inverse()? })
        };
        let located = self.attempt.outcome.control_points.iter().find(|point| point.name == name);
        let found = best.as_ref().map(|best| best.adjustment.prediction());
        let Some(prediction) = found.or_else(approximate) else { return Ok(None) };
        let Some(around) = search.around(index, &prediction, extraction)? else { return Ok(None) };
        let in_file = |p: Vector2<f64>| camera.pixel_from_reduced(p);
        let rect = clipped(extraction.picture_px(), camera.pixels_around(around.predicted_px, around.reach_px));
        let Some(rect) = rect else { return Ok(None) };
        let near = extraction.near(around.predicted_px, around.reach_px).map(|(_, segment)| segment.file_px);
        let segments_px = near.filter(|segment| touches(&rect, segment)).collect();
        let accumulator = around.map.map(|map| Accumulator {
            peaks: map.peaks(PEAKS_SHOWN).iter().map(|p: &Peak| (in_file(p.at_px), p.log_likelihood)).collect(),
            map,
        });
        Ok(Some(Neighbourhood {
            rect,
            predicted_px: in_file(around.predicted_px),
            located_px: located.and_then(|point| point.located_px),
            edges_px: around
                .edges_px
                .iter()
                .map(|e| Segment2 { start: in_file(e.start), end: in_file(e.end) })
                .collect(),
            segments_px,
            accumulator,
        }))
    }
}

/// A correction by the indices of the control points, in reduced pixels.
fn by_hand(control: &[ControlPoint], camera: &Camera, correction: &Correction) -> ByHand {
    let index = |name: &String| control.iter().position(|point| point.name == *name);
    let off: Vec<usize> = correction.off.iter().filter_map(index).collect();
    let place = |(name, at_px): &(String, Vector2<f64>)| {
        index(name).filter(|index| !off.contains(index)).zip(camera.reduced_from_pixel(*at_px))
    };
    ByHand { places: correction.moved.iter().filter_map(place).collect(), off, scenes: None }
}

/// So much worse than it says an approximation may be for all that is known before places are compared with it.
const LOOSELY: f64 = 30.0;
/// Places that determine an orientation.
const DETERMINING: usize = 3;

/// The approximation as it must be believed where several places contradict it: else a position that is wrong by many of
/// its standard deviations would draw the corrected orientation to itself.
fn believed(camera: &Camera, control: &[ControlPoint], stated: &Approximation, by_hand: &ByHand) -> Approximation {
    if by_hand.places.len() < DETERMINING {
        return stated.clone();
    }
    let loose = stated.erring_by(LOOSELY);
    let places_alone = ByHand { scenes: Some(Vec::new()), ..by_hand.clone() };
    let search = Search::with(camera, control, &loose, places_alone);
    let contradiction = from_places(&search, None).and_then(|found| {
        let prior = stated.prior(&found.orientation)?;
        let step = prior.orientation.step_to(&found.orientation);
        Some((step.dot(&(prior.information * step)) / 6.0).sqrt())
    });
    stated.erring_by(contradiction.unwrap_or(1.0).max(1.0))
}

/// Whether an orientation has all places that were pointed at about where they are.
fn agrees(camera: &Camera, control: &[ControlPoint], best: &Solution, by_hand: &ByHand) -> bool {
    by_hand.places.iter().all(|(k, at_px)| {
        let projected = best.adjustment.orientation.reduced_px(camera.principal_distance_px, control[*k].reference_m);
        projected.is_some_and(|projected| (projected - at_px).norm() < CORRECTED_WITHIN_PX)
    })
}

fn pointed_at(search: &Search) -> impl Iterator<Item = Located> {
    search.by_hand.places.iter().map(|(control_point, at_px)| Located {
        control_point: *control_point,
        at_px: *at_px,
        sigma_px: SIGMA_BY_HAND_PX,
        log_odds: 0.0,
    })
}

/// From all that was located before, and what was pointed at.
fn going_on(search: &Search, best: &Solution) -> Option<Hypothesis> {
    let adjustment = &best.adjustment;
    let free = |k: usize| search.is_on(k) && search.placed(k).is_none();
    let kept = adjustment.buildings.iter().zip(&adjustment.kept).filter(|(b, _)| free(b.control_point));
    let kept = kept.filter(|(_, kept)| kept.contains(&true)).filter_map(|(building, _)| {
        let control_point = building.control_point;
        let reference_m = search.control[control_point].reference_m;
        let projected = adjustment.orientation.reduced_px(search.camera.principal_distance_px, reference_m)?;
        let at_px = projected + building.shift_px;
        Some(Located { control_point, at_px, sigma_px: SIGMA_LOCATED_PX, log_odds: 0.0 })
    });
    let located: Vec<Located> = pointed_at(search).chain(kept).collect();
    let prediction = adjustment.prediction();
    (!located.is_empty()).then_some(Hypothesis { prediction, located, score: best.log_odds })
}

/// From what was pointed at alone: what was found before is wrong, or there was nothing.
fn anew(search: &Search, found: Option<ExteriorOrientation>) -> Option<Hypothesis> {
    let located: Vec<Located> = pointed_at(search).collect();
    let prediction = from_places(search, found)?;
    Some(Hypothesis { prediction, located, score: 0.0 })
}

/// The orientation by what was pointed at and the approximation. The heading may be unknown, or have been found wrong: all
/// around is tried.
fn from_places(search: &Search, found: Option<ExteriorOrientation>) -> Option<Prediction> {
    const HEADINGS: usize = 12;
    let places = &search.by_hand.places;
    let approximate = search.approximation.orientation;
    let observations: Vec<PointObservation> =
        places.iter().map(|(k, at_px)| search.observation(*k, *at_px, SIGMA_BY_HAND_PX, &approximate)).collect();
    if observations.is_empty() {
        return None;
    }
    let turned = (0..HEADINGS).map(|step| {
        let turn =
            Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::TAU * step as f64 / HEADINGS as f64);
        ExteriorOrientation { camera_from_object: turn * approximate.camera_from_object, ..approximate }
    });
    let fits = turned.chain(found).filter_map(|start| {
        let prior = search.approximation.prior(&start)?;
        resect(&observations, Some(&prior), &start, search.camera.principal_distance_px)
    });
    let best = fits.min_by(|a, b| a.squares.total_cmp(&b.squares))?;
    Some(Prediction { orientation: best.orientation, covariance: best.covariance * best.sigma0().max(1.0).powi(2) })
}

/// What is not to be used is shown all the same, where it would be.
fn show_unused(outcome: &mut Outcome, search: &Search, adjustment: &Adjustment) {
    for index in &search.by_hand.off {
        let place = outcome.control_points.len();
        outcome.control_points.push(control_point_result(search, Some(adjustment), &[], *index));
        outcome.edges.extend(edges_of(search, adjustment, &[], (place, *index)));
    }
}

/// The pixels of a rectangle that are in the picture; `None` if there are none.
fn clipped([width, height]: [u32; 2], [least, largest]: [Vector2<f64>; 2]) -> Option<PixelRect> {
    let range = |from: f64, to: f64, size: u32| {
        let (from, to) = (from.floor().max(0.0), to.ceil().min(f64::from(size)));
        (to > from).then_some((from as u32, (to - from) as u32))
    };
    let (x, width) = range(least.x, largest.x, width)?;
    let (y, height) = range(least.y, largest.y, height)?;
    Some(PixelRect { x, y, width, height })
}

fn touches(rect: &PixelRect, segment: &Segment2) -> bool {
    let (least, largest) = (segment.start.inf(&segment.end), segment.start.sup(&segment.end));
    let [x, y] = [rect.x, rect.y].map(f64::from);
    largest.x >= x && largest.y >= y && least.x <= x + f64::from(rect.width) && least.y <= y + f64::from(rect.height)
}
