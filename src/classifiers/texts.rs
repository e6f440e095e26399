//! A classifier as three texts: LIBSVM's model file, svm-scale's file of ranges, and a description that has the rest.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};

use crate::learning::drift::Distribution;
use crate::learning::scaling::ScalingError;
use crate::learning::svm::SvmError;
use crate::learning::{Calibration, Classifier, Domain, Kind, Machine, Scaling, Step};

/// The names of the three files in a folder.
pub const FILES: [&str; 3] = ["model.svm", "scaling.range", "classifier.json"];

/// The three texts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Texts {
    /// LIBSVM's model file.
    pub model: String,
    /// svm-scale's file of ranges.
    pub scaling: String,
    /// JSON of a [`Description`].
    pub description: String,
}

/// Texts that are no classifier.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClassifierError {
    /// The model file.
    #[error("model.svm: {0}")]
    Model(#[from] SvmError),
    /// The file of ranges.
    #[error("scaling.range: {0}")]
    Scaling(#[from] ScalingError),
    /// The description.
    #[error("classifier.json: {0}")]
    Description(#[from] serde_json::Error),
    /// The three do not belong together.
    #[error("classifier.json: {detail}")]
    Inconsistent {
        /// What does not fit.
        detail: String,
    },
}

/// What is known of a classifier beside its decision function.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// `paper`, `one_feature`, `evidence_svm` or `evidence_logistic`.
    pub kind: String,
    /// The features in the order of the model.
    pub features: Vec<String>,
    /// From scores to probabilities: from a score on, the probability, and the images that it was taken from.
    pub calibration: Vec<(f64, f64, usize)>,
    /// By so many times the odds of being wrong may be larger in an area that was not trained on.
    pub caution: f64,
    /// Where the training was.
    pub domain: DomainText,
    /// For each feature its distribution over the training images, to measure drift against.
    pub distributions: Vec<Option<DistributionText>>,
    /// How it does on images that it was not trained on.
    pub evaluation: super::Evaluation,
    /// Where it comes from.
    pub provenance: super::Provenance,
}

/// A [`Domain`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DomainText {
    least: Vec<f64>,
    most: Vec<f64>,
    mean: Vec<f64>,
    covariance: Vec<f64>,
    farthest: f64,
}

/// A [`Distribution`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DistributionText {
    edges: Vec<f64>,
    shares: Vec<f64>,
}

impl From<&Domain> for DomainText {
    fn from(domain: &Domain) -> Self {
        let Domain { least, most, mean, covariance, farthest } = domain.clone();
        Self { least, most, mean, covariance, farthest }
    }
}

impl From<&Distribution> for DistributionText {
    fn from(distribution: &Distribution) -> Self {
        Self { edges: distribution.edges.clone(), shares: distribution.shares.clone() }
    }
}

impl From<&DistributionText> for Distribution {
    fn from(text: &DistributionText) -> Self {
        Self { edges: text.edges.clone(), shares: text.shares.clone() }
    }
}

/// A classifier that can be used, with all that is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// The classifier.
    pub classifier: Arc<Classifier>,
    /// The rest.
    pub description: Arc<Description>,
    /// SHA-256 of its texts: its name in results.
    pub sha256: [u8; 32],
}

impl Loaded {
    /// The hash in hexadecimal.
    #[must_use]
    pub fn hash(&self) -> String {
        self.sha256.iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

impl Texts {
    /// Of a classifier and its description.
    ///
    /// # Errors
    /// [`ClassifierError::Description`] if a number of it is not finite.
    pub fn of(classifier: &Classifier, description: &Description) -> Result<Self, ClassifierError> {
        Ok(Self {
            model: classifier.machine.to_text(),
            scaling: classifier.scaling.to_text(),
            description: serde_json::to_string_pretty(description)? + "\n",
        })
    }

    /// SHA-256 of the three, in the order of [`FILES`], a zero byte after each.
    #[must_use]
    pub fn sha256(&self) -> [u8; 32] {
        let mut hash = Sha256::new();
        for text in [&self.model, &self.scaling, &self.description] {
            hash.update(text);
            hash.update([0]);
        }
        hash.finalize().into()
    }

    /// Reads the three.
    ///
    /// # Errors
    /// [`ClassifierError`] says which of them is damaged.
    pub fn load(&self) -> Result<Loaded, ClassifierError> {
        let inconsistent = |detail: &str| ClassifierError::Inconsistent { detail: detail.to_owned() };
        let description: Description = serde_json::from_str(&self.description)?;
        let DomainText { least, most, mean, covariance, farthest } = description.domain.clone();
        let steps = description.calibration.iter().map(|(from, probability, images)| Step {
            from: *from,
            probability: *probability,
            images: *images,
        });
        let classifier = Classifier {
            kind: Kind::from_name(&description.kind).ok_or_else(|| inconsistent("its kind is not known"))?,
            features: description.features.clone(),
            scaling: Scaling::from_text(&self.scaling)?,
            machine: Machine::from_text(&self.model)?,
            calibration: Calibration::of_steps(steps.collect())
                .ok_or_else(|| inconsistent("its calibration does not rise from 0 to 1"))?,
            domain: Domain { least, most, mean, covariance, farthest },
            caution: description.caution,
        };
        if classifier.features != super::feature_names(classifier.kind) {
            return Err(inconsistent("its features are not those of its kind in this version"));
        }
        if !classifier.is_consistent() || description.distributions.len() != classifier.features.len() {
            return Err(inconsistent("model, ranges and description are of different features"));
        }
        let sha256 = self.sha256();
        Ok(Loaded { classifier: Arc::new(classifier), description: Arc::new(description), sha256 })
    }
}
