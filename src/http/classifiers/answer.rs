//! A classifier as the client sees it.

use chrono::{DateTime, Utc};
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use super::{active_id, usable};
use crate::classifiers::{Evaluation, Loaded, Provenance};
use crate::diagnosis::judge::threshold;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::active::{NamedClassifier, SHIPPED, shipped_classifier};
use crate::jobs::drift;
use crate::store::classifiers::{ClassifierStatus, StoredClassifier};

/// A classifier in a list.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ClassifierAnswer {
    /// UUIDv7, or `shipped` for the one that Gable brings along.
    id: String,
    /// Its unique name.
    name: String,
    /// `queued`, `training`, `ready` or `failed`.
    #[schema(example = "ready")]
    status: &'static str,
    /// How far its training is, 0 to 1.
    progress: f64,
    /// Whether it decides at present.
    active: bool,
    /// SHA-256 of its model, scaling and description, as results name it.
    #[serde(skip_serializing_if = "Option::is_none")]
    sha256: Option<String>,
    /// Why it could not be trained.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
    /// When it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    created_at: Option<DateTime<Utc>>,
    /// When its training ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    finished_at: Option<DateTime<Utc>>,
}

/// A classifier with all that is known of it.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ClassifierDetail {
    #[serde(flatten)]
    classifier: ClassifierAnswer,
    /// What it was trained to be, once it is: `paper`, `one_feature`, `evidence_svm` or `evidence_logistic`.
    #[serde(skip_serializing_if = "Option::is_none")]
    kind: Option<String>,
    /// What it looks at.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    features: Vec<String>,
    /// By so many times the odds of being wrong may be larger in an area that it was not trained on.
    #[serde(skip_serializing_if = "Option::is_none")]
    caution: Option<f64>,
    /// T_d at the costs and the caution of this service; left out where accepting never pays.
    #[serde(skip_serializing_if = "Option::is_none")]
    threshold: Option<f64>,
    /// The decisions at that threshold on images that it was not trained on.
    #[serde(skip_serializing_if = "Option::is_none")]
    decisions: Option<Decisions>,
    /// Cross-validation by image: confusion tables over T_d, calibration.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<serde_json::Value>)]
    evaluation: Option<Evaluation>,
    /// What it was trained on, and how all kinds that were trained compare.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<serde_json::Value>)]
    provenance: Option<Provenance>,
    /// How far recent orientations have drifted from the training, feature by feature; only where there are enough.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    drift: Vec<FeatureDrift>,
    /// Its files under its own address.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schema(value_type = Vec<String>)]
    files: Vec<&'static str>,
}

/// Decisions against reality.
#[derive(Debug, Serialize, ToSchema)]
struct Decisions {
    /// Accepted and right.
    cc: usize,
    /// Accepted though wrong.
    cw: usize,
    /// Rejected though right.
    wc: usize,
    /// Rejected and wrong.
    ww: usize,
    /// The expected cost of an image.
    expected_cost: f64,
    /// That of rejecting all.
    cost_of_rejecting: f64,
}

/// The drift of a feature.
#[derive(Debug, Serialize, ToSchema)]
struct FeatureDrift {
    /// The feature.
    feature: String,
    /// The population stability index: below 0.1 nothing has changed, above 0.25 a classifier should be trained anew.
    index: f64,
    /// Whether it is above that.
    drifted: bool,
}

/// The classifier that decides.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ActiveAnswer {
    /// UUIDv7, or `shipped`.
    id: String,
    /// Its name.
    name: String,
    /// As results name it.
    sha256: String,
}

impl ActiveAnswer {
    pub(super) fn of(id: Option<Uuid>, name: String, loaded: &Loaded) -> Self {
        Self { id: id.map_or_else(|| SHIPPED.to_owned(), |id| id.to_string()), name, sha256: loaded.hash() }
    }
}

impl ClassifierAnswer {
    pub(super) fn of_stored(stored: &StoredClassifier, active: Option<Uuid>) -> Self {
        let hash = |bytes: &Vec<u8>| bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Self {
            id: stored.id.to_string(),
            name: stored.name.clone(),
            status: stored.status.name(),
            progress: stored.progress,
            active: active == Some(stored.id),
            sha256: stored.sha256.as_ref().map(hash),
            error: stored.error.clone(),
            created_at: Some(stored.created_at),
            finished_at: stored.finished_at,
        }
    }

    pub(super) fn of_shipped(shipped: &NamedClassifier, active: bool) -> Self {
        Self {
            id: SHIPPED.to_owned(),
            name: SHIPPED.to_owned(),
            status: ClassifierStatus::Ready.name(),
            progress: 1.0,
            active,
            sha256: Some(shipped.loaded.hash()),
            error: None,
            created_at: None,
            finished_at: None,
        }
    }
}

impl ClassifierDetail {
    pub(super) async fn of_stored(state: &AppState, stored: &StoredClassifier) -> Result<Self, Problem> {
        let active = active_id(state).await?;
        let answer = ClassifierAnswer::of_stored(stored, active);
        Self::with(state, answer, usable(Some(stored))?).await
    }

    pub(super) async fn of_shipped(state: &AppState) -> Result<Self, Problem> {
        let active = active_id(state).await?.is_none();
        let shipped = shipped_classifier()?;
        Self::with(state, ClassifierAnswer::of_shipped(&shipped, active), Some(shipped.loaded)).await
    }

    async fn with(state: &AppState, classifier: ClassifierAnswer, loaded: Option<Loaded>) -> Result<Self, Problem> {
        let mut detail = Self {
            classifier,
            kind: None,
            features: Vec::new(),
            caution: None,
            threshold: None,
            decisions: None,
            evaluation: None,
            provenance: None,
            drift: Vec::new(),
            files: Vec::new(),
        };
        let Some(loaded) = loaded else { return Ok(detail) };
        if detail.classifier.active {
            let measured = drift::measured(&state.store, &loaded).await?;
            let of_feature = |(feature, index): (String, f64)| FeatureDrift {
                feature,
                index,
                drifted: index > crate::learning::drift::DRIFTED,
            };
            detail.drift = measured.into_iter().map(of_feature).collect();
        }
        let policy = state.configuration.policy();
        let decides = threshold(&loaded.classifier, &policy);
        let description = loaded.description.as_ref().clone();
        let confusion = description.evaluation.confusion(decides);
        let right_share = description.evaluation.right as f64 / description.evaluation.images.max(1) as f64;
        detail.decisions = Some(Decisions {
            cc: confusion.cc,
            cw: confusion.cw,
            wc: confusion.wc,
            ww: confusion.ww,
            expected_cost: confusion.expected_cost(&policy.costs),
            cost_of_rejecting: policy.costs.of_rejecting(right_share),
        });
        Ok(Self {
            kind: Some(description.kind),
            features: description.features,
            caution: Some(loaded.classifier.caution),
            threshold: Some(decides).filter(|threshold| threshold.is_finite()),
            evaluation: Some(description.evaluation),
            provenance: Some(description.provenance),
            files: super::files::NAMES.to_vec(),
            ..detail
        })
    }
}
