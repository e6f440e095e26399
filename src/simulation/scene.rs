//! A scene: a town, its control, and a flight over it, all from one seed.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::control::{ControlSettings, SimulatedControlPoint, survey};
use super::flight::{FlightSettings, fly};
use super::lazy::LazyPhotograph;
use super::photograph::{Photograph, PhotographSettings, photograph};
use super::town::{Town, TownSettings};
use crate::geometry::{Brown, Camera, CameraError, ExteriorOrientation, FilmError};
use crate::orientation::ControlPoint;
use crate::pipeline::Approximation;

/// Where the origin of the scene's east, north, up frame lies on the ellipsoid: longitude and latitude in degrees
/// (WGS 84), ellipsoidal height in metres. Any place would do; this one is on the Rhine near Bonn.
pub const ORIGIN_LON_LAT_H: [f64; 3] = [7.1, 50.7, 0.0];

/// The camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSettings {
    /// Columns and rows. 3000 x 2250: a quarter of a drone's frame on a side, for a demonstration within seconds.
    pub image_size_px: [u32; 2],
    /// Principal distance. 2600 px: a field of view of 60 degrees, as of the benchmark's cameras.
    pub principal_distance_px: f64,
    /// Principal point. Some pixels beside the middle, so that a confusion of the two shows.
    pub principal_point_px: [f64; 2],
    /// Radial distortion of r²; -0.045 and 0.02 are those of a good consumer lens: 15 px at the corners.
    pub k1: f64,
    /// Radial distortion of r⁴.
    pub k2: f64,
    /// Tangential distortion.
    pub p1: f64,
    /// Tangential distortion.
    pub p2: f64,
}

impl Default for CameraSettings {
    fn default() -> Self {
        Self {
            image_size_px: [3000, 2250],
            principal_distance_px: 2600.0,
            principal_point_px: [1506.3, 1118.9],
            k1: -0.045,
            k2: 0.02,
            p1: 0.0006,
            p2: -0.0004,
        }
    }
}

/// All that a scene is drawn from, beside its seed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneSettings {
    /// The town.
    pub town: TownSettings,
    /// The camera.
    pub camera: CameraSettings,
    /// The flight.
    pub flight: FlightSettings,
    /// The control.
    pub control: ControlSettings,
    /// The photograph.
    pub photograph: PhotographSettings,
}

/// Why a scene cannot be drawn, or not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulationError {
    /// A setting makes no sense.
    #[error("{name} is {value}; it must be {wanted}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// What was given.
        value: f64,
        /// What would be right.
        wanted: &'static str,
    },
    /// The camera makes no sense.
    #[error("the simulated camera cannot be used: {0}")]
    Camera(#[from] CameraError),
    /// The lens of the film camera makes no sense.
    #[error("the simulated film camera cannot be used: {0}")]
    Film(#[from] FilmError),
    /// The film lies in the scanner as no film can.
    #[error("the simulated scan cannot be used: its transformation is singular")]
    Scan,
    /// The photograph cannot be made a file.
    #[error("the photograph cannot be encoded: {detail}")]
    Encode {
        /// What the encoder says.
        detail: String,
    },
    /// A file of the scene cannot be written.
    #[error("{path} cannot be written: {source}")]
    Write {
        /// The file.
        path: std::path::PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
}

/// A town, its control, and a flight over it with a known orientation. Coordinates are in the local east, north, up
/// frame at [`ORIGIN_LON_LAT_H`].
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Where all draws came from.
    pub seed: u64,
    /// What they were drawn from.
    pub settings: SceneSettings,
    /// The town.
    pub town: Town,
    /// The camera.
    pub camera: Camera,
    /// Where the camera truly was.
    pub true_orientation: ExteriorOrientation,
    /// What is known beforehand.
    pub approximation: Approximation,
    /// The control of the whole town, in view or not.
    pub control: Vec<SimulatedControlPoint>,
}

impl Scene {
    /// The scene of a seed.
    ///
    /// # Errors
    /// [`SimulationError`] names the setting that makes no sense.
    pub fn draw(seed: u64, settings: &SceneSettings) -> Result<Self, SimulationError> {
        Self::photographed_with(settings.camera.camera()?, seed, settings)
    }

    /// The scene of a seed, photographed with a camera other than that of the settings.
    ///
    /// # Errors
    /// [`SimulationError`] names the setting that makes no sense.
    pub fn photographed_with(camera: Camera, seed: u64, settings: &SceneSettings) -> Result<Self, SimulationError> {
        settings.check()?;
        let town = Town::build(seed, &settings.town);
        let control = survey(&town, seed, &settings.control);
        let (true_orientation, approximation) = fly(&town, &camera, seed, &settings.flight);
        Ok(Self { seed, settings: *settings, town, camera, true_orientation, approximation, control })
    }

    /// The photograph.
    #[must_use]
    pub fn render(&self) -> Photograph {
        photograph(&self.town, &self.camera, &self.true_orientation, &self.settings.photograph, self.seed)
    }

    /// The photograph, taken only where it is looked at.
    #[must_use]
    pub fn picture(&self) -> LazyPhotograph<'_> {
        LazyPhotograph::new(&self.town, &self.camera, &self.true_orientation, &self.settings.photograph, self.seed)
    }

    /// What the pipeline is told of the control.
    #[must_use]
    pub fn control_points(&self) -> Vec<ControlPoint> {
        self.control.iter().map(|point| point.control_point.clone()).collect()
    }

    /// The control points whose reference points lie in the frame under the true orientation.
    pub fn in_view(&self) -> impl Iterator<Item = &SimulatedControlPoint> {
        self.control.iter().filter(|point| {
            let pixel = self.true_orientation.pixel(&self.camera, point.control_point.reference_m);
            pixel.is_some_and(|pixel| self.camera.contains(pixel, 0.0))
        })
    }

    /// The mean height of the ground in the town, to compare orientations on.
    #[must_use]
    pub fn ground_height_m(&self) -> f64 {
        self.town.terrain.mean_height_m
    }

    /// The size of a pixel in the middle of the image on the ground, seen along its ray.
    #[must_use]
    pub fn ground_sample_distance_m(&self) -> f64 {
        self.settings.flight.height_m / self.camera.principal_distance_px
    }
}

impl CameraSettings {
    /// The camera with these settings.
    ///
    /// # Errors
    /// [`CameraError`] names the parameter that is at fault.
    pub fn camera(&self) -> Result<Camera, CameraError> {
        let Self { k1, k2, p1, p2, .. } = *self;
        let distortion = Brown { k1, k2, p1, p2, ..Brown::default() };
        let principal_point_px = Vector2::from(self.principal_point_px);
        Camera::new(self.image_size_px, self.principal_distance_px, principal_point_px, distortion)
    }
}

/// A quantity's name, its value, the range in which it makes sense, and that range in words.
type Bounded = (&'static str, f64, [f64; 2], &'static str);

impl SceneSettings {
    fn check(&self) -> Result<(), SimulationError> {
        let (town, flight, control, photograph) = (&self.town, &self.flight, &self.control, &self.photograph);
        let [lowest, highest] = town.sun_elevation_deg;
        let [east, north, up] = flight.sigma_position_m;
        const SHARE: [f64; 2] = [0.0, 1.0];
        const ANY_SIZE: [f64; 2] = [0.0, 1e4];
        let bounded: [Bounded; 29] = [
            ("town.half_length_m", town.half_length_m, [30.0, 2000.0], "30 to 2000 m"),
            ("town.street_rows", f64::from(town.street_rows), [1.0, 30.0], "1 to 30"),
            ("town.mean_height_m", town.mean_height_m, [-500.0, 9000.0], "-500 to 9000 m"),
            ("town.relief_m", town.relief_m, [0.0, 20.0], "0 to 20 m"),
            ("town.sun_elevation_deg", lowest, [10.0, 90.0], "10 to 90 degrees"),
            ("town.sun_elevation_deg", highest, [lowest, 90.0], "between the lowest sun and 90 degrees"),
            ("town.trees", town.trees, [0.0, 10.0], "0 to 10"),
            ("town.foliage", town.foliage, SHARE, "0 to 1"),
            ("town.share_alike", town.share_alike, SHARE, "0 to 1"),
            ("flight.height_m", flight.height_m, [40.0, 1e4], "40 to 10000 m"),
            ("flight.greatest_tilt_deg", flight.greatest_tilt_deg, [0.0, 45.0], "0 to 45 degrees"),
            ("flight.aim_spread_m", flight.aim_spread_m, ANY_SIZE, "0 to 10000 m"),
            ("flight.sigma_position_m", east, ANY_SIZE, "0 to 10000 m"),
            ("flight.sigma_position_m", north, ANY_SIZE, "0 to 10000 m"),
            ("flight.sigma_position_m", up, ANY_SIZE, "0 to 10000 m"),
            ("flight.sigma_tilt_deg", flight.sigma_tilt_deg, [0.0, 45.0], "0 to 45 degrees"),
            ("flight.sigma_kappa_deg", flight.sigma_kappa_deg, [0.0, 180.0], "0 to 180 degrees"),
            ("flight.share_wild", flight.share_wild, SHARE, "0 to 1"),
            ("control.share", control.share, SHARE, "0 to 1"),
            ("control.sigma_m", control.sigma_m, ANY_SIZE, "0 to 10000 m"),
            ("control.share_outdated", control.share_outdated, SHARE, "0 to 1"),
            ("control.share_gone", control.share_gone, SHARE, "0 to 1"),
            ("control.sigma_shift_m", control.sigma_shift_m, ANY_SIZE, "0 to 10000 m"),
            ("control.sigma_edge_m", control.sigma_edge_m, ANY_SIZE, "0 to 10000 m"),
            ("control.share_missing", control.share_missing, SHARE, "0 to 1"),
            ("photograph.rays_per_pixel", f64::from(photograph.rays_per_pixel), [1.0, 64.0], "1 to 64"),
            ("photograph.blur_sigma_px", photograph.blur_sigma_px, [0.0, 20.0], "0 to 20 px"),
            ("photograph.clearness", photograph.clearness, SHARE, "0 to 1"),
            ("photograph.noise_grey", photograph.noise_grey, [0.0, 100.0], "0 to 100"),
        ];
        let outside = bounded.into_iter().find(|(_, value, [low, high], _)| !(low..=high).contains(&value));
        outside.map_or(Ok(()), |(name, value, _, wanted)| Err(SimulationError::Setting { name, value, wanted }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_demonstration_has_12_to_25_control_points_in_view() {
        for seed in 1..=20 {
            let scene = Scene::draw(seed, &SceneSettings::default()).unwrap();
            let count = scene.in_view().count();
            assert!((12..=25).contains(&count), "seed {seed}: {count}");
        }
    }

    #[test]
    fn settings_that_make_no_sense_are_named() {
        let refused = |settings: SceneSettings| Scene::draw(1, &settings).unwrap_err().to_string();
        let mut settings = SceneSettings::default();
        settings.control.share = 1.5;
        assert_eq!(refused(settings), "control.share is 1.5; it must be 0 to 1");
        settings = SceneSettings::default();
        settings.flight.height_m = f64::NAN;
        assert!(refused(settings).starts_with("flight.height_m is NaN"));
        settings = SceneSettings::default();
        settings.camera.image_size_px = [0, 100];
        assert!(refused(settings).contains("0 x 100"));
    }

    #[test]
    fn settings_have_a_text_form_in_which_everything_may_be_left_out() {
        let settings: SceneSettings = serde_json::from_str(r#"{"flight": {"height_m": 300}}"#).unwrap();
        assert_eq!(settings.flight.height_m, 300.0);
        assert_eq!(settings.camera, CameraSettings::default());
        assert!(serde_json::from_str::<SceneSettings>(r#"{"flight": {"hight_m": 300}}"#).is_err());
    }
}
