//! Coordinate reference systems, by EPSG code or PROJ string, and the way between them and geocentric coordinates.
//!
//! A position is always in the order east or longitude, north or latitude, up (contract, section Coordinates). The
//! geocentric coordinates between which systems meet are those of WGS 84; ETRS89 and its Polish realisation are
//! taken as the same, which neglects the drift of the European plate (a few decimetres since 1989).
//!
//! Every height is above the ellipsoid of WGS 84 or GRS 80, those of DHDN and of RD New too, whose own ellipsoid is used
//! for the horizontal position only; with a geoid undulation it is above the geoid. The heights of a compound system are above the
//! zero of its height system, which a grid tells ([`geoid`](super::geoid)).
//!
//! RD New (EPSG:28992, with NAP heights 7415) goes to ETRS89 by the Helmert transformation of RDNAPTRANS 2018 alone; its
//! correction grid, up to 0.25 m in the plane, is neglected, and told as [`Crs::accuracy_m`].

mod catalogue;
mod datum;
mod proj_string;
mod projection;
mod stereographic;
#[cfg(test)]
mod tests;
mod vertical;

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;
use std::sync::Arc;

use nalgebra::{Matrix3, Rotation3, Vector3};

use self::datum::Datum;
use self::projection::Projection;
use self::vertical::Heights;
use super::ellipsoid::{Ellipsoid, Geodetic};
use super::geoid::Geoids;
use super::local_frame::LocalFrame;

/// A coordinate reference system. Cheap to clone and to share; equal if written the same.
#[derive(Debug, Clone)]
pub struct Crs {
    name: String,
    system: System,
    /// Those of a compound system; else heights are above the ellipsoid.
    heights: Option<Heights>,
}

/// A height system that is known, for people who look for its grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeightSystem {
    /// Its code in the EPSG register.
    pub code: u32,
    /// What it is called there.
    pub name: &'static str,
    /// The grids that lead to it, file names without their ending, those to be preferred first.
    pub grids: &'static [&'static str],
}

/// What the coordinates of a system mean.
#[derive(Debug, Clone)]
enum System {
    /// Longitude and latitude in degrees, height in metres.
    Geographic(Ellipsoid),
    /// East, north, up in metres.
    Topocentric(LocalFrame),
    /// Grid east and grid north, height in metres.
    Projected(Projection, Datum),
}

/// Why a coordinate reference system or a position in it is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CrsError {
    /// Neither an EPSG code of the list nor a PROJ string.
    #[error("the CRS \"{given}\" is not known; known are {}", catalogue::KNOWN)]
    Unknown {
        /// What was given, shortened if long.
        given: String,
    },
    /// A compound system for whose heights there is no grid.
    #[error(
        "the heights of {given} ({heights}) need a geoid grid, and there is none: put {files} from https://cdn.proj.org/ \
         into the folder of geoid grids (setting geoid_folder); or give the horizontal CRS with ellipsoidal heights, or \
         beside it \"vertical\": {{\"geoid_undulation_m\": N}}"
    )]
    GeoidGridMissing {
        /// The compound system.
        given: String,
        /// What its heights are called.
        heights: &'static str,
        /// The files that would serve.
        files: String,
    },
    /// A grid that cannot be read.
    #[error("the geoid grid {file} for the heights of {crs} cannot be used: {reason}")]
    GeoidGridUnreadable {
        /// The compound system.
        crs: String,
        /// The grid's name.
        file: String,
        /// What is wrong with it.
        reason: String,
    },
    /// A place about which no grid says anything.
    #[error(
        "the geoid grids for the heights of {crs} ({heights}) do not reach longitude {longitude_deg:.6}, latitude \
         {latitude_deg:.6} degrees"
    )]
    OutsideGeoidGrid {
        /// The compound system.
        crs: String,
        /// What its heights are called.
        heights: &'static str,
        /// Longitude of the place.
        longitude_deg: f64,
        /// Latitude of the place.
        latitude_deg: f64,
    },
    /// A compound system of a height system that is not known.
    #[error("the height system EPSG:{code} of \"{given}\" is not known; known are {}", vertical::KNOWN)]
    UnknownHeights {
        /// What was given, shortened if long.
        given: String,
        /// The code after the plus.
        code: u32,
    },
    /// A parameter of a PROJ string that is missing, wrong or not understood.
    #[error("the parameter +{parameter} of the PROJ string: {reason}")]
    Parameter {
        /// Its name without the plus.
        parameter: String,
        /// What is wrong and what would be right.
        reason: String,
    },
    /// A coordinate that is not finite or not plausible in its system.
    #[error("the {coordinate} is {value}; in {crs} it must be from {minimum} to {maximum}")]
    OutOfRange {
        /// The system.
        crs: String,
        /// Where the coordinate stands: 0, 1 or 2.
        index: usize,
        /// What it is called in the system.
        coordinate: &'static str,
        /// Its value.
        value: f64,
        /// The least that is plausible.
        minimum: f64,
        /// The most that is plausible.
        maximum: f64,
    },
    /// No undulation of the Earth's geoid.
    #[error("the geoid undulation is {value_m} m; it must be from -150 to 150 m")]
    Undulation {
        /// Its value.
        value_m: f64,
    },
    /// A geoid undulation beside a system whose heights have their own grid.
    #[error("{crs} says itself what its heights are above; leave the geoid undulation out")]
    UndulationBesideCompound {
        /// The system.
        crs: String,
    },
    /// A geoid undulation beside a system that has no heights.
    #[error("{crs} has no heights to which a geoid undulation could be added; leave it out")]
    UndulationWithoutHeight {
        /// The system.
        crs: String,
    },
}

/// Heights in which cameras and buildings are found, and far more.
const HEIGHT_RANGE_M: RangeInclusive<f64> = -100_000.0..=100_000.0;

/// The geoid is between 107 m below and 86 m above the ellipsoid.
const UNDULATION_RANGE_M: RangeInclusive<f64> = -150.0..=150.0;

/// So far away nobody uses a tangent plane.
const LOCAL_RANGE_M: RangeInclusive<f64> = -1_000_000.0..=1_000_000.0;

/// Half of the distance over which the direction of grid north is taken; rounding and curvature of the grid line then
/// each make less than 1e-10 rad.
const NORTH_STEP_M: f64 = 50.0;

impl Crs {
    /// Reads `EPSG:<code>`, a compound `EPSG:<horizontal>+<vertical>`, or a PROJ string.
    ///
    /// Of the PROJ strings `+proj=topocentric`, `utm`, `tmerc` and `longlat` are understood, on WGS 84 or GRS 80
    /// (the latter is PROJ's default), with the parameters in any order; a missing plus is forgiven, as a URL may
    /// have turned it into a space.
    ///
    /// Whether there is a grid for the heights of a compound system shows when it is first used, or by
    /// [`Self::check_heights`].
    ///
    /// # Errors
    /// [`CrsError::Unknown`], [`CrsError::UnknownHeights`], and [`CrsError::Parameter`], which names the parameter.
    pub fn parse(given: &str) -> Result<Self, CrsError> {
        let given = given.trim();
        match given.get(..5) {
            Some(prefix) if prefix.eq_ignore_ascii_case("EPSG:") => catalogue::find(given, &given[5..]),
            _ => proj_string::parse(given).map(|(name, system)| Self { name, system, heights: None }),
        }
    }

    /// The height systems that compounds may name.
    pub fn height_systems() -> impl Iterator<Item = HeightSystem> {
        vertical::all().map(|&vertical::VerticalSystem { code, name, grids, .. }| HeightSystem { code, name, grids })
    }

    /// The same system, whose grids are looked for here.
    #[must_use]
    pub fn with_geoids(mut self, geoids: Arc<dyn Geoids>) -> Self {
        if let Some(heights) = &mut self.heights {
            heights.geoids = Some(geoids);
        }
        self
    }

    /// The same system with ellipsoidal heights: for what lies in the plane alone, which no grid need reach.
    #[must_use]
    pub fn horizontal(&self) -> Self {
        Self { heights: None, ..self.clone() }
    }

    /// Whether heights in it, with this undulation beside it if any, can be computed anywhere.
    ///
    /// # Errors
    /// [`CrsError::GeoidGridMissing`], [`CrsError::GeoidGridUnreadable`], [`CrsError::Undulation`],
    /// [`CrsError::UndulationBesideCompound`].
    pub fn check_heights(&self, geoid_undulation_m: Option<f64>) -> Result<(), CrsError> {
        self.checked_undulation_m(geoid_undulation_m)?;
        self.heights.as_ref().map_or(Ok(()), |heights| heights.check(&self.name))
    }

    /// The code of its height system in the EPSG register; `None` if its heights are ellipsoidal, or if it has none.
    #[must_use]
    pub fn heights_code(&self) -> Option<u32> {
        self.heights.as_ref().map(|heights| heights.system.code)
    }

    /// Whether its first two coordinates are the same as those of another one, whatever the heights of both: of compounds
    /// the horizontal systems are compared, under a code of their own or as two with a plus.
    #[must_use]
    pub fn lies_in_plane_of(&self, other: &Self) -> bool {
        catalogue::horizontal_name(&self.name) == catalogue::horizontal_name(&other.name)
    }

    /// Whether its first two coordinates are longitude and latitude in degrees.
    #[must_use]
    pub fn is_geographic(&self) -> bool {
        matches!(self.system, System::Geographic(_))
    }

    /// Whether it is a two-dimensional map grid, whose register knows no height: a height in it is taken as
    /// ellipsoidal, which deserves the warning `vertical_assumed_ellipsoidal` where no undulation was given.
    #[must_use]
    pub fn assumes_ellipsoidal_heights(&self) -> bool {
        matches!(self.system, System::Projected(..)) && self.heights.is_none()
    }

    /// How well the published transformation to WGS 84 and to ellipsoidal heights is known, as a standard deviation in
    /// metres; to be added to the accuracy of the positions. 0 where there is nothing to transform.
    #[must_use]
    pub fn accuracy_m(&self) -> f64 {
        let of_datum_m = match &self.system {
            System::Projected(_, datum) => datum.accuracy_m(),
            System::Geographic(_) | System::Topocentric(_) => 0.0,
        };
        self.heights.as_ref().map_or(of_datum_m, |heights| heights.system.accuracy_m.hypot(of_datum_m))
    }

    /// The geocentric coordinates of a position `[east or longitude, north or latitude, up]`.
    ///
    /// With a geoid undulation N the third coordinate is a height above the geoid, and N is added to it.
    ///
    /// # Errors
    /// [`CrsError::OutOfRange`] for a coordinate that is not finite or not plausible, [`CrsError::Undulation`],
    /// [`CrsError::UndulationWithoutHeight`] for an undulation in a topocentric frame,
    /// [`CrsError::UndulationBesideCompound`] for one beside a compound system, and [`CrsError::GeoidGridMissing`],
    /// [`CrsError::GeoidGridUnreadable`] or [`CrsError::OutsideGeoidGrid`] where its grid does not tell.
    pub fn geocentric_from_position(
        &self,
        position: [f64; 3],
        geoid_undulation_m: Option<f64>,
    ) -> Result<Vector3<f64>, CrsError> {
        self.geocentric_from_positions(&[position], geoid_undulation_m).map(|all| all[0])
    }

    /// The same for many positions, in their order, which takes half as long for each.
    ///
    /// # Errors
    /// As for one, of the first that is wrong.
    pub fn geocentric_from_positions(
        &self,
        positions: &[[f64; 3]],
        geoid_undulation_m: Option<f64>,
    ) -> Result<Vec<Vector3<f64>>, CrsError> {
        positions.iter().try_for_each(|position| self.check_position(*position))?;
        let undulation_m = self.checked_undulation_m(geoid_undulation_m)?;
        let mut geocentric_m: Vec<Vector3<f64>> = match &self.system {
            System::Topocentric(_) if geoid_undulation_m.is_some() => {
                return Err(CrsError::UndulationWithoutHeight { crs: self.name.clone() });
            }
            System::Topocentric(frame) => positions.iter().map(|p| frame.to_geocentric(Vector3::from(*p))).collect(),
            System::Geographic(ellipsoid) => {
                let geodetic = |[x, y, z]: &[f64; 3]| Geodetic {
                    longitude_rad: x.to_radians(),
                    latitude_rad: y.to_radians(),
                    height_m: z + undulation_m,
                };
                positions.iter().map(|position| ellipsoid.geocentric_m(geodetic(position))).collect()
            }
            System::Projected(projection, datum) => {
                let plane = projection.longitudes_latitudes_rad(positions.iter().map(|[x, y, _]| [*x, *y]).collect());
                let geodetic = |([longitude_rad, latitude_rad], [.., z]): ([f64; 2], &[f64; 3])| {
                    datum.geocentric_m(Geodetic { longitude_rad, latitude_rad, height_m: z + undulation_m })
                };
                plane.into_iter().zip(positions).map(geodetic).collect()
            }
        };
        let Some(heights) = &self.heights else { return Ok(geocentric_m) };
        for point_m in &mut geocentric_m {
            // so far the height was taken as ellipsoidal; longitude and latitude, all that the grid needs, are right
            let ground = self.ellipsoid().geodetic(*point_m);
            let height_m = ground.height_m + self.grid_undulation_m(heights, ground)?;
            *point_m = self.ellipsoid().geocentric_m(Geodetic { height_m, ..ground });
        }
        Ok(geocentric_m)
    }

    /// The ellipsoid to which its heights refer.
    fn ellipsoid(&self) -> Ellipsoid {
        match self.system {
            System::Geographic(ellipsoid) | System::Projected(_, Datum::Modern(ellipsoid)) => ellipsoid,
            System::Projected(_, Datum::Bessel(_)) => Ellipsoid::GRS80,
            System::Topocentric(_) => Ellipsoid::WGS84,
        }
    }

    fn grid_undulation_m(&self, heights: &Heights, place: Geodetic) -> Result<f64, CrsError> {
        heights.undulation_m(&self.name, place.longitude_rad.to_degrees(), place.latitude_rad.to_degrees())
    }

    /// The position `[east or longitude, north or latitude, up]` of geocentric coordinates.
    ///
    /// With a geoid undulation N its height is above the geoid; in a topocentric frame, whose up is no height, N has
    /// no effect.
    ///
    /// # Errors
    /// [`CrsError::OutOfRange`] where the system does not reach, [`CrsError::Undulation`], and the errors of compound
    /// systems as in [`Self::geocentric_from_position`].
    pub fn position_from_geocentric(
        &self,
        geocentric_m: Vector3<f64>,
        geoid_undulation_m: Option<f64>,
    ) -> Result<[f64; 3], CrsError> {
        let undulation_m = self.checked_undulation_m(geoid_undulation_m)?;
        let position = self.ellipsoidal_position(geocentric_m, undulation_m)?;
        let Some(heights) = &self.heights else { return Ok(position) };
        // down to where the height above the geoid would be an ellipsoidal one, as on the way there: a datum on Bessel's
        // ellipsoid, whose transformation depends on it, then sees the same
        let place = self.ellipsoid().geodetic(geocentric_m);
        let height_m = place.height_m - self.grid_undulation_m(heights, place)?;
        self.ellipsoidal_position(self.ellipsoid().geocentric_m(Geodetic { height_m, ..place }), 0.0)
    }

    /// A position whose height is above the ellipsoid, or above a geoid that lies as high above it everywhere.
    fn ellipsoidal_position(&self, geocentric_m: Vector3<f64>, undulation_m: f64) -> Result<[f64; 3], CrsError> {
        let position = match &self.system {
            System::Topocentric(frame) => frame.from_geocentric(geocentric_m).into(),
            System::Geographic(ellipsoid) => {
                let Geodetic { longitude_rad, latitude_rad, height_m } = ellipsoid.geodetic(geocentric_m);
                [longitude_rad.to_degrees(), latitude_rad.to_degrees(), height_m - undulation_m]
            }
            System::Projected(projection, datum) => {
                let Geodetic { longitude_rad, latitude_rad, height_m } = datum.geodetic(geocentric_m);
                let (easting_m, northing_m) = projection.easting_northing_m(longitude_rad, latitude_rad);
                [easting_m, northing_m, height_m - undulation_m]
            }
        };
        self.check_position(position)?;
        Ok(position)
    }

    /// The rotation of geocentric axes into those that an orientation in this system refers to at a point: the axes
    /// of a topocentric frame; local east, north, up for a geographic system; grid east, grid north and the
    /// ellipsoid's up for a map grid, that is local axes turned by the convergence of the meridians. The heights of a
    /// compound system turn nothing: up is the ellipsoid's, not the plumb line's.
    ///
    /// # Errors
    /// [`CrsError::OutOfRange`] where the system does not reach.
    pub fn axes_from_geocentric(&self, at_geocentric_m: Vector3<f64>) -> Result<Rotation3<f64>, CrsError> {
        let [easting_m, northing_m, _] = self.horizontal().position_from_geocentric(at_geocentric_m, None)?;
        let local = LocalFrame::about(at_geocentric_m).local_from_geocentric();
        let (projection, datum) = match &self.system {
            System::Topocentric(frame) => return Ok(frame.local_from_geocentric()),
            System::Geographic(_) => return Ok(local),
            System::Projected(projection, datum) => (projection, datum),
        };
        // on the ellipsoid itself, where the convergence of the meridians is defined
        let ground_m = |northing_m: f64| {
            let [longitude_rad, latitude_rad] = projection.longitudes_latitudes_rad(vec![[easting_m, northing_m]])[0];
            datum.geocentric_m(Geodetic { longitude_rad, latitude_rad, height_m: 0.0 })
        };
        let north = local * (ground_m(northing_m + NORTH_STEP_M) - ground_m(northing_m - NORTH_STEP_M));
        let (sin, cos) = (north.x / north.xy().norm(), north.y / north.xy().norm());
        let grid_from_local =
            Rotation3::from_matrix_unchecked(Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0));
        Ok(grid_from_local * local)
    }

    /// The undulation to be added to heights, 0 if none was given.
    fn checked_undulation_m(&self, given_m: Option<f64>) -> Result<f64, CrsError> {
        match given_m {
            Some(value_m) if !UNDULATION_RANGE_M.contains(&value_m) => Err(CrsError::Undulation { value_m }),
            Some(_) if self.heights.is_some() => Err(CrsError::UndulationBesideCompound { crs: self.name.clone() }),
            other => Ok(other.unwrap_or(0.0)),
        }
    }

    /// Refuses coordinates that are not finite or not plausible.
    fn check_position(&self, position: [f64; 3]) -> Result<(), CrsError> {
        let coordinates = match &self.system {
            System::Geographic(_) => {
                [("longitude", -180.0..=180.0), ("latitude", -90.0..=90.0), ("height", HEIGHT_RANGE_M)]
            }
            System::Topocentric(_) => ["east", "north", "up"].map(|name| (name, LOCAL_RANGE_M)),
            System::Projected(projection, _) => [
                ("easting", projection.easting_range_m()),
                ("northing", projection.northing_range_m()),
                ("height", HEIGHT_RANGE_M),
            ],
        };
        for (index, ((coordinate, range), value)) in coordinates.into_iter().zip(position).enumerate() {
            if !range.contains(&value) {
                let (minimum, maximum) = range.into_inner();
                return Err(CrsError::OutOfRange {
                    crs: self.name.clone(),
                    index,
                    coordinate,
                    value,
                    minimum,
                    maximum,
                });
            }
        }
        Ok(())
    }
}

impl FromStr for Crs {
    type Err = CrsError;

    fn from_str(given: &str) -> Result<Self, CrsError> {
        Self::parse(given)
    }
}

impl fmt::Display for Crs {
    /// As it was given, without superfluous spaces and with the pluses.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl PartialEq for Crs {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Crs {}
