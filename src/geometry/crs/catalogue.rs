//! The EPSG codes that are known, from the EPSG register (11.022, as in PROJ 9.5.1).

use super::projection::{Projection, TransverseMercator};
use super::{CrsError, Datum, Ellipsoid, System};

/// What [`find`] and the PROJ strings understand, for the error message.
pub(super) const KNOWN: &str = "EPSG:4326, 4979, 4258 (longitude, latitude), 32601-32660 and 32701-32760 (UTM on \
    WGS 84), 25828-25838 (UTM on ETRS89), 2176-2180 (PL-2000, PL-1992), 31466-31469 (DHDN / Gauss-Krueger), 3857 \
    (web Mercator), and PROJ strings with +proj=topocentric, utm, tmerc or longlat on WGS84 or GRS80";

/// The canonical name and the system of an EPSG code; `code` is what follows the colon in `given`.
pub(super) fn find(given: &str, code: &str) -> Result<(String, System), CrsError> {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    // in a URL the plus of a compound may have become a space
    let parts: Vec<&str> = code.trim().split(['+', ' ']).collect();
    if parts.len() > 1 && parts.iter().all(|part| is_number(part)) {
        return Err(CrsError::GeoidGridMissing { given: shortened(given) });
    }
    let number = Some(code.trim()).filter(|code| is_number(code)).and_then(|code| code.parse().ok());
    match number.map(|number| Ok((number, system(number)?))).transpose()? {
        Some((number, Some(system))) => Ok((format!("EPSG:{number}"), system)),
        _ => Err(CrsError::Unknown { given: shortened(given) }),
    }
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
        4258 => return Ok(Some(System::Geographic(Ellipsoid::GRS80))),
        3857 => {
            return Ok(Some(System::Projected(Projection::web_mercator()?, Datum::Modern(Ellipsoid::WGS84))));
        }
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
        31466..=31469 => (Datum::Dhdn, three_degree_strip(Ellipsoid::BESSEL, number - 31464, 1.0)),
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
