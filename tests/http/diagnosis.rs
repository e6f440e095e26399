//! References, classifiers, the health of control points, and what a request may want of its verdict.

use std::time::{Duration, Instant};

use axum::body::Body;
use axum::http::Request;
use gable::configuration::Configuration;
use gable::store::keys::Role;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use tokio_util::sync::{CancellationToken, DropGuard};

use crate::labelled::image;
use crate::support::{Answer, Service, png};

const CLASSIFIERS: &str = "/api/v1/classifiers";
const REFERENCES: &str = "/api/v1/references";

/// A service whose jobs run.
async fn working(change: impl FnOnce(&mut Configuration)) -> (Service, DropGuard) {
    let service = Service::with(change).await;
    service.state.jobs.prepare().await.unwrap();
    let stop = CancellationToken::new();
    let (jobs, stopped) = (service.state.jobs.clone(), stop.clone());
    tokio::spawn(async move { jobs.run(stopped).await });
    (service, stop.drop_guard())
}

fn labelled_set(images: usize) -> String {
    let mut draws = ChaCha8Rng::seed_from_u64(9);
    let area = |k: usize| if k.is_multiple_of(2) { "north" } else { "south" };
    (0..images).map(|k| format!("{}\n", image(area(k), k, &mut draws))).collect()
}

async fn upload_set(service: &Service, query: &str, set: impl Into<Body>) -> Answer {
    let request = Request::post(format!("{CLASSIFIERS}?{query}")).header("content-type", "application/x-ndjson");
    service.send(request.body(set.into()).unwrap()).await
}

/// Waits until a classifier is trained or has failed.
async fn ended(service: &Service, id: &str) -> Value {
    let patience = Instant::now() + Duration::from_secs(120);
    loop {
        let answer = service.get(&format!("{CLASSIFIERS}/{id}")).await.json();
        if ["ready", "failed"].contains(&answer["status"].as_str().unwrap()) {
            return answer;
        }
        assert!(Instant::now() < patience, "{answer}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

fn reference(image: &str) -> Value {
    json!({
        "image": image,
        "area": "block 7",
        "projection_centre": {"crs": "EPSG:25832", "coordinates": [365_000.0, 5_621_000.0, 1200.0]},
        "rotation": {"omega_deg": 1.5, "phi_deg": -2.0, "kappa_deg": 70.0},
    })
}

#[tokio::test]
async fn references_are_kept_replaced_and_removed() {
    let service = Service::new().await;
    let image = service.upload("image/png", png(1)).await.json()["id"].as_str().unwrap().to_owned();
    let give = |reference: Value| json!({"references": [reference]});
    let first = service.post(REFERENCES, &give(reference(&image))).await;
    assert_eq!((first.status.as_u16(), first.json()), (200, json!({"stored": 1, "updated": 0, "rejected": []})));
    let mut moved = reference(&image);
    moved["projection_centre"]["coordinates"][2] = 1300.0.into();
    assert_eq!(service.post(REFERENCES, &give(moved)).await.json()["updated"], 1);
    let kept = service.get(REFERENCES).await.json();
    let [item] = kept["items"].as_array().unwrap().as_slice() else { panic!("{kept}") };
    assert_eq!((&item["image"], &item["area"]), (&json!(image), &json!("block 7")));
    // the ellipsoids of EPSG:25832 (GRS 80) and of the answer (WGS 84) are a tenth of a millimetre apart
    assert!((item["projection_centre"]["coordinates"][2].as_f64().unwrap() - 1300.0).abs() < 2e-4);
    let path = format!("{REFERENCES}/{image}");
    assert_eq!(service.delete(&path).await.status, 204);
    service.delete(&path).await.problem(404);
    assert_eq!(service.get(REFERENCES).await.json()["items"], json!([]));
}

#[tokio::test]
async fn a_bad_reference_is_named_and_loses_no_other() {
    let service = Service::new().await;
    let image = service.upload("image/png", png(2)).await.json()["id"].as_str().unwrap().to_owned();
    let mut mirrored = reference(&image);
    mirrored["rotation"] = json!({"rotation_matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]});
    let mut torn = reference(&image);
    torn["rotation"]["rotation_matrix"] = json!([[1, 0, 0], [0, 1, 0], [0, 0, 1]]);
    let mut wordy = reference(&image);
    wordy["rotation"]["phi_deg"] = "two".into();
    let mut nowhere = reference(&image);
    nowhere["projection_centre"]["crs"] = "EPSG:1".into();
    let unknown = reference("01a20225-f91a-7133-9892-18bd6449110e");
    let all = json!({"references": [mirrored, nowhere, reference(&image), unknown, "text", torn, wordy]});
    let answer = service.post(REFERENCES, &all).await.json();
    assert_eq!(answer["stored"], 1);
    let rejected: Vec<(u64, &str)> = answer["rejected"]
        .as_array()
        .unwrap()
        .iter()
        .map(|r| (r["index"].as_u64().unwrap(), r["pointer"].as_str().unwrap()))
        .collect();
    assert_eq!(
        rejected,
        [
            (0, "/rotation/rotation_matrix"),
            (1, "/projection_centre"),
            (3, "/image"),
            (4, ""),
            (5, "/rotation"),
            (6, "/rotation/phi_deg")
        ]
    );
    service.post(REFERENCES, &json!({"references": vec![json!({}); 1001]})).await.problem(422);
    service.post(REFERENCES, &json!([reference(&image)])).await.problem(422);
}

#[tokio::test]
async fn the_shipped_classifier_shows_all_that_is_known_of_it() {
    let service = Service::new().await;
    let list = service.get(CLASSIFIERS).await.json();
    assert_eq!((&list["items"][0]["id"], &list["items"][0]["active"]), (&json!("shipped"), &json!(true)));
    let shipped = service.get(&format!("{CLASSIFIERS}/shipped")).await.json();
    assert_eq!(shipped["status"], "ready");
    assert!(shipped["evaluation"]["curve"].as_array().unwrap().len() > 20);
    assert_eq!(shipped["evaluation"]["bins"].as_array().unwrap().len(), 10);
    assert!(shipped["provenance"]["samples"].as_u64() >= shipped["provenance"]["samples_used"].as_u64());
    let decisions = &shipped["decisions"];
    assert!(decisions["expected_cost"].as_f64() < decisions["cost_of_rejecting"].as_f64(), "{decisions}");
    let file = async |name: &str| service.get(&format!("{CLASSIFIERS}/shipped/{name}")).await;
    for (name, begin) in [("model.svm", "svm_type c_svc"), ("scaling.range", "x"), ("classifier.json", "{")] {
        assert!(file(name).await.body.starts_with(begin.as_bytes()), "{name}");
    }
    for name in ["cost-curve.svg", "calibration.svg"] {
        let answer = file(name).await;
        assert!(answer.headers["content-type"].to_str().unwrap().starts_with("image/svg+xml"));
        let text = String::from_utf8(answer.body.to_vec()).unwrap();
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"), "{name}");
    }
    file("passwd").await.problem(404);
    service.get(&format!("{CLASSIFIERS}/nobody")).await.problem(404);
}

#[tokio::test]
async fn a_classifier_is_trained_activated_and_rolled_back() {
    let (service, _guard) = working(|_| ()).await;
    let set = labelled_set(240);
    let asked = upload_set(&service, "name=mine&kinds=evidence_logistic,one_feature", set.clone()).await;
    assert_eq!(asked.status, 202, "{:?}", asked.body);
    let id = asked.json()["id"].as_str().unwrap().to_owned();
    assert_eq!(asked.headers["location"], format!("{CLASSIFIERS}/{id}"));
    upload_set(&service, "name=mine&kinds=evidence_logistic", set).await.problem(409);
    let mine = ended(&service, &id).await;
    assert_eq!((&mine["status"], &mine["active"]), (&json!("ready"), &json!(false)), "{mine}");
    assert_eq!(mine["provenance"]["areas"], json!({"north": 120, "south": 120}));
    let path = |rest: &str| format!("{CLASSIFIERS}/{id}/{rest}");
    assert!(service.get(&path("model.svm")).await.body.starts_with(b"svm_type c_svc"));
    let active = service.post(&path("activate"), &json!({})).await.json();
    assert_eq!(active["active"]["sha256"], mine["sha256"]);
    assert_eq!(service.get(CLASSIFIERS).await.json()["items"][0]["active"], false);
    let back = service.post(&format!("{CLASSIFIERS}/rollback"), &json!({})).await.json();
    assert_ne!(back["active"]["sha256"], mine["sha256"]);
    service.post(&format!("{CLASSIFIERS}/rollback"), &json!({})).await.problem(409);
    assert_eq!(service.get(CLASSIFIERS).await.json()["items"][0]["active"], true);
}

#[tokio::test]
async fn sets_that_teach_nothing_are_refused_and_leave_nothing() {
    let (service, _guard) = working(|configuration| configuration.training_max_bytes = 200_000).await;
    let mut broken = labelled_set(12);
    broken.push_str("{\"image\": \"x\"\n");
    let answer = upload_set(&service, "name=broken", broken).await;
    answer.problem(422);
    assert!(String::from_utf8_lossy(&answer.body).contains("line 13"), "{:?}", answer.body);
    upload_set(&service, "name=empty", "").await.problem(422);
    upload_set(&service, "name=large", labelled_set(400)).await.problem(413);
    assert_eq!(upload_set(&service, "kinds=paper", labelled_set(12)).await.problem(422), ["?name"]);
    assert_eq!(upload_set(&service, "name=a&kinds=oracle", labelled_set(12)).await.problem(422), ["/kinds"]);
    assert_eq!(upload_set(&service, "name=shipped", labelled_set(12)).await.problem(422), ["/name"]);
    let history = async |body: Value| service.post(CLASSIFIERS, &body).await;
    let cheap = json!({"name": "a", "costs": {"cc": 0, "cw": 1, "wc": 5, "ww": 10}});
    assert_eq!(history(cheap).await.problem(422), ["/costs/cw"]);
    assert_eq!(service.files("training"), Vec::<String>::new());
    assert_eq!(service.get(CLASSIFIERS).await.json()["items"].as_array().unwrap().len(), 1);
    // nothing has a reference yet: that is found when it is trained
    let asked = history(json!({"name": "own"})).await;
    assert_eq!(asked.status, 202);
    let id = asked.json()["id"].as_str().unwrap().to_owned();
    let failed = ended(&service, &id).await;
    assert_eq!(failed["status"], "failed");
    assert!(failed["error"].as_str().is_some_and(|error| !error.is_empty()), "{failed}");
    service.post(&format!("{CLASSIFIERS}/{id}/activate"), &json!({})).await.problem(409);
    // its name is free again
    assert_eq!(history(json!({"name": "own"})).await.status, 202);
    service.get(&format!("{CLASSIFIERS}/{id}")).await.problem(404);
}

#[tokio::test]
async fn an_operator_may_train_but_not_decide_what_decides() {
    let service = Service::new().await;
    let (operator, _) = service.key(Role::Operator).await;
    let ask = async |activate: bool| {
        let body = json!({"name": format!("own-{activate}"), "activate": activate});
        let post = Request::post(CLASSIFIERS).header("content-type", "application/json");
        service
            .send(post.header("authorization", format!("Bearer {operator}")).body(body.to_string().into()).unwrap())
            .await
    };
    ask(true).await.problem(403);
    assert_eq!(ask(false).await.status, 202);
    let set =
        Request::post(format!("{CLASSIFIERS}?name=set&activate=true")).header("content-type", "application/x-ndjson");
    let set = set.header("authorization", format!("Bearer {operator}")).body(labelled_set(20).into()).unwrap();
    service.send(set).await.problem(403);
    assert_eq!(service.files("training"), Vec::<String>::new());
}

#[tokio::test]
async fn no_more_trainings_wait_than_the_configuration_allows() {
    // nobody works: whatever is asked for waits
    let service = Service::with(|configuration| configuration.training_max_jobs = 2).await;
    for name in ["a", "b"] {
        assert_eq!(service.post(CLASSIFIERS, &json!({"name": name})).await.status, 202);
    }
    let refused = service.post(CLASSIFIERS, &json!({"name": "c"})).await;
    refused.problem(503);
    assert!(refused.headers.contains_key("retry-after"));
}

#[tokio::test]
async fn a_control_point_without_images_has_nothing_to_tell() {
    let service = Service::new().await;
    let health = |name: &str| format!("/api/v1/control-points/{name}/health");
    service.get(&health("nobody")).await.problem(404);
    let points = json!({"type": "FeatureCollection", "features": [{
        "type": "Feature",
        "properties": {"name": "church", "sigma_m": 0.05},
        "geometry": {"type": "MultiLineString", "coordinates": [
            [[365_000.0, 5_621_000.0, 100.0], [365_010.0, 5_621_000.0, 100.0]],
            [[365_010.0, 5_621_000.0, 100.0], [365_010.0, 5_621_008.0, 100.0]],
            [[365_000.0, 5_621_000.0, 100.0], [365_000.0, 5_621_008.0, 100.0]],
        ]},
    }]});
    let import = Request::post("/api/v1/control-points?crs=EPSG:25832").header("content-type", "application/geo+json");
    assert_eq!(service.send(import.body(points.to_string().into()).unwrap()).await.status, 200);
    let answer = service.get(&health("church")).await.json();
    assert_eq!((&answer["seen_in"], &answer["outdated"]), (&json!(0), &json!(false)));
}

#[tokio::test]
async fn what_is_wanted_of_the_verdict_is_checked() {
    let (service, _jobs) = working(|_| {}).await;
    let image = service.upload("image/png", png(3)).await.json()["id"].as_str().unwrap().to_owned();
    let camera = json!({"name": "camera", "image_size_px": [64, 48], "principal_distance_px": 60.0,
        "principal_point_px": [32.0, 24.0]});
    assert_eq!(service.post("/api/v1/cameras", &camera).await.status, 201);
    let ask = async |field: &str, value: Value| {
        let mut request = json!({"image": image, "camera": "camera", "approximation": {
            "position": {"crs": "EPSG:4979", "coordinates": [16.6, 52.7, 400.0]}, "kappa_deg": 10}});
        request[field] = value;
        service.post("/api/v1/orientations", &request).await
    };
    for (field, value, pointer) in [
        ("costs", json!({"cc": 0, "cw": 5, "wc": 5, "ww": 10}), "/costs/cw"),
        ("costs", json!({"cc": -1, "cw": 40, "wc": 5, "ww": 10}), "/costs/cc"),
        ("caution", json!(0.5), "/caution"),
        ("threshold", json!(1e9), "/threshold"),
    ] {
        assert_eq!(ask(field, value.clone()).await.problem(422), [pointer], "{value}");
    }
    for (field, value) in [
        ("costs", json!({"cc": 0.0, "cw": 80.0, "wc": 5.0, "ww": 10.0})),
        ("caution", json!(2.5)),
        ("threshold", json!(-1.5)),
    ] {
        let accepted = ask(field, value.clone()).await;
        assert_eq!(accepted.status, 202, "{:?}", accepted.body);
        let id = accepted.json()["id"].as_str().unwrap().parse().unwrap();
        let kept = service.state.store.orientation(id).await.unwrap().unwrap().prepared;
        let kept: Value = serde_json::from_str(&kept).unwrap();
        assert_eq!(kept["policy"][field], value);
    }
}
