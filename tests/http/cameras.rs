//! Cameras.

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
