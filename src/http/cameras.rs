//! Cameras.

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use chrono::{DateTime, Utc};
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::extract::{Json, Path, Query};
use super::idempotency::NewId;
use super::page::{Page, PageQuery};
use super::problem::Problem;
use super::state::AppState;
use crate::geometry::{Brown, Camera, CameraError};
use crate::store::cameras::{Added, NamedCamera, Removed};

const NAME_MAX_CHARACTERS: usize = 200;

/// The routes of the cameras.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list, create)).routes(routes!(read, remove))
}

/// A camera with its interior orientation.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraRequest {
    /// Unique; 1 to 200 characters. Images can be oriented with the camera by this name.
    #[schema(example = "canon-sx260", min_length = 1, max_length = 200)]
    name: String,
    /// Columns and rows of its images.
    #[schema(example = json!([4000, 3000]), min_items = 2, max_items = 2)]
    image_size_px: [u32; 2],
    /// Distance of the projection centre from the image.
    #[schema(example = 2890.0, value_type = f64, exclusive_minimum = 0.0)]
    principal_distance_px: Option<f64>,
    /// Foot of the perpendicular from the projection centre, x to the right and y down from the corner of the top-left
    /// pixel.
    #[schema(example = json!([2000.0, 1500.0]), value_type = Vec<f64>, min_items = 2, max_items = 2)]
    principal_point_px: Option<[f64; 2]>,
    /// Lens distortion; left out, there is none.
    distortion: Option<Distortion>,
    #[schema(ignore)]
    principal_distance_mm: Option<serde::de::IgnoredAny>,
    #[schema(ignore)]
    principal_point_mm: Option<serde::de::IgnoredAny>,
    #[schema(ignore)]
    fiducials: Option<serde::de::IgnoredAny>,
}

/// A model of lens distortion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum DistortionModel {
    /// Brown's radial and tangential polynomials with affine terms.
    Brown,
}

/// Brown's distortion: with ideal x = X/Z, y = Y/Z (x right, y down, z forward) and r² = x² + y²,
/// x_d = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²),
/// y_d = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y,
/// u = u_0 + c x_d + b1 x_d + b2 y_d, v = v_0 + c y_d.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Distortion {
    /// The model that the coefficients belong to.
    model: DistortionModel,
    /// Radial coefficient of r².
    #[serde(default)]
    k1: f64,
    /// Radial coefficient of r⁴.
    #[serde(default)]
    k2: f64,
    /// Radial coefficient of r⁶.
    #[serde(default)]
    k3: f64,
    /// Tangential coefficient that goes with 2xy in x.
    #[serde(default)]
    p1: f64,
    /// Tangential coefficient that goes with r² + 2x² in x.
    #[serde(default)]
    p2: f64,
    /// Difference of the principal distances in x and y.
    #[serde(default)]
    b1_px: f64,
    /// Shear.
    #[serde(default)]
    b2_px: f64,
}

/// A camera.
#[derive(Debug, Serialize, ToSchema)]
struct CameraAnswer {
    /// UUIDv7.
    id: Uuid,
    /// Unique.
    name: String,
    /// Columns and rows of its images.
    #[schema(min_items = 2, max_items = 2)]
    image_size_px: [u32; 2],
    /// Distance of the projection centre from the image.
    principal_distance_px: f64,
    /// Foot of the perpendicular from the projection centre.
    #[schema(min_items = 2, max_items = 2)]
    principal_point_px: [f64; 2],
    /// Lens distortion.
    distortion: Distortion,
    /// When it was first given.
    created_at: DateTime<Utc>,
}

impl From<NamedCamera> for CameraAnswer {
    fn from(named: NamedCamera) -> Self {
        let NamedCamera { id, name, camera, created_at } = named;
        let Brown { k1, k2, k3, p1, p2, b1_px, b2_px } = camera.distortion().copied().unwrap_or_default();
        Self {
            id,
            name,
            image_size_px: [camera.width_px, camera.height_px],
            principal_distance_px: camera.principal_distance_px,
            principal_point_px: camera.principal_point_px().into(),
            distortion: Distortion { model: DistortionModel::Brown, k1, k2, k3, p1, p2, b1_px, b2_px },
            created_at,
        }
    }
}

impl CameraRequest {
    /// The camera, after checking that it makes sense.
    ///
    /// # Errors
    /// 422 with the pointer of the field that is at fault.
    pub fn camera(&self) -> Result<Camera, Problem> {
        let film = [
            ("/principal_distance_mm", self.principal_distance_mm.is_some()),
            ("/principal_point_mm", self.principal_point_mm.is_some()),
            ("/fiducials", self.fiducials.is_some()),
        ];
        if let Some((pointer, _)) = film.into_iter().find(|(_, given)| *given) {
            let detail = "film cameras with fiducials are not supported by this version; give a digital camera with \
                          principal_distance_px and principal_point_px";
            return Err(Problem::invalid_field(pointer, detail));
        }
        let missing = |name: &str| Problem::invalid_field(format!("/{name}"), format!("{name} is missing"));
        let principal_distance_px = self.principal_distance_px.ok_or_else(|| missing("principal_distance_px"))?;
        let principal_point_px = self.principal_point_px.ok_or_else(|| missing("principal_point_px"))?;
        let distortion = self.distortion.map_or_else(Brown::default, |given| {
            let Distortion { model: DistortionModel::Brown, k1, k2, k3, p1, p2, b1_px, b2_px } = given;
            Brown { k1, k2, k3, p1, p2, b1_px, b2_px }
        });
        Camera::new(self.image_size_px, principal_distance_px, Vector2::from(principal_point_px), distortion)
            .map_err(|error| Problem::invalid_field(pointer(&error), error.to_string()))
    }
}

fn pointer(error: &CameraError) -> String {
    match error {
        CameraError::EmptyFrame { .. } => String::from("/image_size_px"),
        CameraError::PrincipalDistance { .. } => String::from("/principal_distance_px"),
        CameraError::NotFinite { name: "principal_point_px" } => String::from("/principal_point_px"),
        CameraError::NotFinite { name } => format!("/distortion/{name}"),
        _ => String::from("/distortion"),
    }
}

fn check_name(name: &str) -> Result<(), Problem> {
    let refuse = |detail: &str| Err(Problem::invalid_field("/name", detail));
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
/// The same name with the same content again is answered with 200 and the camera that is there.
#[utoipa::path(
    post, path = "/cameras", operation_id = "add_camera", tag = "cameras", request_body = CameraRequest,
    params(("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, description = "Makes the request safe to repeat")),
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
    Json(request): Json<CameraRequest>,
) -> Result<Response, Problem> {
    check_name(&request.name)?;
    let camera = request.camera()?;
    let (status, camera) = match state.store.add_camera(id, &request.name, &camera).await? {
        Added::New(camera) => (StatusCode::CREATED, camera),
        Added::Same(camera) => (StatusCode::OK, camera),
        Added::Different(camera) => {
            let detail = format!(
                "There is a camera {:?} with other values, id {}; delete it first, or choose another name.",
                camera.name, camera.id
            );
            return Err(Problem::conflict(detail).with_error("/name", "belongs to another camera"));
        }
    };
    let location = format!("/api/v1/cameras/{}", camera.id);
    Ok((status, [(header::LOCATION, location)], axum::Json(CameraAnswer::from(camera))).into_response())
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
    Ok(axum::Json(wanted.page(fetched, |camera| camera.id, CameraAnswer::from)))
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
    Ok(axum::Json(camera.into()))
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
