//! Accounts, and logging in and out.

use std::time::{Duration, Instant};

use axum::http::{Method, Request};
use gable::store::keys::Role;
use gable::store::passwords;
use serde_json::{Value, json};

use crate::support::{Answer, Service, json_post, request};

const PASSWORD: &str = "correct horse battery";
const ACCOUNTS: &str = "/api/v1/accounts";

async fn log_in(service: &Service, name: &str, password: &str, cookie: Option<&str>) -> Answer {
    let mut ask = json_post("/api/v1/session", &json!({"name": name, "password": password}));
    if let Some(cookie) = cookie {
        ask.headers_mut().insert("cookie", cookie.parse().unwrap());
    }
    service.send(ask).await
}

/// `name=value` of the cookie that an answer sets.
fn cookie(answer: &Answer) -> String {
    answer.headers["set-cookie"].to_str().unwrap().split(';').next().unwrap().to_owned()
}

fn with_cookie(method: Method, path: &str, cookie: &str, body: &Value) -> Request<axum::body::Body> {
    let mut ask = json_post(path, body);
    *ask.method_mut() = method;
    ask.headers_mut().insert("cookie", cookie.parse().unwrap());
    ask.headers_mut().insert("sec-fetch-site", "same-origin".parse().unwrap());
    ask
}

async fn with_account(name: &str, role: Role) -> Service {
    let service = Service::new().await;
    let kept = passwords::hash(PASSWORD.to_owned()).await.unwrap();
    service.state.store.add_account(name, role, &kept).await.unwrap().unwrap();
    service
}

#[tokio::test]
async fn who_logs_in_is_known_until_they_log_out() {
    let service = with_account("anna", Role::Operator).await;
    // an account closes the open door of this machine
    service.get("/api/v1/session").await.problem(401);
    let answer = log_in(&service, "anna", PASSWORD, None).await;
    assert_eq!((answer.status.as_u16(), answer.json()), (200, json!({"who": "account:anna", "role": "operator"})));
    let set = answer.headers["set-cookie"].to_str().unwrap();
    assert!(set.starts_with("gable=gable_") && !set.contains("Secure"), "{set}");
    assert!(set.ends_with("; Path=/; Max-Age=604800; HttpOnly; SameSite=Lax"), "{set}");
    let first = cookie(&answer);
    let who = async |cookie: &str| {
        service.send(with_cookie(Method::GET, "/api/v1/session", cookie, &Value::Null)).await.status.as_u16()
    };
    assert_eq!(who(&first).await, 200);
    // another login ends the session of the browser's former one
    let second = cookie(&log_in(&service, "anna", PASSWORD, Some(&first)).await);
    assert_ne!(first, second);
    assert_eq!((who(&first).await, who(&second).await), (401, 200));
    let out = service.send(with_cookie(Method::DELETE, "/api/v1/session", &second, &Value::Null)).await;
    assert_eq!((out.status.as_u16(), cookie(&out).as_str()), (204, "gable="));
    assert_eq!(who(&second).await, 401);
    let database = std::fs::read(service.state.store.folder().join("gable.db-wal")).unwrap_or_default();
    for secret in [PASSWORD, first.trim_start_matches("gable=")] {
        assert!(!database.windows(secret.len()).any(|window| window == secret.as_bytes()), "{secret}");
    }
}

#[tokio::test]
async fn with_tls_in_front_no_other_host_can_set_the_cookie() {
    let service = Service::with(|configuration| configuration.cookie_secure = Some(true)).await;
    let kept = passwords::hash(PASSWORD.to_owned()).await.unwrap();
    service.state.store.add_account("anna", Role::Reader, &kept).await.unwrap().unwrap();
    let answer = log_in(&service, "anna", PASSWORD, None).await;
    let set = answer.headers["set-cookie"].to_str().unwrap();
    assert!(
        set.starts_with("__Host-gable=") && set.ends_with("; Path=/; Max-Age=604800; HttpOnly; SameSite=Lax; Secure")
    );
    let mut foreign = json_post("/api/v1/session", &json!({"name": "anna", "password": PASSWORD}));
    foreign.headers_mut().insert("origin", "https://evil.example".parse().unwrap());
    service.send(foreign).await.problem(403);
}

#[tokio::test]
async fn wrong_password_and_missing_account_look_alike() {
    let service = with_account("anna", Role::Reader).await;
    let began = Instant::now();
    let wrong = log_in(&service, "anna", "wrong horse battery", None).await;
    let wrong_took = began.elapsed();
    let began = Instant::now();
    let missing = log_in(&service, "nobody", PASSWORD, None).await;
    let missing_took = began.elapsed();
    wrong.problem(401);
    missing.problem(401);
    assert_eq!(wrong.json()["detail"], missing.json()["detail"]);
    // the first one may be slower: it makes the hash that nobody has. On a busy machine times differ without a reason
    let ratio = wrong_took.as_secs_f64() / missing_took.as_secs_f64();
    assert!((0.1..10.0).contains(&ratio), "{wrong_took:?} and {missing_took:?}");
    // both have tried, and failed
    let failed = "account:anna";
    let more = (0..30).take_while(|_| service.state.failed_logins.take(failed).is_ok()).count();
    assert!((18..=21).contains(&more), "{more} more tries");
    let refused = log_in(&service, "anna", PASSWORD, None).await;
    refused.problem(429);
    assert!(refused.headers.contains_key("retry-after"));
    assert!(service.state.failed_logins.take("account:other").is_ok());
}

#[tokio::test]
async fn admins_make_and_change_accounts_at_once() {
    let service = Service::new().await;
    let (key, _) = service.key(Role::Admin).await;
    let ask = async |method: Method, path: &str, body: &Value| {
        let mut ask = json_post(path, body);
        *ask.method_mut() = method;
        ask.headers_mut().insert("authorization", format!("Bearer {key}").parse().unwrap());
        service.send(ask).await
    };
    let wanted = json!({"name": "anna", "role": "reader", "password": PASSWORD});
    let made = ask(Method::POST, ACCOUNTS, &wanted).await;
    assert_eq!(made.status, 201);
    let path = made.headers["location"].to_str().unwrap().to_owned();
    ask(Method::POST, ACCOUNTS, &wanted).await.problem(409);
    for (field, value) in [("name", json!("a b")), ("password", json!("short")), ("role", json!("owner"))] {
        let mut other = wanted.clone();
        other[field] = value;
        assert_eq!(ask(Method::POST, ACCOUNTS, &other).await.problem(422), [format!("/{field}")]);
    }
    let session = cookie(&log_in(&service, "anna", PASSWORD, None).await);
    let status =
        async |path: &str| service.send(with_cookie(Method::GET, path, &session, &Value::Null)).await.status.as_u16();
    assert_eq!((status("/api/v1/session").await, status(ACCOUNTS).await), (200, 403));
    assert_eq!(ask(Method::PATCH, &path, &json!({"role": "admin"})).await.json()["role"], "admin");
    assert_eq!(status(ACCOUNTS).await, 200);
    assert!(ask(Method::PATCH, &path, &json!({"disabled": true})).await.json()["disabled_at"].is_string());
    assert_eq!(status("/api/v1/session").await, 401);
    log_in(&service, "anna", PASSWORD, None).await.problem(401);
    let change = json!({"disabled": false, "password": "another horse battery"});
    assert_eq!(ask(Method::PATCH, &path, &change).await.status, 200);
    log_in(&service, "anna", PASSWORD, None).await.problem(401);
    assert_eq!(log_in(&service, "anna", "another horse battery", None).await.status, 200);
    assert_eq!(status("/api/v1/session").await, 401, "the former session stays ended");
    let listed = ask(Method::GET, ACCOUNTS, &Value::Null).await;
    assert!(!String::from_utf8_lossy(&listed.body).contains("argon2"));
}

#[tokio::test]
async fn session_ends_by_itself() {
    let service = Service::with(|configuration| configuration.session_idle_s = 1).await;
    let kept = "no hash";
    let account = service.state.store.add_account("anna", Role::Reader, kept).await.unwrap().unwrap();
    let lasting = service.state.configuration.sessions_last();
    service.state.store.begin_session("a", account.id, None, lasting).await.unwrap();
    let mut ask = request(&Method::GET, "/api/v1/session", None);
    ask.headers_mut().insert("cookie", "gable=a".parse().unwrap());
    assert_eq!(service.send(ask).await.status, 200);
    tokio::time::sleep(Duration::from_millis(1100)).await;
    assert_eq!(service.state.store.session("a", lasting).await.unwrap(), None);
}
