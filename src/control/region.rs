//! Rectangles of longitude and latitude, with care for the antimeridian and the poles.

use nalgebra::Vector3;

use crate::geometry::LocalFrame;

/// WGS 84's polar radius is the smaller one: with it a distance never gives too small an angle.
const SMALLEST_RADIUS_M: f64 = 6_335_000.0;

/// WGS 84.
const EQUATOR_M: f64 = 6_378_137.0;
const ECCENTRICITY_SQUARED: f64 = 6.694_379_990_14e-3;
/// Nearer to a pole than this, and beyond this extent, a box is made of its points.
const HIGHEST_LATITUDE_DEG: f64 = 80.0;
const LARGEST_BUILDING_M: f64 = 5_000.0;
/// Below the ellipsoid degrees are shorter: by this at a kilometre below it.
const HEIGHT_SHARE: f64 = 2e-4;

/// A rectangle of longitude and latitude. Longitudes may leave -180 to 180 where it crosses the antimeridian, and
/// `min_lon_deg` lies in -180 to 180 for what is stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeodeticBox {
    /// Western rim.
    pub min_lon_deg: f64,
    /// Eastern rim.
    pub max_lon_deg: f64,
    /// Southern rim.
    pub min_lat_deg: f64,
    /// Northern rim.
    pub max_lat_deg: f64,
}

impl GeodeticBox {
    /// The smallest box around points that lie close together.
    #[must_use]
    pub fn around_points(points_lon_lat_deg: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let mut bounds = Self {
            min_lon_deg: f64::INFINITY,
            max_lon_deg: f64::NEG_INFINITY,
            min_lat_deg: f64::INFINITY,
            max_lat_deg: f64::NEG_INFINITY,
        };
        let mut first_lon_deg = None;
        for [lon_deg, lat_deg] in points_lon_lat_deg {
            let first = *first_lon_deg.get_or_insert(lon_deg);
            // the others on the same side of the antimeridian as the first
            let lon_deg = lon_deg - 360.0 * ((lon_deg - first) / 360.0).round();
            bounds.min_lon_deg = bounds.min_lon_deg.min(lon_deg);
            bounds.max_lon_deg = bounds.max_lon_deg.max(lon_deg);
            bounds.min_lat_deg = bounds.min_lat_deg.min(lat_deg);
            bounds.max_lat_deg = bounds.max_lat_deg.max(lat_deg);
        }
        bounds
    }

    /// The smallest box around two of them, on the same side of the antimeridian.
    #[must_use]
    pub fn around_both(self, other: Self) -> Self {
        Self {
            min_lon_deg: self.min_lon_deg.min(other.min_lon_deg),
            max_lon_deg: self.max_lon_deg.max(other.max_lon_deg),
            min_lat_deg: self.min_lat_deg.min(other.min_lat_deg),
            max_lat_deg: self.max_lat_deg.max(other.max_lat_deg),
        }
    }

    /// A box around a building, too large by some millimetres, and never too small: its points are brought to the tangent
    /// plane at its reference point, which is many times faster than finding the longitude and latitude of each.
    #[must_use]
    pub fn around_building(
        reference_geocentric_m: Vector3<f64>,
        points_geocentric_m: impl Iterator<Item = Vector3<f64>> + Clone,
    ) -> Self {
        let frame = LocalFrame::about(reference_geocentric_m);
        let (lon_deg, lat_deg) = (frame.longitude_deg(), frame.latitude_deg());
        let locals_m = points_geocentric_m.clone().map(|point| frame.from_geocentric(point));
        let reference_m = frame.from_geocentric(reference_geocentric_m);
        let zero = reference_m.xy();
        let (least_m, largest_m) = locals_m.fold((zero, zero), |(a, b), p| (a.inf(&p.xy()), b.sup(&p.xy())));
        let reach_m = least_m.norm().max(largest_m.norm());
        if lat_deg.abs() > HIGHEST_LATITUDE_DEG || reach_m > LARGEST_BUILDING_M {
            return Self::around_points(points_geocentric_m.map(longitude_latitude_deg));
        }
        let (sin, cos) = lat_deg.to_radians().sin_cos();
        let w = (1.0 - ECCENTRICITY_SQUARED * sin * sin).sqrt();
        let east_radius_m = EQUATOR_M / w * cos;
        let north_radius_m = EQUATOR_M * (1.0 - ECCENTRICITY_SQUARED) / w.powi(3);
        // what the curvature and the convergence of the meridians make at that distance, and heights below the ellipsoid
        let margin_m = reach_m * reach_m / north_radius_m * (1.0 + sin.abs() / cos) + reach_m * HEIGHT_SHARE;
        let degrees = |offset_m: f64, margin_m: f64, radius_m: f64| ((offset_m + margin_m) / radius_m).to_degrees();
        Self {
            min_lon_deg: lon_deg + degrees(least_m.x, -margin_m, east_radius_m),
            max_lon_deg: lon_deg + degrees(largest_m.x, margin_m, east_radius_m),
            min_lat_deg: lat_deg + degrees(least_m.y, -margin_m, north_radius_m),
            max_lat_deg: lat_deg + degrees(largest_m.y, margin_m, north_radius_m),
        }
    }

    /// A box that holds everything within `radius_m` of a place.
    #[must_use]
    pub fn around_place([lon_deg, lat_deg]: [f64; 2], radius_m: f64) -> Self {
        let lat_reach_deg = (radius_m / SMALLEST_RADIUS_M).to_degrees();
        let (min_lat_deg, max_lat_deg) = (lat_deg - lat_reach_deg, lat_deg + lat_reach_deg);
        let farthest_lat_deg = min_lat_deg.abs().max(max_lat_deg.abs());
        let lon_reach_deg = if farthest_lat_deg < 89.0 {
            (lat_reach_deg / farthest_lat_deg.to_radians().cos()).min(180.0)
        } else {
            180.0
        };
        Self { min_lon_deg: lon_deg - lon_reach_deg, max_lon_deg: lon_deg + lon_reach_deg, min_lat_deg, max_lat_deg }
    }

    /// A little more on all sides: by a tenth, and by a thousandth of a degree. For what lies between the points that
    /// a box was put around.
    #[must_use]
    pub fn widened(self) -> Self {
        let (lon_deg, lat_deg) = (self.max_lon_deg - self.min_lon_deg, self.max_lat_deg - self.min_lat_deg);
        let (lon_deg, lat_deg) = (0.1 * lon_deg + 1e-3, 0.1 * lat_deg + 1e-3);
        Self {
            min_lon_deg: self.min_lon_deg - lon_deg,
            max_lon_deg: self.max_lon_deg + lon_deg,
            min_lat_deg: self.min_lat_deg - lat_deg,
            max_lat_deg: self.max_lat_deg + lat_deg,
        }
    }

    /// The same box shifted by whole turns: all the places where stored boxes may overlap it.
    pub(super) fn unwrapped(self) -> impl Iterator<Item = Self> {
        // what is stored reaches at most a building's width beyond -180 to 180
        let in_reach = |b: &Self| b.max_lon_deg >= -181.0 && b.min_lon_deg <= 181.0;
        [0.0, -360.0, 360.0]
            .into_iter()
            .map(move |turn| Self {
                min_lon_deg: self.min_lon_deg + turn,
                max_lon_deg: self.max_lon_deg + turn,
                ..self
            })
            .filter(in_reach)
    }
}

/// Longitude and latitude of a geocentric point on WGS 84.
#[must_use]
pub fn longitude_latitude_deg(geocentric_m: Vector3<f64>) -> [f64; 2] {
    let place = LocalFrame::about(geocentric_m);
    [place.longitude_deg(), place.latitude_deg()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_building_on_the_antimeridian_has_a_small_box() {
        let bounds = GeodeticBox::around_points([[179.9999, -17.0], [-179.9998, -16.9999]]);
        assert!((bounds.max_lon_deg - bounds.min_lon_deg - 0.0003).abs() < 1e-9, "{bounds:?}");
    }

    #[test]
    fn the_box_of_a_building_holds_its_points_and_little_more() {
        for (lon_deg, lat_deg, reach_m) in
            [(7.0, 51.0, 20.0), (179.9999, -17.0, 30.0), (0.0, 79.0, 800.0), (5.0, 89.0, 50.0)]
        {
            let frame = LocalFrame::at(lon_deg, lat_deg, 900.0);
            let offsets = [(-1.0, 0.3), (0.7, 1.0), (0.1, -0.9), (1.0, 0.2)];
            let points = offsets.map(|(x, y)| frame.to_geocentric(Vector3::new(reach_m * x, reach_m * y, 8.0)));
            let fast = GeodeticBox::around_building(points[0], points.into_iter());
            let exact = GeodeticBox::around_points(points.map(longitude_latitude_deg));
            let cos = f64::cos(lat_deg.to_radians());
            let margins_m = [
                (exact.min_lon_deg - fast.min_lon_deg) * 111_320.0 * cos,
                (fast.max_lon_deg - exact.max_lon_deg) * 111_320.0 * cos,
                (exact.min_lat_deg - fast.min_lat_deg) * 111_320.0,
                (fast.max_lat_deg - exact.max_lat_deg) * 111_320.0,
            ];
            // at 79 degrees the meridians converge within the building
            let most_m = 0.001 * reach_m + reach_m * reach_m / 80_000.0;
            assert!(margins_m.iter().all(|m| (-1e-6..most_m).contains(m)), "{lat_deg}: {margins_m:?} of {most_m}");
        }
    }

    #[test]
    fn a_place_near_the_antimeridian_is_looked_for_on_both_sides() {
        let parts: Vec<_> = GeodeticBox::around_place([179.99, 0.0], 5_000.0).unwrapped().collect();
        assert!(parts.iter().any(|b| b.min_lon_deg < -179.99 && b.max_lon_deg > -179.97));
        assert!(parts.iter().any(|b| b.min_lon_deg < 179.99 && b.max_lon_deg > 180.0));
    }

    #[test]
    fn near_a_pole_every_longitude_is_near() {
        let bounds = GeodeticBox::around_place([20.0, 89.99], 2_000.0);
        assert!(bounds.max_lon_deg - bounds.min_lon_deg >= 360.0);
    }

    #[test]
    fn the_box_around_a_place_holds_its_circle() {
        for lat_deg in [0.0_f64, 52.0, -75.0] {
            let bounds = GeodeticBox::around_place([10.0, lat_deg], 1_000.0);
            let east_reach_m = (bounds.max_lon_deg - 10.0).to_radians() * 6_378_137.0 * lat_deg.to_radians().cos();
            assert!((1_000.0..1_200.0).contains(&east_reach_m), "{east_reach_m} m at {lat_deg}°");
        }
    }
}
