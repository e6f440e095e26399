//! The HTTP contract, one file a resource.
//!
//! To add a resource: a file with `pub fn routes() -> OpenApiRouter<AppState>`, whose handlers carry
//! `#[utoipa::path]` with an `operation_id` of its own and full doc text, and return `Result<_, Problem>`; a line in [`api`]; and a line for each of
//! its routes in [`access::ROUTES`], which says who may call it. A route that is not listed there answers nobody.

pub mod access;
pub mod accounts;
mod area;
pub mod audit;
pub mod blocks;
pub mod cameras;
pub mod classifiers;
pub mod control_points;
pub mod control_scenes;
pub mod control_sets;
pub mod exports;
pub mod extract;
pub mod health;
pub mod idempotency;
pub mod images;
pub mod interior_orientations;
pub mod keys;
pub mod mark_templates;
pub mod metrics;
pub mod observe;
pub mod openapi;
pub mod orientations;
pub mod pace;
pub mod page;
pub mod problem;
pub mod rate;
pub mod references;
pub mod request_id;
pub mod serve;
pub mod session;
pub mod state;
pub mod statistics;
pub mod uploads;
pub mod webhooks;

use std::any::Any;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse as _, Response};
use tokio::sync::Semaphore;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use utoipa_axum::router::OpenApiRouter;

pub use problem::Problem;
pub use state::{AppState, Readiness};

fn api() -> OpenApiRouter<AppState> {
    let version_1 = OpenApiRouter::new()
        .merge(cameras::routes())
        .merge(mark_templates::routes())
        .merge(images::routes())
        .merge(uploads::routes())
        .merge(blocks::routes())
        .merge(exports::routes())
        .merge(control_points::routes())
        .merge(control_scenes::routes())
        .merge(control_sets::routes())
        .merge(interior_orientations::routes())
        .merge(orientations::routes())
        .merge(references::routes())
        .merge(statistics::routes())
        .merge(classifiers::routes())
        .merge(webhooks::routes())
        .merge(session::routes())
        .merge(keys::routes())
        .merge(accounts::routes())
        .merge(audit::routes())
        .merge(openapi::routes());
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
    let (routes, document) = api().split_for_parts();
    let document = openapi::Text(Arc::from(document.to_json()?));
    Ok(furnished(routes.merge(openapi::pages()).merge(crate::web::routes()).layer(axum::Extension(document)), state))
}

/// What a service answers that only works: health and figures.
pub fn monitoring(state: AppState) -> Router {
    let routes = OpenApiRouter::new().merge(health::routes()).merge(metrics::routes());
    furnished(routes.split_for_parts().0, state)
}

/// Puts everything around the routes that all of them have in common.
fn furnished(routes: Router<AppState>, state: AppState) -> Router {
    metrics::begin_recording();
    let pace = pace::Pace {
        pause_max: Duration::from_secs(state.configuration.body_idle_timeout_s),
        bytes_per_s_min: state.configuration.body_min_bytes_per_s,
    };
    let body_max = DefaultBodyLimit::max(state.configuration.body_max_bytes);
    let secure = observe::Secure(state.configuration.cookies_are_secure());
    let slots = Arc::new(Semaphore::new(state.configuration.requests_max));
    routes
        // closest to the handlers, so that a panic is an answer to everything further out
        .route_layer(CatchPanicLayer::custom(panicked))
        .route_layer(from_fn_with_state(state.clone(), idempotency::replay))
        .route_layer(from_fn_with_state(state.clone(), access::guard))
        .fallback(async || Problem::not_found("There is nothing under this address."))
        .method_not_allowed_fallback(async || Problem::method_not_allowed("This address does not know this method."))
        .layer(body_max)
        .layer(from_fn_with_state(slots, rate::shed))
        .layer(CatchPanicLayer::custom(panicked))
        .layer(from_fn_with_state(secure, observe::observe))
        .layer(from_fn_with_state(pace, pace::watch))
        .layer(CompressionLayer::new())
        .with_state(state)
}

#[expect(clippy::needless_pass_by_value, reason = "tower-http wants it so")]
fn panicked(panic: Box<dyn Any + Send>) -> Response {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    Problem::internal(&format!("panic: {}", text.unwrap_or("of an unknown kind"))).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::{Body, to_bytes};
    use axum::http::{Request, StatusCode};
    use axum::routing::get;
    use tower::ServiceExt as _;

    #[tokio::test]
    async fn panic_is_an_internal_problem_that_tells_nothing_but_the_request_s_id() {
        let folder = tempfile::tempdir().unwrap();
        let store = crate::store::scratch::store(folder.path()).await;
        let state = AppState::new(store, crate::configuration::Configuration::default());
        async fn breaks() {
            panic!("secret")
        }
        let app = furnished(Router::new().route("/health/live", get(breaks)), state);
        let request = Request::get("/health/live").header("x-request-id", "r-1").body(Body::empty()).unwrap();
        let response = app.oneshot(request).await.unwrap();
        assert_eq!(response.status(), StatusCode::INTERNAL_SERVER_ERROR);
        assert_eq!(response.headers()["content-type"], "application/problem+json");
        assert_eq!(response.headers()["x-request-id"], "r-1");
        let body = to_bytes(response.into_body(), 10_000).await.unwrap();
        let problem: serde_json::Value = serde_json::from_slice(&body).unwrap();
        assert_eq!(problem["instance"], "r-1");
        assert_eq!(problem["status"], 500);
        assert!(!String::from_utf8_lossy(&body).contains("secret"), "{problem}");
    }
}
