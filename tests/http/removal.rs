//! What is removed is gone, and what refers to it says so.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use chrono::TimeDelta;
use gable::jobs::retention::{Retention, Swept, sweep};
use gable::store::now;
use serde_json::json;

use crate::orientations::{Working, held, id, quick};
use crate::support::{Service, jpeg, png};

#[tokio::test(flavor = "multi_thread")]
async fn an_image_goes_with_its_file_and_comes_back_under_its_id() {
    let working = Working::with(quick()).await;
    let service = &working.service;
    let orientation = id(&working.ask(&working.request(), &[("prefer", "wait=20")]).await);
    let image = format!("/api/v1/images/{}", working.image);
    assert_eq!(service.delete(&image).await.status, 204);
    assert_eq!(service.files("images"), Vec::<String>::new());
    service.get(&image).await.problem(404);
    service.delete(&image).await.problem(404);
    assert_eq!(service.get("/api/v1/images").await.json()["items"], json!([]));
    assert_eq!(working.ask(&working.request(), &[]).await.problem(422), ["/image"]);
    assert!(service.get(&format!("/api/v1/orientations/{orientation}")).await.json()["result"].is_object());
    service.get(&format!("/api/v1/orientations/{orientation}/overlay")).await.problem(410);
    let again = service.upload("image/png", png(7)).await;
    assert_eq!((again.status.as_u16(), &again.json()["id"]), (201, &json!(working.image)));
    assert_eq!(service.get(&format!("/api/v1/orientations/{orientation}/overlay")).await.status, 200);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_image_that_an_orientation_needs_stays() {
    let gate = Arc::new(AtomicBool::new(false));
    let working = Working::with(held(&gate)).await;
    let orientation = id(&working.ask(&working.request(), &[]).await);
    let image = format!("/api/v1/images/{}", working.image);
    working.service.delete(&image).await.problem(409);
    let forget = format!("/api/v1/orientations/{orientation}?forget=true");
    working.service.delete(&forget).await.problem(409);
    gate.store(true, Ordering::SeqCst);
    working.until(&orientation, "succeeded").await;
    working.service.delete(&format!("/api/v1/orientations/{orientation}")).await.problem(409);
    assert_eq!(working.service.delete(&forget).await.status, 204);
    working.service.delete(&forget).await.problem(404);
    working.service.get(&format!("/api/v1/orientations/{orientation}")).await.problem(404);
    assert_eq!(working.service.delete(&image).await.status, 204);
}

#[tokio::test(flavor = "multi_thread")]
async fn removing_and_uploading_at_the_same_time_never_loses_a_file() {
    let service = Service::new().await;
    let image = service.upload("image/jpeg", jpeg(0)).await.json()["id"].as_str().unwrap().to_owned();
    for _ in 0..20 {
        let path = format!("/api/v1/images/{image}");
        let (_, uploaded, _) =
            tokio::join!(service.delete(&path), service.upload("image/jpeg", jpeg(0)), service.delete(&path));
        assert!([200, 201, 503].contains(&uploaded.status.as_u16()));
        let there = service.get(&path).await.status == 200;
        assert_eq!(service.files("images").len(), usize::from(there));
        service.upload("image/jpeg", jpeg(0)).await;
    }
}

#[tokio::test]
async fn control_points_go_by_name() {
    let service = Service::new().await;
    let line = json!([[16.6, 52.7, 80.0], [16.6001, 52.7, 80.0]]);
    let point = json!({"type": "Feature", "geometry": {"type": "MultiLineString", "coordinates": [line]},
        "properties": {"name": "church", "sigma_m": 0.1}});
    let collection = json!({"type": "FeatureCollection", "features": [point]});
    let imported = service.post("/api/v1/control-points?crs=EPSG:4979", &collection).await;
    assert_eq!(imported.json()["imported"], 1, "{:?}", imported.body);
    assert_eq!(service.delete("/api/v1/control-points/church").await.status, 204);
    service.delete("/api/v1/control-points/church").await.problem(404);
    service.get("/api/v1/control-points/church").await.problem(404);
    let near = service.get("/api/v1/control-points?bbox=16,52,17,53").await.json();
    assert_eq!(near["items"], json!([]));
    assert_eq!(service.post("/api/v1/control-points?crs=EPSG:4979", &collection).await.json()["imported"], 1);
}

#[tokio::test]
async fn as_many_bytes_as_the_configuration_allows() {
    let size = jpeg(0).len() as u64;
    let service = Service::with(|configuration| configuration.images_max_bytes = 2 * size).await;
    let image = service.upload("image/jpeg", jpeg(0)).await.json()["id"].as_str().unwrap().to_owned();
    let padded = |shade: u8| [jpeg(shade), vec![0; size as usize]].concat();
    service.upload("image/jpeg", padded(1)).await.problem(507);
    assert_eq!(service.files("incoming"), Vec::<String>::new());
    assert_eq!(service.delete(&format!("/api/v1/images/{image}")).await.status, 204);
    assert_eq!(service.upload("image/jpeg", padded(0)).await.status, 201);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_too_old_is_swept_and_nothing_else() {
    let working = Working::with(quick()).await;
    let store = &working.service.state.store;
    for _ in 0..3 {
        assert_eq!(working.ask(&working.request(), &[("prefer", "wait=20")]).await.status, 200);
    }
    let later = now() + TimeDelta::days(10);
    let retention = |images_days, yellow_days| Retention { images_days, yellow_days, green_days: 1, red_days: 1 };
    for kept in [Retention::default(), retention(11, 11), retention(0, 0)] {
        assert_eq!(sweep(store, kept, later).await.unwrap(), Swept::default());
    }
    let swept = sweep(store, retention(9, 9), later).await.unwrap();
    assert_eq!((swept.orientations, swept.images, swept.files), (3, 1, 0));
    assert_eq!(working.service.files("images"), Vec::<String>::new());
    assert_eq!(working.service.get("/api/v1/orientations").await.json()["items"], json!([]));
}
