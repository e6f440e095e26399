//! `gable simulate --likeness`: a mixture beside real photographs.

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use gable::control::{Source, geojson};
use gable::geometry::{Camera, Crs, ExteriorOrientation, LocalFrame, rotation};
use gable::http::cameras::CameraRequest;
use gable::imagery::{ImageFile, Limits};
use gable::orientation::ControlPoint;
use gable::simulation::Scene;
use gable::study::Mixture;
use gable::study::likeness::{Known, Likeness, measure, side_by_side};
use nalgebra::{Matrix3, Rotation3, Vector3};
use rayon::prelude::*;
use serde::Deserialize;

use super::super::orient::read_json;
use super::super::print;

/// A dataset's `dataset.json`, as far as it is of interest here.
#[derive(Deserialize)]
struct Description {
    name: String,
    frame: String,
    control_crs: String,
    images_folder: Option<PathBuf>,
}

/// An entry of `images.json`.
#[derive(Deserialize)]
struct Image {
    file: PathBuf,
    approximations: Approximations,
    reference: Reference,
}

#[derive(Deserialize)]
struct Approximations {
    attitude: Attitude,
}

#[derive(Deserialize)]
struct Attitude {
    position: Position,
    omega_deg: f64,
    phi_deg: f64,
    kappa_deg: f64,
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

/// Prints the statistics of a dataset and of a mixture side by side.
pub(super) fn compare(mixture: Mixture, seeds: Range<u64>, dataset: &Path) -> anyhow::Result<()> {
    let (name, real) = of_dataset(dataset)?;
    let simulated = merged(seeds.into_par_iter().map(|seed| of_scene(mixture, seed)).collect::<Result<_, _>>()?);
    print(&side_by_side(&[(name, real), (mixture.name().to_owned(), simulated)]))
}

fn merged(images: Vec<Likeness>) -> Likeness {
    let mut all = Likeness::default();
    images.into_iter().for_each(|image| all.add(image));
    all
}

fn of_scene(mixture: Mixture, seed: u64) -> anyhow::Result<Likeness> {
    let scene = Scene::draw(seed, &mixture.settings(seed))?;
    // control and images of the benchmark are of the same flights: none of it is outdated
    let sound: Vec<ControlPoint> =
        scene.control.iter().filter(|c| c.fault.is_none()).map(|c| c.control_point.clone()).collect();
    Ok(measure(&Known {
        picture: &scene.picture(),
        camera: &scene.camera,
        truth: scene.true_orientation,
        approximate: scene.approximation.orientation,
        control: &sound,
    })?)
}

fn of_dataset(folder: &Path) -> anyhow::Result<(String, Likeness)> {
    let description: Description = lenient_json(&folder.join("dataset.json"))?;
    let camera: CameraRequest = read_json(&folder.join("camera.json"))?;
    let camera = camera.camera().with_context(|| folder.join("camera.json").display().to_string())?;
    let frame = LocalFrame::about(Crs::parse(&description.frame)?.geocentric_from_position([0.0; 3], None)?);
    let body = std::fs::read(folder.join("control_points.geojson")).context("cannot read control_points.geojson")?;
    let crs = Crs::parse(&description.control_crs)?;
    let parsed = geojson::parse(&body, &Source { crs: &crs, geoid_undulation_m: None })?;
    let control: Vec<ControlPoint> = parsed.control_points.iter().map(|(_, point)| point.in_frame(&frame)).collect();
    let images: Vec<Image> = lenient_json(&folder.join("images.json"))?;
    let pictures = folder.join(description.images_folder.as_deref().unwrap_or(Path::new("images")));
    let measured: anyhow::Result<Vec<Likeness>> = images
        .iter()
        .map(|image| {
            of_image(image, &pictures, &camera, &frame, &control).with_context(|| image.file.display().to_string())
        })
        .collect();
    Ok((description.name, merged(measured?)))
}

fn of_image(
    image: &Image,
    pictures: &Path,
    camera: &Camera,
    frame: &LocalFrame,
    control: &[ControlPoint],
) -> anyhow::Result<Likeness> {
    let Reference { projection_centre, rotation_matrix } = &image.reference;
    let rows = Matrix3::from_row_slice(rotation_matrix.as_flattened());
    let truth = ExteriorOrientation {
        projection_centre_m: Vector3::from(*projection_centre),
        camera_from_object: Rotation3::from_matrix_unchecked(rows),
    };
    let Attitude { position, omega_deg, phi_deg, kappa_deg } = &image.approximations.attitude;
    let geocentric_m = Crs::parse(&position.crs)?.geocentric_from_position(position.coordinates, None)?;
    let [omega, phi, kappa] = [omega_deg, phi_deg, kappa_deg].map(|angle| angle.to_radians());
    // the angles are about the axes at the position
    let camera_from_there = rotation::camera_from_object(omega, phi, kappa);
    let there_from_geocentric = LocalFrame::about(geocentric_m).local_from_geocentric();
    let approximate = ExteriorOrientation {
        projection_centre_m: frame.from_geocentric(geocentric_m),
        camera_from_object: camera_from_there * there_from_geocentric * frame.local_from_geocentric().inverse(),
    };
    let picture = ImageFile::open(&pictures.join(&image.file), &Limits::default())?;
    Ok(measure(&Known { picture: &picture, camera, truth, approximate, control })?)
}

/// Reads JSON of which some members are of no interest.
fn lenient_json<T: serde::de::DeserializeOwned>(file: &Path) -> anyhow::Result<T> {
    let name = || file.display().to_string();
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", name()))?;
    serde_json::from_slice(&text).with_context(name)
}
