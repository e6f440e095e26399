//! Control scenes: small georeferenced pictures of the ground.

mod request;
mod upload;

use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use chrono::{DateTime, Utc};
use serde::Serialize;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

pub use request::{CheckedScene, ControlSceneRequest};

use super::area::{AreaQuery, CrsQuery, Rectangle, cursor};
use super::extract::{Path, Query};
use super::idempotency::NewId;
use super::openapi::Binary;
use super::page::{Page, Wanted};
use super::problem::Problem;
use super::state::AppState;
use crate::control::scenes::{self, StoredScene};
use crate::geometry::Crs;
use crate::report::{Position, Vertical, Warning};
use crate::store::images::hexadecimal;
use crate::store::now;

/// The routes of the scenes.
pub fn routes() -> OpenApiRouter<AppState> {
    // the upload counts its bytes itself, part by part
    let upload = OpenApiRouter::new().routes(routes!(create)).layer(DefaultBodyLimit::disable());
    OpenApiRouter::new().routes(routes!(list)).routes(routes!(read, remove)).routes(routes!(show_picture)).merge(upload)
}

/// What the form of an upload consists of.
#[derive(ToSchema)]
#[expect(dead_code, reason = "only describes the form")]
struct ControlSceneForm {
    /// The picture, seen straight from above and in one scale: JPEG, PNG or TIFF, at least 32 px a side.
    #[schema(value_type = String, format = Binary)]
    file: Vec<u8>,
    /// What is said of it.
    scene: ControlSceneRequest,
}

/// A scene.
#[derive(Debug, Serialize, ToSchema)]
struct ControlSceneAnswer {
    /// UUIDv7; stays the same when the scene is replaced.
    id: Uuid,
    /// Unique among the scenes.
    name: String,
    /// Ground sample distance of the picture.
    gsd_m: f64,
    /// Where the upper edge of the picture points to, clockwise from true north.
    azimuth_of_image_up_deg: f64,
    /// Its standard deviation.
    sigma_azimuth_deg: f64,
    /// The reference point in the picture.
    #[schema(value_type = Vec<f64>, min_items = 2, max_items = 2)]
    reference_px: [f64; 2],
    /// The reference point on the ground: the control point that the scene gives an image.
    reference: Position,
    /// Standard deviation of its coordinates, the accuracy of the transformation from the CRS of its upload included.
    sigma_m: f64,
    /// Columns of the picture.
    width_px: u32,
    /// Rows of the picture.
    height_px: u32,
    /// Where the picture is, as it was uploaded.
    #[schema(example = "/api/v1/control-scenes/01a20225-f91a-7133-9892-18bd6449110e/picture")]
    picture: String,
    /// What kind of file the picture is.
    #[schema(example = "image/jpeg")]
    media_type: String,
    /// Length of that file.
    size_bytes: u64,
    /// SHA-256 of that file, in hexadecimal digits.
    #[schema(example = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08")]
    sha256: String,
    /// When it was first given.
    created_at: DateTime<Utc>,
    /// When it was last given.
    updated_at: DateTime<Utc>,
    /// What the client should know besides.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<Warning>,
}

impl ControlSceneAnswer {
    fn new(scene: StoredScene, reference: Position, warnings: Vec<Warning>) -> Self {
        let StoredScene { public_id, content, created_at, updated_at } = scene;
        let [width_px, height_px] = content.size_px;
        Self {
            id: public_id,
            name: content.name,
            gsd_m: content.gsd_m,
            azimuth_of_image_up_deg: content.azimuth_of_image_up_deg,
            sigma_azimuth_deg: content.sigma_azimuth_deg,
            reference_px: content.reference_px,
            reference,
            sigma_m: content.sigma_m,
            width_px,
            height_px,
            picture: format!("/api/v1/control-scenes/{public_id}/picture"),
            media_type: content.media_type,
            size_bytes: content.size_bytes,
            sha256: hexadecimal(&content.sha256),
            created_at,
            updated_at,
            warnings,
        }
    }

    /// With its reference in the CRS asked for; `None` where that does not reach.
    fn within(scene: StoredScene, target: &Target) -> Option<Self> {
        let coordinates = target.position(scene.content.reference_geocentric_m)?;
        let vertical = target.geoid_undulation_m.map(|geoid_undulation_m| Vertical { geoid_undulation_m });
        Some(Self::new(scene, Position { crs: target.crs.to_string(), coordinates, vertical }, Vec::new()))
    }
}

/// Where coordinates are wanted.
struct Target {
    crs: Crs,
    geoid_undulation_m: Option<f64>,
}

impl Target {
    fn position(&self, geocentric_m: nalgebra::Vector3<f64>) -> Option<[f64; 3]> {
        self.crs.position_from_geocentric(geocentric_m, self.geoid_undulation_m).ok()
    }
}

/// Upload a control scene
///
/// A form with two parts: `file`, the picture, and `scene`, JSON. The picture shows the ground straight from above: a
/// rectified terrestrial picture or a piece of an ortho-photo. Found in an aerial image, it gives it one control point:
/// its reference. A scene of the same name is replaced.
#[utoipa::path(
    post, path = "/control-scenes", operation_id = "upload_control_scene", tag = "control scenes",
    request_body(content = ControlSceneForm, content_type = "multipart/form-data"),
    params(("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, description = "Makes the request safe to repeat")),
    responses(
        (status = 201, description = "Stored", body = ControlSceneAnswer),
        (status = 200, description = "The one of this name was replaced", body = ControlSceneAnswer),
        (status = 400, description = "The form or its JSON is malformed", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Too many bytes or pixels", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not a JPEG, PNG or TIFF, or not a form", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A field makes no sense, or the picture is damaged", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "No room left on disk", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(State(state): State<AppState>, NewId(id): NewId, request: Request) -> Result<Response, Problem> {
    // each holds its body and its picture in memory
    let _permit = state.imports.acquire().await.map_err(|error| Problem::internal(&error))?;
    let upload::Received { request, checked, file } = upload::receive(&state, request).await?;
    let written = scenes::write(state.store.database(), id, &checked.content, &file, now()).await?;
    let status = if written.new { StatusCode::CREATED } else { StatusCode::OK };
    let location = format!("/api/v1/control-scenes/{}", written.scene.public_id);
    let answer = ControlSceneAnswer::new(written.scene, request.reference, checked.warnings);
    Ok((status, [(header::LOCATION, location)], axum::Json(answer)).into_response())
}

/// List control scenes
///
/// The oldest first. Without `bbox`, all of them.
#[utoipa::path(
    get, path = "/control-scenes", operation_id = "list_control_scenes", tag = "control scenes", params(AreaQuery),
    responses(
        (status = 200, description = "One page", body = Page<ControlSceneAnswer>),
        (status = 422, description = "A parameter makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<AreaQuery>,
) -> Result<axum::Json<Page<ControlSceneAnswer>>, Problem> {
    let target = Target { crs: query.crs()?, geoid_undulation_m: query.geoid_undulation_m };
    let limit = Wanted::new(query.limit, None)?.limit as usize;
    let rectangle = query.bbox.as_deref().map(Rectangle::parse).transpose()?;
    let region = rectangle.as_ref().map(|rectangle| rectangle.region(&target.crs)).transpose()?;
    let touched = |scene: &StoredScene| {
        let corners = scene.content.corners_geocentric_m().into_iter().map(|corner| target.position(corner));
        let corners: Option<Vec<_>> = corners.collect();
        rectangle.as_ref().is_none_or(|rectangle| corners.is_some_and(|corners| rectangle.touches(corners)))
    };
    let mut after = cursor(query.cursor.as_deref())?;
    let mut items = Vec::new();
    loop {
        // one more than fits, to know whether there is a next page
        let found = match region {
            Some(region) => scenes::in_box(state.store.database(), region, after, limit + 1).await?,
            None => scenes::all(state.store.database(), after, limit + 1).await?,
        };
        let last = found.len() <= limit;
        for (row_id, scene) in found {
            if items.len() == limit {
                return Ok(axum::Json(Page { items, next_cursor: Some(after.to_string()) }));
            }
            after = row_id;
            if touched(&scene) {
                items.extend(ControlSceneAnswer::within(scene, &target));
            }
        }
        if last {
            return Ok(axum::Json(Page { items, next_cursor: None }));
        }
    }
}

/// Show a control scene
#[utoipa::path(
    get, path = "/control-scenes/{id}", operation_id = "show_control_scene", tag = "control scenes",
    params(("id" = String, Path, description = "The scene's id or name"), CrsQuery),
    responses(
        (status = 200, description = "The scene", body = ControlSceneAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(
    State(state): State<AppState>,
    Path(id): Path<String>,
    Query(query): Query<CrsQuery>,
) -> Result<axum::Json<ControlSceneAnswer>, Problem> {
    let target = Target { crs: query.crs()?, geoid_undulation_m: query.geoid_undulation_m };
    let scene = scenes::by_id_or_name(state.store.database(), &id).await?.ok_or_else(missing)?;
    let answer = ControlSceneAnswer::within(scene, &target);
    let outside = || Problem::invalid_field("?crs", format!("the scene does not lie in {}", target.crs));
    Ok(axum::Json(answer.ok_or_else(outside)?))
}

/// Show the picture of a control scene
///
/// The file as it was uploaded. Its `ETag` is its SHA-256.
#[utoipa::path(
    get, path = "/control-scenes/{id}/picture", operation_id = "show_control_scene_picture", tag = "control scenes",
    params(
        ("id" = String, Path, description = "The scene's id or name"),
        ("If-None-Match" = Option<String>, Header, description = "The `ETag` of what the client has"),
    ),
    responses(
        (status = 200, description = "The picture", content(
            (inline(Binary) = "image/jpeg"), (inline(Binary) = "image/png"), (inline(Binary) = "image/tiff"),
        )),
        (status = 304, description = "It is what the client has"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn show_picture(
    State(state): State<AppState>,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let scene = scenes::by_id_or_name(state.store.database(), &id).await?.ok_or_else(missing)?;
    let tag = |scene: &StoredScene| format!("\"{}\"", hexadecimal(&scene.content.sha256));
    let known = headers.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
    let known =
        known.flat_map(|value| value.split(',')).any(|given| given.trim().trim_start_matches("W/") == tag(&scene));
    // a scene may be replaced at any time
    let cached = |tag: String| [(header::ETAG, tag), (header::CACHE_CONTROL, "private, no-cache".to_owned())];
    if known {
        return Ok((StatusCode::NOT_MODIFIED, cached(tag(&scene))).into_response());
    }
    let (scene, file) = scenes::with_picture(state.store.database(), scene.public_id).await?.ok_or_else(missing)?;
    Ok((cached(tag(&scene)), [(header::CONTENT_TYPE, scene.content.media_type)], file).into_response())
}

/// Delete a control scene
///
/// Orientations that have used it keep their results.
#[utoipa::path(
    delete, path = "/control-scenes/{id}", operation_id = "delete_control_scene", tag = "control scenes",
    params(("id" = String, Path, description = "The scene's id or name")),
    responses(
        (status = 204, description = "Deleted"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    match scenes::remove(state.store.database(), &id).await? {
        true => Ok(StatusCode::NO_CONTENT),
        false => Err(missing()),
    }
}

fn missing() -> Problem {
    Problem::not_found("There is no control scene with this id or name.")
}
