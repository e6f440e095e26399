//! Geodetic datums: what longitude and latitude refer to.

use nalgebra::Vector3;

use crate::geometry::ellipsoid::{Ellipsoid, Geodetic};

/// The datum of a map grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Datum {
    /// WGS 84 or ETRS89, by its ellipsoid.
    Modern(Ellipsoid),
    /// One of triangulation on Bessel's ellipsoid, by the published way from there to ETRS89.
    Bessel(&'static Helmert),
}

/// A Helmert transformation from Bessel's ellipsoid to ETRS89, linear in its rotations (EPSG methods 9606 and 9607).
#[derive(Debug, PartialEq)]
pub(super) struct Helmert {
    translation_m: [f64; 3],
    /// As a position vector is turned; the coordinate frame rotations of EPSG 9607 are the negatives.
    rotation_arcsec: [f64; 3],
    scale: f64,
    accuracy_m: f64,
}

/// Deutsches Hauptdreiecksnetz: DHDN to ETRS89 (2), EPSG:1776, the same as EPSG:1777 to WGS 84, for all of western
/// Germany.
pub(super) static DHDN: Helmert = Helmert {
    translation_m: [598.1, 73.7, 418.2],
    rotation_arcsec: [0.202, 0.045, -2.455],
    scale: 1.0 + 6.7e-6,
    accuracy_m: 3.0,
};

/// The Dutch datum: Amersfoort to ETRS89 (8), EPSG:9281, whose rotations are 1.915 14, -1.603 63 and 9.095 46 µrad of the
/// coordinate frame.
///
/// It is the first step of RDNAPTRANS 2018. The second, the correction grid `nl_nsgi_rdtrans2018`, is neglected: up to
/// 0.25 m in the plane, by which the net of the triangulation is distorted, and which the accuracy stands for.
pub(super) static AMERSFOORT: Helmert = Helmert {
    translation_m: [565.7381, 50.4018, 465.2904],
    rotation_arcsec: [-0.395_025_981_036_064, 0.330_772_431_242_031, -1.876_073_294_628_21],
    scale: 1.0 + 4.072_44e-6,
    accuracy_m: 0.25,
};

impl Datum {
    /// How well its transformation to WGS 84 is known.
    pub(super) fn accuracy_m(self) -> f64 {
        match self {
            Self::Modern(_) => 0.0,
            Self::Bessel(helmert) => helmert.accuracy_m,
        }
    }

    /// Geocentric coordinates of WGS 84. Longitude and latitude are those of the datum, the height is above WGS 84 or
    /// GRS 80 in any case.
    pub(super) fn geocentric_m(self, position: Geodetic) -> Vector3<f64> {
        match self {
            Self::Modern(ellipsoid) => ellipsoid.geocentric_m(position),
            Self::Bessel(helmert) => {
                // For the horizontal position the height may as well be above Bessel's ellipsoid: the 50 m between
                // the two make 1 mm. PROJ does the same (push and pop of v_3).
                let horizontal = Ellipsoid::GRS80.geodetic(helmert.etrs89_m(Ellipsoid::BESSEL.geocentric_m(position)));
                Ellipsoid::GRS80.geocentric_m(Geodetic { height_m: position.height_m, ..horizontal })
            }
        }
    }

    /// The inverse of [`Self::geocentric_m`].
    pub(super) fn geodetic(self, geocentric_m: Vector3<f64>) -> Geodetic {
        match self {
            Self::Modern(ellipsoid) => ellipsoid.geodetic(geocentric_m),
            Self::Bessel(helmert) => {
                let target = Ellipsoid::GRS80.geodetic(geocentric_m);
                let at_height = |height_m: f64| {
                    let etrs89_m = Ellipsoid::GRS80.geocentric_m(Geodetic { height_m, ..target });
                    Ellipsoid::BESSEL.geodetic(helmert.bessel_m(etrs89_m))
                };
                // The way back starts where the way there arrived: as high above Bessel's ellipsoid as the target is
                // above GRS 80. The first look tells how far the two are apart here.
                let apart_m = target.height_m - at_height(target.height_m).height_m;
                Geodetic { height_m: target.height_m, ..at_height(target.height_m + apart_m) }
            }
        }
    }
}

impl Helmert {
    /// From the triangulation to ETRS89, geocentric.
    fn etrs89_m(&self, bessel_m: Vector3<f64>) -> Vector3<f64> {
        let turn = self.rotation_rad().cross_matrix();
        self.scale * (bessel_m + turn * bessel_m) + Vector3::from(self.translation_m)
    }

    /// The inverse of [`Self::etrs89_m`].
    fn bessel_m(&self, etrs89_m: Vector3<f64>) -> Vector3<f64> {
        let rotation_rad = self.rotation_rad();
        let (turn, reduced_m) =
            (rotation_rad.cross_matrix(), (etrs89_m - Vector3::from(self.translation_m)) / self.scale);
        // the inverse of I + K for a skew K of the vector r is I + (K² - K) / (1 + r²), since K³ = -r² K
        let turned_back_m = turn * (turn * reduced_m - reduced_m) / (1.0 + rotation_rad.norm_squared());
        reduced_m + turned_back_m
    }

    fn rotation_rad(&self) -> Vector3<f64> {
        Vector3::from(self.rotation_arcsec).map(|arcsec| (arcsec / 3600.0).to_radians())
    }
}
