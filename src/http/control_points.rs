//! Control points.

mod health;
mod list;

use axum::body::{Body, to_bytes};
use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::StatusCode;
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::area::{CrsQuery, known_crs};
use super::extract::{Path, Query, body_problem, media_type, refuse_encoded};
use super::problem::Problem;
use super::state::AppState;
use crate::control::geojson::{self, ControlPointFeature};
use crate::control::{CollectionError, ControlError, ImportReport, Mode, Source, points};
use crate::report::Warning;

/// The routes of the control points.
pub fn routes() -> OpenApiRouter<AppState> {
    // the import has a limit of its own
    let import = OpenApiRouter::new().routes(routes!(import)).layer(DefaultBodyLimit::disable());
    OpenApiRouter::new()
        .routes(routes!(list::list))
        .routes(routes!(list::extent))
        .routes(routes!(read, remove))
        .routes(routes!(health::health))
        .merge(import)
}

/// A GeoJSON `FeatureCollection` of control points; what else it has is ignored.
#[derive(ToSchema)]
#[schema(as = ControlPointCollection)]
#[expect(dead_code, reason = "only describes the body, which is read a feature at a time")]
struct Collection {
    /// Always `FeatureCollection`.
    #[schema(example = "FeatureCollection", pattern = "^FeatureCollection$")]
    r#type: String,
    /// Each as it is listed: a `MultiLineString`, and the properties `name`, `sigma_m` and, if need be, `reference`. Those
    /// that are none are told in the answer.
    #[schema(value_type = Vec<serde_json::Value>)]
    features: Vec<ControlPointFeature>,
}

/// Where an import comes from.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ImportQuery {
    /// The CRS of the coordinates: `EPSG:<code>` or a PROJ string.
    #[param(example = "EPSG:25832", min_length = 1)]
    crs: String,
    /// What makes the heights ellipsoidal: height above the geoid + this = ellipsoidal height.
    geoid_undulation_m: Option<f64>,
    /// What becomes of control points whose name is known: `insert` rejects them, `upsert` (default) updates them,
    /// `replace` updates them and removes all others.
    #[serde(default)]
    #[param(inline)]
    mode: Mode,
}

/// What an import did.
#[derive(Debug, Serialize, ToSchema)]
struct ImportAnswer {
    #[serde(flatten)]
    report: ImportReport,
    /// What the client should know besides.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<Warning>,
}

/// Import control points
///
/// A GeoJSON `FeatureCollection`; each feature is one control point: a `MultiLineString` of segments (lines of two 3D
/// positions), with the properties `name` (unique), `sigma_m` (standard deviation of its coordinates) and, if wanted,
/// `reference` (`[x, y, z]`; default: the mean of the segments' midpoints). One bad feature never loses the others.
#[utoipa::path(
    post, path = "/control-points", operation_id = "import_control_points", tag = "control points", params(ImportQuery),
    request_body(content(
        (Collection = "application/geo+json"), (Collection = "application/json"),
    )),
    responses(
        (status = 200, description = "What was imported, updated and rejected", body = ImportAnswer),
        (status = 400, description = "Not JSON", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Larger than this service accepts", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Not a FeatureCollection, or an unknown CRS", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn import(
    State(state): State<AppState>,
    Query(query): Query<ImportQuery>,
    request: Request,
) -> Result<axum::Json<ImportAnswer>, Problem> {
    let crs = known_crs(&query.crs, query.geoid_undulation_m)?;
    let ellipsoidal_assumed = crs.assumes_ellipsoidal_heights() && query.geoid_undulation_m.is_none();
    let warnings = Vec::from_iter(ellipsoidal_assumed.then(|| Warning::vertical_assumed_ellipsoidal(&crs.to_string())));
    let kind = media_type(request.headers());
    if !matches!(kind.as_deref(), Some("application/geo+json" | "application/json")) {
        let given = kind.as_deref().unwrap_or("none");
        return Err(Problem::unsupported_type(format!("Content-Type is {given}; it must be application/geo+json")));
    }
    refuse_encoded(request.headers())?;
    // each holds its body in memory
    let _permit = state.imports.acquire().await.map_err(|error| Problem::internal(&error))?;
    let body = whole_body(request.into_body(), state.configuration.import_max_bytes).await?;
    let parse = move || geojson::parse(&body, &Source { crs: &crs, geoid_undulation_m: query.geoid_undulation_m });
    let parsed = tokio::task::spawn_blocking(parse).await.map_err(|error| Problem::internal(&error))?;
    let report = points::import(state.store.database(), parsed?, query.mode, |_| {}).await?;
    tracing::info!(imported = report.imported, updated = report.updated, rejected = report.rejected.len(), "imported");
    Ok(axum::Json(ImportAnswer { report, warnings }))
}

pub(super) async fn whole_body(body: Body, max_bytes: usize) -> Result<Bytes, Problem> {
    to_bytes(body, max_bytes).await.map_err(|error| {
        let source = std::error::Error::source(&error);
        if source.is_some_and(|source| source.is::<http_body_util::LengthLimitError>()) {
            return Problem::too_large(format!(
                "The body is larger than the {max_bytes} bytes that this service accepts."
            ));
        }
        body_problem(&error, StatusCode::BAD_REQUEST)
    })
}

/// Show a control point
#[utoipa::path(
    get, path = "/control-points/{name}", operation_id = "show_control_point", tag = "control points",
    params(("name" = String, Path, description = "Its name"), CrsQuery),
    responses(
        (status = 200, description = "The control point as a GeoJSON feature", body = ControlPointFeature),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(
    State(state): State<AppState>,
    Path(name): Path<String>,
    Query(query): Query<CrsQuery>,
) -> Result<axum::Json<ControlPointFeature>, Problem> {
    let crs = query.crs()?;
    let point = points::by_name(state.store.database(), &name).await?;
    let point = point.ok_or_else(|| Problem::not_found("There is no control point of this name."))?;
    let feature = geojson::feature(&point, &Source { crs: &crs, geoid_undulation_m: query.geoid_undulation_m });
    let feature =
        feature.ok_or_else(|| Problem::invalid_field("?crs", format!("the control point does not lie in {crs}")));
    Ok(axum::Json(feature?))
}

/// Remove a control point
///
/// Orientations under way may still use it; results keep it.
#[utoipa::path(
    delete, path = "/control-points/{name}", operation_id = "remove_control_point", tag = "control points",
    params(("name" = String, Path, description = "Its name")),
    responses(
        (status = 204, description = "Removed"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(name): Path<String>) -> Result<StatusCode, Problem> {
    if points::remove(state.store.database(), &name).await? {
        return Ok(StatusCode::NO_CONTENT);
    }
    Err(Problem::not_found("There is no control point of this name."))
}

impl From<ControlError> for Problem {
    fn from(error: ControlError) -> Self {
        match error {
            ControlError::Database(error) => error.into(),
            error => Self::internal(&error),
        }
    }
}

impl From<CollectionError> for Problem {
    fn from(error: CollectionError) -> Self {
        match error {
            CollectionError::Syntax(error) => Self::bad_request(format!("The body is not valid JSON: {error}")),
            error => Self::invalid_field("", error.to_string()),
        }
    }
}
