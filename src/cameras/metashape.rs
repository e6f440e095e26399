//! Agisoft Metashape (1.3 and later): the XML of a calibration, or of all cameras of a project.
//!
//! The principal point is counted from the middle of the image, pixels from its corner. The manual (appendix D) has
//! x' = x (1 + K1 r² + K2 r⁴ + K3 r⁶ + K4 r⁸) + (P1 (r² + 2 x²) + 2 P2 x y) (1 + P3 r² + P4 r⁴), y' alike with P1 and P2
//! exchanged, u = w/2 + cx + x' f + x' B1 + y' B2, v = h/2 + cy + y' f: P1 is the contract's p2.

use nalgebra::Vector2;

use super::conversion::{Axis, Lens, convert};
use super::text::{number, pixels};
use super::xml::Element;
use super::{CameraFileError, Converted, Given, field};
use crate::geometry::Brown;

/// Whether a text is such a file.
pub(super) fn is_one(text: &str) -> bool {
    text.contains("<calibration") && text.contains("<f>")
}

pub(super) fn read(given: &Given<'_>) -> Result<Converted, CameraFileError> {
    let root = Element::read(given.text)?;
    let (name, calibration, size) = if root.name == "calibration" {
        (None, &root, None)
    } else {
        let (name, (calibration, size)) = given.choose(sensors(&root))?;
        (Some(name), calibration, size)
    };
    refuse_others(calibration)?;
    let value = |name: &str| calibration.child(name).map(|found| number(name, &found.text)).transpose();
    let or_zero = |name: &str| Ok::<f64, CameraFileError>(value(name)?.unwrap_or(0.0));
    let f = value("f")?.ok_or_else(|| {
        let older = calibration.child("fx").is_some();
        field("f", if older { "there is fx: files before version 1.3 are not read" } else { "it is missing" })
    })?;
    let size_px = given.size_px(match size_of(calibration)? {
        None => size,
        told => told,
    })?;
    let [width, height] = size_px.map(f64::from);
    let axis = Axis {
        principal_distance_px: f,
        principal_point_px: Vector2::new(width / 2.0 + or_zero("cx")?, height / 2.0 + or_zero("cy")?),
        b1_px: or_zero("b1")?,
        b2_px: or_zero("b2")?,
    };
    let k = [or_zero("k1")?, or_zero("k2")?, or_zero("k3")?, or_zero("k4")?];
    let p = [or_zero("p1")?, or_zero("p2")?, or_zero("p3")?, or_zero("p4")?];
    Ok(Converted { name, conversion: convert(size_px, &axis, &lens(k, p))?, warnings: Vec::new() })
}

fn lens(k: [f64; 4], p: [f64; 4]) -> Lens {
    let ([k1, k2, k3, k4], [p1, p2, p3, p4]) = (k, p);
    if [k4, p3, p4] == [0.0; 3] {
        return Lens::Brown(Brown { k1, k2, k3, p1: p2, p2: p1, b1_px: 0.0, b2_px: 0.0 });
    }
    Lens::Bent(Box::new(move |ideal| {
        let (x, y, r2) = (ideal.x, ideal.y, ideal.norm_squared());
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
        let more = 1.0 + r2 * (p3 + r2 * p4);
        Vector2::new(
            x * radial + (p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y) * more,
            y * radial + (p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y) * more,
        )
    }))
}

/// A calibration with the size of its sensor.
type Sensor<'a> = (&'a Element, Option<[u32; 2]>);

/// The sensors of a project, each with the calibration that was adjusted, else the last.
fn sensors(root: &Element) -> Vec<(String, Sensor<'_>)> {
    let mut sensors = Vec::new();
    root.all("sensor", &mut sensors);
    let named = sensors.into_iter().filter_map(|sensor| {
        let calibrations = || sensor.children.iter().filter(|child| child.name == "calibration");
        let adjusted = calibrations().find(|calibration| calibration.attribute("class") == Some("adjusted"));
        let calibration = adjusted.or_else(|| calibrations().next_back())?;
        let name = sensor.attribute("label").or_else(|| sensor.attribute("id")).unwrap_or_default();
        Some((name.to_owned(), (calibration, size_of(sensor).ok().flatten())))
    });
    named.collect()
}

/// The size in an element: as `width` and `height`, or as attributes of `resolution`.
fn size_of(element: &Element) -> Result<Option<[u32; 2]>, CameraFileError> {
    let side = |name: &str| {
        let child = element.child(name).map(|child| child.text.as_str());
        let text = child.or_else(|| element.child("resolution").and_then(|resolution| resolution.attribute(name)));
        text.map(|text| number(name, text).and_then(|value| pixels(name, value))).transpose()
    };
    Ok(side("width")?.zip(side("height")?).map(|(width, height)| [width, height]))
}

fn refuse_others(calibration: &Element) -> Result<(), CameraFileError> {
    let projection = calibration.child("projection").map(|projection| projection.text.trim());
    match projection.or_else(|| calibration.attribute("type")) {
        None | Some("frame") => Ok(()),
        Some(other) => {
            let detail = "of Metashape's models `frame` is read".to_owned();
            Err(CameraFileError::Model { model: other.to_owned(), detail })
        }
    }
}
