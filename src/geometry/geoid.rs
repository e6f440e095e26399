//! Geoid grids: how high the zero of a height system lies above the ellipsoid, node by node, and between the nodes.
//!
//! Between nodes it is bilinear, in the order of operations of PROJ's `vgridshift`, so that both give the same number. A
//! place that the grid does not reach, or about which it says nothing, is refused: an undulation of 0 would be off by up
//! to 100 m.

use std::fmt;
use std::sync::{Arc, OnceLock};

/// The numbers of a grid, wherever they are kept.
pub trait Nodes: fmt::Debug + Send + Sync {
    /// The undulation at a node in metres, columns counted from the west and rows from the south; `None` where the grid
    /// says nothing.
    ///
    /// # Errors
    /// What is wrong with the file that they are read from.
    fn undulation_m(&self, column: usize, row: usize) -> Result<Option<f32>, String>;
}

/// Where the nodes of a grid lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridPlace {
    /// Longitude of the westernmost nodes.
    pub west_deg: f64,
    /// Latitude of the southernmost nodes.
    pub south_deg: f64,
    /// Longitude between neighbouring nodes.
    pub step_longitude_deg: f64,
    /// Latitude between neighbouring nodes.
    pub step_latitude_deg: f64,
    /// Nodes from west to east.
    pub columns: usize,
    /// Nodes from south to north.
    pub rows: usize,
}

/// Nodes in a rectangle of longitudes and latitudes.
#[derive(Debug)]
pub struct GridPage {
    place: GridPlace,
    nodes: Box<dyn Nodes>,
}

/// A geoid grid: one or several pages. Where several reach, the finest counts.
#[derive(Debug)]
pub struct GeoidGrid {
    pages: Vec<GridPage>,
}

/// Why a grid does not tell an undulation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GeoidFault {
    /// The grid does not reach this place, or says nothing about it.
    #[error("the grid does not reach this place")]
    Outside,
    /// It is no grid, or its file cannot be read.
    #[error("{0}")]
    Unreadable(String),
}

/// A grid and its name.
#[derive(Debug, Clone)]
pub struct NamedGrid {
    /// The name that PROJ gives to its file, without the ending.
    pub name: &'static str,
    /// The grid.
    pub grid: Arc<GeoidGrid>,
}

/// Where grids are found.
pub trait Geoids: fmt::Debug + Send + Sync {
    /// Those of the grids with these names that are there, in the same order. Once it has told any, it always tells the same:
    /// a model that comes later must not change the heights of a service that runs.
    ///
    /// # Errors
    /// What is wrong with the file of one of them.
    fn grids(&self, names: &'static [&'static str]) -> Result<Arc<[NamedGrid]>, GridFileFault>;
}

/// Why the file of a grid cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name}: {reason}")]
pub struct GridFileFault {
    /// The name of the grid.
    pub name: String,
    /// What is wrong with the file.
    pub reason: String,
}

/// The grids of this process. As in PROJ they belong to the installation and not to a coordinate reference system, whose
/// name is a mere text wherever one is read: in requests, in the database, on the command line. They are set at most once,
/// before anything is computed, and each system keeps the grids that it first used: in one process the same system always
/// gives the same numbers.
static INSTALLED: OnceLock<Arc<dyn Geoids>> = OnceLock::new();

/// Sets where all coordinate reference systems of this process find their grids, unless
/// [`Crs::with_geoids`](super::Crs::with_geoids) says otherwise. The first call counts; returns whether this was it.
pub fn install(geoids: Arc<dyn Geoids>) -> bool {
    INSTALLED.set(geoids).is_ok()
}

/// What has been installed.
pub(super) fn installed() -> Option<&'static Arc<dyn Geoids>> {
    INSTALLED.get()
}

/// Rounding of coordinates at the rim of a grid, 0.1 mm on the ground.
const RIM_DEG: f64 = 1e-9;

impl GridPlace {
    /// Whether all is finite, on Earth, and large enough to interpolate in.
    ///
    /// # Errors
    /// What is wrong.
    pub fn check(&self) -> Result<(), String> {
        let Self { west_deg, south_deg, step_longitude_deg, step_latitude_deg, columns, rows } = *self;
        if columns < 2 || rows < 2 {
            return Err(format!("it has {columns} x {rows} nodes; at least 2 x 2 are needed"));
        }
        if ![step_longitude_deg, step_latitude_deg].iter().all(|step| (1e-6..=180.0).contains(step)) {
            return Err(format!("its nodes are {step_longitude_deg} by {step_latitude_deg} degrees apart"));
        }
        let north_deg = south_deg + step_latitude_deg * (rows - 1) as f64;
        // pixels that are areas may reach beyond the poles by half of one
        let is_on_earth = (-360.0..=360.0).contains(&west_deg)
            && step_longitude_deg * (columns - 1) as f64 <= 360.0 + step_longitude_deg
            && south_deg >= -90.0 - step_latitude_deg
            && north_deg <= 90.0 + step_latitude_deg;
        if is_on_earth { Ok(()) } else { Err("its nodes do not lie at longitudes and latitudes in degrees".to_owned()) }
    }

    /// Columns and rows from the south-western node to a place, with fractions; `None` outside.
    fn columns_rows(&self, longitude_deg: f64, latitude_deg: f64) -> Option<(f64, f64)> {
        let mut east_deg = longitude_deg - self.west_deg;
        if east_deg < -RIM_DEG {
            east_deg += 360.0;
        } else if east_deg >= 360.0 {
            east_deg -= 360.0;
        }
        let column = east_deg / self.step_longitude_deg;
        let row = (latitude_deg - self.south_deg) / self.step_latitude_deg;
        let last_column = if self.goes_round() { self.columns as f64 } else { (self.columns - 1) as f64 };
        let (rim_column, rim_row) = (RIM_DEG / self.step_longitude_deg, RIM_DEG / self.step_latitude_deg);
        let last_row = (self.rows - 1) as f64;
        let inside = (-rim_column..=last_column + rim_column).contains(&column)
            && (-rim_row..=last_row + rim_row).contains(&row);
        inside.then(|| (column.clamp(0.0, last_column), row.clamp(0.0, last_row)))
    }

    /// Whether the last column is followed by the first.
    fn goes_round(&self) -> bool {
        (self.columns as f64 * self.step_longitude_deg - 360.0).abs() < 1e-6 * self.step_longitude_deg
    }
}

impl GridPage {
    /// Nodes at a place.
    ///
    /// # Errors
    /// What is wrong with the place.
    pub fn new(place: GridPlace, nodes: Box<dyn Nodes>) -> Result<Self, String> {
        place.check()?;
        Ok(Self { place, nodes })
    }

    fn undulation_m(&self, (column, row): (f64, f64)) -> Result<f64, GeoidFault> {
        let (left, low) = (column.floor(), row.floor());
        let (across, up) = (column - left, row - low);
        let (left, low) = (left as usize, low as usize);
        let right = if left + 1 >= self.place.columns { 0 } else { left + 1 };
        let left = if left >= self.place.columns { 0 } else { left };
        let corners = [
            (left, low, (1.0 - across) * (1.0 - up)),
            (right, low, across * (1.0 - up)),
            (left, low + 1, (1.0 - across) * up),
            (right, low + 1, across * up),
        ];
        let mut sum_m = 0.0;
        for (column, row, weight) in corners.into_iter().filter(|(.., weight)| *weight > 0.0) {
            let node_m = self.nodes.undulation_m(column, row).map_err(GeoidFault::Unreadable)?;
            sum_m += f64::from(node_m.ok_or(GeoidFault::Outside)?) * weight;
        }
        Ok(sum_m)
    }
}

impl GeoidGrid {
    /// A grid of these pages.
    #[must_use]
    pub fn new(mut pages: Vec<GridPage>) -> Self {
        pages.sort_by(|a, b| a.place.step_latitude_deg.total_cmp(&b.place.step_latitude_deg));
        Self { pages }
    }

    /// How high the zero of the heights lies above the ellipsoid at a longitude from -180 to 180 degrees and a latitude.
    ///
    /// # Errors
    /// [`GeoidFault`].
    pub fn undulation_m(&self, longitude_deg: f64, latitude_deg: f64) -> Result<f64, GeoidFault> {
        for page in &self.pages {
            let Some(place) = page.place.columns_rows(longitude_deg, latitude_deg) else { continue };
            match page.undulation_m(place) {
                Err(GeoidFault::Outside) => {}
                told => return told,
            }
        }
        Err(GeoidFault::Outside)
    }

    /// Where its pages lie, the finest first.
    pub fn places(&self) -> impl Iterator<Item = GridPlace> {
        self.pages.iter().map(|page| page.place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_abs_diff_eq;

    /// A bilinear surface, which interpolation must reproduce; nothing in one corner.
    #[derive(Debug)]
    struct Tilted;

    impl Nodes for Tilted {
        fn undulation_m(&self, column: usize, row: usize) -> Result<Option<f32>, String> {
            let (x, y) = (column as f32, row as f32);
            Ok((column < 3 || row < 3).then_some(40.0 + 2.0 * x - y + 0.5 * x * y))
        }
    }

    fn grid(west_deg: f64, columns: usize, step_longitude_deg: f64) -> GeoidGrid {
        let place =
            GridPlace { west_deg, south_deg: 50.0, step_longitude_deg, step_latitude_deg: 0.25, columns, rows: 4 };
        GeoidGrid::new(vec![GridPage::new(place, Box::new(Tilted)).unwrap()])
    }

    #[test]
    fn a_bilinear_surface_is_reproduced_up_to_the_rim() {
        let grid = grid(6.0, 4, 0.5);
        for (longitude_deg, latitude_deg) in [(6.0, 50.0), (6.7, 50.3), (7.5, 50.4), (6.2, 50.75), (6.0, 50.75)] {
            let (x, y) = ((longitude_deg - 6.0) / 0.5, (latitude_deg - 50.0) / 0.25);
            let found = grid.undulation_m(longitude_deg, latitude_deg).unwrap();
            assert_abs_diff_eq!(found, 40.0 + 2.0 * x - y + 0.5 * x * y, epsilon = 1e-9);
        }
    }

    #[test]
    fn beyond_the_rim_and_where_there_is_no_value_it_is_refused() {
        let grid = grid(6.0, 4, 0.5);
        for (longitude_deg, latitude_deg) in
            [(5.99, 50.2), (7.51, 50.2), (6.5, 49.99), (6.5, 50.76), (7.4, 50.7), (-174.0, 50.2), (f64::NAN, 50.2)]
        {
            assert_eq!(grid.undulation_m(longitude_deg, latitude_deg), Err(GeoidFault::Outside));
        }
    }

    #[test]
    fn a_grid_round_the_earth_has_no_seam() {
        // columns at -180, -90, 0, 90
        let round = grid(-180.0, 4, 90.0);
        let first_m = round.undulation_m(-180.0, 50.25).unwrap();
        assert_abs_diff_eq!(round.undulation_m(180.0, 50.25).unwrap(), first_m, epsilon = 1e-9);
        let last_m = round.undulation_m(90.0, 50.25).unwrap();
        assert_abs_diff_eq!(round.undulation_m(135.0, 50.25).unwrap(), (first_m + last_m) / 2.0, epsilon = 1e-9);
    }

    #[test]
    fn longitudes_from_0_to_360_are_met_by_those_from_west() {
        let american = grid(230.0, 4, 0.5);
        assert_abs_diff_eq!(american.undulation_m(-129.5, 50.0).unwrap(), 42.0, epsilon = 1e-9);
        let pacific = grid(179.5, 4, 0.5);
        assert_abs_diff_eq!(pacific.undulation_m(-179.5, 50.0).unwrap(), 44.0, epsilon = 1e-9);
    }

    #[test]
    fn places_off_the_earth_are_refused() {
        let good = GridPlace {
            west_deg: 6.0,
            south_deg: 50.0,
            step_longitude_deg: 0.5,
            step_latitude_deg: 0.25,
            columns: 4,
            rows: 4,
        };
        assert_eq!(good.check(), Ok(()));
        for bad in [
            GridPlace { west_deg: 500_000.0, ..good },
            GridPlace { south_deg: f64::NAN, ..good },
            GridPlace { south_deg: -91.0, ..good },
            GridPlace { step_longitude_deg: -0.5, ..good },
            GridPlace { step_latitude_deg: f64::INFINITY, ..good },
            GridPlace { columns: 1, ..good },
            GridPlace { rows: 1000, ..good },
        ] {
            assert!(bad.check().is_err(), "{bad:?}");
        }
    }
}
