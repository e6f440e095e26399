use approx::assert_relative_eq;
use nalgebra::Vector6;
use serde_json::{Value, json};

use super::*;
use crate::diagnosis::Reason;
use crate::geometry::{ExteriorOrientation, Segment2};
use crate::pipeline::{ControlKind, EdgeResult, Guarantee};

fn frame() -> LocalFrame {
    LocalFrame::at(16.6, 52.77, 0.0)
}

fn orientation() -> ExteriorOrientation {
    ExteriorOrientation {
        projection_centre_m: Vector3::new(31.0, -12.0, 412.0),
        camera_from_object: rotation::camera_from_object(0.12, -0.07, 2.1),
    }
}

/// A covariance with correlations between everything.
fn local_covariance() -> Matrix6<f64> {
    let root =
        Matrix6::from_fn(|row, column| ((row * 7 + column * 3) % 5) as f64 * 0.01 + f64::from(row == column) * 0.1);
    let scale = Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3));
    scale * root * root.transpose() * scale
}

fn decides() -> ClassifierUsed {
    ClassifierUsed { name: "shipped".into(), kind: "paper".into(), sha256: "00".into() }
}

fn outcome() -> Outcome {
    let point = |used| ControlPointResult {
        name: "church".into(),
        kind: ControlKind::Lines,
        predicted_px: Some(Vector2::new(100.0, 200.0)),
        search_region_px: None,
        located_px: Some(Vector2::new(110.0, 190.0)),
        projected_px: None,
        used,
        segments_matched: 7,
        residual_px: Some(0.4),
        sensitivity: Some(ControlPointSensitivity {
            discrepancy_px: Vector2::new(1.0, -2.0),
            test: 3.0,
            contradicts: false,
            ground: GroundBounds { change_m: 0.1, empirical_m: 0.2, theoretical_m: 0.3 },
        }),
    };
    let segment = Segment2 { start: Vector2::new(1.0, 2.0), end: Vector2::new(3.0, 4.0) };
    Outcome {
        cost: None,
        evidence: None,
        trials: vec![],
        ground_height_m: None,
        footprint_m: Vec::new(),
        check_points: Vec::new(),
        pairs: vec![PairResult {
            control_points: [0, 0],
            test: 4.0,
            ground: GroundBounds { change_m: 0.4, empirical_m: 0.5, theoretical_m: 0.6 },
        }],
        estimate: Some(Estimate {
            orientation: orientation(),
            covariance: local_covariance(),
            sigma0: 1.1,
            redundancy: 120,
            configuration: 2.3,
        }),
        control_points: vec![point(true)],
        edges: vec![EdgeResult { control_point: 0, projected_px: segment, matched_px: vec![segment] }],
        ground_precision: vec![GroundPrecision {
            image_px: Vector2::new(200.0, 150.0),
            ground_m: Vector3::new(10.0, 20.0, 112.0),
            sigma_planimetric_m: 0.05,
        }],
        consensus: Some(ConsensusResult {
            guarantee: Guarantee::Bounded { at_most: 12 },
            subsets: 5400,
            control_points: 12,
            inliers: 11,
        }),
        diagnosis: Diagnosis {
            verdict: Verdict::Green,
            score: 3.1,
            threshold: 2.0,
            probability_correct: 0.99,
            features: Some(Features { control_points: 12, eliminated: 1, log_sigma0: 0.1, log_configuration: 0.8 }),
            reasons: vec![Reason { code: "fine", detail: "Everything agrees.".into() }],
            probably_right: vec!["church".into()],
            probably_wrong: vec![],
        },
    }
}

fn approximation() -> ApproximationUsed {
    ApproximationUsed {
        position: Position { crs: "EPSG:4979".into(), coordinates: [16.6, 52.77, 400.0], vertical: None },
        sigma_position_m: [3.0, 3.0, 5.0],
        omega_deg: 0.0,
        phi_deg: 0.0,
        kappa_deg: None,
        sigma_tilt_deg: 5.0,
        sigma_kappa_deg: None,
        origin: ApproximationOrigin { position: Origin::Request, tilt: Origin::Default, kappa: Origin::Unknown },
    }
}

fn output(crs: &str) -> Output {
    Output { crs: Crs::parse(crs).unwrap(), geoid_undulation_m: None }
}

fn reported(outcome: &Outcome, crs: &str) -> OrientationResult {
    result(outcome, &frame(), &output(crs), approximation(), vec![], decides()).unwrap()
}

fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| rows[row][column])
}

const ELSEWHERE: &str = "+proj=topocentric +ellps=WGS84 +lon_0=16.7 +lat_0=52.7 +h_0=40";

/// The camera sees a point in the same direction, in whatever frame it is computed.
#[test]
fn the_rotation_in_another_tangent_plane_sees_the_same() {
    let result = reported(&outcome(), ELSEWHERE);
    let ground_m = Vector3::new(120.0, 77.0, 80.0);
    let ground_there = output(ELSEWHERE).position(frame().to_geocentric(ground_m)).unwrap();
    let rotation = result.rotation.unwrap();
    let centre = Vector3::from(result.projection_centre.unwrap().coordinates);
    let seen = matrix(&rotation.rotation_matrix) * (Vector3::from(ground_there) - centre);
    assert_relative_eq!(seen, orientation().camera_coordinates(ground_m), epsilon = 1e-6);
    assert_eq!(rotation.frame, ELSEWHERE);
}

/// A map grid is turned by the convergence of the meridians (1.9 degrees here), and scaled by no more than 5e-4.
#[test]
fn the_rotation_in_a_map_grid_sees_nearly_the_same() {
    let grid = "EPSG:25832";
    let frame = LocalFrame::at(11.4, 52.0, 0.0);
    let result = result(&outcome(), &frame, &output(grid), approximation(), vec![], decides()).unwrap();
    let ground_m = Vector3::new(220.0, 177.0, 80.0);
    let ground_there = output(grid).position(frame.to_geocentric(ground_m)).unwrap();
    let centre = Vector3::from(result.projection_centre.unwrap().coordinates);
    let rotation = result.rotation.unwrap();
    let seen = matrix(&rotation.rotation_matrix) * (Vector3::from(ground_there) - centre);
    let expected = orientation().camera_coordinates(ground_m);
    assert!((seen.normalize() - expected.normalize()).norm() < 5e-4, "{seen} {expected}");
    assert_eq!(rotation.frame, grid);
    let turn = (rotation.kappa_deg - 2.1_f64.to_degrees()).abs();
    assert!((1.5..2.3).contains(&turn), "{turn} degrees of convergence");
}

#[test]
fn a_geographic_result_has_the_axes_of_the_place() {
    let result = reported(&outcome(), "EPSG:4979");
    let rotation = result.rotation.unwrap();
    let place = Crs::parse(&rotation.frame).unwrap();
    let here = place.position_from_geocentric(frame().to_geocentric(orientation().projection_centre_m), None).unwrap();
    assert!(Vector3::from(here).norm() < 1e-6, "{here:?}");
    // the local frame's origin is 33 m away: its axes are the same within 33 m / 6378 km
    let difference = matrix(&rotation.rotation_matrix) - orientation().camera_from_object.matrix();
    assert!(difference.norm() < 2e-5, "{difference}");
}

/// Every parameter moved by hand, through the whole report, against the covariance that is reported.
#[test]
fn the_covariance_is_that_of_finite_differences() {
    // the axes of a geographic result turn with the place, by 1 / 6378 km, which is not carried through
    for (crs, tolerance) in [(ELSEWHERE, 1e-6), ("EPSG:4979", 1e-3)] {
        let parameters = |step: Vector6<f64>| {
            let mut moved = outcome();
            moved.estimate.as_mut().unwrap().orientation = orientation().moved(&step);
            let reported = reported(&moved, crs);
            let rotation = reported.rotation.unwrap();
            // metres along fixed axes, also where the CRS has degrees
            let centre = reported.projection_centre.unwrap().coordinates;
            let geocentric = Crs::parse(crs).unwrap().geocentric_from_position(centre, None).unwrap();
            let axes = output(crs).crs.axes_from_geocentric(frame().to_geocentric(orientation().projection_centre_m));
            let metres = axes.unwrap() * (geocentric - frame().to_geocentric(orientation().projection_centre_m));
            let angles = [rotation.omega_deg, rotation.phi_deg, rotation.kappa_deg].map(f64::to_radians);
            Vector6::new(metres.x, metres.y, metres.z, angles[0], angles[1], angles[2])
        };
        let mut jacobian = Matrix6::zeros();
        for parameter in 0..6 {
            let size = if parameter < 3 { 0.1 } else { 1e-5 };
            let step = Vector6::ith(parameter, size);
            jacobian.set_column(parameter, &((parameters(step) - parameters(-step)) / (2.0 * size)));
        }
        let expected = jacobian * local_covariance() * jacobian.transpose();
        let reported = reported(&outcome(), crs).covariance.unwrap();
        let reported = Matrix6::from_fn(|row, column| reported.matrix[row][column]);
        for (row, column) in (0..6).flat_map(|row| (0..6).map(move |column| (row, column))) {
            let scale = (expected[(row, row)] * expected[(column, column)]).sqrt();
            let difference = (reported[(row, column)] - expected[(row, column)]).abs();
            assert!(difference < tolerance * scale, "{crs} [{row}, {column}]: {reported} {expected}");
        }
    }
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

/// The names of the contract, from the example in `api.md`.
#[test]
fn the_json_has_the_names_of_the_contract() {
    let value = serde_json::to_value(reported(&outcome(), "EPSG:25833")).unwrap();
    let sorted = |mut names: Vec<&'static str>| {
        names.sort_unstable();
        names
    };
    let expect = |pointer: &str, names: Vec<&'static str>| {
        let mut found = keys(value.pointer(pointer).unwrap());
        found.sort_unstable();
        assert_eq!(found, sorted(names), "{pointer}");
    };
    expect(
        "",
        vec![
            "projection_centre",
            "rotation",
            "covariance",
            "sigma0",
            "redundancy",
            "configuration",
            "control_points",
            "check_points",
            "ground_precision",
            "pairs",
            "consensus",
            "diagnosis",
            "warnings",
            "approximation",
        ],
    );
    expect("/projection_centre", vec!["crs", "coordinates"]);
    expect("/rotation", vec!["frame", "rotation_matrix", "omega_deg", "phi_deg", "kappa_deg"]);
    expect("/covariance", vec!["order", "matrix"]);
    expect(
        "/control_points/0",
        vec!["name", "kind", "predicted_px", "located_px", "used", "segments_matched", "residual_px", "sensitivity"],
    );
    let sensitivity = vec!["discrepancy_px", "test", "contradicts", "change_m", "empirical_m", "theoretical_m"];
    expect("/control_points/0/sensitivity", sensitivity);
    expect("/pairs/0", vec!["control_points", "test", "change_m", "empirical_m", "theoretical_m"]);
    expect("/ground_precision/0", vec!["image_px", "ground", "sigma_planimetric_m"]);
    expect("/consensus", vec!["search", "subsets_examined", "control_points", "inliers"]);
    expect(
        "/diagnosis",
        vec![
            "verdict",
            "score",
            "threshold",
            "probability_correct",
            "features",
            "reasons",
            "probably_right",
            "probably_wrong",
            "classifier",
        ],
    );
    expect("/diagnosis/classifier", vec!["name", "kind", "sha256"]);
    expect("/diagnosis/features", vec!["control_points", "eliminated", "log_sigma0", "log_configuration"]);
    expect("/diagnosis/reasons/0", vec!["code", "detail"]);
    assert_eq!(value["covariance"]["order"], json!(["x_m", "y_m", "z_m", "omega_rad", "phi_rad", "kappa_rad"]));
    assert_eq!(value["diagnosis"]["verdict"], "green");
    let consensus = json!({"search": "bounded", "subsets_examined": 5400, "control_points": 12, "inliers": 11});
    assert_eq!(value["consensus"], consensus);
    assert_eq!(value["approximation"]["origin"], json!({"position": "request", "tilt": "default", "kappa": "unknown"}));
}

#[test]
fn what_does_not_exist_is_left_out() {
    let mut red = outcome();
    red.estimate = None;
    red.consensus = None;
    red.ground_precision.clear();
    red.diagnosis = Diagnosis { verdict: Verdict::Red, score: f64::NEG_INFINITY, features: None, ..red.diagnosis };
    let value = serde_json::to_value(reported(&red, "EPSG:25833")).unwrap();
    for absent in ["projection_centre", "rotation", "covariance", "sigma0", "redundancy", "configuration", "consensus"]
    {
        assert!(value.get(absent).is_none(), "{absent}");
    }
    assert!(value["diagnosis"].get("score").is_none());
    assert_eq!(value["diagnosis"]["verdict"], "red");
}

#[test]
fn no_number_that_is_none_leaves_the_service() {
    let mut broken = outcome();
    broken.estimate.as_mut().unwrap().covariance[(2, 2)] = f64::NAN;
    broken.control_points[0].residual_px = Some(f64::INFINITY);
    let value = serde_json::to_value(reported(&broken, "EPSG:25833")).unwrap();
    assert!(value.get("covariance").is_none());
    assert!(value["control_points"][0].get("residual_px").is_none());
    let mut broken = outcome();
    broken.estimate.as_mut().unwrap().orientation.projection_centre_m.x = f64::NAN;
    assert!(reported(&broken, "EPSG:25833").projection_centre.is_none());
}
