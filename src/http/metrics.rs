//! `GET /metrics`. Any room records with the macros of the crate `metrics`; the names are described here.

use std::sync::OnceLock;

use axum::http::header;
use axum::response::IntoResponse;
use metrics_exporter_prometheus::{PrometheusBuilder, PrometheusHandle};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::problem::Problem;
use super::state::AppState;

/// Upper bounds of the histograms, from a health check to a long orientation.
const SECONDS: [f64; 14] = [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 2.0, 4.0, 8.0, 15.0, 30.0, 60.0, 300.0];

/// The routes of the metrics.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(metrics))
}

/// Figures for Prometheus
///
/// Requests by route and status with their durations, and what the other parts of the service record.
#[utoipa::path(
    get, path = "/metrics", operation_id = "show_metrics", tag = "service",
    responses(
        (status = 200, description = "Prometheus text format", body = String, content_type = "text/plain"),
        (status = 401, description = "No valid key", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn metrics() -> impl IntoResponse {
    let text = recorder().map(PrometheusHandle::render).unwrap_or_default();
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4; charset=utf-8")], text)
}

/// Begins to record, once in the life of the process; before that, records are lost.
pub fn begin_recording() {
    let _ = recorder();
}

fn recorder() -> Option<&'static PrometheusHandle> {
    static RECORDER: OnceLock<Option<PrometheusHandle>> = OnceLock::new();
    RECORDER.get_or_init(install).as_ref()
}

fn install() -> Option<PrometheusHandle> {
    let installed = PrometheusBuilder::new().set_buckets(&SECONDS).and_then(PrometheusBuilder::install_recorder);
    metrics::describe_counter!("gable_http_requests_total", "Requests answered, by method, route and status.");
    metrics::describe_histogram!("gable_http_request_duration_seconds", "Time to answer, by method and route.");
    metrics::describe_gauge!(
        "gable_drift",
        "Population stability index of a feature between the training of the active classifier and recent orientations: \
         above 0.25 a classifier should be trained anew."
    );
    metrics::describe_gauge!("gable_drift_max", "The largest of these.");
    metrics::describe_counter!("gable_webhooks_total", "Tries to tell that an orientation has ended, by outcome.");
    metrics::describe_counter!("gable_audit_failures_total", "Changes and refusals that the audit log lacks.");
    metrics::describe_gauge!("gable_connections", "Connections that are open.");
    metrics::describe_counter!("gable_orientations_total", "Orientations that have ended, by status and verdict.");
    metrics::describe_histogram!("gable_orientation_duration_seconds", "Time of an attempt at an orientation.");
    metrics::describe_histogram!("gable_stage_duration_seconds", "Time of a stage of an attempt.");
    metrics::describe_counter!("gable_attempts_total", "Attempts at orientations, by what they came to.");
    metrics::describe_gauge!("gable_queue_depth", "Orientations that wait.");
    metrics::describe_gauge!("gable_queue_oldest_seconds", "How long the one that has waited longest has waited.");
    metrics::describe_gauge!("gable_workers", "Worker processes of this machine that are alive.");
    metrics::describe_counter!("gable_worker_crashes_total", "Worker processes that have ended by themselves.");
    metrics::describe_gauge!("gable_disk_free_bytes", "Room on the disk of the data folder.");
    metrics::describe_gauge!("gable_ready", "1 if /health/ready says so.");
    installed.inspect_err(|error| tracing::error!(%error, "no metrics")).ok()
}
