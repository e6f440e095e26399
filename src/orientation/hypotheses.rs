//! Orientations from candidates: out of pairs, grown control point by control point, refined round by round.

use nalgebra::{Matrix2, Matrix2x6, Vector2};
use rayon::prelude::*;

use super::ControlPoint;
use super::extract::Extraction;
use super::gate::{GATE, Gate, Located, Round, Scale, Seed};
use super::locate::{Clustering, Peak, SHORTEST_EDGE_PX, ShiftMap, shift_map};
use super::predict::{Prediction, edges_on_frame_px, on_frame};
use super::search::{Candidate, HOPELESSLY_BEHIND, Hypothesis, Search, WIDE, reach, square};
use super::views::{Narrowed, REACH_SIGMAS, narrowed};
use crate::estimation::{PointObservation, Prior, Resection, largest_sigma, resect};
use crate::features::PictureError;
use crate::geometry::{ExteriorOrientation, Segment2};

/// Candidates that are paired with one another.
const PAIRED: usize = 260;
/// Sum of squares of a pair with the prior beyond which they do not belong together: of the four redundant observations
/// two may show all of the tilt that is believed, the others are within 99.99 %.
const PAIR_GATE: f64 = 18.4 + REACH_SIGMAS * REACH_SIGMAS;
/// The gate of a pair is no wider than that of its anchor, but for a change of perspective.
const REACH_MARGIN: f64 = 1.2;
/// The best pairs, to which further control points are joined.
const GROWN: usize = 300;
const PEAKS_OF_A_WINDOW: usize = 10;
/// Half the width of a narrow window: at least so many cells, or chance would be read from the thing itself.
const LEAST_CELLS: f64 = 40.0;
const WIDEST_PX: f64 = 300.0;
/// The window in standard deviations of the prediction: the gate.
const WINDOW_SIGMAS: f64 = 3.4;

/// Hypotheses that predict the same to so many pixels come to the same end.
const SAME_PX: f64 = 1.0;

const ROUNDS: [Round; 3] = [
    Round { scale: Scale { cell_px: 4.0, sigma_px: 6.0 }, direction_tolerance_rad: 0.10 },
    Round { scale: Scale { cell_px: 3.0, sigma_px: 4.0 }, direction_tolerance_rad: 0.07 },
    Round { scale: Scale { cell_px: 2.0, sigma_px: 3.0 }, direction_tolerance_rad: 0.06 },
];

/// A pair that fits the prior, before others are joined.
struct Pair {
    rating: f64,
    seeds: [Seed; 2],
    start: ExteriorOrientation,
}

/// What is around a control point, in reduced pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct Around {
    /// Where its reference point is expected.
    pub predicted_px: Vector2<f64>,
    /// So far to each side something of it may be.
    pub reach_px: f64,
    /// Its edges where they are expected.
    pub edges_px: Vec<Segment2>,
    /// What the line segments say of its shift; none of a scene.
    pub map: Option<ShiftMap>,
}

/// The orientation with one candidate and the prior: where all other control points are, if this one is there.
struct Anchor {
    seed: Seed,
    prediction: Prediction,
    squares: f64,
}

/// A control point as an anchor predicts it.
struct Expected {
    image_px: Vector2<f64>,
    jacobian: Matrix2x6<f64>,
    weight: Matrix2<f64>,
    /// No candidate farther from where a pair predicts it can belong to that pair, which knows more than its anchor.
    reach_px: f64,
}

impl Search<'_> {
    /// Orientations from pairs of candidates, best first, and how many pairs agree with the approximation.
    pub(super) fn paired(&self, candidates: &[Vec<Candidate>]) -> (Vec<Hypothesis>, usize) {
        let mut strongest: Vec<(Seed, &ExteriorOrientation)> = Vec::new();
        for (control_point, of_one) in candidates.iter().enumerate() {
            strongest.extend(of_one.iter().map(|c| (Seed { control_point, peak: c.peak }, &c.view)));
        }
        strongest.sort_by(|a, b| b.0.peak.log_likelihood.total_cmp(&a.0.peak.log_likelihood));
        strongest.truncate(PAIRED);
        let peaks: Vec<Vec<Peak>> = candidates.iter().map(|c| c.iter().map(|c| c.peak).collect()).collect();
        // each with all that are weaker
        let anchored = strongest.par_iter().enumerate().flat_map_iter(|(k, (seed, view))| {
            let weaker = strongest[k + 1..].iter().map(|(weaker, _)| weaker);
            self.anchor(*seed, view).map_or(Vec::new(), |anchor| self.pairs(&anchor, weaker, &peaks))
        });
        let mut pairs: Vec<Pair> = anchored.collect();
        pairs.sort_by(|a: &Pair, b| b.rating.total_cmp(&a.rating));
        let count = pairs.len();
        pairs.truncate(GROWN);
        let grown = pairs.par_iter().map(|pair| self.grown(&pair.seeds, &pair.start, &peaks, WIDE));
        let mut hypotheses: Vec<Hypothesis> = grown.collect::<Vec<_>>().into_iter().flatten().collect();
        hypotheses.sort_by(|a, b| b.score.total_cmp(&a.score));
        (hypotheses, count)
    }

    fn anchor(&self, seed: Seed, view: &ExteriorOrientation) -> Option<Anchor> {
        let Narrowed { approximation, .. } = narrowed(self.approximation, view, self.typical_height_m());
        let fit = self.fit(&[seed], &approximation.prior(view)?, view, WIDE)?;
        let prediction = Prediction { orientation: fit.orientation, covariance: fit.covariance };
        Some(Anchor { seed, prediction, squares: fit.squares })
    }

    /// The pairs of a candidate with others that lie where it predicts them. The second one enters by one step of
    /// sequential adjustment: so near, predicting is linear.
    fn pairs<'s>(&self, anchor: &Anchor, others: impl Iterator<Item = &'s Seed>, peaks: &[Vec<Peak>]) -> Vec<Pair> {
        let located = |k: usize| !peaks[k].is_empty();
        let expected = |k: usize| if located(k) { self.expected(anchor, k) } else { None };
        let expected: Vec<Option<Expected>> = (0..peaks.len()).map(expected).collect();
        let others = others.filter(|other| other.control_point != anchor.seed.control_point);
        let pair = |other: &Seed| {
            let Expected { image_px, jacobian, weight, .. } = expected[other.control_point].as_ref()?;
            let away = other.peak.at_px - image_px;
            let squares = anchor.squares + away.dot(&(weight * away));
            if squares > PAIR_GATE {
                return None;
            }
            let covariance = &anchor.prediction.covariance;
            let gain = covariance * jacobian.transpose() * weight;
            let prediction = Prediction {
                orientation: anchor.prediction.orientation.moved(&(gain * away)),
                covariance: covariance - gain * jacobian * covariance,
            };
            let rating = self.rating(&prediction, &expected, peaks) - squares / 2.0;
            Some(Pair { rating, seeds: [anchor.seed, *other], start: prediction.orientation })
        };
        others.filter_map(pair).collect()
    }

    fn expected(&self, anchor: &Anchor, control_point: usize) -> Option<Expected> {
        let Prediction { orientation, covariance } = &anchor.prediction;
        let reference_m = self.control[control_point].reference_m;
        let (image_px, jacobian) =
            orientation.reduced_px_with_jacobian(self.camera.principal_distance_px, reference_m)?;
        let observed = self.observation(control_point, image_px, WIDE.sigma_px, orientation);
        let open = jacobian * covariance * jacobian.transpose() + Matrix2::identity() * observed.sigma_px.powi(2);
        let reach_px = REACH_MARGIN * largest_sigma(&open) * GATE.sqrt();
        Some(Expected { image_px, jacobian, weight: open.try_inverse()?, reach_px })
    }

    fn fit(&self, seeds: &[Seed], prior: &Prior, start: &ExteriorOrientation, scale: Scale) -> Option<Resection> {
        resect(&self.points(seeds, start, scale), Some(prior), start, self.camera.principal_distance_px)
    }

    fn points(&self, seeds: &[Seed], at: &ExteriorOrientation, scale: Scale) -> Vec<PointObservation> {
        let observation = |seed: &Seed| self.observation(seed.control_point, seed.peak.at_px, scale.sigma_px, at);
        seeds.iter().map(observation).collect()
    }

    /// A located reference point as an observation, the accuracy of the control point in it.
    #[must_use]
    pub fn observation(
        &self,
        control_point: usize,
        image_px: Vector2<f64>,
        sigma_located_px: f64,
        at: &ExteriorOrientation,
    ) -> PointObservation {
        let reference = &self.control[control_point];
        let depth_m = -at.camera_coordinates(reference.reference_m).z;
        let sigma_control_px = reference.sigma_m * self.camera.principal_distance_px / depth_m.max(1.0);
        PointObservation {
            object_m: reference.reference_m,
            image_px,
            sigma_px: sigma_located_px.hypot(sigma_control_px),
        }
    }

    /// Where a control point is expected.
    fn gate(&self, control_point: usize, prediction: &Prediction, scale: Scale) -> Option<Gate> {
        let reference = &self.control[control_point];
        let (image, covariance) = prediction.image_of(self.camera, reference.reference_m, reference.sigma_m)?;
        Gate::new(image, covariance, scale)
    }

    /// A quick measure of how much the candidates speak for the prediction of a pair.
    fn rating(&self, prediction: &Prediction, expected: &[Option<Expected>], peaks: &[Vec<Peak>]) -> f64 {
        let c = self.camera.principal_distance_px;
        let of_one = |(control_point, peaks): (usize, &Vec<Peak>)| {
            let reach_px = expected[control_point].as_ref()?.reach_px;
            let image_px = prediction.orientation.reduced_px(c, self.control[control_point].reference_m)?;
            if peaks.iter().all(|peak| (peak.at_px - image_px).norm_squared() > reach_px * reach_px) {
                return None;
            }
            let gate = self.gate(control_point, prediction, WIDE)?;
            // the covariance shrinks with every control point that joins: half of the open cells will be closed
            gate.best(peaks).map(|(_, odds)| (odds + gate.log_open_cells / 2.0).max(0.0))
        };
        peaks.iter().enumerate().filter_map(of_one).sum()
    }

    /// Grows an orientation from its seeds: the control point that is surest under the present prediction joins,
    /// then all is predicted anew. The score is the logarithm of the odds of all of them by the chain rule; its first
    /// link is that heading and height are near those of the start, where predicting is linear.
    fn grown(
        &self,
        seeds: &[Seed],
        start: &ExteriorOrientation,
        peaks: &[Vec<Peak>],
        scale: Scale,
    ) -> Option<Hypothesis> {
        let Narrowed { approximation, log_odds } = narrowed(self.approximation, start, self.typical_height_m());
        let prior = approximation.prior(start)?;
        let mut prediction =
            Prediction { orientation: prior.orientation, covariance: prior.information.try_inverse()? };
        let mut linearised_at = *start;
        let mut joined: Vec<Seed> = Vec::new();
        let mut located: Vec<Located> = Vec::new();
        loop {
            let next = match seeds.get(joined.len()) {
                Some(seed) => {
                    let odds = self.gate(seed.control_point, &prediction, scale)?.log_odds(&seed.peak);
                    Some((*seed, odds))
                }
                None => self.surest(&joined, &prediction, peaks, scale),
            };
            let Some((seed, log_odds)) = next else { break };
            joined.push(seed);
            let Seed { control_point, peak } = seed;
            located.push(Located { control_point, at_px: peak.at_px, sigma_px: scale.sigma_px, log_odds });
            let fit = self.fit(&joined, &prior, &linearised_at, scale)?;
            linearised_at = fit.orientation;
            prediction = Prediction { orientation: fit.orientation, covariance: fit.covariance };
        }
        let score = log_odds + located.iter().map(|l| l.log_odds).sum::<f64>();
        (located.len() >= 2).then_some(Hypothesis { prediction, located, score })
    }

    /// Of the control points that have not joined, the one whose best candidate has the largest odds, if any speaks
    /// for the prediction.
    fn surest(
        &self,
        joined: &[Seed],
        prediction: &Prediction,
        peaks: &[Vec<Peak>],
        scale: Scale,
    ) -> Option<(Seed, f64)> {
        let free = (0..peaks.len()).filter(|k| !peaks[*k].is_empty() && joined.iter().all(|j| j.control_point != *k));
        let best = free.filter_map(|control_point| {
            let (peak, odds) = self.gate(control_point, prediction, scale)?.best(&peaks[control_point])?;
            (odds > 0.0).then_some((Seed { control_point, peak }, odds))
        });
        best.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Hypotheses after predicting, locating and orienting anew, round by round, with windows that close; those that
    /// nothing speaks for any more are given up, and so are those far behind the best and those that have become the same
    /// as a better one. `None` if the search is to end.
    pub(super) fn refined(
        &self,
        hypotheses: Vec<Hypothesis>,
        extraction: &mut Extraction,
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<Vec<Hypothesis>>, PictureError> {
        let mut current = hypotheses;
        for round in ROUNDS {
            if !go_on() {
                return Ok(None);
            }
            let windows: Vec<Vec<Narrow>> = current.par_iter().map(|h| self.narrow(&h.prediction, round)).collect();
            self.cover(windows.iter().flatten(), extraction)?;
            self.cover_scenes(current.iter().map(|h| &h.prediction), round.scale, extraction)?;
            let extraction = &*extraction;
            let refined = current.par_iter().zip(&windows).map(|(hypothesis, windows)| {
                let peaks = self.located(&hypothesis.prediction, windows, extraction, round);
                self.regrown(hypothesis, &peaks, round.scale)
            });
            current = refined.collect::<Vec<Option<Hypothesis>>>().into_iter().flatten().collect();
            current.sort_by(|a, b| b.score.total_cmp(&a.score));
            current = self.distinct(current, SAME_PX);
            let least_score = current.first().map_or(0.0, |best| best.score) - HOPELESSLY_BEHIND;
            current.retain(|hypothesis| hypothesis.score >= least_score);
        }
        Ok(Some(current))
    }

    /// A hypothesis anew from other candidates; the two that are surest under the old one start the new one.
    fn regrown(&self, hypothesis: &Hypothesis, peaks: &[Vec<Peak>], scale: Scale) -> Option<Hypothesis> {
        let mut seeds: Vec<Seed> = Vec::new();
        for _ in 0..2 {
            seeds.extend(self.surest(&seeds, &hypothesis.prediction, peaks, scale).map(|(seed, _)| seed));
        }
        self.grown(&seeds, &hypothesis.prediction.orientation, peaks, scale)
    }

    /// The control points that are more likely where a prediction has them than not.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read there.
    pub fn locate_where_predicted(
        &self,
        prediction: &Prediction,
        extraction: &mut Extraction,
        round: Round,
    ) -> Result<Vec<Located>, PictureError> {
        let windows = self.narrow(prediction, round);
        self.cover(windows.iter(), extraction)?;
        self.cover_scenes(std::iter::once(prediction), round.scale, extraction)?;
        let peaks = self.located(prediction, &windows, extraction, round);
        let located = peaks.iter().enumerate().filter_map(|(control_point, of_one)| {
            let (peak, log_odds) = self.gate(control_point, prediction, round.scale)?.best(of_one)?;
            let located = Located { control_point, at_px: peak.at_px, sigma_px: round.scale.sigma_px, log_odds };
            (log_odds > 0.0).then_some(located)
        });
        Ok(located.chain(self.seen_scenes().filter_map(|seen| seen.located)).collect())
    }

    /// The windows of all control points of which something is on the frame, given by the prediction's covariance.
    fn narrow(&self, prediction: &Prediction, round: Round) -> Vec<Narrow> {
        let Scale { cell_px, sigma_px } = round.scale;
        let window = |(control_point, reference): (usize, &ControlPoint)| {
            let (predicted, covariance) = prediction.image_of(self.camera, reference.reference_m, reference.sigma_m)?;
            let edges = edges_on_frame_px(self.camera, &prediction.orientation, reference);
            let edges: Vec<Segment2> = edges.into_iter().flatten().collect();
            if edges.iter().all(|edge| edge.length() < SHORTEST_EDGE_PX) {
                return None;
            }
            let sigma = largest_sigma(&covariance).hypot(sigma_px);
            let half_width_px = (WINDOW_SIGMAS * sigma).clamp(LEAST_CELLS * cell_px, WIDEST_PX);
            Some(Narrow { control_point, predicted, half_width_px, edges })
        };
        self.control.iter().enumerate().filter(|(k, _)| self.is_on(*k)).filter_map(window).collect()
    }

    /// What is around a control point under a prediction; `None` if it is not on the frame.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read there.
    pub fn around(
        &self,
        control_point: usize,
        prediction: &Prediction,
        extraction: &mut Extraction,
    ) -> Result<Option<Around>, PictureError> {
        let round = ROUNDS[ROUNDS.len() - 1];
        if let Some(window) = self.narrow(prediction, round).into_iter().find(|w| w.control_point == control_point) {
            self.cover(std::iter::once(&window), extraction)?;
            let reach_px = window.half_width_px + reach(&window.edges, window.predicted);
            let map = clustered(&window, extraction, round);
            let Narrow { predicted: predicted_px, edges: edges_px, .. } = window;
            return Ok(Some(Around { predicted_px, reach_px, edges_px, map: Some(map) }));
        }
        let reference_m = self.control[control_point].reference_m;
        let image = prediction.orientation.reduced_px(self.camera.principal_distance_px, reference_m);
        let on_frame = image.filter(|p| on_frame(self.camera, *p, 0.0));
        let reach_px = LEAST_CELLS * round.scale.cell_px;
        Ok(on_frame.map(|predicted_px| Around { predicted_px, reach_px, edges_px: Vec::new(), map: None }))
    }

    /// Extracts the segments around a control point that somebody has seen at a place.
    pub(super) fn cover_place(
        &self,
        control_point: usize,
        at_px: Vector2<f64>,
        prediction: &Prediction,
        extraction: &mut Extraction,
    ) -> Result<(), PictureError> {
        let edges = edges_on_frame_px(self.camera, &prediction.orientation, &self.control[control_point]);
        let edges: Vec<Segment2> = edges.into_iter().flatten().collect();
        let reach_px = reach(&edges, at_px);
        extraction.cover_all(&[square(self.camera, at_px, reach_px)])
    }

    /// Extracts the segments that windows need.
    fn cover<'w>(
        &self,
        windows: impl Iterator<Item = &'w Narrow>,
        extraction: &mut Extraction,
    ) -> Result<(), PictureError> {
        let needed = |w: &Narrow| square(self.camera, w.predicted, w.half_width_px + reach(&w.edges, w.predicted));
        extraction.cover_all(&windows.map(needed).collect::<Vec<_>>())
    }

    /// The candidates of every control point: of a building in its window, of a scene where it is expected.
    fn located(
        &self,
        prediction: &Prediction,
        windows: &[Narrow],
        extraction: &Extraction,
        round: Round,
    ) -> Vec<Vec<Peak>> {
        let mut candidates = vec![Vec::new(); self.control.len()];
        for window in windows {
            candidates[window.control_point] = clustered(window, extraction, round).peaks(PEAKS_OF_A_WINDOW);
        }
        self.sight(prediction, round.scale, extraction, &mut candidates);
        candidates
    }
}

/// What the line segments say of the shifts of a window.
fn clustered(window: &Narrow, extraction: &Extraction, round: Round) -> ShiftMap {
    let clustering = Clustering {
        half_width_px: window.half_width_px,
        cell_px: round.scale.cell_px,
        direction_tolerance_rad: round.direction_tolerance_rad,
        fine: true,
    };
    let near = extraction.near(window.predicted, window.half_width_px + reach(&window.edges, window.predicted));
    shift_map(&window.edges, window.predicted, near.map(|(_, segment)| segment), &clustering)
}

/// A narrow window with the edges of its control point.
struct Narrow {
    control_point: usize,
    predicted: Vector2<f64>,
    half_width_px: f64,
    edges: Vec<Segment2>,
}
