//! Map projections, carried out by the geodesy library, but for the one that it does not have ([`stereographic`]).
//!
//! Its operations are looked up by a handle in a context that is not to be shared while it grows; here every
//! projection holds its own operation, which never changes, so that threads can share it.

use std::f64::consts::FRAC_PI_2;
use std::ops::RangeInclusive;
use std::sync::Arc;

use geodesy::authoring::{Coor2D, Direction, Minimal, Op};

use super::stereographic::{self, ObliqueStereographic};
use super::{CrsError, Ellipsoid};

/// Between longitude and latitude on an ellipsoid and easting and northing of a map grid.
#[derive(Debug, Clone)]
pub(super) struct Projection {
    formula: Formula,
    easting_range_m: [f64; 2],
    northing_range_m: [f64; 2],
}

#[derive(Debug, Clone)]
enum Formula {
    OfLibrary(Arc<Op>),
    Stereographic(ObliqueStereographic),
}

/// The defining parameters of a transverse Mercator projection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TransverseMercator {
    /// The ellipsoid that is projected.
    pub(super) ellipsoid: Ellipsoid,
    /// Longitude of the central meridian.
    pub(super) central_meridian_deg: f64,
    /// Latitude that has the false northing.
    pub(super) latitude_of_origin_deg: f64,
    /// Scale on the central meridian.
    pub(super) scale: f64,
    /// Easting of the central meridian.
    pub(super) false_easting_m: f64,
    /// Northing of the latitude of origin.
    pub(super) false_northing_m: f64,
}

/// Farther from its central meridian a transverse Mercator grid is hardly used (Norway stretches zone 33 by 600 km);
/// a wrong zone prefix or exchanged axes lead far beyond.
const WIDEST_M: f64 = 750_000.0;

/// Half of the side of the square to which web maps cut the world.
const WEB_MERCATOR_EDGE_M: f64 = 20_037_508.342_789_244;

/// The Netherlands and their part of the North Sea, with 100 km to spare; to the south so much that no easting of the
/// country (at most 278 km) is a northing: exchanged axes are noticed.
const RD_EASTINGS_M: [f64; 2] = [-150_000.0, 400_000.0];
const RD_NORTHINGS_M: [f64; 2] = [280_000.0, 900_000.0];

impl TransverseMercator {
    /// The zone (1 to 60) of Universal Transverse Mercator in the northern or southern hemisphere.
    pub(super) fn utm(ellipsoid: Ellipsoid, zone: u32, southern: bool) -> Self {
        Self {
            ellipsoid,
            central_meridian_deg: 6.0 * f64::from(zone) - 183.0,
            latitude_of_origin_deg: 0.0,
            scale: 0.9996,
            false_easting_m: 500_000.0,
            false_northing_m: if southern { 10_000_000.0 } else { 0.0 },
        }
    }
}

impl Projection {
    /// A transverse Mercator grid from pole to pole.
    pub(super) fn transverse_mercator(parameters: TransverseMercator) -> Result<Self, CrsError> {
        let TransverseMercator { ellipsoid, central_meridian_deg, latitude_of_origin_deg, scale, .. } = parameters;
        let [x_0, y_0] = [parameters.false_easting_m, parameters.false_northing_m];
        let operation = operation(&format!(
            "tmerc ellps={} lon_0={central_meridian_deg} lat_0={latitude_of_origin_deg} k_0={scale} x_0={x_0} y_0={y_0}",
            ellipsoid.name
        ))?;
        let mut grid = Self {
            formula: Formula::OfLibrary(operation),
            easting_range_m: [x_0 - WIDEST_M, x_0 + WIDEST_M],
            northing_range_m: [0.0; 2],
        };
        grid.northing_range_m =
            [-FRAC_PI_2, FRAC_PI_2].map(|pole| grid.easting_northing_m(central_meridian_deg.to_radians(), pole).1);
        Ok(grid)
    }

    /// The spherical Mercator projection of web maps, on the latitudes of WGS 84.
    pub(super) fn web_mercator() -> Result<Self, CrsError> {
        let range_m = [-WEB_MERCATOR_EDGE_M, WEB_MERCATOR_EDGE_M];
        let formula = Formula::OfLibrary(operation("webmerc ellps=WGS84")?);
        Ok(Self { formula, easting_range_m: range_m, northing_range_m: range_m })
    }

    /// Rijksdriehoekscoördinaten, RD New.
    pub(super) fn rd_new() -> Self {
        let parameters = stereographic::Parameters {
            ellipsoid: Ellipsoid::BESSEL,
            // 5° 23′ 15.5″ and 52° 09′ 22.178″
            longitude_of_origin_deg: 5.0 + (23.0 + 15.5 / 60.0) / 60.0,
            latitude_of_origin_deg: 52.0 + (9.0 + 22.178 / 60.0) / 60.0,
            scale: 0.999_907_9,
            false_easting_m: 155_000.0,
            false_northing_m: 463_000.0,
        };
        Self {
            formula: Formula::Stereographic(ObliqueStereographic::new(&parameters)),
            easting_range_m: RD_EASTINGS_M,
            northing_range_m: RD_NORTHINGS_M,
        }
    }

    /// Easting and northing, not finite or out of range where the grid does not reach.
    pub(super) fn easting_northing_m(&self, longitude_rad: f64, latitude_rad: f64) -> (f64, f64) {
        match &self.formula {
            Formula::OfLibrary(operation) => {
                let position = apply(operation, Direction::Fwd, vec![[longitude_rad, latitude_rad]]);
                position[0].into()
            }
            Formula::Stereographic(grid) => grid.easting_northing_m(longitude_rad, latitude_rad),
        }
    }

    /// Longitudes and latitudes of grid positions within range.
    pub(super) fn longitudes_latitudes_rad(&self, positions_m: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
        match &self.formula {
            Formula::OfLibrary(operation) => apply(operation, Direction::Inv, positions_m),
            Formula::Stereographic(grid) => {
                positions_m.into_iter().map(|[x, y]| grid.longitude_latitude_rad(x, y).into()).collect()
            }
        }
    }

    /// The eastings of the grid.
    pub(super) fn easting_range_m(&self) -> RangeInclusive<f64> {
        self.easting_range_m[0]..=self.easting_range_m[1]
    }

    /// The northings of the grid.
    pub(super) fn northing_range_m(&self) -> RangeInclusive<f64> {
        self.northing_range_m[0]..=self.northing_range_m[1]
    }
}

/// The library reads the parameters anew for each call, which costs as much as a position: many at once are cheaper.
fn apply(operation: &Op, direction: Direction, coordinates: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let mut operands: Vec<Coor2D> = coordinates.into_iter().map(Coor2D).collect();
    // The count of successes is of no use: a failure leaves NaN behind, which the callers' ranges refuse.
    operation.apply(&Minimal::default(), &mut operands, direction);
    operands.into_iter().map(|operand| operand.0).collect()
}

/// An operation of the library. Every definition is made here from checked numbers, so that it fails only by a defect.
fn operation(definition: &str) -> Result<Arc<Op>, CrsError> {
    Op::new(definition, &Minimal::default()).map(Arc::new).map_err(|fault| CrsError::Parameter {
        parameter: "proj".into(),
        reason: format!("the projection \"{definition}\" cannot be made: {fault}"),
    })
}
