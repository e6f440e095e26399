//! Uploads that can be resumed, by the protocol tus 1.0 (<https://tus.io/protocols/resumable-upload>) with its extensions
//! creation, creation-with-upload, checksum, expiration and termination.

mod declared;
mod receive;

use axum::extract::{DefaultBodyLimit, Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::map_response;
use axum::response::{IntoResponse as _, Response};
use chrono::{DateTime, TimeDelta, Utc};
use serde::Serialize;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::blocks;
use super::extract::{Path, media_type, refuse_encoded};
use super::idempotency::NewId;
use super::images::{content_length, refuse_if_no_room, refuse_over_quota, too_large};
use super::problem::Problem;
use super::state::AppState;
use crate::store::now;
use crate::store::uploads::{Resumable, UploadError};
use declared::Metadata;
use receive::{receive, settle};

const VERSION: HeaderValue = HeaderValue::from_static("1.0.0");
const EXTENSIONS: &str = "creation,creation-with-upload,checksum,expiration,termination";
const PIECE: &str = "application/offset+octet-stream";
const RESUMABLE: HeaderName = HeaderName::from_static("tus-resumable");
const OFFSET: HeaderName = HeaderName::from_static("upload-offset");
const LENGTH: HeaderName = HeaderName::from_static("upload-length");
const EXPIRES: HeaderName = HeaderName::from_static("upload-expires");
const METADATA: HeaderName = HeaderName::from_static("upload-metadata");
/// The id of the image that an upload has become.
const IMAGE: HeaderName = HeaderName::from_static("gable-image");

/// The routes of the uploads.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(options, create))
        .routes(routes!(head, show, append, remove))
        .layer(DefaultBodyLimit::disable())
        .layer(map_response(async |mut response: Response| {
            response.headers_mut().insert(RESUMABLE, VERSION);
            response
        }))
}

/// An upload.
#[derive(Debug, Serialize, ToSchema)]
struct UploadAnswer {
    /// UUIDv7.
    id: Uuid,
    /// Length of the file.
    length_bytes: i64,
    /// How much of it is on disk.
    received_bytes: i64,
    /// As the client gave it.
    #[serde(skip_serializing_if = "Option::is_none")]
    filename: Option<String>,
    /// The id of the image that has become of it.
    image: Option<Uuid>,
    /// When it was begun.
    created_at: DateTime<Utc>,
    /// When it is given up if nothing more comes.
    expires_at: DateTime<Utc>,
}

/// What the service knows of tus
#[utoipa::path(
    options, path = "/uploads", operation_id = "describe_uploads", tag = "uploads", security(()),
    responses((status = 204, description = "In the headers `Tus-Version`, `Tus-Extension`, `Tus-Max-Size` and `Tus-Checksum-Algorithm`")),
)]
async fn options(State(state): State<AppState>) -> Response {
    let max_bytes = state.configuration.upload_max_bytes.to_string();
    let headers = [
        ("tus-version", "1.0.0".to_owned()),
        ("tus-extension", EXTENSIONS.to_owned()),
        ("tus-max-size", max_bytes),
        ("tus-checksum-algorithm", "sha256".to_owned()),
    ];
    (StatusCode::NO_CONTENT, headers).into_response()
}

/// Begin an upload
///
/// By tus 1.0: `Upload-Length` says how long the file is, `Upload-Metadata` may give `filename`, `filetype`, `sha256` (in
/// hexadecimal digits; checked at the end) and `block` (the id of a block in whose list `filename` stands: there the
/// image is attached and oriented). The body may be the first piece.
#[utoipa::path(
    post, path = "/uploads", operation_id = "begin_upload", tag = "uploads",
    params(
        ("Tus-Resumable" = String, Header, description = "`1.0.0`"),
        ("Upload-Length" = u64, Header, description = "Bytes of the file"),
        ("Upload-Metadata" = Option<String>, Header, description = "Pairs of a key and its value in base64, separated by commas"),
        ("Upload-Checksum" = Option<String>, Header, description = "`sha256 <base64>` of the body"),
    ),
    request_body(content = Option<Vec<u8>>, content_type = "application/offset+octet-stream"),
    responses(
        (status = 201, description = "Begun; `Location` says where it goes on"),
        (status = 400, description = "A header is missing or malformed", body = Problem, content_type = "application/problem+json"),
        (status = 412, description = "Another version of tus", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "Larger than this service accepts", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "The metadata make no sense", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "No room left", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(State(state): State<AppState>, NewId(id): NewId, request: Request) -> Result<Response, Problem> {
    let headers = request.headers();
    refuse_other_version(headers)?;
    refuse_encoded(headers)?;
    let length_bytes = declared::whole_number(headers, &LENGTH)?;
    let metadata = Metadata::of(headers)?;
    if length_bytes == 0 {
        return Err(Problem::invalid("The file is empty."));
    }
    let max_bytes = state.configuration.upload_max_bytes;
    if length_bytes.unsigned_abs() > max_bytes {
        return Err(too_large(max_bytes));
    }
    refuse_if_no_room(&state, length_bytes.unsigned_abs())?;
    refuse_over_quota(&state, length_bytes.unsigned_abs()).await?;
    metadata.check(&state).await?;
    let checksum = declared::checksum(headers)?;
    let with_piece = media_type(headers).as_deref() == Some(PIECE);
    let text = serde_json::to_string(&metadata).map_err(|error| Problem::internal(&error))?;
    state.store.create_upload(id, length_bytes, &text, expiry(&state)).await?;
    let upload = match with_piece {
        true => {
            let writer = state.store.write_upload(id).await?;
            receive(&state, writer, request.into_body(), checksum).await?
        }
        false => found(&state, id).await?,
    };
    let location = HeaderValue::try_from(format!("/api/v1/uploads/{id}")).map_err(|error| Problem::internal(&error))?;
    let mut answer = (StatusCode::CREATED, state_of(&upload)).into_response();
    answer.headers_mut().insert(header::LOCATION, location);
    Ok(answer)
}

/// How far an upload is
#[utoipa::path(
    head, path = "/uploads/{id}", operation_id = "upload_offset", tag = "uploads",
    params(("id" = Uuid, Path, description = "The upload's id"), ("Tus-Resumable" = String, Header, description = "`1.0.0`")),
    responses(
        (status = 200, description = "`Upload-Offset` bytes are on disk; once it is whole, `Gable-Image` is the image's id"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "It has expired", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn head(State(state): State<AppState>, Path(id): Path<Uuid>, headers: HeaderMap) -> Result<Response, Problem> {
    refuse_other_version(&headers)?;
    let upload = settled(&state, living(&state, id).await?).await?;
    let mut answer = (StatusCode::OK, state_of(&upload)).into_response();
    let told = answer.headers_mut();
    told.insert(LENGTH, HeaderValue::from(upload.length_bytes));
    told.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    let given = Metadata::stored(&upload)?.given;
    if let Some(given) = HeaderValue::try_from(given).ok().filter(|given| !given.is_empty()) {
        told.insert(METADATA, given);
    }
    Ok(answer)
}

/// Show an upload
#[utoipa::path(
    get, path = "/uploads/{id}", operation_id = "show_upload", tag = "uploads",
    params(("id" = Uuid, Path, description = "The upload's id")),
    responses(
        (status = 200, description = "The upload", body = UploadAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "It has expired", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn show(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<axum::Json<UploadAnswer>, Problem> {
    let upload = settled(&state, living(&state, id).await?).await?;
    Ok(axum::Json(UploadAnswer {
        id,
        length_bytes: upload.length_bytes,
        received_bytes: upload.received_bytes,
        filename: Metadata::stored(&upload)?.filename,
        image: upload.image_id,
        created_at: upload.created_at,
        expires_at: upload.expires_at,
    }))
}

/// Go on with an upload
///
/// The body is the next piece. What `Upload-Offset` acknowledges is on disk, whatever happens. If the connection breaks,
/// what has come by then is kept, unless the piece has a checksum. The last piece makes the upload an image.
#[utoipa::path(
    patch, path = "/uploads/{id}", operation_id = "append_to_upload", tag = "uploads",
    params(
        ("id" = Uuid, Path, description = "The upload's id"),
        ("Tus-Resumable" = String, Header, description = "`1.0.0`"),
        ("Upload-Offset" = u64, Header, description = "Where the piece belongs"),
        ("Upload-Checksum" = Option<String>, Header, description = "`sha256 <base64>` of the piece"),
    ),
    request_body(content = Vec<u8>, content_type = "application/offset+octet-stream"),
    responses(
        (status = 204, description = "Appended; after the last piece `Location` and `Gable-Image` say which image it is"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The piece does not belong here: ask by HEAD where the upload is", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "It has expired", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "More than `Upload-Length`", body = Problem, content_type = "application/problem+json"),
        (status = 415, description = "Not a piece of a file; or the whole is no image, and then it is dropped", body = Problem, content_type = "application/problem+json"),
        (status = 423, description = "Another request is writing to it", body = Problem, content_type = "application/problem+json"),
        (status = 460, description = "Another checksum than declared; the piece, or the whole, is dropped", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn append(State(state): State<AppState>, Path(id): Path<Uuid>, request: Request) -> Result<Response, Problem> {
    let headers = request.headers();
    refuse_other_version(headers)?;
    refuse_encoded(headers)?;
    if media_type(headers).as_deref() != Some(PIECE) {
        return Err(Problem::unsupported_type(format!("Content-Type must be {PIECE}")));
    }
    let offset = declared::whole_number(headers, &OFFSET)?;
    let checksum = declared::checksum(headers)?;
    let needed_bytes = content_length(headers).unwrap_or(0);
    let upload = living(&state, id).await?;
    let upload = if upload.is_whole() {
        refuse_other_offset(&upload, offset)?;
        settle(&state, upload).await?
    } else {
        let writer = state.store.write_upload(id).await?;
        refuse_other_offset(&writer.upload, offset)?;
        refuse_if_no_room(&state, needed_bytes)?;
        receive(&state, writer, request.into_body(), checksum).await?
    };
    Ok((StatusCode::NO_CONTENT, state_of(&upload)).into_response())
}

/// Give an upload up
///
/// What has come of it is dropped. An image that it has become stays.
#[utoipa::path(
    delete, path = "/uploads/{id}", operation_id = "end_upload", tag = "uploads",
    params(("id" = Uuid, Path, description = "The upload's id"), ("Tus-Resumable" = String, Header, description = "`1.0.0`")),
    responses(
        (status = 204, description = "Given up"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 423, description = "Another request is writing to it", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(id): Path<Uuid>, headers: HeaderMap) -> Result<Response, Problem> {
    refuse_other_version(&headers)?;
    let upload = found(&state, id).await?;
    // the lock is kept until it is gone
    let _writer = match state.store.write_upload(upload.id).await {
        Ok(writer) => Some(writer),
        Err(UploadError::Gone) => None,
        Err(error) => return Err(error.into()),
    };
    state.store.remove_upload(id).await?;
    Ok(StatusCode::NO_CONTENT.into_response())
}

fn refuse_other_version(headers: &HeaderMap) -> Result<(), Problem> {
    if headers.get(&RESUMABLE) == Some(&VERSION) {
        return Ok(());
    }
    Err(Problem::unsupported_version("Tus-Resumable must be 1.0.0.").with_error("Tus-Resumable", "it must be 1.0.0"))
}

fn refuse_other_offset(upload: &Resumable, offset: i64) -> Result<(), Problem> {
    if upload.received_bytes == offset {
        return Ok(());
    }
    let detail = format!("Upload-Offset is {offset}; the upload is at {}", upload.received_bytes);
    Err(Problem::conflict(detail.clone()).with_error("Upload-Offset", detail))
}

/// When an upload of which something has come just now is given up.
fn expiry(state: &AppState) -> DateTime<Utc> {
    let kept_s = i64::try_from(state.configuration.upload_kept_s).unwrap_or(i64::MAX);
    now() + TimeDelta::try_seconds(kept_s).unwrap_or(TimeDelta::days(1))
}

async fn found(state: &AppState, id: Uuid) -> Result<Resumable, Problem> {
    let upload = state.store.upload(id).await?;
    upload.ok_or_else(|| Problem::not_found("There is no upload with this id."))
}

async fn living(state: &AppState, id: Uuid) -> Result<Resumable, Problem> {
    let upload = found(state, id).await?;
    if upload.expires_at < now() {
        return Err(Problem::gone("The upload has expired; begin it anew."));
    }
    Ok(upload)
}

/// The upload; one that was cut off between its last byte and its end is brought to its end.
async fn settled(state: &AppState, upload: Resumable) -> Result<Resumable, Problem> {
    if upload.is_whole() && !upload.done { settle(state, upload).await } else { Ok(upload) }
}

/// The headers that say how an upload stands.
fn state_of(upload: &Resumable) -> HeaderMap {
    let mut headers = HeaderMap::new();
    headers.insert(OFFSET, HeaderValue::from(upload.received_bytes));
    let expires = upload.expires_at.format("%a, %d %b %Y %H:%M:%S GMT").to_string();
    headers.extend(HeaderValue::try_from(expires).ok().map(|expires| (EXPIRES, expires)));
    if let Some(image) = upload.image_id {
        let location = HeaderValue::try_from(format!("/api/v1/images/{image}")).ok();
        headers.extend(location.map(|location| (header::LOCATION, location)));
        headers.extend(HeaderValue::try_from(image.to_string()).ok().map(|image| (IMAGE, image)));
    }
    headers
}

impl From<UploadError> for Problem {
    fn from(error: UploadError) -> Self {
        match error {
            UploadError::Locked => Self::locked("Another request is writing to this upload."),
            UploadError::Gone => Self::gone("The bytes of this upload are not here any more; begin it anew."),
            UploadError::Store(error) => error.into(),
        }
    }
}
