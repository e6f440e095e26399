//! A result for people at a terminal.

use std::fmt::Write as _;

use gable::report::OrientationResult;
use gable::report::result::{ControlPointReport, CovarianceResult};

pub(in crate::cli) const RESET: &str = "\x1b[0m";
pub(in crate::cli) const DIM: &str = "\x1b[2m";

/// The verdict and why, then the orientation with its standard deviations, then the control points.
pub(super) fn summary(result: &OrientationResult, colours: bool) -> String {
    let mut text = String::new();
    let paint = |code: &'static str| if colours { code } else { "" };
    let verdict = result.diagnosis.verdict;
    let _ = writeln!(text, "{}{}{}", paint(colour(verdict)), verdict.to_uppercase(), paint(RESET));
    for reason in &result.diagnosis.reasons {
        let _ = writeln!(text, "  {} {}({}){}", reason.detail, paint(DIM), reason.code, paint(RESET));
    }
    orientation(&mut text, result);
    control_points(&mut text, result);
    for warning in &result.warnings {
        let _ = writeln!(text, "\nWarning: {}", warning.detail);
    }
    text.trim_end().to_owned()
}

/// The colour of a verdict.
pub(in crate::cli) fn colour(verdict: &str) -> &'static str {
    match verdict {
        "green" => "\x1b[1;32m",
        "yellow" => "\x1b[1;33m",
        _ => "\x1b[1;31m",
    }
}

fn orientation(text: &mut String, result: &OrientationResult) {
    let (Some(centre), Some(rotation)) = (&result.projection_centre, &result.rotation) else {
        let _ = writeln!(text, "\nNo orientation was found.");
        return;
    };
    let sigma = |index: usize| result.covariance.as_ref().map(|covariance| sigma(covariance, index));
    let _ = writeln!(text, "\nProjection centre in {}", centre.crs);
    for (index, (name, value)) in ["x", "y", "z"].into_iter().zip(centre.coordinates).enumerate() {
        let _ = writeln!(text, "  {name:<8}{value:>18.7}{}", plus_minus(sigma(index), 1.0, "m"));
    }
    let _ = writeln!(text, "Rotation in {}", rotation.frame);
    let angles = [("omega", rotation.omega_deg), ("phi", rotation.phi_deg), ("kappa", rotation.kappa_deg)];
    for (index, (name, value)) in angles.into_iter().enumerate() {
        let _ = writeln!(
            text,
            "  {name:<8}{value:>18.5}{}",
            plus_minus(sigma(index + 3), 180.0 / std::f64::consts::PI, "°")
        );
    }
    let worst = result.ground_precision.iter().map(|point| point.sigma_planimetric_m).fold(0.0, f64::max);
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
    let redundancy = result.redundancy.map_or_else(|| "-".to_owned(), |redundancy| redundancy.to_string());
    let _ = writeln!(
        text,
        "sigma0 {}, redundancy {redundancy}, configuration {}; on the ground {worst:.3} m at worst, if it is right",
        number(result.sigma0),
        number(result.configuration),
    );
}

fn sigma(covariance: &CovarianceResult, index: usize) -> f64 {
    covariance.matrix[index][index].max(0.0).sqrt()
}

fn plus_minus(sigma: Option<f64>, scale: f64, unit: &str) -> String {
    sigma.map_or_else(String::new, |sigma| format!("  ± {:.4} {unit}", sigma * scale))
}

fn control_points(text: &mut String, result: &OrientationResult) {
    let points = &result.control_points;
    let count = |wanted: &dyn Fn(&ControlPointReport) -> bool| points.iter().filter(|point| wanted(point)).count();
    let used = count(&|point| point.used);
    let located = count(&|point| point.located_px.is_some());
    let _ = writeln!(text, "\n{} control points expected, {located} located, {used} used", points.len());
    for point in points.iter().filter(|point| point.used) {
        let residual = point.residual_px.map_or_else(|| "-".to_owned(), |residual| format!("{residual:.2} px"));
        let found = match point.kind {
            "scene" => format!("{:>12}", "scene"),
            _ => format!("{:>3} segments", point.segments_matched),
        };
        let _ = writeln!(text, "  {:<32} {found}, {residual}", point.name);
    }
}
