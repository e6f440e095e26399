//! The local tangent plane: east, north and up at a point of the ellipsoid. It is the frame of the adjustment.
//!
//! A Cartesian frame keeps straight lines straight and angles true, which no map grid does; curvature, scale of the
//! map and convergence of the meridians then need no corrections (method 4.6).

use std::fmt;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::ellipsoid::{Ellipsoid, Geodetic};

/// East, north and up in metres about an origin on or near the ellipsoid; PROJ calls it topocentric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalFrame {
    ellipsoid: Ellipsoid,
    longitude_deg: f64,
    latitude_deg: f64,
    height_m: f64,
    origin_m: Vector3<f64>,
    local_from_geocentric: Rotation3<f64>,
}

impl LocalFrame {
    /// The frame at a longitude, latitude and ellipsoidal height of WGS 84.
    #[must_use]
    pub fn at(longitude_deg: f64, latitude_deg: f64, height_m: f64) -> Self {
        Self::on(Ellipsoid::WGS84, longitude_deg, latitude_deg, height_m)
    }

    /// The frame whose origin is a geocentric position of WGS 84, such as the approximate projection centre.
    #[must_use]
    pub fn about(geocentric_m: Vector3<f64>) -> Self {
        let origin = Ellipsoid::WGS84.geodetic(geocentric_m);
        Self::at(origin.longitude_rad.to_degrees(), origin.latitude_rad.to_degrees(), origin.height_m)
    }

    /// The frame at a longitude, latitude and height on an ellipsoid.
    #[must_use]
    pub fn on(ellipsoid: Ellipsoid, longitude_deg: f64, latitude_deg: f64, height_m: f64) -> Self {
        let (longitude_rad, latitude_rad) = (longitude_deg.to_radians(), latitude_deg.to_radians());
        Self {
            ellipsoid,
            longitude_deg,
            latitude_deg,
            height_m,
            origin_m: ellipsoid.geocentric_m(Geodetic { longitude_rad, latitude_rad, height_m }),
            local_from_geocentric: east_north_up_from_geocentric(longitude_rad, latitude_rad),
        }
    }

    /// East, north, up of a geocentric position.
    #[must_use]
    pub fn from_geocentric(&self, geocentric_m: Vector3<f64>) -> Vector3<f64> {
        self.local_from_geocentric * (geocentric_m - self.origin_m)
    }

    /// The geocentric position of east, north, up.
    #[must_use]
    pub fn to_geocentric(&self, local_m: Vector3<f64>) -> Vector3<f64> {
        self.origin_m + self.local_from_geocentric.inverse() * local_m
    }

    /// The rotation of geocentric axes into east, north, up.
    #[must_use]
    pub fn local_from_geocentric(&self) -> Rotation3<f64> {
        self.local_from_geocentric
    }

    /// Longitude of the origin.
    #[must_use]
    pub fn longitude_deg(&self) -> f64 {
        self.longitude_deg
    }

    /// Latitude of the origin.
    #[must_use]
    pub fn latitude_deg(&self) -> f64 {
        self.latitude_deg
    }

    /// Ellipsoidal height of the origin.
    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.height_m
    }

    /// The frame as a PROJ string, which [`Crs`](super::Crs) reads back to the very same frame.
    #[must_use]
    pub fn proj_string(&self) -> String {
        self.to_string()
    }
}

impl fmt::Display for LocalFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { ellipsoid, longitude_deg, latitude_deg, height_m, .. } = self;
        let ellps = ellipsoid.name;
        write!(f, "+proj=topocentric +ellps={ellps} +lon_0={longitude_deg} +lat_0={latitude_deg} +h_0={height_m}")
    }
}

/// The rotation of geocentric axes into east, north and up at a longitude and latitude; at the poles the longitude
/// says which way is north.
fn east_north_up_from_geocentric(longitude_rad: f64, latitude_rad: f64) -> Rotation3<f64> {
    let ((sin_lon, cos_lon), (sin_lat, cos_lat)) = (longitude_rad.sin_cos(), latitude_rad.sin_cos());
    Rotation3::from_matrix_unchecked(Matrix3::new(
        -sin_lon,
        cos_lon,
        0.0,
        -sin_lat * cos_lon,
        -sin_lat * sin_lon,
        cos_lat,
        cos_lat * cos_lon,
        cos_lat * sin_lon,
        sin_lat,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;
    use proptest::prelude::*;

    /// pyproj 3.7.2 (PROJ 9.5.1): Transformer.from_pipeline("+proj=pipeline +step +proj=cart +ellps=WGS84 +step FRAME")
    /// .transform(lon, lat, h), FRAME being what the frame prints.
    #[rustfmt::skip]
    const PROJ_TOPOCENTRIC: [([f64; 3], [f64; 3], [f64; 3]); 5] = [
        ([-98.08966904, 30.17120787, 300.0], [-98.09, 30.16, 317.3], [-31.883333855746386, -1242.5131122398993, 17.178393795540387]),
        ([-98.08966904, 30.17120787, 300.0], [-98.0, 30.2, 0.0], [8634.427295000025, 3195.1637664291084, -306.6431633995571]),
        ([16.63618776, 52.774949613, 40.0], [16.64, 52.77, 150.0], [257.3072864335638, -550.8088811593384, 109.97102991368686]),
        ([16.63618776, 52.774949613, 40.0], [16.6, 52.8, 12.0], [-2440.762167861823, 2788.2826895228372, -29.07568692773293]),
        ([30.0, -90.0, 2800.0], [10.0, -89.99, 2900.0], [-382.1890189454768, 1050.0556995158206, 99.90248444583274]),
    ];

    #[test]
    fn local_coordinates_are_those_of_proj_both_ways() {
        for ([lon_0, lat_0, h_0], [longitude_deg, latitude_deg, height_m], local_m) in PROJ_TOPOCENTRIC {
            let frame = LocalFrame::at(lon_0, lat_0, h_0);
            let geocentric_m = Ellipsoid::WGS84.geocentric_m(Geodetic {
                longitude_rad: longitude_deg.to_radians(),
                latitude_rad: latitude_deg.to_radians(),
                height_m,
            });
            assert_abs_diff_eq!(frame.from_geocentric(geocentric_m), Vector3::from(local_m), epsilon = 3e-9);
            assert_abs_diff_eq!(frame.to_geocentric(Vector3::from(local_m)), geocentric_m, epsilon = 3e-9);
        }
    }

    #[test]
    fn axes_point_east_north_and_up() {
        let frame = LocalFrame::at(90.0, 0.0, 0.0);
        let axes = frame.local_from_geocentric();
        assert_abs_diff_eq!(axes * -Vector3::x(), Vector3::x(), epsilon = 1e-15);
        assert_abs_diff_eq!(axes * Vector3::z(), Vector3::y(), epsilon = 1e-15);
        assert_abs_diff_eq!(axes * Vector3::y(), Vector3::z(), epsilon = 1e-15);
    }

    #[test]
    fn the_proj_string_names_the_origin() {
        let frame = LocalFrame::at(-98.089_669_04, 30.171_207_87, 300.5);
        assert_eq!(
            frame.proj_string(),
            "+proj=topocentric +ellps=WGS84 +lon_0=-98.08966904 +lat_0=30.17120787 +h_0=300.5"
        );
    }

    proptest! {
        #[test]
        fn a_frame_about_a_position_has_it_for_its_origin(
            lon in -180.0..180.0, lat in -90.0..90.0, h in -1e5..1e5, local in prop::array::uniform3(-1e4..1e4),
        ) {
            let frame = LocalFrame::at(lon, lat, h);
            let position = frame.to_geocentric(Vector3::from(local));
            prop_assert!((frame.from_geocentric(position) - Vector3::from(local)).norm() < 5e-9);
            prop_assert!(LocalFrame::about(position).from_geocentric(position).norm() < 8e-9);
        }
    }
}
