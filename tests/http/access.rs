//! Who may call what.

use std::time::Duration;

use axum::body::Body;
use axum::http::{Method, Request};
use chrono::{TimeDelta, Utc};
use gable::http::access::{Access, ROUTES};
use gable::store::accounts::Change;
use gable::store::keys::{Role, random_secret};
use serde_json::json;
use uuid::Uuid;

use crate::support::{Service, camera, json_post, request};

async fn public_service() -> Service {
    Service::with(|configuration| configuration.listen = "0.0.0.0:8080".parse().unwrap()).await
}

fn filled(path: &str) -> String {
    let id = "01a20225-f91a-7133-9892-18bd6449110e";
    let filled = path.replace("{id}", id).replace("{image}", id).replace("{name}", "a").replace("{file}", "model.svm");
    let filled = filled.replace("{level}", "0").replace("{column}", "0").replace("{row}", "0");
    filled.replace("{*rest}", "index.html")
}

/// How somebody shows who they are.
enum Shown {
    Nothing,
    Key(String),
    /// By the cookie of a session of an account, from a page with this `Origin`.
    Cookie(Uuid, Option<&'static str>),
}

impl Shown {
    /// A request with it. A session of its own each time: one of the routes ends it.
    async fn request(&self, service: &Service, method: &Method, path: &str) -> Request<Body> {
        match self {
            Self::Nothing => request(method, path, None),
            Self::Key(key) => request(method, path, Some(key)),
            Self::Cookie(account, origin) => {
                let secret = random_secret().unwrap();
                let lasting = service.state.configuration.sessions_last();
                service.state.store.begin_session(&secret, *account, None, lasting).await.unwrap();
                let mut ask = request(method, path, None);
                ask.headers_mut().insert("cookie", format!("a=b; __Host-gable={secret}").parse().unwrap());
                if let Some(origin) = origin {
                    ask.headers_mut().insert("origin", origin.parse().unwrap());
                }
                ask
            }
        }
    }

    /// Whether a browser says that it comes from elsewhere, or does not say.
    fn is_foreign(&self, method: &Method) -> bool {
        !method.is_safe() && matches!(self, Self::Cookie(_, origin) if *origin != Some(OURS))
    }
}

/// `Service::send` asks this host, and the service does not listen on loopback: TLS is in front of it.
const OURS: &str = "https://127.0.0.1:8080";

async fn callers(service: &Service) -> Vec<(Shown, Option<Role>)> {
    let (revoked, key) = service.key(Role::Admin).await;
    assert!(service.state.store.revoke_key(key.id).await.unwrap());
    let expired = random_secret().unwrap();
    let past = Some(Utc::now() - TimeDelta::seconds(1));
    service.state.store.add_key(&expired, "expired", Role::Admin, past).await.unwrap();
    let mut callers = vec![(Shown::Nothing, None)];
    callers.extend(["gable_unknown".to_owned(), revoked, expired].map(|key| (Shown::Key(key), None)));
    let disabled = service.state.store.add_account("disabled", Role::Admin, "").await.unwrap().unwrap();
    let change = Change { disabled: Some(true), ..Change::default() };
    service.state.store.change_account(disabled.id, &change).await.unwrap();
    callers.push((Shown::Cookie(disabled.id, Some(OURS)), None));
    for role in Role::ALL {
        callers.push((Shown::Key(service.key(role).await.0), Some(role)));
        let account = service.state.store.add_account(role.name(), role, "").await.unwrap().unwrap();
        for origin in [Some(OURS), None, Some("https://evil.example"), Some("http://127.0.0.1:8080"), Some("null")] {
            callers.push((Shown::Cookie(account.id, origin), Some(role)));
        }
    }
    callers
}

#[tokio::test]
async fn every_route_answers_exactly_the_roles_of_its_rule() {
    let service = Service::with(|configuration| {
        configuration.listen = "0.0.0.0:8080".parse().unwrap();
        configuration.rate_per_s = 0.0;
    })
    .await;
    let callers = callers(&service).await;
    // streams end at once
    service.state.jobs.stopping().cancel();
    for (method, path, access) in ROUTES {
        for (number, (shown, role)) in callers.iter().enumerate() {
            let ask = shown.request(&service, method, &filled(path)).await;
            let status = service.send(ask).await.status.as_u16();
            let expected = match (access, role) {
                (Access::Public, _) => "let through",
                (Access::AtLeast(_), None) => "401",
                (Access::AtLeast(_), Some(_)) if shown.is_foreign(method) => "403",
                (Access::AtLeast(least), Some(role)) if role < least => "403",
                (Access::AtLeast(_), Some(_)) => "let through",
            };
            let found = match status {
                401 => "401",
                403 => "403",
                _ => "let through",
            };
            assert_eq!(found, expected, "{method} {path} as caller {number}, {role:?}: {status}");
        }
    }
}

#[tokio::test]
async fn key_that_has_expired_says_so() {
    let service = public_service().await;
    let secret = random_secret().unwrap();
    let soon = Some(Utc::now() + TimeDelta::milliseconds(700));
    service.state.store.add_key(&secret, "short", Role::Reader, soon).await.unwrap();
    let ask = || request(&Method::GET, "/api/v1/cameras", Some(&secret));
    assert_eq!(service.send(ask()).await.status, 200);
    tokio::time::sleep(Duration::from_millis(800)).await;
    let answer = service.send(ask()).await;
    answer.problem(401);
    assert_eq!(answer.json()["detail"], "This key has expired.");
}

#[tokio::test]
async fn keys_are_made_shown_and_revoked_by_admins() {
    let service = Service::new().await;
    let wanted = json!({"name": "audit", "role": "admin", "expires_at": "2100-01-01T00:00:00Z"});
    let made = service.post("/api/v1/keys", &wanted).await;
    assert_eq!(made.status, 201);
    let secret = made.json()["secret"].as_str().unwrap().to_owned();
    let with_key = |method: Method, path: &str| request(&method, path, Some(&secret));
    let listed = service.send(with_key(Method::GET, "/api/v1/keys")).await;
    let key = listed.json()["items"][0].clone();
    assert_eq!(
        (&key["name"], &key["role"], &key["expires_at"]),
        (&wanted["name"], &wanted["role"], &wanted["expires_at"])
    );
    assert!(!String::from_utf8_lossy(&listed.body).contains(&secret));
    assert_eq!(made.headers["location"], format!("/api/v1/keys/{}", key["id"].as_str().unwrap()));
    // its use is noted beside the request
    let mut used = serde_json::Value::Null;
    for _ in 0..100 {
        tokio::time::sleep(Duration::from_millis(20)).await;
        used = service.send(with_key(Method::GET, "/api/v1/keys")).await.json()["items"][0]["last_used_at"].clone();
        if used.is_string() {
            break;
        }
    }
    assert!(used.is_string());
    let mut past = json_post("/api/v1/keys", &json!({"role": "reader", "expires_at": "2020-01-01T00:00:00Z"}));
    past.headers_mut().insert("authorization", format!("Bearer {secret}").parse().unwrap());
    assert_eq!(service.send(past).await.problem(422), ["/expires_at"]);
    let mut twice = json_post("/api/v1/keys", &json!({"role": "reader"}));
    twice.headers_mut().insert("authorization", format!("Bearer {secret}").parse().unwrap());
    twice.headers_mut().insert("idempotency-key", "once".parse().unwrap());
    service.send(twice).await.problem(400);
    let path = format!("/api/v1/keys/{}", key["id"].as_str().unwrap());
    assert_eq!(service.send(with_key(Method::DELETE, &path)).await.status, 204);
    service.send(with_key(Method::GET, "/api/v1/keys")).await.problem(401);
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
