//! `Idempotency-Key`.

use axum::body::Body;
use axum::http::Request;
use gable::store::idempotency::Claim;
use gable::store::keys::Role;
use serde_json::{Value, json};
use std::time::Duration;

use crate::support::{Answer, Service, camera, jpeg, json_post, upload};

fn keyed(mut request: Request<Body>, key: &str) -> Request<Body> {
    request.headers_mut().insert("idempotency-key", key.parse().unwrap());
    request
}

async fn add(service: &Service, key: &str, body: &Value) -> Answer {
    service.send(keyed(json_post("/api/v1/cameras", body), key)).await
}

#[tokio::test]
async fn same_request_gets_the_first_answer_again() {
    let service = Service::new().await;
    let first = add(&service, "k1", &camera("once")).await;
    assert_eq!(first.status, 201);
    assert!(!first.headers.contains_key("idempotency-replayed"));
    service.delete("/api/v1/cameras/once").await;
    let again = add(&service, "k1", &camera("once")).await;
    assert_eq!(again.status, 201);
    assert_eq!(again.headers["idempotency-replayed"], "true");
    for header in ["content-type", "location"] {
        assert_eq!(again.headers[header], first.headers[header]);
    }
    assert_eq!(again.json(), first.json());
    service.get("/api/v1/cameras/once").await.problem(404);
}

#[tokio::test]
async fn another_request_with_the_key_is_refused() {
    let service = Service::new().await;
    add(&service, "k1", &camera("first")).await;
    assert_eq!(add(&service, "k1", &camera("second")).await.problem(422), ["Idempotency-Key"]);
    let elsewhere = keyed(upload("image/jpeg", camera("first").to_string()), "k1");
    service.send(elsewhere).await.problem(422);
    assert!(service.state.store.camera("second").await.unwrap().is_none());
}

#[tokio::test]
async fn refusals_are_answers_too_but_cut_off_bodies_are_not() {
    let service = Service::new().await;
    let refused = add(&service, "k1", &json!({})).await;
    refused.problem(422);
    let again = add(&service, "k1", &json!({})).await;
    assert_eq!(again.headers["idempotency-replayed"], "true");
    assert_eq!(again.json(), refused.json());
    let half = [Ok(jpeg(0)[..100].to_vec()), Err(std::io::Error::other("gone"))];
    let broken = Body::from_stream(futures_util::stream::iter(half));
    service.send(keyed(upload("image/jpeg", broken), "k2")).await.problem(400);
    assert_eq!(service.send(keyed(upload("image/jpeg", jpeg(0)), "k2")).await.status, 201);
    assert_eq!(service.send(keyed(upload("image/jpeg", jpeg(0)), "k2")).await.status, 201);
}

#[tokio::test]
async fn many_at_once_do_it_once() {
    let service = Service::new().await;
    let body = camera("contested");
    let answers = futures_util::future::join_all((0..50).map(|_| add(&service, "k1", &body))).await;
    let first = |answer: &&Answer| answer.status == 201 && !answer.headers.contains_key("idempotency-replayed");
    assert_eq!(answers.iter().filter(first).count(), 1);
    for answer in answers.iter().filter(|answer| answer.status != 201) {
        answer.problem(409);
        assert_eq!(answer.headers["retry-after"], "1");
    }
}

#[tokio::test]
async fn keys_of_different_callers_do_not_meet() {
    let service = Service::new().await;
    let (anna, _) = service.key(Role::Operator).await;
    let (berta, _) = service.key(Role::Operator).await;
    for (secret, name) in [(&anna, "hers"), (&berta, "the other's")] {
        let mut request = keyed(json_post("/api/v1/cameras", &camera(name)), "k1");
        request.headers_mut().insert("authorization", format!("Bearer {secret}").parse().unwrap());
        assert_eq!(service.send(request).await.status, 201, "{name}");
    }
}

#[tokio::test]
async fn malformed_keys_are_refused() {
    let service = Service::new().await;
    for key in ["", &"x".repeat(256)] {
        let pointers = add(&service, key, &camera("malformed")).await.problem(400);
        assert_eq!(pointers, ["Idempotency-Key"]);
    }
}

#[tokio::test]
async fn client_that_goes_away_finds_its_answer() {
    let service = Service::new().await;
    let mut request = keyed(json_post("/api/v1/cameras", &camera("left alone")), "k1");
    request.headers_mut().insert("host", "localhost".parse().unwrap());
    {
        use std::future::Future as _;
        use tower::ServiceExt as _;
        let mut under_way = Box::pin(service.app.clone().oneshot(request));
        // until the claim is made and the work has begun, but not until it is done
        for _ in 0..500 {
            let waker = std::task::Waker::noop();
            if under_way.as_mut().poll(&mut std::task::Context::from_waker(waker)).is_ready() {
                break;
            }
            tokio::time::sleep(Duration::from_millis(1)).await;
            if service.state.store.camera("left alone").await.unwrap().is_some() {
                break;
            }
        }
    }
    let mut again = add(&service, "k1", &camera("left alone")).await;
    for _ in 0..100 {
        if again.status != 409 {
            break;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
        again = add(&service, "k1", &camera("left alone")).await;
    }
    assert_eq!(again.status, 201);
    assert_eq!(again.headers["idempotency-replayed"], "true");
}

#[tokio::test]
async fn after_a_crash_the_second_try_has_the_id_of_the_first() {
    let service = Service::new().await;
    let store = &service.state.store;
    let day = Duration::from_secs(86_400);
    let Claim::Granted { resource_id } = store.claim_idempotency("loopback", "k1", day).await.unwrap() else {
        panic!("a new key must be granted")
    };
    add(&service, "k1", &camera("crashed")).await.problem(409);
    store.release_all_idempotency().await.unwrap();
    let made = add(&service, "k1", &camera("crashed")).await;
    assert_eq!(made.status, 201);
    assert_eq!(made.json()["id"], resource_id.to_string());
}

#[tokio::test]
async fn keys_are_forgotten_after_their_time() {
    let service = Service::with(|configuration| configuration.idempotency_kept_s = 1).await;
    add(&service, "k1", &camera("early")).await;
    tokio::time::sleep(Duration::from_millis(1100)).await;
    assert_eq!(add(&service, "k1", &camera("late")).await.status, 201);
}
