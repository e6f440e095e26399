//! Digital cameras.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::geometry::{Brown, Camera, CameraError};
use crate::http::problem::Problem;

/// A digital camera with its interior orientation.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DigitalCameraRequest {
    /// Unique; 1 to 200 characters. Images can be oriented with the camera by this name.
    #[schema(example = "canon-sx260", min_length = 1, max_length = 200)]
    pub(super) name: String,
    /// Columns and rows of its images.
    #[schema(example = json!([4000, 3000]), min_items = 2, max_items = 2)]
    image_size_px: [u32; 2],
    /// Distance of the projection centre from the image.
    #[schema(example = 2890.0, value_type = f64, exclusive_minimum = 0.0)]
    principal_distance_px: Option<f64>,
    /// Foot of the perpendicular from the projection centre, x to the right and y down from the corner of the top-left
    /// pixel.
    #[schema(example = json!([2000.0, 1500.0]), value_type = Vec<f64>, min_items = 2, max_items = 2)]
    principal_point_px: Option<[f64; 2]>,
    /// Lens distortion; left out, there is none.
    distortion: Option<Distortion>,
}

/// A model of lens distortion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(super) enum DistortionModel {
    /// Brown's radial and tangential polynomials with affine terms.
    Brown,
}

/// Brown's distortion: with ideal x = X/Z, y = Y/Z (x right, y down, z forward) and r² = x² + y²,
/// x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²),
/// y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y,
/// u = u_0 + c x_d + b1 x_d + b2 y_d, v = v_0 + c y_d.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Distortion {
    /// The model that the coefficients belong to.
    model: DistortionModel,
    /// Radial coefficient of r².
    #[serde(default)]
    k1: f64,
    /// Radial coefficient of r⁴.
    #[serde(default)]
    k2: f64,
    /// Radial coefficient of r⁶.
    #[serde(default)]
    k3: f64,
    /// Tangential coefficient that goes with 2xy in x.
    #[serde(default)]
    p1: f64,
    /// Tangential coefficient that goes with r² + 2x² in x.
    #[serde(default)]
    p2: f64,
    /// Difference of the principal distances in x and y.
    #[serde(default)]
    b1_px: f64,
    /// Shear.
    #[serde(default)]
    b2_px: f64,
}

impl From<Brown> for Distortion {
    fn from(Brown { k1, k2, k3, p1, p2, b1_px, b2_px }: Brown) -> Self {
        Self { model: DistortionModel::Brown, k1, k2, k3, p1, p2, b1_px, b2_px }
    }
}

impl DigitalCameraRequest {
    /// The camera, after checking that it makes sense.
    ///
    /// # Errors
    /// 422 with the pointer of the field that is at fault.
    pub fn camera(&self) -> Result<Camera, Problem> {
        let missing = |name: &str| Problem::invalid_field(format!("/{name}"), format!("{name} is missing"));
        let principal_distance_px = self.principal_distance_px.ok_or_else(|| missing("principal_distance_px"))?;
        let principal_point_px = self.principal_point_px.ok_or_else(|| missing("principal_point_px"))?;
        let distortion = self.distortion.map_or_else(Brown::default, |given| {
            let Distortion { model: DistortionModel::Brown, k1, k2, k3, p1, p2, b1_px, b2_px } = given;
            Brown { k1, k2, k3, p1, p2, b1_px, b2_px }
        });
        Camera::new(self.image_size_px, principal_distance_px, Vector2::from(principal_point_px), distortion)
            .map_err(|error| Problem::invalid_field(pointer(&error), error.to_string()))
    }
}

fn pointer(error: &CameraError) -> String {
    match error {
        CameraError::EmptyFrame { .. } => String::from("/image_size_px"),
        CameraError::PrincipalDistance { .. } => String::from("/principal_distance_px"),
        CameraError::NotFinite { name: "principal_point_px" } => String::from("/principal_point_px"),
        CameraError::NotFinite { name } => format!("/distortion/{name}"),
        _ => String::from("/distortion"),
    }
}
