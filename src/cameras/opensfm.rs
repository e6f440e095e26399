//! OpenSfM's `camera_models.json` and OpenDroneMap's `cameras.json`; also the cameras of a `reconstruction.json`.
//!
//! Lengths are in units of the longer side of the image, the principal point is counted from its middle. So the same
//! calibration serves images of any size with the same ratio of sides.

use nalgebra::Vector2;
use serde_json::{Map, Value};

use super::conversion::{Axis, convert};
use super::text::pixels;
use super::{CameraFileError, Converted, Given, field, opencv};

/// Projections that are Brown's with fewer coefficients.
const MODELS: [&str; 4] = ["perspective", "brown", "simple_radial", "radial"];
/// Ratios of sides that differ by more are of another image.
const RATIO_TOLERANCE: f64 = 0.005;

/// Whether a text is such a file.
pub(super) fn is_one(text: &str) -> bool {
    text.contains("\"projection_type\"")
}

pub(super) fn read(given: &Given<'_>) -> Result<Converted, CameraFileError> {
    let value: Value = serde_json::from_str(given.text).map_err(|error| CameraFileError::Text {
        place: format!("line {}", error.line()),
        detail: format!("it is no JSON: {error}"),
    })?;
    let mut cameras = Vec::new();
    gather(&value, 0, &mut cameras);
    let (name, camera) = given.choose(cameras)?;
    let number = |key: &str| match camera.get(key) {
        Some(value) => value.as_f64().map(Some).ok_or_else(|| field(key, format!("{value} is no number"))),
        None => Ok(None),
    };
    let model = camera.get("projection_type").and_then(Value::as_str).unwrap_or_default();
    if !MODELS.contains(&model) {
        let detail = format!("of OpenSfM's models {} are read", MODELS.join(", "));
        return Err(CameraFileError::Model { model: model.to_owned(), detail });
    }
    let side = |key: &str| number(key)?.ok_or_else(|| field(key, "it is missing")).and_then(|v| pixels(key, v));
    let size_px = scaled(given, [side("width")?, side("height")?])?;
    let [width, height] = size_px.map(f64::from);
    let longer = width.max(height);
    let focal = |keys: [&str; 2]| -> Result<f64, CameraFileError> {
        let found = number(keys[0])?.map_or_else(|| number(keys[1]), |value| Ok(Some(value)))?;
        found.ok_or_else(|| field(keys[0], "it is missing"))
    };
    let (fx, fy) = (focal(["focal_x", "focal"])? * longer, focal(["focal_y", "focal"])? * longer);
    let or_zero = |key: &str| Ok::<f64, CameraFileError>(number(key)?.unwrap_or(0.0));
    let axis = Axis {
        principal_distance_px: fy,
        principal_point_px: Vector2::new(width, height) / 2.0 + longer * Vector2::new(or_zero("c_x")?, or_zero("c_y")?),
        b1_px: fx - fy,
        b2_px: 0.0,
    };
    let coefficients = [or_zero("k1")?, or_zero("k2")?, or_zero("p1")?, or_zero("p2")?, or_zero("k3")?];
    let conversion = convert(size_px, &axis, &opencv::lens(&coefficients)?)?;
    Ok(Converted { name: Some(name), conversion, warnings: Vec::new() })
}

/// All cameras with their names: in the file itself, in `cameras`, or in the reconstructions of a list.
fn gather<'a>(value: &'a Value, depth: usize, cameras: &mut Vec<(String, &'a Map<String, Value>)>) {
    match value {
        Value::Array(items) if depth == 0 => items.iter().for_each(|item| gather(item, 1, cameras)),
        Value::Object(members) => {
            if let Some(Value::Object(_)) = members.get("cameras") {
                return gather(&members["cameras"], 1, cameras);
            }
            for (name, member) in members {
                let Value::Object(camera) = member else { continue };
                if camera.contains_key("projection_type") && !cameras.iter().any(|(known, _)| known == name) {
                    cameras.push((name.clone(), camera));
                }
            }
        }
        _ => {}
    }
}

/// The size that was given, if the file's has its ratio of sides.
fn scaled(given: &Given<'_>, told: [u32; 2]) -> Result<[u32; 2], CameraFileError> {
    let Some(wanted) = given.image_size_px else { return Ok(told) };
    let ratio = |[width, height]: [u32; 2]| f64::from(width) / f64::from(height.max(1));
    if (ratio(wanted) / ratio(told) - 1.0).abs() > RATIO_TOLERANCE {
        let detail = format!("the calibration is of {} x {} px, another ratio of sides", told[0], told[1]);
        return Err(CameraFileError::Contradiction { parameter: "image_size_px", detail });
    }
    Ok(wanted)
}
