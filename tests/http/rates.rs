//! How often one may ask, how many at a time, and the headers of every answer.

use std::time::Duration;

use axum::body::Body;
use axum::http::{Method, Request};
use gable::http::rate::ClientAddress;
use gable::store::keys::Role;

use crate::support::{Answer, Service, request};

fn seconds(answer: &Answer) -> u64 {
    answer.headers["retry-after"].to_str().unwrap().parse().unwrap()
}

#[tokio::test]
async fn who_asks_too_often_is_told_when_to_come_back_and_others_are_not_held_up() {
    let service = Service::with(|configuration| {
        configuration.rate_per_s = 0.1;
        configuration.rate_burst = 3.0;
    })
    .await;
    let (often, _) = service.key(Role::Reader).await;
    let (seldom, _) = service.key(Role::Reader).await;
    let ask = |key: &str| request(&Method::GET, "/api/v1/cameras", Some(key));
    for _ in 0..3 {
        assert_eq!(service.send(ask(&often)).await.status, 200);
    }
    let refused = service.send(ask(&often)).await;
    refused.problem(429);
    assert!((1..=10).contains(&seconds(&refused)));
    assert_eq!(service.send(ask(&seldom)).await.status, 200);
    let from = |address: &str, path: &str| {
        let mut ask = Request::get(path).body(Body::empty()).unwrap();
        ask.extensions_mut().insert(ClientAddress(address.parse().unwrap()));
        ask
    };
    for _ in 0..3 {
        service.send(from("192.0.2.1", "/api/v1/cameras")).await.problem(401);
    }
    service.send(from("192.0.2.1", "/api/v1/cameras")).await.problem(429);
    service.send(from("192.0.2.1", "/api/v1/openapi.json")).await.problem(429);
    assert_eq!(service.send(from("192.0.2.2", "/api/v1/openapi.json")).await.status, 200);
    for _ in 0..10 {
        assert_eq!(service.send(from("192.0.2.1", "/health/live")).await.status, 200);
    }
}

#[tokio::test]
async fn what_is_too_much_at_a_time_is_refused_at_once_but_health_is_told() {
    let service = Service::with(|configuration| configuration.requests_max = 1).await;
    // a request whose body does not come
    let pending = Body::from_stream(futures_util::stream::pending::<Result<&str, std::io::Error>>());
    let waiting = Request::post("/api/v1/cameras").header("content-type", "application/json");
    let mut waiting = Box::pin(service.send(waiting.body(pending).unwrap()));
    assert!(tokio::time::timeout(Duration::from_millis(500), &mut waiting).await.is_err());
    let refused = service.get("/api/v1/cameras").await;
    refused.problem(503);
    assert_eq!(seconds(&refused), 1);
    assert_eq!(service.get("/health/live").await.status, 200);
    assert_eq!(service.get("/metrics").await.status, 200);
    drop(waiting);
    assert_eq!(service.get("/api/v1/cameras").await.status, 200);
}

#[tokio::test]
async fn every_answer_has_the_same_headers_of_security() {
    let service = Service::with(|configuration| configuration.cookie_secure = Some(true)).await;
    let expected = "cache-control: no-store
content-security-policy: default-src 'none'; frame-ancestors 'none'
cross-origin-resource-policy: same-origin
permissions-policy: accelerometer=(), camera=(), display-capture=(), geolocation=(), gyroscope=(), microphone=(), payment=(), usb=()
referrer-policy: no-referrer
strict-transport-security: max-age=63072000
x-content-type-options: nosniff
x-frame-options: DENY";
    let asks = [
        request(&Method::GET, "/health/live", None),
        request(&Method::GET, "/metrics", None),
        request(&Method::GET, "/api/v1/cameras", None),
        request(&Method::GET, "/api/v1/cameras", Some("wrong")),
        request(&Method::GET, "/api/v1/cameras/none", None),
        request(&Method::POST, "/api/v1/cameras", None),
        request(&Method::PUT, "/api/v1/cameras", None),
        request(&Method::GET, "/nowhere", None),
        request(&Method::GET, "/api/v1/orientations?limit=0", None),
    ];
    let names: Vec<&str> = expected.lines().map(|line| line.split_once(':').unwrap().0).collect();
    for ask in asks {
        let of = format!("{} {}", ask.method(), ask.uri());
        let answer = service.send(ask).await;
        let found: Vec<String> = names
            .iter()
            .filter_map(|name| Some(format!("{name}: {}", answer.headers.get(*name)?.to_str().unwrap())))
            .collect();
        assert_eq!(found.join("\n"), expected, "{of}");
        assert!(answer.headers.keys().all(|name| !name.as_str().starts_with("access-control-")), "{of}");
    }
    let plain = Service::new().await.get("/health/live").await;
    assert!(!plain.headers.contains_key("strict-transport-security"));
    let page = service.get("/docs/").await;
    assert!(page.headers["content-security-policy"].to_str().unwrap().contains("script-src 'self';"));
}
