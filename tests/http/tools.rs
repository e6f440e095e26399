//! The built binary without a service: `gable import` and `gable orient`.

use std::path::Path;
use std::process::Output;

use serde_json::{Value, json};

use crate::command_line::gable;
use crate::support::{camera, png};

fn run(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = gable(folder, arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code(), text(stdout), text(stderr))
}

fn write(folder: &Path, name: &str, value: &Value) {
    std::fs::write(folder.join(name), value.to_string()).unwrap();
}

fn feature(name: &str) -> Value {
    json!({"type": "Feature", "properties": {"name": name, "sigma_m": 0.1},
        "geometry": {"type": "MultiLineString", "coordinates": [[[16.6, 52.7, 70.0], [16.6001, 52.7, 75.0]]]}})
}

fn collection(folder: &Path, features: &[Value]) {
    write(folder, "roofs.geojson", &json!({"type": "FeatureCollection", "features": features}));
}

#[test]
fn import_fills_the_data_folder_and_names_what_it_rejects() {
    let folder = tempfile::tempdir().unwrap();
    collection(folder.path(), &[feature("a"), json!({"type": "Feature"}), feature("b")]);
    let import = ["import", "roofs.geojson", "--crs", "EPSG:4979"];
    let (status, told, _) = run(folder.path(), &import);
    assert_eq!(status, Some(0));
    assert!(told.contains("rejected: feature 1 (without a name): properties are missing"), "{told}");
    assert!(told.ends_with("2 imported, 0 updated, 1 rejected\n"), "{told}");
    let (_, told, _) = run(folder.path(), &[&import[..], &["--json"]].concat());
    let report: Value = serde_json::from_str(&told).unwrap();
    assert_eq!((&report["imported"], &report["updated"]), (&json!(0), &json!(2)));
    let (_, _, warned) = run(folder.path(), &["import", "roofs.geojson", "--crs", "EPSG:25833"]);
    assert!(warned.contains("taken as ellipsoidal"), "{warned}");
}

#[test]
fn import_of_what_cannot_be_used_fails_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    collection(folder.path(), &[json!({"type": "Feature"})]);
    let (status, _, told) = run(folder.path(), &["import", "roofs.geojson", "--crs", "EPSG:4979"]);
    assert_eq!((status, told.contains("nothing was imported")), (Some(1), true), "{told}");
    let (status, _, told) = run(folder.path(), &["import", "none.geojson", "--crs", "EPSG:4979"]);
    assert_eq!((status, told.contains("cannot read none.geojson")), (Some(1), true), "{told}");
    let (status, _, told) = run(folder.path(), &["import", "roofs.geojson", "--crs", "EPSG:1"]);
    assert_eq!((status, told.contains("not known; known are")), (Some(2), true), "{told}");
    std::fs::write(folder.path().join("roofs.geojson"), "{").unwrap();
    let (status, _, told) = run(folder.path(), &["import", "roofs.geojson", "--crs", "EPSG:4979"]);
    assert_eq!((status, told.contains("not valid JSON")), (Some(1), true), "{told}");
}

/// A picture that shows nothing: the answer is a red verdict with its reasons, no error.
#[test]
fn orient_prints_the_json_of_the_api() {
    let folder = tempfile::tempdir().unwrap();
    collection(folder.path(), &[feature("a")]);
    let mut small = camera("small");
    small["image_size_px"] = json!([64, 48]);
    small["principal_point_px"] = json!([32, 24]);
    small["principal_distance_px"] = json!(60);
    write(folder.path(), "camera.json", &small);
    std::fs::write(folder.path().join("image.png"), png(3)).unwrap();
    let orient = ["orient", "image.png", "--camera", "camera.json", "--control", "roofs.geojson", "--crs", "EPSG:4979"];
    let position = ["--position", "16.6,52.7,170", "--kappa", "-12.5", "--overlay", "seen.png"];
    let (status, told, error) = run(folder.path(), &[&orient[..], &position].concat());
    assert_eq!(status, Some(0), "{error}");
    let answer: Value = serde_json::from_str(&told).unwrap();
    assert_eq!(answer["status"], "succeeded");
    assert_eq!(answer["result"]["diagnosis"]["verdict"], "red");
    assert_eq!(answer["result"]["approximation"]["kappa_deg"], -12.5);
    let seen = image::open(folder.path().join("seen.png")).unwrap();
    assert_eq!((seen.width(), seen.height()), (64, 48));
    // the database of nobody was made
    assert!(!folder.path().join("data").exists());
}

#[test]
fn orient_names_every_fault_of_its_arguments() {
    let folder = tempfile::tempdir().unwrap();
    collection(folder.path(), &[feature("a")]);
    write(folder.path(), "camera.json", &camera("large"));
    write(folder.path(), "approximation.json", &json!({"omega": 3}));
    std::fs::write(folder.path().join("image.png"), png(3)).unwrap();
    let orient = ["orient", "image.png", "--camera", "camera.json", "--control", "roofs.geojson", "--crs", "EPSG:4979"];
    let (status, _, told) = run(folder.path(), &[&orient[..], &["--tolerance-m=-1"]].concat());
    assert_eq!(status, Some(1));
    for pointer in ["/camera", "/tolerance_m", "/approximation/position"] {
        assert!(told.contains(pointer), "{told}");
    }
    let (_, _, told) = run(folder.path(), &[&orient[..], &["--approximation", "approximation.json"]].concat());
    assert!(told.contains("unknown field `omega`"), "{told}");
    let (status, _, told) = run(folder.path(), &[&orient[..], &["--position", "1,2"]].concat());
    assert_eq!((status, told.contains("three numbers")), (Some(2), true), "{told}");
    let (_, _, told) = run(folder.path(), &["orient", "image.png", "--camera", "camera.json"]);
    assert!(told.contains("--control FILE"), "{told}");
}

fn scene(name: &str, file: &str) -> Value {
    json!({"name": name, "file": file, "gsd_m": 0.1, "azimuth_of_image_up_deg": 0, "reference_px": [32, 24],
           "sigma_m": 0.05, "reference": {"crs": "EPSG:4979", "coordinates": [16.6, 52.7, 70.0]}})
}

/// A list of scenes, the pictures of which are in the folder beside it and right beside it.
fn scenes(folder: &Path, scenes: &[Value]) {
    std::fs::create_dir_all(folder.join("scenes")).unwrap();
    std::fs::write(folder.join("scenes").join("a.png"), png(1)).unwrap();
    std::fs::write(folder.join("b.png"), png(2)).unwrap();
    write(folder, "scenes.json", &json!(scenes));
}

#[test]
fn scenes_are_imported_and_those_at_fault_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut coarse = scene("coarse", "a.png");
    coarse["gsd_m"] = json!(20);
    let without_file = json!({"name": "no file"});
    scenes(
        folder.path(),
        &[scene("a", "a.png"), scene("c", "c.png"), scene("b", "b.png"), coarse, scene("a", "b.png"), without_file],
    );
    let import = ["import", "--scenes", "scenes.json"];
    let (status, told, error) = run(folder.path(), &import);
    assert_eq!(status, Some(0), "{error}");
    for said in
        ["scene 1 (c): cannot read scenes/c.png", "scene 3 (coarse)", "scene 4 (a): the name", "scene 5 (no file)"]
    {
        assert!(told.contains(said), "{said}: {told}");
    }
    assert!(told.ends_with("2 imported, 0 updated, 4 rejected\n"), "{told}");
    scenes(folder.path(), &[scene("b", "a.png"), scene("d", "b.png")]);
    let (_, told, _) = run(folder.path(), &[&import[..], &["--mode", "insert"]].concat());
    assert!(told.ends_with("1 imported, 0 updated, 1 rejected\n"), "{told}");
    let (_, told, _) = run(folder.path(), &[&import[..], &["--mode", "replace", "--json"]].concat());
    let report = json!({"imported": 0, "updated": 2, "rejected": [], "rejected_count": 0, "rejected_by_reason": []});
    assert_eq!(serde_json::from_str::<Value>(&told).unwrap(), report);
    let (status, _, told) = run(folder.path(), &["import"]);
    assert_eq!((status, told.contains("gable import [OPTIONS] --scenes <FILE>")), (Some(2), true), "{told}");
    // a file may say itself in which CRS it is: that --crs is missing is known once it is read
    let (status, _, _) = run(folder.path(), &["import", "roofs.geojson"]);
    assert_eq!(status, Some(1));
    let (status, _, _) =
        run(folder.path(), &["import", "roofs.geojson", "--crs", "EPSG:4979", "--scenes", "scenes.json"]);
    assert_eq!(status, Some(2));
}

#[test]
fn orient_takes_scenes_from_files_and_from_the_data_folder() {
    let folder = tempfile::tempdir().unwrap();
    scenes(folder.path(), &[scene("a", "a.png")]);
    let mut small = camera("small");
    small["image_size_px"] = json!([64, 48]);
    small["principal_point_px"] = json!([32, 24]);
    small["principal_distance_px"] = json!(60);
    small["distortion"] = json!({"model": "brown"});
    write(folder.path(), "camera.json", &small);
    std::fs::write(folder.path().join("image.png"), png(3)).unwrap();
    let orient = ["orient", "image.png", "--camera", "camera.json", "--position", "16.6,52.7,170", "--kappa", "0"];
    let red = |more: &[&str]| {
        let (status, told, error) = run(folder.path(), &[&orient[..], more].concat());
        assert_eq!(status, Some(0), "{error}");
        let answer: Value = serde_json::from_str(&told).unwrap();
        assert_eq!(answer["result"]["diagnosis"]["verdict"], "red");
        answer["result"]["diagnosis"]["reasons"][0]["code"].as_str().unwrap().to_owned()
    };
    assert_ne!(red(&["--scenes", "scenes.json"]), "no_control_in_view");
    assert_eq!(red(&["--scenes", "scenes.json", "--use", "lines"]), "no_control_in_view");
    assert!(!folder.path().join("data").exists());
    run(folder.path(), &["import", "--scenes", "scenes.json"]);
    assert_ne!(red(&["--use", "scenes"]), "no_control_in_view");
    assert_eq!(red(&["--use", "lines"]), "no_control_in_view");
    let (status, _, _) = run(folder.path(), &[&orient[..], &["--use", "points"]].concat());
    assert_eq!(status, Some(2));
}
