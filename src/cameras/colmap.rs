//! COLMAP's `cameras.txt`: `CAMERA_ID MODEL WIDTH HEIGHT PARAMS…`, a camera a line. Pixels are counted from the corner, as
//! in the contract.

use nalgebra::Vector2;

use super::conversion::{Axis, Lens, convert};
use super::text::{number, pixels};
use super::{CameraFileError, Converted, Given, opencv};

/// A camera of the file.
struct Entry<'a> {
    line: usize,
    model: &'a str,
    size_px: [u32; 2],
    parameters: Vec<f64>,
}

/// The names of the models that are read, and of those that are known and cannot be.
const MODELS: [&str; 6] = ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV"];
const OTHERS: [&str; 6] = [
    "OPENCV_FISHEYE",
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
];

/// Whether a text is such a list.
pub(super) fn is_one(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let model = lines.next().and_then(|line| line.split_whitespace().nth(1));
    model.is_some_and(|model| MODELS.contains(&model) || OTHERS.contains(&model))
}

pub(super) fn read(given: &Given<'_>) -> Result<Converted, CameraFileError> {
    let lines = given.text.lines().enumerate().map(|(at, line)| (at + 1, line.trim()));
    let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (name, entry) = given.choose(lines.map(|(line, text)| entry(line, text)).collect::<Result<_, _>>()?)?;
    let size_px = given.size_px(Some(entry.size_px))?;
    let (axis, lens) = lens(&entry)?;
    Ok(Converted { name: Some(name), conversion: convert(size_px, &axis, &lens)?, warnings: Vec::new() })
}

fn entry(line: usize, text: &str) -> Result<(String, Entry<'_>), CameraFileError> {
    let wrong = |detail: String| CameraFileError::Text { place: format!("line {line}"), detail };
    let words: Vec<&str> = text.split_whitespace().collect();
    let [name, model, width, height, parameters @ ..] = words.as_slice() else {
        return Err(wrong("it must be CAMERA_ID MODEL WIDTH HEIGHT PARAMS…".into()));
    };
    let in_line = |error: CameraFileError| wrong(error.to_string());
    let size = |name: &str, text: &str| number(name, text).and_then(|value| pixels(name, value)).map_err(in_line);
    let parameters: Result<Vec<f64>, _> = parameters.iter().map(|word| number("PARAMS", word)).collect();
    let size_px = [size("WIDTH", width)?, size("HEIGHT", height)?];
    Ok(((*name).to_owned(), Entry { line, model, size_px, parameters: parameters.map_err(in_line)? }))
}

fn lens(entry: &Entry<'_>) -> Result<(Axis, Lens), CameraFileError> {
    let axis = |fx: f64, fy: f64, cx: f64, cy: f64| Axis {
        principal_distance_px: fy,
        principal_point_px: Vector2::new(cx, cy),
        b1_px: fx - fy,
        b2_px: 0.0,
    };
    Ok(match (entry.model, entry.parameters.as_slice()) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => (axis(f, f, cx, cy), opencv::lens(&[])?),
        ("PINHOLE", &[fx, fy, cx, cy]) => (axis(fx, fy, cx, cy), opencv::lens(&[])?),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => (axis(f, f, cx, cy), opencv::lens(&[k, 0.0, 0.0, 0.0])?),
        ("RADIAL", &[f, cx, cy, k1, k2]) => (axis(f, f, cx, cy), opencv::lens(&[k1, k2, 0.0, 0.0])?),
        ("OPENCV", &[fx, fy, cx, cy, ref coefficients @ ..]) if coefficients.len() == 4 => {
            (axis(fx, fy, cx, cy), opencv::lens(coefficients)?)
        }
        ("FULL_OPENCV", &[fx, fy, cx, cy, ref coefficients @ ..]) if coefficients.len() == 8 => {
            (axis(fx, fy, cx, cy), opencv::lens(coefficients)?)
        }
        (model, parameters) if MODELS.contains(&model) => {
            let detail = format!("{model} with {} parameters", parameters.len());
            return Err(CameraFileError::Text { place: format!("line {}", entry.line), detail });
        }
        (model, _) => {
            let detail = format!("line {}; of COLMAP's models {} are read", entry.line, MODELS.join(", "));
            return Err(CameraFileError::Model { model: model.to_owned(), detail });
        }
    })
}
