//! The picture of an orientation.

use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;
use uuid::Uuid;

use super::drawing::{drawn_image, succeeded};
use crate::http::extract::{Path, Query};
use crate::http::openapi::Binary;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::AttemptError;
use crate::report::overlay::Format;

const WIDTH_DEFAULT_PX: u32 = 2000;
const WIDTH_MAX_PX: u32 = 8000;

/// How large the picture is to be.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct OverlayQuery {
    /// At most so many columns, from 16 to 8000; 2000 if left out.
    #[param(minimum = 16, maximum = 8000)]
    width: Option<u32>,
}

/// Look at an orientation
///
/// The image in grey, as stored in its file, with the edges of the control points where the orientation projects them
/// (blue: used; vermilion: all that was matched was rejected; purple: took no part), the line segments matched to them
/// (yellow), an arrow from where each reference point was predicted to where it was located, and names.
#[utoipa::path(
    get, path = "/orientations/{id}/overlay", operation_id = "show_overlay", tag = "orientations",
    params(
        ("id" = Uuid, Path, description = "The orientation's id"), OverlayQuery,
        ("Accept" = Option<String>, Header, description = "`image/png`, or `image/jpeg` (default)"),
    ),
    responses(
        (status = 200, description = "The picture", content((inline(Binary) = "image/jpeg"), (inline(Binary) = "image/png"))),
        (status = 404, description = "There is no such orientation, or it has no result", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "It has not ended yet", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "Its image was removed", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn overlay(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Query(query): Query<OverlayQuery>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let width_px = query.width.unwrap_or(WIDTH_DEFAULT_PX);
    if !(16..=WIDTH_MAX_PX).contains(&width_px) {
        let detail = format!("width is {width_px}; it must be from 16 to {WIDTH_MAX_PX}");
        return Err(Problem::invalid_field("?width", detail));
    }
    let orientation = succeeded(&state, id).await?;
    drawn_image(&state, &orientation).await?;
    let format = wanted_format(&headers);
    let kind = match format {
        Format::Png => "image/png",
        Format::Jpeg => "image/jpeg",
    };
    let picture = state.jobs.overlay(&orientation, width_px, format).await?;
    Ok(([(header::CONTENT_TYPE, kind), (header::VARY, "accept")], picture).into_response())
}

/// The first of the two formats that the client names; the small one if it names none.
fn wanted_format(headers: &HeaderMap) -> Format {
    let accepted = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let mut kinds = accepted.flat_map(|value| value.split(',')).filter_map(|range| range.split(';').next());
    let format = kinds.find_map(|kind| match kind.trim().to_ascii_lowercase().as_str() {
        "image/png" => Some(Format::Png),
        "image/jpeg" => Some(Format::Jpeg),
        _ => None,
    });
    format.unwrap_or(Format::Jpeg)
}

impl From<AttemptError> for Problem {
    fn from(error: AttemptError) -> Self {
        Self::internal(&error)
    }
}
