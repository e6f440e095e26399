use serde_json::{Value, json};

use super::*;
use crate::interior::{Cut, Side};

fn body() -> Value {
    let mark = |name: &str, x: f64, y: f64| json!({"name": name, "position_mm": [x, y], "template": "leica_rc30"});
    json!({
        "name": "rc30", "principal_distance_mm": 153.21, "principal_point_mm": [0.004, -0.002],
        "fiducials": [mark("1", -106.0, -106.0), mark("2", 106.0, -106.0), mark("3", 106.0, 106.0), mark("4", -106.0, 106.0)]})
}

fn defined(body: Value) -> Result<FilmCameraDefinition, Vec<String>> {
    let request: FilmCameraRequest = serde_json::from_value(body).unwrap();
    let definition = request.definition(&Templates::new());
    definition.map_err(|faults| faults.into_iter().map(|fault| fault.pointer).collect())
}

#[test]
fn a_definition_becomes_the_camera_that_it_describes() {
    let mut body = body();
    body["fiducials"][1]["template"] = json!("own");
    body["fiducials"][1]["rotation_deg"] = json!(90);
    body["data_strip"] = json!("left");
    body["asymmetric_feature"] = json!({"position_mm": [0, 112], "template": "arrow"});
    body["distortion"] = json!({"model": "smac", "k1": -3e-9, "p2": 2e-8});
    let request: FilmCameraRequest = serde_json::from_value(body).unwrap();
    assert_eq!(request.uploaded_templates(), BTreeSet::from(["own"]));
    let cut = Cut {
        width: 9,
        height: 9,
        grey: vec![0.0; 81],
        care: vec![true; 81],
        centre_px: nalgebra::Vector2::new(4.5, 4.5),
        pixel_mm: 0.02,
    };
    let own = Arc::new(Mark::Cut(cut));
    let templates = Templates::from([(String::from("own"), own.clone())]);
    let definition = request.definition(&templates).unwrap();
    // what is kept reads back as it was
    let text = serde_json::to_string(&definition).unwrap();
    assert_eq!(serde_json::from_str::<FilmCameraDefinition>(&text).unwrap(), definition);
    let camera = definition.camera(&templates).unwrap();
    assert_eq!(camera.film.distortion.k, [0.0, -3e-9, 0.0, 0.0, 0.0]);
    assert_eq!(camera.film.distortion.p, [0.0, 2e-8, 0.0, 0.0]);
    assert_eq!(camera.film.symmetry_point_mm, camera.film.principal_point_mm);
    assert_eq!((camera.film.format_mm, camera.plate.format_mm), (FORMAT_MM, FORMAT_MM));
    assert_eq!(camera.plate.data_strip, Some(Side::Left));
    assert_eq!(camera.plate.fiducials[1].mark, own);
    assert!((camera.plate.fiducials[1].rotation_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    assert_eq!(*camera.plate.asymmetric.unwrap().mark, Mark::Library(Library::Arrow));
    let missing = definition.camera(&Templates::new()).unwrap_err();
    assert_eq!(missing, DefinitionError::NoTemplate { name: "own".into() });
}

#[test]
fn a_table_is_taken_away_from_what_was_measured() {
    let mut body = body();
    body["distortion"] =
        json!({"model": "table", "radius_mm": [20, 50, 80, 110, 140], "distortion_um": [2, 5, 8, 11, 14]});
    let camera = defined(body).unwrap().camera(&Templates::new()).unwrap();
    let measured = camera.film.principal_point_mm + nalgebra::Vector2::new(100.0, 0.0);
    let moved_um = (camera.film.corrected_mm(measured) - measured).x * 1e3;
    assert!((moved_um + 10.0).abs() < 0.01, "{moved_um}");
}

#[test]
fn distances_move_the_marks() {
    let mut body = body();
    let pairs = [["1", "2"], ["2", "3"], ["3", "4"], ["4", "1"], ["1", "3"], ["2", "4"]];
    let length = |k: usize| if k < 4 { 212.1 } else { 212.1 * 2.0_f64.sqrt() };
    let distances: Vec<Value> =
        pairs.iter().enumerate().map(|(k, pair)| json!({"between": pair, "distance_mm": length(k)})).collect();
    body["fiducial_distances"] = json!(distances);
    let definition = defined(body.clone()).unwrap();
    for fiducial in &definition.fiducials {
        assert_eq!(fiducial.approximate_position_mm.unwrap()[0].abs(), 106.0);
        assert!((fiducial.position_mm[0].abs() - 106.05).abs() < 1e-9);
        assert!((fiducial.sigma_mm - 0.005 * (2.25_f64 / 8.0).sqrt()).abs() < 1e-9, "{}", fiducial.sigma_mm);
    }
    assert_eq!(definition.adjustment.unwrap().redundancy, 1);
    assert!(definition.fiducial_distances.iter().all(|distance| distance.residual_mm.abs() < 1e-9));

    let with = |change: &dyn Fn(&mut Value)| {
        let mut body = body.clone();
        change(&mut body);
        defined(body).unwrap_err()
    };
    let refused = with(&|body| body["fiducial_distances"][5]["distance_mm"] = json!(301.0));
    assert!(refused[0].starts_with("/fiducial_distances/") && refused[0].ends_with("/distance_mm"), "{refused:?}");
    let few = with(&|body| body["fiducial_distances"].as_array_mut().unwrap().truncate(4));
    assert_eq!(few, ["/fiducial_distances"]);
    let unknown = with(&|body| body["fiducial_distances"][2]["between"] = json!(["3", "9"]));
    assert_eq!(unknown, ["/fiducial_distances/2/between/1"]);
    let same = with(&|body| body["fiducial_distances"][2]["between"] = json!(["3", "3"]));
    assert_eq!(same, ["/fiducial_distances/2/between"]);
    let sigma = with(&|body| body["fiducials"][0]["sigma_mm"] = json!(0.002));
    assert_eq!(sigma, ["/fiducials/0/sigma_mm"]);
    // nothing is redundant, but far from where the mark should be
    let far = with(&|body| {
        body["fiducial_distances"].as_array_mut().unwrap().pop();
        body["fiducial_distances"][4]["distance_mm"] = json!(330.0);
    });
    assert!(far.iter().all(|pointer| pointer.ends_with("/position_mm")) && !far.is_empty(), "{far:?}");
}
