//! Errors as the client sees them: `application/problem+json` (RFC 9457). This file alone knows status codes of errors.
//!
//! The client reads what is wrong and what would be right; never a path of the server, SQL, or a stack trace. The
//! cause goes to the log, where the request's id leads to it.

use std::fmt;

use axum::Json;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use sqlx::error::DatabaseError;
use sqlx::postgres::PgDatabaseError;
use utoipa::ToSchema;

use super::request_id;
use crate::jobs::request::FieldFault;
use crate::store::StoreError;

/// An error as RFC 9457 describes it.
#[derive(Debug, Serialize, ToSchema)]
pub struct Problem {
    /// A URN that stays the same for this kind of problem.
    #[serde(rename = "type")]
    #[schema(example = "urn:gable:problem:invalid-content")]
    kind: &'static str,
    /// The kind of problem in words.
    #[schema(example = "The content is not valid")]
    title: &'static str,
    /// The HTTP status.
    #[schema(value_type = u16, example = 422)]
    #[serde(serialize_with = "as_number")]
    status: StatusCode,
    /// What is wrong in this case, and what would be right.
    detail: String,
    /// This occurrence: the request's id, as in the header `X-Request-Id` and in the log.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    instance: Option<Box<str>>,
    /// The fields that are at fault.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    errors: Vec<FieldError>,
    #[serde(skip)]
    retry_after_s: Option<u32>,
    #[serde(skip)]
    challenge: bool,
}

/// A field that is at fault.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct FieldError {
    /// JSON Pointer (RFC 6901) into the body; `?name` for a parameter of the query, a header's name for a header, `line N`
    /// for a line of a text.
    #[schema(example = "/principal_distance_px")]
    pub pointer: String,
    /// What is wrong with it.
    pub detail: String,
}

fn as_number<S: serde::Serializer>(status: &StatusCode, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_u16(status.as_u16())
}

impl Problem {
    fn new(status: StatusCode, kind: &'static str, title: &'static str, detail: impl Into<String>) -> Self {
        Self {
            kind,
            title,
            status,
            detail: detail.into(),
            instance: None,
            errors: Vec::new(),
            retry_after_s: None,
            challenge: false,
        }
    }

    /// 400: the request itself is malformed.
    #[must_use]
    pub fn bad_request(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, "urn:gable:problem:bad-request", "The request is malformed", detail)
    }

    /// 401: no key, or none that is valid.
    #[must_use]
    pub fn unauthorized(detail: impl Into<String>) -> Self {
        let problem =
            Self::new(StatusCode::UNAUTHORIZED, "urn:gable:problem:unauthorized", "A valid key is needed", detail);
        Self { challenge: true, ..problem }
    }

    /// 403: the key's role does not allow it.
    #[must_use]
    pub fn forbidden(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::FORBIDDEN, "urn:gable:problem:forbidden", "This is not allowed", detail)
    }

    /// 404: there is no such thing.
    #[must_use]
    pub fn not_found(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, "urn:gable:problem:not-found", "There is no such thing", detail)
    }

    /// 405: not with this method.
    #[must_use]
    pub fn method_not_allowed(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::METHOD_NOT_ALLOWED,
            "urn:gable:problem:method-not-allowed",
            "This method is not possible here",
            detail,
        )
    }

    /// 408: the client was too slow.
    #[must_use]
    pub fn too_slow(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::REQUEST_TIMEOUT,
            "urn:gable:problem:too-slow",
            "The request took too long to arrive",
            detail,
        )
    }

    /// 409: it contradicts what is there.
    #[must_use]
    pub fn conflict(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::CONFLICT, "urn:gable:problem:conflict", "This contradicts what is there", detail)
    }

    /// 410: it was there, and is not any more.
    #[must_use]
    pub fn gone(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::GONE, "urn:gable:problem:gone", "It is not there any more", detail)
    }

    /// 412: the protocol of the request is another one.
    #[must_use]
    pub fn unsupported_version(detail: impl Into<String>) -> Self {
        let title = "The version of the protocol is not supported";
        Self::new(StatusCode::PRECONDITION_FAILED, "urn:gable:problem:unsupported-version", title, detail)
    }

    /// 423: somebody else is at it.
    #[must_use]
    pub fn locked(detail: impl Into<String>) -> Self {
        let problem = Self::new(StatusCode::LOCKED, "urn:gable:problem:locked", "Somebody else is at it", detail);
        problem.with_retry_after(1)
    }

    /// 460, as tus has it: what has arrived is not what was sent.
    #[must_use]
    pub fn checksum_mismatch(detail: impl Into<String>) -> Self {
        let status = StatusCode::from_u16(460).unwrap_or(StatusCode::BAD_REQUEST);
        Self::new(status, "urn:gable:problem:checksum-mismatch", "What has arrived is not what was sent", detail)
    }

    /// 413: more than the configuration allows.
    #[must_use]
    pub fn too_large(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::PAYLOAD_TOO_LARGE, "urn:gable:problem:too-large", "The content is too large", detail)
    }

    /// 415: not a type that is understood here.
    #[must_use]
    pub fn unsupported_type(detail: impl Into<String>) -> Self {
        let title = "The type of the content is not supported";
        Self::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "urn:gable:problem:unsupported-type", title, detail)
    }

    /// 422: well-formed, but it makes no sense.
    #[must_use]
    pub fn invalid(detail: impl Into<String>) -> Self {
        Self::new(
            StatusCode::UNPROCESSABLE_ENTITY,
            "urn:gable:problem:invalid-content",
            "The content is not valid",
            detail,
        )
    }

    /// 422: one field makes no sense.
    #[must_use]
    pub fn invalid_field(pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        let detail = detail.into();
        Self::invalid(detail.clone()).with_error(pointer, detail)
    }

    /// 422 for all the fields that are at fault.
    #[must_use]
    pub fn of_faults(faults: &[FieldFault]) -> Self {
        let detail = faults.first().map_or("", |fault| fault.detail.as_str());
        let more = if faults.len() > 1 { format!(" (and {} more)", faults.len() - 1) } else { String::new() };
        faults.iter().fold(Self::invalid(format!("{detail}{more}")), |problem, fault| {
            problem.with_error(&fault.pointer, &fault.detail)
        })
    }

    /// 429: too often.
    #[must_use]
    pub fn too_many(detail: impl Into<String>) -> Self {
        Self::new(StatusCode::TOO_MANY_REQUESTS, "urn:gable:problem:too-many", "Too many requests", detail)
    }

    /// 503: not now.
    #[must_use]
    pub fn unavailable(detail: impl Into<String>, retry_after_s: u32) -> Self {
        let problem = Self::new(
            StatusCode::SERVICE_UNAVAILABLE,
            "urn:gable:problem:unavailable",
            "Not available at present",
            detail,
        );
        Self { retry_after_s: Some(retry_after_s), ..problem }
    }

    /// 500: a fault of the service. The cause is logged and not told.
    #[must_use]
    pub fn internal(cause: &dyn fmt::Display) -> Self {
        tracing::error!(%cause, "request failed by a fault of the service");
        let detail = "The service has made a mistake. Its log says more under the id of this request.";
        Self::new(StatusCode::INTERNAL_SERVER_ERROR, "urn:gable:problem:internal", "A fault of the service", detail)
    }

    /// 503: others hold the database for too long.
    fn busy(cause: &dyn fmt::Display) -> Self {
        tracing::warn!(%cause, "the database is too busy");
        Self::unavailable("The database does not answer at present.", 1)
    }

    /// 507: the disk is full.
    #[must_use]
    pub fn storage_full(cause: &dyn fmt::Display) -> Self {
        tracing::error!(%cause, "the disk is full");
        let detail = "The service has no room left on its disk.";
        Self::new(StatusCode::INSUFFICIENT_STORAGE, "urn:gable:problem:storage-full", "No room left", detail)
    }

    /// 507: there are as many images as the configuration allows.
    #[must_use]
    pub fn quota_exceeded(max_bytes: u64) -> Self {
        let detail = format!(
            "All images together may have {max_bytes} bytes (set by `images_max_bytes`), and this one does not fit any \
             more; remove images that are not needed."
        );
        let title = "No room left";
        Self::new(StatusCode::INSUFFICIENT_STORAGE, "urn:gable:problem:quota-exceeded", title, detail)
    }

    /// Names a field that is at fault.
    #[must_use]
    pub fn with_error(mut self, pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        self.errors.push(FieldError { pointer: pointer.into(), detail: detail.into() });
        self
    }

    /// Asks the client to come back later.
    #[must_use]
    pub fn with_retry_after(self, seconds: u32) -> Self {
        Self { retry_after_s: Some(seconds), ..self }
    }

    /// The HTTP status.
    #[must_use]
    pub fn status(&self) -> StatusCode {
        self.status
    }
}

/// On one line, for the command line: what is wrong, and where.
impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.errors.first() {
            Some(FieldError { pointer, detail }) if !pointer.is_empty() => write!(f, "{pointer}: {detail}"),
            _ => f.write_str(&self.detail),
        }
    }
}

impl std::error::Error for Problem {}

impl IntoResponse for Problem {
    fn into_response(mut self) -> Response {
        self.instance = request_id::current().map(String::into_boxed_str);
        let (status, retry_after_s, challenge) = (self.status, self.retry_after_s, self.challenge);
        let mut response = (status, Json(self)).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        if let Some(seconds) = retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if challenge {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        Self::of_store(&error)
    }
}

impl Problem {
    /// What the client is told of an error of the store.
    #[must_use]
    pub fn of_store(error: &StoreError) -> Self {
        match error {
            StoreError::File { source, .. } if source.kind() == std::io::ErrorKind::StorageFull => {
                Self::storage_full(error)
            }
            StoreError::JustRemoved => {
                Self::unavailable("These bytes were being removed at this moment; send them again.", 1)
            }
            StoreError::Database { source } => Self::of_database(source, error),
            StoreError::Objects { .. } => {
                tracing::error!(%error, "the object store does not do what it should");
                Self::unavailable("The object store does not answer.", 5)
            }
            _ => Self::internal(error),
        }
    }

    fn of_database(error: &sqlx::Error, cause: &dyn fmt::Display) -> Self {
        match error {
            // a server that restarts, or a network that was cut
            sqlx::Error::PoolTimedOut | sqlx::Error::PoolClosed | sqlx::Error::Io(_) | sqlx::Error::Tls(_) => {
                Self::busy(cause)
            }
            sqlx::Error::Database(refusal) => match refusal.try_downcast_ref::<PgDatabaseError>() {
                Some(refusal) => match refusal.code() {
                    "53100" => Self::storage_full(cause),
                    // resources, operators, locks, and transactions that met
                    code if ["53", "57P", "08", "55P03", "40"].iter().any(|class| code.starts_with(class)) => {
                        Self::busy(cause)
                    }
                    _ => Self::internal(cause),
                },
                None => match sqlite_code(refusal.as_ref()) {
                    Some(SQLITE_BUSY | SQLITE_LOCKED) => Self::busy(cause),
                    Some(SQLITE_FULL) => Self::storage_full(cause),
                    _ => Self::internal(cause),
                },
            },
            _ => Self::internal(cause),
        }
    }
}

const SQLITE_BUSY: i32 = 5;
const SQLITE_LOCKED: i32 = 6;
const SQLITE_FULL: i32 = 13;

/// The primary result code: the low byte of the extended one.
fn sqlite_code(refusal: &dyn DatabaseError) -> Option<i32> {
    Some(refusal.code()?.parse::<i32>().ok()? & 0xff)
}

impl From<sqlx::Error> for Problem {
    fn from(error: sqlx::Error) -> Self {
        StoreError::from(error).into()
    }
}
