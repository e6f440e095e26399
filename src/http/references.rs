//! Reference orientations: where images were truly taken, to learn from and to be judged by.

use std::borrow::Cow;

use axum::extract::State;
use axum::http::StatusCode;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::extract::{Json, Path, Query, pointer};
use super::page::{Page, PageQuery};
use super::problem::Problem;
use super::state::AppState;
use crate::geometry::{Crs, LocalFrame, rotation};
use crate::report::Position;
use crate::store::references::{ReferenceOrientation, given_now};

/// References in one request.
const MOST_REFERENCES: usize = 1000;
const LONGEST_AREA: usize = 200;
/// The area of references that name none.
const DEFAULT_AREA: &str = "history";
/// Rows of a rotation matrix must be perpendicular and of length 1 to this: three digits are enough to know that it is one.
const LARGEST_DEFECT: f64 = 2e-3;
const MOST_ITERATIONS: usize = 100;

/// The routes of the references.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list, create)).routes(routes!(remove))
}

/// Reference orientations.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct ReferencesRequest {
    /// One for each image; a bad one never loses the others.
    #[schema(max_items = 1000, value_type = Vec<ReferenceRequest>)]
    references: Vec<serde_json::Value>,
}

/// The true orientation of an image, as a bundle block adjustment gives it.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct ReferenceRequest {
    /// The image's id.
    image: Uuid,
    /// The block or flight: what is kept apart when classifiers are compared. Default: `history`.
    area: Option<String>,
    /// Where the camera stood.
    projection_centre: Position,
    /// How it was turned.
    rotation: RotationRequest,
}

/// A rotation: the matrix, or the three angles, or both, as in a result.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct RotationRequest {
    /// Whose axes, a CRS: a topocentric one itself; a map grid's east, north and up at the projection centre; of a
    /// geographic one the local east, north, up frame there. Default: the CRS of the projection centre.
    frame: Option<String>,
    /// Rows of R: object space to the camera frame (x right, y up, z backwards).
    #[schema(value_type = Option<Vec<Vec<f64>>>)]
    rotation_matrix: Option<[[f64; 3]; 3]>,
    /// With `phi_deg` and `kappa_deg`: R = (R_x(omega) R_y(phi) R_z(kappa))^T.
    omega_deg: Option<f64>,
    /// Angle about the y axis.
    phi_deg: Option<f64>,
    /// Angle about the z axis.
    kappa_deg: Option<f64>,
}

/// What became of the references.
#[derive(Debug, Serialize, ToSchema)]
struct ReferencesAnswer {
    /// Images that had none before.
    stored: usize,
    /// Images whose reference was replaced.
    updated: usize,
    /// What was refused.
    rejected: Vec<RejectedReference>,
}

/// A reference that was refused.
#[derive(Debug, Serialize, ToSchema)]
struct RejectedReference {
    /// Its place in the request, from 0.
    index: usize,
    /// The field that is at fault.
    pointer: String,
    /// What is wrong with it and what would be right.
    detail: String,
}

/// A reference as it is kept.
#[derive(Debug, Serialize, ToSchema)]
struct ReferenceAnswer {
    /// The image's id.
    image: Uuid,
    /// The block or flight.
    area: String,
    /// Where the camera stood: longitude, latitude in degrees and ellipsoidal height.
    projection_centre: Position,
    /// Rows of R, from the local east, north, up frame there to the camera frame.
    #[schema(value_type = Vec<Vec<f64>>)]
    rotation_matrix: [[f64; 3]; 3],
    /// When it was given.
    updated_at: chrono::DateTime<chrono::Utc>,
}

/// A field and what is wrong with it.
type Fault = (Cow<'static, str>, String);

/// Give reference orientations
///
/// Where images were truly taken, as a bundle block adjustment of many images gives it. The orientations of these images
/// become labelled: `POST /classifiers` learns from them. Given again, a reference replaces the one before.
#[utoipa::path(
    post, path = "/references", operation_id = "give_references", tag = "diagnosis", request_body = ReferencesRequest,
    responses(
        (status = 200, description = "What was stored, updated and rejected", body = ReferencesAnswer),
        (status = 422, description = "Not a list of references", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(
    State(state): State<AppState>,
    Json(request): Json<ReferencesRequest>,
) -> Result<axum::Json<ReferencesAnswer>, Problem> {
    if request.references.len() > MOST_REFERENCES {
        let detail =
            format!("there are {} references; send at most {MOST_REFERENCES} at a time", request.references.len());
        return Err(Problem::invalid_field("/references", detail));
    }
    let (mut good, mut rejected) = (Vec::new(), Vec::new());
    for (index, given) in request.references.into_iter().enumerate() {
        let checked = match checked(given) {
            Ok(reference) if state.store.image(reference.image_id).await?.is_some() => Ok(reference),
            Ok(_) => Err(("/image".into(), "there is no image with this id; upload it first".to_owned())),
            Err(fault) => Err(fault),
        };
        match checked {
            Ok(reference) => good.push(reference),
            Err((pointer, detail)) => rejected.push(RejectedReference { index, pointer: pointer.into_owned(), detail }),
        }
    }
    let stored = state.store.put_references(&good).await?;
    tracing::info!(stored = stored.added, updated = stored.updated, rejected = rejected.len(), "references");
    Ok(axum::Json(ReferencesAnswer { stored: stored.added, updated: stored.updated, rejected }))
}

fn checked(given: serde_json::Value) -> Result<ReferenceOrientation, Fault> {
    let request: ReferenceRequest = serde_path_to_error::deserialize(given)
        .map_err(|error| (pointer(error.path()).into(), error.into_inner().to_string()))?;
    let area = request.area.unwrap_or_else(|| DEFAULT_AREA.to_owned());
    if area.trim().is_empty() || area.chars().count() > LONGEST_AREA || area.chars().any(char::is_control) {
        return Err((
            "/area".into(),
            format!("it must have 1 to {LONGEST_AREA} characters, none of them a control character"),
        ));
    }
    let centre = &request.projection_centre;
    let of_crs = |error: crate::geometry::CrsError| (Cow::from("/projection_centre"), error.to_string());
    let crs = Crs::parse(&centre.crs).map_err(of_crs)?;
    let undulation_m = centre.vertical.map(|vertical| vertical.geoid_undulation_m);
    let centre_m = crs.geocentric_from_position(centre.coordinates, undulation_m).map_err(of_crs)?;
    let of_frame = |error: crate::geometry::CrsError| (Cow::from("/rotation/frame"), error.to_string());
    let frame = request.rotation.frame.as_deref().map(Crs::parse).transpose().map_err(of_frame)?.unwrap_or(crs);
    let frame_from_geocentric = frame.axes_from_geocentric(centre_m).map_err(of_frame)?;
    let camera_from_geocentric = request.rotation.camera_from_frame()? * frame_from_geocentric;
    let r = camera_from_geocentric.matrix();
    let rows = std::array::from_fn(|k| r[(k / 3, k % 3)]);
    Ok(given_now(request.image, area, centre_m.into(), rows))
}

impl RotationRequest {
    fn camera_from_frame(&self) -> Result<Rotation3<f64>, Fault> {
        let of_matrix = self.rotation_matrix.as_ref().map(rotation_of).transpose()?;
        let of_angles = match (self.omega_deg, self.phi_deg, self.kappa_deg) {
            (None, None, None) => None,
            (Some(omega), Some(phi), Some(kappa)) => {
                if ![omega, phi, kappa].iter().all(|angle| angle.abs() <= 360.0) {
                    return Err(("/rotation".into(), "the angles must be from -360 to 360 degrees".to_owned()));
                }
                Some(rotation::camera_from_object(omega.to_radians(), phi.to_radians(), kappa.to_radians()))
            }
            _ => return Err(("/rotation".into(), "omega_deg, phi_deg and kappa_deg belong together".to_owned())),
        };
        match (of_matrix, of_angles) {
            (Some(matrix), Some(angles)) if matrix.angle_to(&angles) > LARGEST_DEFECT => {
                Err(("/rotation".into(), "rotation_matrix and the angles contradict each other".to_owned()))
            }
            (Some(rotation), _) | (None, Some(rotation)) => Ok(rotation),
            (None, None) => {
                Err(("/rotation".into(), "it needs rotation_matrix, or omega_deg, phi_deg and kappa_deg".to_owned()))
            }
        }
    }
}

/// The rotation next to a matrix that is nearly one.
fn rotation_of(rows: &[[f64; 3]; 3]) -> Result<Rotation3<f64>, Fault> {
    let matrix = Matrix3::from_row_slice(rows.as_flattened());
    let defect = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    if !(defect <= LARGEST_DEFECT && matrix.determinant() > 0.0) {
        let detail = "it is no rotation: its rows must be perpendicular, of length 1 and right-handed";
        return Err(("/rotation/rotation_matrix".into(), detail.to_owned()));
    }
    Ok(Rotation3::from_matrix_eps(&matrix, 1e-12, MOST_ITERATIONS, Rotation3::from_matrix_unchecked(matrix)))
}

/// List the reference orientations
#[utoipa::path(
    get, path = "/references", operation_id = "list_references", tag = "diagnosis", params(PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<ReferenceAnswer>),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<ReferenceAnswer>>, Problem> {
    let wanted = query.wanted()?;
    let fetched = state.store.references(wanted.before, wanted.fetch()).await?;
    let Page { items, next_cursor } = wanted.page(fetched, |reference| reference.image_id, answer);
    let items = items.into_iter().collect::<Result<_, _>>().map_err(|error| Problem::internal(&error))?;
    Ok(axum::Json(Page { items, next_cursor }))
}

fn answer(reference: ReferenceOrientation) -> Result<ReferenceAnswer, crate::geometry::CrsError> {
    const CRS: &str = "EPSG:4979";
    let centre_m = Vector3::from(reference.centre_geocentric_m);
    let coordinates = Crs::parse(CRS)?.position_from_geocentric(centre_m, None)?;
    let camera_from_geocentric = Matrix3::from_row_slice(&reference.camera_from_geocentric);
    let r = camera_from_geocentric * LocalFrame::about(centre_m).local_from_geocentric().inverse().matrix();
    Ok(ReferenceAnswer {
        image: reference.image_id,
        area: reference.area,
        projection_centre: Position { crs: CRS.to_owned(), coordinates, vertical: None },
        rotation_matrix: std::array::from_fn(|row| std::array::from_fn(|column| r[(row, column)])),
        updated_at: reference.updated_at,
    })
}

/// Remove a reference orientation
#[utoipa::path(
    delete, path = "/references/{image}", operation_id = "remove_reference", tag = "diagnosis",
    params(("image" = Uuid, Path, description = "The image's id")),
    responses(
        (status = 204, description = "Removed"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn remove(State(state): State<AppState>, Path(image): Path<Uuid>) -> Result<StatusCode, Problem> {
    if state.store.remove_reference(image).await? {
        return Ok(StatusCode::NO_CONTENT);
    }
    Err(Problem::not_found("There is no reference of this image."))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn reference(rotation: &serde_json::Value) -> serde_json::Value {
        json!({
            "image": "01a20225-f91a-7133-9892-18bd6449110e",
            "projection_centre": {"crs": "EPSG:25832", "coordinates": [365000.0, 5621000.0, 1200.0]},
            "rotation": rotation,
        })
    }

    #[test]
    fn matrix_and_angles_say_the_same_in_the_axes_of_the_grid() {
        let angles = checked(reference(&json!({"omega_deg": 1.5, "phi_deg": -2.0, "kappa_deg": 70.0}))).unwrap();
        let r = rotation::camera_from_object(1.5_f64.to_radians(), -(2.0_f64.to_radians()), 70_f64.to_radians());
        let rows: Vec<Vec<f64>> = (0..3).map(|row| (0..3).map(|column| r.matrix()[(row, column)]).collect()).collect();
        let matrix = checked(reference(&json!({"rotation_matrix": rows}))).unwrap();
        for (a, b) in angles.camera_from_geocentric.iter().zip(matrix.camera_from_geocentric) {
            assert!((a - b).abs() < 1e-9);
        }
        // the axes of the local frame are turned against those of the grid by the convergence
        let local = json!({"frame": "EPSG:4979", "omega_deg": 1.5, "phi_deg": -2.0, "kappa_deg": 70.0});
        let local = checked(reference(&local)).unwrap();
        let difference = |k: usize| (local.camera_from_geocentric[k] - angles.camera_from_geocentric[k]).abs();
        let most = (0..9).map(difference).fold(0.0, f64::max);
        assert!(most > 0.01 && most < 0.05, "{most}");
    }

    #[test]
    fn every_fault_is_named() {
        let fault = |change: &dyn Fn(&mut serde_json::Value)| {
            let mut given = reference(&json!({"omega_deg": 0, "phi_deg": 0, "kappa_deg": 0}));
            change(&mut given);
            checked(given).unwrap_err().0
        };
        assert_eq!(fault(&|v| v["projection_centre"]["crs"] = "EPSG:1".into()), "/projection_centre");
        assert_eq!(fault(&|v| v["area"] = "".into()), "/area");
        assert_eq!(fault(&|v| v["rotation"]["frame"] = "nowhere".into()), "/rotation/frame");
        assert_eq!(fault(&|v| v["rotation"]["kappa_deg"] = json!(null)), "/rotation");
        assert_eq!(fault(&|v| v["rotation"]["kappa_deg"] = 400.into()), "/rotation");
        let mirrored = json!({"rotation_matrix": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]});
        assert_eq!(fault(&|v| v["rotation"] = mirrored.clone()), "/rotation/rotation_matrix");
        let stretched = json!({"rotation_matrix": [[1.1, 0, 0], [0, 1, 0], [0, 0, 1]]});
        assert_eq!(fault(&|v| v["rotation"] = stretched.clone()), "/rotation/rotation_matrix");
        assert_eq!(fault(&|v| v["sigma"] = 1.into()), "/sigma");
        assert_eq!(fault(&|v| v["rotation"]["phi_deg"] = "two".into()), "/rotation/phi_deg");
    }
}
