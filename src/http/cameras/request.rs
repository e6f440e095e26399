//! What a client says of a camera, digital or film.

use std::collections::BTreeMap;

use serde::Serialize;
use serde::de::IgnoredAny;
use utoipa::ToSchema;

use super::digital::DigitalCameraRequest;
use crate::http::extract::parse_json;
use crate::http::problem::Problem;
use crate::jobs::film_camera::FilmCameraRequest;

/// A camera: digital, or for film.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[serde(untagged)]
#[allow(clippy::large_enum_variant, reason = "a camera is small enough to be copied, and there are few at a time")]
pub enum CameraRequest {
    /// A digital camera.
    Digital(DigitalCameraRequest),
    /// A film camera with fiducial marks.
    Film(FilmCameraRequest),
}

const DIGITAL: [&str; 3] = ["image_size_px", "principal_distance_px", "principal_point_px"];
const FILM: [&str; 8] = [
    "principal_distance_mm",
    "principal_point_mm",
    "symmetry_point_mm",
    "format_mm",
    "fiducials",
    "fiducial_distances",
    "asymmetric_feature",
    "data_strip",
];

impl CameraRequest {
    /// Reads JSON, strictly. Which kind of camera it is, most of its fields say.
    ///
    /// # Errors
    /// 400 where it is not JSON, 422 with the pointers of fields that are at fault.
    pub fn parse(body: &[u8]) -> Result<Self, Problem> {
        let keys: BTreeMap<String, IgnoredAny> = parse_json(body)?;
        let given = |names: &[&'static str]| -> Vec<&'static str> {
            names.iter().filter(|name| keys.contains_key(**name)).copied().collect()
        };
        let (digital, film) = (given(&DIGITAL), given(&FILM));
        let is_film = film.len() >= digital.len().max(1);
        let foreign = if is_film { &digital } else { &film };
        if !foreign.is_empty() {
            return Err(mixed(foreign, is_film));
        }
        if is_film { parse_json(body).map(Self::Film) } else { parse_json(body).map(Self::Digital) }
    }

    /// The name that it is to have.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Digital(request) => &request.name,
            Self::Film(request) => &request.name,
        }
    }
}

fn mixed(foreign: &[&str], is_film: bool) -> Problem {
    let explain = |name: &str| match (is_film, name) {
        (true, "image_size_px") => String::from(
            "a film camera has no image_size_px: scans differ in size; the size of the image on the film is format_mm",
        ),
        (true, _) => format!("{name} belongs to a digital camera; a film camera gives millimetres in the plate"),
        (false, _) => format!(
            "{name} belongs to a film camera; give either a film camera with principal_distance_mm, principal_point_mm \
             and fiducials, or a digital camera with image_size_px, principal_distance_px and principal_point_px"
        ),
    };
    let problem = Problem::invalid(foreign.first().map(|name| explain(name)).unwrap_or_default());
    foreign.iter().fold(problem, |problem, name| problem.with_error(format!("/{name}"), explain(name)))
}
