//! The `result` of an orientation, field by field as the contract has it.

use serde::Serialize;
use utoipa::ToSchema;

use super::interior::InteriorResult;
use super::position::{Position, Warning};
use crate::classifiers::Loaded;

/// What was found out about an image. Parts that do not exist, because the image could not be oriented, are left out.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct OrientationResult {
    /// Where the camera stood, in the output CRS.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub projection_centre: Option<Position>,
    /// How it was turned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation: Option<RotationResult>,
    /// Of a scan of film: how it was brought to the camera's plate. All pixels are those of the scan, and the rotation is
    /// that of the plate, whichever way it lies there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interior_orientation: Option<InteriorResult>,
    /// How well both are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub covariance: Option<CovarianceResult>,
    /// Standard deviation of unit weight of the last step that was reached.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sigma0: Option<f64>,
    /// Redundancy of that step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub redundancy: Option<usize>,
    /// Largest eigenvalue of the covariance against that of four control points in the image's corners.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub configuration: Option<f64>,
    /// The control points that were expected in the image.
    pub control_points: Vec<ControlPointReport>,
    /// The check points in view: buildings that are never used, and tell how right the result is. Empty without one.
    pub check_points: Vec<CheckPointReport>,
    /// How the result depends on pairs of control points: those that matter most, at most twenty.
    pub pairs: Vec<PairSensitivityReport>,
    /// Predicted precision on the ground at the image points at 5, 50 and 95 % of width and height, on the horizontal
    /// plane at the mean height of the control used.
    pub ground_precision: Vec<GroundPoint>,
    /// Which of the located control points agree, and how that was searched.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub consensus: Option<ConsensusReport>,
    /// The largest planimetric error on the ground that is accepted: what the verdict is about.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance_m: Option<f64>,
    /// The verdict.
    pub diagnosis: DiagnosisReport,
    /// What the user should know besides.
    pub warnings: Vec<Warning>,
    /// The approximate orientation that was used, and where it came from.
    pub approximation: ApproximationUsed,
    /// What was taken for possible about the approximation, and how much was looked at; left out where there was
    /// nothing to look for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub search: Option<CostReport>,
}

/// What the search took for possible, and how much was looked at: counts, the same on every machine.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct CostReport {
    /// omega and phi were searched so far to either side of the approximation.
    pub tilt_reach_deg: f64,
    /// kappa so far; left out where the whole circle was searched.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kappa_reach_deg: Option<f64>,
    /// The projection centre so far, east and north.
    #[schema(value_type = Vec<f64>)]
    pub position_reach_m: [f64; 2],
    /// The least and the largest height of the projection centre above the control that was searched.
    #[schema(value_type = Vec<f64>)]
    pub flying_height_m: [f64; 2],
    /// Steps of heading and height under which the control points were looked for.
    pub views: usize,
    /// Control points that were looked for in wide windows.
    pub control_points: usize,
    /// Wide windows.
    pub windows: usize,
    /// Pairs of candidates that agree with the approximation.
    pub pairs: usize,
    /// Hypotheses that were refined.
    pub refined: usize,
    /// Hypotheses that were adjusted with lines.
    pub adjusted: usize,
    /// Pixels of the image that were read, in millions.
    pub megapixels_read: f64,
}

/// The rotation of the image.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct RotationResult {
    /// Whose axes: a topocentric output CRS itself; a map grid's east, north and up at the projection centre; for a
    /// geographic output CRS, the local east, north, up frame there.
    pub frame: String,
    /// Rows of R: object space to the camera frame (x right, y up, z backwards).
    #[schema(value_type = Vec<Vec<f64>>)]
    pub rotation_matrix: [[f64; 3]; 3],
    /// Angle about the x axis; R = (R_x(omega) R_y(phi) R_z(kappa))^T.
    pub omega_deg: f64,
    /// Angle about the y axis.
    pub phi_deg: f64,
    /// Angle about the z axis.
    pub kappa_deg: f64,
}

/// The covariance of the six parameters. Metres are along the axes of `rotation.frame`, whatever the unit of the
/// output CRS; the angles are the differentials of omega, phi, kappa there.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct CovarianceResult {
    /// The order of rows and columns.
    #[schema(value_type = Vec<String>)]
    pub order: [&'static str; 6],
    /// Six rows of six.
    #[schema(value_type = Vec<Vec<f64>>)]
    pub matrix: [[f64; 6]; 6],
}

/// What became of a control point.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ControlPointReport {
    /// Its name.
    pub name: String,
    /// `lines`: a building whose roof edges are known. `scene`: a small picture of the ground.
    #[schema(example = "lines")]
    pub kind: &'static str,
    /// Its reference point under the approximate orientation.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    pub predicted_px: Option<[f64; 2]>,
    /// Its reference point where it was found; only of one that took part in the adjustment.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    pub located_px: Option<[f64; 2]>,
    /// Whether it took part in the last step.
    pub used: bool,
    /// Its edges that have a line segment in the image.
    pub segments_matched: usize,
    /// Root mean square distance of the ends of its matched line segments from its projected edges.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual_px: Option<f64>,
    /// How the result depends on it, if it took part and the others say where it should be.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensitivity: Option<SensitivityReport>,
}

/// What the image shows of a check point under the result.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct CheckPointReport {
    /// Its name.
    pub name: String,
    /// Its reference point under the result.
    #[schema(value_type = Vec<f64>)]
    pub predicted_px: [f64; 2],
    /// Its reference point where its lines put it; left out if it was not found.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    pub located_px: Option<[f64; 2]>,
    /// Its edges that have a line segment in the image.
    pub segments_matched: usize,
    /// So far apart are the two, freed of the distortion; where all its lines are parallel, across them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual_px: Option<f64>,
    /// The same at its distance from the camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual_m: Option<f64>,
}

/// Predicted precision of one point of the ground, if the orientation is right.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct GroundPoint {
    /// The image point.
    #[schema(value_type = Vec<f64>)]
    pub image_px: [f64; 2],
    /// Where it lies on the ground, in the output CRS.
    #[schema(value_type = Vec<f64>)]
    pub ground: [f64; 3],
    /// sqrt(variance east + variance north).
    pub sigma_planimetric_m: f64,
}

/// The search for the largest set of located control points that agree upon one orientation.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct ConsensusReport {
    /// `complete`: no larger set agrees. `bounded`: the search was ended by its budget. `sampled`: some sets were
    /// looked at, and nothing is known of the others.
    #[schema(example = "complete")]
    pub search: &'static str,
    /// Subsets of the control points that were examined.
    pub subsets_examined: usize,
    /// Control points that were located.
    pub control_points: usize,
    /// Those that agree.
    pub inliers: usize,
}

/// The verdict with all that led to it.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct DiagnosisReport {
    /// `green`: verified, may be used without a look. `yellow`: doubtful. `red`: not solved, or wrong.
    #[schema(example = "green")]
    pub verdict: &'static str,
    /// The larger the better.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub score: Option<f64>,
    /// Green above it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold: Option<f64>,
    /// Probability that the largest error on the ground is within the tolerance.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub probability_correct: Option<f64>,
    /// After the orientation with points, if there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub features: Option<FeatureReport>,
    /// The one that decided first.
    pub reasons: Vec<ReasonReport>,
    /// Control points that agree with one another: what is probably right.
    pub probably_right: Vec<String>,
    /// Control points that took part and contradict all others: what is probably wrong.
    pub probably_wrong: Vec<String>,
    /// Which classifier has decided.
    pub classifier: ClassifierUsed,
}

/// The classifier that a verdict is of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct ClassifierUsed {
    /// Its name; `shipped` for the one that the program brings along.
    #[schema(example = "shipped")]
    pub name: String,
    /// `paper`, `one_feature`, `evidence_svm` or `evidence_logistic`.
    #[schema(example = "evidence_logistic")]
    pub kind: String,
    /// SHA-256 of its model, scaling and description: the same hash decides the same.
    pub sha256: String,
}

impl ClassifierUsed {
    /// A classifier by its name.
    #[must_use]
    pub fn of(name: &str, loaded: &Loaded) -> Self {
        Self { name: name.to_owned(), kind: loaded.description.kind.clone(), sha256: loaded.hash() }
    }
}

/// How the result depends on a control point: planimetric distances on the ground, the worst of the nine points.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct SensitivityReport {
    /// How far it was found from where all other control points expect it.
    #[schema(value_type = Vec<f64>)]
    pub discrepancy_px: [f64; 2],
    /// The squared discrepancy in units of its covariance (T): chi-square with 2 degrees of freedom, 1 where the control
    /// point was observed in one direction only.
    pub test: f64,
    /// Whether chance hardly explains that (0.1 %).
    pub contradicts: bool,
    /// So far the ground moves if it is left out.
    pub change_m: f64,
    /// Empirical sensitivity: leaving it out changes no coordinate of a ground point by more than this.
    pub empirical_m: f64,
    /// Theoretical sensitivity: an error of it that its test does not find (4 of 5 times) does no more than this.
    pub theoretical_m: f64,
}

/// How the result depends on two control points together.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct PairSensitivityReport {
    /// Their names.
    #[schema(value_type = Vec<String>)]
    pub control_points: [String; 2],
    /// Chi-square with at most 4 degrees of freedom.
    pub test: f64,
    /// So far the ground moves if both are left out.
    pub change_m: f64,
    /// Leaving them out changes no coordinate of a ground point by more than this.
    pub empirical_m: f64,
    /// An error of both that their test does not find does no more than this.
    pub theoretical_m: f64,
}

/// What the diagnosis looks at.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct FeatureReport {
    /// Control points that were located.
    pub control_points: usize,
    /// Of those, the ones eliminated.
    pub eliminated: usize,
    /// Logarithm of the standard deviation of unit weight.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log_sigma0: Option<f64>,
    /// Logarithm of the configuration measure.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log_configuration: Option<f64>,
}

/// Why the verdict is what it is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct ReasonReport {
    /// A stable word for programs.
    pub code: &'static str,
    /// A sentence for staff.
    pub detail: String,
}

/// Where a part of the approximate orientation came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, serde::Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// The request gave it.
    Request,
    /// The image file gave it (EXIF or XMP).
    Exif,
    /// Nobody gave it: the contract's default.
    Default,
    /// Nobody gave it, and everything is possible.
    Unknown,
}

/// The approximate orientation that was used, and where each part came from. Angles are about the axes of a local
/// east, north, up frame at the position.
#[derive(Debug, Clone, PartialEq, Serialize, serde::Deserialize, ToSchema)]
pub struct ApproximationUsed {
    /// The projection centre.
    pub position: Position,
    /// Its standard deviations, east, north, up.
    #[schema(value_type = Vec<f64>)]
    pub sigma_position_m: [f64; 3],
    /// Angle about the x axis.
    pub omega_deg: f64,
    /// Angle about the y axis.
    pub phi_deg: f64,
    /// Angle about the z axis; left out where the whole circle was searched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kappa_deg: Option<f64>,
    /// Standard deviation of omega and phi.
    pub sigma_tilt_deg: f64,
    /// Standard deviation of kappa; left out where the whole circle was searched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_kappa_deg: Option<f64>,
    /// Where these came from.
    pub origin: ApproximationOrigin,
}

/// Where the parts of an approximate orientation came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, serde::Deserialize, ToSchema)]
pub struct ApproximationOrigin {
    /// The projection centre.
    pub position: Origin,
    /// omega and phi.
    pub tilt: Origin,
    /// kappa.
    pub kappa: Origin,
}
