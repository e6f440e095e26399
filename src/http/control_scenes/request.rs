//! What is said of a scene, checked against its picture.

use std::path::Path;

use serde::Deserialize;
use sha2::{Digest as _, Sha256};
use utoipa::ToSchema;

use crate::control::SceneContent;
use crate::geometry::Crs;
use crate::http::cameras::check_name;
use crate::http::images::imagery_problem;
use crate::http::problem::Problem;
use crate::imagery::{ImageryError, Limits};
use crate::jobs::request::{FieldFault, place_of};
use crate::jobs::scenes::{SceneError, ScenePicture};
use crate::report::{Position, Warning};

/// In less than this nothing is found again.
const LEAST_SIDE_PX: u32 = 32;
/// With coarser pixels a scene is no point on the ground.
const GSD_BELOW_M: f64 = 10.0;
const SIGMA_AZIMUTH_DEG: f64 = 5.0;
/// Coordinates worse than this cannot orient anything.
const LARGEST_SIGMA_M: f64 = 100.0;

/// What is said of the picture of a scene.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ControlSceneRequest {
    /// Unique among the scenes, 1 to 200 characters. A scene of the same name is replaced.
    #[schema(example = "church-square", min_length = 1, max_length = 200)]
    pub name: String,
    /// Ground sample distance of the picture, above 0 and below 10 m.
    #[schema(example = 0.02, exclusive_minimum = 0, exclusive_maximum = 10)]
    pub gsd_m: f64,
    /// Where the upper edge of the picture points to, clockwise from true north: 0 if north is up. Of a piece of an
    /// ortho-photo it is minus the convergence of the meridians, if that matters beside `sigma_azimuth_deg`.
    #[schema(example = 0.0, minimum = -360, maximum = 360)]
    pub azimuth_of_image_up_deg: f64,
    /// Its standard deviation, above 0 and at most 180; default: 5.
    #[serde(default)]
    #[schema(example = 5.0, exclusive_minimum = 0, maximum = 180)]
    pub sigma_azimuth_deg: Option<f64>,
    /// The reference point in the picture, x to the right and y down from the corner of the top-left pixel.
    #[schema(example = json!([212.5, 198.0]), value_type = Vec<f64>, min_items = 2, max_items = 2)]
    pub reference_px: [f64; 2],
    /// The reference point on the ground.
    pub reference: Position,
    /// Standard deviation of its coordinates, above 0 and at most 100 m.
    #[schema(example = 0.05, exclusive_minimum = 0, maximum = 100)]
    pub sigma_m: f64,
}

/// A scene in which everything is checked.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedScene {
    /// What it is.
    pub content: SceneContent,
    /// The grey values of its picture, row by row.
    pub grey: Vec<f32>,
    /// What the client should know besides.
    pub warnings: Vec<Warning>,
}

impl ControlSceneRequest {
    /// Checks everything, and reads the file of the picture. `folder` is one where it may stand for a moment.
    ///
    /// # Errors
    /// [`Problem`] with the pointers of all fields that are at fault, or what is wrong with the picture.
    pub fn check(&self, file: &[u8], folder: &Path, limits: &Limits) -> Result<CheckedScene, Problem> {
        check_name("/name", &self.name)?;
        let mut faults = Vec::new();
        self.check_numbers(&mut faults);
        let reference = self.reference(&mut faults);
        let picture = ScenePicture::read(file, folder, limits).map_err(picture_problem)?;
        check_picture(&picture)?;
        self.check_place(picture.size_px, &mut faults);
        let Some((crs, reference_geocentric_m)) = reference.filter(|_| faults.is_empty()) else {
            return Err(Problem::of_faults(&faults));
        };
        let heights_unknown = crs.assumes_ellipsoidal_heights() && self.reference.vertical.is_none();
        let content = SceneContent {
            name: self.name.clone(),
            size_px: picture.size_px,
            gsd_m: self.gsd_m,
            azimuth_of_image_up_deg: self.azimuth_of_image_up_deg,
            sigma_azimuth_deg: self.sigma_azimuth_deg(),
            reference_px: self.reference_px,
            reference_geocentric_m,
            sigma_m: self.sigma_m.hypot(crs.accuracy_m()),
            media_type: picture.format.media_type().to_owned(),
            size_bytes: file.len() as u64,
            sha256: Sha256::digest(file).into(),
        };
        Ok(CheckedScene {
            content,
            grey: picture.grey,
            warnings: Vec::from_iter(heights_unknown.then(|| Warning::vertical_assumed_ellipsoidal(&crs.to_string()))),
        })
    }

    fn sigma_azimuth_deg(&self) -> f64 {
        self.sigma_azimuth_deg.unwrap_or(SIGMA_AZIMUTH_DEG)
    }

    fn check_numbers(&self, faults: &mut Vec<FieldFault>) {
        let (gsd_m, azimuth_deg) = (self.gsd_m, self.azimuth_of_image_up_deg);
        let (sigma_azimuth_deg, sigma_m) = (self.sigma_azimuth_deg(), self.sigma_m);
        if !(gsd_m > 0.0 && gsd_m < GSD_BELOW_M) {
            let detail = format!("{gsd_m} is not above 0 and below {GSD_BELOW_M} m, the ground that a pixel shows");
            faults.push(fault("/gsd_m", detail));
        }
        if !(-360.0..=360.0).contains(&azimuth_deg) {
            let detail = format!("{azimuth_deg} is not from -360 to 360 degrees, clockwise from true north");
            faults.push(fault("/azimuth_of_image_up_deg", detail));
        }
        if !(sigma_azimuth_deg > 0.0 && sigma_azimuth_deg <= 180.0) {
            let detail = format!("{sigma_azimuth_deg} is not above 0 and at most 180 degrees");
            faults.push(fault("/sigma_azimuth_deg", detail));
        }
        if !(sigma_m > 0.0 && sigma_m <= LARGEST_SIGMA_M) {
            let detail = format!("{sigma_m} is not above 0 and at most {LARGEST_SIGMA_M} m");
            faults.push(fault("/sigma_m", detail));
        }
    }

    fn reference(&self, faults: &mut Vec<FieldFault>) -> Option<(Crs, nalgebra::Vector3<f64>)> {
        let crs = match Crs::parse(&self.reference.crs) {
            Ok(crs) => crs,
            Err(error) => {
                faults.push(fault("/reference/crs", error.to_string()));
                return None;
            }
        };
        let undulation_m = self.reference.vertical.map(|vertical| vertical.geoid_undulation_m);
        match crs.geocentric_from_position(self.reference.coordinates, undulation_m) {
            Ok(geocentric_m) => Some((crs, geocentric_m)),
            Err(error) => {
                faults.push(fault(format!("/reference{}", place_of(&error)), error.to_string()));
                None
            }
        }
    }

    fn check_place(&self, size_px @ [width, height]: [u32; 2], faults: &mut Vec<FieldFault>) {
        for (k, (value, side)) in self.reference_px.into_iter().zip(size_px).enumerate() {
            if !(0.0..=f64::from(side)).contains(&value) {
                let detail = format!("{value} is not in the picture, which has {width} x {height} px");
                faults.push(fault(format!("/reference_px/{k}"), detail));
            }
        }
    }
}

fn fault(pointer: impl Into<String>, detail: impl Into<String>) -> FieldFault {
    FieldFault { pointer: pointer.into(), detail: detail.into() }
}

fn check_picture(picture: &ScenePicture) -> Result<(), Problem> {
    let [width, height] = picture.size_px;
    if width.min(height) < LEAST_SIDE_PX {
        let detail = format!(
            "The picture of a scene has {width} x {height} px; it must have at least {LEAST_SIDE_PX} px a side."
        );
        return Err(Problem::invalid(detail));
    }
    let shade = picture.grey.first();
    if picture.grey.iter().all(|grey| Some(grey) == shade) {
        return Err(Problem::invalid("The picture of the scene is of one grey only; it shows nothing."));
    }
    Ok(())
}

fn picture_problem(error: SceneError) -> Problem {
    match error {
        // this limit is one of scenes, whatever the limits of images are called
        SceneError::Imagery(ImageryError::OverLimit { what: "pixels", found, limit, .. }) => {
            Problem::too_large(format!(
                "The picture of a scene has {found} pixels; it may have {limit} (set by `scene_max_pixels`). Cut out what \
                 matters."
            ))
        }
        SceneError::Imagery(error) => imagery_problem(&error),
        SceneError::Picture(error) => Problem::invalid(format!("The picture of the scene is damaged: {error}")),
        error => Problem::internal(&error),
    }
}
