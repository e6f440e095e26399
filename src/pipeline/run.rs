//! One image from its pixels to its verdict.

use nalgebra::Matrix6;
use rand::SeedableRng as _;
use rand::seq::index::sample;
use rand_chacha::ChaCha8Rng;

use super::assess::{Rivals, mean_height_m};
use super::outcome::control_point_results;
use super::{Approximation, ConsensusResult, Cost, Fault, Observer, Outcome, Stage, Task, Tolerance};
use crate::diagnosis::{
    Features, MOST_TRIALS, Trial, Verdict, d_max_m, lambda_max, not_oriented, reference_covariance,
};
use crate::estimation::{
    Consensus, Guarantee, PointObservation, Prior, Resection, Survey, largest_consistent, quadruples, resect,
};
use crate::features::Picture;
use crate::geometry::{Camera, ExteriorOrientation};
use crate::orientation::ControlPoint;
use crate::orientation::adjust::Adjustment;
use crate::orientation::collect::{adjust_with_lines, log_odds};
use crate::orientation::extract::Extraction;
use crate::orientation::predict::Prediction;
use crate::orientation::search::{BEYOND_DOUBT, Found, HOPELESSLY_BEHIND, Hypothesis, Search};
use crate::orientation::select::{maybe_in_view, well_spread};

/// Control points that an image is oriented by, at most: the search costs time for each, and a few dozen that are
/// well spread say all.
const MOST_CONTROL_POINTS: usize = 60;
/// Hypotheses that are adjusted with lines.
const ADJUSTED: usize = 6;
/// Subsets that the search for the largest consistent set may examine: some 15 ms for an image that needs them all,
/// where a few thousand do as a rule.
const MOST_SUBSETS: usize = 200_000;
/// Quadruples of version A, which stands in where no set is consistent: all up to 30 points, C(30, 4).
const MOST_QUADRUPLES: usize = 27_405;
/// The paper's threshold for an acceptable reprojection (1.5 px), in units of the a-priori standard deviation.
const LARGEST_SIGMA0: f64 = 1.5;
/// The paper's T_C for the quadruples of version A.
const ACCEPTABLE_CONFIGURATION: f64 = 10.0;
/// The paper's tolerance t_e of a residual in version A.
const TOLERANCE_PX: f64 = 10.0;

/// Orients one image by the control points around it (given in the same local tangent plane as the approximation;
/// those that cannot be in view are ignored).
///
/// # Errors
/// [`Fault`] if the picture cannot be read or the observer cancels.
pub fn orient(
    picture: &dyn Picture,
    control: &[ControlPoint],
    task: &Task,
    observer: &dyn Observer,
) -> Result<Outcome, Fault> {
    Ok(attempt(Run { picture, task, observer, done: 0.0 }, control)?.outcome)
}

/// The same, with all that another look at the image needs.
pub(super) fn attempt<'a>(run: Run<'a>, control: &[ControlPoint]) -> Result<Attempt<'a>, Fault> {
    let stated = &run.task.approximation;
    if stated.prior(&stated.orientation).is_none() {
        let detail = "the approximate rotation looks along the horizon (phi near 90 degrees), where omega and kappa are \
                      not defined: only images that look down can be oriented";
        let diagnosis = not_oriented("approximation_degenerate", detail.to_owned());
        return Ok(Attempt::without_search(Outcome::without_orientation(diagnosis)));
    }
    let first = run.around(control, stated)?;
    if first.is_found() || first.outcome.diagnosis.verdict != Verdict::Red {
        return Ok(first);
    }
    // nothing that can be used: the approximation may be worse than it says
    let Some(erring_more) = stated.erring_more() else { return Ok(first) };
    let again = Run { done: ALMOST_DONE, ..run }.around(control, &erring_more)?;
    let cost = again.outcome.cost.map(|again| again.after(first.outcome.cost.as_ref()));
    let mut better = if again.best_score > first.best_score { again } else { first };
    better.outcome.cost = cost;
    Ok(better)
}

/// Where the progress of a second search begins: the first one was thought to be the only one.
const ALMOST_DONE: f64 = 0.97;

/// What a search around an approximation led to.
pub(super) struct Attempt<'a> {
    pub(super) outcome: Outcome,
    /// That of its best hypothesis.
    best_score: f64,
    /// `None` where there was nothing to search for.
    pub(super) searched: Option<Searched<'a>>,
}

/// What was searched, and what was found on the way.
pub(super) struct Searched<'a> {
    pub(super) control: Vec<ControlPoint>,
    pub(super) approximation: Approximation,
    pub(super) extraction: Extraction<'a>,
    pub(super) best: Option<Solution>,
    /// All orientations that were taken into account, with their log odds.
    pub(super) seen: Vec<(ExteriorOrientation, f64)>,
}

impl Attempt<'_> {
    fn without_search(outcome: Outcome) -> Self {
        Self { outcome, best_score: 0.0, searched: None }
    }

    /// Whether a wrong hypothesis would not have such a score.
    fn is_found(&self) -> bool {
        self.best_score > BEYOND_DOUBT / 2.0
    }
}

/// What all stages of a run share.
#[derive(Clone, Copy)]
pub(super) struct Run<'a> {
    pub(super) picture: &'a dyn Picture,
    pub(super) task: &'a Task,
    pub(super) observer: &'a dyn Observer,
    /// The share of the work that was done before.
    pub(super) done: f64,
}

/// An orientation that was adjusted with lines.
#[derive(Clone)]
pub(super) struct Solution {
    /// The orientation with points.
    pub(super) by_points: Prediction,
    pub(super) adjustment: Adjustment,
    pub(super) log_odds: f64,
    pub(super) features: Features,
    pub(super) consensus: ConsensusResult,
}

impl<'a> Run<'a> {
    pub(super) fn enter(&self, stage: Stage, fraction: f64) -> Result<(), Fault> {
        self.progress(stage, fraction);
        if self.observer.cancelled() { Err(Fault::Cancelled) } else { Ok(()) }
    }

    fn progress(&self, stage: Stage, fraction: f64) {
        self.observer.progress(stage, self.done + (1.0 - self.done) * fraction);
    }

    /// With an approximation and the control points that it may have in view.
    fn around(&self, control: &[ControlPoint], approximation: &Approximation) -> Result<Attempt<'a>, Fault> {
        self.enter(Stage::Predict, 0.0)?;
        let camera = &self.task.camera;
        let in_view = maybe_in_view(control, camera, approximation);
        let control = well_spread(&in_view, MOST_CONTROL_POINTS);
        if control.is_empty() {
            let detail = "no control point lies where this image can look: import control points for this area, or \
                          check the approximate position";
            let diagnosis = not_oriented("no_control_in_view", detail.to_owned());
            return Ok(Attempt::without_search(Outcome::without_orientation(diagnosis)));
        }
        let search = Search::new(camera, &control, approximation);
        self.enter(Stage::Extract, 0.05)?;
        let edge_px = typical_edge_px(&control, camera, approximation);
        let mut extraction = Extraction::new(self.picture, camera, edge_px).for_scenes(search.reduction());
        self.enter(Stage::Locate, 0.1)?;
        let go_on = |done: f64| {
            self.progress(Stage::Locate, 0.1 + 0.6 * done);
            !self.observer.cancelled()
        };
        let Found { hypotheses, report } = search.run(&mut extraction, &go_on)?;
        self.enter(Stage::Resect, 0.7)?;
        let best_score = hypotheses.first().map_or(0.0, |best| best.score);
        let least_score = best_score - HOPELESSLY_BEHIND;
        let promising = hypotheses.iter().take(ADJUSTED).take_while(|h| h.score >= least_score).count();
        let mut trials = Vec::new();
        let (mut solutions, unsolved) =
            self.solutions(&search, &hypotheses[..promising], &mut extraction, &mut trials)?;
        self.look_again(&search, &mut solutions, &mut extraction)?;
        self.enter(Stage::Diagnose, ALMOST_DONE)?;
        let cost =
            Some(Cost { search: report, adjusted: promising, pixels_read: extraction.pixels_read(), widened: false });
        let adjusted = solutions.iter().map(|s| (s.adjustment.orientation, s.log_odds));
        let not_adjusted = unsolved.into_iter().chain(&hypotheses[promising..]);
        let not_adjusted = not_adjusted.map(|h| (h.prediction.orientation, h.score));
        let seen: Vec<(ExteriorOrientation, f64)> = adjusted.chain(not_adjusted).collect();
        let best = solutions.into_iter().next();
        let outcome = match &best {
            Some(best) => self.outcome(&search, &extraction, best, self.rivals(&search, best, &seen, trials)),
            None => self.not_found(&search, &hypotheses),
        };
        let check_points = match &best {
            Some(best) => self.check_points(&best.adjustment, &mut extraction)?,
            None => Vec::new(),
        };
        let outcome = Outcome { cost, check_points, ..outcome };
        let approximation = approximation.clone();
        let searched = Searched { control, approximation, extraction, best, seen };
        Ok(Attempt { outcome, best_score, searched: Some(searched) })
    }

    /// What a solution is held against, of all that was seen.
    pub(super) fn rivals(
        &self,
        search: &Search,
        best: &Solution,
        seen: &[(ExteriorOrientation, f64)],
        trials: Vec<Trial>,
    ) -> Rivals {
        let rivals = seen.iter().filter(|(other, _)| self.differ(search, best, other));
        let runner_up_log_odds = rivals.map(|(_, log_odds)| *log_odds).fold(0.0, f64::max);
        Rivals { runner_up_log_odds, trials: selected(trials) }
    }

    /// What hypotheses lead to, the best first, and those that lead to nothing.
    fn solutions<'h>(
        &self,
        search: &Search,
        hypotheses: &'h [Hypothesis],
        extraction: &mut Extraction,
        trials: &mut Vec<Trial>,
    ) -> Result<(Vec<Solution>, Vec<&'h Hypothesis>), Fault> {
        let (mut solutions, mut unsolved) = (Vec::new(), Vec::new());
        for (k, hypothesis) in hypotheses.iter().enumerate() {
            self.enter(Stage::Adjust, 0.75 + 0.2 * k as f64 / ADJUSTED as f64)?;
            match self.solve(search, hypothesis, extraction, trials)? {
                Some(solution) => solutions.push(solution),
                None => unsolved.push(hypothesis),
            }
        }
        solutions.sort_by(|a: &Solution, b| b.log_odds.total_cmp(&a.log_odds));
        Ok((solutions, unsolved))
    }

    /// Points, then lines.
    pub(super) fn solve(
        &self,
        search: &Search,
        hypothesis: &Hypothesis,
        extraction: &mut Extraction,
        trials: &mut Vec<Trial>,
    ) -> Result<Option<Solution>, Fault> {
        let Some(prior) = search.approximation.prior(&hypothesis.prediction.orientation) else { return Ok(None) };
        let points = points(search, hypothesis);
        let Some(consensus) = self.consensus(&points, &prior, hypothesis) else { return Ok(None) };
        trials.extend(self.trials(&points, &consensus, &prior));
        let (by_points, features) = self.after_points(&points, &consensus, &prior);
        let consensus = ConsensusResult {
            guarantee: consensus.guarantee,
            subsets: consensus.subsets,
            control_points: points.len(),
            inliers: consensus.inliers.len(),
        };
        let Some(adjustment) = adjust_with_lines(search, &by_points, extraction)? else { return Ok(None) };
        let log_odds = log_odds(search, &adjustment.prediction(), extraction)?;
        Ok(Some(Solution { by_points, adjustment, log_odds, features, consensus }))
    }

    /// Which of the located points agree: the largest set that is consistent. Where none is, by far more than the
    /// points' standard deviations explain, version A with its wide tolerance; and where no quadruple is acceptable
    /// either, all stay: the search has chosen them to agree, and the lines will tell.
    fn consensus(&self, points: &[PointObservation], prior: &Prior, hypothesis: &Hypothesis) -> Option<Consensus> {
        let start = hypothesis.prediction.orientation;
        let principal_distance_px = self.task.camera.principal_distance_px;
        let survey = Survey { points, prior: Some(prior), start, principal_distance_px };
        let version_a = || {
            let reference = self.reference(&hypothesis.prediction.orientation, points, prior);
            let acceptable = |fit: &Resection| {
                let lambda = reference.as_ref().and_then(|r| lambda_max(&fit.covariance, r));
                lambda.is_some_and(|l| l <= ACCEPTABLE_CONFIGURATION)
            };
            let cancelled = || self.observer.cancelled();
            let found = quadruples(&survey, &acceptable, TOLERANCE_PX, MOST_QUADRUPLES, &cancelled)?;
            // all quadruples may be complete, but not by the measure of the largest consistent set
            Some(Consensus { guarantee: Guarantee::Sampled, ..found })
        };
        let all = || {
            let resection = resect(points, Some(prior), &start, principal_distance_px)?;
            let inliers: Vec<usize> = (0..points.len()).collect();
            let examined = vec![inliers.clone()];
            Some(Consensus { resection, inliers, guarantee: Guarantee::Sampled, subsets: 1, examined })
        };
        largest_consistent(&survey, LARGEST_SIGMA0, MOST_SUBSETS).or_else(version_a).or_else(all)
    }

    fn after_points(
        &self,
        points: &[PointObservation],
        consensus: &Consensus,
        prior: &Prior,
    ) -> (Prediction, Features) {
        let fit = &consensus.resection;
        let inflation = fit.sigma0().max(1.0).powi(2);
        let prediction = Prediction { orientation: fit.orientation, covariance: fit.covariance * inflation };
        (prediction, self.features(points, consensus.inliers.len(), fit, prior))
    }

    /// The paper's features of a resection with some of the located points.
    fn features(&self, points: &[PointObservation], inliers: usize, fit: &Resection, prior: &Prior) -> Features {
        let configuration = self
            .reference(&fit.orientation, points, prior)
            .and_then(|reference| lambda_max(&fit.covariance, &reference))
            .unwrap_or(f64::INFINITY);
        Features {
            control_points: points.len(),
            eliminated: points.len().saturating_sub(inliers),
            log_sigma0: fit.sigma0().max(SMALLEST_SIGMA0).ln(),
            log_configuration: configuration.min(LARGEST_CONFIGURATION).ln(),
        }
    }

    /// The sets of points that the search for the consensus has examined, each with its own resection.
    fn trials(&self, points: &[PointObservation], consensus: &Consensus, prior: &Prior) -> Vec<Trial> {
        let start = &consensus.resection.orientation;
        let trial = |set: &Vec<usize>| {
            let chosen: Vec<PointObservation> = set.iter().map(|&index| points[index]).collect();
            let fit = resect(&chosen, Some(prior), start, self.task.camera.principal_distance_px)?;
            let features = self.features(points, chosen.len(), &fit, prior);
            Some(Trial { features, orientation: fit.orientation })
        };
        consensus.examined.iter().filter_map(trial).collect()
    }

    /// The covariance with four control points in the image corners, located as well as these.
    fn reference(&self, at: &ExteriorOrientation, points: &[PointObservation], prior: &Prior) -> Option<Matrix6<f64>> {
        let count = points.len() as f64;
        let height_m = points.iter().map(|p| p.object_m.z).sum::<f64>() / count;
        let sigma_px = points.iter().map(|p| p.sigma_px).sum::<f64>() / count;
        reference_covariance(&self.task.camera, at, height_m, sigma_px, Some(prior))
    }

    /// Whether another orientation sees the ground differently by more than the user can accept.
    fn differ(&self, search: &Search, best: &Solution, other: &ExteriorOrientation) -> bool {
        let height_m = mean_height_m(search.control, &best.adjustment);
        let own = &best.adjustment.orientation;
        d_max_m(&self.task.camera, other, own, height_m).is_none_or(|d| d > self.tolerance_m(own, height_m))
    }

    pub(super) fn tolerance_m(&self, orientation: &ExteriorOrientation, height_m: f64) -> f64 {
        match self.task.tolerance {
            Tolerance::Metres(metres) => metres,
            Tolerance::Gsd(gsd) => {
                let depth_m = orientation.projection_centre_m.z - height_m;
                gsd * depth_m / self.task.camera.principal_distance_px
            }
        }
    }

    pub(super) fn not_found(&self, search: &Search, hypotheses: &[Hypothesis]) -> Outcome {
        let located = hypotheses.first().map_or(0, |h| h.located.len());
        let detail = format!(
            "of {} control points around, {located} were found where one orientation has them, and their lines do not \
             determine it: the image may lie elsewhere, or show too little of the control",
            search.control.len()
        );
        let code = if located == 0 { "nothing_located" } else { "not_determined" };
        let mut outcome = Outcome::without_orientation(not_oriented(code, detail));
        outcome.control_points = control_point_results(search, None, &[]);
        outcome
    }
}

/// Logarithms stay finite.
const SMALLEST_SIGMA0: f64 = 1e-3;
pub(super) const LARGEST_CONFIGURATION: f64 = 1e9;

/// Of all trials those that are kept: half of them are the best by residual, the others a draw of the rest.
fn selected(mut trials: Vec<Trial>) -> Vec<Trial> {
    trials.sort_by(|a, b| a.features.log_sigma0.total_cmp(&b.features.log_sigma0));
    if trials.len() > MOST_TRIALS {
        let rest = trials.split_off(MOST_TRIALS / 2);
        let mut draws = ChaCha8Rng::seed_from_u64(SEED_OF_TRIALS);
        let mut drawn = sample(&mut draws, rest.len(), MOST_TRIALS - MOST_TRIALS / 2).into_vec();
        drawn.sort_unstable();
        trials.extend(drawn.into_iter().map(|k| rest[k].clone()));
    }
    trials
}

const SEED_OF_TRIALS: u64 = 64;

/// The located control points as observations, surest first.
fn points(search: &Search, hypothesis: &Hypothesis) -> Vec<PointObservation> {
    let mut located = hypothesis.located.clone();
    located.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
    let at = &hypothesis.prediction.orientation;
    located.iter().map(|l| search.observation(l.control_point, l.at_px, l.sigma_px, at)).collect()
}

/// The median length in the image of the edges, roughly: it decides at which resolutions segments are extracted.
fn typical_edge_px(control: &[ControlPoint], camera: &Camera, approximation: &Approximation) -> f64 {
    let centre_m = approximation.orientation.projection_centre_m;
    let mut lengths_px: Vec<f64> = control
        .iter()
        .flat_map(|point| point.edges_m.iter())
        .map(|edge| {
            let depth_m = (centre_m.z - edge.midpoint().z).abs().max(1.0);
            edge.length() * camera.principal_distance_px / depth_m
        })
        .collect();
    let middle = lengths_px.len() / 2;
    if lengths_px.is_empty() {
        return 0.0;
    }
    *lengths_px.select_nth_unstable_by(middle, f64::total_cmp).1
}
