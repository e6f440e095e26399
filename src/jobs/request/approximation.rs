//! The approximate orientation: what the request says, else what the image file says, else the contract's defaults.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Faults, ImageFacts, within};
use crate::geometry::{Crs, CrsError};
use crate::report::{ApproximationOrigin, ApproximationUsed, Origin, Position, Vertical, Warning};

/// What is assumed where neither the request nor the image file says anything, for documents and help texts.
pub const NUMBERS_ASSUMED: &str = "omega = phi = 0 with sigma 5 degrees; position sigma 15, 15, 30 m; \
    kappa sigma 15 degrees";

const SIGMA_POSITION_M: [f64; 3] = [15.0, 15.0, 30.0];
const SIGMA_TILT_DEG: f64 = 5.0;
const SIGMA_KAPPA_DEG: f64 = 15.0;
/// However sure of itself a receiver is, its clock and the shutter do not agree better.
const LEAST_SIGMA_EXIF_M: f64 = 1.0;
/// The geoid is about so far from the ellipsoid, root mean square over the earth.
const GEOID_RMS_M: f64 = 30.0;

const LARGEST_SIGMA_POSITION_M: f64 = 10_000.0;
const LARGEST_SIGMA_TILT_DEG: f64 = 45.0;
/// Steeper than this no ground is in view.
const LARGEST_TILT_DEG: f64 = 80.0;

/// What is known of the orientation beforehand. Angles are about the axes of a local east, north, up frame at the
/// position; everything may be left out.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ApproximationRequest {
    /// The projection centre; default: the image's EXIF position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<Position>,
    /// Where the position is left out: what makes the EXIF altitude, which is above the geoid, ellipsoidal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vertical: Option<Vertical>,
    /// Standard deviations east, north, up; default: 15, 15, 30 m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>, example = json!([3, 3, 5]))]
    pub sigma_position_m: Option<[f64; 3]>,
    /// Angle about the east axis; default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub omega_deg: Option<f64>,
    /// Angle about the north axis; default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phi_deg: Option<f64>,
    /// Angle about the up axis, counter-clockwise; default: from the image's heading, else the whole circle is searched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = 12.5)]
    pub kappa_deg: Option<f64>,
    /// Standard deviation of omega and of phi; default: 5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = 3)]
    pub sigma_tilt_deg: Option<f64>,
    /// Standard deviation of kappa; default: 15.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = 3)]
    pub sigma_kappa_deg: Option<f64>,
}

/// The projection centre with all that belongs to it.
struct Placed {
    position: Position,
    sigma_m: [f64; 3],
    origin: Origin,
}

impl ApproximationRequest {
    pub(super) fn resolve(
        &self,
        image: &ImageFacts,
        faults: &mut Faults,
        warnings: &mut Vec<Warning>,
    ) -> Option<ApproximationUsed> {
        let placed = match &self.position {
            Some(position) => self.requested_position(position, faults, warnings),
            None => self.exif_position(image, faults, warnings),
        };
        let sigma_position_m = self.checked_sigma_position(faults);
        let tilt = self.tilt(faults);
        let kappa = self.kappa(image, faults);
        let placed = placed?;
        let (omega_deg, phi_deg, sigma_tilt_deg, tilt_origin) = tilt?;
        let (kappa_deg, sigma_kappa_deg, kappa_origin) = kappa?;
        Some(ApproximationUsed {
            sigma_position_m: sigma_position_m?.unwrap_or(placed.sigma_m),
            position: placed.position,
            omega_deg,
            phi_deg,
            kappa_deg,
            sigma_tilt_deg,
            sigma_kappa_deg,
            origin: ApproximationOrigin { position: placed.origin, tilt: tilt_origin, kappa: kappa_origin },
        })
    }

    fn requested_position(
        &self,
        position: &Position,
        faults: &mut Faults,
        warnings: &mut Vec<Warning>,
    ) -> Option<Placed> {
        if self.vertical.is_some() {
            let detail = "it belongs to the EXIF altitude; beside a position, give \"vertical\" in the position";
            faults.add("/approximation/vertical", detail);
        }
        let crs = Crs::parse(&position.crs).map_err(|e| e.to_string());
        let crs = faults.check("/approximation/position/crs", crs)?;
        let undulation_m = position.vertical.map(|vertical| vertical.geoid_undulation_m);
        if let Err(error) = crs.geocentric_from_position(position.coordinates, undulation_m) {
            faults.add(format!("/approximation/position{}", place_of(&error)), error.to_string());
            return None;
        }
        if crs.assumes_ellipsoidal_heights() && undulation_m.is_none() {
            warnings.push(Warning::vertical_assumed_ellipsoidal(&crs.to_string()));
        }
        let position = Position { crs: crs.to_string(), ..position.clone() };
        Some(Placed { position, sigma_m: SIGMA_POSITION_M, origin: Origin::Request })
    }

    fn exif_position(&self, image: &ImageFacts, faults: &mut Faults, warnings: &mut Vec<Warning>) -> Option<Placed> {
        let pointer = "/approximation/position";
        let Some(exif) = image.position else {
            faults
                .add(pointer, "the image file says nothing about its position; give the approximate projection centre");
            return None;
        };
        let Some(altitude_m) = exif.altitude_m else {
            let detail = "the image file knows its position, but no altitude; give the approximate projection centre";
            faults.add(pointer, detail);
            return None;
        };
        let coordinates = [exif.longitude_deg, exif.latitude_deg, altitude_m];
        let undulation_m = self.vertical.map(|vertical| vertical.geoid_undulation_m);
        let on_earth = Crs::parse("EPSG:4979").and_then(|crs| crs.geocentric_from_position(coordinates, undulation_m));
        if let Err(error) = on_earth {
            match error {
                CrsError::Undulation { .. } => {
                    faults.add("/approximation/vertical/geoid_undulation_m", error.to_string());
                }
                _ => faults.add(pointer, format!("the position in the image file is not usable: {error}; give one")),
            }
            return None;
        }
        let sigma_plan_m =
            exif.horizontal_error_m.map_or(SIGMA_POSITION_M[0], |error_m| error_m.max(LEAST_SIGMA_EXIF_M));
        let sigma_height_m = SIGMA_POSITION_M[2];
        let sigma_up_m = match self.vertical {
            Some(_) => sigma_height_m,
            None => {
                warnings.push(geoid_unknown());
                sigma_height_m.hypot(GEOID_RMS_M)
            }
        };
        Some(Placed {
            position: Position { crs: "EPSG:4979".to_owned(), coordinates, vertical: self.vertical },
            sigma_m: [sigma_plan_m, sigma_plan_m, sigma_up_m],
            origin: Origin::Exif,
        })
    }

    /// `None` is a fault, `Some(None)` that nothing was given.
    fn checked_sigma_position(&self, faults: &mut Faults) -> Option<Option<[f64; 3]>> {
        let Some(sigma_m) = self.sigma_position_m else {
            return Some(None);
        };
        let before = faults.0.len();
        for (axis, value) in sigma_m.into_iter().enumerate() {
            faults.check(
                &format!("/approximation/sigma_position_m/{axis}"),
                within(value, 0.001, LARGEST_SIGMA_POSITION_M, "m"),
            );
        }
        (faults.0.len() == before).then_some(Some(sigma_m))
    }

    fn tilt(&self, faults: &mut Faults) -> Option<(f64, f64, f64, Origin)> {
        let given = self.omega_deg.is_some() || self.phi_deg.is_some();
        let mut angle = |pointer, value: Option<f64>| {
            faults.check(pointer, within(value.unwrap_or(0.0), -LARGEST_TILT_DEG, LARGEST_TILT_DEG, "degrees"))
        };
        let (omega, phi) =
            (angle("/approximation/omega_deg", self.omega_deg), angle("/approximation/phi_deg", self.phi_deg));
        let sigma = self.sigma_tilt_deg.unwrap_or(SIGMA_TILT_DEG);
        let sigma = within(sigma, 0.001, LARGEST_SIGMA_TILT_DEG, "degrees");
        let sigma = faults.check("/approximation/sigma_tilt_deg", sigma);
        Some((omega?, phi?, sigma?, if given { Origin::Request } else { Origin::Default }))
    }

    fn kappa(&self, image: &ImageFacts, faults: &mut Faults) -> Option<(Option<f64>, Option<f64>, Origin)> {
        let sigma = within(self.sigma_kappa_deg.unwrap_or(SIGMA_KAPPA_DEG), 0.001, 180.0, "degrees");
        let sigma = faults.check("/approximation/sigma_kappa_deg", sigma)?;
        match (self.kappa_deg, image.heading) {
            (Some(kappa), _) => {
                let kappa = faults.check("/approximation/kappa_deg", within(kappa, -360.0, 360.0, "degrees"))?;
                Some((Some(kappa), Some(sigma), Origin::Request))
            }
            // a heading turns clockwise, kappa counter-clockwise
            (None, Some(heading)) => Some((Some(half_circle(-heading.heading_deg)), Some(sigma), Origin::Exif)),
            (None, None) if self.sigma_kappa_deg.is_some() => {
                let detail =
                    "kappa_deg is not given and the image file has no heading, so there is nothing to be sure of";
                faults.add("/approximation/sigma_kappa_deg", detail);
                None
            }
            (None, None) => Some((None, None, Origin::Unknown)),
        }
    }
}

/// The part of a position that an error is about, as the end of a JSON pointer.
#[must_use]
pub fn place_of(error: &CrsError) -> String {
    match error {
        CrsError::OutOfRange { index, .. } => format!("/coordinates/{index}"),
        CrsError::Undulation { .. }
        | CrsError::UndulationWithoutHeight { .. }
        | CrsError::UndulationBesideCompound { .. } => "/vertical/geoid_undulation_m".to_owned(),
        CrsError::OutsideGeoidGrid { .. } => "/coordinates".to_owned(),
        _ => "/crs".to_owned(),
    }
}

fn half_circle(degrees: f64) -> f64 {
    (degrees + 180.0).rem_euclid(360.0) - 180.0
}

fn geoid_unknown() -> Warning {
    Warning {
        code: "geoid_undulation_unknown".to_owned(),
        detail: format!(
            "The altitude in the image file is above the geoid, whose height above the ellipsoid is not known here: \
             it was taken as 0 with a standard deviation of {GEOID_RMS_M} m. Give it as \"vertical\": \
             {{\"geoid_undulation_m\": N}} in \"approximation\"."
        ),
    }
}
