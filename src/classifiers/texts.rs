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

/// Why there is no classifier: nothing could be learned, or its texts are damaged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ClassifierError {
    /// The training.
    #[error("no classifier of the kind {kind} can be trained: {source}")]
    Training {
        /// The kind that failed.
        kind: &'static str,
        /// Why.
        source: SvmError,
    },
    /// No kind of classifier was asked for.
    #[error("no kind of classifier was asked for")]
    NoKind,
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
    /// From scores to probabilities: the mean score of a pool of images, their probability, and how many they are.
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
        let steps = description.calibration.iter().map(|(score, probability, images)| Step {
            score: *score,
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
            return Err(inconsistent(
                "model, ranges and description do not belong together, or a number of them is out of range",
            ));
        }
        let sha256 = self.sha256();
        Ok(Loaded { classifier: Arc::new(classifier), description: Arc::new(description), sha256 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classifiers::train::tests::quickly_trained;

    /// The texts with something else in the description.
    fn described(texts: &Texts, change: impl FnOnce(&mut serde_json::Value)) -> Texts {
        let mut description = serde_json::from_str(&texts.description).unwrap();
        change(&mut description);
        Texts { description: description.to_string(), ..texts.clone() }
    }

    #[test]
    fn the_texts_of_what_was_read_are_the_same() {
        for kind in [Kind::Paper, Kind::EvidenceLogistic] {
            let texts = quickly_trained(kind);
            let loaded = texts.load().unwrap();
            assert_eq!(loaded.classifier.kind, kind);
            assert_eq!(Texts::of(&loaded.classifier, &loaded.description).unwrap(), texts);
        }
    }

    #[test]
    fn the_hash_changes_with_each_of_the_texts() {
        let texts = quickly_trained(Kind::OneFeature);
        let longer = |text: &String| text.clone() + "\n";
        let others = [
            Texts { model: longer(&texts.model), ..texts.clone() },
            Texts { scaling: longer(&texts.scaling), ..texts.clone() },
            Texts { description: longer(&texts.description), ..texts.clone() },
            // the same bytes in a row
            Texts { model: texts.model.clone() + "x", scaling: texts.scaling[1..].to_owned(), ..texts.clone() },
        ];
        let mut hashes: Vec<[u8; 32]> = others.iter().chain([&texts]).map(Texts::sha256).collect();
        hashes.sort_unstable();
        hashes.dedup();
        assert_eq!(hashes.len(), 5);
        let loaded = texts.load().unwrap();
        assert_eq!(loaded.sha256, texts.sha256());
        let bytes: Vec<u8> =
            (0..32).map(|k| u8::from_str_radix(&loaded.hash()[2 * k..2 * k + 2], 16).unwrap()).collect();
        assert_eq!((bytes, loaded.hash().len()), (texts.sha256().to_vec(), 64));
    }

    #[test]
    fn damaged_texts_are_refused_by_the_name_of_their_file() {
        let texts = quickly_trained(Kind::EvidenceLogistic);
        let other = quickly_trained(Kind::OneFeature);
        let refused = |texts: &Texts, file: &str| {
            let error = texts.load().unwrap_err().to_string();
            assert!(error.starts_with(file), "{error} instead of {file}");
        };
        let half = |text: &str| text[..text.len() / 2].to_owned();
        refused(&Texts { model: half(&texts.model), ..texts.clone() }, "model.svm");
        refused(&Texts { scaling: texts.scaling.replacen("-1 1", "0 1", 1), ..texts.clone() }, "scaling.range");
        refused(&Texts { description: half(&texts.description), ..texts.clone() }, "classifier.json");
        refused(&Texts { scaling: other.scaling.clone(), ..texts.clone() }, "classifier.json");
        refused(&Texts { model: texts.model.clone(), ..other.clone() }, "classifier.json");
        type Damage = fn(&mut serde_json::Value);
        let damages: [(&str, Damage); 11] = [
            ("unknown kind", |d| d["kind"] = "oracle".into()),
            ("another kind", |d| d["kind"] = "paper".into()),
            ("unknown field", |d| d["colour"] = "red".into()),
            ("swapped features", |d| d["features"].as_array_mut().unwrap().swap(0, 1)),
            ("falling calibration", |d| d["calibration"].as_array_mut().unwrap().reverse()),
            ("no calibration", |d| d["calibration"] = serde_json::json!([])),
            ("certain calibration", |d| d["calibration"][0][1] = 1.0.into()),
            ("small domain", |d| drop(d["domain"]["least"].as_array_mut().unwrap().pop())),
            ("no covariance", |d| drop(d["domain"]["covariance"].as_array_mut().unwrap().pop())),
            ("few distributions", |d| drop(d["distributions"].as_array_mut().unwrap().pop())),
            ("no caution", |d| d["caution"] = 0.5.into()),
        ];
        for (name, damage) in damages {
            let damaged = described(&texts, damage);
            assert!(damaged.load().is_err_and(|error| error.to_string().starts_with("classifier.json")), "{name}");
        }
        assert!(described(&texts, |_| ()).load().is_ok());
    }
}
