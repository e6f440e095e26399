//! Cameras.

use axum::body::Body;
use axum::http::Request;
use serde_json::json;

use crate::support::{Service, camera};

#[tokio::test]
async fn camera_comes_back_as_it_was_given() {
    let service = Service::new().await;
    let made = service.post("/api/v1/cameras", &camera("canon sx/260")).await;
    assert_eq!(made.status, 201);
    let made_json = made.json();
    for name in ["name", "image_size_px", "principal_distance_px", "principal_point_px"] {
        assert_eq!(made_json[name], camera("canon sx/260")[name]);
    }
    let distortion = json!({"model": "brown", "k1": -0.01, "k2": 0.001, "k3": 0.0, "p1": 0.0, "p2": 0.0, "b1_px": 0.0, "b2_px": 0.0});
    assert_eq!(made_json["distortion"], distortion);
    let id = made_json["id"].as_str().unwrap();
    assert_eq!(uuid::Uuid::parse_str(id).unwrap().get_version_num(), 7);
    assert_eq!(made.headers["location"], format!("/api/v1/cameras/{id}"));
    for address in [format!("/api/v1/cameras/{id}"), "/api/v1/cameras/canon%20sx%2F260".into()] {
        assert_eq!(service.get(&address).await.json(), made_json);
    }
}

#[tokio::test]
async fn same_name_is_the_same_camera_or_a_conflict() {
    let service = Service::new().await;
    let first = service.post("/api/v1/cameras", &camera("twice")).await;
    let again = service.post("/api/v1/cameras", &camera("twice")).await;
    assert_eq!((first.status.as_u16(), again.status.as_u16()), (201, 200));
    assert_eq!(first.json(), again.json());
    let mut other = camera("twice");
    other["principal_distance_px"] = json!(2_890.000_000_000_001);
    assert_eq!(service.post("/api/v1/cameras", &other).await.problem(409), ["/name"]);
    assert_eq!(service.get("/api/v1/cameras/twice").await.json(), first.json());
}

#[tokio::test]
async fn camera_that_is_deleted_is_gone() {
    let service = Service::new().await;
    service.post("/api/v1/cameras", &camera("brief")).await;
    let gone = service.delete("/api/v1/cameras/brief").await;
    assert_eq!((gone.status.as_u16(), gone.body.len()), (204, 0));
    service.get("/api/v1/cameras/brief").await.problem(404);
    service.delete("/api/v1/cameras/brief").await.problem(404);
}

#[tokio::test]
async fn pages_show_every_camera_once() {
    let service = Service::new().await;
    for n in 0..7 {
        service.post("/api/v1/cameras", &camera(&format!("camera {n}"))).await;
    }
    let mut names = Vec::new();
    let mut address = String::from("/api/v1/cameras?limit=3");
    loop {
        let page = service.get(&address).await.json();
        let items = page["items"].as_array().unwrap();
        assert!(items.len() <= 3);
        names.extend(items.iter().map(|camera| camera["name"].as_str().unwrap().to_owned()));
        match page["next_cursor"].as_str() {
            Some(cursor) => address = format!("/api/v1/cameras?limit=3&cursor={cursor}"),
            None => break,
        }
    }
    assert_eq!(names, (0..7).rev().map(|n| format!("camera {n}")).collect::<Vec<_>>());
}

#[tokio::test]
async fn cameras_outlive_the_process() {
    let service = Service::new().await;
    let made = service.post("/api/v1/cameras", &camera("lasting")).await.json();
    let reopened = &service.reopened().await;
    let kept = reopened.camera("lasting").await.unwrap().unwrap();
    assert_eq!(made["id"], kept.id.to_string());
    assert_eq!(kept.digital().unwrap().distortion().unwrap().k1.to_bits(), (-0.01_f64).to_bits());
}

fn calibration(query: &str, kind: &str, text: &'static str) -> Request<Body> {
    let post = Request::post(format!("/api/v1/cameras?{query}")).header("content-type", kind);
    post.body(Body::from(text)).unwrap()
}

const OPENCV: &str = include_str!("../../src/cameras/tests/opencv.yaml");
const COLMAP: &str = include_str!("../../src/cameras/tests/cameras.txt");
const AUSTRALIS: &str = include_str!("../../src/cameras/tests/australis.txt");
const INPHO: &str = include_str!("../../src/cameras/tests/inpho.prj");

#[tokio::test]
async fn a_calibration_of_another_program_becomes_a_camera_and_says_how_well() {
    let service = Service::new().await;
    let made = service.send(calibration("format=opencv&name=canon", "application/yaml", OPENCV)).await;
    assert_eq!(made.status, 201);
    let made = made.json();
    // OpenCV counts pixels from the centre of the first one
    assert_eq!(made["principal_point_px"], json!([2010.75, 1491.25]));
    assert_eq!(made["distortion"]["b1_px"], 1.5);
    assert_eq!(made["conversion"]["exact"], true);
    assert!(made["conversion"]["max_px"].as_f64().unwrap() < 1e-6);
    let mut shown = service.get("/api/v1/cameras/canon").await.json();
    shown["conversion"] = made["conversion"].clone();
    assert_eq!(shown, made);
    let again = service.send(calibration("format=opencv&name=canon", "text/plain", OPENCV)).await;
    assert_eq!(again.status, 200);

    let fitted = service.send(calibration("format=australis&name=phase-one", "text/plain", AUSTRALIS)).await.json();
    assert_eq!(fitted["conversion"]["exact"], false);
    assert_eq!(fitted["conversion"]["residuals"].as_array().unwrap().len(), 117);
    assert!(fitted["conversion"]["rms_px"].as_f64().unwrap() > 0.0);
}

#[tokio::test]
async fn a_report_of_a_film_camera_becomes_one_with_its_marks() {
    const REPORT: &str = include_str!("../../src/cameras/tests/usgs.txt");
    let service = Service::new().await;
    let made = service.send(calibration("format=usgs&template=wild_rc10", "text/plain", REPORT)).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    let made = made.json();
    assert_eq!(made["name"], "Example Aviogon 153 4711");
    assert_eq!(made["principal_point_mm"], json!([0.003, -0.001]));
    assert_eq!(made["fiducials"].as_array().unwrap().len(), 8);
    assert_eq!(made["distortion"]["k1"], 4.21e-9);
    assert!(made.get("conversion").is_none());
    let without = service.send(calibration("format=usgs", "text/plain", REPORT)).await;
    assert_eq!(without.problem(422), ["?template"]);
}

#[tokio::test]
async fn a_calibration_that_cannot_be_read_names_what_is_at_fault() {
    let service = Service::new().await;
    for (query, text, pointers) in [
        ("format=zeiss&name=a", OPENCV, &["?format"][..]),
        ("format=opencv", OPENCV, &["?name"]),
        ("format=colmap", COLMAP, &["?camera"]),
        ("format=inpho", INPHO, &["?camera"]),
        ("format=colmap&camera=12", COLMAP, &["?camera"]),
        ("format=colmap&camera=2&image_size_px=4000", COLMAP, &["?image_size_px"]),
        ("format=colmap&camera=2&image_size_px=4000,4000", COLMAP, &["?image_size_px"]),
        ("format=colmap&camera=2&pixel_size_mm=0", COLMAP, &["?pixel_size_mm"]),
        ("format=colmap&camera=7", COLMAP, &[]),
        ("format=colmap&name=a", OPENCV, &[]),
        ("name=a", OPENCV, &["?name"]),
    ] {
        let answer = service.send(calibration(query, "text/plain", text)).await;
        assert_eq!(answer.problem(422), pointers, "{query}");
    }
    service.send(calibration("format=opencv&name=a", "image/jpeg", OPENCV)).await.problem(415);
    service.send(calibration("", "application/yaml", OPENCV)).await.problem(415);
    assert!(service.state.store.cameras(None, 10).await.unwrap().is_empty());
}

#[tokio::test]
async fn heights_of_a_compound_without_its_grid_are_refused_wherever_they_are_given() {
    let service = Service::new().await;
    for path in ["/api/v1/control-points?crs=EPSG:25832%2B7837", "/api/v1/control-scenes?crs=EPSG:25832%2B7837"] {
        let answer = service.get(path).await;
        assert_eq!(answer.problem(422), ["?crs"]);
        let detail = answer.json()["detail"].as_str().unwrap().to_owned();
        assert!(detail.contains("de_bkg_gcg2016.tif") && detail.contains("geoid_folder"), "{detail}");
    }
}
