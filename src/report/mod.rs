//! The answer: from the local frame of the adjustment into the CRS that was asked for, as the contract writes it.

pub mod drawing;
pub mod interior;
pub mod map;
pub mod overlay;
pub mod position;
pub mod result;

use nalgebra::{Matrix3, Matrix6, Rotation3, Vector2, Vector3};

pub use interior::InteriorResult;
pub use position::{Position, Vertical, Warning};
pub use result::{ApproximationOrigin, ApproximationUsed, ClassifierUsed, OrientationResult, Origin};

use crate::diagnosis::{Diagnosis, Features, Verdict};
use crate::geometry::{Crs, CrsError, LocalFrame, rotation};
use crate::pipeline::{
    CheckPointResult, ConsensusResult, ControlKind, ControlPointResult, ControlPointSensitivity, Cost, Estimate,
    GroundBounds, GroundPrecision, Outcome, PairResult, SearchReport,
};
use result::{
    CheckPointReport, ConsensusReport, ControlPointReport, CostReport, CovarianceResult, DiagnosisReport,
    FeatureReport, GroundPoint, PairSensitivityReport, ReasonReport, RotationResult, SensitivityReport,
};

/// Where the answer is to be given.
#[derive(Debug, Clone)]
pub struct Output {
    /// The CRS.
    pub crs: Crs,
    /// What takes its heights off the ellipsoid, where they are not ellipsoidal.
    pub geoid_undulation_m: Option<f64>,
}

impl Output {
    fn position(&self, geocentric_m: Vector3<f64>) -> Result<[f64; 3], CrsError> {
        self.crs.position_from_geocentric(geocentric_m, self.geoid_undulation_m)
    }
}

/// The verdict's word in the contract.
#[must_use]
pub fn verdict_name(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Red => "red",
        Verdict::Yellow => "yellow",
        Verdict::Green => "green",
    }
}

/// The contract's result of an outcome in the local frame `frame`.
///
/// # Errors
/// [`CrsError`] if the projection centre lies where the output CRS does not reach.
pub fn result(
    outcome: &Outcome,
    frame: &LocalFrame,
    output: &Output,
    approximation: ApproximationUsed,
    warnings: Vec<Warning>,
    decides: ClassifierUsed,
) -> Result<OrientationResult, CrsError> {
    let mut result = OrientationResult {
        projection_centre: None,
        rotation: None,
        interior_orientation: None,
        covariance: None,
        sigma0: None,
        redundancy: None,
        configuration: None,
        control_points: outcome.control_points.iter().map(control_point).collect(),
        check_points: outcome.check_points.iter().filter_map(check_point).collect(),
        ground_precision: outcome.ground_precision.iter().filter_map(|p| ground_point(p, frame, output)).collect(),
        consensus: outcome.consensus.as_ref().map(consensus),
        pairs: pairs(outcome),
        tolerance_m: outcome.evidence.as_ref().and_then(|evidence| finite(evidence.tolerance_m)),
        diagnosis: diagnosis(&outcome.diagnosis, decides),
        warnings,
        approximation,
        search: outcome.cost.as_ref().map(cost),
    };
    if outcome.cost.is_some_and(|cost| cost.search.assumed.height_cut) {
        result.warnings.push(Warning::height_cut());
    }
    if outcome.cost.is_some_and(|cost| cost.widened) {
        result.warnings.push(Warning::approximation_widened());
    }
    if let Some(estimate) = outcome.estimate.as_ref().filter(|estimate| is_finite(estimate)) {
        let geocentric_m = frame.to_geocentric(estimate.orientation.projection_centre_m);
        result.projection_centre = Some(Position {
            crs: output.crs.to_string(),
            coordinates: output.position(geocentric_m)?,
            vertical: output.geoid_undulation_m.map(|geoid_undulation_m| Vertical { geoid_undulation_m }),
        });
        let output_from_local =
            output.crs.axes_from_geocentric(geocentric_m)? * frame.local_from_geocentric().inverse();
        let camera_from_output = estimate.orientation.camera_from_object * output_from_local.inverse();
        result.rotation = Some(rotation_result(&camera_from_output, axes_name(&output.crs, geocentric_m)));
        result.covariance = covariance(&estimate.covariance, &output_from_local, &camera_from_output);
        result.sigma0 = finite(estimate.sigma0);
        result.redundancy = Some(estimate.redundancy);
        result.configuration = finite(estimate.configuration);
    }
    Ok(result)
}

fn cost(cost: &Cost) -> CostReport {
    let SearchReport { assumed, views, control_points, windows, pairs, refined } = cost.search;
    CostReport {
        tilt_reach_deg: assumed.tilt_reach_rad.to_degrees(),
        kappa_reach_deg: assumed.kappa_reach_rad.map(f64::to_degrees),
        position_reach_m: assumed.position_reach_m,
        flying_height_m: assumed.flying_height_m,
        views,
        control_points,
        windows,
        pairs,
        refined,
        adjusted: cost.adjusted,
        megapixels_read: cost.pixels_read as f64 / 1e6,
    }
}

fn is_finite(estimate: &Estimate) -> bool {
    let orientation = &estimate.orientation;
    orientation.projection_centre_m.iter().chain(orientation.camera_from_object.matrix().iter()).all(|v| v.is_finite())
}

/// JSON has no infinity: what is not finite is left out.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

fn pixel(point: Vector2<f64>) -> Option<[f64; 2]> {
    Some([finite(point.x)?, finite(point.y)?])
}

/// The CRS of which the axes of the rotation are.
fn axes_name(crs: &Crs, centre_geocentric_m: Vector3<f64>) -> String {
    if crs.is_geographic() { LocalFrame::about(centre_geocentric_m).proj_string() } else { crs.to_string() }
}

fn rotation_result(camera_from_output: &Rotation3<f64>, frame: String) -> RotationResult {
    let [omega, phi, kappa] = rotation::angles(camera_from_output);
    let r = camera_from_output.matrix();
    RotationResult {
        frame,
        rotation_matrix: std::array::from_fn(|row| std::array::from_fn(|column| r[(row, column)])),
        omega_deg: omega.to_degrees(),
        phi_deg: phi.to_degrees(),
        kappa_deg: kappa.to_degrees(),
    }
}

/// From `[dX0 in the local frame, theta about the camera's axes]` to `[x, y, z, omega, phi, kappa]` in the output's
/// axes; `None` where omega and kappa cannot be told apart.
fn covariance(
    local: &Matrix6<f64>,
    output_from_local: &Rotation3<f64>,
    camera_from_output: &Rotation3<f64>,
) -> Option<CovarianceResult> {
    let angles_by_theta: Matrix3<f64> = rotation::angles_by_theta(camera_from_output)?;
    let mut jacobian = Matrix6::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(output_from_local.matrix());
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&angles_by_theta);
    let transformed = jacobian * local * jacobian.transpose();
    let symmetric = (transformed + transformed.transpose()) / 2.0;
    symmetric.iter().all(|v| v.is_finite()).then(|| CovarianceResult {
        order: ["x_m", "y_m", "z_m", "omega_rad", "phi_rad", "kappa_rad"],
        matrix: std::array::from_fn(|row| std::array::from_fn(|column| symmetric[(row, column)])),
    })
}

fn control_point(point: &ControlPointResult) -> ControlPointReport {
    ControlPointReport {
        name: point.name.clone(),
        kind: match point.kind {
            ControlKind::Lines => "lines",
            ControlKind::Scene => "scene",
        },
        predicted_px: point.predicted_px.and_then(pixel),
        located_px: point.located_px.and_then(pixel),
        used: point.used,
        segments_matched: point.segments_matched,
        residual_px: point.residual_px.and_then(finite),
        sensitivity: point.sensitivity.as_ref().and_then(sensitivity),
    }
}

fn check_point(point: &CheckPointResult) -> Option<CheckPointReport> {
    Some(CheckPointReport {
        name: point.name.clone(),
        predicted_px: pixel(point.predicted_px)?,
        located_px: point.located_px.and_then(pixel),
        segments_matched: point.segments_matched,
        residual_px: point.residual_px.and_then(finite),
        residual_m: point.residual_m.and_then(finite),
    })
}

fn sensitivity(of_point: &ControlPointSensitivity) -> Option<SensitivityReport> {
    let GroundBounds { change_m, empirical_m, theoretical_m } = of_point.ground;
    Some(SensitivityReport {
        discrepancy_px: pixel(of_point.discrepancy_px)?,
        test: finite(of_point.test)?,
        contradicts: of_point.contradicts,
        change_m: finite(change_m)?,
        empirical_m: finite(empirical_m)?,
        theoretical_m: finite(theoretical_m)?,
    })
}

/// Pairs that are told.
const MOST_PAIRS: usize = 20;

/// The pairs without which the ground moves most, or may be wrong most.
fn pairs(outcome: &Outcome) -> Vec<PairSensitivityReport> {
    let mut pairs: Vec<&PairResult> = outcome.pairs.iter().collect();
    let weight = |pair: &PairResult| pair.ground.change_m.max(pair.ground.theoretical_m);
    pairs.sort_by(|a, b| weight(b).total_cmp(&weight(a)));
    let report = |pair: &PairResult| {
        let GroundBounds { change_m, empirical_m, theoretical_m } = pair.ground;
        let name = |index: usize| outcome.control_points.get(index).map(|point| point.name.clone());
        let [a, b] = pair.control_points;
        Some(PairSensitivityReport {
            control_points: [name(a)?, name(b)?],
            test: finite(pair.test)?,
            change_m: finite(change_m)?,
            empirical_m: finite(empirical_m)?,
            theoretical_m: finite(theoretical_m)?,
        })
    };
    pairs.into_iter().take(MOST_PAIRS).filter_map(report).collect()
}

fn ground_point(point: &GroundPrecision, frame: &LocalFrame, output: &Output) -> Option<GroundPoint> {
    Some(GroundPoint {
        image_px: pixel(point.image_px)?,
        ground: output.position(frame.to_geocentric(point.ground_m)).ok()?,
        sigma_planimetric_m: finite(point.sigma_planimetric_m)?,
    })
}

fn diagnosis(diagnosis: &Diagnosis, decides: ClassifierUsed) -> DiagnosisReport {
    DiagnosisReport {
        verdict: verdict_name(diagnosis.verdict),
        score: finite(diagnosis.score),
        threshold: finite(diagnosis.threshold),
        probability_correct: finite(diagnosis.probability_correct),
        features: diagnosis.features.as_ref().map(features),
        reasons: diagnosis
            .reasons
            .iter()
            .map(|reason| ReasonReport { code: reason.code, detail: reason.detail.clone() })
            .collect(),
        probably_right: diagnosis.probably_right.clone(),
        probably_wrong: diagnosis.probably_wrong.clone(),
        classifier: decides,
    }
}

fn consensus(consensus: &ConsensusResult) -> ConsensusReport {
    ConsensusReport {
        search: consensus.guarantee.name(),
        subsets_examined: consensus.subsets,
        control_points: consensus.control_points,
        inliers: consensus.inliers,
    }
}

fn features(features: &Features) -> FeatureReport {
    FeatureReport {
        control_points: features.control_points,
        eliminated: features.eliminated,
        log_sigma0: finite(features.log_sigma0),
        log_configuration: finite(features.log_configuration),
    }
}

#[cfg(test)]
mod tests;
