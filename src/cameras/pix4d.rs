//! Pix4D: `…_pix4d_calibrated_internal_camera_parameters.cam`, in millimetres or in pixels.
//!
//! The principal point is counted from the corner. Pix4D's article on its parameters has x_d = x (1 + K1 r² + K2 r⁴ +
//! K3 r⁶) + 2 T1 x y + T2 (r² + 2 x²), which is the contract's form; it leaves open which way the axes of the tangential
//! terms run, so that these are taken as the contract's and a warning says so.

use nalgebra::Vector2;

use super::conversion::{Axis, Lens, convert};
use super::text::number;
use super::{CameraFileError, Converted, Given, field};
use crate::geometry::Brown;

const HEAD: &str = "Pix4D camera calibration file";

/// A calibration of the file.
#[derive(Default)]
struct Entry {
    /// Width and height of the sensor in millimetres.
    sensor_mm: Option<[f64; 2]>,
    in_pixels: bool,
    values: Vec<(String, f64)>,
}

/// Whether a text is such a file.
pub(super) fn is_one(text: &str) -> bool {
    text.contains(HEAD)
}

pub(super) fn read(given: &Given<'_>) -> Result<Converted, CameraFileError> {
    let (name, entry) = given.choose(entries(given.text)?)?;
    let value = |key: &str| entry.values.iter().find(|(known, _)| known.eq_ignore_ascii_case(key)).map(|found| found.1);
    let needed = |key: &str| value(key).ok_or_else(|| field(key, "it is missing"));
    let or_zero = |key: &str| value(key).unwrap_or(0.0);
    let size_px = given.size_px(None)?;
    let per_unit = entry.pixels_per_unit(given, size_px)?;
    let axis = Axis {
        principal_distance_px: needed("F")? * per_unit,
        principal_point_px: Vector2::new(needed("Px")?, needed("Py")?) * per_unit,
        b1_px: 0.0,
        b2_px: 0.0,
    };
    let [p1, p2] = [or_zero("T1"), or_zero("T2")];
    let brown = Brown { k1: or_zero("K1"), k2: or_zero("K2"), k3: or_zero("K3"), p1, p2, ..Brown::default() };
    let warnings =
        Vec::from_iter((p1 != 0.0 || p2 != 0.0).then(|| {
            "T1 and T2 are taken as p1 and p2 with x to the right and y down; Pix4D does not say so".to_owned()
        }));
    let conversion = convert(size_px, &axis, &Lens::Brown(brown))?;
    Ok(Converted { name: Some(name), conversion, warnings })
}

impl Entry {
    /// Pixels of a millimetre, or 1 where the file is in pixels.
    fn pixels_per_unit(&self, given: &Given<'_>, [width, height]: [u32; 2]) -> Result<f64, CameraFileError> {
        if self.in_pixels {
            return Ok(1.0);
        }
        let of_sensor = self.sensor_mm.map(|[w, h]| [w / f64::from(width), h / f64::from(height)]);
        match (of_sensor, given.pixel_size_mm) {
            (Some([across, down]), _) if (across / down - 1.0).abs() > 1e-3 => {
                let detail = format!("the sensor would have pixels of {across:.6} x {down:.6} mm");
                Err(CameraFileError::Contradiction { parameter: "image_size_px", detail })
            }
            (Some([across, _]), Some(given)) if (across / given - 1.0).abs() > 1e-3 => {
                let detail = format!("the sensor has pixels of {across:.6} mm");
                Err(CameraFileError::Contradiction { parameter: "pixel_size_mm", detail })
            }
            (Some([across, _]), _) => Ok(1.0 / across),
            (None, Some(size_mm)) => Ok(1.0 / size_mm),
            (None, None) => Err(CameraFileError::Missing { what: "the size of a pixel", parameter: "pixel_size_mm" }),
        }
    }
}

fn entries(text: &str) -> Result<Vec<(String, Entry)>, CameraFileError> {
    let mut entries: Vec<(String, Entry)> = Vec::new();
    for (at, line) in text.lines().enumerate() {
        let line = line.trim();
        let wrong = |detail: String| CameraFileError::Text { place: format!("line {}", at + 1), detail };
        if let Some(number) = line.strip_prefix(HEAD) {
            entries.push((number.trim().to_owned(), Entry::default()));
            continue;
        }
        let Some((_, entry)) = entries.last_mut() else {
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            return Err(wrong(format!("before it, a line {HEAD:?} is missing")));
        };
        if let Some(comment) = line.strip_prefix('#') {
            entry.take_comment(comment);
        } else if let Some((key, value)) = line.split_once(char::is_whitespace) {
            let value = number(key, value).map_err(|error| wrong(error.to_string()))?;
            if entry.values.iter().any(|(known, _)| known.eq_ignore_ascii_case(key)) {
                return Err(wrong(format!("{key} is given twice; each camera begins with a line {HEAD:?}")));
            }
            entry.values.push((key.to_owned(), value));
        } else if !line.is_empty() {
            return Err(wrong(format!("{line:?} is no name with a value")));
        }
    }
    Ok(entries)
}

impl Entry {
    /// "Focal Length mm assuming a sensor width of 17.5x13.1mm".
    fn take_comment(&mut self, comment: &str) {
        let small = comment.to_lowercase();
        if !small.trim_start().starts_with("focal length") {
            return;
        }
        self.in_pixels = small.contains("pixel");
        let size =
            small.rsplit(' ').next().and_then(|size| size.strip_suffix("mm")).and_then(|size| size.split_once('x'));
        let positive = |text: &str| text.parse().ok().filter(|side: &f64| *side > 0.0 && side.is_finite());
        self.sensor_mm = size.and_then(|(width, height)| Some([positive(width)?, positive(height)?]));
    }
}
