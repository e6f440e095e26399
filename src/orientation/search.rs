//! Which of the candidates belong together? The errors of prediction are common to all control points of an image,
//! so two of them, rightly located, predict all others.
//!
//! *Views*: the rotations that the approximation allows are cut into steps small enough for the shape of a control
//! point; under each of them every control point is located in a wide window. *Pairs* of candidates with the
//! approximation as an observation give orientations; each is rated by the candidates of the other control points
//! that lie where it predicts them. The best are *refined*: predicted anew, located in narrow windows, oriented.

use nalgebra::{Matrix2, Rotation3, Vector2, Vector3};

use super::ControlPoint;
use super::extract::Extraction;
use super::locate::{Clustering, Peak, shift_map};
use super::predict::{Approximation, Prediction, edges_px, on_frame};
use crate::estimation::{PointObservation, Prior, Resection, resect};
use crate::features::PictureError;
use crate::geometry::{Camera, ExteriorOrientation};

/// What the search works with.
pub struct Search<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Control points that may be in view.
    pub control: &'a [ControlPoint],
    /// What is known beforehand.
    pub approximation: &'a Approximation,
    /// The same as an observation.
    pub prior: &'a Prior,
}

/// A control point at one of its candidates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// Index of the control point.
    pub control_point: usize,
    /// Where it is, reduced.
    pub at_px: Vector2<f64>,
    /// Standard deviation of the location.
    pub sigma_px: f64,
    /// Logarithm of the odds that it is there, given the prediction.
    pub log_odds: f64,
}

/// An orientation with the control points that speak for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Hypothesis {
    /// The orientation and its covariance.
    pub prediction: Prediction,
    /// Control points found where it predicts them.
    pub located: Vec<Located>,
    /// Sum of their log odds, less what the prior says against the orientation.
    pub score: f64,
}

/// What the search cost and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SearchCost {
    /// Rotations under which the control points were located.
    pub views: usize,
    /// Candidates for control points.
    pub candidates: usize,
    /// Pairs of candidates that were oriented.
    pub pairs: usize,
    /// Hypotheses that were refined.
    pub refined: usize,
}

/// Steps of the rotation up to this to either side leave the shape of a building as it is, to a cell of shifts.
const HALF_VIEW_RAD: f64 = 5.2 * std::f64::consts::PI / 180.0;
/// The approximation is believed up to so many of its standard deviations.
const REACH_SIGMAS: f64 = 3.0;
/// Windows of the wide search; a wider one costs more than another view.
const WIDEST_PX: f64 = 700.0;
/// Standard deviation of a location in the wide search: half a cell and what the view is off.
const WIDE_SIGMA_PX: f64 = 8.0;
const WIDE_CELL_PX: f64 = 6.0;
const WIDE_DIRECTION_RAD: f64 = 7.0 * std::f64::consts::PI / 180.0;
const PEAKS_OF_A_VIEW: usize = 10;
const PEAKS_OF_A_CONTROL_POINT: usize = 40;
/// Candidates that are paired with one another.
const PAIRED: usize = 260;
/// Squared distance from prediction, in standard deviations, up to which a candidate counts: 99.7 % of a plane.
const GATE: f64 = 11.6;
/// Sum of squares of a pair with the prior beyond which they do not belong together (4 redundant observations,
/// 99.99 %).
const PAIR_GATE: f64 = 24.0;
const GROWN: usize = 300;
const REFINED: usize = 14;

impl Search<'_> {
    /// The best hypotheses that differ from one another, best first; empty if nothing speaks for any.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read where control points are expected.
    pub fn run(
        &self,
        extraction: &mut Extraction,
        cancelled: &dyn Fn() -> bool,
    ) -> Result<(Vec<Hypothesis>, SearchCost), PictureError> {
        let views = self.views();
        let mut candidates: Vec<Vec<Candidate>> = vec![Vec::new(); self.control.len()];
        for view in &views {
            if cancelled() {
                return Ok(Default::default());
            }
            for (index, of_one) in candidates.iter_mut().enumerate() {
                self.locate_wide(view, index, extraction, of_one)?;
            }
        }
        for of_one in &mut candidates {
            keep_best(of_one);
        }
        let (hypotheses, pairs) = self.pairs(&candidates, cancelled);
        let mut refined = Vec::new();
        for hypothesis in hypotheses.iter().take(REFINED) {
            if cancelled() {
                return Ok(Default::default());
            }
            refined.extend(self.refined(hypothesis, extraction)?);
        }
        let cost = SearchCost {
            views: views.len(),
            candidates: candidates.iter().map(Vec::len).sum(),
            pairs,
            refined: refined.len(),
        };
        refined.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok((self.distinct(refined), cost))
    }

    /// Orientations that cover what the approximation allows, each with the covariance of what remains open.
    fn views(&self) -> Vec<Prediction> {
        let steps = |reach: f64| ((reach / HALF_VIEW_RAD).ceil() as i32).max(1);
        let tilt_reach = REACH_SIGMAS * self.approximation.sigma_tilt_rad;
        let kappa_reach = self
            .approximation
            .sigma_kappa_rad
            .map_or(std::f64::consts::PI, |s| (REACH_SIGMAS * s).min(std::f64::consts::PI));
        let (tilts, kappas) = (steps(tilt_reach), steps(kappa_reach));
        let at = |k: i32, n: i32, reach: f64| reach * (2.0 * f64::from(k) + 1.0 - f64::from(n)) / f64::from(n);
        // what remains open in a step: evenly distributed, but no wider than what was known
        let open = |reach: f64, n: i32| reach / f64::from(n) / 3.0_f64.sqrt();
        let (tilt_open, kappa_open) = (open(tilt_reach, tilts).powi(2), open(kappa_reach, kappas).powi(2));
        let mut views = Vec::new();
        for (i, j, k) in (0..tilts).flat_map(|i| (0..tilts).flat_map(move |j| (0..kappas).map(move |k| (i, j, k)))) {
            let (tilt_x, tilt_y) = (at(i, tilts, tilt_reach), at(j, tilts, tilt_reach));
            // a view in the corner of the square is less likely than any that the reach was meant for
            if tilts > 2 && tilt_x.hypot(tilt_y) > 1.15 * tilt_reach {
                continue;
            }
            let orientation = self.approximation.orientation;
            let turn = Rotation3::from_scaled_axis(Vector3::new(tilt_x, tilt_y, 0.0));
            let spin = Rotation3::from_axis_angle(&Vector3::z_axis(), at(k, kappas, kappa_reach));
            let rotation = turn * spin * orientation.camera_from_object;
            let mut covariance = nalgebra::Matrix6::zeros();
            for (axis, sigma) in self.approximation.sigma_position_m.iter().enumerate() {
                covariance[(axis, axis)] = sigma.powi(2);
            }
            for (axis, variance) in [tilt_open, tilt_open, kappa_open].into_iter().enumerate() {
                covariance[(3 + axis, 3 + axis)] = variance;
            }
            let orientation = ExteriorOrientation { camera_from_object: rotation, ..orientation };
            views.push(Prediction { orientation, covariance });
        }
        views
    }

    fn locate_wide(
        &self,
        view: &Prediction,
        index: usize,
        extraction: &mut Extraction,
        candidates: &mut Vec<Candidate>,
    ) -> Result<(), PictureError> {
        let control_point = &self.control[index];
        let Some((predicted, covariance)) =
            view.image_of(self.camera, control_point.reference_m, control_point.sigma_m)
        else {
            return Ok(());
        };
        let half_width_px = (2.5 * largest_sigma(&covariance)).clamp(60.0, WIDEST_PX);
        if !on_frame(self.camera, predicted, half_width_px) {
            return Ok(());
        }
        let edges = edges_anywhere(self.camera, &view.orientation, control_point);
        let clustering = Clustering {
            half_width_px,
            cell_px: WIDE_CELL_PX,
            direction_tolerance_rad: WIDE_DIRECTION_RAD,
            fine: false,
        };
        cover(extraction, self.camera, predicted, half_width_px + reach(&edges, predicted))?;
        let map = shift_map(&edges, predicted, extraction.segments(), &clustering);
        for peak in map.peaks(PEAKS_OF_A_VIEW) {
            if on_frame(self.camera, peak.at_px, 0.0) {
                candidates.push(Candidate { peak, view: view.orientation });
            }
        }
        Ok(())
    }

    /// Orientations from pairs of candidates, best first, and how many pairs were oriented.
    fn pairs(&self, candidates: &[Vec<Candidate>], cancelled: &dyn Fn() -> bool) -> (Vec<Hypothesis>, usize) {
        let mut strongest: Vec<(usize, &Candidate)> =
            candidates.iter().enumerate().flat_map(|(k, of_one)| of_one.iter().map(move |c| (k, c))).collect();
        strongest.sort_by(|a, b| b.1.peak.log_likelihood.total_cmp(&a.1.peak.log_likelihood));
        strongest.truncate(PAIRED);
        let peaks: Vec<Vec<Peak>> = candidates.iter().map(|c| c.iter().map(|c| c.peak).collect()).collect();
        let mut rated: Vec<(f64, [Seed; 2], ExteriorOrientation)> = Vec::new();
        let mut examined = 0;
        for (k, (a, first)) in strongest.iter().enumerate() {
            if cancelled() {
                break;
            }
            for (b, second) in &strongest[..k] {
                if a == b {
                    continue;
                }
                examined += 1;
                let seeds = [Seed::of(*b, second), Seed::of(*a, first)];
                let Some(fit) = self.fit(&seeds, &second.view, WIDE_SIGMA_PX) else { continue };
                if fit.squares > PAIR_GATE {
                    continue;
                }
                let prediction = Prediction { orientation: fit.orientation, covariance: fit.covariance };
                rated.push((self.rating(&prediction, &peaks) - fit.squares / 2.0, seeds, fit.orientation));
            }
        }
        rated.sort_by(|a, b| b.0.total_cmp(&a.0));
        let scale = Scale { cell_px: WIDE_CELL_PX, sigma_px: WIDE_SIGMA_PX };
        let mut hypotheses: Vec<Hypothesis> = rated
            .iter()
            .take(GROWN)
            .filter_map(|(_, seeds, start)| self.grown(seeds, start, &peaks, scale))
            .collect();
        hypotheses.sort_by(|a, b| b.score.total_cmp(&a.score));
        (self.distinct(hypotheses), examined)
    }

    fn fit(&self, seeds: &[Seed], start: &ExteriorOrientation, sigma_px: f64) -> Option<Resection> {
        let observation = |seed: &Seed| PointObservation {
            object_m: self.control[seed.control_point].reference_m,
            image_px: seed.at_px,
            sigma_px,
        };
        let points: Vec<PointObservation> = seeds.iter().map(observation).collect();
        resect(&points, Some(self.prior), start, self.camera.principal_distance_px)
    }

    /// A quick measure of how much the candidates speak for a prediction.
    fn rating(&self, prediction: &Prediction, peaks: &[Vec<Peak>]) -> f64 {
        let mut sum = 0.0;
        for (reference, of_one) in self.control.iter().zip(peaks) {
            let Some((image, covariance)) = prediction.image_of(self.camera, reference.reference_m, reference.sigma_m)
            else {
                continue;
            };
            let gate = Gate::new(image, covariance, Scale { cell_px: WIDE_CELL_PX, sigma_px: WIDE_SIGMA_PX });
            // the covariance shrinks with every control point that joins: half of the open cells will be closed
            let best = gate.and_then(|g| g.best(of_one).map(|(_, odds)| odds + g.log_open_cells / 2.0));
            sum += best.unwrap_or(0.0).max(0.0);
        }
        sum
    }

    /// Grows an orientation from its seeds: the control point that is surest under the present prediction joins,
    /// then all is predicted anew. The score is the logarithm of the odds of all of them by the chain rule.
    fn grown(
        &self,
        seeds: &[Seed],
        start: &ExteriorOrientation,
        peaks: &[Vec<Peak>],
        scale: Scale,
    ) -> Option<Hypothesis> {
        let mut seeds_waiting = seeds.iter().rev().copied().collect::<Vec<_>>();
        let mut prediction =
            Prediction { orientation: *start, covariance: self.prior.information.try_inverse()? };
        // under the prior alone everything is where the prior says
        let mut anchor = self.prior.orientation;
        let mut located: Vec<Located> = Vec::new();
        let mut joined: Vec<Seed> = Vec::new();
        let mut score = 0.0;
        loop {
            let at = |k: usize, anchor: &ExteriorOrientation, covariance: &Prediction| {
                let reference = &self.control[k];
                let (_, c) = covariance.image_of(self.camera, reference.reference_m, reference.sigma_m)?;
                let image = anchor.reduced_px(self.camera.principal_distance_px, reference.reference_m)?;
                Gate::new(image, c, scale)
            };
            let next = if let Some(seed) = seeds_waiting.pop() {
                let gate = at(seed.control_point, &anchor, &prediction)?;
                Some((seed, gate.log_odds(seed.at_px, seed.log_likelihood)))
            } else {
                let free = (0..peaks.len()).filter(|k| joined.iter().all(|j| j.control_point != *k));
                free.filter_map(|k| {
                    let (peak, odds) = at(k, &anchor, &prediction)?.best(&peaks[k])?;
                    let seed = Seed { control_point: k, at_px: peak.at_px, log_likelihood: peak.log_likelihood };
                    (odds > 0.0).then_some((seed, odds))
                })
                .max_by(|a, b| a.1.total_cmp(&b.1))
            };
            let Some((seed, log_odds)) = next else { break };
            joined.push(seed);
            score += log_odds;
            located.push(Located {
                control_point: seed.control_point,
                at_px: seed.at_px,
                sigma_px: scale.sigma_px,
                log_odds,
            });
            let fit = self.fit(&joined, &prediction.orientation, scale.sigma_px)?;
            prediction = Prediction { orientation: fit.orientation, covariance: fit.covariance };
            anchor = fit.orientation;
        }
        Some(Hypothesis { prediction, located, score })
    }

    /// A hypothesis after predicting, locating and orienting anew, round by round, with windows that close.
    fn refined(
        &self,
        hypothesis: &Hypothesis,
        extraction: &mut Extraction,
    ) -> Result<Option<Hypothesis>, PictureError> {
        let mut current = hypothesis.clone();
        for round in ROUNDS {
            let peaks = self.locate_narrow(&current.prediction, extraction, round)?;
            // the two that are surest start
            let mut seeds: Vec<Seed> = Vec::new();
            for (control_point, of_one) in peaks.iter().enumerate() {
                let reference = &self.control[control_point];
                let gate = current
                    .prediction
                    .image_of(self.camera, reference.reference_m, reference.sigma_m)
                    .and_then(|(image, covariance)| Gate::new(image, covariance, round.scale));
                let best = gate.and_then(|g| g.best(of_one));
                seeds.extend(best.filter(|(_, odds)| *odds > 0.0).map(|(peak, odds)| {
                    Seed { control_point, at_px: peak.at_px, log_likelihood: odds }
                }));
            }
            seeds.sort_by(|a, b| b.log_likelihood.total_cmp(&a.log_likelihood));
            seeds.truncate(2);
            for seed in &mut seeds {
                let of_one = &peaks[seed.control_point];
                let own = of_one.iter().find(|p| p.at_px == seed.at_px).map_or(0.0, |p| p.log_likelihood);
                seed.log_likelihood = own;
            }
            let grown = self.grown(&seeds, &current.prediction.orientation, &peaks, round.scale);
            let Some(grown) = grown else { return Ok(None) };
            current = grown;
        }
        Ok(Some(current))
    }

    /// The candidates of all control points on the frame, in windows given by the prediction's covariance.
    fn locate_narrow(
        &self,
        prediction: &Prediction,
        extraction: &mut Extraction,
        round: Round,
    ) -> Result<Vec<Vec<Peak>>, PictureError> {
        let mut candidates = vec![Vec::new(); self.control.len()];
        for (of_one, reference) in candidates.iter_mut().zip(self.control) {
            let Some((predicted, covariance)) = prediction.image_of(self.camera, reference.reference_m, reference.sigma_m)
            else {
                continue;
            };
            if !on_frame(self.camera, predicted, 0.0) {
                continue;
            }
            let Scale { cell_px, sigma_px } = round.scale;
            let sigma = largest_sigma(&covariance).hypot(sigma_px);
            let half_width_px = (3.4 * sigma).clamp(40.0 * cell_px, 300.0);
            let edges = edges_px(self.camera, &prediction.orientation, reference, false);
            let clustering = Clustering {
                half_width_px,
                cell_px,
                direction_tolerance_rad: round.direction_tolerance_rad,
                fine: true,
            };
            cover(extraction, self.camera, predicted, half_width_px + reach(&edges, predicted))?;
            *of_one = shift_map(&edges, predicted, extraction.segments(), &clustering).peaks(PEAKS_OF_A_VIEW);
        }
        Ok(candidates)
    }

    /// The control points that are found where a prediction has them.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read there.
    pub fn locate_where_predicted(
        &self,
        prediction: &Prediction,
        extraction: &mut Extraction,
        round: Round,
    ) -> Result<Vec<Located>, PictureError> {
        let peaks = self.locate_narrow(prediction, extraction, round)?;
        let located = peaks.iter().enumerate().filter_map(|(control_point, of_one)| {
            let reference = &self.control[control_point];
            let (image, covariance) = prediction.image_of(self.camera, reference.reference_m, reference.sigma_m)?;
            let (peak, log_odds) = Gate::new(image, covariance, round.scale)?.best(of_one)?;
            let sigma_px = round.scale.sigma_px;
            (log_odds > 0.0).then_some(Located { control_point, at_px: peak.at_px, sigma_px, log_odds })
        });
        Ok(located.collect())
    }

    /// Of hypotheses in order of their score, those that predict differently from all better ones.
    fn distinct(&self, hypotheses: Vec<Hypothesis>) -> Vec<Hypothesis> {
        const MOST: usize = 3 * REFINED;
        const DIFFERENT_PX: f64 = 25.0;
        let mut kept: Vec<Hypothesis> = Vec::new();
        for hypothesis in hypotheses {
            if kept.len() == MOST {
                break;
            }
            let same = |other: &Hypothesis| self.difference_px(&hypothesis, other) < DIFFERENT_PX;
            if !kept.iter().any(same) {
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

/// How finely shifts are told apart.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Side of a cell of shifts.
    pub cell_px: f64,
    /// Standard deviation of a location.
    pub sigma_px: f64,
}

/// A round of locating in narrow windows.
#[derive(Debug, Clone, Copy)]
pub struct Round {
    /// The scale of the shifts.
    pub scale: Scale,
    /// Largest angle between a model edge and a segment that may be its image.
    pub direction_tolerance_rad: f64,
}

const ROUNDS: [Round; 3] = [
    Round { scale: Scale { cell_px: 4.0, sigma_px: 6.0 }, direction_tolerance_rad: 0.10 },
    Round { scale: Scale { cell_px: 3.0, sigma_px: 4.0 }, direction_tolerance_rad: 0.07 },
    Round { scale: Scale { cell_px: 2.0, sigma_px: 3.0 }, direction_tolerance_rad: 0.06 },
];

/// A control point at a place.
#[derive(Debug, Clone, Copy)]
struct Seed {
    control_point: usize,
    at_px: Vector2<f64>,
    log_likelihood: f64,
}

impl Seed {
    fn of(control_point: usize, candidate: &Candidate) -> Self {
        Self { control_point, at_px: candidate.peak.at_px, log_likelihood: candidate.peak.log_likelihood }
    }
}

/// Where a control point is expected, and how many cells that leaves open.
struct Gate {
    predicted: Vector2<f64>,
    weight: Matrix2<f64>,
    log_open_cells: f64,
}

impl Gate {
    fn new(predicted: Vector2<f64>, covariance: Matrix2<f64>, scale: Scale) -> Option<Self> {
        let covariance = covariance + Matrix2::identity() * scale.sigma_px.powi(2);
        let weight = covariance.try_inverse()?;
        let open_cells = 2.0 * std::f64::consts::PI * covariance.determinant().sqrt() / (2.0 * scale.cell_px).powi(2);
        Some(Self { predicted, weight, log_open_cells: open_cells.max(1.0).ln() })
    }

    /// A peak's likelihood ratio is against a shift anywhere; a prediction that leaves many cells open has as many
    /// chances to meet a peak by accident.
    fn log_odds(&self, at_px: Vector2<f64>, log_likelihood: f64) -> f64 {
        let away = at_px - self.predicted;
        log_likelihood - away.dot(&(self.weight * away)) / 2.0 - self.log_open_cells
    }

    /// The candidate with the largest log odds within the gate.
    fn best(&self, peaks: &[Peak]) -> Option<(Peak, f64)> {
        let inside = peaks.iter().filter(|peak| {
            let away = peak.at_px - self.predicted;
            away.dot(&(self.weight * away)) < GATE
        });
        inside.map(|p| (*p, self.log_odds(p.at_px, p.log_likelihood))).max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    peak: Peak,
    view: ExteriorOrientation,
}

/// Keeps the best candidates of a control point, and of those that neighbouring views found twice the better.
fn keep_best(candidates: &mut Vec<Candidate>) {
    candidates.sort_by(|a, b| b.peak.log_likelihood.total_cmp(&a.peak.log_likelihood));
    let mut kept: Vec<Candidate> = Vec::with_capacity(PEAKS_OF_A_CONTROL_POINT);
    for candidate in candidates.iter() {
        let twice = |k: &Candidate| (k.peak.at_px - candidate.peak.at_px).norm() < 2.0 * WIDE_CELL_PX;
        if kept.len() < PEAKS_OF_A_CONTROL_POINT && !kept.iter().any(twice) {
            kept.push(*candidate);
        }
    }
    *candidates = kept;
}

fn edges_anywhere(
    camera: &Camera,
    orientation: &ExteriorOrientation,
    control_point: &ControlPoint,
) -> Vec<crate::geometry::Segment2> {
    let c = camera.principal_distance_px;
    let ends = control_point.edges_m.iter().filter_map(|edge| {
        Some(crate::geometry::Segment2 {
            start: orientation.reduced_px(c, edge.start)?,
            end: orientation.reduced_px(c, edge.end)?,
        })
    });
    ends.collect()
}

fn reach(edges: &[crate::geometry::Segment2], predicted: Vector2<f64>) -> f64 {
    edges.iter().flat_map(|e| [e.start, e.end]).map(|end| (end - predicted).amax()).fold(0.0, f64::max)
}

/// Extracts the segments in a square about a reduced point.
fn cover(
    extraction: &mut Extraction,
    camera: &Camera,
    centre: Vector2<f64>,
    half_width_px: f64,
) -> Result<(), PictureError> {
    let centre = camera.pixel_from_reduced(centre);
    let half = Vector2::repeat(1.05 * half_width_px);
    extraction.cover(centre - half, centre + half)
}

fn largest_sigma(covariance: &Matrix2<f64>) -> f64 {
    let (a, b, c) = (covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]);
    ((a + c) / 2.0 + ((a - c) / 2.0).hypot(b)).sqrt()
}

