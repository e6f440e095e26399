//! Whether the service lives, and whether it can do its work.

use std::collections::BTreeMap;
use std::time::Duration;

use axum::extract::State;
use axum::http::StatusCode;
use axum::{Json, response::IntoResponse};
use serde::Serialize;
use tokio_util::sync::CancellationToken;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::state::AppState;

const DATABASE_TIMEOUT: Duration = Duration::from_secs(2);
const WATCH_INTERVAL: Duration = Duration::from_secs(5);

/// The routes of the health checks.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(live)).routes(routes!(ready))
}

/// The state of the service.
#[derive(Debug, Serialize, ToSchema)]
pub struct Health {
    /// `live`, `ready` or `not ready`.
    #[schema(example = "ready")]
    status: &'static str,
    /// The parts that cannot do their work, with the reasons.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    not_ready: BTreeMap<&'static str, String>,
}

/// Does the service live?
///
/// 200 as long as the process answers at all. One that does not should be started anew.
#[utoipa::path(get, path = "/health/live", operation_id = "is_live", tag = "service", security(()),
    responses((status = 200, description = "It does", body = Health)))]
async fn live() -> Json<Health> {
    Json(Health { status: "live", not_ready: BTreeMap::new() })
}

/// Can the service do its work?
///
/// 503, naming what is not ready, while a part of it cannot do its work or the service is about to end: send requests
/// elsewhere until it is ready again.
#[utoipa::path(get, path = "/health/ready", operation_id = "is_ready", tag = "service", security(()),
    responses(
        (status = 200, description = "It can", body = Health),
        (status = 503, description = "It cannot, for the reasons named", body = Health),
    ))]
async fn ready(State(state): State<AppState>) -> impl IntoResponse {
    let not_ready = not_ready(&state).await;
    if not_ready.is_empty() {
        (StatusCode::OK, Json(Health { status: "ready", not_ready }))
    } else {
        (StatusCode::SERVICE_UNAVAILABLE, Json(Health { status: "not ready", not_ready }))
    }
}

/// Records whether the service can do its work, until `stop`.
pub async fn watch(state: AppState, stop: CancellationToken) {
    while !stop.is_cancelled() {
        let ready = not_ready(&state).await.is_empty();
        metrics::gauge!("gable_ready").set(if ready { 1.0 } else { 0.0 });
        if let Ok(free) = state.store.free_bytes() {
            metrics::gauge!("gable_disk_free_bytes").set(free as f64);
        }
        let _ = tokio::time::timeout(WATCH_INTERVAL, stop.cancelled()).await;
    }
}

/// The parts that cannot do their work, with the reasons.
async fn not_ready(state: &AppState) -> BTreeMap<&'static str, String> {
    let mut not_ready = state.readiness.blocked();
    match tokio::time::timeout(DATABASE_TIMEOUT, state.store.ping()).await {
        Ok(Ok(())) => {
            if let Some(reason) = classifier_fault(state).await {
                not_ready.insert("classifier", reason);
            }
        }
        Ok(Err(error)) => {
            tracing::error!(%error, "the database or the object store does not answer");
            not_ready.insert("database", String::from("does not answer"));
        }
        Err(_) => {
            not_ready.insert("database", format!("has not answered within {} s", DATABASE_TIMEOUT.as_secs()));
        }
    }
    match state.store.free_bytes() {
        Ok(free) if free >= state.configuration.disk_reserve_bytes => {}
        Ok(_) => {
            not_ready.insert("disk", String::from("is full"));
        }
        Err(error) => {
            tracing::error!(%error, "the disk does not answer");
            not_ready.insert("disk", String::from("does not answer"));
        }
    }
    if let Some(reason) = state.jobs.crew_fault() {
        not_ready.insert("workers", reason);
    }
    not_ready
}

/// Why the active classifier cannot decide, asked of a database that has just answered.
async fn classifier_fault(state: &AppState) -> Option<String> {
    match tokio::time::timeout(DATABASE_TIMEOUT, state.jobs.active_classifier()).await {
        Ok(Ok(_)) => None,
        Ok(Err(error)) => {
            tracing::error!(%error, "the active classifier cannot be used");
            Some(String::from("the active one cannot be used; activate another one"))
        }
        Err(_) => Some(format!("could not be read within {} s", DATABASE_TIMEOUT.as_secs())),
    }
}
