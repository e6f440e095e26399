//! Which of the candidates belong together? The errors of prediction are common to all control points of an image,
//! so two of them, rightly located, predict all others.
//!
//! The search narrows. The most distinctive control points are located first, in wide *windows* that cover all that the
//! approximation allows (`views`). *Pairs* of candidates with the approximation as an observation give orientations, to
//! which further control points are joined one by one. The best are *refined*: all control points are predicted anew,
//! located in narrow windows, oriented (`hypotheses`). If none of these is beyond doubt, the next control points are
//! located in wide windows too, until there are no more.

use nalgebra::Vector2;
use rayon::prelude::*;

use super::ControlPoint;
use super::by_hand::ByHand;
use super::extract::Extraction;
use super::gate::{Located, Scale};
use super::locate::{Clustering, Peak, shift_map};
use super::predict::{Approximation, Prediction, edges_px, on_frame};
use super::select::distinctiveness;
use super::sight::SceneLooks;
use super::views::{Assumed, Frame, View, Window, views};
use crate::features::PictureError;
use crate::geometry::{Camera, ExteriorOrientation, Segment2};

/// What the search works with.
pub struct Search<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Control points that may be in view.
    pub control: &'a [ControlPoint],
    /// What is known beforehand.
    pub approximation: &'a Approximation,
    /// The scenes among them as the image may show them.
    pub(super) looks: SceneLooks,
    /// What staff say of the control points.
    pub by_hand: ByHand,
}

/// An orientation with the control points that speak for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Hypothesis {
    /// The orientation and its covariance.
    pub prediction: Prediction,
    /// Control points found where it predicts them.
    pub located: Vec<Located>,
    /// Logarithm of the odds of all of them together.
    pub score: f64,
}

/// What a search found, and what it cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The best hypotheses that differ from one another, best first; empty if nothing speaks for any.
    pub hypotheses: Vec<Hypothesis>,
    /// How it was searched.
    pub report: SearchReport,
}

/// What was taken for possible, and how much was looked at. Counts, the same on every machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchReport {
    /// What was taken for possible.
    pub assumed: Assumed,
    /// Steps of heading and height.
    pub views: usize,
    /// Control points that were located in wide windows.
    pub control_points: usize,
    /// Wide windows.
    pub windows: usize,
    /// Pairs of candidates that agree with the approximation, in the end.
    pub pairs: usize,
    /// Hypotheses that were refined.
    pub refined: usize,
}

/// The wide search: cells as large as a view may be wrong, a location good to little more.
pub(super) const WIDE: Scale = Scale { cell_px: 6.0, sigma_px: 8.0 };
const WIDE_DIRECTION_RAD: f64 = 7.0 * std::f64::consts::PI / 180.0;
const PEAKS_OF_A_WINDOW: usize = 10;
const PEAKS_OF_A_CONTROL_POINT: usize = 40;
/// So many control points are located in wide windows before their candidates are paired: where half of them are in
/// view and half of these are among the candidates, there are still three, and three pairs.
const LOCATED_AT_ONCE: usize = 12;
const REFINED: usize = 14;
/// A hypothesis with such a score needs no more control points to be believed: wrong ones reach half of it.
pub const BEYOND_DOUBT: f64 = 40.0;
/// Hypotheses so far behind the best are not looked at any further.
pub const HOPELESSLY_BEHIND: f64 = 40.0;
/// How much of the work is done after the windows, and after the pairs.
const SHARE_OF_WINDOWS: f64 = 0.7;
const SHARE_BEFORE_REFINING: f64 = 0.85;
/// Views between two looks at whether to go on: their windows are in memory together.
const VIEWS_AT_ONCE: usize = 4;
/// Hypotheses that predict the same to so many pixels are the same.
const DIFFERENT_PX: f64 = 25.0;

/// A candidate with the view under which it was found.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) peak: Peak,
    pub(super) view: ExteriorOrientation,
}

impl<'a> Search<'a> {
    /// A search for control points under an approximation.
    #[must_use]
    pub fn new(camera: &'a Camera, control: &'a [ControlPoint], approximation: &'a Approximation) -> Self {
        let looks = SceneLooks::of(camera, control, &approximation.orientation);
        Self { camera, control, approximation, looks, by_hand: ByHand::default() }
    }
}

impl Search<'_> {
    /// Searches all that the approximation allows. `go_on` hears how much is done (0 to 1), and ends the search, with
    /// nothing, by answering no.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read where control points are expected.
    pub fn run(&self, extraction: &mut Extraction, go_on: &dyn Fn(f64) -> bool) -> Result<Found, PictureError> {
        let (views, assumed) = views(self.approximation, self.typical_height_m());
        let mut report =
            SearchReport { assumed, views: views.len(), control_points: 0, windows: 0, pairs: 0, refined: 0 };
        let mut candidates: Vec<Vec<Candidate>> = vec![Vec::new(); self.control.len()];
        let frame = Frame::of(self.camera);
        let order = self.most_telling_first(&views, &frame);
        // where there are scenes, they alone may do: SIFT needs no views
        let scenes_alone = if self.has_scenes() { Some(&[] as &[usize]) } else { None };
        self.sight_all(extraction, &mut candidates)?;
        let batches: Vec<&[usize]> = scenes_alone.into_iter().chain(order.chunks(LOCATED_AT_ONCE)).collect();
        let count = batches.len() as f64;
        let mut hypotheses = Vec::new();
        for (k, batch) in batches.into_iter().enumerate() {
            let go_on = |done: f64| go_on((k as f64 + done) / count);
            report.control_points += batch.len();
            for (seen, some) in views.chunks(VIEWS_AT_ONCE).enumerate().filter(|_| !batch.is_empty()) {
                if !go_on(SHARE_OF_WINDOWS * (seen * VIEWS_AT_ONCE) as f64 / views.len() as f64) {
                    return Ok(Found { hypotheses: Vec::new(), report });
                }
                let windows = self.windows(some, &frame, batch);
                report.windows += windows.len();
                self.locate_wide(&windows, extraction, &mut candidates)?;
            }
            if !go_on(SHARE_OF_WINDOWS) {
                return Ok(Found { hypotheses: Vec::new(), report });
            }
            let (paired, pairs) = self.paired(&candidates);
            report.pairs = pairs;
            let mut starts = self.distinct(paired, DIFFERENT_PX);
            starts.truncate(REFINED);
            report.refined += starts.len();
            let Some(refined) = self.refined(starts, extraction, &|| go_on(SHARE_BEFORE_REFINING))? else {
                return Ok(Found { hypotheses: Vec::new(), report });
            };
            hypotheses.extend(refined);
            hypotheses.sort_by(|a: &Hypothesis, b| b.score.total_cmp(&a.score));
            if hypotheses.first().is_some_and(|best| best.score > BEYOND_DOUBT) {
                break;
            }
        }
        Ok(Found { hypotheses: self.distinct(hypotheses, DIFFERENT_PX), report })
    }

    /// The median height of the control.
    pub(super) fn typical_height_m(&self) -> f64 {
        let mut heights: Vec<f64> = self.control.iter().map(|point| point.reference_m.z).collect();
        heights.sort_by(f64::total_cmp);
        heights.get(heights.len() / 2).copied().unwrap_or(0.0)
    }

    /// The control points, first those that are the most distinctive and the likeliest to be in view.
    fn most_telling_first(&self, views: &[View], frame: &Frame) -> Vec<usize> {
        let Some(view) = views.get(views.len() / 2) else { return Vec::new() };
        let buildings = self.control.iter().enumerate().filter(|(_, point)| point.scene.is_none());
        let telling = buildings.map(|(index, control_point)| {
            let share = view.share_on_frame(self.camera, frame, control_point);
            (index, share * distinctiveness(control_point) as f64)
        });
        let mut telling: Vec<(usize, f64)> = telling.collect();
        telling.sort_by(|a, b| b.1.total_cmp(&a.1));
        telling.into_iter().map(|(index, _)| index).collect()
    }

    /// Where the control points may be, and how far their edges reach from their reference points there.
    fn windows(&self, views: &[View], frame: &Frame, control_points: &[usize]) -> Vec<(Window, f64)> {
        let of_view = |view: &View| {
            let windows = control_points.iter().flat_map(|k| view.windows(self.camera, frame, (*k, &self.control[*k])));
            let with_reach = windows.map(|window| {
                let reach_px = window.half_width_px + reach(&self.drawn(&window), window.centre_px);
                (window, reach_px)
            });
            with_reach.collect::<Vec<_>>()
        };
        views.par_iter().flat_map_iter(of_view).collect()
    }

    /// The edges as a window shows them.
    fn drawn(&self, window: &Window) -> Vec<Segment2> {
        edges_px(self.camera, &window.view, &self.control[window.control_point]).into_iter().flatten().collect()
    }

    /// Adds the candidates in all windows.
    fn locate_wide(
        &self,
        windows: &[(Window, f64)],
        extraction: &mut Extraction,
        candidates: &mut [Vec<Candidate>],
    ) -> Result<(), PictureError> {
        let squares = windows.iter().map(|(window, reach_px)| square(self.camera, window.centre_px, *reach_px));
        extraction.cover_all(&squares.collect::<Vec<_>>())?;
        let extraction = &*extraction;
        let peaks = |(window, reach_px): &(Window, f64)| {
            let clustering = Clustering {
                half_width_px: window.half_width_px,
                cell_px: WIDE.cell_px,
                direction_tolerance_rad: WIDE_DIRECTION_RAD,
                fine: false,
            };
            let coarse = extraction.coarse_near(window.centre_px, *reach_px);
            shift_map(&self.drawn(window), window.centre_px, coarse, &clustering).peaks(PEAKS_OF_A_WINDOW)
        };
        let found: Vec<Vec<Peak>> = windows.par_iter().map(peaks).collect();
        for ((window, _), peaks) in windows.iter().zip(found) {
            let peaks = peaks.into_iter().filter(|peak| on_frame(self.camera, peak.at_px, 0.0));
            candidates[window.control_point].extend(peaks.map(|peak| Candidate { peak, view: window.view }));
        }
        candidates.iter_mut().for_each(keep_best);
        Ok(())
    }

    /// Of hypotheses in order of their score, those that predict differently from all better ones, by `least_px`.
    pub(super) fn distinct(&self, hypotheses: Vec<Hypothesis>, least_px: f64) -> Vec<Hypothesis> {
        let mut kept: Vec<Hypothesis> = Vec::new();
        for hypothesis in hypotheses {
            let same = |other: &Hypothesis| self.difference_px(&hypothesis, other) < least_px;
            if kept.len() < 3 * REFINED && !kept.iter().any(same) {
                kept.push(hypothesis);
            }
        }
        kept
    }

    /// Largest distance between the images of the control points that speak for the first hypothesis.
    fn difference_px(&self, a: &Hypothesis, b: &Hypothesis) -> f64 {
        let c = self.camera.principal_distance_px;
        let image = |h: &Hypothesis, k: usize| h.prediction.orientation.reduced_px(c, self.control[k].reference_m);
        let distances = a.located.iter().map(|l| {
            let both = image(a, l.control_point).zip(image(b, l.control_point));
            both.map_or(f64::INFINITY, |(p, q)| (p - q).norm())
        });
        distances.fold(0.0, f64::max)
    }
}

/// Keeps the best candidates of a control point, and of those that neighbouring views found twice the better.
fn keep_best(candidates: &mut Vec<Candidate>) {
    candidates.sort_by(|a, b| b.peak.log_likelihood.total_cmp(&a.peak.log_likelihood));
    let mut kept: Vec<Candidate> = Vec::with_capacity(PEAKS_OF_A_CONTROL_POINT);
    for candidate in candidates.iter() {
        let twice = |k: &Candidate| (k.peak.at_px - candidate.peak.at_px).norm() < 2.0 * WIDE.cell_px;
        if kept.len() < PEAKS_OF_A_CONTROL_POINT && !kept.iter().any(twice) {
            kept.push(*candidate);
        }
    }
    *candidates = kept;
}

/// How far the edges reach from the reference point, in x or y.
pub(crate) fn reach<'e>(edges: impl IntoIterator<Item = &'e Segment2>, predicted: Vector2<f64>) -> f64 {
    edges.into_iter().flat_map(|e| [e.start, e.end]).map(|end| (end - predicted).amax()).fold(0.0, f64::max)
}

/// The rectangle of the file that holds a square about a reduced point.
pub(super) fn square(camera: &Camera, centre: Vector2<f64>, half_width_px: f64) -> [Vector2<f64>; 2] {
    // the distortion stretches it a little
    camera.pixels_around(centre, 1.05 * half_width_px)
}
