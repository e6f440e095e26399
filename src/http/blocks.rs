//! Blocks: flights that are posted as a list, and followed as a whole.

mod images;
mod request;
mod results;

use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use chrono::{DateTime, Utc};
use serde::Serialize;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

pub(super) use images::attach;

use super::control_points::whole_body;
use super::extract::{Path, Query, refuse_encoded};
use super::idempotency::NewId;
use super::page::{Page, PageQuery};
use super::problem::Problem;
use super::state::AppState;
use crate::jobs::request::OrientationRequest;
use crate::report::Warning;
use crate::store::blocks::{Block, Tally};
use request::BlockQuery;

/// The routes of the blocks.
pub fn routes() -> OpenApiRouter<AppState> {
    // the list and the images have limits of their own
    let bodies = OpenApiRouter::new().routes(routes!(list, create)).routes(routes!(images::upload));
    OpenApiRouter::new()
        .routes(routes!(read, remove))
        .routes(routes!(images::list))
        .routes(routes!(results::results))
        .merge(bodies.layer(DefaultBodyLimit::disable()))
}

/// A block.
#[derive(Debug, Serialize, ToSchema)]
struct BlockAnswer {
    /// UUIDv7.
    id: Uuid,
    /// For people.
    name: String,
    /// The CRS of the list.
    #[schema(example = "EPSG:25832")]
    crs: String,
    /// Images listed.
    images: i64,
    /// What all its orientations have in common: camera, tolerance, output CRS and so on, as in their requests.
    #[schema(value_type = Object)]
    settings: serde_json::Value,
    /// How far it is; not in lists.
    #[serde(skip_serializing_if = "Option::is_none")]
    progress: Option<Progress>,
    /// How many images have which verdict; not in lists.
    #[serde(skip_serializing_if = "Option::is_none")]
    verdicts: Option<Verdicts>,
    /// When it was posted.
    created_at: DateTime<Utc>,
    /// When the first of its images was last begun.
    #[serde(skip_serializing_if = "Option::is_none")]
    started_at: Option<DateTime<Utc>>,
    /// When the last one came to its end, once all have.
    #[serde(skip_serializing_if = "Option::is_none")]
    finished_at: Option<DateTime<Utc>>,
    /// Columns of the list that mean nothing here; only in the answer to the list.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ignored_columns: Vec<String>,
    /// What the client should know besides; only in the answer to the list.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<Warning>,
}

/// How many images of a block are how far.
#[derive(Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
struct Progress {
    /// In the list.
    listed: i64,
    /// Whose file is there.
    uploaded: i64,
    /// Whose orientation waits.
    queued: i64,
    /// Whose orientation is being worked on.
    running: i64,
    /// Whose orientation has a result, which may well be red.
    succeeded: i64,
    /// Whose file is broken, or the service is at fault.
    failed: i64,
    /// Whose orientation was cancelled.
    cancelled: i64,
}

/// How many images of a block have which verdict.
#[derive(Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
struct Verdicts {
    /// May be used without a look.
    green: i64,
    /// Doubtful.
    yellow: i64,
    /// Not solved, or wrong.
    red: i64,
}

impl BlockAnswer {
    fn new(block: Block) -> Result<Self, Problem> {
        let mut settings: serde_json::Value =
            serde_json::from_str(&block.settings).map_err(|error| Problem::internal(&error))?;
        // these are of each image
        for own in ["image", "approximation"] {
            settings.as_object_mut().map(|settings| settings.remove(own));
        }
        Ok(Self {
            id: block.id,
            name: block.name,
            crs: block.crs,
            images: block.images,
            settings,
            progress: None,
            verdicts: None,
            created_at: block.created_at,
            started_at: None,
            finished_at: None,
            ignored_columns: Vec::new(),
            warnings: Vec::new(),
        })
    }

    fn with(mut self, tallies: &[Tally]) -> Self {
        let (mut progress, mut verdicts) = (Progress::default(), Verdicts::default());
        for tally in tallies {
            progress.listed += tally.images;
            progress.uploaded += tally.uploaded;
            match tally.status.as_deref() {
                Some("queued") => progress.queued += tally.images,
                Some("running") => progress.running += tally.images,
                Some("succeeded") => progress.succeeded += tally.images,
                Some("failed") => progress.failed += tally.images,
                Some("cancelled") => progress.cancelled += tally.images,
                _ => {}
            }
            match tally.verdict.as_deref() {
                Some("green") => verdicts.green += tally.images,
                Some("yellow") => verdicts.yellow += tally.images,
                Some("red") => verdicts.red += tally.images,
                _ => {}
            }
        }
        let all_ended = progress.succeeded + progress.failed + progress.cancelled == progress.listed;
        self.started_at = tallies.iter().filter_map(|tally| tally.started_at).min();
        self.finished_at = tallies.iter().filter_map(|tally| tally.finished_at).max().filter(|_| all_ended);
        (self.progress, self.verdicts) = (Some(progress), Some(verdicts));
        self
    }
}

/// Post a block
///
/// The body is the list of a flight's images with their approximate positions; everything else is in the query. Which
/// form the list has follows from its type:
///
/// `text/csv`: the first line names the columns, separated by comma, semicolon or tab: `name` (or `image`, `filename`);
/// `x,y,z` or `lon,lat,height` or `easting,northing,height`; and if wanted `omega,phi,kappa`, `sigma_x,sigma_y,sigma_z`
/// (metres), `sigma_tilt`, `sigma_kappa`, `image_id` (of an image that is uploaded) and `sha256` (of its file). Other
/// columns are ignored, and named in the answer.
///
/// `application/geo+json`: a `FeatureCollection` of points, with the properties `name`, `omega_deg`, `phi_deg`,
/// `kappa_deg`, `sigma_position_m`, `sigma_tilt_deg`, `sigma_kappa_deg`, `image_id` and `sha256`.
///
/// `text/plain`: lines `name X Y Z`, or `name X Y Z omega phi kappa`, or the latter with a time at its end; `#` begins a
/// comment.
///
/// Angles are about the axes of `crs`: grid east, grid north and up of a map grid, the local ones of a geographic CRS. A
/// list is accepted whole or not at all: then the first hundred faults are named. Images that are uploaded already, by
/// `image_id` or `sha256`, are oriented at once; the others as soon as they come, by `PUT /blocks/{id}/images/{name}`.
#[utoipa::path(
    post, path = "/blocks", operation_id = "post_block", tag = "blocks",
    params(BlockQuery, ("Idempotency-Key" = Option<String>, Header, description = "Makes the request safe to repeat")),
    request_body(content(
        (String = "text/csv"), (serde_json::Value = "application/geo+json"), (String = "text/plain"),
    )),
    responses(
        (status = 201, description = "Accepted", body = BlockAnswer),
        (status = 413, description = "Larger than this service accepts", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not a list of these types", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A parameter or a line makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too many are waiting", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(
    State(state): State<AppState>,
    NewId(id): NewId,
    Query(query): Query<BlockQuery>,
    request: Request,
) -> Result<Response, Problem> {
    refuse_encoded(request.headers())?;
    let format = request::format_of(request.headers())?;
    let settings = query.settings()?;
    let camera = state.store.camera(&query.camera).await?;
    let camera = camera.ok_or_else(|| Problem::invalid_field("?camera", "there is no camera with this id or name"))?;
    let source = query.source()?;
    let warnings = query.warnings(&source);
    let crs = source.crs.to_string();
    // each holds its body in memory
    let permit = state.imports.acquire().await.map_err(|error| Problem::internal(&error))?;
    let body = whole_body(request.into_body(), state.configuration.import_max_bytes).await?;
    let planned = request::Planned { query, settings, source, format, image_size_px: camera.image_size_px() };
    let listed = tokio::task::spawn_blocking(move || planned.read(&body)).await;
    let listed = listed.map_err(|error| Problem::internal(&error))??;
    let ignored_columns = listed.ignored.clone();
    let block = listed.block(id, crs)?;
    let block = request::accept(&state, block, listed, &camera).await?;
    drop(permit);
    let tallies = state.store.block_tallies(id).await?;
    tracing::info!(block = %id, images = block.images, "accepted a block");
    let answer = BlockAnswer { ignored_columns, warnings, ..BlockAnswer::new(block)?.with(&tallies) };
    let location = format!("/api/v1/blocks/{id}");
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], axum::Json(answer)).into_response())
}

/// List the blocks
///
/// The newest first, without how far they are.
#[utoipa::path(
    get, path = "/blocks", operation_id = "list_blocks", tag = "blocks", params(PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<BlockAnswer>),
        (status = "default", description = "Any problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<BlockAnswer>>, Problem> {
    let wanted = query.wanted()?;
    let fetched = state.store.blocks(wanted.before, wanted.fetch()).await?;
    let Page { items, next_cursor } = wanted.page(fetched, |block| block.id, BlockAnswer::new);
    let items = items.into_iter().collect::<Result<_, _>>()?;
    Ok(axum::Json(Page { items, next_cursor }))
}

/// Show a block
///
/// With how far it is, and how many images have which verdict.
#[utoipa::path(
    get, path = "/blocks/{id}", operation_id = "show_block", tag = "blocks",
    params(("id" = Uuid, Path, description = "The block's id")),
    responses(
        (status = 200, description = "The block", body = BlockAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<axum::Json<BlockAnswer>, Problem> {
    let block = found(&state, id).await?;
    let tallies = state.store.block_tallies(id).await?;
    Ok(axum::Json(BlockAnswer::new(block)?.with(&tallies)))
}

/// Remove a block
///
/// Its orientations that have not ended are cancelled. Its images, and the results that are there, stay.
#[utoipa::path(
    delete, path = "/blocks/{id}", operation_id = "remove_block", tag = "blocks",
    params(("id" = Uuid, Path, description = "The block's id")),
    responses(
        (status = 204, description = "Removed"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<StatusCode, Problem> {
    if state.jobs.remove_block(id).await? {
        return Ok(StatusCode::NO_CONTENT);
    }
    Err(missing())
}

pub(super) async fn found(state: &AppState, id: Uuid) -> Result<Block, Problem> {
    state.store.block(id).await?.ok_or_else(missing)
}

fn missing() -> Problem {
    Problem::not_found("There is no block with this id.")
}

/// What all orientations of a block have in common.
fn settings_of(block: &Block) -> Result<OrientationRequest, Problem> {
    serde_json::from_str(&block.settings).map_err(|error| Problem::internal(&error))
}

/// Those of a block wait for each other, not for those of other blocks.
fn lane(block: Uuid) -> String {
    format!("block:{block}")
}
