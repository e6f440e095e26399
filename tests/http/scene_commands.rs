//! The built binary: `gable scene rectify` and `gable scene cut`.

use std::path::Path;
use std::process::Output;

use gable::scenes::declination::declination;
use gable::simulation::{TEMPLATE_M, TerrestrialView};
use image::GrayImage;
use nalgebra::Vector2;
use serde_json::{Value, json};

use crate::command_line::gable;

fn run(folder: &Path, arguments: &[&str]) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = gable(folder, arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code(), text(stdout), text(stderr))
}

fn write(folder: &Path, name: &str, value: &Value) {
    std::fs::write(folder.join(name), value.to_string()).unwrap();
}

fn read(folder: &Path, name: &str) -> (Value, GrayImage) {
    let text = std::fs::read(folder.join(format!("{name}.json"))).unwrap();
    let picture = image::open(folder.join(format!("{name}.png"))).unwrap();
    (serde_json::from_slice(&text).unwrap(), picture.into_luma8())
}

/// Waves of 1.1 and 0.7 m across each other.
fn ground(place_m: Vector2<f64>) -> f64 {
    let wave = |along: f64, length_m: f64| (std::f64::consts::TAU * along / length_m).sin();
    127.0 + 50.0 * wave(place_m.x + 0.3 * place_m.y, 1.1) + 40.0 * wave(place_m.y - 0.5 * place_m.x, 0.7)
}

fn simulated(folder: &Path) -> TerrestrialView {
    let view = TerrestrialView::from_a_pole(1064).unwrap();
    let [width, height] = view.camera.size_px();
    GrayImage::from_raw(width, height, view.photograph(&ground, 3)).unwrap().save(folder.join("pole.png")).unwrap();
    write(folder, "fisheye.json", &view.camera_body());
    write(folder, "target.json", &TerrestrialView::targets_body(&view.targets(&TEMPLATE_M, 0.0, 1)));
    view
}

const BERLIN: &str = "13.4,52.5,80";

fn rectify<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let fixed = ["scene", "rectify", "pole.png", "--camera", "fisheye.json", "--target", "target.json"];
    [&fixed, &["--crs", "EPSG:4979", "--reference", BERLIN, "--name", "yard", "--out", "scenes"][..], more].concat()
}

/// Root mean square of what a picture differs by from the ground, rim left out.
fn from_ground(scene: &Value, picture: &GrayImage) -> f64 {
    let number = |value: &Value| value.as_f64().unwrap();
    let (gsd_m, reference) = (number(&scene["gsd_m"]), &scene["reference_px"]);
    let (x0, y0) = (number(&reference[0]), number(&reference[1]));
    let place = |x: u32, y: u32| gsd_m * Vector2::new(f64::from(x) + 0.5 - x0, y0 - f64::from(y) - 0.5);
    let squares: f64 =
        picture.enumerate_pixels().map(|(x, y, grey)| (f64::from(grey.0[0]) - ground(place(x, y))).powi(2)).sum();
    (squares / f64::from(picture.width() * picture.height())).sqrt()
}

#[test]
fn a_picture_from_a_pole_becomes_a_scene_with_north_up() {
    let folder = tempfile::tempdir().unwrap();
    let view = simulated(folder.path());
    let true_deg = view.azimuth_of_y_rad.to_degrees();
    let bearing = true_deg.to_string();
    let (status, told, errors) = run(folder.path(), &rectify(&["--bearing-deg", &bearing]));
    assert_eq!(status, Some(0), "{errors}");
    for part in ["sigma0     0.00 with 12 redundant", "4.000 m above the ground", "curl -F", "/api/v1/control-scenes"] {
        assert!(told.contains(part), "{part}: {told}");
    }
    let (scene, picture) = read(&folder.path().join("scenes"), "yard");
    let keys: Vec<_> = scene.as_object().unwrap().keys().map(String::as_str).collect();
    let contract =
        ["azimuth_of_image_up_deg", "gsd_m", "name", "reference", "reference_px", "sigma_azimuth_deg", "sigma_m"];
    assert_eq!(keys, contract);
    assert_eq!(scene["reference"], json!({"crs": "EPSG:4979", "coordinates": [13.4, 52.5, 80.0]}));
    assert_eq!((&scene["gsd_m"], &scene["azimuth_of_image_up_deg"]), (&json!(0.02), &json!(0.0)));
    let sigma_deg = scene["sigma_azimuth_deg"].as_f64().unwrap();
    assert!((2.0..2.1).contains(&sigma_deg), "{sigma_deg}");
    assert!(picture.width() > 350 && picture.height() > 350, "{:?}", picture.dimensions());
    let difference = from_ground(&scene, &picture);
    assert!(difference < 5.0, "{difference}");

    // the same as a compass would have told it, and of the other arm
    let berlin = declination(13.4, 52.5, 80.0, [2026, 5, 1]).unwrap().declination_rad.to_degrees();
    let compass = (true_deg - berlin + 90.0).to_string();
    let magnetic = ["--magnetic", "--date", "2026-05-01", "--arm", "x", "--bearing-deg", &compass, "--size-m", "4"];
    let (status, told, errors) = run(folder.path(), &rectify(&magnetic));
    assert_eq!(status, Some(0), "{errors}");
    assert!(told.contains(&format!("declination {berlin:.2}° on 2026-05-01")), "{told}");
    let (scene, picture) = read(&folder.path().join("scenes"), "yard");
    assert_eq!(picture.dimensions(), (200, 200));
    let difference = from_ground(&scene, &picture);
    assert!(difference < 5.0, "{difference}");
}

#[test]
fn what_cannot_be_rectified_fails_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    simulated(folder.path());
    let refused = |more: &[&str], named: &str| {
        let (status, _, told) = run(folder.path(), &rectify(more));
        assert!(status != Some(0) && told.contains(named), "{status:?} {told}");
    };
    refused(&["--magnetic"], "--date");
    refused(&["--magnetic", "--date", "2035-01-01"], "validity");
    refused(&["--reference-at-m", "40,0"], "outside of the rectified ground");
    refused(&["--plate-height-m", "-5"], "below the camera");
    write(folder.path(), "target.json", &json!({"points": [{"xy_m": [0, 0], "px": [500, 400]}]}));
    refused(&[], "1 targets are too few");
    write(folder.path(), "target.json", &json!({"points": [{"px": [500, 400]}]}));
    refused(&[], "xy_m or xyz_m");
    write(folder.path(), "fisheye.json", &json!({"projection": "mercator"}));
    refused(&[], "fisheye.json");
}

/// A picture whose grey tells the column, with a world file of 0.1 m; pixel (100, 80) is the point in question.
fn ortho(folder: &Path) {
    GrayImage::from_fn(300, 200, |x, y| image::Luma([(x % 200 + y % 50) as u8]))
        .save(folder.join("ortho.png"))
        .unwrap();
    std::fs::write(folder.join("ortho.pgw"), "0.1\n0\n0\n-0.1\n565002.35\n5934418.65\n").unwrap();
}

#[test]
fn a_scene_is_cut_out_of_an_ortho_photo_with_its_world_file() {
    let folder = tempfile::tempdir().unwrap();
    ortho(folder.path());
    let cut = ["scene", "cut", "ortho.png", "--crs", "EPSG:25832", "--size-m", "10"];
    let point = ["--at", "565012.3,5934410.7", "--height-m", "0.9", "--geoid-undulation-m", "44.1", "--name", "kerb"];
    let (status, told, errors) = run(folder.path(), &[&cut[..], &point].concat());
    assert_eq!(status, Some(0), "{errors}");
    assert!(told.contains("curl -F 'file=@./kerb.png' -F 'scene=<./kerb.json'"), "{told}");
    let (scene, picture) = read(folder.path(), "kerb");
    assert_eq!(scene["reference"], json!({"crs": "EPSG:25832", "coordinates": [565_012.3, 5_934_410.7, 45.0]}));
    let azimuth_deg = scene["azimuth_of_image_up_deg"].as_f64().unwrap();
    assert!((azimuth_deg - 0.7895).abs() < 1e-3, "{azimuth_deg}");
    assert!((scene["sigma_m"].as_f64().unwrap() - 0.2).abs() < 1e-3, "{scene}");
    let x = scene["reference_px"][0].as_f64().unwrap();
    let from = (100.0 - x).round() as u32;
    assert_eq!(
        u32::from(picture.get_pixel(10, 0).0[0]),
        from + 10 + (80 - scene["reference_px"][1].as_f64().unwrap().round() as u32) % 50
    );

    std::fs::write(
        folder.path().join("points.csv"),
        "name,e,n,h\na/b,565012.3,5934410.7,45\nfar,1000000,5934410.7,45\n",
    )
    .unwrap();
    let (status, told, errors) = run(folder.path(), &[&cut[..], &["--points", "points.csv", "--out", "many"]].concat());
    assert_eq!(status, Some(0), "{errors}");
    assert!(told.contains("far: left out:") && told.contains("outside of the ortho-photo"), "{told}");
    assert_eq!(read(&folder.path().join("many"), "a-b").0["name"], json!("a/b"));
}

#[test]
fn an_ortho_photo_of_nowhere_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    ortho(folder.path());
    let point = ["--at", "565012.3,5934410.7", "--height-m", "45", "--name", "kerb"];
    let refused = |more: &[&str], named: &str| {
        let (status, _, told) = run(folder.path(), &[&["scene", "cut", "ortho.png"], more].concat());
        assert!(status != Some(0) && told.contains(named), "{status:?} {told}");
    };
    refused(&point, "give --crs");
    refused(&["--crs", "EPSG:25832"], "--points");
    refused(&[&point[..], &["--crs", "EPSG:25832", "--size-m", "0.5"]].concat(), "too small");
    std::fs::write(folder.path().join("ortho.pgw"), "0.1 0 0").unwrap();
    refused(&[&point[..], &["--crs", "EPSG:25832"]].concat(), "six numbers");
    std::fs::remove_file(folder.path().join("ortho.pgw")).unwrap();
    refused(&[&point[..], &["--crs", "EPSG:25832"]].concat(), "give --world");
}

#[test]
fn the_simulated_picture_from_a_pole_is_rectified_by_the_command_that_is_printed() {
    let folder = tempfile::tempdir().unwrap();
    let (status, told, errors) = run(folder.path(), &["simulate", "--pole", "--out", "poles"]);
    assert_eq!(status, Some(0), "{errors}");
    let command: Vec<&str> = told.lines().last().unwrap().split_whitespace().collect();
    assert_eq!(command[..3], ["gable", "scene", "rectify"]);
    let (status, told, errors) = run(folder.path(), &command[1..]);
    assert_eq!(status, Some(0), "{errors}");
    assert!(told.contains("4.00"), "{told}");
    let (scene, picture) = read(&folder.path().join("poles/seed-1/scenes"), "yard");
    assert_eq!(scene["name"], "yard");
    assert!(picture.width() > 350 && picture.height() > 350, "{:?}", picture.dimensions());
}
