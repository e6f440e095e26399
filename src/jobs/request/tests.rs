use nalgebra::Vector2;
use rstest::rstest;
use serde_json::{Value, json};

use super::*;
use crate::geometry::Brown;
use crate::imagery::North;
use crate::jobs::active::shipped_classifier;
use crate::report::Origin;

fn camera() -> Camera {
    Camera::new([4000, 3000], 2890.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap()
}

fn bare() -> ImageFacts {
    ImageFacts { size_px: [4000, 3000], ..ImageFacts::default() }
}

fn with_exif() -> ImageFacts {
    let position =
        ExifPosition { longitude_deg: -98.09, latitude_deg: 30.16, altitude_m: Some(317.3), horizontal_error_m: None };
    let heading = ExifHeading { heading_deg: 200.0, north: North::True };
    ImageFacts { position: Some(position), heading: Some(heading), ..bare() }
}

fn complete() -> Value {
    json!({
        "image": "0190", "camera": "canon",
        "approximation": {
            "position": {"crs": "EPSG:4979", "coordinates": [-98.09, 30.16, 317.3]},
            "sigma_position_m": [3, 3, 5], "omega_deg": 1, "phi_deg": -2, "kappa_deg": 12.5,
            "sigma_tilt_deg": 3, "sigma_kappa_deg": 3},
        "tolerance_gsd": 10, "control": "lines", "output_crs": "EPSG:32614"})
}

fn request(value: Value) -> OrientationRequest {
    serde_json::from_value(value).unwrap()
}

/// The request with another value at a pointer.
fn with(pointer: &str, value: Value) -> OrientationRequest {
    let mut body = complete();
    match body.pointer_mut(pointer) {
        Some(place) => *place = value,
        None => {
            let (parent, key) = pointer.rsplit_once('/').unwrap();
            body.pointer_mut(parent).unwrap()[key] = value;
        }
    }
    request(body)
}

#[test]
fn a_complete_request_is_taken_as_it_is() {
    let prepared = request(complete()).prepare(Some([4000, 3000]), &bare()).unwrap();
    assert_eq!(prepared.approximation.kappa_deg, Some(12.5));
    assert_eq!(prepared.approximation.origin.position, Origin::Request);
    assert_eq!(prepared.output_crs, "EPSG:32614");
    assert_eq!(prepared.tolerance, ToleranceGiven::Gsd(10.0));
    // heights in a map grid are not said to be ellipsoidal by anybody
    assert_eq!(prepared.warnings[0].code, "vertical_assumed_ellipsoidal");
    let again: Prepared = serde_json::from_value(serde_json::to_value(&prepared).unwrap()).unwrap();
    assert_eq!(again, prepared);
}

#[rstest]
#[case("/approximation/position/crs", json!("EPSG:1234567"), "/approximation/position/crs")]
#[case("/approximation/position/crs", json!("EPSG:25832+7837"), "/approximation/position/crs")]
#[case("/approximation/position/coordinates", json!([-98.09, 91.0, 3.0]), "/approximation/position/coordinates/1")]
#[case("/approximation/position/coordinates", json!([-98.09, 30.0, 1e9]), "/approximation/position/coordinates/2")]
#[case("/approximation/position/vertical", json!({"geoid_undulation_m": 900.0}),
    "/approximation/position/vertical/geoid_undulation_m")]
#[case("/approximation/vertical", json!({"geoid_undulation_m": 9.0}), "/approximation/vertical")]
#[case("/approximation/sigma_position_m", json!([3, 0, 5]), "/approximation/sigma_position_m/1")]
#[case("/approximation/sigma_position_m", json!([3, 3, 1e7]), "/approximation/sigma_position_m/2")]
#[case("/approximation/omega_deg", json!(90), "/approximation/omega_deg")]
#[case("/approximation/phi_deg", json!(-120), "/approximation/phi_deg")]
#[case("/approximation/kappa_deg", json!(1e6), "/approximation/kappa_deg")]
#[case("/approximation/sigma_tilt_deg", json!(-1), "/approximation/sigma_tilt_deg")]
#[case("/approximation/sigma_tilt_deg", json!(0), "/approximation/sigma_tilt_deg")]
#[case("/approximation/sigma_kappa_deg", json!(400), "/approximation/sigma_kappa_deg")]
#[case("/tolerance_gsd", json!(0), "/tolerance_gsd")]
#[case("/tolerance_gsd", json!(1e9), "/tolerance_gsd")]
#[case("/tolerance_m", json!(1), "/tolerance_m")]
#[case("/output_crs", json!("EPSG:0"), "/output_crs")]
#[case("/output_crs", json!("EPSG:25832"), "/output_crs")]
#[case("/output_crs", json!("EPSG:32614+5703"), "/output_crs")]
fn a_bad_field_is_named(#[case] pointer: &str, #[case] value: Value, #[case] named: &str) {
    let faults = with(pointer, value).prepare(Some([4000, 3000]), &bare()).unwrap_err();
    assert_eq!(faults.iter().map(|fault| fault.pointer.as_str()).collect::<Vec<_>>(), [named], "{faults:?}");
}

#[rstest]
#[case(json!("lines"), [true, false])]
#[case(json!("scenes"), [false, true])]
#[case(json!("both"), [true, true])]
#[case(Value::Null, [true, true])]
fn the_control_is_that_which_was_chosen(#[case] control: Value, #[case] wanted: [bool; 2]) {
    let prepared = with("/control", control).prepare(Some([4000, 3000]), &bare()).unwrap();
    let again: Prepared = serde_json::from_value(serde_json::to_value(&prepared).unwrap()).unwrap();
    assert_eq!([again.wanted().kinds.lines, again.wanted().kinds.scenes], wanted);
}

#[test]
fn what_was_prepared_before_there_were_scenes_is_understood() {
    let prepared = request(complete()).prepare(Some([4000, 3000]), &bare()).unwrap();
    let mut stored = serde_json::to_value(prepared).unwrap();
    stored.as_object_mut().unwrap().remove("control").unwrap();
    let again: Prepared = serde_json::from_value(stored).unwrap();
    assert_eq!(again.control, ControlChoice::Both);
}

#[test]
fn all_faults_are_named_at_once() {
    let mut body = complete();
    body["approximation"]["omega_deg"] = json!(100);
    body["tolerance_gsd"] = json!(-1);
    body["approximation"]["position"]["crs"] = json!("nonsense");
    let faults = request(body).prepare(Some([4000, 3000]), &bare()).unwrap_err();
    assert_eq!(faults.len(), 3, "{faults:?}");
}

#[test]
fn the_camera_s_frame_is_that_of_the_image() {
    let turned = ImageFacts { size_px: [3000, 4000], ..bare() };
    let faults = request(complete()).prepare(Some([4000, 3000]), &turned).unwrap_err();
    assert_eq!(faults[0].pointer, "/camera");
    assert!(faults[0].detail.contains("3000 x 4000"), "{}", faults[0].detail);
}

#[test]
fn what_is_left_out_comes_from_the_image_file() {
    let used = request(json!({"image": "0190", "camera": "c"})).prepare(Some([4000, 3000]), &with_exif()).unwrap();
    let approximation = &used.approximation;
    assert_eq!(approximation.position.coordinates, [-98.09, 30.16, 317.3]);
    assert_eq!((approximation.omega_deg, approximation.phi_deg, approximation.sigma_tilt_deg), (0.0, 0.0, 5.0));
    // a heading of 200 degrees clockwise is a kappa of 160 counter-clockwise
    assert_eq!((approximation.kappa_deg, approximation.sigma_kappa_deg), (Some(160.0), Some(15.0)));
    assert_eq!(approximation.origin.kappa, Origin::Exif);
    assert_eq!(approximation.sigma_position_m[..2], [15.0, 15.0]);
    assert!(approximation.sigma_position_m[2] > 40.0, "the geoid is not known");
    assert_eq!(used.warnings[0].code, "geoid_undulation_unknown");
    assert_eq!(used.output_crs, "EPSG:4979");
}

#[test]
fn an_undulation_makes_the_exif_altitude_ellipsoidal() {
    let body = json!({"image": "0190", "camera": "c", "approximation": {"vertical": {"geoid_undulation_m": -27.0}}});
    let prepared = request(body).prepare(Some([4000, 3000]), &with_exif()).unwrap();
    assert_eq!(prepared.approximation.sigma_position_m, [15.0, 15.0, 30.0]);
    assert!(prepared.warnings.is_empty());
    let work = prepared.work(CameraModel::Digital(camera()), &shipped_classifier().unwrap()).unwrap();
    assert!((work.approximation.orientation.projection_centre_m.z - 290.3).abs() < 1e-6);
    // the result has its heights above the geoid, as the position had
    assert_eq!(work.output.geoid_undulation_m, Some(-27.0));
}

#[test]
fn a_receiver_that_knows_its_error_is_believed_but_not_below_a_metre() {
    for (error_m, sigma_m) in [(4.0, 4.0), (0.02, 1.0)] {
        let position = with_exif().position.map(|p| ExifPosition { horizontal_error_m: Some(error_m), ..p });
        let facts = ImageFacts { position, ..with_exif() };
        let prepared = request(json!({"image": "0190", "camera": "c"})).prepare(Some([4000, 3000]), &facts).unwrap();
        assert_eq!(prepared.approximation.sigma_position_m[..2], [sigma_m, sigma_m]);
    }
}

#[test]
fn without_any_position_there_is_nothing_to_begin_with() {
    let faults = request(json!({"image": "0190", "camera": "c"})).prepare(Some([4000, 3000]), &bare()).unwrap_err();
    assert_eq!(faults[0].pointer, "/approximation/position");
    let position = with_exif().position.map(|position| ExifPosition { altitude_m: None, ..position });
    let no_altitude = ImageFacts { position, ..bare() };
    let faults =
        request(json!({"image": "0190", "camera": "c"})).prepare(Some([4000, 3000]), &no_altitude).unwrap_err();
    assert!(faults[0].detail.contains("altitude"), "{}", faults[0].detail);
}

#[test]
fn an_unknown_kappa_opens_the_whole_circle() {
    let mut body = complete();
    let approximation = body["approximation"].as_object_mut().unwrap();
    approximation.remove("kappa_deg");
    approximation.remove("sigma_kappa_deg");
    let work = request(body.clone())
        .prepare(Some([4000, 3000]), &bare())
        .unwrap()
        .work(CameraModel::Digital(camera()), &shipped_classifier().unwrap())
        .unwrap();
    assert_eq!(work.approximation.sigma_kappa_rad, None);
    body["approximation"]["sigma_kappa_deg"] = json!(3);
    let faults = request(body).prepare(Some([4000, 3000]), &bare()).unwrap_err();
    assert_eq!(faults[0].pointer, "/approximation/sigma_kappa_deg");
}

#[test]
fn the_work_is_in_the_frame_at_the_foot_of_the_position() {
    let work = request(complete())
        .prepare(Some([4000, 3000]), &bare())
        .unwrap()
        .work(CameraModel::Digital(camera()), &shipped_classifier().unwrap())
        .unwrap();
    let centre = work.approximation.orientation.projection_centre_m;
    assert!((centre - Vector3::new(0.0, 0.0, 317.3)).norm() < 1e-6, "{centre}");
    assert_eq!(work.tolerance, Tolerance::Gsd(10.0));
    let [omega, phi, kappa] = rotation::angles(&work.approximation.orientation.camera_from_object);
    for (angle, degrees) in [(omega, 1.0), (phi, -2.0), (kappa, 12.5_f64)] {
        assert!((angle.to_degrees() - degrees).abs() < 1e-9);
    }
}

#[rstest]
#[case(json!({"image": "a", "camera": "b", "colour": "red"}))]
#[case(json!({"image": "a", "camera": "b", "approximation": {"omega": 1}}))]
#[case(json!({"image": "a", "camera": "b", "approximation": {"position": {"crs": "x", "coordinates": [1, 2]}}}))]
#[case(json!({"image": "a", "camera": "b", "control": "points"}))]
#[case(json!({"camera": "b"}))]
fn what_the_contract_does_not_know_is_refused(#[case] body: Value) {
    assert!(serde_json::from_value::<OrientationRequest>(body).is_err());
}
