//! What is known of the orientation that was found: its outcome, and the evidence for and against it.

use nalgebra::{Matrix6, Vector2};

use super::outcome::{control_point_results, edge_results, footprint_m, in_view, matched_shares, pair_results};
use super::run::{LARGEST_CONFIGURATION, Run, Solution};
use super::{ControlPointResult, Estimate, GroundPrecision, Judge, Outcome};
use crate::diagnosis::precision::{ground_points, ground_precision};
use crate::diagnosis::{
    Case, Evidence, GroundSensitivity, Risk, Sensitivities, SensitivityEvidence, Trial, Witness, WitnessWeight,
    d_max_m, hull_share, judge, lambda_max, reference_covariance, risk,
};
use crate::estimation::Reliability;
use crate::orientation::ControlPoint;
use crate::orientation::adjust::{Adjustment, Model};
use crate::orientation::extract::Extraction;
use crate::orientation::search::Search;
use crate::orientation::shifts::sigma_shift_px;

/// What the best solution is held against.
pub(super) struct Rivals {
    /// Log odds of the best other orientation that sees the ground differently.
    pub(super) runner_up_log_odds: f64,
    /// The orientations with points that were examined.
    pub(super) trials: Vec<Trial>,
}

impl Run<'_> {
    /// The outcome with the best solution, judged.
    pub(super) fn outcome(&self, search: &Search, extraction: &Extraction, best: &Solution, rivals: Rivals) -> Outcome {
        let camera = &self.task.camera;
        let adjustment = &best.adjustment;
        let prediction = adjustment.prediction();
        let height_m = mean_height_m(search.control, adjustment);
        let ground = ground_points(camera, &prediction.orientation, height_m);
        let precision = ground_precision(&ground, &prediction.covariance);
        let reliability = reliability(search, extraction, adjustment);
        let sensitivities = reliability.as_ref().map(|reliability| Sensitivities::of(reliability, &ground));
        let tolerance_m = self.tolerance_m(&adjustment.orientation, height_m);
        let scale = adjustment.sigma0().max(1.0).powi(2);
        let all_on_ground = ground.len() == 9;
        let risk = reliability.filter(|_| all_on_ground).map(|r| risk(&r, scale, &ground, tolerance_m));
        let configuration = self.configuration(search, adjustment, height_m);
        let evidence = Evidence {
            configuration,
            runner_up_log_odds: rivals.runner_up_log_odds,
            sensitivity: extremes(sensitivities.as_ref()),
            risk: risk.unwrap_or(CERTAIN),
            ..self.evidence(search, extraction, best, &precision, height_m)
        };
        let sensitivities = sensitivities.unwrap_or_default();
        let control_points = control_point_results(search, Some((adjustment, &sensitivities)), extraction.segments());
        let witnesses: Vec<Witness> = control_points.iter().map(witness).collect();
        let case = Case { evidence: &evidence, trials: &rivals.trials, witnesses: &witnesses };
        let Judge { classifier, policy } = &self.task.judge;
        Outcome {
            estimate: Some(Estimate {
                orientation: adjustment.orientation,
                covariance: prediction.covariance,
                sigma0: adjustment.sigma0(),
                redundancy: adjustment.redundancy,
                configuration: configuration.min(LARGEST_CONFIGURATION),
            }),
            diagnosis: judge(&case, classifier, policy),
            control_points,
            check_points: Vec::new(),
            pairs: pair_results(search, adjustment, &sensitivities),
            edges: edge_results(search, adjustment, extraction.segments()),
            ground_precision: precision,
            consensus: Some(best.consensus),
            evidence: Some(evidence),
            trials: rivals.trials,
            ground_height_m: Some(height_m),
            footprint_m: footprint_m(camera, &adjustment.orientation, height_m),
            cost: None,
        }
    }

    /// The evidence of the solution itself.
    fn evidence(
        &self,
        search: &Search,
        extraction: &Extraction,
        best: &Solution,
        ground: &[GroundPrecision],
        height_m: f64,
    ) -> Evidence {
        let adjustment = &best.adjustment;
        let orientation = &adjustment.orientation;
        let all_on_ground = |value: f64| if ground.len() == 9 { value } else { f64::INFINITY };
        let sigmas_m = || ground.iter().map(|g| g.sigma_planimetric_m);
        let away = self.task.approximation.prior(orientation).map_or(f64::INFINITY, |prior| {
            let step = orientation.step_to(&prior.orientation);
            step.dot(&(prior.information * step))
        });
        let matches = || adjustment.kept.iter().flatten();
        let matched = matched_shares(search, adjustment, extraction.segments());
        let places: Vec<Vector2<f64>> = adjustment
            .held_by()
            .filter_map(|index| orientation.pixel(search.camera, search.control[index].reference_m))
            .collect();
        let by_points = best.by_points.orientation;
        Evidence {
            features: best.features,
            sigma0: adjustment.sigma0(),
            redundancy: adjustment.redundancy,
            configuration: f64::INFINITY,
            control_points: adjustment.held_by().count(),
            control_points_in_view: in_view(search, Some(adjustment)).count(),
            inlier_share: matches().filter(|kept| **kept).count() as f64 / matches().count().max(1) as f64,
            matched_share: matched.of_used,
            matched_share_in_view: matched.of_all,
            hull_share: hull_share(search.camera, &places),
            sigma_planimetric_m: all_on_ground(sigmas_m().fold(0.0, f64::max)),
            sigma_of_nine_m: all_on_ground(mean(sigmas_m().map(|s| s * s)).sqrt()),
            tolerance_m: self.tolerance_m(orientation, height_m),
            log_odds: best.log_odds,
            runner_up_log_odds: 0.0,
            distance_from_approximation: away,
            moved_by_lines_m: d_max_m(search.camera, &by_points, orientation, height_m).unwrap_or(f64::INFINITY),
            sensitivity: extremes(None),
            risk: CERTAIN,
        }
    }

    /// lambda_max against four buildings in the image corners, as exactly known as these.
    fn configuration(&self, search: &Search, adjustment: &Adjustment, height_m: f64) -> f64 {
        let camera = &self.task.camera;
        let orientation = &adjustment.orientation;
        let depth_m = (orientation.projection_centre_m.z - height_m).max(1.0);
        let sigma_m = mean(adjustment.held_by().map(|index| search.control[index].sigma_m));
        let sigma_px = (sigma_m * camera.principal_distance_px / depth_m).hypot(sigma_shift_px());
        let prior = search.approximation.prior(orientation);
        reference_covariance(camera, orientation, height_m, sigma_px, prior.as_ref())
            .and_then(|reference: Matrix6<f64>| lambda_max(&adjustment.covariance, &reference))
            .unwrap_or(f64::INFINITY)
    }
}

/// What cannot be computed may well happen.
const CERTAIN: Risk = Risk { by_chance: 1.0, with_displacement: 1.0, with_pair: 1.0 };

/// How the adjustment depends on its control points.
pub(super) fn reliability(search: &Search, extraction: &Extraction, adjustment: &Adjustment) -> Option<Reliability> {
    let Search { camera, control, approximation, .. } = *search;
    let prior = approximation.prior(&adjustment.orientation)?;
    let model = Model { camera, control, observed: extraction.segments(), prior: &prior };
    model.reliability(adjustment)
}

fn witness(point: &ControlPointResult) -> Witness {
    let weight = point.sensitivity.map(|sensitivity| WitnessWeight {
        contradicts: sensitivity.contradicts,
        change_m: sensitivity.ground.change_m,
        theoretical_m: sensitivity.ground.theoretical_m,
    });
    Witness { name: point.name.clone(), used: point.used, weight }
}

/// The extremes of the sensitivities; where they cannot be computed, or nothing checks a control point or a pair,
/// anything may happen.
fn extremes(sensitivities: Option<&Sensitivities>) -> SensitivityEvidence {
    let nothing = Sensitivities::default();
    let Sensitivities { single, pairs, unchecked, unchecked_pairs } = sensitivities.unwrap_or(&nothing);
    let checked = unchecked.is_empty() && !single.is_empty();
    let of_one = |value: fn(&GroundSensitivity<1>) -> f64| {
        if checked { single.iter().map(value).fold(0.0, f64::max) } else { f64::INFINITY }
    };
    let of_two = |value: fn(&GroundSensitivity<2>) -> f64| {
        let checked = checked && unchecked_pairs.is_empty() && !pairs.is_empty();
        if checked { pairs.iter().map(value).fold(0.0, f64::max) } else { f64::INFINITY }
    };
    SensitivityEvidence {
        change_by_one_m: of_one(|s| s.change_m),
        change_by_two_m: of_two(|s| s.change_m),
        undetected_by_one_m: of_one(|s| s.theoretical_m),
        undetected_by_two_m: of_two(|s| s.theoretical_m),
        largest_test: of_one(|s| s.test),
        mean_test: if checked { mean(single.iter().map(|s| s.test)) } else { f64::INFINITY },
        contradicting: single.iter().filter(|s| s.contradicts).count(),
    }
}

/// The mean height of the control used.
pub(super) fn mean_height_m(control: &[ControlPoint], adjustment: &Adjustment) -> f64 {
    mean(adjustment.held_by().map(|index| control[index].reference_m.z))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / f64::max(count, 1.0)
}
