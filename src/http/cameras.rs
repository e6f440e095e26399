//! Cameras.

mod answer;
mod convert;
mod digital;
mod request;

use axum::extract::{FromRequest as _, Request, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::extract::{JsonText, Path, Query, Raw};
use super::idempotency::NewId;
use super::page::{Page, PageQuery};
use super::problem::Problem;
use super::state::AppState;
use crate::cameras;
use crate::jobs::camera_model::uploaded_templates;
use crate::store::cameras::{Added, Removed};
use answer::CameraAnswer;
use convert::{CalibrationQuery, refuse_other_than_text};
pub use digital::DigitalCameraRequest;
pub use request::CameraRequest;

const NAME_MAX_CHARACTERS: usize = 200;

/// The routes of the cameras.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list, create)).routes(routes!(read, remove))
}

/// Whether something may have this name.
pub(super) fn check_name(pointer: &str, name: &str) -> Result<(), Problem> {
    let refuse = |detail: &str| Err(Problem::invalid_field(pointer, detail));
    let characters = name.chars().count();
    if !(1..=NAME_MAX_CHARACTERS).contains(&characters) {
        return refuse(&format!("name has {characters} characters; it must have from 1 to {NAME_MAX_CHARACTERS}"));
    }
    if name.trim() != name || name.chars().any(char::is_control) {
        return refuse("name begins or ends with a space, or contains control characters");
    }
    if Uuid::try_parse(name).is_ok() {
        return refuse("name looks like an id; choose another one");
    }
    Ok(())
}

/// Add a camera
///
/// Digital or for film. A film camera gives millimetres in the plate and its fiducial marks instead of the size of its
/// images; where its calibration report has distances between marks instead of their positions, these are adjusted. The
/// same name with the same content again is answered with 200 and the camera that is there.
///
/// With `format` the body is the calibration of another program, as text of any kind. The camera is fitted to it over the
/// whole image, and `conversion` in the answer has what is left between the two. The report of a film camera is taken over
/// as it is.
#[utoipa::path(
    post, path = "/cameras", operation_id = "add_camera", tag = "cameras", request_body = CameraRequest,
    params(CalibrationQuery, ("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, description = "Makes the request safe to repeat")),
    responses(
        (status = 201, description = "Added", body = CameraAnswer),
        (status = 200, description = "It was there already, the same", body = CameraAnswer),
        (status = 409, description = "The name belongs to a camera with other content", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A field makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(
    State(state): State<AppState>,
    NewId(id): NewId,
    Query(query): Query<CalibrationQuery>,
    request: Request,
) -> Result<Response, Problem> {
    let (added, conversion) = match &query.format {
        None => {
            query.refuse_without_format()?;
            let JsonText(body) = JsonText::from_request(request, &state).await?;
            let request = CameraRequest::parse(&body)?;
            check_name("/name", request.name())?;
            (add(&state, id, &request).await?, None)
        }
        Some(format) if format.eq_ignore_ascii_case(cameras::USGS) => {
            refuse_other_than_text(request.headers())?;
            let Raw(body) = Raw::from_request(request, &state).await?;
            let request = CameraRequest::Film(query.read_report(&body)?);
            check_name("?name", request.name())?;
            (add(&state, id, &request).await?, None)
        }
        Some(format) => {
            refuse_other_than_text(request.headers())?;
            let Raw(body) = Raw::from_request(request, &state).await?;
            let (name, conversion, answer) = query.read(format, &body)?;
            check_name("?name", &name)?;
            (state.store.add_camera(id, &name, &conversion.camera).await?, Some(answer))
        }
    };
    let (status, camera) = match added {
        Added::New(camera) => (StatusCode::CREATED, camera),
        Added::Same(camera) => (StatusCode::OK, camera),
        Added::Different(camera) => {
            let detail = format!(
                "There is a camera {:?} with other values, id {}; delete it first, or choose another name.",
                camera.name, camera.id
            );
            return Err(Problem::conflict(detail).with_error("/name", "belongs to another camera"));
        }
        Added::TemplateGone => return Err(Problem::conflict("A template of the camera was deleted at this moment.")),
    };
    let location = format!("/api/v1/cameras/{}", camera.id);
    let answer = CameraAnswer::of(camera)?.converted(conversion);
    Ok((status, [(header::LOCATION, location)], axum::Json(answer)).into_response())
}

async fn add(state: &AppState, id: Uuid, request: &CameraRequest) -> Result<Added, Problem> {
    match request {
        CameraRequest::Digital(request) => Ok(state.store.add_camera(id, &request.name, &request.camera()?).await?),
        CameraRequest::Film(request) => {
            let templates = uploaded_templates(&state.store, &request.uploaded_templates()).await?;
            let definition = request.definition(&templates.marks).map_err(|faults| Problem::of_faults(&faults))?;
            let definition = serde_json::to_string(&definition).map_err(|error| Problem::internal(&error))?;
            Ok(state.store.add_film_camera(id, &request.name, &definition, &templates.ids).await?)
        }
    }
}

/// List the cameras
///
/// The newest first.
#[utoipa::path(
    get, path = "/cameras", operation_id = "list_cameras", tag = "cameras", params(PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<CameraAnswer>),
        (status = "default", description = "Any problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<CameraAnswer>>, Problem> {
    let wanted = query.wanted()?;
    let fetched = state.store.cameras(wanted.before, wanted.fetch()).await?;
    let Page { items, next_cursor } = wanted.page(fetched, |camera| camera.id, CameraAnswer::of);
    Ok(axum::Json(Page { items: items.into_iter().collect::<Result<_, _>>()?, next_cursor }))
}

/// Show a camera
#[utoipa::path(
    get, path = "/cameras/{id}", operation_id = "show_camera", tag = "cameras",
    params(("id" = String, Path, description = "The camera's id or name")),
    responses(
        (status = 200, description = "The camera", body = CameraAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(State(state): State<AppState>, Path(id): Path<String>) -> Result<axum::Json<CameraAnswer>, Problem> {
    let camera = state.store.camera(&id).await?.ok_or_else(missing)?;
    Ok(axum::Json(CameraAnswer::of(camera)?))
}

/// Delete a camera
///
/// Not while an orientation refers to it.
#[utoipa::path(
    delete, path = "/cameras/{id}", operation_id = "delete_camera", tag = "cameras",
    params(("id" = String, Path, description = "The camera's id or name")),
    responses(
        (status = 204, description = "Deleted"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "An orientation refers to it", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(id): Path<String>) -> Result<StatusCode, Problem> {
    match state.store.remove_camera(&id).await? {
        Removed::Gone => Ok(StatusCode::NO_CONTENT),
        Removed::Missing => Err(missing()),
        Removed::InUse => Err(Problem::conflict("Orientations refer to this camera; it must stay.")),
    }
}

fn missing() -> Problem {
    Problem::not_found("There is no camera with this id or name.")
}
