//! Self-diagnosis by thresholds (Förstner and Läbe 2.3; method 1.6 and trap 4.7.3).
//!
//! Every criterion gives a margin: the logarithm of the ratio of what is allowed to what was found, so that 0 is just
//! allowed. The score is the smallest margin. Green: no margin is negative. Red: one is so negative that the result
//! is no use even for a second look. Yellow: between.

use super::verdict::{Diagnosis, Features, Reason, Verdict};

/// What is known of an orientation when it is judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// The paper's features, after the orientation with points.
    pub features: Features,
    /// Standard deviation of unit weight of the adjustment with lines.
    pub sigma0: f64,
    /// lambda_max of the adjustment against four control points in the corners.
    pub configuration: f64,
    /// Control points that took part in the adjustment.
    pub control_points: usize,
    /// Control points that the orientation puts on the frame.
    pub control_points_in_view: usize,
    /// Largest predicted planimetric standard deviation on the 3x3 ground grid; infinite if a ray misses the ground.
    pub sigma_planimetric_m: f64,
    /// The largest D_max that the user can accept.
    pub tolerance_m: f64,
    /// Logarithm of the odds of the chosen orientation.
    pub log_odds: f64,
    /// The same of the best orientation that differs from it.
    pub runner_up_log_odds: f64,
    /// Squared distance from the approximation, in its standard deviations (6 degrees of freedom).
    pub distance_from_approximation: f64,
}

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
    /// exceeds two of them in 2 % of all cases if the errors are as assumed, and in 6 % if they are
    /// [`REAL_ERRORS`] times as large. At 40 for a wrong acceptance against 5 for a wrong rejection (paper 4.1) it
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

/// Control shares errors that no residual shows: on the photographs of `../shared/bench` the true error on the ground
/// was in the root mean square about so many times the predicted one.
const REAL_ERRORS: f64 = 1.2;
/// Beyond this margin (a factor of three) a result is no use.
const RED_MARGIN: f64 = -1.1;

/// The verdict on an orientation.
#[must_use]
pub fn judge(evidence: &Evidence, thresholds: &Thresholds) -> Diagnosis {
    let mut criteria = criteria(evidence, thresholds);
    criteria.sort_by(|a, b| a.margin.total_cmp(&b.margin));
    let score = criteria.first().map_or(f64::NEG_INFINITY, |worst| worst.margin);
    let verdict = if score >= 0.0 {
        Verdict::Green
    } else if score > RED_MARGIN {
        Verdict::Yellow
    } else {
        Verdict::Red
    };
    let failed = criteria.into_iter().filter(|c| c.margin < 0.0);
    let mut reasons: Vec<Reason> = failed.map(|c| Reason { code: c.code, detail: c.detail }).collect();
    if reasons.is_empty() {
        reasons.push(Reason { code: "verified", detail: verified(evidence) });
    }
    Diagnosis {
        verdict,
        score: score.max(LEAST_SCORE),
        threshold: 0.0,
        probability_correct: probability(evidence, thresholds),
        features: Some(evidence.features),
        reasons,
    }
}

/// Scores are finite, however hopeless.
const LEAST_SCORE: f64 = -99.0;

/// The verdict on an image for which no orientation was found.
#[must_use]
pub fn not_oriented(code: &'static str, detail: String) -> Diagnosis {
    Diagnosis {
        verdict: Verdict::Red,
        score: LEAST_SCORE,
        threshold: 0.0,
        probability_correct: 0.0,
        features: None,
        reasons: vec![Reason { code, detail }],
    }
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

fn verified(e: &Evidence) -> String {
    format!(
        "{} control points agree, sigma0 is {:.2}, the predicted standard deviation on the ground stays below {:.2} m for \
         a tolerance of {:.2} m",
        e.control_points, e.sigma0, e.sigma_planimetric_m, e.tolerance_m
    )
}

/// Probability that D_max is within the tolerance: that the right control points were found, from the log odds and
/// the lead, and then that a planimetric error with the predicted standard deviation stays within it. A rule of thumb
/// until a classifier is trained.
fn probability(e: &Evidence, t: &Thresholds) -> f64 {
    let logistic = |v: f64| 1.0 / (1.0 + (-v).exp());
    let lead = e.log_odds - e.runner_up_log_odds;
    let found = logistic((e.log_odds - t.log_odds / 2.0) / 3.0) * logistic((lead - t.lead / 2.0) / 2.0);
    let ratio = e.tolerance_m / (REAL_ERRORS * e.sigma_planimetric_m);
    let precise = if ratio.is_finite() { 1.0 - (-ratio * ratio).exp() } else { 0.0 };
    (found * precise).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sound() -> Evidence {
        Evidence {
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

    fn verdict(change: impl FnOnce(&mut Evidence)) -> (Verdict, &'static str) {
        let mut evidence = sound();
        change(&mut evidence);
        let diagnosis = judge(&evidence, &Thresholds::default());
        (diagnosis.verdict, diagnosis.reasons[0].code)
    }

    #[test]
    fn what_is_sound_is_green() {
        assert_eq!(verdict(|_| ()), (Verdict::Green, "verified"));
    }

    #[test]
    fn every_criterion_can_stop_it_and_names_itself() {
        assert_eq!(verdict(|e| e.sigma_planimetric_m = 0.3), (Verdict::Yellow, "precision_insufficient"));
        assert_eq!(verdict(|e| e.sigma_planimetric_m = f64::INFINITY), (Verdict::Red, "precision_insufficient"));
        assert_eq!(verdict(|e| e.sigma0 = 2.5), (Verdict::Yellow, "fit_poor"));
        assert_eq!(verdict(|e| e.configuration = 500.0), (Verdict::Red, "configuration_weak"));
        assert_eq!(
            verdict(|e| (e.control_points, e.control_points_in_view) = (3, 4)),
            (Verdict::Yellow, "few_control_points")
        );
        assert_eq!(verdict(|e| e.log_odds = 12.0), (Verdict::Yellow, "ambiguous"));
        assert_eq!(verdict(|e| (e.log_odds, e.runner_up_log_odds) = (12.0, -9.0)), (Verdict::Yellow, "evidence_weak"));
        assert_eq!(verdict(|e| e.runner_up_log_odds = 79.0), (Verdict::Red, "ambiguous"));
        assert_eq!(verdict(|e| e.distance_from_approximation = 30.0), (Verdict::Yellow, "contradicts_approximation"));
        assert_eq!(verdict(|e| e.runner_up_log_odds = 50.0), (Verdict::Yellow, "ambiguous"));
        assert_eq!(verdict(|e| e.control_points_in_view = 30), (Verdict::Yellow, "control_missing"));
        assert_eq!(verdict(|e| e.features.log_sigma0 = 1.2), (Verdict::Yellow, "points_disagree"));
        assert_eq!(verdict(|e| e.features.eliminated = 7), (Verdict::Yellow, "many_eliminated"));
    }

    #[test]
    fn not_a_number_is_never_green() {
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
            assert_ne!(verdict(spoil).0, Verdict::Green);
        }
    }
}
