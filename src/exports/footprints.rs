//! What the photographs show of the ground, as GeoJSON (RFC 7946).

use serde_json::{Value, json};

use super::local::json_file;
use super::{ExportError, File, Photograph};

/// Points along each side of the frame: distortion bends the rim.
const PER_SIDE: usize = 8;

/// A polygon for each photograph, at the mean height of its ground, in longitude and latitude.
pub(super) fn write(photographs: &[Photograph]) -> Result<Vec<File>, ExportError> {
    let features = photographs.iter().map(feature).collect::<Result<Vec<_>, _>>()?;
    let mut file = json_file("footprints.geojson", &json!({"type": "FeatureCollection", "features": features}));
    file.media_type = "application/geo+json";
    Ok(vec![file])
}

fn feature(photograph: &Photograph) -> Result<Value, ExportError> {
    let corners = [(0.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.0)];
    let mut ring = Vec::with_capacity(4 * PER_SIDE + 1);
    for (index, (x, y)) in corners.into_iter().enumerate() {
        let (to_x, to_y) = corners[(index + 1) % corners.len()];
        for step in 0..PER_SIDE {
            let share = step as f64 / PER_SIDE as f64;
            let pixel = photograph.camera.frame_px(x + (to_x - x) * share, y + (to_y - y) * share);
            ring.push(Photograph::geodetic(photograph.ground_geocentric_m(pixel, photograph.ground_height_m)?)?);
        }
    }
    if twice_area(&ring) < 0.0 {
        ring.reverse();
    }
    ring.push(ring[0]);
    let centre = Photograph::geodetic(photograph.centre_geocentric_m)?;
    Ok(json!({
        "type": "Feature",
        "geometry": {"type": "Polygon", "coordinates": [ring]},
        "properties": {
            "filename": photograph.name, "camera": photograph.camera_name, "projection_centre": centre,
            "ground_height_m": photograph.ground_height_m,
        },
    }))
}

/// Positive if the ring is counter-clockwise, as it must be.
fn twice_area(ring: &[[f64; 3]]) -> f64 {
    let next = ring.iter().cycle().skip(1);
    ring.iter().zip(next).map(|([x, y, _], [to_x, to_y, _])| x * to_y - to_x * y).sum()
}
