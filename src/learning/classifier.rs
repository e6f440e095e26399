//! A trained classifier: from features to a score and a probability.

use super::calibration::Calibration;
use super::domain::{Domain, Outside};
use super::scaling::Scaling;
use super::svm::Machine;

/// What a classifier is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The paper's: a support vector machine with RBF kernel on N, E, log sigma0 and log lambda_max of each trial.
    Paper,
    /// The paper's simplified one: log(sigma0² lambda_max) of each trial (4.2).
    OneFeature,
    /// A support vector machine with RBF kernel on the evidence of the image.
    EvidenceSvm,
    /// A logistic regression on the evidence of the image.
    EvidenceLogistic,
}

/// What a classifier looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sees {
    /// Every orientation with points that the search has examined; an image is as good as its best trial.
    Trials,
    /// The evidence for the orientation that was found.
    Evidence,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Paper, Self::OneFeature, Self::EvidenceSvm, Self::EvidenceLogistic];

    /// Its name in files and answers.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::OneFeature => "one_feature",
            Self::EvidenceSvm => "evidence_svm",
            Self::EvidenceLogistic => "evidence_logistic",
        }
    }

    /// The kind of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// What it looks at.
    #[must_use]
    pub fn sees(self) -> Sees {
        match self {
            Self::Paper | Self::OneFeature => Sees::Trials,
            Self::EvidenceSvm | Self::EvidenceLogistic => Sees::Evidence,
        }
    }
}

/// A trained classifier.
#[derive(Debug, Clone, PartialEq)]
pub struct Classifier {
    /// What it is.
    pub kind: Kind,
    /// The names of the features, in the order of the model.
    pub features: Vec<String>,
    /// Brings them to the range of the model.
    pub scaling: Scaling,
    /// The decision function.
    pub machine: Machine,
    /// From scores to probabilities.
    pub calibration: Calibration,
    /// Where the training was.
    pub domain: Domain,
    /// By so many times the odds of being wrong may be larger in an area that was not trained on.
    pub caution: f64,
}

/// What a classifier says of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgement {
    /// The decision value; of several samples the largest.
    pub score: f64,
    /// The probability of being right.
    pub probability: f64,
    /// How the sample with that score lies outside what the classifier has seen.
    pub outside: Option<Outside>,
}

impl Classifier {
    /// Judges the samples of an image: its trials, or its evidence. `None` if there is none with finite features.
    #[must_use]
    pub fn judge(&self, samples: &[Vec<f64>]) -> Option<Judgement> {
        let usable = samples.iter().filter(|sample| sample.iter().all(|value| value.is_finite()));
        let scored = usable.map(|sample| (self.decision(sample), sample));
        let (score, best) = scored.filter(|(score, _)| score.is_finite()).max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Judgement { score, probability: self.calibration.probability(score), outside: self.domain.outside(best) })
    }

    /// The decision value of one sample.
    #[must_use]
    pub fn decision(&self, features: &[f64]) -> f64 {
        self.machine.decision(&self.scaling.scaled(&self.domain.clamped(features)))
    }

    /// Whether scaling, model and domain are of as many features as there are names.
    #[must_use]
    pub fn is_consistent(&self) -> bool {
        let count = self.features.len();
        let Domain { least, most, mean, covariance, farthest } = &self.domain;
        let finite = least.iter().chain(most).chain(mean).chain(covariance).all(|value| value.is_finite());
        self.scaling.features() == count
            && self.machine.features() <= count
            && [least.len(), most.len(), mean.len()] == [count; 3]
            && covariance.len() == count * (count + 1) / 2
            && finite
            && self.caution >= 1.0
            && self.caution.is_finite()
            && !farthest.is_nan()
    }
}
