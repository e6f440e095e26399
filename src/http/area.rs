//! Parts of the earth that a query asks for.

use serde::Deserialize;
use utoipa::IntoParams;

use super::problem::Problem;
use crate::control::GeodeticBox;
use crate::control::region::longitude_latitude_deg;
use crate::geometry::{Crs, CrsError};

/// Which control points or scenes are wanted, and in which CRS.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct AreaQuery {
    /// Only those that touch this rectangle: `min_x,min_y,max_x,max_y` in `crs`.
    #[param(example = "16.63,52.77,16.64,52.78")]
    pub(super) bbox: Option<String>,
    /// The CRS of `bbox` and of the answer; default: EPSG:4979. What it does not reach is left out.
    #[param(example = "EPSG:4979", min_length = 1)]
    pub(super) crs: Option<String>,
    /// Gives heights above the geoid: ellipsoidal height - this.
    pub(super) geoid_undulation_m: Option<f64>,
    /// Items on a page, from 1 to 200; 50 if left out.
    #[param(minimum = 1, maximum = 200)]
    pub(super) limit: Option<u32>,
    /// `next_cursor` of the page before.
    #[param(min_length = 1)]
    pub(super) cursor: Option<String>,
}

/// In which CRS one of them is wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct CrsQuery {
    /// The CRS of the answer; default: EPSG:4979.
    #[param(min_length = 1)]
    crs: Option<String>,
    /// Gives heights above the geoid: ellipsoidal height - this.
    pub(super) geoid_undulation_m: Option<f64>,
}

impl AreaQuery {
    pub(super) fn crs(&self) -> Result<Crs, Problem> {
        known_crs(self.crs.as_deref().unwrap_or(DEFAULT_CRS), self.geoid_undulation_m)
    }
}

impl CrsQuery {
    pub(super) fn crs(&self) -> Result<Crs, Problem> {
        known_crs(self.crs.as_deref().unwrap_or(DEFAULT_CRS), self.geoid_undulation_m)
    }
}

/// The CRS of an answer if the query does not say.
pub(super) const DEFAULT_CRS: &str = "EPSG:4979";

/// A CRS that is known, with an undulation that makes sense.
pub(super) fn known_crs(given: &str, geoid_undulation_m: Option<f64>) -> Result<Crs, Problem> {
    let crs = Crs::parse(given).map_err(|error| Problem::invalid_field("?crs", error.to_string()))?;
    match crs.check_heights(geoid_undulation_m) {
        Ok(()) => Ok(crs),
        Err(CrsError::Undulation { .. }) => {
            let detail = "geoid_undulation_m must be from -150 to 150 m";
            Err(Problem::invalid_field("?geoid_undulation_m", detail))
        }
        Err(error @ CrsError::UndulationBesideCompound { .. }) => {
            Err(Problem::invalid_field("?geoid_undulation_m", error.to_string()))
        }
        Err(error) => Err(Problem::invalid_field("?crs", error.to_string())),
    }
}

/// Where the next page begins, as the page before has told.
pub(super) fn cursor(given: Option<&str>) -> Result<i64, Problem> {
    let detail = "cursor is not one that this service has given; begin without one";
    given.map_or(Ok(0), |text| text.parse().map_err(|_| Problem::invalid_field("?cursor", detail)))
}

/// A rectangle in some CRS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rectangle {
    min: [f64; 2],
    max: [f64; 2],
}

/// Points on each side of a rectangle whose places bound it on the ellipsoid.
const STEPS: u32 = 16;

impl Rectangle {
    /// Understands `min_x,min_y,max_x,max_y`.
    pub(super) fn parse(text: &str) -> Result<Self, Problem> {
        let refuse = |detail: &str| Problem::invalid_field("?bbox", format!("bbox is {text:?}; {detail}"));
        let numbers: Vec<f64> = text.split(',').map_while(|number| number.trim().parse().ok()).collect();
        let [min_x, min_y, max_x, max_y] = numbers[..] else {
            return Err(refuse("it must be four numbers: min_x,min_y,max_x,max_y"));
        };
        if text.split(',').count() != 4 || !numbers.iter().all(|number| number.is_finite()) {
            return Err(refuse("it must be four finite numbers: min_x,min_y,max_x,max_y"));
        }
        if min_x > max_x || min_y > max_y {
            return Err(refuse("its minimum is above its maximum"));
        }
        Ok(Self { min: [min_x, min_y], max: [max_x, max_y] })
    }

    /// Its longitudes and latitudes, rather too many than too few.
    pub(super) fn region(&self, crs: &Crs) -> Result<GeodeticBox, Problem> {
        let crs = crs.horizontal();
        let places = self
            .rim()
            .map(|[x, y]| Ok(longitude_latitude_deg(crs.geocentric_from_position([x, y, 0.0], None)?)))
            .collect::<Result<Vec<_>, CrsError>>()
            .map_err(|error| Problem::invalid_field("?bbox", error.to_string()))?;
        if crs.is_geographic() {
            let ([min_lon_deg, min_lat_deg], [max_lon_deg, max_lat_deg]) = (self.min, self.max);
            return Ok(GeodeticBox { min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg });
        }
        Ok(GeodeticBox::around_points(places).widened())
    }

    /// Around all places of a part of the earth, in a CRS that reaches them; rather too large than too small.
    pub(super) fn around(region: GeodeticBox, crs: &Crs) -> Result<Self, Problem> {
        let crs = crs.horizontal();
        let GeodeticBox { min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg } = region;
        let wgs84 = Self { min: [min_lon_deg, min_lat_deg], max: [max_lon_deg, max_lat_deg] };
        if crs.is_geographic() {
            return Ok(wgs84);
        }
        let unreached = |error: CrsError| Problem::invalid_field("?crs", error.to_string());
        let geographic = Crs::parse(DEFAULT_CRS).map_err(unreached)?;
        let (mut min, mut max) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for [lon_deg, lat_deg] in wgs84.rim() {
            let lon_deg = (lon_deg + 180.0).rem_euclid(360.0) - 180.0;
            let place = geographic.geocentric_from_position([lon_deg, lat_deg.clamp(-90.0, 90.0), 0.0], None);
            let [x, y, _] = place.and_then(|place| crs.position_from_geocentric(place, None)).map_err(unreached)?;
            (min, max) = ([min[0].min(x), min[1].min(y)], [max[0].max(x), max[1].max(y)]);
        }
        Ok(Self { min, max })
    }

    /// Least x, least y, largest x, largest y.
    pub(super) fn bounds(&self) -> [f64; 4] {
        [self.min[0], self.min[1], self.max[0], self.max[1]]
    }

    /// Points on its four sides.
    fn rim(&self) -> impl Iterator<Item = [f64; 2]> + use<> {
        let Self { min, max } = *self;
        let at = move |step: u32, axis: usize| min[axis] + (max[axis] - min[axis]) * f64::from(step) / f64::from(STEPS);
        (0..=STEPS).flat_map(move |step| {
            [[at(step, 0), min[1]], [at(step, 0), max[1]], [min[0], at(step, 1)], [max[0], at(step, 1)]]
        })
    }

    /// Whether the box around these positions, which are in its CRS, has anything in common with it.
    pub(super) fn touches(&self, positions: impl IntoIterator<Item = [f64; 3]>) -> bool {
        let (mut min, mut max) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for position in positions {
            for axis in 0..2 {
                min[axis] = min[axis].min(position[axis]);
                max[axis] = max[axis].max(position[axis]);
            }
        }
        (0..2).all(|axis| min[axis] <= self.max[axis] && max[axis] >= self.min[axis])
    }
}
