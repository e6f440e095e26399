//! A scene as files and request bodies: what the command line and the service's clients read (the HTTP contract,
//! version 1), and the truth beside it.

use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use nalgebra::{Rotation3, Vector2, Vector3};
use serde_json::{Value, json};

use super::photograph::Photograph;
use super::scene::{ORIGIN_LON_LAT_H, Scene, SimulationError};
use crate::geometry::{Brown, LocalFrame, rotation};

/// The picture's name in a scene's folder.
pub const PHOTOGRAPH_FILE: &str = "photograph.png";

/// Side of a cell of the grid of the ground.
const TERRAIN_CELL_M: f64 = 4.0;
/// How far the grid reaches to all sides, in flying heights.
const TERRAIN_REACH: f64 = 1.6;

impl Scene {
    /// The CRS of all coordinates of the scene: a topocentric frame.
    #[must_use]
    pub fn crs(&self) -> String {
        let [longitude_deg, latitude_deg, height_m] = ORIGIN_LON_LAT_H;
        LocalFrame::at(longitude_deg, latitude_deg, height_m).proj_string()
    }

    /// The body of `POST /cameras`.
    #[must_use]
    pub fn camera_body(&self) -> Value {
        let Brown { k1, k2, k3, p1, p2, b1_px, b2_px } = self.camera.distortion().copied().unwrap_or_default();
        let principal_point_px = self.camera.principal_point_px();
        json!({
            "name": format!("simulated-{}", self.seed),
            "image_size_px": [self.camera.width_px, self.camera.height_px],
            "principal_distance_px": self.camera.principal_distance_px,
            "principal_point_px": [principal_point_px.x, principal_point_px.y],
            "distortion": {
                "model": "brown", "k1": k1, "k2": k2, "k3": k3, "p1": p1, "p2": p2, "b1_px": b1_px, "b2_px": b2_px
            }
        })
    }

    /// The body of `POST /control-points?crs=` with [`Scene::crs`]: a GeoJSON FeatureCollection.
    #[must_use]
    pub fn control_points_body(&self) -> Value {
        let feature = |point: &crate::orientation::ControlPoint| {
            let lines: Vec<_> = point.edges_m.iter().map(|edge| [position(edge.start), position(edge.end)]).collect();
            json!({
                "type": "Feature",
                "properties": {
                    "name": point.name, "sigma_m": point.sigma_m, "reference": position(point.reference_m)
                },
                "geometry": { "type": "MultiLineString", "coordinates": lines }
            })
        };
        let features: Vec<Value> = self.control.iter().map(|point| feature(&point.control_point)).collect();
        json!({ "type": "FeatureCollection", "features": features })
    }

    /// The member `approximation` of `POST /orientations`.
    #[must_use]
    pub fn approximation_body(&self) -> Value {
        let approximation = &self.approximation;
        let [omega, phi, kappa] = rotation::angles(&approximation.orientation.camera_from_object).map(f64::to_degrees);
        let mut body = json!({
            "position": {
                "crs": self.crs(),
                "coordinates": position(approximation.orientation.projection_centre_m)
            },
            "sigma_position_m": approximation.sigma_position_m,
            "omega_deg": omega,
            "phi_deg": phi,
            "sigma_tilt_deg": approximation.sigma_tilt_rad.to_degrees(),
        });
        if let Some(sigma_kappa_rad) = approximation.sigma_kappa_rad {
            body["kappa_deg"] = json!(kappa);
            body["sigma_kappa_deg"] = json!(sigma_kappa_rad.to_degrees());
        }
        body
    }

    /// What the pipeline is not told: the true orientation, and which control points are out of date.
    #[must_use]
    pub fn truth(&self) -> Value {
        let [omega, phi, kappa] = rotation::angles(&self.true_orientation.camera_from_object).map(f64::to_degrees);
        let faulty = self.control.iter().filter_map(|point| {
            let fault = point.fault?;
            Some(json!({ "name": point.control_point.name, "fault": fault }))
        });
        let shifts: Vec<Value> = self
            .control
            .iter()
            .filter(|point| self.settings.control.sigma_shift_m > 0.0 || !point.edge_shifts_m.iter().all(|s| *s == 0.0))
            .map(|point| {
                let name = &point.control_point.name;
                json!({ "name": name, "shift_m": position(point.shift_m), "edge_shifts_m": point.edge_shifts_m })
            })
            .collect();
        let in_view: Vec<&str> = self.in_view().map(|point| point.control_point.name.as_str()).collect();
        json!({
            "seed": self.seed,
            "frame": self.crs(),
            "projection_centre": position(self.true_orientation.projection_centre_m),
            "rotation_matrix": rows(&self.true_orientation.camera_from_object),
            "omega_deg": omega,
            "phi_deg": phi,
            "kappa_deg": kappa,
            "ground_height_m": self.ground_height_m(),
            "gsd_m": self.ground_sample_distance_m(),
            "to_sun": position(self.town.to_sun),
            "control_points_in_view": in_view,
            "control_points_out_of_date": faulty.collect::<Vec<_>>(),
            "control_points_shifted": shifts,
            "settings": self.settings,
        })
    }

    /// The ground without its houses as a grid of Esri's text format, in the frame's metres, all around what is in view.
    #[must_use]
    pub fn terrain_grid(&self) -> String {
        let centre_m = self.true_orientation.projection_centre_m;
        let reach_m = TERRAIN_REACH * (centre_m.z - self.ground_height_m()) / TERRAIN_CELL_M;
        let half = reach_m.ceil() * TERRAIN_CELL_M;
        let cells = (2.0 * half / TERRAIN_CELL_M) as usize;
        let (west, south) = (centre_m.x.floor() - half, centre_m.y.floor() - half);
        let mut text = format!(
            "ncols {cells}\nnrows {cells}\nxllcorner {west}\nyllcorner {south}\ncellsize {TERRAIN_CELL_M}\nNODATA_value -9999\n"
        );
        for row in (0..cells).rev() {
            let height = |column: usize| {
                let middle = Vector2::new(column as f64 + 0.5, row as f64 + 0.5) * TERRAIN_CELL_M;
                format!("{:.3}", self.town.terrain.height_m(Vector2::new(west, south) + middle))
            };
            text.push_str(&(0..cells).map(height).collect::<Vec<_>>().join(" "));
            text.push('\n');
        }
        text
    }

    /// Takes the photograph and writes the scene into a folder that exists: `photograph.png`, `camera.json`,
    /// `control_points.geojson`, `approximation.json`, `terrain.asc` and `truth.json`.
    ///
    /// # Errors
    /// [`SimulationError::Write`] names the file that could not be written.
    pub fn write(&self, folder: &Path) -> Result<(), SimulationError> {
        self.write_bodies(folder, &self.camera_body(), &self.truth())?;
        let path = folder.join(PHOTOGRAPH_FILE);
        std::fs::write(&path, self.render().png()?).map_err(|source| SimulationError::Write { path, source })
    }

    /// All but the photograph.
    pub(super) fn write_bodies(&self, folder: &Path, camera: &Value, truth: &Value) -> Result<(), SimulationError> {
        let to_file = |name: &str, content: Vec<u8>| {
            let path = folder.join(name);
            std::fs::write(&path, content).map_err(|source| SimulationError::Write { path, source })
        };
        to_file("camera.json", text(camera))?;
        to_file("control_points.geojson", text(&self.control_points_body()))?;
        to_file("approximation.json", text(&self.approximation_body()))?;
        to_file("terrain.asc", self.terrain_grid().into_bytes())?;
        to_file("truth.json", text(truth))
    }
}

impl Photograph {
    /// The picture as the bytes of a PNG file.
    ///
    /// # Errors
    /// [`SimulationError::Encode`] for a picture that PNG cannot hold: one without pixels.
    pub fn png(&self) -> Result<Vec<u8>, SimulationError> {
        let mut bytes = Vec::new();
        PngEncoder::new(&mut bytes)
            .write_image(&self.grey, self.width_px, self.height_px, ExtendedColorType::L8)
            .map_err(|source| SimulationError::Encode { detail: source.to_string() })?;
        Ok(bytes)
    }
}

fn position(point: Vector3<f64>) -> [f64; 3] {
    point.into()
}

fn rows(rotation: &Rotation3<f64>) -> [[f64; 3]; 3] {
    rotation.matrix().transpose().into()
}

fn text(value: &Value) -> Vec<u8> {
    format!("{value:#}\n").into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::SceneSettings;
    use approx::assert_relative_eq;

    fn small_scene() -> Scene {
        let mut settings = SceneSettings::default();
        settings.camera.image_size_px = [300, 225];
        settings.camera.principal_distance_px = 260.0;
        settings.camera.principal_point_px = [150.0, 112.0];
        Scene::draw(4, &settings).unwrap()
    }

    fn read(folder: &Path, name: &str) -> Value {
        serde_json::from_slice(&std::fs::read(folder.join(name)).unwrap()).unwrap()
    }

    fn numbers(value: &Value) -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    }

    #[test]
    fn files_hold_the_scene() {
        let (scene, folder) = (small_scene(), tempfile::tempdir().unwrap());
        scene.write(folder.path()).unwrap();
        let picture = image::open(folder.path().join(PHOTOGRAPH_FILE)).unwrap().into_luma8();
        assert_eq!(picture.into_raw(), scene.render().grey);

        let camera = read(folder.path(), "camera.json");
        assert_eq!(camera["image_size_px"], json!([300, 225]));
        assert_eq!(camera["distortion"]["k1"], json!(-0.045));

        let control = read(folder.path(), "control_points.geojson");
        let features = control["features"].as_array().unwrap();
        assert_eq!(features.len(), scene.control.len());
        let end = numbers(&features[2]["geometry"]["coordinates"][1][1]);
        assert_eq!(end, scene.control[2].control_point.edges_m[1].end.as_slice());
    }

    #[test]
    fn approximation_and_truth_are_the_scene_s_orientations() {
        let scene = small_scene();
        let turned_back = |body: &Value| {
            let [omega, phi, kappa] =
                ["omega_deg", "phi_deg", "kappa_deg"].map(|name| body[name].as_f64().unwrap().to_radians());
            rotation::camera_from_object(omega, phi, kappa)
        };
        let approximation = scene.approximation_body();
        let expected = scene.approximation.orientation;
        assert_relative_eq!(turned_back(&approximation), expected.camera_from_object, epsilon = 1e-12);
        assert_eq!(numbers(&approximation["position"]["coordinates"]), expected.projection_centre_m.as_slice());
        let truth = scene.truth();
        assert_relative_eq!(turned_back(&truth), scene.true_orientation.camera_from_object, epsilon = 1e-12);
        let first_row = numbers(&truth["rotation_matrix"][0]);
        assert_eq!(first_row[1], scene.true_orientation.camera_from_object.matrix()[(0, 1)]);
        assert_eq!(truth["frame"], approximation["position"]["crs"]);
    }

    #[test]
    fn a_folder_that_is_not_there_is_named() {
        let error = small_scene().write(Path::new("/nowhere/at/all")).unwrap_err();
        assert!(error.to_string().contains("/nowhere/at/all/camera.json"), "{error}");
    }
}
