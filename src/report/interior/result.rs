//! The `result` of an interior orientation, field by field as the contract has it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What was found out about how a film lies in its scan. Parts that do not exist, because too few marks were found, are
/// left out. Pixel coordinates count from the corner of the top-left pixel, x to the right and y down; plate
/// coordinates are those of the camera's calibration, millimetres on the film.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct InteriorResult {
    /// Columns and rows of the scan.
    #[schema(value_type = Vec<u32>)]
    pub image_size_px: [u32; 2],
    /// Width and height of the image on the film, about the plate's origin.
    #[schema(value_type = Vec<f64>)]
    pub format_mm: [f64; 2],
    /// Side of a pixel on the film that was assumed at the beginning.
    #[schema(example = 14.0)]
    pub pixel_size_um: f64,
    /// `positive` or `negative`: bright and dark exchanged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = "positive")]
    pub polarity: Option<String>,
    /// How the film lies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plate_orientation: Option<PlateOrientationReport>,
    /// Between the plate and the pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transformation: Option<TransformationReport>,
    /// The fiducial marks in the order of the camera.
    pub marks: Vec<MarkReport>,
    /// All pairs of the marks used.
    pub pairs: Vec<MarkPairReport>,
    /// How well the pixel of any place of the image is known.
    pub precision: InteriorPrecision,
    /// The verdict.
    pub diagnosis: InteriorDiagnosis,
}

/// How the film lies in the scan, and how that was decided.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlateOrientationReport {
    /// Quarter turns of the plate, counter-clockwise as one sees the scan.
    pub quarter_turns: u8,
    /// The same in degrees.
    #[schema(example = 90)]
    pub turn_deg: u32,
    /// `right`, or `wrong`: mirrored about the plate's y axis before it is turned.
    #[schema(example = "right")]
    pub reading: String,
    /// `marks`, `asymmetric_feature`, `data_strip`, `calibration`, `image_content`, `stated` or `nothing`.
    #[schema(example = "asymmetric_feature")]
    pub decided_by: String,
    /// How sure that is, in standard deviations; left out where nothing had to be compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test: Option<f64>,
    /// All ways in which the marks allow the film to lie, the likeliest first: all else is told for this one.
    pub candidates: Vec<LayingReport>,
    /// How many of these, from the first on, are still possible: 1 if it is decided.
    pub open: usize,
}

/// A way in which the film may lie, with what speaks for it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LayingReport {
    /// Quarter turns, counter-clockwise.
    pub quarter_turns: u8,
    /// `right` or `wrong`.
    #[schema(example = "right")]
    pub reading: String,
    /// Correlation coefficient of the asymmetric feature where this has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub feature_correlation: Option<f64>,
    /// Mean gradient of the scan where this has the data strip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strip: Option<f64>,
    /// Weighted sum of the squared residuals of the marks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub squares: Option<f64>,
}

/// The transformation between the plate and the pixels of the scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TransformationReport {
    /// `similarity`, `affine` or `projective`.
    #[schema(example = "affine")]
    pub kind: String,
    /// From (x, y, 1) in millimetres to (x, y, 1) in pixels, times a factor where the last row is not 0, 0, 1.
    #[schema(value_type = Vec<Vec<f64>>)]
    pub pixel_from_plate: [[f64; 3]; 3],
    /// The other way.
    #[schema(value_type = Vec<Vec<f64>>)]
    pub plate_from_pixel: [[f64; 3]; 3],
    /// Of `pixel_from_plate`, of a projective transformation to first order at the plate's origin. It rests on the
    /// standard deviations that were expected; `sigma0` says how the residuals compare with these.
    pub covariance: MatrixCovariance,
    /// Standard deviation of unit weight; 1 without redundancy.
    pub sigma0: f64,
    /// Root mean square distance of the marks used from where the transformation has them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms_residual_um: Option<f64>,
    /// Coordinates of the marks used less unknowns.
    pub redundancy: usize,
    /// Side of a pixel on the film as the calibration has it, along the plate's axes.
    #[schema(value_type = Vec<f64>)]
    pub pixel_size_um: [f64; 2],
    /// By how much the angle between the plate's axes exceeds a right one in the scan.
    pub shear_mrad: f64,
}

/// The covariance of the first two rows of a matrix.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MatrixCovariance {
    /// The order of rows and columns.
    #[schema(value_type = Vec<String>)]
    pub order: [String; 6],
    /// Six rows of six.
    #[schema(value_type = Vec<Vec<f64>>)]
    pub matrix: [[f64; 6]; 6],
}

/// What became of a fiducial mark.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MarkReport {
    /// Its name.
    pub name: String,
    /// Its calibrated position.
    #[schema(value_type = Vec<f64>)]
    pub plate_mm: [f64; 2],
    /// Where the transformation has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    pub predicted_px: Option<[f64; 2]>,
    /// Where it was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    pub located_px: Option<[f64; 2]>,
    /// Standard deviations of that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    pub sigma_px: Option<[f64; 2]>,
    /// Covariance that it counts with, on the film along the plate's axes: of its measuring, of its calibrated position,
    /// and of what film does beside such a transformation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Vec<f64>>>)]
    pub covariance_um2: Option<[[f64; 2]; 2]>,
    /// Correlation coefficient of its template with the scan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correlation: Option<f64>,
    /// Whether the transformation rests on it.
    pub used: bool,
    /// Found less predicted, on the film along the plate's axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    pub residual_um: Option<[f64; 2]>,
    /// The length of that in the scan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residual_px: Option<f64>,
    /// How the transformation depends on it; left out if it is not used or the others do not check it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity: Option<MarkSensitivity>,
}

/// How the transformation depends on a mark, or on two together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MarkSensitivity {
    /// Its squared discrepancy from what the others predict, in units of its covariance (T): chi-square with two degrees
    /// of freedom, four of a pair.
    pub test: f64,
    /// Whether chance hardly explains that (0.1 %).
    pub contradicts: bool,
    /// The relative loss of precision without it.
    pub loss_of_precision: f64,
    /// Leaving it out changes no function of the transformation by more than this many of its standard deviations.
    pub empirical: f64,
    /// Nor does an error of it that its test does not find (4 of 5 times).
    pub theoretical: f64,
    /// So no place of the image moves by more than this if it is left out. Left out where `transformation` of a pair is
    /// another than that of the result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub empirical_px: Option<f64>,
    /// Nor by more than this by an error that its test does not find.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub theoretical_px: Option<f64>,
}

/// How the transformation depends on two marks together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MarkPairReport {
    /// Their names.
    #[schema(value_type = Vec<String>)]
    pub marks: [String; 2],
    /// The transformation that was asked: a similarity where the others leave the wanted one undetermined.
    #[schema(example = "affine")]
    pub transformation: String,
    /// `null` if the other marks do not determine even that.
    pub sensitivity: Option<MarkSensitivity>,
}

/// How well the pixel of a place of the image is known: the worst place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct InteriorPrecision {
    /// Standard deviation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_sigma_px: Option<f64>,
    /// No place moves by more than this if one mark is left out; left out if a mark cannot be.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_change_px: Option<f64>,
    /// Nor by more than this through an error of one mark that nothing shows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub largest_undetected_px: Option<f64>,
    /// A green verdict promises that no place is farther from where the transformation has it.
    pub promised_px: f64,
}

/// The verdict on an interior orientation.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct InteriorDiagnosis {
    /// `green`: verified, may be used without a look. `yellow`: doubtful. `red`: not solved, or wrong.
    #[schema(example = "green")]
    pub verdict: String,
    /// The one that decided first.
    pub reasons: Vec<InteriorReason>,
}

/// Why the verdict is what it is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct InteriorReason {
    /// A stable word for programs.
    #[schema(example = "verified")]
    pub code: String,
    /// A sentence for staff.
    pub detail: String,
}
