//! An orientation as the client sees it.

use chrono::{DateTime, Utc};
use serde::Serialize;
use serde_json::value::RawValue;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::http::problem::Problem;
use crate::report::OrientationResult;
use crate::store::orientations::{DiagnosisInShort, Orientation, ReasonInShort};

/// An orientation.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct OrientationAnswer {
    /// UUIDv7.
    id: Uuid,
    /// The image's id.
    image: Uuid,
    /// What the image's file was called, if its upload has said.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = "IMG_0042.JPG")]
    image_name: Option<String>,
    /// The camera's id.
    camera: Uuid,
    /// The camera's name.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = "fc6310")]
    camera_name: Option<String>,
    /// The id of the block that it belongs to.
    #[serde(skip_serializing_if = "Option::is_none")]
    block: Option<Uuid>,
    /// `queued`, `running`, `succeeded`, `failed` or `cancelled`.
    #[schema(example = "succeeded")]
    status: &'static str,
    /// The stage that was last heard of: `predict`, `extract`, `locate`, `resect`, `adjust` or `diagnose`.
    stage: Option<String>,
    /// 0 to 1.
    progress: f64,
    /// How often it was begun.
    attempts: u32,
    /// The verdict of the result.
    #[serde(skip_serializing_if = "Option::is_none")]
    verdict: Option<String>,
    /// In short, why the verdict is what it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    diagnosis: Option<DiagnosisAnswer>,
    /// What staff have decided: `accepted` or `rejected`; left out while nobody has.
    #[serde(skip_serializing_if = "Option::is_none")]
    review: Option<String>,
    /// Why it has failed.
    error: Option<ErrorAnswer>,
    /// What came out; only of one that has succeeded, and not in lists.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<OrientationResult>)]
    result: Option<Box<RawValue>>,
    /// When it was asked for.
    created_at: DateTime<Utc>,
    /// When it was last begun.
    started_at: Option<DateTime<Utc>>,
    /// When it came to its end.
    finished_at: Option<DateTime<Utc>>,
}

/// Why an orientation has failed.
#[derive(Debug, Serialize, ToSchema)]
struct ErrorAnswer {
    /// A stable word for programs.
    #[schema(example = "image_unusable")]
    code: String,
    /// A sentence for staff.
    detail: String,
}

/// A diagnosis in short.
#[derive(Debug, Serialize, ToSchema)]
struct DiagnosisAnswer {
    /// The larger the better.
    #[serde(skip_serializing_if = "Option::is_none")]
    score: Option<f64>,
    /// Probability that the largest error on the ground is within the tolerance.
    #[serde(skip_serializing_if = "Option::is_none")]
    probability_correct: Option<f64>,
    /// The one that decided first.
    reasons: Vec<ReasonAnswer>,
}

/// Why a verdict is what it is.
#[derive(Debug, Serialize, ToSchema)]
struct ReasonAnswer {
    /// A stable word for programs.
    #[schema(example = "few_control_points")]
    code: String,
    /// A sentence for staff.
    detail: String,
}

impl From<DiagnosisInShort> for DiagnosisAnswer {
    fn from(diagnosis: DiagnosisInShort) -> Self {
        let DiagnosisInShort { score, probability_correct, reasons } = diagnosis;
        let reason = |reason: ReasonInShort| ReasonAnswer { code: reason.code, detail: reason.detail };
        Self { score, probability_correct, reasons: reasons.into_iter().map(reason).collect() }
    }
}

impl OrientationAnswer {
    pub(super) fn new(orientation: Orientation) -> Result<Self, Problem> {
        let result = orientation.result.map(RawValue::from_string).transpose();
        Ok(Self {
            id: orientation.id,
            image: orientation.image_id,
            image_name: orientation.image_name,
            camera: orientation.camera_id,
            camera_name: orientation.camera_name,
            block: orientation.block_id,
            status: orientation.status.name(),
            stage: orientation.stage,
            progress: orientation.progress,
            attempts: orientation.attempts,
            verdict: orientation.verdict,
            diagnosis: orientation.diagnosis.map(DiagnosisAnswer::from),
            review: orientation.review,
            error: orientation.error.map(|failure| ErrorAnswer { code: failure.code, detail: failure.detail }),
            result: result.map_err(|error| Problem::internal(&error))?,
            created_at: orientation.created_at,
            started_at: orientation.started_at,
            finished_at: orientation.finished_at,
        })
    }
}
