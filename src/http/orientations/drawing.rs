//! What there is to see of an orientation: in the image, and on the map.

use axum::extract::State;
use uuid::Uuid;

use super::found;
use crate::http::extract::Path;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::report::drawing::{Drawing, DrawnImage, ImageDrawing};
use crate::store::orientations::{Orientation, Status};

/// What there is to see in the image
///
/// The control points that were expected in the image, with their search regions and edges under the orientation, and the
/// line segments that were matched to them. Pixels are those of the file as stored; an EXIF orientation is not obeyed.
#[utoipa::path(
    get, path = "/orientations/{id}/drawing", operation_id = "show_drawing", tag = "orientations",
    params(("id" = Uuid, Path, description = "The orientation's id")),
    responses(
        (status = 200, description = "What there is to draw", body = ImageDrawing),
        (status = 404, description = "There is no such orientation, or it has no result", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "It has not ended yet", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn drawing(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
) -> Result<axum::Json<ImageDrawing>, Problem> {
    let orientation = succeeded(&state, id).await?;
    let image = drawn_image(&state, &orientation).await?;
    Ok(axum::Json(kept(&orientation)?.on(image)))
}

/// What there is to see on the map
///
/// GeoJSON in longitude and latitude (WGS 84, with ellipsoidal heights). Each feature has a `role`: `footprint`,
/// `projection_centre`, `approximation`, `error_ellipse` (of three standard deviations, magnified by `magnification`), `control_point`, or
/// `grid_point`.
#[utoipa::path(
    get, path = "/orientations/{id}/map", operation_id = "show_map", tag = "orientations",
    params(("id" = Uuid, Path, description = "The orientation's id")),
    responses(
        (status = 200, description = "A GeoJSON FeatureCollection", body = serde_json::Value, content_type = "application/geo+json"),
        (status = 404, description = "There is no such orientation, or it has no map", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "It has not ended yet", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn map(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
) -> Result<([(axum::http::HeaderName, &'static str); 1], String), Problem> {
    let drawing = kept(&succeeded(&state, id).await?)?;
    let map = drawing.map().ok_or_else(|| {
        Problem::not_found("It was oriented by an older version, which kept no map; orient the image again.")
    })?;
    Ok(([(axum::http::header::CONTENT_TYPE, "application/geo+json")], map.to_string()))
}

/// An orientation that has a result.
pub(super) async fn succeeded(state: &AppState, id: Uuid) -> Result<Orientation, Problem> {
    let orientation = found(state, id).await?;
    if !orientation.status.is_final() {
        return Err(Problem::conflict("It has not ended yet.").with_retry_after(1));
    }
    if orientation.status != Status::Succeeded {
        return Err(Problem::not_found(format!("It has {}: there is nothing to see.", orientation.status.name())));
    }
    Ok(orientation)
}

fn kept(orientation: &Orientation) -> Result<Drawing, Problem> {
    Drawing::kept(orientation.drawing.as_deref()).map_err(|error| Problem::internal(&error))
}

/// The image of an orientation; its file may have been removed.
pub(super) async fn drawn_image(state: &AppState, orientation: &Orientation) -> Result<DrawnImage, Problem> {
    let image = state.store.image(orientation.image_id).await?;
    let image = image.ok_or_else(|| Problem::gone("The image was removed; upload it again to look at it."))?;
    Ok(DrawnImage { id: image.id, width_px: image.header.width_px, height_px: image.header.height_px })
}
