//! From stored results to photographs that can be exported.

use nalgebra::{Matrix3, Rotation3};
use serde::Deserialize;

use super::request::CameraModel;
use crate::exports::{ExportError, Judgement, Photograph, Sigma, Target};
use crate::geometry::{Camera, Crs, CrsError, Ellipsoid, Geodetic, PixelFromPlate};
use crate::report::{InteriorResult, Position};

/// How an export is wanted.
#[derive(Debug, Clone, Default)]
pub struct ExportWanted {
    /// The CRS of formats in a map grid. Default: that of the result, or if that has degrees the UTM zone with the same
    /// heights.
    pub crs: Option<Crs>,
    /// What takes its heights off the ellipsoid. Default: that of the result, in the result's CRS.
    pub geoid_undulation_m: Option<f64>,
    /// Mean ellipsoidal height of the ground. Default: that of the control that was used.
    pub ground_height_m: Option<f64>,
    /// How far the ground reaches above and below that. Default: [`RELIEF_SHARE`] of the flying height.
    pub relief_m: Option<f64>,
    /// Side of a pixel of a digital camera, for formats in millimetres.
    pub pixel_size_um: Option<f64>,
    /// Also what is red, or was rejected by staff.
    pub all: bool,
}

/// Of the flying height, where nobody says how hilly the ground is.
pub const RELIEF_SHARE: f64 = 0.05;
const LEAST_RELIEF_M: f64 = 5.0;
/// Of sensors in aerial cameras; what stands in formats only has to be the same everywhere.
const PIXEL_SIZE_UM: f64 = 4.0;
const MM_PER_UM: f64 = 1e-3;

/// Of a result, what an export needs.
#[derive(Debug, Clone, Deserialize)]
pub struct Exportable {
    projection_centre: Option<Position>,
    rotation: Option<Turned>,
    covariance: Option<Matrix>,
    diagnosis: Option<Diagnosed>,
    /// What staff have decided.
    #[serde(skip)]
    review: Option<String>,
    #[serde(default)]
    ground_precision: Vec<Ground>,
    interior_orientation: Option<InteriorResult>,
}

#[derive(Debug, Clone, Deserialize)]
struct Turned {
    frame: String,
    rotation_matrix: [[f64; 3]; 3],
}

#[derive(Debug, Clone, Deserialize)]
struct Matrix {
    matrix: [[f64; 6]; 6],
}

#[derive(Debug, Clone, Deserialize)]
struct Diagnosed {
    verdict: String,
}

#[derive(Debug, Clone, Deserialize)]
struct Ground {
    ground: [f64; 3],
}

/// Why a result cannot be exported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportableError {
    /// It is not the JSON of a result.
    #[error("this is not the result of an orientation: {0}")]
    Json(#[from] serde_json::Error),
    /// It could not be oriented.
    #[error("there is no orientation in this result")]
    NotOriented,
    /// Nobody should use it unknowingly.
    #[error("{why}; all=true, or --all, exports it all the same")]
    Doubtful {
        /// What speaks against it.
        why: &'static str,
    },
    /// Nothing says where the ground is.
    #[error("the result does not say how high the ground is; give ground_height_m, above the ellipsoid")]
    NoGround,
    /// A scan without an interior orientation.
    #[error("the interior orientation of the scan is not in this result")]
    NoInterior,
    /// A CRS that is not known any more.
    #[error(transparent)]
    Crs(#[from] CrsError),
    /// It cannot be exported so.
    #[error(transparent)]
    Export(#[from] ExportError),
}

impl Exportable {
    /// Reads the result of an orientation, or an answer that holds one.
    ///
    /// # Errors
    /// [`ExportableError::Json`].
    pub fn read(text: &str) -> Result<Self, ExportableError> {
        let value: serde_json::Value = serde_json::from_str(text)?;
        let review = value.get("review").and_then(serde_json::Value::as_str).map(str::to_owned);
        let result = value.get("result").filter(|result| result.is_object()).cloned();
        Ok(Self { review, ..serde_json::from_value(result.unwrap_or(value))? })
    }

    /// The same, of which staff have decided this.
    #[must_use]
    pub fn with_review(self, review: Option<String>) -> Self {
        Self { review, ..self }
    }

    /// What the system thinks of it, and staff as far as the answer says.
    fn judgement(&self) -> Judgement {
        let verdict = self.diagnosis.as_ref().map(|diagnosis| diagnosis.verdict.clone());
        Judgement { verdict, review: self.review.clone() }
    }

    /// The photograph, by what its file and its camera are called.
    ///
    /// # Errors
    /// [`ExportableError`].
    pub fn photograph(
        &self,
        (name, camera_name): (&str, &str),
        camera: &CameraModel,
        wanted: &ExportWanted,
    ) -> Result<Photograph, ExportableError> {
        let (Some(centre), Some(turned)) = (&self.projection_centre, &self.rotation) else {
            return Err(ExportableError::NotOriented);
        };
        let judgement = self.judgement();
        if let Some(why) = judgement.warning().filter(|_| !wanted.all) {
            return Err(ExportableError::Doubtful { why });
        }
        let undulation_m = undulation_m(centre);
        let centre_geocentric_m =
            Crs::parse(&centre.crs)?.geocentric_from_position(centre.coordinates, undulation_m)?;
        let axes = Crs::parse(&turned.frame)?.axes_from_geocentric(centre_geocentric_m)?;
        let rows = Matrix3::from_row_slice(turned.rotation_matrix.as_flattened());
        let ground_height_m = match wanted.ground_height_m {
            Some(height_m) => height_m,
            None => self.ground_height_m(centre)?.ok_or(ExportableError::NoGround)?,
        };
        let flying_height_m = Ellipsoid::WGS84.geodetic(centre_geocentric_m).height_m - ground_height_m;
        let (camera, pixel_size_mm) = self.interior(camera, wanted)?;
        Ok(Photograph {
            name: name.to_owned(),
            camera_name: camera_name.to_owned(),
            camera,
            pixel_size_mm,
            centre_geocentric_m,
            camera_from_geocentric: Rotation3::from_matrix_unchecked(rows) * axes,
            sigma: self.covariance.as_ref().map(|Matrix { matrix }| Sigma {
                frame: turned.frame.clone(),
                projection_centre_m: std::array::from_fn(|k| matrix[k][k].sqrt()),
                omega_phi_kappa_rad: std::array::from_fn(|k| matrix[k + 3][k + 3].sqrt()),
            }),
            judgement,
            ground_height_m,
            relief_m: wanted.relief_m.unwrap_or((RELIEF_SHARE * flying_height_m).max(LEAST_RELIEF_M)),
        })
    }

    /// Where the formats in a map grid are to be.
    ///
    /// # Errors
    /// [`ExportableError`].
    pub fn target(&self, wanted: &ExportWanted) -> Result<Target, ExportableError> {
        let centre = self.projection_centre.as_ref().ok_or(ExportableError::NotOriented)?;
        if let Some(crs) = &wanted.crs {
            return Ok(Target::new(crs.clone(), wanted.geoid_undulation_m)?);
        }
        let crs = Crs::parse(&centre.crs)?;
        let geoid_undulation_m = wanted.geoid_undulation_m.or(undulation_m(centre));
        if !crs.is_geographic() {
            return Ok(Target::new(crs, geoid_undulation_m)?);
        }
        let geocentric_m = crs.geocentric_from_position(centre.coordinates, undulation_m(centre))?;
        // heights stay what they are
        let zone = utm_zone(Ellipsoid::WGS84.geodetic(geocentric_m), crs.heights_code());
        Ok(Target::new(Crs::parse(&zone)?, geoid_undulation_m)?)
    }

    fn ground_height_m(&self, centre: &Position) -> Result<Option<f64>, CrsError> {
        let crs = Crs::parse(&centre.crs)?;
        let height_m = |point: &Ground| {
            let geocentric_m = crs.geocentric_from_position(point.ground, undulation_m(centre))?;
            Ok(Ellipsoid::WGS84.geodetic(geocentric_m).height_m)
        };
        let heights_m = self.ground_precision.iter().map(height_m).collect::<Result<Vec<f64>, CrsError>>()?;
        Ok((!heights_m.is_empty()).then(|| heights_m.iter().sum::<f64>() / heights_m.len() as f64))
    }

    /// The camera, of film as it lies in the scan, and the side of its pixels.
    fn interior(&self, camera: &CameraModel, wanted: &ExportWanted) -> Result<(Camera, f64), ExportableError> {
        let film = match camera {
            CameraModel::Digital(camera) => {
                return Ok((*camera, wanted.pixel_size_um.unwrap_or(PIXEL_SIZE_UM) * MM_PER_UM));
            }
            CameraModel::Film(film) => film,
        };
        let interior = self.interior_orientation.as_ref().ok_or(ExportableError::NoInterior)?;
        let transformation = interior.transformation.as_ref().ok_or(ExportableError::NoInterior)?;
        let matrix = Matrix3::from_row_slice(transformation.pixel_from_plate.as_flattened());
        let pixel_from_plate = PixelFromPlate::new(&matrix).ok_or(ExportableError::NoInterior)?;
        let camera = Camera::of_scan(interior.image_size_px, &film.film, &pixel_from_plate)
            .map_err(|_| ExportableError::NoInterior)?;
        Ok((camera, film.film.principal_distance_mm / camera.principal_distance_px))
    }
}

fn undulation_m(position: &Position) -> Option<f64> {
    position.vertical.map(|vertical| vertical.geoid_undulation_m)
}

/// The zone of UTM on WGS 84, without the exceptions in Norway, with a height system if there is one.
fn utm_zone(at: Geodetic, heights: Option<u32>) -> String {
    let zone = ((at.longitude_rad.to_degrees() + 180.0) / 6.0).floor().clamp(0.0, 59.0) as u32 + 1;
    let base = if at.latitude_rad < 0.0 { 32_700 } else { 32_600 };
    let heights = heights.map(|code| format!("+{code}")).unwrap_or_default();
    format!("EPSG:{}{heights}", base + zone)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Brown, LocalFrame, rotation};
    use approx::assert_abs_diff_eq;
    use nalgebra::{Vector2, Vector3};

    const RESULT: &str = r#"{"id": "x", "result": {
        "projection_centre": {"crs": "+proj=topocentric +ellps=WGS84 +lon_0=7.1 +lat_0=50.7 +h_0=0", "coordinates": [100, -200, 900]},
        "rotation": {"frame": "+proj=topocentric +ellps=WGS84 +lon_0=7.1 +lat_0=50.7 +h_0=0",
                     "rotation_matrix": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], "omega_deg": 0, "phi_deg": 0, "kappa_deg": 90},
        "ground_precision": [{"image_px": [1, 1], "ground": [0, 0, 60], "sigma_planimetric_m": 0.1}]}}"#;

    fn camera() -> CameraModel {
        CameraModel::Digital(Camera::new([4000, 3000], 3000.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap())
    }

    #[test]
    fn a_result_becomes_a_photograph_where_it_says() {
        let exportable = Exportable::read(RESULT).unwrap();
        let photograph = exportable.photograph(("a.jpg", "c"), &camera(), &ExportWanted::default()).unwrap();
        let frame = LocalFrame::at(7.1, 50.7, 0.0);
        let orientation = photograph.in_frame(&frame);
        assert_abs_diff_eq!(orientation.projection_centre_m, Vector3::new(100.0, -200.0, 900.0), epsilon = 1e-6);
        let kappa = rotation::angles(&orientation.camera_from_object)[2];
        assert_abs_diff_eq!(kappa.to_degrees(), 90.0, epsilon = 1e-9);
        assert_abs_diff_eq!(photograph.ground_height_m, 60.0, epsilon = 1e-3);
        assert_abs_diff_eq!(photograph.relief_m, 42.0, epsilon = 0.1);
        assert_eq!(exportable.target(&ExportWanted::default()).unwrap().crs.to_string(), frame.proj_string());
    }

    #[test]
    fn degrees_become_the_zone_of_utm() {
        let text = RESULT.replace(
            "+proj=topocentric +ellps=WGS84 +lon_0=7.1 +lat_0=50.7 +h_0=0\", \"coordinates\": [100, -200, 900]",
            "EPSG:4979\", \"coordinates\": [-98.1, -30.2, 900]",
        );
        let target = Exportable::read(&text).unwrap().target(&ExportWanted::default()).unwrap();
        assert_eq!(target.crs.to_string(), "EPSG:32714");
        let wanted = ExportWanted { crs: Some(Crs::parse("EPSG:4326").unwrap()), ..ExportWanted::default() };
        assert!(Exportable::read(&text).unwrap().target(&wanted).is_err());
    }

    #[test]
    fn the_zone_keeps_the_heights_of_the_result() {
        let text = RESULT.replace(
            "+proj=topocentric +ellps=WGS84 +lon_0=7.1 +lat_0=50.7 +h_0=0\", \"coordinates\": [100, -200, 900]",
            "EPSG:4979\", \"coordinates\": [7.1, 50.7, 900], \"vertical\": {\"geoid_undulation_m\": 46.5}",
        );
        let exportable = Exportable::read(&text).unwrap();
        assert_eq!(exportable.target(&ExportWanted::default()).unwrap().geoid_undulation_m, Some(46.5));
        let wanted = ExportWanted { geoid_undulation_m: Some(47.0), ..ExportWanted::default() };
        assert_eq!(exportable.target(&wanted).unwrap().geoid_undulation_m, Some(47.0));
        // who names a grid names its heights too
        let wanted = ExportWanted { crs: Some(Crs::parse("EPSG:25832").unwrap()), ..ExportWanted::default() };
        assert_eq!(exportable.target(&wanted).unwrap().geoid_undulation_m, None);
        let bonn = Geodetic { longitude_rad: 7.1_f64.to_radians(), latitude_rad: 0.88, height_m: 0.0 };
        for (of_result, zone) in
            [("EPSG:9924", "EPSG:32632+7837"), ("EPSG:4258+7837", "EPSG:32632+7837"), ("EPSG:4979", "EPSG:32632")]
        {
            assert_eq!(utm_zone(bonn, Crs::parse(of_result).unwrap().heights_code()), zone);
        }
    }

    #[test]
    fn an_undulation_has_no_place_in_a_topocentric_frame() {
        let wanted = ExportWanted { geoid_undulation_m: Some(46.0), ..ExportWanted::default() };
        let refused = Exportable::read(RESULT).unwrap().target(&wanted).unwrap_err().to_string();
        assert!(refused.contains("leave it out"), "{refused}");
    }

    #[test]
    fn what_is_red_or_rejected_is_exported_only_if_wanted() {
        let verdict = |verdict: &str| {
            let diagnosed = format!(r#""result": {{"diagnosis": {{"verdict": "{verdict}"}},"#);
            Exportable::read(&RESULT.replace(r#""result": {"#, &diagnosed)).unwrap()
        };
        let reviewed = |name: &str, review: &str| verdict(name).with_review(Some(review.to_owned()));
        let all = ExportWanted { all: true, ..ExportWanted::default() };
        for (exportable, why) in [
            (verdict("red"), Some("red")),
            (reviewed("green", "rejected"), Some("staff have rejected")),
            (reviewed("red", "accepted"), None),
            (verdict("yellow"), None),
        ] {
            let photograph = exportable.photograph(("a", "c"), &camera(), &ExportWanted::default());
            match (photograph, why) {
                (Err(error), Some(why)) => assert!(error.to_string().contains(why), "{error}"),
                (Ok(photograph), None) => assert!(photograph.judgement.verdict.is_some()),
                (other, why) => panic!("{other:?}, {why:?}"),
            }
            exportable.photograph(("a", "c"), &camera(), &all).unwrap();
        }
        // as the API answers
        let answer = RESULT.replacen('{', r#"{"review": "rejected", "#, 1);
        assert_eq!(Exportable::read(&answer).unwrap().judgement().review.as_deref(), Some("rejected"));
    }

    #[test]
    fn standard_deviations_name_the_axes_that_they_are_along() {
        let diagonal: [[f64; 6]; 6] = std::array::from_fn(|row| {
            std::array::from_fn(|column| f64::from(u8::from(row == column)) * (row + 1).pow(2) as f64)
        });
        let covariance = format!(r#""result": {{"covariance": {{"matrix": {diagonal:?}}},"#);
        let exportable = Exportable::read(&RESULT.replace(r#""result": {"#, &covariance)).unwrap();
        let sigma = exportable.photograph(("a", "c"), &camera(), &ExportWanted::default()).unwrap().sigma.unwrap();
        assert!(sigma.frame.starts_with("+proj=topocentric"));
        assert_eq!((sigma.projection_centre_m, sigma.omega_phi_kappa_rad), ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]));
    }

    #[test]
    fn what_was_not_oriented_is_not_exported() {
        let exportable = Exportable::read(r#"{"result": {"control_points": []}}"#).unwrap();
        let refused = exportable.photograph(("a", "c"), &camera(), &ExportWanted::default());
        assert!(matches!(refused, Err(ExportableError::NotOriented)));
        assert!(matches!(Exportable::read("[1"), Err(ExportableError::Json(_))));
    }
}
