//! Around every request: its id, its line in the log, its place in the metrics, and the headers that every answer has.

use std::time::Instant;

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderName, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::Response;
use tracing::Instrument as _;

use super::request_id;
use crate::web;

/// For everything but pages: nothing may be loaded or embedded.
const POLICY: HeaderValue = HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'");
/// Swagger UI sets styles from its script.
const POLICY_OF_DOCS: HeaderValue = HeaderValue::from_static(
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
     connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
);

/// What pages may ask of the browser: nothing.
const PERMISSIONS: HeaderValue = HeaderValue::from_static(
    "accelerometer=(), camera=(), display-capture=(), geolocation=(), gyroscope=(), microphone=(), payment=(), usb=()",
);
/// With TLS in front: only so, for two years.
const TRANSPORT: HeaderValue = HeaderValue::from_static("max-age=63072000");

/// Whether TLS is in front of the service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Secure(pub bool);

/// Runs a request and records it.
pub async fn observe(State(Secure(secure)): State<Secure>, request: Request, next: Next) -> Response {
    let id = request_id::accept_or_make(request.headers().get(request_id::HEADER).and_then(|id| id.to_str().ok()));
    let method = method_label(request.method());
    let route = request.extensions().get::<MatchedPath>().map_or("unmatched", MatchedPath::as_str).to_owned();
    let span = tracing::info_span!("request", id, method, path = request.uri().path());
    let began = Instant::now();
    let work = async {
        let response = next.run(request).await;
        let status = response.status().as_u16();
        let seconds = began.elapsed().as_secs_f64();
        if route.starts_with("/health/") {
            tracing::debug!(status, seconds, "answered");
        } else {
            tracing::info!(status, seconds, "answered");
        }
        let labels = [("method", method.to_owned()), ("route", route.clone()), ("status", status.to_string())];
        metrics::counter!("gable_http_requests_total", &labels).increment(1);
        metrics::histogram!("gable_http_request_duration_seconds", &labels[..2]).record(seconds);
        response
    };
    let mut response = request_id::scope(id.clone(), work.instrument(span)).await;
    add_headers(&mut response, &id, &route);
    if secure {
        response.headers_mut().insert(header::STRICT_TRANSPORT_SECURITY, TRANSPORT);
    }
    response
}

/// A client may invent methods without end; the metrics must not grow with them.
fn method_label(method: &Method) -> &'static str {
    match *method {
        Method::GET => "GET",
        Method::HEAD => "HEAD",
        Method::POST => "POST",
        Method::PUT => "PUT",
        Method::PATCH => "PATCH",
        Method::DELETE => "DELETE",
        Method::OPTIONS => "OPTIONS",
        _ => "other",
    }
}

/// What the browser may load for what is under a route.
fn policy(route: &str) -> HeaderValue {
    if route.starts_with("/docs") {
        POLICY_OF_DOCS
    } else if route == web::ASSETS || web::PAGES.contains(&route) {
        web::POLICY
    } else {
        POLICY
    }
}

fn add_headers(response: &mut Response, id: &str, route: &str) {
    let headers = response.headers_mut();
    if let Ok(id) = HeaderValue::from_str(id) {
        headers.insert(HeaderName::from_static(request_id::HEADER), id);
    }
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("same-origin"));
    headers.insert(HeaderName::from_static("permissions-policy"), PERMISSIONS);
    headers.insert(header::X_FRAME_OPTIONS, HeaderValue::from_static("DENY"));
    headers.insert(header::CONTENT_SECURITY_POLICY, policy(route));
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
}
