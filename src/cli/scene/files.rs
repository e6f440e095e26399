//! The files of `gable scene`: the fish-eye camera, the targets, and what is left for the service.

use std::path::{Path, PathBuf};

use crate::geometry::{Brown, Crs, Fisheye, Projection};
use crate::scenes::Scene;
use crate::scenes::resect::Target;
use anyhow::{Context as _, bail};
use nalgebra::{Vector2, Vector3};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::cli::print;

/// A fish-eye camera; the keys are those of `POST /cameras`, and `projection`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    #[serde(rename = "name", default)]
    _name: String,
    image_size_px: [u32; 2],
    projection: ProjectionName,
    principal_distance_px: f64,
    principal_point_px: [f64; 2],
    #[serde(default)]
    distortion: Distortion,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum ProjectionName {
    Equidistant,
    Equisolid,
    Brown,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Distortion {
    model: Option<Model>,
    k1: f64,
    k2: f64,
    k3: f64,
    p1: f64,
    p2: f64,
    b1_px: f64,
    b2_px: f64,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Model {
    Brown,
}

/// The targets of a template, measured in the first picture.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TargetFile {
    points: Vec<TargetPoint>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TargetPoint {
    #[serde(default)]
    name: Option<String>,
    xy_m: Option<[f64; 2]>,
    xyz_m: Option<[f64; 3]>,
    px: [f64; 2],
}

pub(super) fn camera(file: &Path) -> anyhow::Result<Fisheye> {
    let read: CameraFile = json(file)?;
    let Distortion { model: _, k1, k2, k3, p1, p2, b1_px, b2_px } = read.distortion;
    let projection = match read.projection {
        ProjectionName::Equidistant => Projection::Equidistant,
        ProjectionName::Equisolid => Projection::Equisolid,
        ProjectionName::Brown => Projection::Perspective,
    };
    Fisheye::new(
        read.image_size_px,
        projection,
        read.principal_distance_px,
        read.principal_point_px.into(),
        Brown { k1, k2, k3, p1, p2, b1_px, b2_px },
    )
    .with_context(|| file.display().to_string())
}

/// The targets and their names; one without a name is called by its number.
pub(super) fn targets(file: &Path) -> anyhow::Result<Vec<(String, Target)>> {
    let read: TargetFile = json(file)?;
    let target = |(point, number): (TargetPoint, usize)| {
        let name = point.name.unwrap_or_else(|| number.to_string());
        let template_m = match (point.xy_m, point.xyz_m) {
            (Some([x, y]), None) => Vector3::new(x, y, 0.0),
            (None, Some(xyz_m)) => xyz_m.into(),
            _ => bail!("{}: the point {name} needs either xy_m or xyz_m", file.display()),
        };
        Ok((name, Target { template_m, pixel: point.px.into() }))
    };
    read.points.into_iter().zip(1..).map(target).collect()
}

fn json<T: DeserializeOwned>(file: &Path) -> anyhow::Result<T> {
    let name = || file.display().to_string();
    let text = std::fs::read(file).with_context(|| format!("cannot read {}", name()))?;
    let mut reader = serde_json::Deserializer::from_slice(&text);
    serde_path_to_error::deserialize(&mut reader).with_context(name)
}

/// A reference point: where it is said to be, and how well that is known.
#[derive(Debug)]
pub(super) struct Reference<'a> {
    pub(super) crs: &'a Crs,
    /// The height is ellipsoidal.
    pub(super) coordinates: [f64; 3],
    pub(super) sigma_m: f64,
}

/// Writes a scene's picture and its description, and gives their names.
pub(super) fn write(folder: &Path, name: &str, scene: &Scene, at: &Reference<'_>) -> anyhow::Result<[PathBuf; 2]> {
    let [picture, description] = ["png", "json"].map(|ending| folder.join(format!("{}.{ending}", file_name(name))));
    let body = serde_json::json!({
        "name": name,
        "gsd_m": scene.gsd_m,
        "azimuth_of_image_up_deg": scene.azimuth_of_image_up_rad.to_degrees(),
        "sigma_azimuth_deg": scene.sigma_azimuth_rad.to_degrees(),
        "reference_px": [scene.reference_px.x, scene.reference_px.y],
        "reference": {"crs": at.crs.to_string(), "coordinates": at.coordinates},
        "sigma_m": at.sigma_m,
    });
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let grey = scene.grey.iter().map(|grey| grey.round().clamp(0.0, 255.0) as u8).collect();
    let (width, height) = (u32::try_from(scene.width)?, u32::try_from(scene.height)?);
    let image = image::GrayImage::from_raw(width, height, grey).context("the scene has another size than it says")?;
    image.save(&picture).with_context(|| format!("cannot write {}", picture.display()))?;
    let text = format!("{}\n", serde_json::to_string_pretty(&body)?);
    std::fs::write(&description, text).with_context(|| format!("cannot write {}", description.display()))?;
    Ok([picture, description])
}

/// The line that sends a scene to the service.
pub(super) fn sending([picture, description]: &[PathBuf; 2]) -> String {
    let quoted = |path: &Path| path.display().to_string().replace('\'', "'\\''");
    format!(
        "curl -F 'file=@{}' -F 'scene=<{}' http://localhost:8080/api/v1/control-scenes",
        quoted(picture),
        quoted(description)
    )
}

/// Names of scenes are free; those of files here are plain.
fn file_name(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || c == '-' || c == '_' { c } else { '-' };
    name.chars().map(plain).collect()
}

/// `x,y` as clap reads it.
pub(super) fn pair(text: &str) -> Result<Vector2<f64>, String> {
    numbers::<2>(text, "x,y").map(Vector2::from)
}

/// `x,y,z` as clap reads it.
pub(super) fn triple(text: &str) -> Result<[f64; 3], String> {
    numbers::<3>(text, "x,y,z")
}

fn numbers<const N: usize>(text: &str, form: &str) -> Result<[f64; N], String> {
    let wrong = || format!("it must be {N} numbers, as {form}");
    let read: Vec<f64> =
        text.split(',').map(|word| word.trim().parse()).collect::<Result<_, _>>().map_err(|_| wrong())?;
    read.try_into().ok().filter(|read: &[f64; N]| read.iter().all(|v| v.is_finite())).ok_or_else(wrong)
}

/// A name that a scene may have.
pub(super) fn scene_name(text: &str) -> Result<String, String> {
    let name = text.trim();
    if name.is_empty() { Err("a scene needs a name".to_owned()) } else { Ok(name.to_owned()) }
}

/// A positive number.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("it must be a positive number".to_owned()),
    }
}

/// A number of at least 0.
pub(super) fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("it must be a number of at least 0".to_owned()),
    }
}

/// Says so where heights are taken as ellipsoidal for want of better knowledge.
pub(super) fn note_on_heights(crs: &Crs, geoid_undulation_m: Option<f64>) -> anyhow::Result<()> {
    if crs.assumes_ellipsoidal_heights() && geoid_undulation_m.is_none() {
        print(&format!(
            "height     {crs} says nothing about heights: taken as ellipsoidal; --geoid-undulation-m makes them so"
        ))?;
    }
    Ok(())
}

/// The same position with its height above the ellipsoid.
pub(super) fn ellipsoidal(crs: &Crs, position: [f64; 3], geoid_undulation_m: Option<f64>) -> anyhow::Result<[f64; 3]> {
    crs.geocentric_from_position(position, geoid_undulation_m)?;
    let [x, y, z] = position;
    Ok([x, y, z + geoid_undulation_m.unwrap_or(0.0)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_never_lead_out_of_the_folder() {
        assert_eq!(file_name("church-square_2"), "church-square_2");
        assert_eq!(file_name("../x y.z"), "---x-y-z");
    }

    #[test]
    fn numbers_are_read_with_their_number() {
        assert_eq!(triple("1, -2.5,3e2"), Ok([1.0, -2.5, 300.0]));
        for wrong in ["1,2", "1,2,3,4", "1,2,x", "1,2,nan"] {
            assert!(triple(wrong).is_err(), "{wrong}");
        }
        assert!(positive("0").is_err() && not_negative("0").is_ok() && positive("inf").is_err());
    }
}
