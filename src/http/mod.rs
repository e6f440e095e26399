//! The HTTP contract, one file a resource.
//!
//! To add a resource: a file with `pub fn routes() -> OpenApiRouter<AppState>`, whose handlers carry
//! `#[utoipa::path]` with full doc text and return `Result<_, Problem>`; a line in [`api`]; and a line for each of
//! its routes in [`access::ROUTES`], which says who may call it. A route that is not listed there answers nobody.

pub mod access;
pub mod cameras;
pub mod extract;
pub mod health;
pub mod idempotency;
pub mod images;
pub mod metrics;
pub mod observe;
pub mod openapi;
pub mod page;
pub mod problem;
pub mod request_id;
pub mod serve;
pub mod state;

use std::any::Any;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::response::{IntoResponse as _, Response};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use tower_http::timeout::RequestBodyTimeoutLayer;
use utoipa_axum::router::OpenApiRouter;

pub use problem::Problem;
pub use state::{AppState, Readiness};

fn api() -> OpenApiRouter<AppState> {
    let version_1 = OpenApiRouter::new().merge(cameras::routes()).merge(images::routes()).merge(openapi::routes());
    openapi::base().merge(health::routes()).merge(metrics::routes()).nest("/api/v1", version_1)
}

/// The contract as a document.
#[must_use]
pub fn document() -> utoipa::openapi::OpenApi {
    api().into_openapi()
}

/// The whole service, ready to be served.
///
/// # Errors
/// If the OpenAPI document cannot be written as JSON.
pub fn router(state: AppState) -> Result<Router, serde_json::Error> {
    metrics::begin_recording();
    let (routes, document) = api().split_for_parts();
    let document = openapi::Text(Arc::from(document.to_json()?));
    let body_idle = Duration::from_secs(state.configuration.body_idle_timeout_s);
    let body_max = DefaultBodyLimit::max(state.configuration.body_max_bytes);
    Ok(routes
        .merge(openapi::pages())
        // closest to the handlers, so that a panic is an answer to everything further out
        .route_layer(CatchPanicLayer::custom(panicked))
        .route_layer(from_fn_with_state(state.clone(), idempotency::replay))
        .route_layer(from_fn_with_state(state.clone(), access::guard))
        .fallback(async || Problem::not_found("There is nothing under this address."))
        .method_not_allowed_fallback(async || Problem::method_not_allowed("This address does not know this method."))
        .layer(axum::Extension(document))
        .layer(body_max)
        .layer(CatchPanicLayer::custom(panicked))
        .layer(from_fn(observe::observe))
        .layer(RequestBodyTimeoutLayer::new(body_idle))
        .layer(CompressionLayer::new())
        .with_state(state))
}

#[expect(clippy::needless_pass_by_value, reason = "tower-http wants it so")]
fn panicked(panic: Box<dyn Any + Send>) -> Response {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    Problem::internal(&format!("panic: {}", text.unwrap_or("of an unknown kind"))).into_response()
}
