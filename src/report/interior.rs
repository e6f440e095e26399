//! The interior orientation of a scan as the contract has it, and as pictures: the residuals on the plate, and each
//! mark in the scan.

mod close_up;
mod residual_plot;
mod result;
#[cfg(test)]
mod tests;

pub use close_up::close_up;
pub use residual_plot::residual_plot;
pub use result::{
    InteriorDiagnosis, InteriorPrecision, InteriorReason, InteriorResult, LayingReport, MarkPairReport, MarkReport,
    MarkSensitivity, MatrixCovariance, PlateOrientationReport, TransformationReport,
};

use nalgebra::{Matrix2, Matrix3, Vector2};

use super::verdict_name;
use crate::interior::judge::promised_px;
use crate::interior::{
    Decision, InteriorOrientation, LayingCandidate, MarkResult, PairSensitivity, Plate, SIGMA_FILM_MM, Sensitivity,
    Transformation,
};

/// The elements of the matrix in the order of its covariance.
const ORDER: [&str; 6] = ["a11", "a12", "a13", "a21", "a22", "a23"];

impl InteriorResult {
    /// The contract's result of what was found in a scan of this size.
    #[must_use]
    pub fn of(found: &InteriorOrientation, plate: &Plate, size_px: [u32; 2]) -> Self {
        // what sensitivities are told in: the precision of the marks alone
        let sigma0 = found.transformation.as_ref().map_or(1.0, Transformation::sigma0);
        let unit_px = finite(found.largest_sigma_px).map(|sigma_px| sigma_px / sigma0.max(1.0));
        let transformation = found.transformation.as_ref();
        let linear = |at: Vector2<f64>| transformation.and_then(|t| plate_from_pixel_at(t, at));
        Self {
            image_size_px: size_px,
            format_mm: plate.format_mm,
            pixel_size_um: 1e3 * found.pixel_mm,
            polarity: found
                .decision
                .as_ref()
                .map(|_| (if found.negative { "negative" } else { "positive" }).to_owned()),
            plate_orientation: found.decision.as_ref().map(orientation_report),
            transformation: transformation.and_then(|t| transformation_report(t, &found.marks)),
            marks: found
                .marks
                .iter()
                .map(|mark| mark_report(mark, linear(mark.plate_mm).as_ref(), expected_mm2(plate, mark), unit_px))
                .collect(),
            pairs: found
                .pairs
                .iter()
                // the standard deviations of another transformation are not known here
                .map(|pair| {
                    let wanted = transformation.is_some_and(|t| t.kind == pair.kind);
                    pair_report(pair, &found.marks, unit_px.filter(|_| wanted))
                })
                .collect(),
            precision: InteriorPrecision {
                largest_sigma_px: finite(found.largest_sigma_px),
                largest_change_px: found.largest_change_px.and_then(finite),
                largest_undetected_px: found.largest_undetected_px.and_then(finite),
                promised_px: promised_px(found.pixel_mm),
            },
            diagnosis: InteriorDiagnosis {
                verdict: verdict_name(found.verdict).to_owned(),
                reasons: found
                    .reasons
                    .iter()
                    .map(|reason| InteriorReason { code: reason.code.to_owned(), detail: reason.detail.clone() })
                    .collect(),
            },
        }
    }
}

/// JSON has no infinities.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn all_finite<const N: usize>(values: [f64; N]) -> Option<[f64; N]> {
    values.iter().all(|value| value.is_finite()).then_some(values)
}

fn reading(mirrored: bool) -> String {
    (if mirrored { "wrong" } else { "right" }).to_owned()
}

fn orientation_report(decision: &Decision) -> PlateOrientationReport {
    let first = decision.candidates[0].laying;
    PlateOrientationReport {
        quarter_turns: first.quarter_turns % 4,
        turn_deg: first.turn_deg(),
        reading: reading(first.mirrored),
        decided_by: decision.basis.name().to_owned(),
        test: decision.test.and_then(finite),
        candidates: decision.candidates.iter().map(laying_report).collect(),
        open: decision.open,
    }
}

fn laying_report(candidate: &LayingCandidate) -> LayingReport {
    LayingReport {
        quarter_turns: candidate.laying.quarter_turns % 4,
        reading: reading(candidate.laying.mirrored),
        feature_correlation: candidate.feature.and_then(finite),
        strip: candidate.strip.and_then(finite),
        squares: finite(candidate.squares),
    }
}

fn rows<const N: usize>(element: impl Fn(usize, usize) -> f64) -> Option<[[f64; N]; N]> {
    let rows: [[f64; N]; N] = std::array::from_fn(|row| std::array::from_fn(|column| element(row, column)));
    rows.iter().flatten().all(|value| value.is_finite()).then_some(rows)
}

/// `None` where it cannot be told in numbers, which no transformation that was fitted comes to.
fn transformation_report(transformation: &Transformation, marks: &[MarkResult]) -> Option<TransformationReport> {
    let matrix = transformation.matrix();
    let inverse = matrix.try_inverse()?;
    let inverse: Matrix3<f64> = inverse / inverse[(2, 2)];
    let covariance = transformation.covariance_of_affine();
    let (px_per_mm, shear_rad) = transformation.shape();
    let used = marks.iter().filter(|mark| mark.used).filter_map(|mark| mark.residual_mm);
    let squares: Vec<f64> = used.map(|residual_mm| residual_mm.norm_squared()).collect();
    let rms_mm = (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt());
    Some(TransformationReport {
        kind: transformation.kind.name().to_owned(),
        pixel_from_plate: rows(|row, column| matrix[(row, column)])?,
        plate_from_pixel: rows(|row, column| inverse[(row, column)])?,
        covariance: MatrixCovariance {
            order: ORDER.map(str::to_owned),
            matrix: rows(|row, column| covariance[(row, column)])?,
        },
        sigma0: finite(transformation.sigma0())?,
        rms_residual_um: rms_mm.and_then(finite).map(|rms_mm| 1e3 * rms_mm),
        redundancy: transformation.redundancy,
        pixel_size_um: all_finite(px_per_mm.map(|px| 1e3 / px))?,
        shear_mrad: finite(1e3 * shear_rad)?,
    })
}

/// From pixels to the plate's millimetres, to first order at a place of the plate.
fn plate_from_pixel_at(transformation: &Transformation, plate_mm: Vector2<f64>) -> Option<Matrix2<f64>> {
    let here = transformation.pixel_from_plate(plate_mm);
    let axis = |unit: Vector2<f64>| transformation.pixel_from_plate(plate_mm + unit) - here;
    Matrix2::from_columns(&[axis(Vector2::x()), axis(Vector2::y())]).try_inverse()
}

/// Variance of a coordinate of a mark's place on the film before it is measured: of its calibration, and of what the film
/// does beside the transformation.
fn expected_mm2(plate: &Plate, mark: &MarkResult) -> f64 {
    let fiducial = plate.fiducials.iter().find(|fiducial| fiducial.name == mark.name);
    fiducial.map_or(0.0, |fiducial| fiducial.sigma_mm.powi(2)) + SIGMA_FILM_MM.powi(2)
}

fn mark_report(
    mark: &MarkResult,
    plate_from_pixel: Option<&Matrix2<f64>>,
    expected_mm2: f64,
    unit_px: Option<f64>,
) -> MarkReport {
    let covariance_um2 = mark.covariance_px2.zip(plate_from_pixel).and_then(|(covariance_px2, linear)| {
        let measured_mm2 = linear * covariance_px2 * linear.transpose();
        let covariance = (measured_mm2 + Matrix2::identity() * expected_mm2) * 1e6;
        rows(|row, column| covariance[(row, column)])
    });
    let away_px = mark.located_px.zip(mark.predicted_px).map(|(located, predicted)| (located - predicted).norm());
    let sigma_px = mark.covariance_px2.map(|c| [c[(0, 0)], c[(1, 1)]].map(|variance: f64| variance.max(0.0).sqrt()));
    MarkReport {
        name: mark.name.clone(),
        plate_mm: mark.plate_mm.into(),
        predicted_px: mark.predicted_px.and_then(|at| all_finite(at.into())),
        located_px: mark.located_px.and_then(|at| all_finite(at.into())),
        sigma_px: sigma_px.and_then(all_finite),
        covariance_um2,
        correlation: mark.correlation.and_then(finite),
        used: mark.used,
        residual_um: mark.residual_mm.and_then(|residual_mm| all_finite((1e3 * residual_mm).into())),
        residual_px: away_px.and_then(finite),
        sensitivity: mark.sensitivity.and_then(|s| sensitivity_report(&s, unit_px)),
    }
}

fn sensitivity_report(sensitivity: &Sensitivity, unit_px: Option<f64>) -> Option<MarkSensitivity> {
    let Sensitivity { test, contradicts, loss, empirical, theoretical } = *sensitivity;
    let [test, loss_of_precision, empirical, theoretical] = all_finite([test, loss, empirical, theoretical])?;
    let [empirical_px, theoretical_px] = [empirical, theoretical].map(|sigmas| unit_px.map(|px| sigmas * px));
    Some(MarkSensitivity { test, contradicts, loss_of_precision, empirical, theoretical, empirical_px, theoretical_px })
}

fn pair_report(pair: &PairSensitivity, marks: &[MarkResult], unit_px: Option<f64>) -> MarkPairReport {
    let name = |index: usize| marks.get(index).map(|mark| mark.name.clone()).unwrap_or_default();
    MarkPairReport {
        marks: pair.marks.map(name),
        transformation: pair.kind.name().to_owned(),
        sensitivity: pair.sensitivity.and_then(|s| sensitivity_report(&s, unit_px)),
    }
}
