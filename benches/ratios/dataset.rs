//! The real images of `../shared/bench`: what a run of the pipeline needs, without a service in between.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result};
use gable::control::{Source, geojson};
use gable::diagnosis::Policy;
use gable::geometry::{Brown, Camera, Crs, ExteriorOrientation, LocalFrame, rotation};
use gable::jobs::active::shipped_classifier;
use gable::orientation::ControlPoint;
use gable::pipeline::{Approximation, Judge, Outcome, Task, Tolerance};
use gable::scenes::Scene;
use nalgebra::{Vector2, Vector3};
use serde_json::Value;

/// One of the datasets.
pub struct Dataset {
    pub camera: Camera,
    pub images: Vec<Image>,
    pub tolerance_gsd: f64,
    ground_height_m: f64,
    frame: LocalFrame,
}

/// One image with its control in the local frame of its own approximation.
pub struct Image {
    pub file: PathBuf,
    pub task: Task,
    pub control: Vec<ControlPoint>,
    /// The control scenes, in the same frame.
    pub scenes: Vec<ControlPoint>,
    pub gsd_m: f64,
    local: LocalFrame,
    reference: ExteriorOrientation,
}

impl Dataset {
    /// Reads a folder; images with at least `least_in_view` control points in view, with the attitude approximation
    /// or another.
    pub fn read(folder: &Path, approximation: &str, least_in_view: u64) -> Result<Self> {
        let json = |name: &str| -> Result<Value> {
            let path = folder.join(name);
            let text = std::fs::read(&path).with_context(|| path.display().to_string())?;
            Ok(serde_json::from_slice(&text)?)
        };
        let (data, camera) = (json("dataset.json")?, camera(&json("camera.json")?)?);
        let crs = Crs::parse(data["control_crs"].as_str().context("control_crs")?)?;
        let body = std::fs::read(folder.join("control_points.geojson"))?;
        let control = geojson::parse(&body, &Source { crs: &crs, geoid_undulation_m: None })?.control_points;
        let pictures = folder.join(data["images_folder"].as_str().unwrap_or("images"));
        let frame = topocentric(data["frame"].as_str().context("frame")?)?;
        let scenes = scenes(&folder.join(data["scenes_folder"].as_str().unwrap_or(".")), &frame)?;
        let tolerance_gsd = number(&data["tolerance_gsd"])?;
        let mut images = Vec::new();
        let judge = Judge { classifier: shipped_classifier()?.loaded.classifier, policy: Policy::default() };
        for entry in json("images.json")?.as_array().context("images.json is no list")? {
            if entry["control_points_in_view"].as_u64().is_none_or(|n| n < least_in_view) {
                continue;
            }
            let (local, approximation) = approximation_of(&entry["approximations"][approximation])?;
            let mut control: Vec<ControlPoint> = control.iter().map(|(_, point)| point.in_frame(&local)).collect();
            control.sort_by(|a, b| a.name.cmp(&b.name));
            let reference = &entry["reference"];
            let rows = reference["rotation_matrix"].as_array().context("rotation_matrix")?;
            let rows = rows.iter().map(numbers).collect::<Result<Vec<_>>>()?.concat();
            images.push(Image {
                file: pictures.join(entry["file"].as_str().context("file")?),
                task: Task {
                    camera,
                    approximation,
                    check: Arc::default(),
                    tolerance: Tolerance::Gsd(tolerance_gsd),
                    judge: judge.clone(),
                },
                control,
                scenes: scenes
                    .iter()
                    .map(|(scene, at_m)| ControlPoint { reference_m: local.from_geocentric(*at_m), ..scene.clone() })
                    .collect(),
                gsd_m: number(&entry["gsd_m"])?,
                local,
                reference: ExteriorOrientation {
                    projection_centre_m: Vector3::from_column_slice(&numbers(&reference["projection_centre"])?),
                    camera_from_object: nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_row_slice(
                        &rows,
                    )),
                },
            });
        }
        Ok(Self { camera, images, tolerance_gsd, ground_height_m: number(&data["ground_height_m"])?, frame })
    }

    /// D_max of the paper in ground sample distances: the largest planimetric distance on the ground between the rays
    /// of an outcome and of the reference, over 3 x 3 points of the image.
    pub fn d_max_gsd(&self, image: &Image, outcome: &Outcome) -> Option<f64> {
        let found = &outcome.estimate.as_ref()?.orientation;
        let turn = image.local.local_from_geocentric() * self.frame.local_from_geocentric().inverse();
        let estimate = ExteriorOrientation {
            projection_centre_m: self.frame.from_geocentric(image.local.to_geocentric(found.projection_centre_m)),
            camera_from_object: found.camera_from_object * turn,
        };
        let [width, height] = [self.camera.width_px, self.camera.height_px].map(f64::from);
        let c = self.camera.principal_distance_px;
        let mut worst: f64 = 0.0;
        for (u, v) in [0.05, 0.5, 0.95].iter().flat_map(|u| [0.05, 0.5, 0.95].map(|v| (u * width, v * height))) {
            let reduced = self.camera.reduced_from_pixel(Vector2::new(u, v))?;
            let ground = |o: &ExteriorOrientation| o.ground_point_m(c, reduced, self.ground_height_m);
            let Some(b) = ground(&image.reference) else { continue };
            worst = worst.max((ground(&estimate)? - b).xy().norm());
        }
        Some(worst / image.gsd_m)
    }
}

impl Image {
    /// The reference orientation in the local frame of the image, in which its control is.
    pub fn true_orientation(&self, dataset: &Dataset) -> ExteriorOrientation {
        let turn = dataset.frame.local_from_geocentric() * self.local.local_from_geocentric().inverse();
        let centre_m = dataset.frame.to_geocentric(self.reference.projection_centre_m);
        ExteriorOrientation {
            projection_centre_m: self.local.from_geocentric(centre_m),
            camera_from_object: self.reference.camera_from_object * turn,
        }
    }
}

/// The scenes of a folder, with the geocentric places of their references.
fn scenes(folder: &Path, frame: &LocalFrame) -> Result<Vec<(ControlPoint, Vector3<f64>)>> {
    let list: Value = serde_json::from_slice(&std::fs::read(folder.join("scenes.json"))?)?;
    let scene = |entry: &Value| -> Result<(ControlPoint, Vector3<f64>)> {
        let file = folder.join("scenes").join(entry["file"].as_str().context("file")?);
        let picture = image::open(&file).with_context(|| file.display().to_string())?.to_luma8();
        let reference_px = Vector2::from_column_slice(&numbers(&entry["reference_px"])?);
        let scene = Scene {
            width: picture.width() as usize,
            height: picture.height() as usize,
            grey: picture.as_raw().iter().map(|grey| f32::from(*grey)).collect(),
            gsd_m: number(&entry["gsd_m"])?,
            azimuth_of_image_up_rad: number(&entry["azimuth_of_image_up_deg"])?.to_radians(),
            sigma_azimuth_rad: number(&entry["sigma_azimuth_deg"])?.to_radians(),
            reference_px,
        };
        let control_point = ControlPoint {
            name: entry["name"].as_str().context("name")?.to_owned(),
            sigma_m: number(&entry["sigma_m"])?,
            reference_m: Vector3::zeros(),
            edges_m: Vec::new(),
            edge_sigmas_m: Vec::new(),
            scene: Some(Arc::new(scene)),
        };
        Ok((control_point, frame.to_geocentric(triple(&entry["reference"]["coordinates"])?.into())))
    };
    list.as_array().context("scenes.json is no list")?.iter().map(scene).collect()
}

fn number(value: &Value) -> Result<f64> {
    value.as_f64().with_context(|| format!("{value} is no number"))
}

fn numbers(value: &Value) -> Result<Vec<f64>> {
    value.as_array().with_context(|| format!("{value} is no list"))?.iter().map(number).collect()
}

fn triple(value: &Value) -> Result<[f64; 3]> {
    numbers(value)?.try_into().map_err(|_| anyhow::anyhow!("{value} is not three numbers"))
}

fn camera(json: &Value) -> Result<Camera> {
    let size = json["image_size_px"].as_array().context("image_size_px")?;
    let side = |k: usize| size[k].as_u64().and_then(|n| u32::try_from(n).ok()).context("image_size_px");
    let point = numbers(&json["principal_point_px"])?;
    let term = |name: &str| json["distortion"][name].as_f64().unwrap_or(0.0);
    let brown = Brown {
        k1: term("k1"),
        k2: term("k2"),
        k3: term("k3"),
        p1: term("p1"),
        p2: term("p2"),
        b1_px: term("b1_px"),
        b2_px: term("b2_px"),
    };
    let principal_point_px = Vector2::new(point[0], point[1]);
    Ok(Camera::new([side(0)?, side(1)?], number(&json["principal_distance_px"])?, principal_point_px, brown)?)
}

/// As `jobs::request` makes it: the frame at the foot of the position on the ellipsoid.
fn approximation_of(json: &Value) -> Result<(LocalFrame, Approximation)> {
    let crs = Crs::parse(json["position"]["crs"].as_str().context("crs")?)?;
    let geocentric_m = crs.geocentric_from_position(triple(&json["position"]["coordinates"])?, None)?;
    let place = LocalFrame::about(geocentric_m);
    let frame = LocalFrame::at(place.longitude_deg(), place.latitude_deg(), 0.0);
    let radians = |name: &str| number(&json[name]).map(f64::to_radians);
    let approximation = Approximation {
        orientation: ExteriorOrientation {
            projection_centre_m: frame.from_geocentric(geocentric_m),
            camera_from_object: rotation::camera_from_object(
                radians("omega_deg")?,
                radians("phi_deg")?,
                radians("kappa_deg")?,
            ),
        },
        sigma_position_m: triple(&json["sigma_position_m"])?,
        sigma_tilt_rad: radians("sigma_tilt_deg")?,
        sigma_kappa_rad: Some(radians("sigma_kappa_deg")?),
    };
    Ok((frame, approximation))
}

/// The frame of a PROJ string as `dataset.json` has it.
fn topocentric(text: &str) -> Result<LocalFrame> {
    let term = |name: &str| {
        let value = text.split_whitespace().find_map(|part| part.strip_prefix(name)?.strip_prefix('='));
        value.with_context(|| format!("{name} in {text}"))?.parse::<f64>().context("a number")
    };
    Ok(LocalFrame::at(term("+lon_0")?, term("+lat_0")?, term("+h_0")?))
}
