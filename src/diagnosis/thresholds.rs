//! Self-diagnosis by thresholds (Förstner and Läbe 2.3; method 1.6 and trap 4.7.3). A classifier decides; the thresholds
//! say in words what it may not like, and are what it is measured against.
//!
//! Every criterion gives a margin: the logarithm of the ratio of what is allowed to what was found, so that 0 is just
//! allowed.

use super::evidence::Evidence;
use super::verdict::Reason;

/// What is allowed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    /// T_P for sigma0: two to three times what was assumed is usual (paper 2.3).
    pub sigma0: f64,
    /// T_C for lambda_max. The paper's 10 is for points; here the reference is four buildings adjusted with all their
    /// edges in the corners of the image, which is a stricter one.
    pub configuration: f64,
    /// Fewer control points than four leave no check on errors (paper 2.2).
    pub control_points: usize,
    /// The tolerance must be so many times the largest predicted planimetric standard deviation: a planimetric error
    /// exceeds two of them in 2 % of all cases if the errors are as assumed, and in 6 % if they are 1.2 times as large,
    /// as they were on the photographs of `../shared/bench`. At 40 for a wrong acceptance against 5 for a wrong rejection (paper 4.1) it
    /// pays to accept up to 14 %.
    pub tolerance_by_sigma: f64,
    /// Least log odds in favour of the orientation.
    pub log_odds: f64,
    /// Least lead over the runner-up, in log odds; and no less than the runner-up's own: one that is half as well
    /// founded is a contradiction, not an accident.
    pub lead: f64,
    /// Largest squared distance from the approximation: chi-square with 6 degrees of freedom, 99.9 %.
    pub distance_from_approximation: f64,
    /// Least share of the control points in view that must have been found: where most of them contradict an
    /// orientation by their absence, the others may be the wrong ones.
    pub found_share: f64,
    /// T_P for sigma0 of the orientation with points.
    pub sigma0_of_points: f64,
    /// Largest share of control points that were eliminated as wrong: beyond, consensus may be chance.
    pub eliminated_share: f64,
}

impl Default for Thresholds {
    fn default() -> Self {
        Self {
            sigma0: 2.0,
            configuration: 20.0,
            control_points: 4,
            tolerance_by_sigma: 2.0,
            log_odds: 15.0,
            lead: 10.0,
            distance_from_approximation: 22.5,
            found_share: 0.5,
            sigma0_of_points: 3.0,
            eliminated_share: 0.5,
        }
    }
}

/// The criteria that are not met, the worst first.
pub(super) fn failed(evidence: &Evidence, thresholds: &Thresholds) -> Vec<Reason> {
    let mut failed = criteria(evidence, thresholds);
    failed.retain(|criterion| criterion.margin < 0.0);
    failed.sort_by(|a, b| a.margin.total_cmp(&b.margin));
    failed.into_iter().map(|criterion| Reason { code: criterion.code, detail: criterion.detail }).collect()
}

/// Whether no threshold is passed.
#[must_use]
pub fn accepts(evidence: &Evidence, thresholds: &Thresholds) -> bool {
    criteria(evidence, thresholds).iter().all(|criterion| criterion.margin >= 0.0)
}

struct Criterion {
    margin: f64,
    code: &'static str,
    detail: String,
}

/// The margin of something that must be small; not a number counts as not allowed.
fn at_most(value: f64, limit: f64) -> f64 {
    if value >= 0.0 && limit > 0.0 { (limit / value.max(f64::MIN_POSITIVE)).ln() } else { f64::NEG_INFINITY }
}

/// The margin of something that must be large.
fn at_least(value: f64, limit: f64) -> f64 {
    if value > 0.0 { (value / limit).ln() } else { f64::NEG_INFINITY }
}

fn criteria(e: &Evidence, t: &Thresholds) -> Vec<Criterion> {
    let eliminated = e.features.eliminated as f64 / e.features.control_points.max(1) as f64;
    let lead = e.log_odds - e.runner_up_log_odds;
    let least_lead = t.lead.max(e.runner_up_log_odds);
    let found = e.control_points as f64 / e.control_points_in_view.max(1) as f64;
    let sigma0_of_points = e.features.log_sigma0.exp();
    let criterion = |margin: f64, code, detail: String| Criterion { margin, code, detail };
    vec![
        criterion(
            at_most(t.tolerance_by_sigma * e.sigma_planimetric_m, e.tolerance_m),
            "precision_insufficient",
            format!(
                "the predicted standard deviation on the ground reaches {:.2} m; for a tolerance of {:.2} m it must stay \
                 below {:.2} m: more control is needed where the image has none",
                e.sigma_planimetric_m,
                e.tolerance_m,
                e.tolerance_m / t.tolerance_by_sigma
            ),
        ),
        criterion(
            at_most(e.sigma0, t.sigma0),
            "fit_poor",
            format!(
                "the line segments fit {:.1} times worse than assumed ({:.1} is allowed): control may be outdated or \
                 its stated accuracy too good",
                e.sigma0, t.sigma0
            ),
        ),
        criterion(
            // lambda_max is a ratio of variances
            at_most(e.configuration.sqrt(), t.configuration.sqrt()),
            "configuration_weak",
            format!(
                "the control points lie unfavourably: lambda_max is {:.1}, {:.0} is allowed; control in the other parts \
                 of the image would help",
                e.configuration, t.configuration
            ),
        ),
        criterion(
            at_least(e.control_points as f64, t.control_points as f64),
            "few_control_points",
            format!(
                "only {} control points were found and used; {} are needed to check one another",
                e.control_points, t.control_points
            ),
        ),
        criterion(
            at_least(e.log_odds, t.log_odds),
            "evidence_weak",
            format!(
                "the image shows little of the control (log odds {:.1}, at least {:.0} are needed): the agreement may be \
                 chance",
                e.log_odds, t.log_odds
            ),
        ),
        criterion(
            at_least(lead, least_lead),
            "ambiguous",
            format!(
                "another orientation explains the image nearly as well (log odds differ by {lead:.1}, at least {:.0} are \
                 needed): repeated patterns, or control that contradicts itself; a better approximation would decide",
                least_lead
            ),
        ),
        criterion(
            at_most(e.distance_from_approximation, t.distance_from_approximation),
            "contradicts_approximation",
            format!(
                "the orientation is {:.1} standard deviations away from the approximation: one of them is wrong, or the \
                 sigmas of the approximation are too small",
                e.distance_from_approximation.sqrt()
            ),
        ),
        criterion(
            at_least(found, t.found_share),
            "control_missing",
            format!(
                "only {} of {} control points in view were found: the others contradict the orientation, or are outdated \
                 or hidden",
                e.control_points, e.control_points_in_view
            ),
        ),
        criterion(
            at_most(sigma0_of_points, t.sigma0_of_points),
            "points_disagree",
            format!(
                "the located control points fit {sigma0_of_points:.1} times worse than assumed ({:.1} is allowed): some \
                 are located wrongly or outdated",
                t.sigma0_of_points
            ),
        ),
        criterion(
            at_most(eliminated, t.eliminated_share),
            "many_eliminated",
            format!(
                "{} of {} located control points do not fit the others: the consensus may be chance",
                e.features.eliminated, e.features.control_points
            ),
        ),
    ]
}

/// What speaks for an orientation that is accepted.
pub(super) fn verified(e: &Evidence) -> String {
    format!(
        "{} control points agree, sigma0 is {:.2}, the predicted standard deviation on the ground stays below {:.2} m for \
         a tolerance of {:.2} m",
        e.control_points, e.sigma0, e.sigma_planimetric_m, e.tolerance_m
    )
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::diagnosis::{Features, Risk, SensitivityEvidence};

    pub(in crate::diagnosis) fn sound() -> Evidence {
        Evidence {
            redundancy: 200,
            inlier_share: 0.9,
            matched_share: 0.6,
            matched_share_in_view: 0.5,
            hull_share: 0.5,
            sigma_of_nine_m: 0.04,
            moved_by_lines_m: 0.1,
            risk: Risk { by_chance: 1e-6, with_displacement: 1e-4, with_pair: 1e-5 },
            sensitivity: SensitivityEvidence {
                change_by_one_m: 0.05,
                change_by_two_m: 0.1,
                undetected_by_one_m: 0.1,
                undetected_by_two_m: 0.2,
                largest_test: 6.0,
                mean_test: 2.0,
                contradicting: 0,
            },
            features: Features { control_points: 12, eliminated: 1, log_sigma0: 0.0, log_configuration: 1.0 },
            sigma0: 1.1,
            configuration: 3.0,
            control_points: 11,
            control_points_in_view: 14,
            sigma_planimetric_m: 0.05,
            tolerance_m: 0.5,
            log_odds: 80.0,
            runner_up_log_odds: 5.0,
            distance_from_approximation: 5.0,
        }
    }

    fn worst(change: impl FnOnce(&mut Evidence)) -> &'static str {
        let mut evidence = sound();
        change(&mut evidence);
        let failed = failed(&evidence, &Thresholds::default());
        assert_eq!(failed.is_empty(), accepts(&evidence, &Thresholds::default()));
        failed.first().map_or("accepted", |reason| reason.code)
    }

    #[test]
    fn what_is_sound_is_accepted() {
        assert_eq!(worst(|_| ()), "accepted");
    }

    #[test]
    fn every_criterion_can_stop_it_and_names_itself() {
        assert_eq!(worst(|e| e.sigma_planimetric_m = 0.3), "precision_insufficient");
        assert_eq!(worst(|e| e.sigma_planimetric_m = f64::INFINITY), "precision_insufficient");
        assert_eq!(worst(|e| e.sigma0 = 2.5), "fit_poor");
        assert_eq!(worst(|e| e.configuration = 500.0), "configuration_weak");
        assert_eq!(worst(|e| (e.control_points, e.control_points_in_view) = (3, 4)), "few_control_points");
        assert_eq!(worst(|e| e.log_odds = 12.0), "ambiguous");
        assert_eq!(worst(|e| (e.log_odds, e.runner_up_log_odds) = (12.0, -9.0)), "evidence_weak");
        assert_eq!(worst(|e| e.runner_up_log_odds = 79.0), "ambiguous");
        assert_eq!(worst(|e| e.distance_from_approximation = 30.0), "contradicts_approximation");
        assert_eq!(worst(|e| e.runner_up_log_odds = 50.0), "ambiguous");
        assert_eq!(worst(|e| e.control_points_in_view = 30), "control_missing");
        assert_eq!(worst(|e| e.features.log_sigma0 = 1.2), "points_disagree");
        assert_eq!(worst(|e| e.features.eliminated = 7), "many_eliminated");
    }

    #[test]
    fn not_a_number_is_never_accepted() {
        for spoil in [
            |e: &mut Evidence| e.sigma0 = f64::NAN,
            |e: &mut Evidence| e.features.log_sigma0 = f64::NAN,
            |e: &mut Evidence| e.tolerance_m = f64::NAN,
            |e: &mut Evidence| e.tolerance_m = -1.0,
            |e: &mut Evidence| e.configuration = f64::NAN,
            |e: &mut Evidence| e.sigma_planimetric_m = f64::NAN,
            |e: &mut Evidence| e.log_odds = f64::NAN,
            |e: &mut Evidence| e.runner_up_log_odds = f64::NAN,
            |e: &mut Evidence| e.distance_from_approximation = f64::NAN,
        ] {
            assert_ne!(worst(spoil), "accepted");
        }
    }
}
