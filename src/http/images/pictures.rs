//! Images to look at, in grey, as stored in their files.

use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;
use utoipa::IntoParams;
use uuid::Uuid;

use super::{found, imagery_problem};
use crate::features::PixelRect;
use crate::http::extract::{Path, Query};
use crate::http::openapi::Binary;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::imagery::ImageryError;
use crate::jobs::pictures::LookError;

/// The longest side of a window.
const WINDOW_SIDE_MAX_PX: u32 = 2048;

/// A rectangle of an image, in pixels of its file.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct WindowQuery {
    /// First column; negative where the rectangle begins left of the image.
    #[param(example = 1000)]
    x: i64,
    /// First row; negative where the rectangle begins above the image.
    #[param(example = 1500)]
    y: i64,
    /// Columns, from 1 to 2048.
    #[param(minimum = 1, maximum = 2048, example = 400)]
    width: u32,
    /// Rows, from 1 to 2048.
    #[param(minimum = 1, maximum = 2048, example = 300)]
    height: u32,
}

impl WindowQuery {
    /// What of it lies in an image of this size.
    fn within(&self, [width_px, height_px]: [u32; 2]) -> Result<PixelRect, Problem> {
        let along = |name: &str, first: i64, (of, length): (&str, u32), side_px: u32| {
            if !(1..=WINDOW_SIDE_MAX_PX).contains(&length) {
                let detail = format!("{of} is {length}; it must be from 1 to {WINDOW_SIDE_MAX_PX}");
                return Err(Problem::invalid_field(format!("?{of}"), detail));
            }
            let begin = first.clamp(0, side_px.into());
            let end = first.saturating_add(length.into()).clamp(0, side_px.into());
            if begin >= end {
                let detail =
                    format!("nothing of the rectangle lies in the image, which has {width_px} x {height_px} px");
                return Err(Problem::invalid_field(format!("?{name}"), detail));
            }
            // both lie between 0 and the side
            Ok((begin as u32, (end - begin) as u32))
        };
        let (x, width) = along("x", self.x, ("width", self.width), width_px)?;
        let (y, height) = along("y", self.y, ("height", self.height), height_px)?;
        Ok(PixelRect { x, y, width, height })
    }
}

/// Look at a tile of an image
///
/// A grey JPEG of 512 x 512 px, fewer at the right and lower rim, of the image averaged over squares of 2^level px; level
/// 0 has the pixels of the file as stored. The highest level is the first that fits into one tile.
#[utoipa::path(
    get, path = "/images/{id}/tiles/{level}/{column}/{row}", operation_id = "show_tile", tag = "images",
    params(
        ("id" = Uuid, Path, description = "The image's id"),
        ("level" = u32, Path, description = "0 for the pixels of the file"),
        ("column" = u32, Path, description = "From the left, beginning with 0"),
        ("row" = u32, Path, description = "From above, beginning with 0"),
    ),
    responses(
        (status = 200, description = "The tile", content((inline(Binary) = "image/jpeg"))),
        (status = 404, description = "There is no such image, or it has no such tile", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "Its file is not there any more", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Its file is damaged", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn tile(
    State(state): State<AppState>,
    Path((id, level, column, row)): Path<(Uuid, u32, u32, u32)>,
) -> Result<Response, Problem> {
    let image = found(&state, id).await?;
    let tile = state.pictures.tile(&image, [level, column, row]).await?;
    Ok(shown(tile.ok_or_else(|| Problem::not_found("The image has no such tile."))?))
}

/// Look at an image, small
///
/// A grey JPEG of the whole image as stored, its longer side at most 256 px.
#[utoipa::path(
    get, path = "/images/{id}/thumbnail", operation_id = "show_thumbnail", tag = "images",
    params(("id" = Uuid, Path, description = "The image's id")),
    responses(
        (status = 200, description = "The picture", content((inline(Binary) = "image/jpeg"))),
        (status = 404, description = "There is no such image", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "Its file is not there any more", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Its file is damaged", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn thumbnail(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<Response, Problem> {
    let image = found(&state, id).await?;
    Ok(shown(state.pictures.thumbnail(&image).await?))
}

/// Look at a window of an image
///
/// A grey JPEG of what of the rectangle lies in the image, in the pixels of the file.
#[utoipa::path(
    get, path = "/images/{id}/window", operation_id = "show_window", tag = "images",
    params(("id" = Uuid, Path, description = "The image's id"), WindowQuery),
    responses(
        (status = 200, description = "The picture", content((inline(Binary) = "image/jpeg"))),
        (status = 404, description = "There is no such image", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "Its file is not there any more", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "Nothing of it lies in the image, or the file is damaged", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn window(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Query(query): Query<WindowQuery>,
) -> Result<Response, Problem> {
    let image = found(&state, id).await?;
    let rect = query.within([image.header.width_px, image.header.height_px])?;
    Ok(shown(state.pictures.window(&image, rect).await?))
}

/// The bytes of an image never change.
fn shown(jpeg: Vec<u8>) -> Response {
    let headers =
        [(header::CONTENT_TYPE, "image/jpeg"), (header::CACHE_CONTROL, "private, max-age=31536000, immutable")];
    (headers, jpeg).into_response()
}

impl From<LookError> for Problem {
    fn from(error: LookError) -> Self {
        match &error {
            LookError::Imagery(cause) => match &**cause {
                ImageryError::Read { source } if source.kind() == std::io::ErrorKind::NotFound => {
                    Self::gone("The file of this image is not there any more; upload it again.")
                }
                cause => imagery_problem(cause),
            },
            LookError::Picture(cause) => Self::invalid(cause.to_string()),
            LookError::Store(cause) => Self::of_store(cause),
            _ => Self::internal(&error),
        }
    }
}
