//! An orientation as the client sees it.

use chrono::{DateTime, Utc};
use serde::Serialize;
use serde_json::value::RawValue;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::http::problem::Problem;
use crate::report::OrientationResult;
use crate::store::orientations::Orientation;

/// An orientation.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct OrientationAnswer {
    /// UUIDv7.
    id: Uuid,
    /// The image's id.
    image: Uuid,
    /// The camera's id.
    camera: Uuid,
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

impl OrientationAnswer {
    pub(super) fn new(orientation: Orientation) -> Result<Self, Problem> {
        let result = orientation.result.map(RawValue::from_string).transpose();
        Ok(Self {
            id: orientation.id,
            image: orientation.image_id,
            camera: orientation.camera_id,
            status: orientation.status.name(),
            stage: orientation.stage,
            progress: orientation.progress,
            attempts: orientation.attempts,
            verdict: orientation.verdict,
            error: orientation.error.map(|failure| ErrorAnswer { code: failure.code, detail: failure.detail }),
            result: result.map_err(|error| Problem::internal(&error))?,
            created_at: orientation.created_at,
            started_at: orientation.started_at,
            finished_at: orientation.finished_at,
        })
    }
}
