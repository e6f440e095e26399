//! Folders of real images with control and reference orientations, as in `../shared/bench`.

use std::path::{Path, PathBuf};

use crate::configuration::Configuration;
use crate::control::geojson::Rejection;
use crate::control::{Kinds, Source, geojson};
use crate::geometry::{Camera, Crs, ExteriorOrientation, LocalFrame, rotation};
use crate::http::cameras::DigitalCameraRequest;
use crate::http::control_scenes::CheckedScene;
use crate::orientation::ControlPoint;
use crate::pipeline::Approximation;
use anyhow::Context as _;
use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use serde::Deserialize;

use super::orient::read_json;
use super::scenes::{Bounds, ReadScene, SceneList};

/// A dataset in its local frame.
pub(super) struct Dataset {
    pub(super) name: String,
    pub(super) camera: Camera,
    /// Of the kinds that were chosen: buildings, and after them scenes.
    pub(super) control: Vec<ControlPoint>,
    pub(super) ground_height_m: f64,
    pub(super) tolerance_gsd: f64,
    pub(super) images: Vec<DatasetImage>,
}

/// An image of a dataset.
pub(super) struct DatasetImage {
    pub(super) file: PathBuf,
    /// Of the kinds that were chosen.
    pub(super) control_points_in_view: usize,
    pub(super) gsd_m: f64,
    pub(super) reference: ExteriorOrientation,
    /// Omega and phi roughly known.
    pub(super) attitude: Approximation,
    /// Omega and phi taken as 0.
    pub(super) nadir: Approximation,
}

/// `dataset.json`, as far as it is of interest here.
#[derive(Deserialize)]
struct Description {
    name: String,
    frame: String,
    control_crs: String,
    ground_height_m: f64,
    tolerance_gsd: f64,
    images_folder: Option<PathBuf>,
    scenes_folder: Option<PathBuf>,
}

/// An entry of `images.json`.
#[derive(Deserialize)]
struct Entry {
    file: PathBuf,
    control_points_in_view: usize,
    #[serde(default)]
    control_scenes_in_view: usize,
    gsd_m: f64,
    approximations: Approximations,
    reference: Reference,
}

#[derive(Deserialize)]
struct Approximations {
    attitude: Given,
    nadir: Given,
}

#[derive(Deserialize)]
struct Given {
    position: Position,
    sigma_position_m: [f64; 3],
    omega_deg: f64,
    phi_deg: f64,
    kappa_deg: f64,
    sigma_tilt_deg: f64,
    sigma_kappa_deg: f64,
}

#[derive(Deserialize)]
struct Position {
    crs: String,
    coordinates: [f64; 3],
}

#[derive(Deserialize)]
struct Reference {
    projection_centre: [f64; 3],
    rotation_matrix: [[f64; 3]; 3],
}

impl Dataset {
    /// Reads the folder with the pictures of the scenes, if they are wanted, and without the images.
    pub(super) fn read(folder: &Path, kinds: Kinds) -> anyhow::Result<Self> {
        let description: Description = lenient_json(&folder.join("dataset.json"))?;
        let camera: DigitalCameraRequest = read_json(&folder.join("camera.json"))?;
        let camera = camera.camera().with_context(|| folder.join("camera.json").display().to_string())?;
        let frame = LocalFrame::about(Crs::parse(&description.frame)?.geocentric_from_position([0.0; 3], None)?);
        let mut control = Vec::new();
        if kinds.lines {
            control = buildings(folder, &description, &frame)?;
        }
        if kinds.scenes {
            control.append(&mut scenes(folder, &description, &frame)?);
        }
        let entries: Vec<Entry> = lenient_json(&folder.join("images.json"))?;
        let pictures = folder.join(description.images_folder.as_deref().unwrap_or(Path::new("images")));
        let image = |entry: Entry| {
            let rows = Matrix3::from_row_slice(entry.reference.rotation_matrix.as_flattened());
            Ok(DatasetImage {
                file: pictures.join(&entry.file),
                control_points_in_view: if kinds.lines { entry.control_points_in_view } else { 0 }
                    + if kinds.scenes { entry.control_scenes_in_view } else { 0 },
                gsd_m: entry.gsd_m,
                reference: ExteriorOrientation {
                    projection_centre_m: Vector3::from(entry.reference.projection_centre),
                    camera_from_object: Rotation3::from_matrix_unchecked(rows),
                },
                attitude: entry.approximations.attitude.in_frame(&frame)?,
                nadir: entry.approximations.nadir.in_frame(&frame)?,
            })
        };
        Ok(Self {
            name: description.name,
            camera,
            control,
            ground_height_m: description.ground_height_m,
            tolerance_gsd: description.tolerance_gsd,
            images: entries.into_iter().map(image).collect::<anyhow::Result<_>>()?,
        })
    }
}

fn buildings(folder: &Path, description: &Description, frame: &LocalFrame) -> anyhow::Result<Vec<ControlPoint>> {
    let body = std::fs::read(folder.join("control_points.geojson")).context("cannot read control_points.geojson")?;
    let crs = Crs::parse(&description.control_crs)?;
    let parsed = geojson::parse(&body, &Source { crs: &crs, geoid_undulation_m: None })?;
    Ok(parsed.control_points.iter().map(|(_, point)| point.in_frame(frame)).collect())
}

fn scenes(folder: &Path, description: &Description, frame: &LocalFrame) -> anyhow::Result<Vec<ControlPoint>> {
    let list = folder.join(description.scenes_folder.as_deref().unwrap_or(Path::new(""))).join("scenes.json");
    let name = list.display().to_string();
    let list = SceneList::read(&list)?;
    let bounds = Bounds::of(&Configuration::default());
    let scene = |read: Result<ReadScene, Rejection>| {
        let CheckedScene { content, grey, .. } = read
            .map_err(|rejection| anyhow::anyhow!("{name}: scene {}: {}", rejection.index, rejection.detail))?
            .checked;
        Ok(content.in_frame(frame, grey))
    };
    list.scenes(&bounds).map(scene).collect()
}

impl Given {
    /// In the frame of the dataset; its angles are about the axes at the position.
    fn in_frame(&self, frame: &LocalFrame) -> anyhow::Result<Approximation> {
        let geocentric_m = Crs::parse(&self.position.crs)?.geocentric_from_position(self.position.coordinates, None)?;
        let [omega, phi, kappa] = [self.omega_deg, self.phi_deg, self.kappa_deg].map(f64::to_radians);
        let camera_from_there = rotation::camera_from_object(omega, phi, kappa);
        let there_from_geocentric = LocalFrame::about(geocentric_m).local_from_geocentric();
        Ok(Approximation {
            orientation: ExteriorOrientation {
                projection_centre_m: frame.from_geocentric(geocentric_m),
                camera_from_object: camera_from_there * there_from_geocentric * frame.local_from_geocentric().inverse(),
            },
            sigma_position_m: self.sigma_position_m,
            sigma_tilt_rad: self.sigma_tilt_deg.to_radians(),
            sigma_kappa_rad: Some(self.sigma_kappa_deg.to_radians()),
        })
    }
}

/// An approximation drawn anew about the true orientation, with the standard deviations that it states.
pub(super) fn drawn(stated: &Approximation, truth: &ExteriorOrientation, seed: u64) -> Approximation {
    let mut draws = ChaCha8Rng::seed_from_u64(seed);
    // Box and Muller
    let mut normal = || {
        let (above_zero, turn) = (1.0 - draws.random::<f64>(), std::f64::consts::TAU * draws.random::<f64>());
        (-2.0 * above_zero.ln()).sqrt() * turn.cos()
    };
    let shift_m = Vector3::from(stated.sigma_position_m.map(|sigma_m| sigma_m * normal()));
    let [omega, phi, kappa] = rotation::angles(&truth.camera_from_object);
    let mut erring = |angle: f64, sigma: f64| angle + sigma * normal();
    let tilt = stated.sigma_tilt_rad;
    let (omega, phi) = (erring(omega, tilt), erring(phi, tilt));
    let kappa = erring(kappa, stated.sigma_kappa_rad.unwrap_or(0.0));
    let orientation = ExteriorOrientation {
        projection_centre_m: truth.projection_centre_m + shift_m,
        camera_from_object: rotation::camera_from_object(omega, phi, kappa),
    };
    Approximation { orientation, ..stated.clone() }
}

/// Reads JSON of which some members are of no interest.
fn lenient_json<T: serde::de::DeserializeOwned>(file: &Path) -> anyhow::Result<T> {
    let name = || file.display().to_string();
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", name()))?;
    serde_json::from_slice(&text).with_context(name)
}
