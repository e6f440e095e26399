//! How far recent orientations have drifted from what the active classifier was trained on.

use std::collections::BTreeMap;

use super::Inner;
use crate::classifiers::labelled::TrialRecord;
use crate::classifiers::{LabelledImage, Loaded, Record, TrialRow, samples_of};
use crate::learning::drift::Distribution;
use crate::store::{Store, StoreError};

/// Orientations that are looked at.
const RECENT: u32 = 1000;

/// The population stability index of each feature over the latest orientations; empty where there are too few.
///
/// # Errors
/// [`StoreError`].
pub async fn measured(store: &Store, loaded: &Loaded) -> Result<Vec<(String, f64)>, StoreError> {
    let records = store.latest_records(RECENT).await?;
    let classifier = &loaded.classifier;
    let deciding = records.iter().filter_map(|record| {
        let samples = samples_of(&unlabelled(serde_json::from_str(record).ok()?), classifier.kind);
        let scored = samples.into_iter().map(|(features, _)| (classifier.decision(&features), features));
        scored.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, features)| features)
    });
    let deciding: Vec<Vec<f64>> = deciding.collect();
    let of_feature = |(k, name): (usize, &String)| {
        let before: Distribution = loaded.description.distributions.get(k)?.as_ref()?.into();
        let recent: Vec<f64> = deciding.iter().map(|features| features[k]).collect();
        Some((name.clone(), before.index(&recent)?))
    };
    Ok(classifier.features.iter().enumerate().filter_map(of_feature).collect())
}

/// A record as a labelled image of which nothing is known.
fn unlabelled(record: Record) -> LabelledImage {
    let trial = |TrialRecord(points, eliminated, log_sigma0, log_configuration, _): &TrialRecord| {
        TrialRow(*points, *eliminated, *log_sigma0, *log_configuration, f64::INFINITY)
    };
    LabelledImage {
        image: String::new(),
        area: String::new(),
        evidence: record.evidence,
        tolerance_m: 0.0,
        d_max_m: None,
        trials: record.trials.iter().map(trial).collect(),
    }
}

impl Inner {
    /// Shows the drift in the metrics.
    pub(super) async fn gauge_drift(&self) {
        let measured = match self.active.get(&self.store).await {
            Ok(named) => measured(&self.store, &named.loaded).await,
            Err(error) => {
                tracing::warn!(%error, "the drift cannot be measured");
                return;
            }
        };
        match measured {
            Ok(indices) => {
                let indices: BTreeMap<String, f64> = indices.into_iter().collect();
                metrics::gauge!("gable_drift_max").set(indices.values().copied().fold(0.0, f64::max));
                for (feature, index) in indices {
                    metrics::gauge!("gable_drift", "feature" => feature).set(index);
                }
            }
            Err(error) => tracing::warn!(%error, "the drift cannot be measured"),
        }
    }
}
