//! Where the compass points: the magnetic declination by NOAA's and BGS's World Magnetic Model.

use world_magnetic_model::GeomagneticField;
use world_magnetic_model::time::{Date, Month};
use world_magnetic_model::uom::si::angle::{degree, radian};
use world_magnetic_model::uom::si::f32::{Angle, Length};
use world_magnetic_model::uom::si::length::meter;

/// How far magnetic north lies from true north, clockwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Declination {
    /// The angle.
    pub declination_rad: f64,
    /// Standard deviation by the model's own error model, which knows nothing of iron near the compass.
    pub sigma_rad: f64,
    /// Near the magnetic poles, where a compass is not to be relied on.
    pub near_pole: bool,
}

/// Why there is no declination.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DeclinationError {
    /// No day of the calendar.
    #[error("{year}-{month:02}-{day:02} is no date")]
    NoDate {
        /// Year.
        year: i32,
        /// Month.
        month: u8,
        /// Day of the month.
        day: u8,
    },
    /// The magnetic field drifts: a model holds for five years.
    #[error("{detail}; give the true bearing instead")]
    OutOfModel {
        /// The model's own words.
        detail: String,
    },
}

/// The declination at a place of WGS 84 on a day `[year, month, day]`.
///
/// # Errors
/// [`DeclinationError`] for what is no date, and for days and places that the model does not cover.
pub fn declination(
    longitude_deg: f64,
    latitude_deg: f64,
    height_m: f64,
    [year, month, day]: [u16; 3],
) -> Result<Declination, DeclinationError> {
    let (year, month, day) = (i32::from(year), month.min(99) as u8, day.min(99) as u8);
    let no_date = DeclinationError::NoDate { year, month, day };
    let named = Month::try_from(month).map_err(|_| no_date.clone())?;
    let date = Date::from_calendar_date(year, named, day).map_err(|_| no_date)?;
    let field = GeomagneticField::new(
        Length::new::<meter>(height_m as f32),
        Angle::new::<degree>(latitude_deg as f32),
        Angle::new::<degree>(longitude_deg as f32),
        date,
    )
    .map_err(|error| DeclinationError::OutOfModel { detail: format!("the World Magnetic Model says: {error}") })?;
    Ok(Declination {
        declination_rad: field.declination().get::<radian>().into(),
        sigma_rad: field.declination_uncertainty().get::<radian>().into(),
        near_pole: field.declination_warning().is_some(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn declinations_are_those_of_the_test_table_of_wmm2025() {
        // NOAA, WMM2025 test values, at the height of the ellipsoid on the first day of 2025 (240° east is -120°)
        for (latitude, longitude, expected) in [(80.0, 0.0, 1.28), (0.0, 120.0, -0.16), (-80.0, -120.0, 68.78)] {
            let found = declination(longitude, latitude, 0.0, [2025, 1, 1]).unwrap();
            assert!((found.declination_rad.to_degrees() - expected).abs() < 0.006, "{latitude} {longitude}: {found:?}");
        }
        let home = declination(13.4, 52.5, 80.0, [2026, 5, 1]).unwrap();
        assert!((home.sigma_rad.to_degrees() - 0.37).abs() < 0.1 && !home.near_pole, "{home:?}");
        // the magnetic south pole of 2025
        assert!(declination(136.0, -64.0, 0.0, [2026, 1, 1]).unwrap().near_pole);
    }

    #[test]
    fn days_that_no_model_covers_are_refused() {
        for year in [2012, 2031] {
            let error = declination(7.0, 51.0, 0.0, [year, 5, 1]).unwrap_err();
            assert!(error.to_string().contains("validity") && error.to_string().contains("true bearing"), "{error}");
        }
        let no_date = declination(7.0, 51.0, 0.0, [2026, 2, 30]).unwrap_err();
        assert_eq!(no_date.to_string(), "2026-02-30 is no date");
        assert!(matches!(declination(7.0, 51.0, 0.0, [2026, 13, 1]), Err(DeclinationError::NoDate { .. })));
    }
}
