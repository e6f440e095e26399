//! PROJ strings. What is not understood is refused by name: a parameter passed over in silence would move positions.

use std::ops::RangeInclusive;

use super::catalogue::shortened;
use super::projection::{Projection, TransverseMercator};
use super::{CrsError, Datum, Ellipsoid, HEIGHT_RANGE_M, LocalFrame, System};

/// The parameters that have not been understood yet, in the order given; a flag has no value.
struct Parameters<'a>(Vec<(&'a str, Option<&'a str>)>);

/// The canonical name and the system of a PROJ string.
pub(super) fn parse(given: &str) -> Result<(String, System), CrsError> {
    let tokens: Vec<&str> =
        given.split_whitespace().map(|token| token.trim_start_matches('+')).filter(|token| !token.is_empty()).collect();
    let mut parameters = Parameters::of(&tokens)?;
    let Some(projection) = parameters.text("proj")? else {
        return Err(CrsError::Unknown { given: shortened(given) });
    };
    parameters.drop_what_changes_nothing()?;
    let ellipsoid = parameters.ellipsoid()?;
    let system = match projection {
        "topocentric" => parameters.topocentric(ellipsoid)?,
        "longlat" => System::Geographic(ellipsoid),
        "utm" => parameters.utm(ellipsoid)?,
        "tmerc" => parameters.transverse_mercator(ellipsoid)?,
        other => {
            return Err(refused("proj", format!("{} is not topocentric, utm, tmerc or longlat", shortened(other))));
        }
    };
    match parameters.0.first() {
        Some((key, _)) => Err(refused(key, format!("it is not understood with +proj={projection}"))),
        None => Ok((tokens.iter().map(|token| format!("+{token}")).collect::<Vec<_>>().join(" "), system)),
    }
}

impl<'a> Parameters<'a> {
    /// The parameters of a string that has been split; each may come once.
    fn of(tokens: &[&'a str]) -> Result<Self, CrsError> {
        /// No projection has more parameters.
        const MOST: usize = 30;
        if tokens.len() > MOST {
            return Err(refused("proj", format!("the string has {} parameters, more than {MOST}", tokens.len())));
        }
        let mut parameters: Vec<(&str, Option<&str>)> = Vec::new();
        for token in tokens {
            let (key, value) = token.split_once('=').map_or((*token, None), |(key, value)| (key, Some(value)));
            if parameters.iter().any(|(known, _)| *known == key) {
                return Err(refused(key, "it is given twice".into()));
            }
            parameters.push((key, value));
        }
        Ok(Self(parameters))
    }

    fn topocentric(&mut self, ellipsoid: Ellipsoid) -> Result<System, CrsError> {
        let required = |key: &str, value: Option<f64>| {
            value.ok_or_else(|| refused(key, "it is missing; it tells the origin in degrees".into()))
        };
        let longitude_deg = required("lon_0", self.number("lon_0", -180.0..=180.0)?)?;
        let latitude_deg = required("lat_0", self.number("lat_0", -90.0..=90.0)?)?;
        let height_m = self.number("h_0", HEIGHT_RANGE_M)?.unwrap_or(0.0);
        Ok(System::Topocentric(LocalFrame::on(ellipsoid, longitude_deg, latitude_deg, height_m)))
    }

    fn utm(&mut self, ellipsoid: Ellipsoid) -> Result<System, CrsError> {
        let zone = self.text("zone")?.and_then(|zone| zone.parse().ok()).filter(|zone| (1..=60).contains(zone));
        let zone = zone.ok_or_else(|| refused("zone", "it must be a whole number from 1 to 60".into()))?;
        let southern = self.flag("south")?;
        projected(TransverseMercator::utm(ellipsoid, zone, southern))
    }

    fn transverse_mercator(&mut self, ellipsoid: Ellipsoid) -> Result<System, CrsError> {
        const SHIFT_RANGE_M: RangeInclusive<f64> = -1e8..=1e8;
        const SCALE_RANGE: RangeInclusive<f64> = 0.9..=1.1;
        let (k, k_0) = (self.number("k", SCALE_RANGE)?, self.number("k_0", SCALE_RANGE)?);
        if k.is_some() && k_0.is_some() {
            return Err(refused("k", "it is the same as +k_0; give one of them".into()));
        }
        projected(TransverseMercator {
            ellipsoid,
            central_meridian_deg: self.number("lon_0", -180.0..=180.0)?.unwrap_or(0.0),
            latitude_of_origin_deg: self.number("lat_0", -90.0..=90.0)?.unwrap_or(0.0),
            scale: k.or(k_0).unwrap_or(1.0),
            false_easting_m: self.number("x_0", SHIFT_RANGE_M)?.unwrap_or(0.0),
            false_northing_m: self.number("y_0", SHIFT_RANGE_M)?.unwrap_or(0.0),
        })
    }

    /// The ellipsoid by `+ellps` or `+datum`; GRS 80 without either, as in PROJ.
    fn ellipsoid(&mut self) -> Result<Ellipsoid, CrsError> {
        let named = match (self.text("ellps")?, self.text("datum")?) {
            (Some(_), Some(_)) => return Err(refused("datum", "it tells the same as +ellps; give one of them".into())),
            (_, Some("WGS84")) => return Ok(Ellipsoid::WGS84),
            (_, Some(other)) => return Err(refused("datum", format!("{} is not WGS84", shortened(other)))),
            (ellps, None) => ellps,
        };
        match named {
            None | Some("GRS80") => Ok(Ellipsoid::GRS80),
            Some("WGS84") => Ok(Ellipsoid::WGS84),
            Some(other) => Err(refused("ellps", format!("{} is not WGS84 or GRS80", shortened(other)))),
        }
    }

    /// Takes away what is written often and says only what is so in any case.
    fn drop_what_changes_nothing(&mut self) -> Result<(), CrsError> {
        self.flag("no_defs")?;
        for (key, only) in [("type", "crs"), ("units", "m")] {
            if let Some(other) = self.text(key)?.filter(|value| *value != only) {
                return Err(refused(key, format!("{} is not {only}", shortened(other))));
            }
        }
        let is_zero = |part: &str| part.parse::<f64>().is_ok_and(|shift| shift == 0.0);
        match self.text("towgs84")? {
            Some(shifts) if !shifts.split(',').all(is_zero) => {
                Err(refused("towgs84", "only shifts of zero are understood".into()))
            }
            _ => Ok(()),
        }
    }

    /// Takes a parameter out: its value, or `None` if it is not there.
    fn text(&mut self, key: &str) -> Result<Option<&'a str>, CrsError> {
        match self.take(key) {
            Some(None | Some("")) => Err(refused(key, "it has no value".into())),
            Some(value) => Ok(value),
            None => Ok(None),
        }
    }

    fn number(&mut self, key: &str, range: RangeInclusive<f64>) -> Result<Option<f64>, CrsError> {
        let Some(text) = self.text(key)? else {
            return Ok(None);
        };
        match text.parse().ok().filter(|value| range.contains(value)) {
            Some(value) => Ok(Some(value)),
            None => Err(refused(
                key,
                format!("{} is not a number from {} to {}", shortened(text), range.start(), range.end()),
            )),
        }
    }

    fn flag(&mut self, key: &str) -> Result<bool, CrsError> {
        match self.take(key) {
            Some(Some(value)) => Err(refused(key, format!("it takes no value, {} was given", shortened(value)))),
            found => Ok(found.is_some()),
        }
    }

    fn take(&mut self, key: &str) -> Option<Option<&'a str>> {
        let at = self.0.iter().position(|(known, _)| *known == key)?;
        Some(self.0.remove(at).1)
    }
}

fn projected(grid: TransverseMercator) -> Result<System, CrsError> {
    Ok(System::Projected(Projection::transverse_mercator(grid)?, Datum::Modern(grid.ellipsoid)))
}

fn refused(parameter: &str, reason: String) -> CrsError {
    CrsError::Parameter { parameter: shortened(parameter), reason }
}
