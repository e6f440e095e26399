//! A result for people at a terminal.

use std::fmt::Write as _;

use crate::report::OrientationResult;
use crate::report::result::{CheckPointReport, ControlPointReport, CovarianceResult};

pub(in crate::cli) const RESET: &str = "\x1b[0m";
pub(in crate::cli) const DIM: &str = "\x1b[2m";

/// The verdict and why, then the orientation with its standard deviations, then the control points, then the check points.
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
    check_points(&mut text, &result.check_points);
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

/// What no orientation was made from tells how right it is: each check point, and all that were found together.
fn check_points(text: &mut String, points: &[CheckPointReport]) {
    if points.is_empty() {
        return;
    }
    let located = points.iter().filter(|point| point.located_px.is_some()).count();
    let px = root_mean_square(points.iter().filter_map(|point| point.residual_px));
    let metres = root_mean_square(points.iter().filter_map(|point| point.residual_m));
    let _ = write!(text, "\n{} check points expected, {located} located", points.len());
    let _ = match residual(px, metres) {
        Some(together) => writeln!(text, ", root mean square {together}"),
        None => writeln!(text),
    };
    for point in points {
        let off = residual(point.residual_px, point.residual_m).unwrap_or_else(|| "not located".to_owned());
        let _ = writeln!(text, "  {:<32} {:>3} segments, {off}", point.name, point.segments_matched);
    }
}

fn residual(px: Option<f64>, metres: Option<f64>) -> Option<String> {
    let metres = metres.map_or_else(String::new, |metres| format!(" = {metres:.3} m"));
    px.map(|px| format!("{px:.2} px{metres}"))
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values.fold((0_u32, 0.0), |(count, sum), value| (count + 1, sum + value * value));
    (count > 0).then(|| (sum / f64::from(count)).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(name: &str, residual: Option<(f64, f64)>) -> CheckPointReport {
        CheckPointReport {
            name: name.to_owned(),
            predicted_px: [10.0, 20.0],
            located_px: residual.map(|(px, _)| [10.0 + px, 20.0]),
            segments_matched: if residual.is_some() { 7 } else { 0 },
            residual_px: residual.map(|(px, _)| px),
            residual_m: residual.map(|(_, metres)| metres),
        }
    }

    #[test]
    fn check_points_are_told_each_and_together() {
        let mut text = String::new();
        check_points(&mut text, &[point("a", Some((3.0, 0.3))), point("b", None), point("c", Some((4.0, 0.4)))]);
        let lines: Vec<&str> = text.trim_start().lines().map(|line| line.trim_start()).collect();
        assert_eq!(lines[0], "3 check points expected, 2 located, root mean square 3.54 px = 0.354 m");
        assert!(lines[1].starts_with("a ") && lines[1].ends_with("  7 segments, 3.00 px = 0.300 m"));
        assert!(lines[2].starts_with("b ") && lines[2].ends_with("0 segments, not located"));
        assert_eq!(lines.len(), 4);
        let mut none = String::new();
        check_points(&mut none, &[point("b", None)]);
        assert_eq!(none.lines().nth(1), Some("1 check points expected, 0 located"));
        check_points(&mut String::new(), &[]);
    }
}
