//! Ellipsoids of revolution: between longitude, latitude, height and geocentric coordinates.
//!
//! The library's own inverse is one pass of Bowring's formula, which is off by 0.1 mm at 100 km of height; here it
//! is two, which leaves only the rounding of the numbers (about 2 nm) between 100 km below and 1000 km above.

use nalgebra::Vector3;

/// An ellipsoid of revolution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid {
    /// Its name in PROJ strings.
    pub name: &'static str,
    /// The equatorial radius a.
    pub semi_major_axis_m: f64,
    /// The flattening f = (a - b) / a.
    pub flattening: f64,
}

/// A position by longitude, latitude and height above an ellipsoid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Longitude, east of Greenwich positive, from -pi to pi.
    pub longitude_rad: f64,
    /// Geodetic latitude, north positive, from -pi/2 to pi/2.
    pub latitude_rad: f64,
    /// Height above the ellipsoid along its normal.
    pub height_m: f64,
}

impl Ellipsoid {
    /// The ellipsoid of WGS 84.
    pub const WGS84: Self = Self { name: "WGS84", semi_major_axis_m: 6_378_137.0, flattening: 1.0 / 298.257_223_563 };
    /// The Geodetic Reference System 1980, the ellipsoid of ETRS89; 0.1 mm flatter than that of WGS 84 at the poles.
    pub const GRS80: Self = Self { name: "GRS80", semi_major_axis_m: 6_378_137.0, flattening: 1.0 / 298.257_222_101 };
    /// Bessel's ellipsoid of 1841, that of DHDN.
    pub const BESSEL: Self = Self { name: "bessel", semi_major_axis_m: 6_377_397.155, flattening: 1.0 / 299.152_812_8 };

    /// Geocentric coordinates: x towards Greenwich, y towards 90° east, z towards the North Pole.
    #[must_use]
    pub fn geocentric_m(&self, position: Geodetic) -> Vector3<f64> {
        let (sin_longitude, cos_longitude) = position.longitude_rad.sin_cos();
        let (sin_latitude, cos_latitude) = position.latitude_rad.sin_cos();
        let e2 = self.eccentricity_squared();
        let normal = self.semi_major_axis_m / (1.0 - e2 * sin_latitude * sin_latitude).sqrt();
        let from_axis = (normal + position.height_m) * cos_latitude;
        Vector3::new(
            from_axis * cos_longitude,
            from_axis * sin_longitude,
            (normal * (1.0 - e2) + position.height_m) * sin_latitude,
        )
    }

    /// Longitude, latitude and height of a geocentric position (Bowring, Survey Review 1976 and 1985).
    ///
    /// On the axis the longitude is 0 or pi. At the geocentre, where the latitude means nothing, and for coordinates
    /// that are not finite, the height is not finite either.
    #[must_use]
    pub fn geodetic(&self, geocentric_m: Vector3<f64>) -> Geodetic {
        let (a, b) = (self.semi_major_axis_m, self.semi_major_axis_m * (1.0 - self.flattening));
        let e2 = self.eccentricity_squared();
        let (from_axis, z) = (geocentric_m.x.hypot(geocentric_m.y), geocentric_m.z);
        let unit = |sine: f64, cosine: f64| (sine / sine.hypot(cosine), cosine / sine.hypot(cosine));
        let (mut reduced_sin, mut reduced_cos) = unit(z * a, from_axis * b);
        let (mut sin, mut cos) = (reduced_sin, reduced_cos);
        for _ in 0..2 {
            let (north, outward) =
                (z + e2 / (1.0 - e2) * b * reduced_sin.powi(3), from_axis - e2 * a * reduced_cos.powi(3));
            (sin, cos) = unit(north, outward);
            (reduced_sin, reduced_cos) = unit(b * sin, a * cos);
        }
        Geodetic {
            longitude_rad: geocentric_m.y.atan2(geocentric_m.x),
            latitude_rad: sin.atan2(cos),
            height_m: from_axis * cos + z * sin - a * (1.0 - e2 * sin * sin).sqrt(),
        }
    }

    /// The squared first eccentricity e² = f (2 - f).
    fn eccentricity_squared(&self) -> f64 {
        self.flattening * (2.0 - self.flattening)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    /// pyproj 3.7.2 (PROJ 9.5.1): Transformer.from_pipeline("+proj=cart +ellps=ELLPS").transform(lon, lat, h)
    #[rustfmt::skip]
    const PROJ_CART: [(Ellipsoid, [f64; 3], [f64; 3]); 9] = [
        (Ellipsoid::WGS84, [0.0, 0.0, 0.0], [6378137.0, 0.0, 0.0]),
        (Ellipsoid::WGS84, [7.1, 50.73, 100.0], [4014371.6365022603, 500016.41941920976, 4914664.6291950485]),
        (Ellipsoid::WGS84, [-98.09, 30.17, -100000.0], [-764486.9826918112, -5378294.521975416, 3136423.384724085]),
        (Ellipsoid::WGS84, [179.999, -89.9999, 100000.0], [-11.343930879891266, 0.0001979889439962556, -6456752.314235279]),
        (Ellipsoid::WGS84, [-45.0, 90.0, 1234.5], [2.771417940211525e-10, -2.7714179402115243e-10, 6357986.814245179]),
        (Ellipsoid::GRS80, [16.6, 52.77, 40.0], [3705942.9395905244, 1104789.573279666, 5055130.702711448]),
        (Ellipsoid::GRS80, [-120.0, -45.0, 8848.0], [-2261923.679842995, -3917766.736331228, -4493604.889554738]),
        (Ellipsoid::BESSEL, [9.0, 51.0, 200.0], [3972152.2092852127, 629127.1045515087, 4933197.209891721]),
        (Ellipsoid::BESSEL, [13.5, 48.6, 0.0], [4108642.1228095475, 986397.7023484098, 4760775.459146099]),
    ];

    fn geodetic(longitude_deg: f64, latitude_deg: f64, height_m: f64) -> Geodetic {
        Geodetic { longitude_rad: longitude_deg.to_radians(), latitude_rad: latitude_deg.to_radians(), height_m }
    }

    #[test]
    fn geocentric_coordinates_are_those_of_proj_both_ways() {
        for (ellipsoid, [longitude_deg, latitude_deg, height_m], geocentric_m) in PROJ_CART {
            let (position, expected) = (geodetic(longitude_deg, latitude_deg, height_m), Vector3::from(geocentric_m));
            assert_abs_diff_eq!(ellipsoid.geocentric_m(position), expected, epsilon = 2e-9);
            let back = ellipsoid.geodetic(expected);
            assert_abs_diff_eq!(back.longitude_rad, position.longitude_rad, epsilon = 4e-16);
            assert_abs_diff_eq!(back.latitude_rad, position.latitude_rad, epsilon = 4e-16);
            assert_abs_diff_eq!(back.height_m, height_m, epsilon = 4e-9);
        }
    }

    #[test]
    fn on_the_axis_the_height_counts_from_the_pole() {
        let b = 6_378_137.0 * (1.0 - 1.0 / 298.257_223_563);
        for sign in [1.0, -1.0] {
            let pole = Ellipsoid::WGS84.geodetic(Vector3::new(0.0, 0.0, sign * (b + 55.0)));
            assert_eq!(pole.latitude_rad, sign * FRAC_PI_2);
            assert_abs_diff_eq!(pole.height_m, 55.0, epsilon = 4e-9);
        }
    }

    #[test]
    fn the_geocentre_and_coordinates_that_are_not_finite_have_no_height() {
        for bad in [Vector3::zeros(), Vector3::new(f64::NAN, 1.0, 1.0), Vector3::new(1.0, f64::INFINITY, 1.0)] {
            assert!(!Ellipsoid::WGS84.geodetic(bad).height_m.is_finite());
        }
    }

    proptest! {
        #[test]
        fn there_and_back_is_the_same_place(
            longitude_rad in -PI..PI, latitude_rad in -FRAC_PI_2..FRAC_PI_2, height_m in -1e5..1e5,
            near_pole in 0.0..1e-3_f64,
        ) {
            let polar = (FRAC_PI_2 - near_pole * near_pole).copysign(latitude_rad);
            for latitude_rad in [latitude_rad, polar] {
                let there = Ellipsoid::GRS80.geocentric_m(Geodetic { longitude_rad, latitude_rad, height_m });
                let back = Ellipsoid::GRS80.geodetic(there);
                prop_assert!((back.height_m - height_m).abs() < 5e-9);
                prop_assert!((back.latitude_rad - latitude_rad).abs() * 6.4e6 < 5e-9);
                prop_assert!((Ellipsoid::GRS80.geocentric_m(back) - there).norm() < 5e-9);
            }
        }
    }
}
