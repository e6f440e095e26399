//! Orientations, through the router, with a pipeline that the test controls.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::http::Request;
use gable::configuration::Configuration;
use gable::diagnosis::{Diagnosis, Reason, Verdict};
use gable::geometry::Segment2;
use gable::jobs::Orient;
use gable::pipeline::{ControlKind, ControlPointResult, EdgeResult, Estimate, Fault, Outcome, Stage, Task};
use nalgebra::{Matrix6, Vector2};
use serde_json::{Value, json};
use tokio_util::sync::{CancellationToken, DropGuard};
use tower::ServiceExt as _;

use crate::support::{Answer, Service, json_post, png};

fn outcome(task: &Task) -> Outcome {
    let segment = Segment2 { start: Vector2::new(10.0, 10.0), end: Vector2::new(50.0, 10.0) };
    Outcome {
        cost: None,
        estimate: Some(Estimate {
            orientation: task.approximation.orientation,
            covariance: Matrix6::identity() * 1e-4,
            sigma0: 1.0,
            redundancy: 10,
            configuration: 2.0,
        }),
        control_points: vec![ControlPointResult {
            name: "church".into(),
            kind: ControlKind::Lines,
            predicted_px: Some(Vector2::new(20.0, 40.0)),
            search_region_px: None,
            located_px: Some(Vector2::new(30.0, 35.0)),
            projected_px: None,
            used: true,
            segments_matched: 1,
            residual_px: Some(0.3),
            sensitivity: None,
        }],
        edges: vec![EdgeResult { control_point: 0, projected_px: segment, matched_px: vec![] }],
        evidence: None,
        trials: vec![],
        ground_height_m: None,
        footprint_m: Vec::new(),
        check_points: Vec::new(),
        pairs: vec![],
        ground_precision: vec![],
        consensus: None,
        diagnosis: Diagnosis {
            verdict: Verdict::Yellow,
            score: 1.0,
            threshold: 2.0,
            probability_correct: 0.7,
            features: None,
            reasons: vec![Reason { code: "few_control_points", detail: "Only one control point was found.".into() }],
            probably_right: vec!["church".into()],
            probably_wrong: vec![],
        },
    }
}

/// Succeeds at once.
pub(crate) fn quick() -> Orient {
    Arc::new(|_, _, task, observer| {
        observer.progress(Stage::Predict, 0.1);
        Ok(outcome(task))
    })
}

/// Waits until it is let go or cancelled.
pub(crate) fn held(gate: &Arc<AtomicBool>) -> Orient {
    let gate = gate.clone();
    Arc::new(move |_, _, task, observer| {
        observer.progress(Stage::Locate, 0.4);
        while !gate.load(Ordering::SeqCst) {
            if observer.cancelled() {
                return Err(Fault::Cancelled);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(outcome(task))
    })
}

/// A service that works, with a camera "camera" and one image.
pub(crate) struct Working {
    pub(crate) service: Service,
    pub(crate) image: String,
    stop: CancellationToken,
    _guard: DropGuard,
}

impl Working {
    pub(crate) async fn with(orient: Orient) -> Self {
        Self::set(|_| (), orient).await
    }

    pub(crate) async fn set(change: impl FnOnce(&mut Configuration), orient: Orient) -> Self {
        let one_at_a_time = |configuration: &mut Configuration| {
            configuration.workers = 1;
            change(configuration);
        };
        let service = Service::with_pipeline(one_at_a_time, orient).await;
        service.state.jobs.prepare().await.unwrap();
        let stop = CancellationToken::new();
        let (jobs, stopped) = (service.state.jobs.clone(), stop.clone());
        tokio::spawn(async move { jobs.run(stopped).await });
        let camera = json!({"name": "camera", "image_size_px": [64, 48], "principal_distance_px": 60.0,
            "principal_point_px": [32.0, 24.0]});
        assert_eq!(service.post("/api/v1/cameras", &camera).await.status, 201);
        let image = service.upload("image/png", png(7)).await.json()["id"].as_str().unwrap().to_owned();
        Self { service, image, stop: stop.clone(), _guard: stop.drop_guard() }
    }

    pub(crate) fn request(&self) -> Value {
        json!({"image": self.image, "camera": "camera", "approximation": {
            "position": {"crs": "EPSG:4979", "coordinates": [16.6, 52.7, 400.0]}, "kappa_deg": 10}})
    }

    pub(crate) async fn ask(&self, request: &Value, headers: &[(&'static str, &str)]) -> Answer {
        let mut post = json_post("/api/v1/orientations", request);
        for (name, value) in headers {
            post.headers_mut().insert(*name, value.parse().unwrap());
        }
        self.service.send(post).await
    }

    async fn get(&self, id: &str, rest: &str) -> Answer {
        self.service.get(&format!("/api/v1/orientations/{id}{rest}")).await
    }

    pub(super) async fn until(&self, id: &str, status: &str) -> Value {
        let began = Instant::now();
        loop {
            let orientation = self.get(id, "").await.json();
            if orientation["status"] == status {
                return orientation;
            }
            assert!(began.elapsed() < Duration::from_secs(20), "not {status}: {orientation}");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }
}

pub(super) fn id(answer: &Answer) -> String {
    answer.json()["id"].as_str().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn who_waits_gets_the_result() {
    let working = Working::with(quick()).await;
    let answer = working.ask(&working.request(), &[("prefer", "wait=20")]).await;
    assert_eq!(answer.status, 200);
    assert_eq!(answer.headers["preference-applied"], "wait=20");
    let orientation = answer.json();
    assert_eq!(orientation["status"], "succeeded");
    assert_eq!(orientation["verdict"], "yellow");
    assert_eq!(orientation["error"], Value::Null);
    let result = &orientation["result"];
    assert_eq!(result["diagnosis"]["reasons"][0]["code"], "few_control_points");
    assert_eq!(result["rotation"]["frame"].as_str().unwrap().split(' ').next(), Some("+proj=topocentric"));
    assert_eq!(
        result["approximation"]["origin"],
        json!({"position": "request", "tilt": "default", "kappa": "request"})
    );
    let shown = working.get(orientation["id"].as_str().unwrap(), "").await;
    assert_eq!(shown.json(), orientation);
}

#[tokio::test(flavor = "multi_thread")]
async fn who_does_not_wait_is_told_where_to_look() {
    let gate = Arc::new(AtomicBool::new(false));
    let working = Working::with(held(&gate)).await;
    let answer = working.ask(&working.request(), &[]).await;
    assert_eq!(answer.status, 202);
    assert!(!answer.headers.contains_key("preference-applied"));
    let id = id(&answer);
    assert_eq!(answer.headers["location"], format!("/api/v1/orientations/{id}"));
    let running = working.until(&id, "running").await;
    assert!(running.get("result").is_none());
    // too short a wait ends with 202 as well
    let second = working.ask(&working.request(), &[("prefer", "wait=1")]).await;
    assert_eq!((second.status.as_u16(), &second.headers["preference-applied"]), (202, &"wait=1".parse().unwrap()));
    assert_eq!(second.json()["status"], "queued");
    let running = working.get(&id, "").await.json();
    assert_eq!((&running["stage"], &running["progress"]), (&json!("locate"), &json!(0.4)));
    gate.store(true, Ordering::SeqCst);
    let done = working.until(&id, "succeeded").await;
    assert_eq!(done["progress"], 1.0);
}

#[tokio::test(flavor = "multi_thread")]
async fn same_request_with_the_same_key_is_one_orientation() {
    let working = Working::with(quick()).await;
    let key = [("idempotency-key", "one"), ("prefer", "wait=20")];
    let first = working.ask(&working.request(), &key).await;
    let second = working.ask(&working.request(), &key).await;
    assert_eq!(first.json(), second.json());
    let mut other = working.request();
    other["tolerance_gsd"] = json!(3);
    working.ask(&other, &key).await.problem(422);
    assert_eq!(working.service.get("/api/v1/orientations").await.json()["items"].as_array().unwrap().len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn cancelling_ends_it_and_nothing_that_has_ended() {
    let gate = Arc::new(AtomicBool::new(false));
    let working = Working::with(held(&gate)).await;
    let running = id(&working.ask(&working.request(), &[]).await);
    working.until(&running, "running").await;
    let queued = id(&working.ask(&working.request(), &[]).await);
    for id in [&queued, &running, &running] {
        let answer = working.service.delete(&format!("/api/v1/orientations/{id}")).await;
        assert_eq!((answer.status.as_u16(), &answer.json()["status"]), (200, &json!("cancelled")));
    }
    gate.store(true, Ordering::SeqCst);
    let done = id(&working.ask(&working.request(), &[("prefer", "wait=20")]).await);
    working.until(&done, "succeeded").await;
    working.service.delete(&format!("/api/v1/orientations/{done}")).await.problem(409);
    working.service.delete("/api/v1/orientations/01a20225-f91a-7133-9892-18bd6449110e").await.problem(404);
    assert_eq!(working.get(&running, "").await.json()["status"], "cancelled");
    working.get(&running, "/overlay").await.problem(404);
}

#[tokio::test(flavor = "multi_thread")]
async fn events_tell_what_happens_and_end() {
    let gate = Arc::new(AtomicBool::new(false));
    let working = Working::with(held(&gate)).await;
    let id = id(&working.ask(&working.request(), &[]).await);
    working.until(&id, "running").await;
    let opener = async {
        tokio::time::sleep(Duration::from_millis(100)).await;
        gate.store(true, Ordering::SeqCst);
    };
    let (answer, ()) = tokio::join!(working.get(&id, "/events"), opener);
    assert_eq!(answer.headers["content-type"], "text/event-stream");
    let text = String::from_utf8(answer.body.to_vec()).unwrap();
    assert!(text.starts_with("event: progress\ndata: {"), "{text}");
    assert!(text.contains("event: end\ndata: {\"status\":\"succeeded\",\"verdict\":\"yellow\"}"), "{text}");
    // of what has ended, only the end
    let text = String::from_utf8(working.get(&id, "/events").await.body.to_vec()).unwrap();
    assert!(text.starts_with("event: end"), "{text}");
    working.get("01a20225-f91a-7133-9892-18bd6449110e", "/events").await.problem(404);
}

#[tokio::test(flavor = "multi_thread")]
async fn who_waits_or_listens_does_not_hold_up_the_end_of_the_service() {
    let working = Working::with(held(&Arc::default())).await;
    let id = id(&working.ask(&working.request(), &[]).await);
    working.until(&id, "running").await;
    let began = Instant::now();
    let end = async {
        tokio::time::sleep(Duration::from_millis(100)).await;
        working.stop.cancel();
    };
    let request = working.request();
    let (answer, events, ()) =
        tokio::join!(working.ask(&request, &[("prefer", "wait=60")]), working.get(&id, "/events"), end);
    assert_eq!(answer.status, 202);
    assert!(!String::from_utf8_lossy(&events.body).contains("event: end"));
    assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
    assert_eq!(working.until(&id, "queued").await["attempts"], 0, "what was interrupted does not count");
}

#[tokio::test(flavor = "multi_thread")]
async fn overlay_is_a_picture_in_the_format_asked_for() {
    let working = Working::with(quick()).await;
    let id = id(&working.ask(&working.request(), &[("prefer", "wait=20")]).await);
    let overlay = async |accept: &str, query: &str| {
        let path = format!("/api/v1/orientations/{id}/overlay{query}");
        working.service.send(Request::get(path).header("accept", accept).body(Body::empty()).unwrap()).await
    };
    for (accept, kind) in [("image/png", "image/png"), ("image/jpeg", "image/jpeg"), ("*/*", "image/jpeg")] {
        let answer = overlay(accept, "").await;
        assert_eq!(answer.headers["content-type"], kind);
        let picture = image::load_from_memory(&answer.body).unwrap();
        assert_eq!((picture.width(), picture.height()), (64, 48));
    }
    let picture = image::load_from_memory(&overlay("image/png", "").await.body).unwrap().to_rgb8();
    assert_eq!(picture.get_pixel(45, 10).0, [86, 180, 233], "the edge of a control point that was used");
    let narrow = image::load_from_memory(&overlay("image/png", "?width=32").await.body).unwrap();
    assert_eq!((narrow.width(), narrow.height()), (32, 24));
    assert_eq!(overlay("image/png", "?width=1").await.problem(422), ["?width"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn list_is_filtered_and_paged() {
    let working = Working::with(quick()).await;
    let mut ids = Vec::new();
    for _ in 0..3 {
        ids.push(id(&working.ask(&working.request(), &[("prefer", "wait=20")]).await));
    }
    let list = async |query: &str| {
        let page = working.service.get(&format!("/api/v1/orientations?{query}")).await.json();
        let items = page["items"].as_array().unwrap().clone();
        (
            items.iter().map(|item| item["id"].as_str().unwrap().to_owned()).collect::<Vec<_>>(),
            page["next_cursor"].clone(),
        )
    };
    let newest_first: Vec<_> = ids.iter().rev().cloned().collect();
    assert_eq!(list("verdict=yellow&status=succeeded").await.0, newest_first);
    assert_eq!(list("verdict=green").await.0, Vec::<String>::new());
    assert_eq!(list(&format!("image={}", working.image)).await.0.len(), 3);
    assert_eq!(list("image=01a20225-f91a-7133-9892-18bd6449110e").await.0.len(), 0);
    assert_eq!(list("since=2100-01-01T00:00:00Z").await.0.len(), 0);
    assert_eq!(list("since=2020-01-01T00:00:00Z").await.0.len(), 3);
    let (first, cursor) = list("limit=2").await;
    let (second, end) = list(&format!("limit=2&cursor={}", cursor.as_str().unwrap())).await;
    assert_eq!([first, second].concat(), newest_first);
    assert_eq!(end, Value::Null);
    assert_eq!(list("until=2020-01-01T00:00:00Z").await.0.len(), 0);
    assert_eq!(list("since=%2B200000-01-01T00:00:00Z").await.0.len(), 0);
    assert_eq!(list("since=-200000-01-01T00:00:00Z&until=%2B200000-01-01T00:00:00Z").await.0.len(), 3);
    assert_eq!(list("camera=camera&reason=few_control_points&review=open&until=2100-01-01T00:00:00Z").await.0.len(), 3);
    assert_eq!(list("camera=other").await.0.len(), 0);
    assert_eq!(list("block=01a20225-f91a-7133-9892-18bd6449110e").await.0.len(), 0);
    assert_eq!(list("reason=tolerance").await.0.len(), 0);
    assert_eq!(list("review=accepted").await.0.len(), 0);
    assert_eq!(list(&format!("q={}", ids[1])).await.0, ids[1..2]);
    assert_eq!(list(&format!("q={}", working.image)).await.0.len(), 3);
    assert_eq!(list("q=no+such+image").await.0.len(), 0);
    assert_eq!(list("q=").await.0.len(), 3);
    let long = format!("q={}", "x".repeat(201));
    for (query, pointer) in [
        ("status=done", "?status"),
        ("verdict=blue", "?verdict"),
        ("image=x", "?image"),
        ("since=now", "?since"),
        ("until=now", "?until"),
        ("review=maybe", "?review"),
        ("reason=Why%3F", "?reason"),
        ("reason=", "?reason"),
        ("block=x", "?block"),
        ("camera=%00", "?camera"),
        ("q=%00", "?q"),
        (&long, "?q"),
    ] {
        assert_eq!(working.service.get(&format!("/api/v1/orientations?{query}")).await.problem(422), [pointer]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_listed_says_why_and_of_what() {
    let working = Working::with(quick()).await;
    let mut request = crate::support::upload("image/png", png(8));
    *request.uri_mut() = "/api/v1/images?name=IMG_8.PNG".parse().unwrap();
    let image = working.service.send(request).await.json()["id"].clone();
    let mut body = working.request();
    body["image"] = image;
    let shown = working.ask(&body, &[("prefer", "wait=20")]).await.json();
    let listed = working.service.get("/api/v1/orientations?q=img_").await.json()["items"][0].clone();
    for told in [&shown, &listed] {
        assert_eq!((&told["image_name"], &told["camera_name"]), (&json!("IMG_8.PNG"), &json!("camera")));
        let reason = json!({"code": "few_control_points", "detail": "Only one control point was found."});
        let diagnosis = json!({"score": 1.0, "probability_correct": 0.7, "reasons": [reason]});
        assert_eq!(told["diagnosis"], diagnosis);
        assert!(told.get("review").is_none() && told.get("block").is_none(), "{told}");
    }
    assert!(listed.get("result").is_none());
}

#[tokio::test(flavor = "multi_thread")]
async fn events_of_all_tell_from_the_acceptance_to_the_verdict_and_end_with_the_service() {
    let working = Working::with(quick()).await;
    let request = Request::get("/api/v1/orientations/events").header("host", "localhost").body(Body::empty()).unwrap();
    let response = working.service.app.clone().oneshot(request).await.unwrap();
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    let first = id(&working.ask(&working.request(), &[("prefer", "wait=20")]).await);
    let second = id(&working.ask(&working.request(), &[]).await);
    working.service.delete(&format!("/api/v1/orientations/{second}")).await;
    tokio::time::sleep(Duration::from_millis(100)).await;
    working.stop.cancel();
    let body = axum::body::to_bytes(response.into_body(), usize::MAX).await.unwrap();
    let text = String::from_utf8(body.to_vec()).unwrap();
    let of = |id: &str| {
        let data = text.lines().filter_map(|line| line.strip_prefix("data: "));
        let changes = data.map(|data| serde_json::from_str::<Value>(data).unwrap());
        changes.filter(|change| change["id"] == id).collect::<Vec<_>>()
    };
    assert!(text.starts_with("event: change\ndata: {"), "{text}");
    let (told, cancelled) = (of(&first), of(&second));
    assert_eq!(told[0], json!({"id": first, "status": "queued", "stage": null, "progress": 0.0}));
    assert!(told.iter().any(|change| change["stage"] == "predict" && change["progress"] == 0.1), "{text}");
    let end = json!({"id": first, "status": "succeeded", "stage": null, "progress": 1.0, "verdict": "yellow"});
    assert_eq!(told.last(), Some(&end));
    assert!(cancelled.iter().any(|change| change["status"] == "queued"), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn who_does_not_listen_fast_enough_is_told_that_he_has_missed_something() {
    let working = Working::with(held(&Arc::default())).await;
    let request = Request::get("/api/v1/orientations/events").header("host", "localhost").body(Body::empty()).unwrap();
    let response = working.service.app.clone().oneshot(request).await.unwrap();
    let running = id(&working.ask(&working.request(), &[]).await);
    working.until(&running, "running").await;
    // each is accepted and cancelled: two changes
    for _ in 0..600 {
        let waiting = id(&working.ask(&working.request(), &[]).await);
        working.service.delete(&format!("/api/v1/orientations/{waiting}")).await;
    }
    working.stop.cancel();
    let body = axum::body::to_bytes(response.into_body(), usize::MAX).await.unwrap();
    let text = String::from_utf8_lossy(&body);
    assert!(text.starts_with("event: missed\ndata: {}\n\nevent: change\n"), "{}", &text[..100]);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_makes_no_sense_is_refused_with_its_pointer_and_changes_nothing() {
    let working = Working::with(quick()).await;
    let with = |pointer: &str, value: Value| {
        let mut body = working.request();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        body.pointer_mut(parent).unwrap()[key] = value;
        body
    };
    let cases = [
        ("/image", json!("no-such-image"), "/image"),
        ("/image", json!("01a20225-f91a-7133-9892-18bd6449110e"), "/image"),
        ("/image", json!(7), "/image"),
        ("/camera", json!("no such camera"), "/camera"),
        ("/colour", json!("red"), "/colour"),
        ("/approximation/position/crs", json!("EPSG:1"), "/approximation/position/crs"),
        ("/approximation/position/coordinates", json!([16.6, 99, 400]), "/approximation/position/coordinates/1"),
        ("/approximation/position/coordinates", json!([16.6, 52.7]), "/approximation/position/coordinates"),
        ("/approximation/position", Value::Null, "/approximation/position"),
        ("/approximation/omega_deg", json!("tilted"), "/approximation/omega_deg"),
        ("/approximation/omega_deg", json!(1e300), "/approximation/omega_deg"),
        ("/tolerance_gsd", json!(-1), "/tolerance_gsd"),
        ("/control", json!("points"), "/control"),
        ("/webhook", json!("http://example.org/hook"), "/webhook"),
        ("/webhook", json!("https://127.0.0.1/hook"), "/webhook"),
        ("/webhook", json!("https://169.254.169.254/"), "/webhook"),
        ("/webhook", json!("https://localhost/"), "/webhook"),
        ("/webhook", json!("no address"), "/webhook"),
        ("/output_crs", json!("EPSG:2"), "/output_crs"),
    ];
    for (pointer, value, named) in cases {
        let body = with(pointer, value);
        assert_eq!(working.ask(&body, &[]).await.problem(422), [named], "{body}");
    }
    let text = working.request().to_string().replace("52.7", "1e999");
    let post = Request::post("/api/v1/orientations").header("content-type", "application/json");
    working.service.send(post.body(Body::from(text)).unwrap()).await.problem(400);
    assert_eq!(working.service.get("/api/v1/orientations").await.json()["items"], json!([]));
}

#[tokio::test(flavor = "multi_thread")]
async fn camera_of_another_size_is_refused() {
    let working = Working::with(quick()).await;
    let camera = json!({"name": "large", "image_size_px": [640, 480], "principal_distance_px": 600.0,
        "principal_point_px": [320.0, 240.0]});
    working.service.post("/api/v1/cameras", &camera).await;
    let mut body = working.request();
    body["camera"] = json!("large");
    assert_eq!(working.ask(&body, &[]).await.problem(422), ["/camera"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn full_queue_is_503_with_a_time_to_come_back() {
    let gate = Arc::new(AtomicBool::new(false));
    let service = Service::with_pipeline(|configuration| configuration.queue_max_jobs = 1, held(&gate)).await;
    service.state.jobs.prepare().await.unwrap();
    let camera = json!({"name": "camera", "image_size_px": [64, 48], "principal_distance_px": 60.0,
        "principal_point_px": [32.0, 24.0]});
    service.post("/api/v1/cameras", &camera).await;
    let image = service.upload("image/png", png(7)).await.json()["id"].clone();
    let request = json!({"image": image, "camera": "camera", "approximation": {
        "position": {"crs": "EPSG:4979", "coordinates": [16.6, 52.7, 400.0]}}});
    assert_eq!(service.post("/api/v1/orientations", &request).await.status, 202);
    let refused = service.post("/api/v1/orientations", &request).await;
    refused.problem(503);
    assert_eq!(refused.headers["retry-after"], "10");
}
