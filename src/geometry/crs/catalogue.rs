//! The EPSG codes that are known, from the EPSG register (11.022, as in PROJ 9.5.1).

use std::borrow::Cow;

use super::projection::{Projection, TransverseMercator};
use super::vertical::{self, Heights};
use super::{Crs, CrsError, Datum, Ellipsoid, System, datum};

/// What [`find`] and the PROJ strings understand, for the error message.
pub(super) const KNOWN: &str = "EPSG:4326, 4979, 4258, 4937, 6668, 6667 (longitude, latitude), 32601-32660 and 32701-32760 \
    (UTM on WGS 84), 25828-25838 (UTM on ETRS89), 2176-2180 (PL-2000, PL-1992), 31466-31469 (DHDN / Gauss-Krueger), \
    28992 (Amersfoort / RD New), 6669-6687 (JGD2011 / Japan Plane Rectangular), 3857 (web Mercator), compounds of these and a height system as \
    EPSG:25832+7837, the registered compounds 5554-5556, 5971-5976, 6697, 7415, 7423, 9286, 9518, 9707, 9924 and 10162-10174, and \
    PROJ strings with +proj=topocentric, utm, tmerc or longlat on WGS84 or GRS80";

/// The system of an EPSG code, or of two with a plus between them; `code` is what follows the colon in `given`.
pub(super) fn find(given: &str, code: &str) -> Result<Crs, CrsError> {
    let unknown = || CrsError::Unknown { given: shortened(given) };
    // in a URL the plus of a compound may have become a space
    let (horizontal, vertical) = match code.trim().split_once(['+', ' ']) {
        Some((horizontal, vertical)) => (horizontal, Some(vertical)),
        None => (code.trim(), None),
    };
    let horizontal = number(horizontal).ok_or_else(unknown)?;
    let Some(vertical) = vertical else { return by_code(horizontal)?.ok_or_else(unknown) };
    let vertical = number(vertical).ok_or_else(unknown)?;
    let system = system(horizontal)?.ok_or_else(unknown)?;
    match vertical::find(vertical) {
        Some(found) => Ok(compound(format!("EPSG:{horizontal}+{vertical}"), system, found)),
        None => Err(CrsError::UnknownHeights { given: shortened(given), code: vertical }),
    }
}

fn number(text: &str) -> Option<u32> {
    Some(text).filter(|text| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit()))?.parse().ok()
}

fn by_code(code: u32) -> Result<Option<Crs>, CrsError> {
    let name = format!("EPSG:{code}");
    if let Some((horizontal, vertical)) = registered_compound(code) {
        let (Some(system), Some(found)) = (system(horizontal)?, vertical::find(vertical)) else { return Ok(None) };
        return Ok(Some(compound(name, system, found)));
    }
    Ok(system(code)?.map(|system| Crs { name, system, heights: None }))
}

fn compound(name: String, system: System, heights: &'static vertical::VerticalSystem) -> Crs {
    Crs { name, system, heights: Some(Heights { system: heights, geoids: None }) }
}

/// The two parts of compound systems that have a code of their own.
fn registered_compound(code: u32) -> Option<(u32, u32)> {
    match code {
        // ETRS89 / UTM + DHHN92; + NN2000
        5554..=5556 => Some((code - 5554 + 25831, 5783)),
        5971..=5976 => Some((code - 5971 + 25831, 5941)),
        // JGD2011, geographic and in the plane
        6697 => Some((6668, 6695)),
        10162..=10174 => Some((code - 10162 + 6669, 6695)),
        // RD New + NAP
        7415 => Some((28992, 5709)),
        // ETRS89 + EVRF2007, + NAP, + DHHN2016
        7423 => Some((4258, 5621)),
        9286 => Some((4258, 5709)),
        9924 => Some((4258, 7837)),
        // WGS 84 + EGM2008, + EGM96
        9518 => Some((4326, 3855)),
        9707 => Some((4326, 5773)),
        _ => None,
    }
}

/// The name of the system without heights of one that [`Crs::parse`](super::Crs::parse) has named.
pub(super) fn horizontal_name(name: &str) -> Cow<'_, str> {
    let Some(code) = name.strip_prefix("EPSG:").and_then(|codes| codes.split('+').next()).and_then(number) else {
        return name.into();
    };
    let horizontal = match code {
        4979 => 4326,
        4937 => 4258,
        6667 => 6668,
        code => registered_compound(code).map_or(code, |(horizontal, _)| horizontal),
    };
    format!("EPSG:{horizontal}").into()
}

/// So much of a text as an error message bears.
pub(super) fn shortened(text: &str) -> String {
    const LONGEST: usize = 80;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

fn system(number: u32) -> Result<Option<System>, CrsError> {
    let (datum, grid) = match number {
        4326 | 4979 => return Ok(Some(System::Geographic(Ellipsoid::WGS84))),
        4258 | 4937 | 6668 | 6667 => return Ok(Some(System::Geographic(Ellipsoid::GRS80))),
        3857 => {
            return Ok(Some(System::Projected(Projection::web_mercator()?, Datum::Modern(Ellipsoid::WGS84))));
        }
        28992 => return Ok(Some(System::Projected(Projection::rd_new(), Datum::Bessel(&datum::AMERSFOORT)))),
        32601..=32660 => modern(TransverseMercator::utm(Ellipsoid::WGS84, number - 32600, false)),
        32701..=32760 => modern(TransverseMercator::utm(Ellipsoid::WGS84, number - 32700, true)),
        25828..=25838 => modern(TransverseMercator::utm(Ellipsoid::GRS80, number - 25800, false)),
        2176..=2179 => modern(three_degree_strip(Ellipsoid::GRS80, number - 2171, 0.999_923)),
        2180 => modern(TransverseMercator {
            ellipsoid: Ellipsoid::GRS80,
            central_meridian_deg: 19.0,
            latitude_of_origin_deg: 0.0,
            scale: 0.9993,
            false_easting_m: 500_000.0,
            false_northing_m: -5_300_000.0,
        }),
        6669..=6687 => modern(japanese_zone((number - 6669) as usize)),
        31466..=31469 => (Datum::Bessel(&datum::DHDN), three_degree_strip(Ellipsoid::BESSEL, number - 31464, 1.0)),
        _ => return Ok(None),
    };
    Ok(Some(System::Projected(Projection::transverse_mercator(grid)?, datum)))
}

fn modern(grid: TransverseMercator) -> (Datum, TransverseMercator) {
    (Datum::Modern(grid.ellipsoid), grid)
}

/// A strip of 3° whose number leads its eastings.
fn three_degree_strip(ellipsoid: Ellipsoid, strip: u32, scale: f64) -> TransverseMercator {
    TransverseMercator {
        ellipsoid,
        central_meridian_deg: 3.0 * f64::from(strip),
        latitude_of_origin_deg: 0.0,
        scale,
        false_easting_m: 1e6 * f64::from(strip) + 500_000.0,
        false_northing_m: 0.0,
    }
}

/// A zone of the Japanese plane rectangular system, counted from 0. Its x is to the north; here, as everywhere, east
/// comes first.
fn japanese_zone(zone: usize) -> TransverseMercator {
    /// Latitude and longitude of the origin, degrees and minutes.
    const ORIGINS: [(f64, (f64, f64)); 19] = [
        (33.0, (129.0, 30.0)),
        (33.0, (131.0, 0.0)),
        (36.0, (132.0, 10.0)),
        (33.0, (133.0, 30.0)),
        (36.0, (134.0, 20.0)),
        (36.0, (136.0, 0.0)),
        (36.0, (137.0, 10.0)),
        (36.0, (138.0, 30.0)),
        (36.0, (139.0, 50.0)),
        (40.0, (140.0, 50.0)),
        (44.0, (140.0, 15.0)),
        (44.0, (142.0, 15.0)),
        (44.0, (144.0, 15.0)),
        (26.0, (142.0, 0.0)),
        (26.0, (127.0, 30.0)),
        (26.0, (124.0, 0.0)),
        (26.0, (131.0, 0.0)),
        (20.0, (136.0, 0.0)),
        (26.0, (154.0, 0.0)),
    ];
    let (latitude_of_origin_deg, (degrees, minutes)) = ORIGINS[zone];
    TransverseMercator {
        ellipsoid: Ellipsoid::GRS80,
        central_meridian_deg: degrees + minutes / 60.0,
        latitude_of_origin_deg,
        scale: 0.9999,
        false_easting_m: 0.0,
        false_northing_m: 0.0,
    }
}
