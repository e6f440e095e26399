//! An interior orientation as the client sees it.

use chrono::{DateTime, Utc};
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use crate::http::problem::Problem;
use crate::jobs::interior::PreparedInterior;
use crate::report::InteriorResult;
use crate::store::interior_orientations::InteriorOrientation;

/// An interior orientation.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct InteriorOrientationAnswer {
    /// UUIDv7.
    id: Uuid,
    /// The image's id.
    image: Uuid,
    /// The camera's id.
    camera: Uuid,
    /// What was asked for, with everything filled in.
    #[schema(value_type = PreparedInterior)]
    request: serde_json::Value,
    /// `green`, `yellow` or `red`.
    #[schema(example = "green")]
    verdict: String,
    /// What came out; not in lists.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<InteriorResult>)]
    result: Option<serde_json::Value>,
    /// When it was made.
    created_at: DateTime<Utc>,
}

impl InteriorOrientationAnswer {
    pub(super) fn new(kept: InteriorOrientation) -> Result<Self, Problem> {
        let json = |text: &str| serde_json::from_str(text).map_err(|error| Problem::internal(&error));
        Ok(Self {
            id: kept.id,
            image: kept.image_id,
            camera: kept.camera_id,
            request: json(&kept.prepared)?,
            verdict: kept.verdict,
            result: kept.result.as_deref().map(json).transpose()?,
            created_at: kept.created_at,
        })
    }
}
