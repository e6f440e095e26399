//! What classifiers see: features without units, of the evidence for an orientation or of a trial. The larger the
//! better, each of them.

use super::evidence::{Evidence, Trial};
use super::verdict::Features;
use crate::learning::Kind;

/// The features of a trial, those of Förstner and Läbe (section 4), with their signs turned where less is better.
pub const OF_TRIAL: [&str; 4] = ["points", "less_eliminated", "less_log_sigma0", "less_log_configuration"];

/// What they say, for staff.
const ABOUT_TRIAL: [&str; 4] = [
    "number of located control points",
    "agreement of the located control points with one another",
    "fit of the located control points",
    "configuration of the located control points",
];

/// The paper's simplified classifier has one (4.2).
pub const OF_TRIAL_SIMPLIFIED: [&str; 1] = ["less_log_variance_increase"];

/// The four features of a trial.
#[must_use]
pub fn of_trial(features: &Features) -> Vec<f64> {
    let Features { control_points, eliminated, log_sigma0, log_configuration } = *features;
    vec![control_points as f64, -(eliminated as f64), -log_sigma0, -log_configuration]
}

/// `-log(sigma0² lambda_max)`: by so much the largest variance is larger than that of the reference configuration.
#[must_use]
pub fn of_trial_simplified(features: &Features) -> Vec<f64> {
    vec![-(2.0 * features.log_sigma0 + features.log_configuration)]
}

/// What a feature of a kind of classifier says, for staff: "the … is low".
#[must_use]
pub fn about(kind: Kind, feature: usize) -> &'static str {
    let known = match kind {
        Kind::Paper => ABOUT_TRIAL.get(feature).copied(),
        Kind::OneFeature => Some("precision by the located control points"),
        Kind::EvidenceSvm | Kind::EvidenceLogistic => OF_EVIDENCE.get(feature).map(|feature| feature.about),
    };
    known.unwrap_or("quality")
}

/// The features of each trial.
#[must_use]
pub fn of_trials(trials: &[Trial], of_one: fn(&Features) -> Vec<f64>) -> Vec<Vec<f64>> {
    trials.iter().map(|trial| of_one(&trial.features)).collect()
}

/// A feature of the evidence.
pub struct EvidenceFeature {
    /// Its name.
    pub name: &'static str,
    /// What it says, for staff: "the … is low".
    pub about: &'static str,
    value: fn(&Evidence) -> f64,
}

/// The features of the evidence.
pub const OF_EVIDENCE: [EvidenceFeature; 22] = [
    EvidenceFeature {
        name: "safety_from_chance",
        about: "probability that random errors stay within the tolerance",
        value: |e| log_odds_against(e.risk.by_chance),
    },
    EvidenceFeature {
        name: "safety_from_displacement",
        about: "probability that no displaced control point takes the ground beyond the tolerance",
        value: |e| log_odds_against(e.risk.with_displacement),
    },
    EvidenceFeature {
        name: "safety_from_pair",
        about: "probability that no two displaced control points together take the ground beyond the tolerance",
        value: |e| log_odds_against(e.risk.with_pair),
    },
    EvidenceFeature {
        name: "tolerance_by_sigma",
        about: "tolerance in units of the predicted precision on the ground",
        value: |e| log_ratio(e.tolerance_m, e.sigma_planimetric_m),
    },
    EvidenceFeature {
        name: "tolerance_by_undetected",
        about: "tolerance in units of what an undetected error of a control point can do",
        value: |e| log_ratio(e.tolerance_m, e.sensitivity.undetected_by_one_m),
    },
    EvidenceFeature {
        name: "tolerance_by_undetected_pair",
        about: "tolerance in units of what undetected errors of two control points can do",
        value: |e| log_ratio(e.tolerance_m, e.sensitivity.undetected_by_two_m),
    },
    EvidenceFeature {
        name: "tolerance_by_change",
        about: "tolerance in units of what leaving out a control point changes",
        value: |e| log_ratio(e.tolerance_m, e.sensitivity.change_by_one_m),
    },
    EvidenceFeature {
        name: "tolerance_by_change_pair",
        about: "tolerance in units of what leaving out two control points changes",
        value: |e| log_ratio(e.tolerance_m, e.sensitivity.change_by_two_m),
    },
    EvidenceFeature {
        name: "tolerance_by_move",
        about: "agreement of the orientation with points and the one with lines",
        value: |e| log_ratio(e.tolerance_m, e.moved_by_lines_m),
    },
    EvidenceFeature {
        name: "control_points",
        about: "number of control points that took part",
        value: |e| (e.control_points as f64 + 0.5).ln(),
    },
    EvidenceFeature {
        name: "redundancy",
        about: "number of observations that check the orientation",
        value: |e| (e.redundancy as f64 + 0.5).ln(),
    },
    EvidenceFeature {
        name: "found_share",
        about: "share of the control points in view that were found",
        value: |e| e.control_points as f64 / e.control_points_in_view.max(1) as f64,
    },
    EvidenceFeature {
        name: "agreement",
        about: "agreement of the control points with one another",
        value: |e| -e.sensitivity.mean_test.clamp(SMALL_TEST, LARGE_TEST).ln(),
    },
    EvidenceFeature {
        name: "worst_agreement",
        about: "agreement of the worst control point with all others",
        value: |e| -e.sensitivity.largest_test.clamp(SMALL_TEST, LARGE_TEST).ln(),
    },
    EvidenceFeature { name: "fit", about: "fit of the line segments", value: |e| -e.sigma0.clamp(0.2, 10.0).ln() },
    EvidenceFeature { name: "inlier_share", about: "share of the line segments that fit", value: |e| e.inlier_share },
    EvidenceFeature {
        name: "matched_share",
        about: "share of the edges in view that were found",
        value: |e| e.matched_share_in_view,
    },
    EvidenceFeature {
        name: "hull",
        about: "part of the image that lies between control points",
        value: |e| e.hull_share.max(0.0).sqrt(),
    },
    EvidenceFeature {
        name: "log_odds",
        about: "evidence that it is this place",
        value: |e| e.log_odds.clamp(0.1, 1e6).ln(),
    },
    EvidenceFeature {
        name: "lead",
        about: "lead over the best other orientation",
        value: |e| (e.log_odds - e.runner_up_log_odds).clamp(0.1, 1e6).ln(),
    },
    EvidenceFeature {
        name: "approximation",
        about: "agreement with the approximate orientation",
        value: |e| -(e.distance_from_approximation / 6.0).clamp(0.0, 1e3).sqrt(),
    },
    EvidenceFeature {
        name: "kept_share",
        about: "share of the located control points that agree",
        value: |e| 1.0 - e.features.eliminated as f64 / e.features.control_points.max(1) as f64,
    },
];

/// The names of the features of the evidence.
#[must_use]
pub fn names_of_evidence() -> Vec<&'static str> {
    OF_EVIDENCE.iter().map(|feature| feature.name).collect()
}

/// The features of the evidence; not finite where the evidence is not.
#[must_use]
pub fn of_evidence(evidence: &Evidence) -> Vec<f64> {
    OF_EVIDENCE.iter().map(|feature| (feature.value)(evidence)).collect()
}

/// Tests beyond these say no more.
const SMALL_TEST: f64 = 0.05;
const LARGE_TEST: f64 = 1e3;
/// Probabilities beyond these say no more.
const SMALL_RISK: f64 = 1e-6;
/// A thousandth of the tolerance, or a thousand times it, says all.
const LARGEST_RATIO: f64 = 1e3;

fn log_odds_against(risk: f64) -> f64 {
    let risk = risk.clamp(SMALL_RISK, 1.0 - SMALL_RISK);
    ((1.0 - risk) / risk).ln()
}

/// The logarithm of a ratio of lengths; not a number where one of them is not, or is negative.
fn log_ratio(tolerance_m: f64, length_m: f64) -> f64 {
    if !(tolerance_m > 0.0 && length_m >= 0.0) {
        return f64::NAN;
    }
    (tolerance_m / length_m).clamp(1.0 / LARGEST_RATIO, LARGEST_RATIO).ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::thresholds::tests::sound;

    /// What is worse for each feature, in their order.
    const WORSE: [fn(&mut Evidence); 22] = [
        |e| e.risk.by_chance *= 10.0,
        |e| e.risk.with_displacement *= 10.0,
        |e| e.risk.with_pair *= 10.0,
        |e| e.sigma_planimetric_m *= 2.0,
        |e| e.sensitivity.undetected_by_one_m *= 2.0,
        |e| e.sensitivity.undetected_by_two_m *= 2.0,
        |e| e.sensitivity.change_by_one_m *= 2.0,
        |e| e.sensitivity.change_by_two_m *= 2.0,
        |e| e.moved_by_lines_m *= 2.0,
        |e| e.control_points -= 3,
        |e| e.redundancy -= 40,
        |e| e.control_points_in_view += 5,
        |e| e.sensitivity.mean_test *= 2.0,
        |e| e.sensitivity.largest_test *= 2.0,
        |e| e.sigma0 *= 1.5,
        |e| e.inlier_share -= 0.1,
        |e| e.matched_share_in_view -= 0.1,
        |e| e.hull_share -= 0.1,
        |e| e.log_odds -= 20.0,
        |e| e.runner_up_log_odds += 20.0,
        |e| e.distance_from_approximation += 3.0,
        |e| e.features.eliminated += 2,
    ];

    #[test]
    fn every_feature_can_be_named_to_staff() {
        assert_eq!(about(Kind::Paper, 0), "number of located control points");
        assert_eq!(about(Kind::EvidenceSvm, 9), "number of control points that took part");
        assert!(about(Kind::OneFeature, 0).contains("precision"));
    }

    #[test]
    fn what_is_worse_is_less() {
        let before = of_evidence(&sound());
        for (k, worse) in WORSE.iter().enumerate() {
            let mut evidence = sound();
            worse(&mut evidence);
            let after = of_evidence(&evidence);
            assert!(after[k] < before[k], "{}", OF_EVIDENCE[k].name);
            assert!((0..22).all(|other| after[other] <= before[other]), "{}", OF_EVIDENCE[k].name);
        }
    }

    #[test]
    fn units_of_length_do_not_matter() {
        let mut in_feet = sound();
        for length in [
            &mut in_feet.tolerance_m,
            &mut in_feet.sigma_planimetric_m,
            &mut in_feet.sigma_of_nine_m,
            &mut in_feet.moved_by_lines_m,
            &mut in_feet.sensitivity.change_by_one_m,
            &mut in_feet.sensitivity.change_by_two_m,
            &mut in_feet.sensitivity.undetected_by_one_m,
            &mut in_feet.sensitivity.undetected_by_two_m,
        ] {
            *length /= 0.3048;
        }
        let differs = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-9;
        assert!(!of_evidence(&in_feet).iter().zip(&of_evidence(&sound())).any(differs));
    }

    #[test]
    fn features_of_trials_are_the_papers() {
        let features = Features { control_points: 9, eliminated: 2, log_sigma0: 0.5, log_configuration: 1.25 };
        assert_eq!(of_trial(&features), [9.0, -2.0, -0.5, -1.25]);
        assert_eq!(of_trial_simplified(&features), [-(2.0 * 0.5 + 1.25)]);
    }

    #[test]
    fn lengths_that_are_none_have_no_feature() {
        assert!(log_ratio(1.0, f64::NAN).is_nan() && log_ratio(0.0, 1.0).is_nan() && log_ratio(1.0, -1.0).is_nan());
        assert_eq!(log_ratio(1.0, 0.0), LARGEST_RATIO.ln());
        assert_eq!(log_ratio(1.0, f64::INFINITY), -LARGEST_RATIO.ln());
    }
}
