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

/// More caution than this accepts nothing.
pub const LARGEST_CAUTION: f64 = 1e6;

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

    /// Whether scaling, model and domain are of as many features as there are names, and the model of its kind.
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
            && (1.0..=LARGEST_CAUTION).contains(&self.caution)
            && *farthest > 0.0
            && self.machine.is_linear() == matches!(self.kind, Kind::OneFeature | Kind::EvidenceLogistic)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn classifier() -> Classifier {
        let samples: Vec<Vec<f64>> = (0..40).map(|k| vec![f64::from(k) / 20.0 - 1.0, f64::from(k % 7) / 3.0]).collect();
        let features: Vec<&[f64]> = samples.iter().map(Vec::as_slice).collect();
        Classifier {
            kind: Kind::EvidenceLogistic,
            features: vec!["a".to_owned(), "b".to_owned()],
            scaling: Scaling::of(&features).unwrap(),
            machine: Machine::linear(&[2.0, 0.0], 0.0).unwrap(),
            calibration: Calibration::of(&[(-1.0, false), (0.0, false), (0.5, true), (1.0, true)]).unwrap(),
            domain: Domain::of(&features).unwrap(),
            caution: 1.0,
        }
    }

    #[test]
    fn an_image_is_as_good_as_its_best_sample() {
        let classifier = classifier();
        let alone = |a: f64| classifier.judge(&[vec![a, 1.0]]).unwrap();
        let together = classifier.judge(&[vec![-0.5, 1.0], vec![0.4, 1.0], vec![0.1, 1.0]]).unwrap();
        assert_eq!(together, alone(0.4));
        assert!(alone(0.4).score > alone(0.1).score);
        assert!(alone(0.9).probability > alone(-0.9).probability);
        assert!(together.outside.is_none() && alone(-3.0).outside.is_some());
    }

    #[test]
    fn what_is_not_a_number_is_not_judged() {
        let classifier = classifier();
        assert_eq!(classifier.judge(&[]), None);
        assert_eq!(classifier.judge(&[vec![f64::NAN, 0.0], vec![0.0, f64::INFINITY]]), None);
        let beside = classifier.judge(&[vec![f64::NAN, 0.0], vec![0.2, 1.0]]);
        assert_eq!(beside, classifier.judge(&[vec![0.2, 1.0]]));
    }

    #[test]
    fn parts_of_different_sizes_do_not_belong_together() {
        let sound = classifier();
        assert!(sound.is_consistent());
        assert!(!Classifier { features: vec!["a".to_owned()], ..sound.clone() }.is_consistent());
        assert!(!Classifier { caution: 0.5, ..sound.clone() }.is_consistent());
        let larger = Machine::linear(&[1.0, 1.0, 1.0], 0.0).unwrap();
        assert!(!Classifier { machine: larger, ..sound }.is_consistent());
    }

    #[test]
    fn every_kind_has_a_name_of_its_own() {
        for kind in Kind::ALL {
            assert_eq!(Kind::from_name(kind.name()), Some(kind));
        }
        assert_eq!(Kind::from_name("oracle"), None);
    }
}
