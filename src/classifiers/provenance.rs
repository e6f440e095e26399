//! Where a classifier comes from.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// All that decides what a training comes to: the same sets and the same program give the same classifier.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The version of the program.
    pub program: String,
    /// The labelled sets that it was trained on.
    pub sets: Vec<LabelledSet>,
    /// Those that it was not trained on, but chosen by.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sets_not_trained_on: Vec<LabelledSet>,
    /// Images of each area.
    pub areas: BTreeMap<String, usize>,
    /// Samples that there were: trials, or images with an orientation.
    pub samples: usize,
    /// Samples that were trained on.
    pub samples_used: usize,
    /// C of a support vector machine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub c: Option<f64>,
    /// gamma of its kernel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gamma: Option<f64>,
    /// Support vectors; 1 of a weighted sum.
    pub support_vectors: usize,
    /// Parts of the cross-validation, by image.
    pub folds: usize,
    /// Of the draws.
    pub seed: u64,
    /// What decisions cost where something was chosen by it: cc, cw, wc, ww.
    pub costs: [f64; 4],
    /// How all kinds that were trained did, this one among them.
    pub compared: Vec<Comparison>,
    /// Kinds that were wanted and could not be trained.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_trained: Vec<NotTrained>,
}

/// A kind of classifier that could not be trained.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NotTrained {
    /// The kind.
    pub kind: String,
    /// Why.
    pub reason: String,
}

/// A labelled set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelledSet {
    /// Its name.
    pub name: String,
    /// Its images.
    pub images: usize,
    /// SHA-256 of its file, in hexadecimal.
    pub sha256: String,
}

/// How a kind of classifier did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    /// The kind.
    pub kind: String,
    /// Expected cost of an image in the cross-validation, at the cheapest threshold.
    pub cost_cross_validated: f64,
    /// The caution that areas not trained on deserve.
    pub caution: f64,
    /// For each area what it does there, with that caution, when it is not trained on it.
    pub areas_not_trained_on: Vec<AreaNotTrainedOn>,
}

/// An area that was not trained on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AreaNotTrainedOn {
    /// Its name.
    pub area: String,
    /// Accepted and right, accepted though wrong, rejected though right, rejected and wrong.
    pub confusion: [usize; 4],
    /// The expected cost of an image.
    pub cost: f64,
    /// That of rejecting all.
    pub cost_of_rejecting: f64,
}

impl Comparison {
    /// What decides between kinds: the mean cost on areas not trained on, else that of the cross-validation.
    #[must_use]
    pub fn deciding_cost(&self) -> f64 {
        if self.areas_not_trained_on.is_empty() {
            return self.cost_cross_validated;
        }
        let sum: f64 = self.areas_not_trained_on.iter().map(|area| area.cost).sum();
        sum / self.areas_not_trained_on.len() as f64
    }
}
