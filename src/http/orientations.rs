//! Orientations: asked for, followed, looked at.

mod all_events;
mod answer;
mod drawing;
mod events;
mod list;
mod overlay;
mod reviews;
mod trials;

use std::time::{Duration, Instant};

use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::access::Caller;
use super::extract::{Json, Path, Query};
use super::idempotency::NewId;
use super::problem::Problem;
use super::state::AppState;
use crate::control::sets;
use crate::imagery::{self, ImageryError};
use crate::jobs::SubmitError;
use crate::jobs::request::{ImageFacts, OrientationRequest};
use crate::store::cameras::NamedCamera;
use crate::store::images::Image;
use crate::store::orientations::{NewOrientation, Orientation, Status};
use crate::store::removal::Removal;
use answer::OrientationAnswer;

/// After a full queue, when to come back.
const RETRY_AFTER_S: u32 = 10;

/// The routes of the orientations.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(list::list, create))
        .routes(routes!(read, cancel))
        .routes(routes!(all_events::events))
        .routes(routes!(events::events))
        .routes(routes!(overlay::overlay))
        .routes(routes!(drawing::drawing))
        .routes(routes!(drawing::map))
        .routes(routes!(trials::attempt))
        .routes(routes!(trials::window))
        .routes(routes!(reviews::create, reviews::list))
}

/// Orient an image
///
/// Everything is checked before it is accepted; what is accepted comes to its end, even through a restart of the
/// service. An image that cannot be oriented has `succeeded` with the verdict `red` and its reasons; `failed` is for a
/// broken file or a fault of the service. Where the approximation leaves something out, the image file is asked: its
/// EXIF position (sigma 15, 15, 30 m unless it states better) and the heading in its EXIF or XMP (kappa = -heading, with
/// a sigma of 15 degrees).
#[utoipa::path(
    post, path = "/orientations", operation_id = "orient", tag = "orientations", request_body = OrientationRequest,
    params(
        ("Prefer" = Option<String>, Header, description = "`wait=N`: answer when it has ended, at the latest after N seconds"),
        ("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, description = "Makes the request safe to repeat"),
    ),
    responses(
        (status = 202, description = "Accepted; `Location` says where to look", body = OrientationAnswer),
        (status = 200, description = "Ended while the client waited", body = OrientationAnswer),
        (status = 422, description = "A field makes no sense, or refers to what does not exist", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too many are waiting", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(
    State(state): State<AppState>,
    NewId(id): NewId,
    caller: Caller,
    headers: HeaderMap,
    Json(request): Json<OrientationRequest>,
) -> Result<Response, Problem> {
    let new = checked(&state, id, &request, caller.credential).await?;
    state.jobs.submit(&new).await?;
    let wait_s = preferred_wait_s(&headers).map(|seconds| seconds.min(state.configuration.wait_max_s));
    let patience = Duration::from_secs(wait_s.unwrap_or(0));
    let orientation = state.jobs.wait(id, patience).await?.ok_or_else(missing)?;
    let status = if wait_s.is_some() && orientation.status.is_final() { StatusCode::OK } else { StatusCode::ACCEPTED };
    let location = format!("/api/v1/orientations/{id}");
    let answer = OrientationAnswer::new(orientation)?;
    let mut response = (status, [(header::LOCATION, location)], axum::Json(answer)).into_response();
    if let Some(applied) = wait_s.and_then(|seconds| HeaderValue::try_from(format!("wait={seconds}")).ok()) {
        response.headers_mut().insert(HeaderName::from_static("preference-applied"), applied);
    }
    Ok(response)
}

/// Finds what the request refers to, and checks everything. `lane`: among whom it waits its turn.
pub(super) async fn checked(
    state: &AppState,
    id: Uuid,
    request: &OrientationRequest,
    lane: String,
) -> Result<NewOrientation, Problem> {
    let image = match Uuid::try_parse(&request.image) {
        Ok(id) => state.store.image(id).await?,
        Err(_) => None,
    };
    let image = image.ok_or_else(|| Problem::invalid_field("/image", "there is no image with this id"))?;
    let camera = state.store.camera(&request.camera).await?;
    let camera = camera.ok_or_else(|| Problem::invalid_field("/camera", "there is no camera with this id or name"))?;
    checked_of(state, id, request, (&image, &camera), lane).await
}

/// Checks everything, for an image and a camera that are found.
pub(super) async fn checked_of(
    state: &AppState,
    id: Uuid,
    request: &OrientationRequest,
    (image, camera): (&Image, &NamedCamera),
    lane: String,
) -> Result<NewOrientation, Problem> {
    let facts = facts(state, image, request).await?;
    let mut prepared = request.prepare(camera.image_size_px(), &facts).map_err(|faults| Problem::of_faults(&faults))?;
    for (place, set) in request.control_sets.iter().flatten().enumerate() {
        if sets::by_name(state.store.database(), set).await?.is_none() {
            return Err(Problem::invalid_field(
                format!("/control_sets/{place}"),
                "there is no control set of this name",
            ));
        }
    }
    if let Some(webhook) = &request.webhook {
        let allowed = state.configuration.webhook_policy().check(webhook);
        allowed.map_err(|detail| Problem::invalid_field("/webhook", detail))?;
    }
    prepared.policy = prepared.policy.or(&state.configuration.policy());
    let prepared = serde_json::to_string(&prepared).map_err(|error| Problem::internal(&error))?;
    let (priority, webhook) = (request.priority.unwrap_or_default(), request.webhook.clone());
    Ok(NewOrientation { id, image_id: image.id, camera_id: camera.id, prepared, lane, priority, webhook })
}

/// What is known of the image; its file is asked only where the request leaves something out.
async fn facts(state: &AppState, image: &Image, request: &OrientationRequest) -> Result<ImageFacts, Problem> {
    let size_px = [image.header.width_px, image.header.height_px];
    if request.approximation.position.is_some() && request.approximation.kappa_deg.is_some() {
        return Ok(ImageFacts { size_px, taken: image.header.taken_on, ..ImageFacts::default() });
    }
    let (path, limits) = (state.store.image_file(&image.sha256).await?, state.configuration.image_limits());
    let probed = tokio::task::spawn_blocking(move || imagery::probe(&path, &limits)).await;
    match probed.map_err(|error| Problem::internal(&error))? {
        Ok(probe) => Ok(ImageFacts::from(&probe)),
        Err(ImageryError::Read { source }) => Err(Problem::internal(&source)),
        Err(error) => Err(Problem::invalid_field("/image", error.to_string())),
    }
}

/// The seconds of `Prefer: wait=N` (RFC 7240). What cannot be understood there is to be ignored.
fn preferred_wait_s(headers: &HeaderMap) -> Option<u64> {
    let preferences = headers.get_all("prefer").iter().filter_map(|value| value.to_str().ok());
    preferences.flat_map(|value| value.split(',')).find_map(|preference| {
        let (name, value) = preference.split(';').next()?.split_once('=')?;
        name.trim().eq_ignore_ascii_case("wait").then(|| value.trim().trim_matches('"').parse().ok())?
    })
}

/// Show an orientation
///
/// With its result, once it has one.
#[utoipa::path(
    get, path = "/orientations/{id}", operation_id = "show_orientation", tag = "orientations",
    params(("id" = Uuid, Path, description = "The orientation's id")),
    responses(
        (status = 200, description = "The orientation", body = OrientationAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<Response, Problem> {
    let began = Instant::now();
    let text = match state.ended.get(&id) {
        Some(text) => text,
        None => {
            let orientation = found(&state, id).await?;
            let has_ended = orientation.status.is_final();
            let text = serde_json::to_vec(&OrientationAnswer::new(orientation)?);
            let text = Bytes::from(text.map_err(|error| Problem::internal(&error))?);
            if has_ended {
                state.ended.put(id, text.clone(), began);
            }
            text
        }
    };
    Ok(([(header::CONTENT_TYPE, "application/json")], text).into_response())
}

/// What is to become of an orientation.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct CancelQuery {
    /// `true` removes an orientation that has ended, with its result, instead of cancelling one that has not.
    #[serde(default)]
    forget: bool,
}

/// Cancel an orientation
///
/// An attempt under way ends soon. What was cancelled before is answered the same. With `forget=true` one that has ended
/// is removed with its result, for good.
#[utoipa::path(
    delete, path = "/orientations/{id}", operation_id = "cancel_orientation", tag = "orientations",
    params(("id" = Uuid, Path, description = "The orientation's id"), CancelQuery),
    responses(
        (status = 200, description = "Cancelled", body = OrientationAnswer),
        (status = 204, description = "Removed, as asked for by `forget`"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "It has ended already; with `forget`, it has not", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn cancel(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Query(query): Query<CancelQuery>,
) -> Result<Response, Problem> {
    if query.forget {
        return match state.store.forget_orientation(id).await? {
            Removal::Done => {
                state.ended.forget_all();
                Ok(StatusCode::NO_CONTENT.into_response())
            }
            Removal::Missing => Err(missing()),
            Removal::InUse => Err(Problem::conflict("It has not ended; cancel it first.")),
        };
    }
    state.jobs.cancel(id).await?;
    let orientation = found(&state, id).await?;
    if orientation.status != Status::Cancelled {
        return Err(Problem::conflict(format!("It has {} already.", orientation.status.name())));
    }
    Ok(axum::Json(OrientationAnswer::new(orientation)?).into_response())
}

async fn found(state: &AppState, id: Uuid) -> Result<Orientation, Problem> {
    state.store.orientation(id).await?.ok_or_else(missing)
}

fn missing() -> Problem {
    Problem::not_found("There is no orientation with this id.")
}

impl From<SubmitError> for Problem {
    fn from(error: SubmitError) -> Self {
        match error {
            SubmitError::QueueFull { .. } => Self::unavailable(format!("{error}; come back later."), RETRY_AFTER_S),
            SubmitError::Store(error) => error.into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waiting_is_understood_in_all_its_spellings() {
        let wait = |value: &'static str| {
            let headers = HeaderMap::from_iter([(HeaderName::from_static("prefer"), HeaderValue::from_static(value))]);
            preferred_wait_s(&headers)
        };
        assert_eq!(wait("wait=10"), Some(10));
        assert_eq!(wait("respond-async, Wait=\"5\""), Some(5));
        assert_eq!(wait("wait = 7; foo=bar"), Some(7));
        assert_eq!(wait("respond-async"), None);
        assert_eq!(wait("wait=soon"), None);
        assert_eq!(wait("wait=-1"), None);
    }
}
