//! What was found against the truth.

use std::fmt::Write as _;

use crate::diagnosis::external::d_max_m;
use crate::geometry::{ExteriorOrientation, rotation};
use crate::report::Position;
use crate::simulation::Scene;
use anyhow::bail;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Deserialize;

/// What the answer may err on the ground: the contract's default.
pub(super) const TOLERANCE_GSD: f64 = 10.0;

/// The service's result, as far as it is of interest here.
#[derive(Debug, Deserialize)]
pub(super) struct Found {
    projection_centre: Option<Position>,
    rotation: Option<Rotation>,
    covariance: Option<Covariance>,
    control_points: Vec<ControlPoint>,
    diagnosis: Diagnosis,
}

#[derive(Debug, Deserialize)]
struct Rotation {
    frame: String,
    rotation_matrix: [[f64; 3]; 3],
}

#[derive(Debug, Deserialize)]
struct Covariance {
    matrix: [[f64; 6]; 6],
}

#[derive(Debug, Deserialize)]
struct ControlPoint {
    name: String,
    located_px: Option<[f64; 2]>,
    used: bool,
}

#[derive(Debug, Deserialize)]
struct Diagnosis {
    verdict: String,
    reasons: Vec<Reason>,
}

#[derive(Debug, Deserialize)]
struct Reason {
    code: String,
    detail: String,
}

/// The result and its true error.
#[derive(Debug)]
pub(super) struct Comparison {
    found: Found,
    orientation: Option<ExteriorOrientation>,
    d_max_m: Option<f64>,
    gsd_m: f64,
}

impl Comparison {
    pub(super) fn new(scene: &Scene, found: Option<Found>) -> anyhow::Result<Self> {
        let Some(found) = found else { bail!("the service has answered without a result") };
        let orientation = match (&found.projection_centre, &found.rotation) {
            (Some(centre), Some(rotation)) if centre.crs == scene.crs() && rotation.frame == scene.crs() => {
                let rows = Matrix3::from_row_slice(rotation.rotation_matrix.as_flattened());
                let projection_centre_m = Vector3::from(centre.coordinates);
                let camera_from_object = Rotation3::from_matrix_unchecked(rows);
                Some(ExteriorOrientation { projection_centre_m, camera_from_object })
            }
            (Some(centre), _) => bail!("the result is in {}, not in {} as asked", centre.crs, scene.crs()),
            _ => None,
        };
        let error = |found| d_max_m(&scene.camera, found, &scene.true_orientation, scene.ground_height_m());
        let d_max_m = orientation.as_ref().and_then(error);
        Ok(Self { found, orientation, d_max_m, gsd_m: scene.ground_sample_distance_m() })
    }

    fn is_right(&self) -> bool {
        self.d_max_m.is_some_and(|error_m| error_m <= TOLERANCE_GSD * self.gsd_m)
    }

    /// # Errors
    /// Unless the orientation is right, and the verdict says so.
    pub(super) fn accepted(&self) -> anyhow::Result<()> {
        match (self.is_right(), self.found.diagnosis.verdict.as_str()) {
            (true, "green") => Ok(()),
            (true, verdict) => bail!("the orientation is right, but the verdict is {verdict}"),
            (false, "green") => bail!("the orientation is wrong, and the verdict does not say so"),
            (false, _) => bail!("the orientation is wrong, as the verdict says"),
        }
    }

    /// The verdict, the six parameters and the true error, for people.
    pub(super) fn text(&self, scene: &Scene) -> String {
        let diagnosis = &self.found.diagnosis;
        let mut text = format!("Verdict: {}\n", diagnosis.verdict.to_uppercase());
        for Reason { code, detail } in &diagnosis.reasons {
            let _ = writeln!(text, "  {detail} ({code})");
        }
        self.control_points(&mut text, scene);
        self.parameters(&mut text, scene);
        let _ = match self.d_max_m {
            None => write!(text, "\nNo orientation was found."),
            Some(error_m) => write!(
                text,
                "\nLargest true error on the ground: {error_m:.3} m = {:.2} GSD. The tolerance is {:.3} m = \
                 {TOLERANCE_GSD} GSD: the orientation is {}.",
                error_m / self.gsd_m,
                TOLERANCE_GSD * self.gsd_m,
                if self.is_right() { "right" } else { "wrong" },
            ),
        };
        text
    }

    fn control_points(&self, text: &mut String, scene: &Scene) {
        let outdated =
            |name: &str| scene.control.iter().any(|point| point.fault.is_some() && point.control_point.name == name);
        let points = &self.found.control_points;
        let located = points.iter().filter(|point| point.located_px.is_some()).count();
        let used: Vec<_> = points.iter().filter(|point| point.used).collect();
        let used_outdated = used.iter().filter(|point| outdated(&point.name)).count();
        let _ = writeln!(
            text,
            "{} control points are in view; {located} were located, {} used, {used_outdated} of these out of date",
            scene.in_view().count(),
            used.len(),
        );
    }

    fn parameters(&self, text: &mut String, scene: &Scene) {
        let Some(orientation) = &self.orientation else { return };
        let approximate = parameters(&scene.approximation.orientation);
        let (found, truth) = (parameters(orientation), parameters(&scene.true_orientation));
        let _ = writeln!(
            text,
            "\n{:<10}{:>13}{:>13}{:>13}{:>11}{:>14}",
            "", "approximate", "found", "true", "sigma", "found - true"
        );
        for (index, name) in ["x, m", "y, m", "z, m", "omega, °", "phi, °", "kappa, °"].into_iter().enumerate() {
            let error = found[index] - truth[index];
            let (unit, error) = if index < 3 { (1.0, error) } else { (1_f64.to_degrees(), around(error)) };
            let sigma = self.found.covariance.as_ref().map_or(f64::NAN, |c| c.matrix[index][index].sqrt() * unit);
            let [approximate, found, truth] = [&approximate, &found, &truth].map(|values| values[index]);
            let _ = writeln!(text, "{name:<10}{approximate:>13.4}{found:>13.4}{truth:>13.4}{sigma:>11.4}{error:>14.4}");
        }
    }
}

/// Projection centre in metres, then omega, phi, kappa in degrees.
fn parameters(orientation: &ExteriorOrientation) -> [f64; 6] {
    let [x, y, z] = orientation.projection_centre_m.into();
    let [omega, phi, kappa] = rotation::angles(&orientation.camera_from_object).map(f64::to_degrees);
    [x, y, z, omega, phi, kappa]
}

/// A difference of angles the short way round.
fn around(difference_deg: f64) -> f64 {
    (difference_deg + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::SceneSettings;
    use serde_json::json;

    fn scene() -> Scene {
        Scene::draw(1, &SceneSettings::default()).unwrap()
    }

    /// The truth as the service would answer it, moved to the east.
    fn answer(scene: &Scene, east_m: f64, verdict: &str) -> Found {
        let truth = scene.truth();
        let mut centre: [f64; 3] = scene.true_orientation.projection_centre_m.into();
        centre[0] += east_m;
        serde_json::from_value(json!({
            "projection_centre": {"crs": truth["frame"], "coordinates": centre},
            "rotation": {"frame": truth["frame"], "rotation_matrix": truth["rotation_matrix"]},
            "control_points": [{"name": "house-001", "used": true}],
            "diagnosis": {"verdict": verdict, "reasons": [{"code": "why", "detail": "Because."}]},
        }))
        .unwrap()
    }

    #[test]
    fn only_a_right_answer_with_a_green_verdict_is_accepted() {
        let scene = scene();
        let tolerance_m = TOLERANCE_GSD * scene.ground_sample_distance_m();
        for (east_m, verdict, refusal) in [
            (0.0, "green", None),
            (0.99 * tolerance_m, "green", None),
            (1.01 * tolerance_m, "green", Some("does not say so")),
            (1.01 * tolerance_m, "red", Some("as the verdict says")),
            (0.0, "yellow", Some("is right, but the verdict is yellow")),
        ] {
            let compared = Comparison::new(&scene, Some(answer(&scene, east_m, verdict))).unwrap();
            assert!((compared.d_max_m.unwrap() - east_m).abs() < 1e-6);
            match (compared.accepted(), refusal) {
                (Ok(()), None) => {}
                (Err(error), Some(refusal)) => assert!(error.to_string().contains(refusal), "{error}"),
                (accepted, _) => panic!("{east_m} m, {verdict}: {accepted:?}"),
            }
        }
    }

    #[test]
    fn nothing_found_is_not_right() {
        let scene = scene();
        let nothing = json!({"control_points": [], "diagnosis": {"verdict": "red", "reasons": []}});
        let compared = Comparison::new(&scene, serde_json::from_value(nothing).unwrap()).unwrap();
        assert!(compared.accepted().is_err());
        assert!(compared.text(&scene).contains("No orientation was found"));
    }

    #[test]
    fn errors_are_told_in_metres_and_in_ground_sample_distances() {
        let scene = scene();
        let text = Comparison::new(&scene, Some(answer(&scene, 0.5, "yellow"))).unwrap().text(&scene);
        let gsd = 0.5 / scene.ground_sample_distance_m();
        for told in ["Verdict: YELLOW", "Because. (why)", "0.500 m", &format!("{gsd:.2} GSD"), "1 used"] {
            assert!(text.contains(told), "{told}: {text}");
        }
    }

    #[test]
    fn angles_differ_the_short_way_round() {
        assert!((around(359.0) + 1.0).abs() < 1e-12);
        assert!((around(-359.0) - 1.0).abs() < 1e-12);
    }
}
