//! The oblique stereographic projection as the Dutch have it (EPSG method 9809): conformally from the ellipsoid to the
//! sphere of Gauss, which touches it along the parallel of the origin, and from there to the plane.

use crate::geometry::ellipsoid::Ellipsoid;

/// The defining parameters of an oblique stereographic grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Parameters {
    /// The ellipsoid that is projected.
    pub(super) ellipsoid: Ellipsoid,
    /// Longitude of the origin.
    pub(super) longitude_of_origin_deg: f64,
    /// Latitude of the origin.
    pub(super) latitude_of_origin_deg: f64,
    /// Scale at the origin.
    pub(super) scale: f64,
    /// Easting of the origin.
    pub(super) false_easting_m: f64,
    /// Northing of the origin.
    pub(super) false_northing_m: f64,
}

/// An oblique stereographic grid, ready to be computed with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ObliqueStereographic {
    false_origin_m: [f64; 2],
    longitude_of_origin_rad: f64,
    eccentricity: f64,
    /// By what angles on the sphere are larger than on the ellipsoid.
    n: f64,
    /// Isometric latitude on the sphere where that on the ellipsoid is 0.
    shift: f64,
    /// Sine and cosine of the origin's latitude on the sphere.
    origin: (f64, f64),
    /// Twice the radius of the sphere, scaled.
    diameter_m: f64,
}

impl ObliqueStereographic {
    pub(super) fn new(parameters: &Parameters) -> Self {
        let Ellipsoid { semi_major_axis_m: a, flattening: f, .. } = parameters.ellipsoid;
        let e2 = f * (2.0 - f);
        let (sin, cos) = parameters.latitude_of_origin_deg.to_radians().sin_cos();
        let w2 = 1.0 - e2 * sin * sin;
        // the geometric mean of the radii of curvature at the origin
        let radius_m = a * (1.0 - e2).sqrt() / w2;
        let n = (1.0 + e2 * cos.powi(4) / (1.0 - e2)).sqrt();
        let sin_on_sphere = sin / n;
        Self {
            false_origin_m: [parameters.false_easting_m, parameters.false_northing_m],
            longitude_of_origin_rad: parameters.longitude_of_origin_deg.to_radians(),
            eccentricity: e2.sqrt(),
            n,
            shift: sin_on_sphere.atanh() - n * isometric(sin, e2.sqrt()),
            origin: (sin_on_sphere, (1.0 - sin_on_sphere * sin_on_sphere).sqrt()),
            diameter_m: 2.0 * radius_m * parameters.scale,
        }
    }

    /// Easting and northing; not finite at the point opposite to the origin.
    pub(super) fn easting_northing_m(&self, longitude_rad: f64, latitude_rad: f64) -> (f64, f64) {
        let (sin_origin, cos_origin) = self.origin;
        let isometric = self.n * isometric(latitude_rad.sin(), self.eccentricity) + self.shift;
        let (sin, cos) = (isometric.tanh(), 1.0 / isometric.cosh());
        // into the half turn to either side first: n is not 1
        let from_origin_rad = (longitude_rad - self.longitude_of_origin_rad).sin_cos();
        let (sin_longitude, cos_longitude) = (self.n * from_origin_rad.0.atan2(from_origin_rad.1)).sin_cos();
        let stretch = self.diameter_m / (1.0 + sin * sin_origin + cos * cos_origin * cos_longitude);
        let [x_0, y_0] = self.false_origin_m;
        (x_0 + stretch * cos * sin_longitude, y_0 + stretch * (sin * cos_origin - cos * sin_origin * cos_longitude))
    }

    /// Longitude and latitude, the exact inverse.
    pub(super) fn longitude_latitude_rad(&self, easting_m: f64, northing_m: f64) -> (f64, f64) {
        /// Each step makes what is missing smaller by e², 1/150.
        const STEPS: usize = 9;
        let (sin_origin, cos_origin) = self.origin;
        let [x_0, y_0] = self.false_origin_m;
        let (x, y) = ((easting_m - x_0) / self.diameter_m, (northing_m - y_0) / self.diameter_m);
        let q2 = x * x + y * y;
        // cosine of the arc from the origin, and its sine over the distance in the plane
        let (cos_arc, per_distance) = ((1.0 - q2) / (1.0 + q2), 2.0 / (1.0 + q2));
        let sin = cos_arc * sin_origin + y * per_distance * cos_origin;
        let longitude_on_sphere = (x * per_distance).atan2(cos_arc * cos_origin - y * per_distance * sin_origin);
        let isometric = (sin.atanh() - self.shift) / self.n;
        let mut sin_latitude = isometric.tanh();
        for _ in 0..STEPS {
            sin_latitude = (isometric + self.eccentricity * (self.eccentricity * sin_latitude).atanh()).tanh();
        }
        (self.longitude_of_origin_rad + longitude_on_sphere / self.n, sin_latitude.asin())
    }
}

/// The isometric latitude on an ellipsoid, by the sine of the geodetic one.
fn isometric(sin_latitude: f64, eccentricity: f64) -> f64 {
    sin_latitude.atanh() - eccentricity * (eccentricity * sin_latitude).atanh()
}
