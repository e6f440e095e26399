//! Cameras as they are shown.

use chrono::{DateTime, Utc};
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use super::convert::ConversionAnswer;
use super::digital::Distortion;
use crate::geometry::Camera;
use crate::http::problem::Problem;
use crate::jobs::film_camera::FilmCameraDefinition;
use crate::store::cameras::{CameraKind, NamedCamera};

/// A camera.
#[derive(Debug, Serialize, ToSchema)]
#[serde(untagged)]
#[allow(clippy::large_enum_variant, reason = "a camera is small enough to be copied, and there are few at a time")]
pub(super) enum CameraAnswer {
    /// A digital camera.
    Digital(DigitalCameraAnswer),
    /// A film camera.
    Film(FilmCameraAnswer),
}

/// A digital camera.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct DigitalCameraAnswer {
    /// UUIDv7.
    id: Uuid,
    /// Unique.
    name: String,
    /// Columns and rows of its images.
    #[schema(min_items = 2, max_items = 2)]
    image_size_px: [u32; 2],
    /// Distance of the projection centre from the image.
    principal_distance_px: f64,
    /// Foot of the perpendicular from the projection centre.
    #[schema(min_items = 2, max_items = 2)]
    principal_point_px: [f64; 2],
    /// Lens distortion.
    distortion: Distortion,
    /// When it was first given.
    created_at: DateTime<Utc>,
    /// How well it does what its calibration says; only when it is added with `format`.
    #[serde(skip_serializing_if = "Option::is_none")]
    conversion: Option<ConversionAnswer>,
}

/// A film camera, with the defaults filled in and the marks where the distances between them have them.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct FilmCameraAnswer {
    /// UUIDv7.
    id: Uuid,
    /// Unique.
    name: String,
    #[serde(flatten)]
    definition: FilmCameraDefinition,
    /// When it was first given.
    created_at: DateTime<Utc>,
}

impl CameraAnswer {
    /// With what is left between a digital camera and the calibration that it was made from.
    pub(super) fn converted(mut self, answer: Option<ConversionAnswer>) -> Self {
        if let Self::Digital(camera) = &mut self {
            camera.conversion = answer;
        }
        self
    }

    /// # Errors
    /// 500 if a stored definition is not what this version understands.
    pub(super) fn of(named: NamedCamera) -> Result<Self, Problem> {
        let NamedCamera { id, name, kind, created_at } = named;
        match kind {
            CameraKind::Digital(camera) => Ok(Self::Digital(digital((id, name, created_at), &camera))),
            CameraKind::Film(definition) => {
                let definition = serde_json::from_str(&definition).map_err(|error| Problem::internal(&error))?;
                Ok(Self::Film(FilmCameraAnswer { id, name, definition, created_at }))
            }
        }
    }
}

fn digital((id, name, created_at): (Uuid, String, DateTime<Utc>), camera: &Camera) -> DigitalCameraAnswer {
    DigitalCameraAnswer {
        id,
        name,
        image_size_px: [camera.width_px, camera.height_px],
        principal_distance_px: camera.principal_distance_px,
        principal_point_px: camera.principal_point_px().into(),
        distortion: camera.distortion().copied().unwrap_or_default().into(),
        created_at,
        conversion: None,
    }
}
