//! Webhooks, from the request to the receiver.

use std::net::SocketAddr;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use axum::Router;
use axum::http::{HeaderMap, StatusCode};
use axum::routing::post;
use gable::database::query;
use gable::webhooks::{Sender, by_the_system, run, secret};
use serde_json::{Value, json};
use tokio_util::sync::{CancellationToken, DropGuard};

use crate::orientations::{Working, held, quick};
use crate::support::Service;

type Heard = Arc<Mutex<Vec<(HeaderMap, Value)>>>;

/// A receiver that gives these answers one after the other, and 200 from then on.
async fn receiver(answers: &[u16]) -> (SocketAddr, Heard) {
    let (heard, answers) = (Heard::default(), answers.to_vec());
    let hearing = heard.clone();
    let app = Router::new().route(
        "/hook",
        post(move |headers: HeaderMap, axum::Json(body): axum::Json<Value>| async move {
            let mut heard = hearing.lock().unwrap();
            heard.push((headers, body));
            StatusCode::from_u16(answers.get(heard.len() - 1).copied().unwrap_or(200)).unwrap()
        }),
    );
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move { axum::serve(listener, app).await });
    (address, heard)
}

async fn telling(service: &Service) -> DropGuard {
    let (store, policy) = (service.state.store.clone(), service.state.configuration.webhook_policy());
    let secret = secret(&store, None).await.unwrap();
    let stop = CancellationToken::new();
    tokio::spawn(run(store, Sender::new(policy, secret, by_the_system()).unwrap(), stop.clone()));
    stop.drop_guard()
}

async fn until(service: &Service, status: &str) -> Value {
    let began = Instant::now();
    loop {
        let listed = service.get(&format!("/api/v1/webhooks?status={status}")).await.json();
        if let Some(webhook) = listed["items"].as_array().and_then(|items| items.first()) {
            return webhook.clone();
        }
        let all = service.get("/api/v1/webhooks").await.json();
        assert!(began.elapsed() < Duration::from_secs(20), "not {status}: {all}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn receiver_that_fails_twice_is_told_until_it_has_it() {
    let working = Working::set(|configuration| configuration.webhook_allow_loopback = true, quick()).await;
    let _telling = telling(&working.service).await;
    let (address, heard) = receiver(&[500, 503]).await;
    let mut request = working.request();
    request["webhook"] = json!(format!("http://{address}/hook"));
    let orientation = working.ask(&request, &[("prefer", "wait=20")]).await.json();
    // one that nobody is told of
    working.ask(&working.request(), &[("prefer", "wait=20")]).await;
    let webhook = until(&working.service, "delivered").await;
    assert_eq!((&webhook["attempts"], &webhook["orientation"]), (&json!(3), &orientation["id"]));
    assert_eq!(webhook["last_error"], Value::Null);
    let heard = heard.lock().unwrap().clone();
    assert_eq!(heard.len(), 3);
    for (headers, body) in &heard {
        assert_eq!(headers["webhook-id"], webhook["id"].as_str().unwrap());
        assert!(headers["webhook-signature"].to_str().unwrap().starts_with("v1,"));
        assert_eq!(body["type"], "orientation.finished");
        let told = json!({"id": orientation["id"], "status": "succeeded", "verdict": "yellow"});
        assert_eq!(body["data"], told);
    }
    assert_eq!(working.service.get("/api/v1/webhooks").await.json()["items"].as_array().unwrap().len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_tried_for_a_day_is_given_up_and_can_be_sent_again() {
    let gate = Arc::new(AtomicBool::new(false));
    let working = Working::set(|configuration| configuration.webhook_allow_loopback = true, held(&gate)).await;
    let (address, heard) = receiver(&[500]).await;
    let mut request = working.request();
    request["webhook"] = json!(format!("http://{address}/hook"));
    let orientation = working.ask(&request, &[]).await.json();
    // who cancels is told, too
    let path = format!("/api/v1/orientations/{}", orientation["id"].as_str().unwrap());
    assert_eq!(working.service.delete(&path).await.status, 200);
    let update = query("UPDATE webhooks SET begun_at_ms = begun_at_ms - $1").bind(25 * 3_600_000_i64);
    assert_eq!(update.execute(working.service.state.store.database()).await.unwrap(), 1);
    let _telling = telling(&working.service).await;
    let webhook = until(&working.service, "given_up").await;
    assert_eq!((&webhook["attempts"], heard.lock().unwrap().len()), (&json!(1), 1));
    assert!(webhook["last_error"].as_str().unwrap().contains("500"), "{webhook}");
    let again = format!("/api/v1/webhooks/{}/resend", webhook["id"].as_str().unwrap());
    assert_eq!(working.service.post(&again, &json!({})).await.json()["status"], "waiting");
    let delivered = until(&working.service, "delivered").await;
    assert_eq!(delivered["id"], webhook["id"]);
    let heard = heard.lock().unwrap().clone();
    assert_eq!(heard[1].1["data"]["status"], "cancelled");
    working.service.post("/api/v1/webhooks/01a20225-f91a-7133-9892-18bd6449110e/resend", &json!({})).await.problem(404);
    assert_eq!(working.service.get("/api/v1/webhooks?status=lost").await.problem(422), ["?status"]);
}

#[tokio::test]
async fn two_processes_tell_each_event_once() {
    let working = Working::set(|configuration| configuration.webhook_allow_loopback = true, quick()).await;
    let mut request = working.request();
    request["webhook"] = json!("https://example.org/hook");
    for _ in 0..20 {
        assert_eq!(working.ask(&request, &[("prefer", "wait=20")]).await.status, 200);
    }
    let store = &working.service.state.store;
    let (one, other) = tokio::join!(store.take_due_webhooks(12), store.take_due_webhooks(12));
    let mut taken: Vec<_> = one.unwrap().into_iter().chain(other.unwrap()).map(|due| due.id).collect();
    let all = taken.len();
    taken.sort_unstable();
    taken.dedup();
    assert_eq!((all, taken.len()), (20, 20));
    assert!(store.take_due_webhooks(12).await.unwrap().is_empty());
}
