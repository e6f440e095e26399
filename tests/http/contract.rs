//! The OpenAPI document against the routes and against its copy in the repository.

use gable::database::query;
use std::collections::BTreeSet;

use axum::http::Method;
use gable::http::access::ROUTES;
use gable::http::document;
use gable::web;
use serde_json::Value;

use crate::support::Service;

fn operations(document: &Value) -> impl Iterator<Item = (String, String, &Value)> {
    let paths = document["paths"].as_object().unwrap();
    paths.iter().flat_map(|(path, item)| {
        let methods = item.as_object().unwrap().iter();
        methods.map(move |(method, operation)| (method.to_uppercase(), path.clone(), operation))
    })
}

fn of_the_program() -> Value {
    serde_json::from_str(&document().to_json().unwrap()).unwrap()
}

#[test]
fn every_operation_has_an_access_rule_and_every_rule_an_operation() {
    let document = of_the_program();
    let documented: BTreeSet<_> = operations(&document).map(|(method, path, _)| (method, path)).collect();
    let pages = |path: &str| path.starts_with("/docs") || path == web::ASSETS || web::PAGES.contains(&path);
    let ruled: BTreeSet<_> = ROUTES
        .iter()
        .filter(|(_, path, _)| !pages(path))
        .map(|(method, path, _)| (method.to_string(), (*path).to_owned()))
        .collect();
    assert_eq!(documented, ruled);
    let distinct: BTreeSet<_> = ROUTES.iter().map(|(method, path, _)| (method.to_string(), path)).collect();
    assert_eq!(distinct.len(), ROUTES.len());
}

#[test]
fn every_operation_is_described() {
    let document = of_the_program();
    let mut ids = BTreeSet::new();
    for (method, path, operation) in operations(&document) {
        let id = operation["operationId"].as_str().unwrap();
        assert!(ids.insert(id.to_owned()), "{id} is used twice");
        assert!(operation["summary"].is_string(), "{method} {path} has no summary");
        assert_eq!(operation["tags"].as_array().map(Vec::len), Some(1), "{method} {path}");
        for parameter in operation["parameters"].as_array().into_iter().flatten() {
            assert!(parameter["description"].is_string(), "{method} {path}: {}", parameter["name"]);
        }
        let responses = operation["responses"].as_object().unwrap();
        let public = operation["security"] == serde_json::json!([{}]);
        let problem = responses.iter().any(|(_, response)| response["content"]["application/problem+json"].is_object());
        assert!(problem || public, "{method} {path} describes no problem");
    }
}

#[test]
fn every_field_is_described() {
    let document = of_the_program();
    for (name, schema) in document["components"]["schemas"].as_object().unwrap() {
        for (field, about) in schema["properties"].as_object().into_iter().flatten() {
            let alternatives = about["oneOf"].as_array().into_iter().flatten();
            let described = [about].into_iter().chain(alternatives).any(|about| about["description"].is_string());
            assert!(described, "{name}.{field} is not described: {about}");
        }
    }
}

#[tokio::test]
async fn documented_routes_are_there_and_the_document_is_served() {
    let service = Service::new().await;
    let document = of_the_program();
    assert_eq!(service.get("/api/v1/openapi.json").await.json(), document);
    // streams end at once
    service.state.jobs.stopping().cancel();
    for (method, path, _) in operations(&document) {
        let id = "01a20225-f91a-7133-9892-18bd6449110e";
        let path =
            path.replace("{id}", id).replace("{image}", id).replace("{name}", "a").replace("{file}", "model.svm");
        let path = path.replace("{level}", "0").replace("{column}", "0").replace("{row}", "0");
        let method = Method::from_bytes(method.as_bytes()).unwrap();
        let answer = service.send(crate::support::request(&method, &path, None)).await;
        let text = String::from_utf8_lossy(&answer.body).into_owned();
        assert_ne!(answer.status, 405, "{method} {path}");
        assert!(!text.contains("nothing under this address"), "{method} {path}");
    }
}

#[test]
fn copy_in_the_repository_is_that_of_the_program() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/openapi/gable.json");
    let copy: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap_or_default()).unwrap_or_default();
    assert!(copy == of_the_program(), "renew it: gable openapi > openapi/gable.json");
}

#[tokio::test]
async fn pages_come_out_of_the_binary() {
    let service = Service::new().await;
    assert_eq!(service.get("/docs").await.headers["location"], "/docs/");
    let page = service.get("/docs/").await;
    assert_eq!(page.status, 200);
    let page = String::from_utf8_lossy(&page.body).into_owned();
    assert!(page.contains("swagger-ui") && !page.contains("https://"), "{page}");
    let begin = service.get("/docs/swagger-initializer.js").await;
    assert!(String::from_utf8_lossy(&begin.body).contains("/api/v1/openapi.json"));
    assert!(service.get("/docs/swagger-ui-bundle.js").await.body.len() > 500_000);
}

#[tokio::test]
async fn health_names_what_is_not_ready() {
    let service = Service::new().await;
    assert_eq!(service.get("/health/live").await.status, 200);
    assert_eq!(service.get("/health/ready").await.json(), serde_json::json!({"status": "ready"}));
    service.state.readiness.block("workers", "have not begun");
    let answer = service.get("/health/ready").await;
    assert_eq!(answer.status, 503);
    let expected = serde_json::json!({"status": "not ready", "not_ready": {"workers": "have not begun"}});
    assert_eq!(answer.json(), expected);
    service.state.readiness.clear("workers");
    assert_eq!(service.get("/health/ready").await.status, 200);
    service.state.store.close().await;
    let answer = service.get("/health/ready").await;
    assert_eq!(answer.status, 503);
    assert_eq!(answer.json()["not_ready"]["database"], "does not answer");
    assert_eq!(service.get("/health/live").await.status, 200);
}

#[tokio::test]
async fn metrics_count_requests_by_route_not_by_address() {
    let service = Service::new().await;
    service.get("/api/v1/cameras/a-name-that-nobody-else-uses").await.problem(404);
    let text = String::from_utf8(service.get("/metrics").await.body.to_vec()).unwrap();
    assert!(text.contains("gable_http_requests_total{method=\"GET\",route=\"/api/v1/cameras/{id}\",status=\"404\"}"));
    assert!(text.contains("gable_http_request_duration_seconds_bucket"));
    assert!(!text.contains("nobody-else"), "{text}");
}

#[tokio::test]
async fn fault_of_the_database_is_not_told() {
    let service = Service::new().await;
    query("ALTER TABLE cameras RENAME TO elsewhere").execute(service.state.store.database()).await.unwrap();
    let answer = service.get("/api/v1/cameras").await;
    answer.problem(500);
    let text = String::from_utf8_lossy(&answer.body).to_lowercase();
    for word in ["sql", "table", "select", "cameras", "/tmp"] {
        assert!(!text.contains(word), "{text}");
    }
}
