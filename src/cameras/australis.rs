//! The text report of Australis, iWitness and CalibCam, and of reports in their form.
//!
//! Photogrammetric: millimetres from the middle of the sensor, x to the right, y up, and the coefficients correct what was
//! *measured* (Fraser 1997): with x, y from the principal point the corrected x is
//! x + x (K1 r² + K2 r⁴ + K3 r⁶) + P1 (r² + 2 x²) + 2 P2 x y + B1 x + B2 y, the corrected y is
//! y + y (K1 r² + …) + P2 (r² + 2 y²) + 2 P1 x y. Their principal distance is C.

use nalgebra::Vector2;

use super::conversion::{Axis, Lens, convert};
use super::text::pixels;
use super::{CameraFileError, Converted, Given, field};

const NAMES: [&str; 10] = ["C", "XP", "YP", "K1", "K2", "K3", "P1", "P2", "B1", "B2"];

/// Whether a text is such a report.
pub(super) fn is_one(text: &str) -> bool {
    let values = read_values(text);
    ["C", "XP", "YP", "K1"].iter().all(|name| values.iter().any(|(known, _)| known == name))
}

pub(super) fn read(given: &Given<'_>) -> Result<Converted, CameraFileError> {
    let values = read_values(given.text);
    let value = |name: &str| values.iter().find(|(known, _)| *known == name).map(|(_, value)| *value);
    let needed = |name: &str| value(name).ok_or_else(|| field(name, "it is missing"));
    let or_zero = |name: &str| value(name).unwrap_or(0.0);
    let [across, down] = [sensor(given.text, "H")?, sensor(given.text, "V")?];
    let size_px = given.size_px(across.zip(down).map(|(across, down)| [across.0, down.0]))?;
    let told_mm = across.zip(down).map(|(across, down)| [across.1, down.1]);
    let missing = CameraFileError::Missing { what: "the size of a pixel", parameter: "pixel_size_mm" };
    let [pixel_x_mm, pixel_y_mm] = told_mm.or(given.pixel_size_mm.map(|side| [side; 2])).ok_or(missing)?;
    let (c, xp, yp) = (needed("C")?, needed("XP")?, needed("YP")?);
    if ![c, pixel_x_mm, pixel_y_mm].iter().all(|length| *length > 0.0 && length.is_finite()) {
        return Err(field("C", format!("{c} mm, with pixels of {pixel_x_mm} x {pixel_y_mm} mm")));
    }
    let middle = Vector2::new(f64::from(size_px[0]), f64::from(size_px[1])) / 2.0;
    let axis = Axis {
        principal_distance_px: c / pixel_y_mm,
        principal_point_px: middle + Vector2::new(xp / pixel_x_mm, -yp / pixel_y_mm),
        b1_px: c / pixel_x_mm - c / pixel_y_mm,
        b2_px: 0.0,
    };
    let k = ["K1", "K2", "K3"].map(or_zero);
    let (p, b) = (["P1", "P2"].map(or_zero), ["B1", "B2"].map(or_zero));
    let lens = Lens::Corrected(Box::new(move |pixel: Vector2<f64>| {
        let from_middle = pixel - middle;
        let measured = Vector2::new(from_middle.x * pixel_x_mm - xp, -from_middle.y * pixel_y_mm - yp);
        let corrected = corrected(measured, k, p, b);
        Vector2::new(corrected.x, -corrected.y) / c
    }));
    Ok(Converted { name: None, conversion: convert(size_px, &axis, &lens)?, warnings: Vec::new() })
}

/// Corrected coordinates of measured ones, both from the principal point.
fn corrected(measured: Vector2<f64>, [k1, k2, k3]: [f64; 3], [p1, p2]: [f64; 2], [b1, b2]: [f64; 2]) -> Vector2<f64> {
    let (x, y, r2) = (measured.x, measured.y, measured.norm_squared());
    let radial = r2 * (k1 + r2 * (k2 + r2 * k3));
    Vector2::new(
        x + x * radial + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y + b1 * x + b2 * y,
        y + y * radial + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y,
    )
}

/// The values of a report: each line has the name and either the one value, or initial value, adjustment, final value.
fn read_values(text: &str) -> Vec<(&'static str, f64)> {
    let mut values = Vec::new();
    for line in text.lines() {
        let mut words =
            line.split(|c: char| c.is_whitespace() || matches!(c, '=' | ':')).filter(|word| !word.is_empty());
        let Some(first) = words.next() else { continue };
        let Some(name) = NAMES.iter().find(|name| name.eq_ignore_ascii_case(first)) else { continue };
        let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
        let found = if numbers.len() >= 3 { numbers.get(2) } else { numbers.first() };
        if let (Some(value), false) = (found, values.iter().any(|(known, _)| known == name)) {
            values.push((*name, *value));
        }
    }
    values
}

/// Pixels and the size of one in millimetres in the line of a direction: `H 4000 0.00163`.
fn sensor(text: &str, direction: &str) -> Result<Option<(u32, f64)>, CameraFileError> {
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        if let [first, count, size, ..] = words.as_slice()
            && first.eq_ignore_ascii_case(direction)
            && let (Ok(count), Ok(size)) = (count.parse::<f64>(), size.parse::<f64>())
        {
            return Ok(Some((pixels(direction, count)?, size)));
        }
    }
    Ok(None)
}
