//! A film camera as clients define it (contract, `POST /cameras`), as it is kept, and what is made of it.
//!
//! [`FilmCameraRequest`] is checked and filled in once ([`FilmCameraRequest::definition`]); what is stored and answered
//! is the [`FilmCameraDefinition`], with the marks' places adjusted where only distances between them were calibrated.

mod check;
mod convert;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cameras::usgs::FilmCalibration;
use crate::geometry::Smac;
use crate::interior::{Library, Mark};
pub use convert::DefinitionError;

/// Side of the image on the film of nearly all aerial cameras.
const FORMAT_MM: [f64; 2] = [230.0, 230.0];
const SIGMA_MM: f64 = 0.003;
const SIGMA_DISTANCE_MM: f64 = 0.005;
const SIGMA_ASYMMETRIC_MM: f64 = 0.2;

/// The templates that users have uploaded, by name.
pub type Templates = BTreeMap<String, Arc<Mark>>;

/// A film camera with its calibration report. Its scans may differ in size and resolution. The plate frame is that of the
/// report: millimetres, x in the direction of flight, y to the left of it, seen as the scene is seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FilmCameraRequest {
    /// Unique; 1 to 200 characters. Images can be oriented with the camera by this name.
    #[schema(example = "rc30-5123", min_length = 1, max_length = 200)]
    pub name: String,
    /// Calibrated principal distance.
    #[schema(example = 153.21, exclusive_minimum = 0.0)]
    pub principal_distance_mm: f64,
    /// Principal point of autocollimation in the plate.
    #[schema(example = json!([0.004, -0.002]), value_type = Vec<f64>, min_items = 2, max_items = 2)]
    pub principal_point_mm: [f64; 2],
    /// Principal point of symmetry, the centre of the distortion. Default: the principal point.
    #[schema(example = json!([0.01, 0.006]), value_type = Option<Vec<f64>>, min_items = 2, max_items = 2)]
    pub symmetry_point_mm: Option<[f64; 2]>,
    /// Width (x) and height (y) of the image on the film. Default: 230, 230.
    #[schema(example = json!([230.0, 230.0]), value_type = Option<Vec<f64>>, min_items = 2, max_items = 2)]
    pub format_mm: Option<[f64; 2]>,
    /// Lens distortion; left out, there is none.
    pub distortion: Option<FilmDistortion>,
    /// The calibrated fiducial marks, 2 to 32.
    #[schema(min_items = 2, max_items = 32)]
    pub fiducials: Vec<FiducialRequest>,
    /// Distances between marks, where the report gives these instead of positions: the positions are then approximate
    /// and are adjusted. Their centroid and direction stay, the scale becomes that of the distances.
    #[schema(max_items = 1000)]
    pub fiducial_distances: Option<Vec<DistanceRequest>>,
    /// A figure on one side of the plate only, which tells how the film lies.
    pub asymmetric_feature: Option<AsymmetricRequest>,
    /// The side of the plate, in the plate frame, beside which the camera writes its data (clock, counter, text).
    pub data_strip: Option<StripSide>,
}

/// A fiducial mark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FiducialRequest {
    /// Its name in the report, unique; 1 to 40 characters.
    #[schema(example = "1", min_length = 1, max_length = 40)]
    pub name: String,
    /// Its place in the plate.
    #[schema(example = json!([-106.0, -106.0]), value_type = Vec<f64>, min_items = 2, max_items = 2)]
    pub position_mm: [f64; 2],
    /// Standard deviation of each coordinate, above 0 to 1. Default: 0.003. Not together with distances, from which it
    /// follows.
    #[schema(example = 0.003, exclusive_minimum = 0.0, maximum = 1.0)]
    pub sigma_mm: Option<f64>,
    /// What it looks like: `wild_rc5`, `wild_rc10`, `wild_rc20`, `leica_rc30`, `zeiss_rmk`, `zeiss_rmk_top`,
    /// `fairchild_pinhole`, `fairchild_wing`, `arrow`, `bar`, or the name of an uploaded template.
    #[schema(example = "leica_rc30")]
    pub template: String,
    /// How the mark is turned in the plate, counter-clockwise, -360 to 360. Default: 0.
    #[schema(example = 0, minimum = -360, maximum = 360)]
    pub rotation_deg: Option<f64>,
}

/// A calibrated distance between two marks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DistanceRequest {
    /// Names of the two marks.
    #[schema(example = json!(["1", "3"]), value_type = Vec<String>, min_items = 2, max_items = 2)]
    pub between: [String; 2],
    /// The distance.
    #[schema(example = 299.8, exclusive_minimum = 0.0)]
    pub distance_mm: f64,
    /// Its standard deviation, above 0 to 1. Default: 0.005.
    #[schema(example = 0.005, exclusive_minimum = 0.0, maximum = 1.0)]
    pub sigma_mm: Option<f64>,
}

/// A figure that is on one side of the plate only.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AsymmetricRequest {
    /// Its place in the plate.
    #[schema(example = json!([0.0, 112.0]), value_type = Vec<f64>, min_items = 2, max_items = 2)]
    pub position_mm: [f64; 2],
    /// Standard deviation of each coordinate, above 0 to 1. Default: 0.2, for such figures are not calibrated.
    #[schema(example = 0.2, exclusive_minimum = 0.0, maximum = 1.0)]
    pub sigma_mm: Option<f64>,
    /// What it looks like, as for fiducial marks.
    #[schema(example = "arrow")]
    pub template: String,
    /// How it is turned in the plate, counter-clockwise, -360 to 360. Default: 0.
    #[schema(example = 0, minimum = -360, maximum = 360)]
    pub rotation_deg: Option<f64>,
}

/// Models of the distortion of film cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum FilmModel {
    /// The polynomials of the USGS reports.
    Smac,
    /// Radial distortion by radius.
    Table,
}

/// Distortion of a film camera. With `smac`: x, y from the point of symmetry in mm and r² = x² + y² give the corrected
/// x (1 + k0 + k1 r² + k2 r⁴ + k3 r⁶ + k4 r⁸) + [p1 (r² + 2 x²) + 2 p2 x y] (1 + p3 r² + p4 r⁴), and y alike; what is left
/// out is 0. With `table`: radial distortion as reports tabulate it, positive outwards; it is what is taken away from the
/// measured radius.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FilmDistortion {
    /// Which of the two; the fields of the other one are refused.
    pub model: FilmModel,
    /// `smac`: radial coefficient of 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k0: Option<f64>,
    /// `smac`: radial coefficient of r².
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k1: Option<f64>,
    /// `smac`: radial coefficient of r⁴.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k2: Option<f64>,
    /// `smac`: radial coefficient of r⁶.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k3: Option<f64>,
    /// `smac`: radial coefficient of r⁸.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub k4: Option<f64>,
    /// `smac`: decentring coefficient that goes with r² + 2x² in x.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub p1: Option<f64>,
    /// `smac`: decentring coefficient that goes with 2xy in x.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub p2: Option<f64>,
    /// `smac`: by how much the decentring grows with r².
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub p3: Option<f64>,
    /// `smac`: by how much the decentring grows with r⁴.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub p4: Option<f64>,
    /// `table`: radii in the plate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null), max_items = 200)]
    pub radius_mm: Option<Vec<f64>>,
    /// `table`: the radial distortion there, in micrometres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null), max_items = 200)]
    pub distortion_um: Option<Vec<f64>>,
}

impl FilmCameraRequest {
    /// The camera of a calibration report, whose marks all look like this template.
    #[must_use]
    pub fn of_report(name: String, report: &FilmCalibration, template: &str) -> Self {
        let Smac { k, p } = report.distortion;
        let ([k0, k1, k2, k3, k4], [p1, p2, p3, p4]) = (k.map(Some), p.map(Some));
        let fiducial = |(name, position_mm): &(String, [f64; 2])| FiducialRequest {
            name: name.clone(),
            position_mm: *position_mm,
            sigma_mm: None,
            template: template.to_owned(),
            rotation_deg: None,
        };
        Self {
            name,
            principal_distance_mm: report.principal_distance_mm,
            principal_point_mm: report.principal_point_mm,
            symmetry_point_mm: Some(report.symmetry_point_mm),
            format_mm: None,
            distortion: Some(FilmDistortion {
                model: FilmModel::Smac,
                k0,
                k1,
                k2,
                k3,
                k4,
                p1,
                p2,
                p3,
                p4,
                radius_mm: None,
                distortion_um: None,
            }),
            fiducials: report.marks.iter().map(fiducial).collect(),
            fiducial_distances: None,
            asymmetric_feature: None,
            data_strip: None,
        }
    }
}

/// A side of the plate: `right` is towards positive x, `top` towards positive y.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum StripSide {
    /// Towards negative x.
    Left,
    /// Towards positive x.
    Right,
    /// Towards positive y.
    Top,
    /// Towards negative y.
    Bottom,
}

/// A film camera with everything checked and filled in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FilmCameraDefinition {
    /// Calibrated principal distance.
    pub principal_distance_mm: f64,
    /// Principal point of autocollimation in the plate.
    #[schema(value_type = Vec<f64>, min_items = 2, max_items = 2)]
    pub principal_point_mm: [f64; 2],
    /// Principal point of symmetry, the centre of the distortion.
    #[schema(value_type = Vec<f64>, min_items = 2, max_items = 2)]
    pub symmetry_point_mm: [f64; 2],
    /// Width (x) and height (y) of the image on the film.
    #[schema(value_type = Vec<f64>, min_items = 2, max_items = 2)]
    pub format_mm: [f64; 2],
    /// Lens distortion.
    pub distortion: FilmDistortion,
    /// The fiducial marks.
    pub fiducials: Vec<FiducialDefinition>,
    /// The distances that their positions were adjusted to.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fiducial_distances: Vec<DistanceDefinition>,
    /// How well the distances agree, if there are any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adjustment: Option<Adjustment>,
    /// The figure that is on one side of the plate only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asymmetric_feature: Option<AsymmetricDefinition>,
    /// The side beside which the camera writes its data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub data_strip: Option<StripSide>,
}

/// A fiducial mark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FiducialDefinition {
    /// Its name in the report.
    pub name: String,
    /// Its place in the plate, adjusted if there are distances.
    #[schema(value_type = Vec<f64>, min_items = 2, max_items = 2)]
    pub position_mm: [f64; 2],
    /// Standard deviation of each coordinate; from the adjustment if there are distances.
    pub sigma_mm: f64,
    /// The position as it was given, if there are distances.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>, min_items = 2, max_items = 2)]
    pub approximate_position_mm: Option<[f64; 2]>,
    /// What it looks like.
    pub template: String,
    /// How it is turned in the plate, counter-clockwise.
    pub rotation_deg: f64,
}

/// A calibrated distance between two marks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DistanceDefinition {
    /// Names of the two marks.
    #[schema(value_type = Vec<String>, min_items = 2, max_items = 2)]
    pub between: [String; 2],
    /// The distance.
    pub distance_mm: f64,
    /// Its standard deviation.
    pub sigma_mm: f64,
    /// Given less adjusted.
    pub residual_mm: f64,
}

/// How well distances between marks agree.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Adjustment {
    /// By how much larger the residuals are than the standard deviations say; 1 if nothing is redundant.
    pub sigma0: f64,
    /// Distances beyond those that are needed.
    pub redundancy: usize,
}

/// A figure that is on one side of the plate only.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AsymmetricDefinition {
    /// Its place in the plate.
    #[schema(value_type = Vec<f64>, min_items = 2, max_items = 2)]
    pub position_mm: [f64; 2],
    /// Standard deviation of each coordinate.
    pub sigma_mm: f64,
    /// What it looks like.
    pub template: String,
    /// How it is turned in the plate, counter-clockwise.
    pub rotation_deg: f64,
}

/// Those of the names that Gable does not bring along.
fn uploaded<'a>(names: impl Iterator<Item = &'a String>) -> BTreeSet<&'a str> {
    names.map(String::as_str).filter(|name| Library::from_name(name).is_none()).collect()
}

impl FilmCameraRequest {
    /// The names of uploaded templates that it refers to.
    #[must_use]
    pub fn uploaded_templates(&self) -> BTreeSet<&str> {
        let asymmetric = self.asymmetric_feature.iter().map(|feature| &feature.template);
        uploaded(self.fiducials.iter().map(|fiducial| &fiducial.template).chain(asymmetric))
    }
}

impl FilmCameraDefinition {
    /// The names of uploaded templates that it refers to.
    #[must_use]
    pub fn uploaded_templates(&self) -> BTreeSet<&str> {
        let asymmetric = self.asymmetric_feature.iter().map(|feature| &feature.template);
        uploaded(self.fiducials.iter().map(|fiducial| &fiducial.template).chain(asymmetric))
    }
}
