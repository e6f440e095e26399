//! Sets of control points.

use axum::extract::State;
use axum::http::StatusCode;
use chrono::{DateTime, Utc};
use serde::Serialize;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::extract::Path;
use super::page::Page;
use super::problem::Problem;
use super::state::AppState;
use crate::control::sets::{self, ControlSet};

/// The routes of the sets.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list)).routes(routes!(read, remove))
}

/// A set of control points, which requests may choose.
#[derive(Debug, Serialize, ToSchema)]
struct ControlSetAnswer {
    /// Its name.
    #[schema(example = "nrw-2024")]
    name: String,
    /// What is in it.
    #[serde(skip_serializing_if = "Option::is_none")]
    description: Option<String>,
    /// The year of its survey. Of buildings of the same name in several sets that of the latest survey is used.
    #[serde(skip_serializing_if = "Option::is_none")]
    survey_year: Option<i64>,
    /// How many control points it has.
    control_points: i64,
    /// When it was first imported to.
    created_at: DateTime<Utc>,
}

impl From<ControlSet> for ControlSetAnswer {
    fn from(set: ControlSet) -> Self {
        let ControlSet { name, description, survey_year, points: control_points, created_at, .. } = set;
        Self { name, description, survey_year, control_points, created_at }
    }
}

/// List control sets
///
/// All of them, by name, on one page. A set is made by an import that names it.
#[utoipa::path(
    get, path = "/control-sets", operation_id = "list_control_sets", tag = "control points",
    responses(
        (status = 200, description = "All sets", body = Page<ControlSetAnswer>),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(State(state): State<AppState>) -> Result<axum::Json<Page<ControlSetAnswer>>, Problem> {
    let items = sets::all(state.store.database()).await?.into_iter().map(ControlSetAnswer::from).collect();
    Ok(axum::Json(Page { items, next_cursor: None }))
}

/// Show a control set
#[utoipa::path(
    get, path = "/control-sets/{name}", operation_id = "show_control_set", tag = "control points",
    params(("name" = String, Path, description = "Its name")),
    responses(
        (status = 200, description = "The set", body = ControlSetAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(
    State(state): State<AppState>,
    Path(name): Path<String>,
) -> Result<axum::Json<ControlSetAnswer>, Problem> {
    let set = sets::by_name(state.store.database(), &name).await?;
    let set = set.ok_or_else(|| Problem::not_found("There is no control set of this name."))?;
    Ok(axum::Json(set.into()))
}

/// Remove a control set
///
/// With all its control points, some thousands at a time; one that was broken off goes on when it is sent again. The set
/// `default` is emptied, and stays.
#[utoipa::path(
    delete, path = "/control-sets/{name}", operation_id = "remove_control_set", tag = "control points",
    params(("name" = String, Path, description = "Its name")),
    responses(
        (status = 204, description = "Removed"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(name): Path<String>) -> Result<StatusCode, Problem> {
    match sets::remove(state.store.database(), &name).await? {
        true => Ok(StatusCode::NO_CONTENT),
        false => Err(Problem::not_found("There is no control set of this name.")),
    }
}
