//! What handlers take out of a request, with problems instead of axum's own rejections.

use axum::RequestExt as _;
use axum::body::Bytes;
use axum::extract::rejection::{BytesRejection, PathRejection, QueryRejection};
use axum::extract::{FromRequest, FromRequestParts, Request};
use axum::http::{HeaderMap, header};
use chrono::{DateTime, Utc};
use serde::de::DeserializeOwned;

use super::pace::TooSlow;
use super::problem::Problem;

/// The most characters of a text that is looked for.
const SEARCHED_MAX: usize = 200;

/// A JSON body. Unknown fields are for `T` to refuse (`deny_unknown_fields`).
#[derive(Debug)]
pub struct Json<T>(pub T);

/// A JSON body that is not read yet.
#[derive(Debug)]
pub struct JsonText(pub Bytes);

/// The parameters of the query.
#[derive(Debug, FromRequestParts)]
#[from_request(via(axum::extract::Query), rejection(Problem))]
pub struct Query<T>(pub T);

/// The parameters of the path.
#[derive(Debug, FromRequestParts)]
#[from_request(via(axum::extract::Path), rejection(Problem))]
pub struct Path<T>(pub T);

/// A body as it is, up to the limit of its route.
#[derive(Debug)]
pub struct Raw(pub Bytes);

impl<T: DeserializeOwned, S: Send + Sync> FromRequest<S> for Json<T> {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let JsonText(body) = JsonText::from_request(request, state).await?;
        parse_json(&body).map(Self)
    }
}

impl<S: Send + Sync> FromRequest<S> for JsonText {
    type Rejection = Problem;

    async fn from_request(request: Request, state: &S) -> Result<Self, Problem> {
        let kind = media_type(request.headers());
        if !kind.as_deref().is_some_and(is_json) {
            let given = kind.as_deref().unwrap_or("none");
            return Err(Problem::unsupported_type(format!("Content-Type is {given}; it must be application/json")));
        }
        let Raw(body) = Raw::from_request(request, state).await?;
        Ok(Self(body))
    }
}

impl<S: Send + Sync> FromRequest<S> for Raw {
    type Rejection = Problem;

    async fn from_request(request: Request, _state: &S) -> Result<Self, Problem> {
        refuse_encoded(request.headers())?;
        Ok(Self(request.extract::<Bytes, _>().await?))
    }
}

/// The media type of a body without its parameters, in lower case.
#[must_use]
pub fn media_type(headers: &HeaderMap) -> Option<String> {
    let value = headers.get(header::CONTENT_TYPE)?.to_str().ok()?;
    Some(value.split(';').next().unwrap_or_default().trim().to_ascii_lowercase())
}

/// Refuses a body that is compressed for the way.
///
/// # Errors
/// 415.
pub fn refuse_encoded(headers: &HeaderMap) -> Result<(), Problem> {
    match headers.get(header::CONTENT_ENCODING) {
        Some(value) if value != "identity" => {
            Err(Problem::unsupported_type("Content-Encoding is not supported; send the content as it is"))
        }
        _ => Ok(()),
    }
}

/// Reads JSON, strictly.
///
/// # Errors
/// 400 where it is not JSON, 422 with the field's pointer where it is not what is expected.
pub fn parse_json<T: DeserializeOwned>(body: &[u8]) -> Result<T, Problem> {
    let mut deserializer = serde_json::Deserializer::from_slice(body);
    let value = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let pointer = pointer(error.path());
        let error = error.into_inner();
        match error.classify() {
            serde_json::error::Category::Data => Problem::invalid_field(pointer, error.to_string()),
            _ => Problem::bad_request(format!("The body is not valid JSON: {error}")),
        }
    })?;
    deserializer.end().map_err(|error| Problem::bad_request(format!("The body is not valid JSON: {error}")))?;
    Ok(value)
}

/// A text that is looked for, of a parameter of the query; an empty one is none.
///
/// # Errors
/// 422 if it cannot be in any name.
pub fn searched<'t>(parameter: &str, given: Option<&'t str>) -> Result<Option<&'t str>, Problem> {
    let Some(text) = given.filter(|text| !text.is_empty()) else { return Ok(None) };
    if text.chars().count() > SEARCHED_MAX || text.chars().any(char::is_control) {
        let detail = format!("{parameter} must have at most {SEARCHED_MAX} characters, and none of control");
        return Err(Problem::invalid_field(format!("?{parameter}"), detail));
    }
    Ok(Some(text))
}

/// A time that both databases can hold and compare: of the years 1970 to 9999.
#[must_use]
pub fn comparable(time: DateTime<Utc>) -> DateTime<Utc> {
    // the last second of 9999
    let latest = DateTime::from_timestamp(253_402_300_799, 0).unwrap_or(DateTime::UNIX_EPOCH);
    time.clamp(DateTime::UNIX_EPOCH, latest)
}

fn is_json(media_type: &str) -> bool {
    media_type == "application/json" || (media_type.starts_with("application/") && media_type.ends_with("+json"))
}

/// The JSON pointer to where something is wrong.
pub(super) fn pointer(path: &serde_path_to_error::Path) -> String {
    use serde_path_to_error::Segment;
    path.iter()
        .filter_map(|segment| match segment {
            Segment::Seq { index } => Some(format!("/{index}")),
            Segment::Map { key } => Some(format!("/{}", key.replace('~', "~0").replace('/', "~1"))),
            Segment::Enum { .. } | Segment::Unknown => None,
        })
        .collect()
}

impl From<BytesRejection> for Problem {
    fn from(rejection: BytesRejection) -> Self {
        body_problem(&rejection, rejection.status())
    }
}

impl From<QueryRejection> for Problem {
    fn from(rejection: QueryRejection) -> Self {
        let text = rejection.body_text();
        let detail = text.strip_prefix("Failed to deserialize query string: ").unwrap_or(&text).to_owned();
        let name = detail.split(':').next().filter(|name| !name.contains(' ')).unwrap_or_default();
        let pointer = format!("?{name}");
        Self::invalid_field(pointer, detail)
    }
}

impl From<PathRejection> for Problem {
    fn from(rejection: PathRejection) -> Self {
        tracing::debug!(%rejection, "path parameter");
        Self::not_found("There is nothing under this address.")
    }
}

/// Why a body could not be read to its end.
#[must_use]
pub fn body_problem(error: &(dyn std::error::Error + 'static), status: axum::http::StatusCode) -> Problem {
    if status == axum::http::StatusCode::PAYLOAD_TOO_LARGE {
        return Problem::too_large("The body is larger than this service accepts here.");
    }
    let mut cause = Some(error);
    while let Some(error) = cause {
        if error.is::<TooSlow>() {
            return Problem::too_slow("The body comes too slowly, or has paused for too long.");
        }
        cause = error.source();
    }
    Problem::bad_request("The body ended before it was complete.")
}
