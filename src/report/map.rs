//! What an orientation looks like on the ground: a GeoJSON FeatureCollection (RFC 7946, longitude and latitude on WGS 84
//! with ellipsoidal heights), each feature with its `role`.

use nalgebra::{Matrix2, Rotation2, Vector2, Vector3};
use serde_json::{Value, json};

use super::position::Position;
use crate::geometry::{Crs, CrsError, LocalFrame, Segment3};
use crate::orientation::ControlPoint;
use crate::pipeline::{ControlPointResult, Ellipse, GroundPrecision, Outcome};

/// Of the ellipse around the projection centre.
const ELLIPSE_SIGMAS: f64 = 3.0;
const ELLIPSE_CORNERS: usize = 48;
/// The ellipse is magnified to about this part of the footprint, for beside that it could not be seen.
const ELLIPSE_SHARE: f64 = 0.06;

/// The features of an outcome in the local frame `frame`. `control` are the control points that it could know,
/// `approximation` is the position that was stated.
///
/// # Errors
/// [`CrsError`] if the CRS of that is not known any more.
pub fn map(
    outcome: &Outcome,
    control: &[ControlPoint],
    frame: &LocalFrame,
    approximation: &Position,
) -> Result<Value, CrsError> {
    let sheet = Sheet { frame, crs: Crs::parse("EPSG:4979")? };
    let mut features = Vec::new();
    if let Some(rim) = sheet.ring(&outcome.footprint_m) {
        features.push(feature("footprint", json!({"type": "Polygon", "coordinates": [rim]}), json!({})));
    }
    features.extend(sheet.control_points(outcome, control));
    features.extend(sheet.grid(outcome));
    let undulation_m = approximation.vertical.map(|vertical| vertical.geoid_undulation_m);
    let stated_m = Crs::parse(&approximation.crs)?.geocentric_from_position(approximation.coordinates, undulation_m)?;
    if let Some(position) = sheet.position(frame.from_geocentric(stated_m)) {
        features.push(feature("approximation", json!({"type": "Point", "coordinates": position}), json!({})));
    }
    features.extend(sheet.projection_centre(outcome));
    Ok(json!({"type": "FeatureCollection", "features": features}))
}

/// What became of a control point, in the words of drawings and maps.
#[must_use]
pub fn state(used: bool, located: bool) -> &'static str {
    match (used, located) {
        (true, _) => "matched",
        (false, true) => "rejected",
        (false, false) => "unmatched",
    }
}

struct Sheet<'a> {
    frame: &'a LocalFrame,
    crs: Crs,
}

impl Sheet<'_> {
    /// Longitude, latitude, height; `None` where there are none.
    fn position(&self, local_m: Vector3<f64>) -> Option<[f64; 3]> {
        let position = self.crs.position_from_geocentric(self.frame.to_geocentric(local_m), None).ok()?;
        position.iter().all(|value| value.is_finite()).then_some(position)
    }

    /// A closed ring, counter-clockwise.
    fn ring(&self, corners_m: &[Vector3<f64>]) -> Option<Vec<[f64; 3]>> {
        let mut ring = corners_m.iter().map(|corner| self.position(*corner)).collect::<Option<Vec<_>>>()?;
        if twice_area_m2(corners_m) < 0.0 {
            ring.reverse();
        }
        ring.push(*ring.first()?);
        Some(ring)
    }

    fn control_points(&self, outcome: &Outcome, control: &[ControlPoint]) -> Vec<Value> {
        let of_one = |point: &ControlPointResult| {
            let known = control.iter().find(|known| known.name == point.name)?;
            let line = |edge: &Segment3| Some([self.position(edge.start)?, self.position(edge.end)?]);
            let lines: Vec<_> = known.edges_m.iter().filter_map(line).collect();
            let geometry = if lines.is_empty() {
                json!({"type": "Point", "coordinates": self.position(known.reference_m)?})
            } else {
                json!({"type": "MultiLineString", "coordinates": lines})
            };
            let state = state(point.used, point.located_px.is_some());
            Some(feature("control_point", geometry, json!({"name": point.name, "state": state})))
        };
        outcome.control_points.iter().filter_map(of_one).collect()
    }

    fn grid(&self, outcome: &Outcome) -> Vec<Value> {
        let tolerance_m = outcome.evidence.as_ref().map(|evidence| evidence.tolerance_m);
        let of_one = |point: &GroundPrecision| {
            let geometry = json!({"type": "Point", "coordinates": self.position(point.ground_m)?});
            let properties = json!({
                "image_px": [point.image_px.x, point.image_px.y],
                "sigma_planimetric_m": point.sigma_planimetric_m,
                "tolerance_m": tolerance_m,
            });
            Some(feature("grid_point", geometry, properties))
        };
        outcome.ground_precision.iter().filter_map(of_one).collect()
    }

    fn projection_centre(&self, outcome: &Outcome) -> Vec<Value> {
        let Some(estimate) = &outcome.estimate else { return Vec::new() };
        let centre_m = estimate.orientation.projection_centre_m;
        let Some(position) = self.position(centre_m) else { return Vec::new() };
        let sigma_m = [0, 1, 2].map(|axis| estimate.covariance[(axis, axis)].max(0.0).sqrt());
        let geometry = json!({"type": "Point", "coordinates": position});
        let centre = feature("projection_centre", geometry, json!({"sigma_m": sigma_m}));
        let planimetric: Matrix2<f64> = estimate.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        let ellipse = Ellipse::of_covariance(centre_m.xy(), &planimetric, ELLIPSE_SIGMAS);
        let ellipse =
            ellipse.and_then(|ellipse| self.error_ellipse(&ellipse, centre_m.z, extent_m(&outcome.footprint_m)));
        ellipse.into_iter().chain([centre]).collect()
    }

    fn error_ellipse(&self, ellipse: &Ellipse, height_m: f64, extent_m: f64) -> Option<Value> {
        let Ellipse { centre: centre_m, semi_axes: [longer_m, shorter_m], angle_rad } = *ellipse;
        let magnification = round_number(ELLIPSE_SHARE * extent_m / longer_m).max(1.0);
        let corner = |k: usize| {
            let (sine, cosine) = (std::f64::consts::TAU * k as f64 / ELLIPSE_CORNERS as f64).sin_cos();
            let on_axes = Vector2::new(longer_m * cosine, shorter_m * sine) * magnification;
            (centre_m + Rotation2::new(angle_rad) * on_axes).push(height_m)
        };
        let ring = self.ring(&(0..ELLIPSE_CORNERS).map(corner).collect::<Vec<_>>())?;
        let properties = json!({"magnification": magnification, "sigmas": ELLIPSE_SIGMAS});
        Some(feature("error_ellipse", json!({"type": "Polygon", "coordinates": [ring]}), properties))
    }
}

fn feature(role: &str, geometry: Value, properties: Value) -> Value {
    let mut feature = json!({"type": "Feature"});
    feature["geometry"] = geometry;
    feature["properties"] = properties;
    feature["properties"]["role"] = json!(role);
    feature
}

/// Positive if the corners go round counter-clockwise, seen from above.
fn twice_area_m2(corners_m: &[Vector3<f64>]) -> f64 {
    let next = corners_m.iter().cycle().skip(1);
    corners_m.iter().zip(next).map(|(a, b)| a.x * b.y - b.x * a.y).sum()
}

/// The longer side of what the points cover.
fn extent_m(points_m: &[Vector3<f64>]) -> f64 {
    let of_axis = |axis: usize| {
        let values = || points_m.iter().map(move |point| point[axis]);
        values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min)
    };
    of_axis(0).max(of_axis(1)).max(0.0)
}

/// The next lower number of 1, 2, 5, 10, 20, …
fn round_number(value: f64) -> f64 {
    if !value.is_finite() || value < 1.0 {
        return 1.0;
    }
    let decade = 10_f64.powf(value.log10().floor());
    [5.0, 2.0].into_iter().find(|step| value / decade >= *step).unwrap_or(1.0) * decade
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn magnifications_are_round() {
        for (value, round) in [(0.3, 1.0), (1.0, 1.0), (4.9, 2.0), (5.0, 5.0), (99.0, 50.0), (2400.0, 2000.0)] {
            assert!((round_number(value) - round).abs() < 1e-9, "{value}");
        }
        assert!((round_number(f64::INFINITY) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_ring_is_closed_and_counter_clockwise_whichever_way_it_was_given() {
        let frame = LocalFrame::at(7.0, 50.0, 0.0);
        let sheet = Sheet { frame: &frame, crs: Crs::parse("EPSG:4979").unwrap() };
        let clockwise = [[0.0, 0.0], [0.0, 100.0], [100.0, 100.0], [100.0, 0.0]].map(|[x, y]| Vector3::new(x, y, 0.0));
        let mut other_way = clockwise;
        other_way.reverse();
        for corners in [clockwise, other_way] {
            let ring = sheet.ring(&corners).unwrap();
            assert_eq!(ring.len(), 5);
            assert_eq!(ring[0], ring[4]);
            let twice_area: f64 = ring.windows(2).map(|w| w[0][0] * w[1][1] - w[1][0] * w[0][1]).sum();
            assert!(twice_area > 0.0);
        }
        // a hundred metres north are 0.0009 degrees
        let ring = sheet.ring(&clockwise).unwrap();
        let latitudes = ring.iter().map(|p| p[1]);
        assert!((latitudes.fold(0.0, f64::max) - 50.0 - 0.000_899).abs() < 1e-6);
    }
}
