//! Interior orientations of scanned film: asked for, kept, looked at.

mod answer;
mod pictures;

use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use tokio::sync::OwnedSemaphorePermit;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::extract::{Json, Path, Query};
use super::idempotency::NewId;
use super::page::{Page, Wanted};
use super::problem::Problem;
use super::state::AppState;
use crate::imagery::ImageryError;
use crate::interior::FilmCamera;
use crate::jobs::camera_model::camera_model;
use crate::jobs::interior::{self, InteriorError, InteriorRequest};
use crate::jobs::request::CameraModel;
use crate::store::images::Image;
use crate::store::interior_orientations::{Filter, InteriorOrientation, NewInteriorOrientation};
use answer::InteriorOrientationAnswer;

/// How long a request waits for its turn: each takes a second or less.
const PATIENCE: Duration = Duration::from_secs(10);
/// When to come back after that.
const RETRY_AFTER_S: u32 = 5;

/// The routes of the interior orientations.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(list, create))
        .routes(routes!(read, remove))
        .routes(routes!(pictures::residuals))
        .routes(routes!(pictures::mark))
}

/// Which interior orientations are wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ListQuery {
    /// Only of this image.
    image: Option<Uuid>,
    /// Only with the camera of this id or name.
    camera: Option<String>,
    /// `green`, `yellow` or `red`.
    verdict: Option<String>,
    /// Items on a page, from 1 to 200; 50 if left out.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    #[param(min_length = 1)]
    cursor: Option<String>,
}

impl ListQuery {
    fn filter(self, before: Option<Uuid>) -> Result<Filter, Problem> {
        if let Some(name) = self.verdict.as_ref().filter(|name| !["green", "yellow", "red"].contains(&name.as_str())) {
            let detail = format!("verdict is {name:?}; it must be green, yellow or red");
            return Err(Problem::invalid_field("?verdict", detail));
        }
        Ok(Filter { image_id: self.image, camera: self.camera, verdict: self.verdict, before })
    }
}

/// Find the interior orientation of a scan
///
/// The fiducial marks of the film camera are searched in the scan, measured, and brought to their calibrated positions;
/// the answer comes at once. A film whose marks cannot be found has the verdict `red` with its reasons, which is a result
/// too. Scans of film need no such request before they are oriented.
#[utoipa::path(
    post, path = "/interior-orientations", operation_id = "orient_interior", tag = "interior orientations",
    request_body = InteriorRequest,
    params(("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, description = "Makes the request safe to repeat")),
    responses(
        (status = 201, description = "Found out, whatever the verdict", body = InteriorOrientationAnswer),
        (status = 422, description = "A field makes no sense, the camera is a digital one, or the image cannot be read", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too many are waiting", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(
    State(state): State<AppState>,
    NewId(id): NewId,
    Json(request): Json<InteriorRequest>,
) -> Result<Response, Problem> {
    let image = image(&state, &request.image).await?;
    let (camera_id, camera) = film_camera(&state, &request.camera).await?;
    let (path, limits) = (state.store.image_file(&image.sha256).await?, state.configuration.image_limits());
    let work = move || interior::oriented(&path, &limits, &camera, &request);
    let (prepared, result) = at_a_time(&state, work).await??;
    let json = |value: serde_json::Result<String>| value.map_err(|error| Problem::internal(&error));
    let new = NewInteriorOrientation {
        id,
        image_id: image.id,
        camera_id,
        prepared: json(serde_json::to_string(&prepared))?,
        verdict: result.diagnosis.verdict.clone(),
        result: json(serde_json::to_string(&result))?,
    };
    let kept = state.store.add_interior_orientation(&new).await?;
    let location = format!("/api/v1/interior-orientations/{id}");
    let answer = InteriorOrientationAnswer::new(kept)?;
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], axum::Json(answer)).into_response())
}

async fn image(state: &AppState, id: &str) -> Result<Image, Problem> {
    let image = match Uuid::try_parse(id) {
        Ok(id) => state.store.image(id).await?,
        Err(_) => None,
    };
    image.ok_or_else(|| Problem::invalid_field("/image", "there is no image with this id"))
}

/// The film camera with this id or name, and its id.
async fn film_camera(state: &AppState, id_or_name: &str) -> Result<(Uuid, Arc<FilmCamera>), Problem> {
    let missing = || Problem::invalid_field("/camera", "there is no camera with this id or name");
    let id = state.store.camera(id_or_name).await?.ok_or_else(missing)?.id;
    let model = camera_model(&state.store, &id.to_string()).await.map_err(|error| Problem::internal(&error))?;
    match model.ok_or_else(missing)? {
        CameraModel::Film(camera) => Ok((id, camera)),
        CameraModel::Digital(_) => {
            let detail = "this is a digital camera, whose interior orientation is known; a scan needs a film camera, with \
                          principal_distance_mm and fiducials";
            Err(Problem::invalid_field("/camera", detail))
        }
    }
}

/// Does work on a scan as soon as few enough others are worked on.
async fn at_a_time<T: Send + 'static>(
    state: &AppState,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Problem> {
    let permit = permitted(state, PATIENCE).await?;
    let work = move || {
        let _permit = permit;
        work()
    };
    tokio::task::spawn_blocking(work).await.map_err(|error| Problem::internal(&error))
}

async fn permitted(state: &AppState, patience: Duration) -> Result<OwnedSemaphorePermit, Problem> {
    match tokio::time::timeout(patience, state.scans.clone().acquire_owned()).await {
        Ok(permit) => permit.map_err(|error| Problem::internal(&error)),
        Err(_) => Err(Problem::unavailable("Too many scans are being worked on; come back later.", RETRY_AFTER_S)),
    }
}

/// List the interior orientations
///
/// The newest first, without their results.
#[utoipa::path(
    get, path = "/interior-orientations", operation_id = "list_interior_orientations", tag = "interior orientations",
    params(ListQuery),
    responses(
        (status = 200, description = "One page", body = Page<InteriorOrientationAnswer>),
        (status = 422, description = "A parameter makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<ListQuery>,
) -> Result<axum::Json<Page<InteriorOrientationAnswer>>, Problem> {
    let wanted = Wanted::new(query.limit, query.cursor.as_deref())?;
    let fetched = state.store.interior_orientations(&query.filter(wanted.before)?, wanted.fetch()).await?;
    let Page { items, next_cursor } = wanted.page(fetched, |row| row.id, InteriorOrientationAnswer::new);
    let items = items.into_iter().collect::<Result<_, _>>()?;
    Ok(axum::Json(Page { items, next_cursor }))
}

/// Show an interior orientation
///
/// With its result.
#[utoipa::path(
    get, path = "/interior-orientations/{id}", operation_id = "show_interior_orientation", tag = "interior orientations",
    params(("id" = Uuid, Path, description = "The interior orientation's id")),
    responses(
        (status = 200, description = "The interior orientation", body = InteriorOrientationAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
) -> Result<axum::Json<InteriorOrientationAnswer>, Problem> {
    Ok(axum::Json(InteriorOrientationAnswer::new(found(&state, id).await?)?))
}

/// Delete an interior orientation
#[utoipa::path(
    delete, path = "/interior-orientations/{id}", operation_id = "delete_interior_orientation",
    tag = "interior orientations",
    params(("id" = Uuid, Path, description = "The interior orientation's id")),
    responses(
        (status = 204, description = "Deleted"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<StatusCode, Problem> {
    if state.store.remove_interior_orientation(id).await? { Ok(StatusCode::NO_CONTENT) } else { Err(missing()) }
}

async fn found(state: &AppState, id: Uuid) -> Result<InteriorOrientation, Problem> {
    state.store.interior_orientation(id).await?.ok_or_else(missing)
}

fn missing() -> Problem {
    Problem::not_found("There is no interior orientation with this id.")
}

impl From<InteriorError> for Problem {
    fn from(error: InteriorError) -> Self {
        match error {
            InteriorError::Imagery(ImageryError::Read { source }) => Self::internal(&source),
            InteriorError::Request(faults) => Self::of_faults(&faults),
            InteriorError::Imagery(_) | InteriorError::Picture(_) => Self::invalid_field("/image", error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configuration::Configuration;

    #[tokio::test]
    async fn who_comes_when_too_many_are_worked_on_is_asked_to_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let configuration = Configuration { workers: 1, ..Configuration::default() };
        let state = AppState::new(crate::store::scratch::store(folder.path()).await, configuration);
        let permit = permitted(&state, Duration::ZERO).await.unwrap();
        let refused = permitted(&state, Duration::from_millis(20)).await.unwrap_err();
        assert_eq!(refused.status(), StatusCode::SERVICE_UNAVAILABLE);
        drop(permit);
        assert_eq!(at_a_time(&state, || 7).await.unwrap(), 7);
    }
}
