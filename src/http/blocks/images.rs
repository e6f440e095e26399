//! The images of a block: listed, uploaded, attached.

use axum::extract::{Request, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse as _, Response};
use serde::Serialize;
use utoipa::ToSchema;
use uuid::Uuid;

use super::results::Found;
use super::{found, lane, settings_of};
use crate::http::area::cursor;
use crate::http::extract::{Path, Query};
use crate::http::images::{self, receive};
use crate::http::orientations::checked;
use crate::http::page::{Page, PageQuery};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::request::OrientationRequest;
use crate::store::blocks::{self, Block, BlockImage, BlockRow};
use crate::store::images::{Image, hexadecimal};
use crate::store::orientations::Status;

/// An image of a block.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct BlockImageAnswer {
    /// As listed.
    name: String,
    /// The image's id, once it is uploaded.
    image: Option<Uuid>,
    /// The orientation's id, as long as it is kept.
    orientation: Option<Uuid>,
    /// `listed` if there is no orientation; else `queued`, `running`, `succeeded`, `failed` or `cancelled`.
    #[schema(example = "succeeded")]
    status: String,
    /// `green`, `yellow` or `red`.
    #[serde(skip_serializing_if = "Option::is_none")]
    verdict: Option<String>,
    /// The larger the better.
    #[serde(skip_serializing_if = "Option::is_none")]
    score: Option<f64>,
    /// Why it has failed, as a word for programs.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

impl BlockImageAnswer {
    fn new(row: BlockRow) -> Result<Self, Problem> {
        let score = Found::of(row.result.as_deref())?.and_then(|found| found.diagnosis.score);
        Ok(Self {
            name: row.name,
            image: row.image_id,
            orientation: row.orientation_id,
            status: row.status.unwrap_or_else(|| "listed".to_owned()),
            verdict: row.verdict,
            score,
            error: row.error_code,
        })
    }
}

/// List the images of a block
///
/// In the order of its list.
#[utoipa::path(
    get, path = "/blocks/{id}/images", operation_id = "list_block_images", tag = "blocks",
    params(("id" = Uuid, Path, description = "The block's id"), PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<BlockImageAnswer>),
        (status = 404, description = "There is no such block", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn list(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<BlockImageAnswer>>, Problem> {
    let (limit, after) = (query.limit()?, cursor(query.cursor())?);
    found(&state, id).await?;
    let mut rows = state.store.block_rows(id, after, limit + 1).await?;
    let more = rows.len() > limit as usize;
    rows.truncate(limit as usize);
    let next_cursor = rows.last().filter(|_| more).map(|last| last.number.to_string());
    let items = rows.into_iter().map(BlockImageAnswer::new).collect::<Result<_, _>>()?;
    Ok(axum::Json(Page { items, next_cursor }))
}

/// Upload an image of a block
///
/// The body is the file, as in `POST /images`, and it is kept in the same way. It is oriented with the settings of the
/// block and the approximation of its line. The same image again is answered with what is there; where its orientation
/// has failed or was cancelled, or is not kept any more, it is oriented anew.
#[utoipa::path(
    put, path = "/blocks/{id}/images/{name}", operation_id = "upload_block_image", tag = "blocks",
    params(
        ("id" = Uuid, Path, description = "The block's id"),
        ("name" = String, Path, description = "The image's name, as listed"),
        ("Content-Digest" = Option<String>, Header, description = "`sha-256=:<base64>:` of the body"),
        ("Repr-Digest" = Option<String>, Header, description = "`sha-256=:<base64>:` of the file"),
    ),
    request_body(content((Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png"), (Vec<u8> = "image/tiff"))),
    responses(
        (status = 201, description = "Its orientation was accepted", body = BlockImageAnswer),
        (status = 200, description = "It was there already", body = BlockImageAnswer),
        (status = 404, description = "There is no such block, or no such name in its list", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "Another image is attached to this name", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "It is not the file that the list says, or cannot be oriented as the block says; as an image it is kept", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too many are waiting; send it again later", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem, as in `POST /images`", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn upload(
    State(state): State<AppState>,
    Path((id, name)): Path<(Uuid, String)>,
    request: Request,
) -> Result<Response, Problem> {
    // before the body is read
    let block = found(&state, id).await?;
    listed(&state, id, &name).await?;
    let (image, _) = receive(&state, Uuid::now_v7(), images::name::checked(&name).ok(), request).await?;
    let new = attach(&state, &block, &name, &image).await?;
    let number = listed(&state, id, &name).await?.number;
    let row = state.store.block_rows(id, number - 1, 1).await?.pop().ok_or_else(unlisted)?;
    let status = if new { StatusCode::CREATED } else { StatusCode::OK };
    Ok((status, axum::Json(BlockImageAnswer::new(row)?)).into_response())
}

/// Attaches an image to a name of a block and submits its orientation; `false` if it was there already.
///
/// # Errors
/// 404 for a name that is not listed, 409 where another image is attached, 422 where the image does not fit, 503 if the
/// queue is full.
pub(in crate::http) async fn attach(
    state: &AppState,
    block: &Block,
    name: &str,
    image: &Image,
) -> Result<bool, Problem> {
    let listed = listed(state, block.id, name).await?;
    if listed.sha256.as_ref().is_some_and(|sha256| *sha256 != image.sha256) {
        let detail = format!("the SHA-256 of the file is {}; the list says another one", hexadecimal(&image.sha256));
        return Err(Problem::invalid_field("", detail));
    }
    let former = match listed.orientation_id {
        Some(id) => state.store.orientation(id).await?,
        None => None,
    };
    let again = former.as_ref().is_none_or(|o| matches!(o.status, Status::Failed | Status::Cancelled));
    if listed.image_id == Some(image.id) && !again {
        return Ok(false);
    }
    if !again {
        return Err(Problem::conflict("Another image is attached to this name, and its orientation has not failed."));
    }
    let approximation = serde_json::from_str(&listed.approximation).map_err(|error| Problem::internal(&error))?;
    let request = OrientationRequest { image: image.id.to_string(), approximation, ..settings_of(block)? };
    let new = checked(state, Uuid::now_v7(), &request, lane(block.id)).await?;
    let mut transaction = state.store.begin_write().await?;
    state.jobs.submit_all(&mut transaction, std::slice::from_ref(&new)).await?;
    let attached = BlockImage { image_id: Some(image.id), orientation_id: Some(new.id), ..listed };
    if !blocks::attach(&mut transaction, block.id, &attached, former.map(|former| former.id)).await? {
        let detail = "Another request has attached an image to this name, or removed the block.";
        return Err(Problem::conflict(detail).with_retry_after(1));
    }
    transaction.commit().await?;
    state.jobs.announce(std::slice::from_ref(&new)).await;
    Ok(true)
}

async fn listed(state: &AppState, block: Uuid, name: &str) -> Result<BlockImage, Problem> {
    state.store.block_image(block, name).await?.ok_or_else(unlisted)
}

fn unlisted() -> Problem {
    Problem::not_found("The list of the block has no image of this name.")
}
