//! Geodetic datums: what longitude and latitude refer to.

use nalgebra::Vector3;

use crate::geometry::ellipsoid::{Ellipsoid, Geodetic};

/// The datum of a map grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Datum {
    /// WGS 84 or ETRS89, by its ellipsoid.
    Modern(Ellipsoid),
    /// Deutsches Hauptdreiecksnetz, on Bessel's ellipsoid.
    Dhdn,
}

/// The Helmert transformation DHDN to ETRS89 (2), EPSG:1776, the same as EPSG:1777 to WGS 84: position vector, for
/// all of western Germany.
mod dhdn {
    pub(super) const TRANSLATION_M: [f64; 3] = [598.1, 73.7, 418.2];
    pub(super) const ROTATION_ARCSEC: [f64; 3] = [0.202, 0.045, -2.455];
    pub(super) const SCALE: f64 = 1.0 + 6.7e-6;
    pub(super) const ACCURACY_M: f64 = 3.0;
}

impl Datum {
    /// How well its transformation to WGS 84 is known.
    pub(super) fn accuracy_m(self) -> f64 {
        match self {
            Self::Modern(_) => 0.0,
            Self::Dhdn => dhdn::ACCURACY_M,
        }
    }

    /// Geocentric coordinates of WGS 84. Longitude and latitude are those of the datum, the height is above WGS 84 or
    /// GRS 80 in any case.
    pub(super) fn geocentric_m(self, position: Geodetic) -> Vector3<f64> {
        match self {
            Self::Modern(ellipsoid) => ellipsoid.geocentric_m(position),
            Self::Dhdn => {
                // For the horizontal position the height may as well be above Bessel's ellipsoid: the 50 m between
                // the two make 1 mm. PROJ does the same (push and pop of v_3).
                let horizontal =
                    Ellipsoid::GRS80.geodetic(etrs89_from_dhdn_m(Ellipsoid::BESSEL.geocentric_m(position)));
                Ellipsoid::GRS80.geocentric_m(Geodetic { height_m: position.height_m, ..horizontal })
            }
        }
    }

    /// The inverse of [`Self::geocentric_m`].
    pub(super) fn geodetic(self, geocentric_m: Vector3<f64>) -> Geodetic {
        match self {
            Self::Modern(ellipsoid) => ellipsoid.geodetic(geocentric_m),
            Self::Dhdn => {
                let target = Ellipsoid::GRS80.geodetic(geocentric_m);
                let at_height = |height_m: f64| {
                    let etrs89_m = Ellipsoid::GRS80.geocentric_m(Geodetic { height_m, ..target });
                    Ellipsoid::BESSEL.geodetic(dhdn_from_etrs89_m(etrs89_m))
                };
                // The way back starts where the way there arrived: as high above Bessel's ellipsoid as the target is
                // above GRS 80. The first look tells how far the two are apart here.
                let apart_m = target.height_m - at_height(target.height_m).height_m;
                Geodetic { height_m: target.height_m, ..at_height(target.height_m + apart_m) }
            }
        }
    }
}

fn etrs89_from_dhdn_m(dhdn_m: Vector3<f64>) -> Vector3<f64> {
    let turn = rotation_rad().cross_matrix();
    // linear in the rotations, as the method is defined (EPSG 9606)
    dhdn::SCALE * (dhdn_m + turn * dhdn_m) + Vector3::from(dhdn::TRANSLATION_M)
}

fn dhdn_from_etrs89_m(etrs89_m: Vector3<f64>) -> Vector3<f64> {
    let (turn, reduced_m) =
        (rotation_rad().cross_matrix(), (etrs89_m - Vector3::from(dhdn::TRANSLATION_M)) / dhdn::SCALE);
    // the inverse of I + K for a skew K of the vector r is I + (K² - K) / (1 + r²), since K³ = -r² K
    let turned_back_m = turn * (turn * reduced_m - reduced_m) / (1.0 + rotation_rad().norm_squared());
    reduced_m + turned_back_m
}

fn rotation_rad() -> Vector3<f64> {
    Vector3::from(dhdn::ROTATION_ARCSEC).map(|arcsec| (arcsec / 3600.0).to_radians())
}
