//! A photograph on film, from the upload of its scan to its exterior orientation.

use axum::body::Body;
use axum::http::Request;
use gable::simulation::SceneSettings;
use gable::simulation::film::{FilmScene, TiffSettings, write_tiff};
use nalgebra::Vector3;
use serde_json::{Value, json};
use tokio_util::sync::CancellationToken;

use crate::support::{Service, json_post};

/// The scan as the bytes of a tiled TIFF.
fn tiff(scene: &FilmScene) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    write_tiff(&scene.picture(), &TiffSettings::default(), &mut bytes).unwrap();
    bytes.into_inner()
}

async fn oriented(service: &Service, scene: &FilmScene, image: &str, camera: &Value) -> Value {
    let added = service.post("/api/v1/cameras", camera).await;
    assert_eq!(added.status, 201, "{:?}", added.body);
    let body = json!({"image": image, "camera": camera["name"], "approximation": scene.scene.approximation_body()});
    let mut request = json_post("/api/v1/orientations", &body);
    request.headers_mut().insert("prefer", "wait=60".parse().unwrap());
    let answer = service.send(request).await;
    assert_eq!(answer.status, 200, "{:?}", answer.body);
    answer.json()["result"].clone()
}

fn from_truth_m(result: &Value, scene: &FilmScene) -> f64 {
    let found: Vec<f64> = serde_json::from_value(result["projection_centre"]["coordinates"].clone()).unwrap();
    (Vector3::from_vec(found) - scene.scene.true_orientation.projection_centre_m).norm()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_scan_of_film_is_oriented_from_its_upload_to_its_exterior_orientation() {
    let scene = FilmScene::draw(45, &SceneSettings::default(), &FilmScene::default_scan(45)).unwrap();
    let service = Service::with(|configuration| configuration.wait_max_s = 60).await;
    service.state.jobs.prepare().await.unwrap();
    let stop = CancellationToken::new();
    let (jobs, stopped) = (service.state.jobs.clone(), stop.clone());
    tokio::spawn(async move { jobs.run(stopped).await });
    let stop = stop.drop_guard();

    let query: String = url(&scene.scene.crs());
    let control = Request::post(format!("/api/v1/control-points?crs={query}"))
        .header("content-type", "application/geo+json")
        .body(Body::from(scene.scene.control_points_body().to_string()))
        .unwrap();
    assert_eq!(service.send(control).await.status, 200);
    let uploaded = service.upload("image/tiff", tiff(&scene)).await;
    assert_eq!(uploaded.status, 201, "{:?}", uploaded.body);
    let image = uploaded.json()["id"].as_str().unwrap().to_owned();

    let result = oriented(&service, &scene, &image, &scene.camera_body()).await;
    assert_eq!(result["diagnosis"]["verdict"], "green", "{}", result["diagnosis"]);
    let interior = &result["interior_orientation"];
    let lies = &scene.truth()["scan"];
    assert_eq!(interior["diagnosis"]["verdict"], "green", "{}", interior["diagnosis"]);
    assert_eq!(interior["plate_orientation"]["quarter_turns"], lies["quarter_turns"]);
    assert_eq!(interior["plate_orientation"]["reading"], lies["reading"]);
    assert_eq!(interior["polarity"], lies["polarity"]);
    assert!(from_truth_m(&result, &scene) < 0.5, "{}", from_truth_m(&result, &scene));

    // nothing but the image tells how the film lies: no feature, and positions as in the design
    let mut plain = scene.camera_body();
    plain["name"] = json!("plain");
    plain.as_object_mut().unwrap().remove("asymmetric_feature");
    for fiducial in plain["fiducials"].as_array_mut().unwrap() {
        let rounded = |value: &Value| json!(value.as_f64().unwrap().round());
        let position: Vec<Value> = fiducial["position_mm"].as_array().unwrap().iter().map(rounded).collect();
        fiducial["position_mm"] = json!(position);
        fiducial["sigma_mm"] = json!(0.015);
    }
    let result = oriented(&service, &scene, &image, &plain).await;
    let interior = &result["interior_orientation"];
    assert_eq!(interior["plate_orientation"]["decided_by"], "image_content", "{}", interior["plate_orientation"]);
    assert_eq!(interior["plate_orientation"]["quarter_turns"], lies["quarter_turns"]);
    assert_eq!(interior["plate_orientation"]["reading"], lies["reading"]);
    assert!(from_truth_m(&result, &scene) < 0.5);

    // another camera's marks are not there: that ends it, with reasons
    let mut other = scene.camera_body();
    other["name"] = json!("other");
    for fiducial in other["fiducials"].as_array_mut().unwrap() {
        let [x, y] = [0, 1].map(|axis| fiducial["position_mm"][axis].as_f64().unwrap());
        fiducial["position_mm"] = json!([0.7 * x, 0.6 * y]);
        fiducial["template"] = json!("leica_rc30");
    }
    let result = oriented(&service, &scene, &image, &other).await;
    assert_eq!(result["diagnosis"]["verdict"], "red");
    assert_eq!(result["diagnosis"]["reasons"][0]["code"], "interior_orientation_red", "{}", result["diagnosis"]);
    assert!(result.get("projection_centre").is_none());
    drop(stop);
}

/// A PROJ string in a query.
fn url(crs: &str) -> String {
    crs.replace('+', "%2B").replace(' ', "%20")
}
