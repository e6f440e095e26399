//! Images, streamed to disk.

pub(super) mod name;
mod pictures;

use axum::body::Body;
use axum::extract::multipart::{Field, MultipartError};
use axum::extract::{DefaultBodyLimit, FromRequest as _, Multipart, Request, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use chrono::{DateTime, NaiveDate, Utc};
use futures_util::StreamExt as _;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::extract::{Path, Query, body_problem, media_type, refuse_encoded};
use super::idempotency::NewId;
use super::openapi::Binary;
use super::page::{Page, PageQuery};
use super::problem::Problem;
use super::state::AppState;
use crate::imagery::{self, Format, ImageryError, Limits};
use crate::store::images::{GeographicPosition, Header, Image, Received, Upload, hexadecimal};
use crate::store::removal::Removal;

const MEDIA_TYPES: &str = "image/jpeg, image/png, image/tiff, or multipart/form-data with a part `file`";

/// The routes of the images.
pub fn routes() -> OpenApiRouter<AppState> {
    // the upload counts its bytes itself, as they come
    let upload = OpenApiRouter::new().routes(routes!(upload)).layer(DefaultBodyLimit::disable());
    OpenApiRouter::new()
        .routes(routes!(list))
        .routes(routes!(read, remove))
        .routes(routes!(pictures::tile))
        .routes(routes!(pictures::thumbnail))
        .routes(routes!(pictures::window))
        .merge(upload)
}

/// An image.
#[derive(Debug, Serialize, ToSchema)]
struct ImageAnswer {
    /// UUIDv7.
    id: Uuid,
    /// SHA-256 of the file, in hexadecimal digits.
    #[schema(example = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08")]
    sha256: String,
    /// What its file was called where it came from, if the upload has said.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = "IMG_0042.JPG")]
    name: Option<String>,
    /// Length of the file.
    size_bytes: u64,
    /// `jpeg`, `png` or `tiff`.
    #[schema(example = "jpeg")]
    format: String,
    /// Columns, as stored in the file.
    width_px: u32,
    /// Rows, as stored in the file.
    height_px: u32,
    /// Where it was taken, if its EXIF says.
    #[serde(skip_serializing_if = "Option::is_none")]
    position: Option<PositionAnswer>,
    /// Make and model of the camera, if its EXIF says.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = "DJI FC6310")]
    camera_model: Option<String>,
    /// When it was taken, if EXIF says.
    #[serde(skip_serializing_if = "Option::is_none")]
    taken_on: Option<NaiveDate>,
    /// When it was first uploaded.
    created_at: DateTime<Utc>,
}

/// A position as EXIF gives it.
#[derive(Debug, Serialize, ToSchema)]
struct PositionAnswer {
    /// WGS 84.
    #[schema(example = "EPSG:4326")]
    crs: &'static str,
    /// Longitude and latitude in degrees.
    #[schema(example = json!([17.09, 52.16]), min_items = 2, max_items = 2)]
    coordinates: [f64; 2],
    /// Height above the geoid; often wrong by tens of metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    height_above_geoid_m: Option<f64>,
}

impl From<Image> for ImageAnswer {
    fn from(image: Image) -> Self {
        let Header { format, width_px, height_px, position, camera_model, taken_on } = image.header;
        Self {
            id: image.id,
            sha256: hexadecimal(&image.sha256),
            name: image.name,
            size_bytes: image.size_bytes,
            format,
            width_px,
            height_px,
            position: position.map(|p| PositionAnswer {
                crs: "EPSG:4326",
                coordinates: [p.longitude_deg, p.latitude_deg],
                height_above_geoid_m: p.height_m,
            }),
            camera_model,
            taken_on,
            created_at: image.created_at,
        }
    }
}

/// What is said of an image that is uploaded.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct UploadQuery {
    /// What the file is called; folders before it are left out. A form says it by the filename of its part.
    #[param(example = "IMG_0042.JPG", min_length = 1)]
    name: Option<String>,
}

/// Upload an image
///
/// The body is the file itself, or a form with the file as its part `file`. It is written to disk as it comes and
/// becomes visible only when it is complete. The same bytes again are answered with 200 and the image that is there.
/// A SHA-256 in `Content-Digest` or `Repr-Digest` (RFC 9530) is checked. The pixels are decoded, strictly, only when
/// the image is oriented.
#[utoipa::path(
    post, path = "/images", operation_id = "upload_image", tag = "images",
    request_body(content(
        (inline(Binary) = "image/jpeg"), (inline(Binary) = "image/png"), (inline(Binary) = "image/tiff"),
        (Form = "multipart/form-data"),
    )),
    params(
        UploadQuery,
        ("Content-Digest" = Option<String>, Header, description = "`sha-256=:<base64>:` of the body"),
        ("Repr-Digest" = Option<String>, Header, description = "`sha-256=:<base64>:` of the file"),
        ("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, description = "Makes the request safe to repeat"),
    ),
    responses(
        (status = 201, description = "Stored", body = ImageAnswer),
        (status = 200, description = "These bytes were there already", body = ImageAnswer),
        (status = 400, description = "The body ended early, or a header is malformed", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Larger than this service accepts, in bytes or pixels", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not a JPEG, PNG or TIFF, or not what its type says", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A damaged picture, or another digest than declared", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "No room left on disk, or as many bytes of images as the service may have (`images_max_bytes`)", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn upload(
    State(state): State<AppState>,
    NewId(id): NewId,
    Query(query): Query<UploadQuery>,
    request: Request,
) -> Result<Response, Problem> {
    let name = query.name.as_deref().map(name::checked).transpose();
    let name = name.map_err(|detail| Problem::invalid_field("?name", detail))?;
    let (image, new) = receive(&state, id, name, request).await?;
    let status = if new { StatusCode::CREATED } else { StatusCode::OK };
    let location = format!("/api/v1/images/{}", image.id);
    Ok((status, [(header::LOCATION, location)], axum::Json(ImageAnswer::from(image))).into_response())
}

/// Takes the image of a request in, as `id` unless its bytes are there already; whether it is new comes with it. Without
/// a name, it has that which a form gives.
pub(super) async fn receive(
    state: &AppState,
    id: Uuid,
    name: Option<String>,
    request: Request,
) -> Result<(Image, bool), Problem> {
    let headers = request.headers();
    let kind = media_type(headers).unwrap_or_default();
    let is_form = kind == "multipart/form-data";
    refuse_encoded(headers)?;
    let declared = Declared {
        name,
        format: if is_form { None } else { Some(format_of(&kind)?) },
        file_sha256: declared_digest(headers, "repr-digest")?,
        body_sha256: declared_digest(headers, "content-digest")?,
    };
    if is_form && declared.body_sha256.is_some() {
        let detail = "Content-Digest of a form is not checked; give the file's digest as Repr-Digest";
        return Err(Problem::bad_request(detail).with_error("Content-Digest", detail));
    }
    let max_bytes = state.configuration.upload_max_bytes;
    let declared_bytes = content_length(headers);
    if declared_bytes.is_some_and(|bytes| bytes > max_bytes) {
        return Err(too_large(max_bytes));
    }
    refuse_if_no_room(state, declared_bytes.unwrap_or(0))?;
    refuse_over_quota(state, declared_bytes.unwrap_or(0)).await?;
    let target = Target { upload: state.store.begin_upload()?, max_bytes };
    let (received, declared) = if is_form {
        receive_form(request, target, declared).await?
    } else {
        (receive_body(request.into_body(), target).await?, declared)
    };
    declared.check(&received)?;
    refuse_over_quota(state, received.size_bytes).await?;
    keep(state, id, received, declared.name.as_deref(), declared.format).await
}

/// Keeps what was received, if it is an image, of this format if one was declared.
pub(super) async fn keep(
    state: &AppState,
    id: Uuid,
    received: Received,
    name: Option<&str>,
    declared: Option<Format>,
) -> Result<(Image, bool), Problem> {
    let (received, header) = probe(received, declared, state.configuration.image_limits()).await?;
    Ok(state.store.keep_image(id, received, &header, name).await?)
}

/// A form with a file.
#[derive(ToSchema)]
#[expect(dead_code, reason = "describes the form in the document")]
struct Form {
    /// The image.
    #[schema(format = Binary, content_media_type = "application/octet-stream")]
    file: String,
}

/// What the client says of the file.
struct Declared {
    name: Option<String>,
    format: Option<Format>,
    file_sha256: Option<[u8; 32]>,
    body_sha256: Option<[u8; 32]>,
}

impl Declared {
    fn check(&self, received: &Received) -> Result<(), Problem> {
        if received.size_bytes == 0 {
            return Err(Problem::invalid("The file is empty."));
        }
        for (name, declared) in [("Repr-Digest", self.file_sha256), ("Content-Digest", self.body_sha256)] {
            if declared.is_some_and(|declared| declared != received.sha256) {
                let detail = format!("the SHA-256 of what has arrived is {}", hexadecimal(&received.sha256));
                let problem = Problem::invalid("What has arrived is not what was sent: its digest is another one.");
                return Err(problem.with_error(name, detail));
            }
        }
        Ok(())
    }
}

pub(super) fn format_of(media_type: &str) -> Result<Format, Problem> {
    [Format::Jpeg, Format::Png, Format::Tiff]
        .into_iter()
        .find(|format| format.media_type() == media_type)
        .ok_or_else(|| Problem::unsupported_type(format!("Content-Type is {media_type:?}; it must be {MEDIA_TYPES}")))
}

/// The `sha-256` of a dictionary of digests (RFC 9530); other algorithms are left unread, as the RFC allows.
fn declared_digest(headers: &HeaderMap, name: &'static str) -> Result<Option<[u8; 32]>, Problem> {
    let values = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
    let mut members = values.flat_map(|value| value.split(',')).filter_map(|member| member.trim().split_once('='));
    let Some((_, digest)) = members.find(|(algorithm, _)| *algorithm == "sha-256") else {
        return Ok(None);
    };
    let base64 = digest.strip_prefix(':').and_then(|text| text.strip_suffix(':'));
    let sha256 = base64.and_then(|text| STANDARD.decode(text).ok()?.try_into().ok());
    sha256.map(Some).ok_or_else(|| {
        let detail = format!("{name} is malformed; it must be sha-256=:<base64 of 32 bytes>:");
        Problem::bad_request(detail.clone()).with_error(name, detail)
    })
}

pub(super) fn content_length(headers: &HeaderMap) -> Option<u64> {
    headers.get(header::CONTENT_LENGTH)?.to_str().ok()?.parse().ok()
}

pub(super) fn refuse_if_no_room(state: &AppState, needed_bytes: u64) -> Result<(), Problem> {
    let (free, reserve) = (state.store.free_bytes()?, state.configuration.disk_reserve_bytes);
    if needed_bytes.saturating_add(reserve) > free {
        return Err(Problem::storage_full(&format!("{needed_bytes} bytes wanted, {free} free, {reserve} in reserve")));
    }
    Ok(())
}

/// Refuses what does not fit into the room that all images together may have.
pub(super) async fn refuse_over_quota(state: &AppState, needed_bytes: u64) -> Result<(), Problem> {
    let max_bytes = state.configuration.images_max_bytes;
    if max_bytes > 0 && state.store.images_bytes().await?.saturating_add(needed_bytes) > max_bytes {
        return Err(Problem::quota_exceeded(max_bytes));
    }
    Ok(())
}

pub(super) fn too_large(max_bytes: u64) -> Problem {
    Problem::too_large(format!("The image is larger than the {max_bytes} bytes that this service accepts."))
}

struct Target {
    upload: Upload,
    max_bytes: u64,
}

impl Target {
    async fn write(&mut self, bytes: &[u8]) -> Result<(), Problem> {
        if self.upload.size_bytes() + bytes.len() as u64 > self.max_bytes {
            return Err(too_large(self.max_bytes));
        }
        Ok(self.upload.write(bytes).await?)
    }
}

async fn receive_body(body: Body, mut target: Target) -> Result<Received, Problem> {
    let mut chunks = body.into_data_stream();
    while let Some(chunk) = chunks.next().await {
        let chunk = chunk.map_err(|error| body_problem(&error, StatusCode::BAD_REQUEST))?;
        target.write(&chunk).await?;
    }
    Ok(target.upload.complete().await?)
}

async fn receive_form(
    request: Request,
    mut target: Target,
    mut declared: Declared,
) -> Result<(Received, Declared), Problem> {
    let malformed = |error: MultipartError| body_problem(&error, error.status());
    let mut form = Multipart::from_request(request, &())
        .await
        .map_err(|error| Problem::bad_request(format!("The form is malformed: {}", error.body_text())))?;
    let mut found = false;
    while let Some(mut part) = form.next_field().await.map_err(malformed)? {
        refuse_part(&part, found)?;
        found = true;
        if let Some(kind) = part.content_type().filter(|kind| *kind != "application/octet-stream") {
            declared.format = Some(format_of(kind)?);
        }
        // it is said by the way here: one that cannot be kept is no reason to refuse the file
        declared.name = declared.name.or_else(|| part.file_name().and_then(|name| name::checked(name).ok()));
        while let Some(chunk) = part.chunk().await.map_err(malformed)? {
            target.write(&chunk).await?;
        }
    }
    if !found {
        return Err(Problem::invalid("The form has no part `file`."));
    }
    Ok((target.upload.complete().await?, declared))
}

fn refuse_part(part: &Field<'_>, file_was_found: bool) -> Result<(), Problem> {
    if part.name() != Some("file") {
        let name = part.name().unwrap_or_default();
        return Err(Problem::invalid(format!("The form has a part {name:?}; it must have one part, `file`.")));
    }
    if file_was_found {
        return Err(Problem::invalid("The form has more than one part `file`; upload one image at a time."));
    }
    Ok(())
}

async fn probe(received: Received, declared: Option<Format>, limits: Limits) -> Result<(Received, Header), Problem> {
    let read = move || imagery::probe(received.path(), &limits).map(|probe| (received, probe));
    let (received, probe) = tokio::task::spawn_blocking(read)
        .await
        .map_err(|error| Problem::internal(&error))?
        .map_err(|error| imagery_problem(&error))?;
    if let Some(declared) = declared.filter(|declared| *declared != probe.format) {
        let detail = format!("The type says {}, but the content is a {}.", declared.name(), probe.format.name());
        return Err(Problem::unsupported_type(detail));
    }
    let header = Header {
        format: probe.format.name().to_ascii_lowercase(),
        width_px: probe.width_px,
        height_px: probe.height_px,
        position: probe.position.map(|p| GeographicPosition {
            longitude_deg: p.longitude_deg,
            latitude_deg: p.latitude_deg,
            height_m: p.altitude_m,
        }),
        camera_model: probe.camera_model,
        taken_on: probe.taken,
    };
    Ok((received, header))
}

pub(super) fn imagery_problem(error: &ImageryError) -> Problem {
    match error {
        ImageryError::Read { source } => Problem::internal(source),
        ImageryError::UnknownFormat { .. } => Problem::unsupported_type(error.to_string()),
        // the configuration has the same names, with a prefix
        ImageryError::OverLimit { what, found, limit, setting } => {
            let detail = format!("the picture has {found} {what}, but at most {limit} are read here");
            Problem::too_large(format!("{detail} (set by `image_{setting}`)"))
        }
        ImageryError::Unsupported { .. } | ImageryError::Damaged { .. } => Problem::invalid(error.to_string()),
    }
}

/// List the images
///
/// The newest first.
#[utoipa::path(
    get, path = "/images", operation_id = "list_images", tag = "images", params(PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<ImageAnswer>),
        (status = "default", description = "Any problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<ImageAnswer>>, Problem> {
    let wanted = query.wanted()?;
    let fetched = state.store.images(wanted.before, wanted.fetch()).await?;
    Ok(axum::Json(wanted.page(fetched, |image| image.id, ImageAnswer::from)))
}

/// Show an image
///
/// What is known of it, not its pixels.
#[utoipa::path(
    get, path = "/images/{id}", operation_id = "show_image", tag = "images",
    params(("id" = Uuid, Path, description = "The image's id")),
    responses(
        (status = 200, description = "The image", body = ImageAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<axum::Json<ImageAnswer>, Problem> {
    Ok(axum::Json(found(&state, id).await?.into()))
}

async fn found(state: &AppState, id: Uuid) -> Result<Image, Problem> {
    state.store.image(id).await?.ok_or_else(missing)
}

fn missing() -> Problem {
    Problem::not_found("There is no image with this id.")
}

/// Remove an image
///
/// Its file is gone then, and with it all pictures of it; orientations keep their results. The same bytes uploaded again bring
/// it back under the same id.
#[utoipa::path(
    delete, path = "/images/{id}", operation_id = "remove_image", tag = "images",
    params(("id" = Uuid, Path, description = "The image's id")),
    responses(
        (status = 204, description = "Removed"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "An orientation of it waits or runs", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<StatusCode, Problem> {
    let image = state.store.image(id).await?;
    match state.store.remove_image(id).await? {
        Removal::Done => {
            image.iter().for_each(|image| state.pictures.forget(&image.sha256));
            Ok(StatusCode::NO_CONTENT)
        }
        Removal::Missing => Err(missing()),
        Removal::InUse => {
            Err(Problem::conflict("An orientation of this image waits or runs; cancel it, or wait for its end."))
        }
    }
}
