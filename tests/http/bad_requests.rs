//! What is malformed gets its problem, and changes nothing.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use crate::support::{Service, camera, json_post};

fn raw(content_type: &str, body: impl Into<Body>) -> Request<Body> {
    Request::post("/api/v1/cameras").header("content-type", content_type).body(body.into()).unwrap()
}

#[tokio::test]
async fn unknown_addresses_and_methods() {
    let service = Service::new().await;
    service.get("/nothing").await.problem(404);
    service.get("/api/v1/nothing").await.problem(404);
    service.get("/api/v2/cameras").await.problem(404);
    service.get("/api/v1/images/not-an-id").await.problem(404);
    service.get("/api/v1/cameras/nobody").await.problem(404);
    let answer = service.delete("/api/v1/cameras").await;
    answer.problem(405);
    assert_eq!(answer.headers["allow"], "GET,HEAD,POST");
}

#[tokio::test]
async fn bodies_that_are_no_json() {
    let service = Service::new().await;
    for body in ["", "{", "{\"name\": \"x\",}", "{\"k\": NaN}", "\u{feff}{}", "{} {}"] {
        let status = service.send(raw("application/json", body)).await.status.as_u16();
        assert!(matches!(status, 400 | 422), "{body:?}: {status}");
    }
    service.send(raw("application/json", "{\"name\": ")).await.problem(400);
    service.send(raw("application/json", [0xff, 0xfe].as_slice())).await.problem(400);
    let deep = "[".repeat(100_000);
    service.send(raw("application/json", deep)).await.problem(422);
    let twice = format!("{} ", camera("trailing")).replace("} ", "} {}");
    service.send(raw("application/json", twice)).await.problem(400);
    assert!(service.state.store.camera("trailing").await.unwrap().is_none());
}

#[tokio::test]
async fn bodies_of_another_type() {
    let service = Service::new().await;
    let body = camera("typed").to_string();
    service.send(raw("text/plain", body.clone())).await.problem(415);
    service.send(raw("application/x-www-form-urlencoded", "a=b")).await.problem(415);
    service.send(Request::post("/api/v1/cameras").body(Body::from(body.clone())).unwrap()).await.problem(415);
    let mut packed = raw("application/json", body.clone());
    packed.headers_mut().insert("content-encoding", "gzip".parse().unwrap());
    service.send(packed).await.problem(415);
    assert_eq!(service.send(raw("Application/JSON; charset=utf-8", body)).await.status, 201);
}

#[tokio::test]
async fn bodies_that_are_too_large() {
    let service = Service::with(|configuration| configuration.body_max_bytes = 1000).await;
    let padded = format!("{}{}", camera("large"), " ".repeat(1000));
    service.send(raw("application/json", padded.clone())).await.problem(413);
    let chunks = futures_util::stream::iter(padded.into_bytes().into_iter().map(|b| Ok::<_, std::io::Error>(vec![b])));
    service.send(raw("application/json", Body::from_stream(chunks))).await.problem(413);
    assert!(service.state.store.camera("large").await.unwrap().is_none());
}

#[tokio::test]
async fn fields_at_fault_are_pointed_at() {
    let service = Service::new().await;
    let with = |change: fn(&mut Value)| {
        let mut body = camera("pointed");
        change(&mut body);
        body
    };
    let cases: [(Value, &str); 20] = [
        (json!([]), ""),
        (with(|c| c["colour"] = json!("red")), "/colour"),
        (with(|c| c["role"] = json!("admin")), "/role"),
        (with(|c| c["distortion"]["k9"] = json!(1)), "/distortion/k9"),
        (with(|c| c["distortion"]["k1"] = json!("1")), "/distortion/k1"),
        (with(|c| c["distortion"]["model"] = json!("fisheye")), "/distortion/model"),
        (with(|c| c["distortion"]["k1"] = json!(-5)), "/distortion"),
        (with(|c| c["name"] = json!("")), "/name"),
        (with(|c| c["name"] = json!("a\u{0}b")), "/name"),
        (with(|c| c["name"] = json!("x".repeat(201))), "/name"),
        (with(|c| c["name"] = json!("01a20225-f91a-7133-9892-18bd6449110e")), "/name"),
        (with(|c| c["image_size_px"] = json!([0, 3000])), "/image_size_px"),
        (with(|c| c["image_size_px"] = json!([4000.5, 3000])), "/image_size_px/0"),
        (with(|c| c["image_size_px"] = json!([-1, 3000])), "/image_size_px/0"),
        (with(|c| c["principal_distance_px"] = json!(0)), "/principal_distance_px"),
        (with(|c| c["principal_distance_px"] = json!(-1)), "/principal_distance_px"),
        (with(|c| c["principal_point_px"] = json!([1, "2"])), "/principal_point_px/1"),
        (with(|c| drop(c.as_object_mut().unwrap().remove("principal_distance_px"))), "/principal_distance_px"),
        (with(|c| c["principal_distance_mm"] = json!(153.0)), "/principal_distance_mm"),
        (with(|c| c["fiducials"] = json!([])), "/fiducials"),
    ];
    for (body, pointer) in cases {
        let pointers = service.post("/api/v1/cameras", &body).await.problem(422);
        assert_eq!(pointers, [pointer], "{body}");
    }
    assert!(service.state.store.cameras(None, 10).await.unwrap().is_empty());
}

#[tokio::test]
async fn infinite_numbers_are_refused() {
    let service = Service::new().await;
    let text = camera("infinite").to_string().replace("2890.0", "1e999");
    let status = service.send(raw("application/json", text)).await.status.as_u16();
    assert!(matches!(status, 400 | 422), "{status}");
    assert!(service.state.store.camera("infinite").await.unwrap().is_none());
}

#[tokio::test]
async fn parameters_of_the_query() {
    let service = Service::new().await;
    let cases = [("limit=0", "?limit"), ("limit=201", "?limit"), ("limit=x", "?limit"), ("limit=-1", "?limit")];
    for (query, pointer) in cases.into_iter().chain([("cursor=zz", "?cursor"), ("limt=5", "?limt")]) {
        let pointers = service.get(&format!("/api/v1/cameras?{query}")).await.problem(422);
        assert_eq!(pointers, [pointer], "{query}");
    }
}

#[tokio::test]
async fn request_ids_are_taken_over_only_if_they_may_stand_in_a_log() {
    let service = Service::new().await;
    let long = "x".repeat(65);
    for (given, kept) in [("abc-1_2", true), ("a b", false), ("a\"b", false), ("", false), (long.as_str(), false)] {
        let ask = Request::get("/nothing").header("x-request-id", given).body(Body::empty()).unwrap();
        let answer = service.send(ask).await;
        answer.problem(404);
        assert_eq!(answer.headers["x-request-id"] == given, kept, "{given:?}");
    }
}

#[tokio::test]
async fn every_answer_has_the_headers_of_safety() {
    let service = Service::new().await;
    let add = json_post("/api/v1/cameras", &camera("safe"));
    for answer in [service.get("/health/live").await, service.get("/none").await, service.send(add).await] {
        assert_eq!(answer.headers["x-content-type-options"], "nosniff");
        assert_eq!(answer.headers["content-security-policy"], "default-src 'none'; frame-ancestors 'none'");
        assert!(!answer.headers.contains_key("access-control-allow-origin"));
    }
    let docs = service.get("/docs/").await;
    let policy = docs.headers["content-security-policy"].to_str().unwrap();
    assert!(policy.contains("script-src 'self';") && !policy.contains("http"), "{policy}");
}
