//! The traffic light: what a classifier says of the evidence, at the costs of the user, and why.
//!
//! Green: verified, the score exceeds the threshold and the evidence is of a kind that the classifier knows. Red: not
//! solved, or more likely wrong than right. Yellow: between, or unknown to the classifier.

use super::evidence::{Evidence, Trial};
use super::features::{about, of_evidence, of_trial, of_trial_simplified, of_trials};
use super::thresholds::{Thresholds, failed, verified};
use super::verdict::{Diagnosis, Reason, Verdict};
use crate::learning::classifier::Judgement;
use crate::learning::{Classifier, Costs, Kind, Outside};

/// What the user wants of a verdict.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Policy {
    /// What decisions cost.
    pub costs: Costs,
    /// By so many times the odds of being wrong may be larger than on the images that the classifier was trained on;
    /// `None`: what the classifier says of areas that it was not trained on.
    pub caution: Option<f64>,
    /// T_d, instead of that which follows from costs and caution.
    pub threshold: Option<f64>,
}

/// What a control point has to say.
#[derive(Debug, Clone, PartialEq)]
pub struct Witness {
    /// Its name.
    pub name: String,
    /// Whether it took part.
    pub used: bool,
    /// How the result depends on it; `None` if the others do not predict it, or if it tells nothing.
    pub weight: Option<WitnessWeight>,
}

/// How a result depends on a control point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WitnessWeight {
    /// Whether it is not where all others expect it.
    pub contradicts: bool,
    /// So far the ground moves without it.
    pub change_m: f64,
    /// What an undetected error of it can do.
    pub theoretical_m: f64,
}

/// An orientation to be judged.
#[derive(Debug, Clone, Copy)]
pub struct Case<'a> {
    /// What is known of it.
    pub evidence: &'a Evidence,
    /// The orientations with points that were examined.
    pub trials: &'a [Trial],
    /// The control points in view.
    pub witnesses: &'a [Witness],
}

/// More than this probability of being wrong is red.
const LEAST_PROBABILITY_OF_YELLOW: f64 = 0.5;
/// Fewer control points leave no check on errors (paper 2.2).
const LEAST_CONTROL_POINTS: usize = 4;
/// Where two or more control points contradict all others, and one in so many does, nothing is verified.
const MOST_CONTRADICTING: usize = 4;
/// Scores are finite, however hopeless.
const LEAST_SCORE: f64 = -99.0;
/// Names in a reason, at most.
const MOST_NAMES: usize = 5;

/// The threshold of a classifier at the costs of a policy: where accepting begins to pay, on images that it was not
/// trained on and with its caution. Infinite where it never does.
#[must_use]
pub fn threshold(classifier: &Classifier, policy: &Policy) -> f64 {
    let of_costs = || {
        let caution = policy.caution.unwrap_or(classifier.caution);
        let from = classifier.calibration.least_score(policy.costs.least_probability_with(caution)?)?;
        // what exceeds the threshold is accepted, and it is finite where all are
        Some(from.next_down().max(2.0 * LEAST_SCORE))
    };
    policy.threshold.or_else(of_costs).unwrap_or(f64::INFINITY)
}

/// What the classifier says of an orientation.
#[must_use]
pub fn judged(classifier: &Classifier, case: &Case) -> Option<Judgement> {
    let samples = match classifier.kind {
        Kind::Paper => of_trials(case.trials, of_trial),
        Kind::OneFeature => of_trials(case.trials, of_trial_simplified),
        Kind::EvidenceSvm | Kind::EvidenceLogistic => vec![of_evidence(case.evidence)],
    };
    classifier.judge(&samples)
}

/// The verdict on an orientation.
#[must_use]
pub fn judge(case: &Case, classifier: &Classifier, policy: &Policy) -> Diagnosis {
    let threshold = threshold(classifier, policy);
    let judgement = judged(classifier, case);
    let (score, probability) = judgement.map_or((LEAST_SCORE, 0.0), |j| (j.score.max(LEAST_SCORE), j.probability));
    let accepted = judgement.is_some_and(|j| j.outside.is_none() && j.score > threshold);
    let verdict = if accepted && is_checked(case.evidence) {
        Verdict::Green
    } else if judgement.is_some() && probability >= LEAST_PROBABILITY_OF_YELLOW {
        Verdict::Yellow
    } else {
        Verdict::Red
    };
    let names = |wanted: &dyn Fn(&Witness) -> bool| -> Vec<String> {
        case.witnesses.iter().filter(|w| wanted(w)).map(|w| w.name.clone()).collect()
    };
    let contradicts = |w: &Witness| w.weight.is_some_and(|weight| weight.contradicts);
    Diagnosis {
        verdict,
        score,
        threshold,
        probability_correct: probability,
        features: Some(case.evidence.features),
        reasons: reasons(case, verdict, judgement, classifier.kind, threshold),
        probably_right: names(&|w| w.used && w.weight.is_some() && !contradicts(w)),
        probably_wrong: names(&|w| w.used && contradicts(w)),
    }
}

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
        probably_right: Vec::new(),
        probably_wrong: Vec::new(),
    }
}

/// Whether it may be green at all: the evidence is whole, enough control points check one another and hardly any
/// contradicts all others, and no other orientation is half as well founded. Where houses repeat, or control is of
/// another time, all else may fit perfectly, which no classifier learns from areas where that is not so.
#[must_use]
pub fn is_checked(evidence: &Evidence) -> bool {
    let contradicting = evidence.sensitivity.contradicting;
    of_evidence(evidence).iter().all(|value| value.is_finite())
        && evidence.control_points >= LEAST_CONTROL_POINTS
        && (contradicting < 2 || MOST_CONTRADICTING * contradicting < evidence.control_points)
        && evidence.log_odds > 2.0 * evidence.runner_up_log_odds
}

/// Why, the most telling reason first.
fn reasons(case: &Case, verdict: Verdict, judgement: Option<Judgement>, kind: Kind, threshold: f64) -> Vec<Reason> {
    let mut reasons = Vec::new();
    if verdict == Verdict::Green {
        reasons.push(Reason { code: "verified", detail: verified(case.evidence) });
        reasons.extend(decisive(case));
        reasons.extend(contradicting(case.witnesses));
        return reasons;
    }
    reasons.extend(judgement.and_then(|j| j.outside).map(|outside| unknown(outside, kind)));
    reasons.extend(decisive(case));
    reasons.extend(failed(case.evidence, &Thresholds::default()));
    reasons.extend(contradicting(case.witnesses));
    if judgement.is_none_or(|j| j.score <= threshold) {
        reasons.push(too_low(judgement, threshold));
    }
    reasons
}

fn too_low(judgement: Option<Judgement>, threshold: f64) -> Reason {
    let detail = match judgement {
        None => "nothing that the classifier looks at could be computed: look at the overlay before any use".to_owned(),
        Some(_) if threshold.is_infinite() => {
            "at the costs that were given, accepting never pays; with a lower cost of a \
                                               wrong acceptance some orientations would be accepted"
                .to_owned()
        }
        Some(judgement) => format!(
            "all evidence together gives a score of {:.2}, {threshold:.2} is needed: of such orientations {:.0} % \
             are within the tolerance; look at the overlay before any use, or allow a larger tolerance",
            judgement.score.max(LEAST_SCORE),
            100.0 * judgement.probability
        ),
    };
    Reason { code: "score_too_low", detail }
}

fn unknown(outside: Outside, kind: Kind) -> Reason {
    let what = match outside {
        Outside::Worse { feature } => format!("the {} is lower than in all of them", about(kind, feature)),
        Outside::Unlike { distance } => {
            format!("its features together are like none of them (squared distance {distance:.0})")
        }
        Outside::Unknown => "one of its features is not a number".to_owned(),
    };
    let detail = format!(
        "the classifier was trained on images unlike this one: {what}. It must be looked at; a classifier trained on \
         images of this kind would decide"
    );
    Reason { code: "outside_experience", detail }
}

/// Control points that carry the result alone: an error of them that nothing shows would take the ground beyond the
/// tolerance, or there is nothing that could show one.
fn decisive(case: &Case) -> Option<Reason> {
    let tolerance_m = case.evidence.tolerance_m;
    let mut alone: Vec<(&Witness, f64)> = case
        .witnesses
        .iter()
        .filter(|w| w.used || w.weight.is_some())
        .map(|w| (w, w.weight.map_or(f64::INFINITY, |weight| weight.theoretical_m)))
        .filter(|(_, theoretical_m)| *theoretical_m > tolerance_m)
        .collect();
    alone.sort_by(|a, b| b.1.total_cmp(&a.1));
    let (_, worst_m) = *alone.first()?;
    let moves = if worst_m.is_finite() {
        format!("moves the ground by up to {worst_m:.2} m, {tolerance_m:.2} m are acceptable")
    } else {
        format!("can move the ground by any distance, {tolerance_m:.2} m are acceptable")
    };
    let detail = format!(
        "the result rests on {} alone: an error there that no other control point would show {moves}; check in the \
         overlay that they are where they belong, or add control near them",
        listed(alone.iter().map(|(w, _)| w.name.as_str()))
    );
    Some(Reason { code: "control_points_decisive", detail })
}

fn contradicting(witnesses: &[Witness]) -> Option<Reason> {
    let contradicting: Vec<&Witness> =
        witnesses.iter().filter(|w| w.weight.is_some_and(|weight| weight.contradicts)).collect();
    let largest_m = contradicting.iter().filter_map(|w| w.weight).map(|w| w.change_m).fold(0.0, f64::max);
    (!contradicting.is_empty()).then(|| Reason {
        code: "control_points_contradict",
        detail: format!(
            "{} not where all others expect {}: out of date, or something beside was taken for {}; without {} the \
             ground moves by up to {largest_m:.2} m",
            listed(contradicting.iter().map(|w| w.name.as_str()))
                + if contradicting.len() == 1 { " is" } else { " are" },
            if contradicting.len() == 1 { "it" } else { "them" },
            if contradicting.len() == 1 { "it" } else { "them" },
            if contradicting.len() == 1 { "it" } else { "them" },
        ),
    })
}

/// Names for a sentence: "a, b and 3 more".
fn listed<'n>(names: impl Iterator<Item = &'n str>) -> String {
    let names: Vec<&str> = names.collect();
    let shown = names[..names.len().min(MOST_NAMES)].join(", ");
    if names.len() > MOST_NAMES { format!("{shown} and {} more", names.len() - MOST_NAMES) } else { shown }
}

#[cfg(test)]
mod tests;
