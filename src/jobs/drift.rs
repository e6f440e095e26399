//! How far recent orientations have drifted from what the active classifier was trained on.

use std::collections::BTreeMap;

use super::Inner;
use crate::classifiers::labelled::TrialRecord;
use crate::classifiers::{LabelledImage, Loaded, Record, TrialRow, feature_names, samples_of};
use crate::learning::Kind;
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
                // not a number: not measured; features of another classifier do not keep their last value
                metrics::gauge!("gable_drift_max")
                    .set(indices.iter().map(|(_, index)| *index).fold(f64::NAN, f64::max));
                let mut of_feature: BTreeMap<String, f64> =
                    Kind::ALL.into_iter().flat_map(feature_names).map(|name| (name.to_owned(), f64::NAN)).collect();
                of_feature.extend(indices);
                for (feature, index) in of_feature {
                    metrics::gauge!("gable_drift", "feature" => feature).set(index);
                }
            }
            Err(error) => tracing::warn!(%error, "the drift cannot be measured"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classifiers::labelled::Pose;
    use crate::classifiers::labelled::tests::simulated;
    use crate::classifiers::train::tests::quickly_trained;
    use crate::jobs::training::tests::Bench;
    use crate::learning::drift::DRIFTED;

    /// Records of images like those of the training, with a larger sigma0 of all trials.
    fn records(seed: u64, count: usize, larger: f64) -> Vec<String> {
        let record = |image: LabelledImage| {
            let trial = |TrialRow(points, eliminated, log_sigma0, log_configuration, _): &TrialRow| {
                TrialRecord(*points, *eliminated, log_sigma0 + larger, *log_configuration, Pose([0.0; 6]))
            };
            let trials = image.trials.iter().map(trial).collect();
            let record = Record { evidence: image.evidence, estimate: None, ground_height_m: None, trials };
            serde_json::to_string(&record).unwrap()
        };
        simulated("north", seed, count).into_iter().map(record).collect()
    }

    async fn largest(bench: &Bench, loaded: &Loaded) -> Option<f64> {
        let measured = measured(&bench.store, loaded).await.unwrap();
        measured.into_iter().map(|(_, index)| index).reduce(f64::max)
    }

    #[tokio::test]
    async fn images_like_those_of_the_training_have_not_drifted_and_others_have() {
        let loaded = quickly_trained(Kind::OneFeature).load().unwrap();
        for (larger, drifted) in [(0.0, false), (0.5, true)] {
            let bench = Bench::new().await;
            bench.keep(&records(11, 500, larger)).await;
            let index = largest(&bench, &loaded).await.unwrap();
            assert_eq!(index > DRIFTED, drifted, "{index}");
        }
    }

    #[tokio::test]
    async fn only_the_latest_orientations_count() {
        let loaded = quickly_trained(Kind::OneFeature).load().unwrap();
        let bench = Bench::new().await;
        bench.keep(&records(11, 1000, 1.0)).await;
        assert!(largest(&bench, &loaded).await.unwrap() > DRIFTED);
        bench.keep(&records(12, RECENT as usize, 0.0)).await;
        assert!(largest(&bench, &loaded).await.unwrap() < DRIFTED);
    }

    #[tokio::test]
    async fn the_features_are_those_of_the_classifier_and_need_enough_readable_records() {
        let bench = Bench::new().await;
        let loaded = quickly_trained(Kind::EvidenceLogistic).load().unwrap();
        // every tenth has no evidence
        bench.keep(&records(11, 110, 0.0)).await;
        bench.keep(&vec!["{}".to_owned(); 20]).await;
        assert_eq!(measured(&bench.store, &loaded).await.unwrap(), []);
        bench.keep(&records(12, 2, 0.0)).await;
        let names: Vec<String> =
            measured(&bench.store, &loaded).await.unwrap().into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, loaded.classifier.features);
    }
}
