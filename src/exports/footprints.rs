//! What the photographs show of the ground, as GeoJSON (RFC 7946): beyond the antimeridian it goes on at the other end of
//! the map, as a part of its own.

use serde_json::{Value, json};

use super::local::json_file;
use super::photograph::unwrapped_deg;
use super::{ExportError, File, Photograph};

/// Points along each side of the frame: distortion bends the rim.
const PER_SIDE: usize = 8;
const TURN_DEG: f64 = 360.0;

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
    let centre = Photograph::geodetic(photograph.centre_geocentric_m)?;
    Ok(json!({
        "type": "Feature",
        "geometry": geometry(ring, centre[0]),
        "properties": {
            "filename": photograph.name, "camera": photograph.camera_name, "projection_centre": centre,
            "ground_height_m": photograph.ground_height_m,
        },
    }))
}

/// A polygon, or two that the antimeridian parts (section 3.1.9 of the RFC).
fn geometry(mut ring: Vec<[f64; 3]>, centre_longitude_deg: f64) -> Value {
    for [longitude_deg, ..] in &mut ring {
        // so that the ring does not jump from one end of the map to the other
        *longitude_deg = unwrapped_deg(*longitude_deg, centre_longitude_deg);
    }
    if twice_area(&ring) < 0.0 {
        ring.reverse();
    }
    let mut parts: Vec<Vec<[f64; 3]>> = Vec::new();
    for turn in [-TURN_DEG, 0.0, TURN_DEG] {
        let shifted: Vec<_> =
            ring.iter().map(|[longitude, latitude, height]| [longitude + turn, *latitude, *height]).collect();
        let mut part = cut(&cut(&shifted, 1.0), -1.0);
        if part.len() > 2 {
            part.push(part[0]);
            parts.push(part);
        }
    }
    match &parts[..] {
        [only] => json!({"type": "Polygon", "coordinates": [only]}),
        parts => json!({"type": "MultiPolygon", "coordinates": parts.iter().map(|part| [part]).collect::<Vec<_>>()}),
    }
}

/// What of a ring lies on this side of the meridian `side` · 180° (Sutherland and Hodgman).
fn cut(ring: &[[f64; 3]], side: f64) -> Vec<[f64; 3]> {
    let mut kept = Vec::with_capacity(ring.len() + 2);
    let inside_deg = |point: &[f64; 3]| TURN_DEG / 2.0 - side * point[0];
    if !ring.iter().any(|point| inside_deg(point) > 0.0) {
        return kept;
    }
    for (from, to) in ring.iter().zip(ring.iter().cycle().skip(1)) {
        let (a, b) = (inside_deg(from), inside_deg(to));
        if a >= 0.0 {
            kept.push(*from);
        }
        if a * b < 0.0 {
            let share = a / (a - b);
            kept.push([
                side * TURN_DEG / 2.0,
                from[1] + share * (to[1] - from[1]),
                from[2] + share * (to[2] - from[2]),
            ]);
        }
    }
    kept
}

/// Positive if the ring is counter-clockwise, as it must be.
fn twice_area(ring: &[[f64; 3]]) -> f64 {
    let next = ring.iter().cycle().skip(1);
    ring.iter().zip(next).map(|([x, y, _], [to_x, to_y, _])| x * to_y - to_x * y).sum()
}
