//! The pictures of an interior orientation.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use uuid::Uuid;

use super::{at_a_time, found};
use crate::http::extract::Path;
use crate::http::openapi::Binary;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::interior::{self, InteriorError};
use crate::report::InteriorResult;
use crate::report::interior::residual_plot;
use crate::store::interior_orientations::InteriorOrientation;

/// Draw the residuals of an interior orientation
///
/// The plate seen as the scene is seen, with the image's format and the marks: their residuals, magnified, with a scale in
/// micrometres, and the 95 % ellipses of the accuracy that they count with. Marks that were not used are vermilion, hollow where
/// they were not found.
#[utoipa::path(
    get, path = "/interior-orientations/{id}/residuals.svg", operation_id = "show_residuals",
    tag = "interior orientations",
    params(("id" = Uuid, Path, description = "The interior orientation's id")),
    responses(
        (status = 200, description = "The drawing", content_type = "image/svg+xml", body = String),
        (status = 404, description = "There is no such interior orientation", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn residuals(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<Response, Problem> {
    let result = result(&found(&state, id).await?)?;
    Ok(([(header::CONTENT_TYPE, "image/svg+xml")], residual_plot(&result)).into_response())
}

/// Look at a fiducial mark
///
/// The mark in the scan at full resolution, magnified, at most 600 px wide: an upright blue cross where it was found, a
/// diagonal orange one where the transformation has it. A mark that was not found is shown about that place.
#[utoipa::path(
    get, path = "/interior-orientations/{id}/marks/{name}", operation_id = "show_mark", tag = "interior orientations",
    params(
        ("id" = Uuid, Path, description = "The interior orientation's id"),
        ("name" = String, Path, description = "The mark's name, followed by `.png`", example = "1.png"),
    ),
    responses(
        (status = 200, description = "The picture", body = inline(Binary), content_type = "image/png"),
        (status = 404, description = "There is no such mark, or nothing is known of where it is", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "The image was removed", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn mark(
    State(state): State<AppState>,
    Path((id, file)): Path<(Uuid, String)>,
) -> Result<Response, Problem> {
    let kept = found(&state, id).await?;
    let result = result(&kept)?;
    let name = file.strip_suffix(".png").unwrap_or_default();
    let mark = result.marks.iter().find(|mark| mark.name == name).cloned();
    let mark = mark.ok_or_else(|| Problem::not_found("The camera has no such mark; ask for its name with .png."))?;
    let image = state.store.image(kept.image_id).await?;
    let image = image.ok_or_else(|| Problem::gone("The image was removed; upload it again to look at its marks."))?;
    let (path, limits) = (state.store.image_file(&image.sha256).await?, state.configuration.image_limits());
    let draw = move || interior::close_up(&path, &limits, &result, &mark);
    // the client is not at fault: the image could be read before
    let drawn = at_a_time(&state, draw).await?.map_err(|error: InteriorError| Problem::internal(&error))?;
    let picture = drawn.ok_or_else(|| Problem::not_found("Nothing is known of where this mark is in the scan."))?;
    Ok(([(header::CONTENT_TYPE, "image/png")], picture).into_response())
}

fn result(kept: &InteriorOrientation) -> Result<InteriorResult, Problem> {
    serde_json::from_str(kept.result.as_deref().unwrap_or_default()).map_err(|error| Problem::internal(&error))
}
