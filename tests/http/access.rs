//! Who may call what.

use axum::body::Body;
use axum::http::{Method, Request};
use gable::http::access::{Access, ROUTES};
use gable::store::keys::Role;

use crate::support::{Service, camera, json_post, request};

async fn public_service() -> Service {
    Service::with(|configuration| configuration.listen = "0.0.0.0:8080".parse().unwrap()).await
}

fn filled(path: &str) -> String {
    let id = "01a20225-f91a-7133-9892-18bd6449110e";
    let filled = path.replace("{id}", id).replace("{image}", id).replace("{name}", "a").replace("{file}", "model.svm");
    filled.replace("{*rest}", "index.html")
}

#[tokio::test]
async fn every_route_answers_exactly_the_roles_of_its_rule() {
    let service = public_service().await;
    let (revoked, key) = service.key(Role::Admin).await;
    assert!(service.state.store.revoke_key(key.id).await.unwrap());
    let mut callers = vec![(None, None), (Some("gable_unknown".to_owned()), None), (Some(revoked), None)];
    for role in Role::ALL {
        callers.push((Some(service.key(role).await.0), Some(role)));
    }
    for (method, path, access) in ROUTES {
        for (key, role) in &callers {
            let status = service.send(request(method, &filled(path), key.as_deref())).await.status.as_u16();
            let expected = match (access, role) {
                (Access::Public, _) => "let through",
                (Access::AtLeast(_), None) => "401",
                (Access::AtLeast(least), Some(role)) if role < least => "403",
                (Access::AtLeast(_), Some(_)) => "let through",
            };
            let found = match status {
                401 => "401",
                403 => "403",
                _ => "let through",
            };
            assert_eq!(found, expected, "{method} {path} as {role:?}: {status}");
        }
    }
}

#[tokio::test]
async fn key_that_is_revoked_works_no_more() {
    let service = public_service().await;
    let (secret, key) = service.key(Role::Reader).await;
    let ask = || request(&Method::GET, "/api/v1/cameras", Some(&secret));
    assert_eq!(service.send(ask()).await.status, 200);
    assert!(service.state.store.revoke_key(key.id).await.unwrap());
    let answer = service.send(ask()).await;
    answer.problem(401);
    assert_eq!(answer.headers["www-authenticate"], "Bearer");
}

#[tokio::test]
async fn refused_request_changes_nothing() {
    let service = public_service().await;
    let (reader, _) = service.key(Role::Reader).await;
    let mut add = json_post("/api/v1/cameras", &camera("forbidden"));
    add.headers_mut().insert("authorization", format!("Bearer {reader}").parse().unwrap());
    service.send(add).await.problem(403);
    assert!(service.state.store.camera("forbidden").await.unwrap().is_none());
}

#[tokio::test]
async fn authorization_that_is_no_bearer_key_is_refused_even_on_loopback() {
    let service = Service::new().await;
    for value in ["Basic YTpi", "Bearer", "Bearer wrong", "gable_0"] {
        let ask = Request::get("/api/v1/cameras").header("authorization", value).body(Body::empty()).unwrap();
        service.send(ask).await.problem(401);
    }
}

#[tokio::test]
async fn loopback_without_keys_lets_in_this_machine_only() {
    let service = Service::new().await;
    let cases: [(&[(&str, &str)], u16); 14] = [
        (&[("host", "127.0.0.1:8080")], 200),
        (&[("host", "localhost")], 200),
        (&[("host", "[::1]:8080")], 200),
        (&[("host", "localhost:8080"), ("origin", "http://localhost:8080")], 200),
        (&[("host", "example.org")], 403),
        (&[("host", "127.0.0.1.example.org")], 403),
        (&[("host", "localhost.example.org:8080")], 403),
        (&[("host", "192.168.1.5:8080")], 403),
        (&[("host", "")], 403),
        (&[("host", "localhost:8080"), ("origin", "http://localhost:3000")], 403),
        (&[("host", "localhost:8080"), ("origin", "https://evil.example")], 403),
        (&[("host", "localhost:8080"), ("origin", "null")], 403),
        (&[("host", "localhost:8080"), ("x-forwarded-for", "203.0.113.7")], 403),
        (&[("host", "localhost:8080"), ("forwarded", "for=203.0.113.7")], 403),
    ];
    for (headers, status) in cases {
        let ask = headers.iter().fold(Request::get("/api/v1/cameras"), |ask, (name, value)| ask.header(*name, *value));
        let answer = service.send(ask.body(Body::empty()).unwrap()).await;
        assert_eq!(answer.status.as_u16(), status, "{headers:?}");
    }
}

#[tokio::test]
async fn first_key_closes_the_open_door_and_its_revocation_does_not_open_it() {
    let service = Service::new().await;
    assert_eq!(service.get("/api/v1/cameras").await.status, 200);
    let (secret, key) = service.key(Role::Admin).await;
    service.get("/api/v1/cameras").await.problem(401);
    assert_eq!(service.send(request(&Method::GET, "/api/v1/cameras", Some(&secret))).await.status, 200);
    assert!(service.state.store.revoke_key(key.id).await.unwrap());
    service.get("/api/v1/cameras").await.problem(401);
    let reopened = &service.reopened().await;
    assert!(reopened.any_key().await.unwrap());
}

#[tokio::test]
async fn database_holds_no_key() {
    let service = Service::new().await;
    let (secret, _) = service.key(Role::Admin).await;
    service.state.store.close().await;
    let folder = service.state.store.folder();
    for file in ["gable.db", "gable.db-wal"] {
        let bytes = std::fs::read(folder.join(file)).unwrap_or_default();
        assert!(!bytes.windows(secret.len()).any(|window| window == secret.as_bytes()), "{file}");
    }
}
