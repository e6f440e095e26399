//! What the client asks for (contract, `POST /orientations`), and what becomes of it once everything in it is checked.

mod approximation;
mod policy;
mod scan;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use chrono::{NaiveDate, Utc};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use approximation::{ApproximationRequest, NUMBERS_ASSUMED, place_of};
pub use policy::{CostsRequest, PolicyGiven};
pub use scan::{Reading, ScanRequest, TransformationKind};

use super::active::NamedClassifier;
use crate::control::{Kinds, Wanted};
use crate::geometry::{Camera, Crs, CrsError, ExteriorOrientation, LocalFrame, rotation};
use crate::imagery::{ExifHeading, ExifPosition, Probe};
use crate::interior::{self, FilmCamera};
use crate::orientation::ControlPoint;
use crate::pipeline::{Approximation, FilmTask, Judge, Task, Tolerance};
use crate::report::{ApproximationUsed, ClassifierUsed, Output, Vertical, Warning};
use crate::store::orientations::Priority;

/// The tolerance if the request does not say.
const TOLERANCE_GSD: f64 = 10.0;
const LARGEST_TOLERANCE: f64 = 10_000.0;

/// An image to orient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct OrientationRequest {
    /// The image's id.
    pub image: String,
    /// The camera's id or name.
    #[schema(example = "canon-sx260")]
    pub camera: String,
    /// What is known of the orientation beforehand; what is left out comes from the image file or from the defaults.
    #[serde(default)]
    pub approximation: ApproximationRequest,
    /// The largest planimetric error on the ground that is acceptable, in ground sample distances. Default: 10.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = 10)]
    pub tolerance_gsd: Option<f64>,
    /// The same in metres, instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance_m: Option<f64>,
    /// What decisions cost: the verdict is green where accepting costs less than rejecting. Default: the service's, of
    /// which the paper's are the default (0, 40, 5, 10).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub costs: Option<CostsRequest>,
    /// So many times larger than the classifier says may the odds of being wrong be: 1 trusts it as in the area that it was
    /// trained in. Default: what the classifier has shown in areas that it was not trained on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null))]
    pub caution: Option<f64>,
    /// T_d: green where the score exceeds it, whatever the costs. Scores mean something for one classifier only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null))]
    pub threshold: Option<f64>,
    /// Which control is used; default: whatever there is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub control: Option<ControlChoice>,
    /// The sets of control points that may be used, by their names; default: all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null))]
    pub control_sets: Option<Vec<String>>,
    /// When the image was taken: buildings that did not stand then are not used. Default: as the image file says, else
    /// today.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = "2024-05-17")]
    pub date: Option<NaiveDate>,
    /// How a scan of film is brought to its camera's plate; only with a film camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null))]
    pub interior_orientation: Option<ScanRequest>,
    /// The CRS of the result; default: that of the position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = "EPSG:32614")]
    pub output_crs: Option<String>,
    /// Which of the waiting go first: `low`, `normal` (the default) or `high`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub priority: Option<Priority>,
    /// An `https` address that is told by a `POST` when the orientation has ended, signed after the Standard Webhooks
    /// specification and repeated until it is received, for 24 hours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null))]
    pub webhook: Option<String>,
}

/// Kinds of control.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum ControlChoice {
    /// Roof lines of buildings.
    Lines,
    /// Control scenes: small pictures of the ground.
    Scenes,
    /// Whatever there is of both.
    #[default]
    Both,
}

impl From<ControlChoice> for Kinds {
    fn from(choice: ControlChoice) -> Self {
        Self { lines: choice != ControlChoice::Scenes, scenes: choice != ControlChoice::Lines }
    }
}

/// What is known of the image's file.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImageFacts {
    /// Columns and rows.
    pub size_px: [u32; 2],
    /// Where it was taken.
    pub position: Option<ExifPosition>,
    /// Where its top points.
    pub heading: Option<ExifHeading>,
    /// When it was taken.
    pub taken: Option<NaiveDate>,
}

impl From<&Probe> for ImageFacts {
    fn from(probe: &Probe) -> Self {
        Self {
            size_px: [probe.width_px, probe.height_px],
            position: probe.position,
            heading: probe.heading,
            taken: probe.taken,
        }
    }
}

/// A field of the request that is at fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldFault {
    /// JSON Pointer into the request.
    pub pointer: String,
    /// What is wrong with it and what would be right.
    pub detail: String,
}

/// A request in which everything is checked and nothing is left open; kept with the orientation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Prepared {
    /// The approximate orientation with where it came from.
    pub approximation: ApproximationUsed,
    /// What the verdict is about.
    pub tolerance: ToleranceGiven,
    /// Costs and threshold.
    #[serde(default)]
    pub policy: PolicyGiven,
    /// How a scan of film is brought to its camera's plate.
    #[serde(default)]
    pub scan: ScanRequest,
    /// Which control is used.
    #[serde(default)]
    pub control: ControlChoice,
    /// The sets of control points that may be used; `None`: all.
    #[serde(default)]
    pub control_sets: Option<Vec<String>>,
    /// When the image was taken; `None` in requests from before this was asked.
    #[serde(default)]
    pub date: Option<NaiveDate>,
    /// The CRS of the result.
    pub output_crs: String,
    /// Above which its heights are, if not the ellipsoid.
    pub output_vertical: Option<Vertical>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

/// A tolerance in the unit in which it was given.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToleranceGiven {
    /// Ground sample distances.
    Gsd(f64),
    /// Metres.
    M(f64),
}

/// A camera that is ready for use.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a camera is small enough to be copied, and there are few at a time")]
pub enum CameraModel {
    /// Its images are all alike.
    Digital(Camera),
    /// Every scan has an interior orientation of its own.
    Film(Arc<FilmCamera>),
}

impl CameraModel {
    /// Columns and rows of its images; scans of film differ.
    #[must_use]
    pub fn image_size_px(&self) -> Option<[u32; 2]> {
        match self {
            Self::Digital(camera) => Some([camera.width_px, camera.height_px]),
            Self::Film(_) => None,
        }
    }

    /// How far from its axis it sees, radians.
    #[must_use]
    pub fn half_view_rad(&self) -> f64 {
        match self {
            Self::Digital(camera) => camera.half_view_rad(),
            Self::Film(camera) => camera.film.half_view_rad(),
        }
    }
}

/// What the pipeline needs, in the local frame at the approximate position.
#[derive(Debug, Clone)]
pub struct Work {
    /// East, north, up at the foot of the approximate position on the ellipsoid.
    pub frame: LocalFrame,
    /// The camera.
    pub camera: CameraModel,
    /// The approximate orientation in that frame.
    pub approximation: Approximation,
    /// Buildings that the orientation is checked with; none until they are looked for.
    pub check: Arc<[ControlPoint]>,
    /// What the verdict is about.
    pub tolerance: Tolerance,
    /// Who decides.
    pub judge: Judge,
    /// Where the result is to be given.
    pub output: Output,
    /// The classifier, as results name it.
    pub decides: ClassifierUsed,
}

/// The faults of one request.
#[derive(Debug, Default)]
pub(super) struct Faults(pub(super) Vec<FieldFault>);

impl Faults {
    pub(super) fn add(&mut self, pointer: impl Into<String>, detail: impl Into<String>) {
        self.0.push(FieldFault { pointer: pointer.into(), detail: detail.into() });
    }

    /// The value, or `fallback` with a fault.
    pub(super) fn check<T>(&mut self, pointer: &str, value: Result<T, String>) -> Option<T> {
        value.map_err(|detail| self.add(pointer, detail)).ok()
    }
}

/// A finite number within bounds, or what is wrong with it.
pub(super) fn within(value: f64, least: f64, most: f64, unit: &str) -> Result<f64, String> {
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        Err(format!("{value} is not from {least} to {most} {unit}"))
    }
}

impl OrientationRequest {
    /// Checks everything and fills in what was left out. `camera_size_px` is the size of the camera's images, if they are
    /// all alike.
    ///
    /// # Errors
    /// All the faults there are, not only the first.
    pub fn prepare(&self, camera_size_px: Option<[u32; 2]>, image: &ImageFacts) -> Result<Prepared, Vec<FieldFault>> {
        let mut faults = Faults::default();
        let mut warnings = Vec::new();
        self.check_sizes(camera_size_px, image, &mut faults);
        let scan = self.scan(camera_size_px, &mut faults);
        let tolerance = self.tolerance(&mut faults);
        let policy = self.policy(&mut faults);
        let approximation = self.approximation.resolve(image, &mut faults, &mut warnings);
        let output = approximation.as_ref().and_then(|used| self.output(used, &mut faults, &mut warnings));
        match (approximation, tolerance, output) {
            (Some(approximation), Some(tolerance), Some((output_crs, output_vertical))) if faults.0.is_empty() => {
                let control = self.control.unwrap_or_default();
                let control_sets = self.control_sets.clone();
                let date = Some(self.date.or(image.taken).unwrap_or_else(|| Utc::now().date_naive()));
                Ok(Prepared {
                    approximation,
                    tolerance,
                    policy,
                    scan,
                    control,
                    control_sets,
                    date,
                    output_crs,
                    output_vertical,
                    warnings,
                })
            }
            _ => Err(faults.0),
        }
    }

    fn check_sizes(&self, camera_size_px: Option<[u32; 2]>, image: &ImageFacts, faults: &mut Faults) {
        let [width, height] = image.size_px;
        if let Some([columns, rows]) = camera_size_px.filter(|size_px| *size_px != image.size_px) {
            let detail = format!(
                "the image has {width} x {height} px, but this camera's images have {columns} x {rows} px; give the \
                 camera that took the image as it is stored"
            );
            faults.add("/camera", detail);
        }
    }

    fn scan(&self, camera_size_px: Option<[u32; 2]>, faults: &mut Faults) -> ScanRequest {
        const POINTER: &str = "/interior_orientation";
        let Some(scan) = self.interior_orientation else { return ScanRequest::default() };
        scan.check(POINTER, faults);
        if camera_size_px.is_some() {
            faults.add(POINTER, "this camera is digital: only scans of film have an interior orientation of their own");
        }
        scan
    }

    fn policy(&self, faults: &mut Faults) -> PolicyGiven {
        if let Some(costs) = &self.costs {
            costs.check(faults);
        }
        if let Some(caution) = self.caution {
            policy::check_caution(caution, faults);
        }
        if let Some(threshold) = self.threshold {
            policy::check_threshold(threshold, faults);
        }
        PolicyGiven { costs: self.costs, caution: self.caution, threshold: self.threshold }
    }

    fn tolerance(&self, faults: &mut Faults) -> Option<ToleranceGiven> {
        let positive = |value: f64, unit| match value > 0.0 {
            true => within(value, 0.0, LARGEST_TOLERANCE, unit),
            false => Err(format!("{value} is not above 0 {unit}")),
        };
        match (self.tolerance_gsd, self.tolerance_m) {
            (Some(_), Some(_)) => {
                faults.add("/tolerance_m", "give either tolerance_gsd or tolerance_m, not both");
                None
            }
            (None, Some(metres)) => faults.check("/tolerance_m", positive(metres, "m")).map(ToleranceGiven::M),
            (gsd, None) => {
                let gsd = gsd.unwrap_or(TOLERANCE_GSD);
                faults.check("/tolerance_gsd", positive(gsd, "ground sample distances")).map(ToleranceGiven::Gsd)
            }
        }
    }

    fn output(
        &self,
        used: &ApproximationUsed,
        faults: &mut Faults,
        warnings: &mut Vec<Warning>,
    ) -> Option<(String, Option<Vertical>)> {
        let Some(name) = &self.output_crs else {
            return Some((used.position.crs.clone(), used.position.vertical));
        };
        let crs = Crs::parse(name).and_then(|crs| crs.check_heights(None).map(|()| crs));
        let crs = faults.check("/output_crs", crs.map_err(|e| e.to_string()))?;
        let reaches = geocentric(used).and_then(|geocentric_m| crs.position_from_geocentric(geocentric_m, None));
        faults.check("/output_crs", reaches.map_err(|e| format!("the position does not lie in this CRS: {e}")))?;
        let warning = Warning::vertical_assumed_ellipsoidal(&crs.to_string());
        if crs.assumes_ellipsoidal_heights() && !warnings.contains(&warning) {
            warnings.push(warning);
        }
        Some((crs.to_string(), None))
    }
}

fn geocentric(used: &ApproximationUsed) -> Result<Vector3<f64>, CrsError> {
    let undulation_m = used.position.vertical.map(|vertical| vertical.geoid_undulation_m);
    Crs::parse(&used.position.crs)?.geocentric_from_position(used.position.coordinates, undulation_m)
}

impl Prepared {
    /// The local frame in which the image is oriented: at the foot of the approximate position.
    ///
    /// # Errors
    /// [`CrsError`] if a CRS that was known when the request came is not known any more.
    pub fn frame(&self) -> Result<LocalFrame, CrsError> {
        let place = LocalFrame::about(geocentric(&self.approximation)?);
        Ok(LocalFrame::at(place.longitude_deg(), place.latitude_deg(), 0.0))
    }

    /// Which control is looked for.
    #[must_use]
    pub fn wanted(&self) -> Wanted {
        Wanted { kinds: self.control.into(), sets: self.control_sets.clone(), date: self.date }
    }

    /// The task for the pipeline.
    ///
    /// # Errors
    /// [`CrsError`] if a CRS that was known when the request came is not known any more.
    pub fn work(&self, camera: CameraModel, decides: &NamedClassifier) -> Result<Work, CrsError> {
        let used = &self.approximation;
        let geocentric_m = geocentric(used)?;
        let frame = self.frame()?;
        let radians = |degrees: Option<f64>| degrees.unwrap_or(0.0).to_radians();
        let orientation = ExteriorOrientation {
            projection_centre_m: frame.from_geocentric(geocentric_m),
            camera_from_object: rotation::camera_from_object(
                radians(Some(used.omega_deg)),
                radians(Some(used.phi_deg)),
                radians(used.kappa_deg),
            ),
        };
        let approximation = Approximation {
            orientation,
            sigma_position_m: used.sigma_position_m,
            sigma_tilt_rad: used.sigma_tilt_deg.to_radians(),
            sigma_kappa_rad: used.sigma_kappa_deg.map(f64::to_radians),
        };
        let tolerance = match self.tolerance {
            ToleranceGiven::Gsd(gsd) => Tolerance::Gsd(gsd),
            ToleranceGiven::M(metres) => Tolerance::Metres(metres),
        };
        let output = Output {
            crs: Crs::parse(&self.output_crs)?,
            geoid_undulation_m: self.output_vertical.map(|vertical| vertical.geoid_undulation_m),
        };
        let judge = Judge { classifier: decides.loaded.classifier.clone(), policy: self.policy.policy() };
        let decides = ClassifierUsed::of(&decides.name, &decides.loaded);
        Ok(Work { frame, camera, approximation, check: Arc::default(), tolerance, judge, output, decides })
    }
}

impl Work {
    /// The task for an image of this camera.
    #[must_use]
    pub fn task(&self, camera: Camera) -> Task {
        let Self { approximation, check, tolerance, judge, .. } = self.clone();
        Task { camera, approximation, check, tolerance, judge }
    }

    /// The task for a scan of film.
    #[must_use]
    pub fn film_task(&self, camera: Arc<FilmCamera>, wanted: interior::Wanted) -> FilmTask {
        let Self { approximation, check, tolerance, judge, .. } = self.clone();
        FilmTask { camera, wanted, approximation, check, tolerance, judge }
    }
}
