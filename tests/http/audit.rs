//! The audit log.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use axum::http::Method;
use gable::database::{Dialects, query};
use gable::store::audit::Verified;
use gable::store::keys::Role;
use serde_json::{Value, json};

use crate::orientations::{Working, held};
use crate::support::{Service, camera, json_post, request};

async fn whole(service: &Service) -> i64 {
    match service.state.store.verify_audit().await.unwrap() {
        Verified::Whole { rows, .. } => rows,
        broken => panic!("{broken:?}"),
    }
}

#[tokio::test]
async fn what_is_changed_or_refused_is_noted_with_who_did_it() {
    let service = Service::new().await;
    service.post("/api/v1/cameras", &camera("first")).await;
    let (reader, key) = service.key(Role::Reader).await;
    let (admin, _) = service.key(Role::Admin).await;
    let mut refused = json_post("/api/v1/cameras", &camera("second"));
    refused.headers_mut().insert("authorization", format!("Bearer {reader}").parse().unwrap());
    service.send(refused).await.problem(403);
    service.post("/api/v1/session", &json!({"name": "anna", "password": "wrong horse battery"})).await.problem(401);
    // what changes nothing is not noted
    service.send(request(&Method::GET, "/api/v1/cameras", Some(&reader))).await;
    service.send(request(&Method::DELETE, "/api/v1/cameras/none", Some(&admin))).await.problem(404);
    let log = service.send(request(&Method::GET, "/api/v1/audit", Some(&admin))).await.json();
    let row = |entry: &Value| {
        let text = |field: &str| entry[field].as_str().unwrap().to_owned();
        (entry["number"].as_i64().unwrap(), text("who"), text("action"), entry["status"].as_i64().unwrap())
    };
    let rows: Vec<_> = log["items"].as_array().unwrap().iter().map(row).collect();
    let expected = [
        (3, "nobody".to_owned(), "POST /api/v1/session".to_owned(), 401),
        (2, key.id.to_string(), "POST /api/v1/cameras".to_owned(), 403),
        (1, "loopback".to_owned(), "POST /api/v1/cameras".to_owned(), 201),
    ];
    assert_eq!(rows, expected);
    let first = &log["items"][2];
    assert!(first["object"].as_str().unwrap().starts_with("/api/v1/cameras/"));
    assert!(!first["request_id"].as_str().unwrap().is_empty());
    let page = async |rest: &str| {
        let path = format!("/api/v1/audit?{rest}");
        service.send(request(&Method::GET, &path, Some(&admin))).await.json()
    };
    assert_eq!(page("who=loopback").await["items"].as_array().unwrap().len(), 1);
    assert_eq!(page("since=2100-01-01T00:00:00Z").await["items"], json!([]));
    let one = page("limit=1").await;
    let next = page(&format!("limit=1&cursor={}", one["next_cursor"].as_str().unwrap())).await;
    assert_eq!(next["items"][0]["number"], 2);
}

#[tokio::test]
async fn one_byte_that_was_changed_is_found() {
    let service = Service::new().await;
    for name in ["a", "b", "c", "d"] {
        service.post("/api/v1/cameras", &camera(name)).await;
    }
    assert_eq!(whole(&service).await, 4);
    let database = service.state.store.database();
    for forbidden in ["UPDATE audit SET who = 'x' WHERE number = 3", "DELETE FROM audit WHERE number = 3"] {
        let error = query(forbidden).execute(database).await.unwrap_err();
        assert!(error.to_string().contains("append-only"), "{error}");
    }
    let triggers = [
        Dialects {
            sqlite: "DROP TRIGGER audit_is_not_changed",
            postgres: "DROP TRIGGER audit_is_not_changed ON audit",
        },
        Dialects { sqlite: "DROP TRIGGER audit_is_not_shortened", postgres: "SELECT 1" },
    ];
    for trigger in triggers {
        query(database.dialect(trigger)).execute(database).await.unwrap();
    }
    let tampers = [
        ("UPDATE audit SET who = 'loopbacc' WHERE number = 3", 3),
        ("UPDATE audit SET who = 'loopback' WHERE number = 3", 0),
        ("UPDATE audit SET status = 200 WHERE number = 2", 2),
        ("UPDATE audit SET status = 201 WHERE number = 2", 0),
        ("DELETE FROM audit WHERE number = 2", 2),
    ];
    for (tamper, broken) in tampers {
        assert_eq!(query(tamper).execute(database).await.unwrap(), 1);
        let found = service.state.store.verify_audit().await.unwrap();
        match broken {
            0 => assert!(matches!(found, Verified::Whole { rows: 4, .. }), "{tamper}: {found:?}"),
            number => assert_eq!(found, Verified::Broken { number }, "{tamper}"),
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn many_at_once_make_one_chain() {
    let service = std::sync::Arc::new(Service::new().await);
    let adding = (0..40).map(|number| {
        let service = service.clone();
        tokio::spawn(async move { service.post("/api/v1/cameras", &camera(&format!("{number}"))).await.status })
    });
    for added in adding.collect::<Vec<_>>() {
        assert_eq!(added.await.unwrap(), 201);
    }
    assert_eq!(whole(&service).await, 40);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_accepted_is_noted_even_if_the_client_goes_away() {
    let gate = Arc::new(AtomicBool::new(false));
    let working = Working::set(|_| (), held(&gate)).await;
    let before = whole(&working.service).await;
    let (wanted, wait) = (working.request(), [("prefer", "wait=20")]);
    assert!(tokio::time::timeout(Duration::from_millis(500), working.ask(&wanted, &wait)).await.is_err());
    gate.store(true, Ordering::SeqCst);
    let began = Instant::now();
    while whole(&working.service).await == before {
        assert!(began.elapsed() < Duration::from_secs(20));
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let last = working.service.state.store.audit(None, None, None, 1).await.unwrap().remove(0);
    assert_eq!((last.action.as_str(), last.status), ("POST /api/v1/orientations", 200));
}
