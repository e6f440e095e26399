//! Classifiers and what they are learned from, as files: labelled sets, models with their scaling and provenance, and
//! the classifier that the program brings along.

pub mod evaluation;
pub mod labelled;
pub mod plot;
pub mod provenance;
pub mod shipped;
pub mod texts;
pub mod train;

use std::collections::BTreeMap;

pub use evaluation::{CalibrationBin, CurvePoint, Evaluation, Scored};
pub use labelled::{LabelledImage, Record, Reference, TrialRow};
pub use provenance::{Comparison, LabelledSet, Provenance};
pub use shipped::shipped;
pub use texts::{ClassifierError, Description, Loaded, Texts};
pub use train::{Training, TrainingSet, trained};

use crate::diagnosis::features::of_trial_simplified;
use crate::diagnosis::features::{OF_TRIAL, OF_TRIAL_SIMPLIFIED, names_of_evidence, of_evidence, of_trial};
use crate::diagnosis::judge::is_checked;
use crate::diagnosis::{Evidence, Features};
use crate::learning::{Classifier, Kind, Sees};

/// The names of the features that a kind sees.
#[must_use]
pub fn feature_names(kind: Kind) -> Vec<&'static str> {
    match kind {
        Kind::Paper => OF_TRIAL.to_vec(),
        Kind::OneFeature => OF_TRIAL_SIMPLIFIED.to_vec(),
        Kind::EvidenceSvm | Kind::EvidenceLogistic => names_of_evidence(),
    }
}

/// The evidence of named numbers.
///
/// # Errors
/// The name of one that is missing or not finite.
pub fn evidence_of(numbers: &BTreeMap<String, f64>) -> Result<Evidence, &'static str> {
    Evidence::from_numbers(|name| numbers.get(name).copied())
}

/// What a kind of classifier sees of a labelled image, with whether it is right: the trials, or the evidence.
#[must_use]
pub fn samples_of(image: &LabelledImage, kind: Kind) -> Vec<(Vec<f64>, bool)> {
    if kind.sees() == Sees::Evidence {
        let evidence = train::evidence(image).map(|evidence| of_evidence(&evidence));
        let usable = evidence.filter(|features| features.iter().all(|value| value.is_finite()));
        return usable.map(|features| (features, image.right())).into_iter().collect();
    }
    let of_one = if kind == Kind::Paper { of_trial } else { of_trial_simplified };
    let sample = |TrialRow(points, eliminated, log_sigma0, log_configuration, d_max_m): &TrialRow| {
        let features = Features {
            control_points: *points as usize,
            eliminated: *eliminated as usize,
            log_sigma0: *log_sigma0,
            log_configuration: *log_configuration,
        };
        (of_one(&features), *d_max_m <= image.tolerance_m)
    };
    image.trials.iter().map(sample).collect()
}

/// What a classifier says of a labelled image; what is never green, whatever it says, has the lowest score.
#[must_use]
pub fn scored(classifier: &Classifier, image: &LabelledImage) -> Scored {
    let samples: Vec<Vec<f64>> = samples_of(image, classifier.kind).into_iter().map(|(features, _)| features).collect();
    let right = image.right();
    match classifier.judge(&samples) {
        None => Scored { score: f64::NEG_INFINITY, probability: 0.0, right },
        Some(judgement) => {
            let checked = train::evidence(image).is_none_or(|evidence| is_checked(&evidence));
            let known = judgement.outside.is_none();
            let score = if known && checked { judgement.score } else { f64::NEG_INFINITY };
            Scored { score, probability: judgement.probability, right }
        }
    }
}
