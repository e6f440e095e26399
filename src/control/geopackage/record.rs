//! The control point of the rows of a building.

use std::sync::Arc;

use chrono::NaiveDate;

use super::blob::{self, Shape};
use super::layer::Layer;
use crate::buildings::{self, Building, EdgeKind, Limits};
use crate::control::accuracy::edge_sigma_m;
use crate::control::geojson::{self, Defaults, MOST_EDGES, SHORTEST_EDGE_M, Source};
use crate::control::model::{StoredControlPoint, StoredEdge, Use, Validity};
use crate::control::reading::{EDGE_BYTES, corners_geocentric_m, of_building};
use crate::geometry::Segment3;

/// What a row takes beside its geometry, about.
const ROW_BYTES: usize = 256;
/// So much the rows of one building may have: the points that one may have, and something for what is around them.
pub(super) const MOST_BYTES: usize = 16 << 20;

/// A row of a table.
#[derive(Debug, Clone)]
pub(super) struct Row {
    /// Its number.
    pub(super) id: i64,
    /// What the building is known by, of which several rows may be.
    pub(super) key: Option<String>,
    /// The name, if it has one.
    pub(super) name: Option<String>,
    /// As it is stored, or why it cannot be read.
    pub(super) geometry: Result<Vec<u8>, String>,
    /// Standard deviation of its coordinates.
    pub(super) sigma_m: Option<f64>,
    /// The word for the kind of its edges.
    pub(super) kind: Option<String>,
    /// The word for its use.
    pub(super) purpose: Option<String>,
    /// The first day on which it stands like this.
    pub(super) valid_from: Option<String>,
    /// The last one.
    pub(super) valid_to: Option<String>,
}

/// The rows of a GeoPackage that are to become one control point.
#[derive(Debug)]
pub struct Record {
    layer: Arc<Layer>,
    key: Option<String>,
    name: Option<String>,
    rows: Vec<Row>,
    bytes: usize,
    /// Whether they are too many, and forgotten.
    too_large: bool,
}

impl Record {
    /// Begins with a row.
    pub(super) fn of(layer: Arc<Layer>, row: Row) -> Self {
        let (key, name) = (row.key.clone(), row.name.clone());
        let mut record = Self { layer, key, name, rows: Vec::with_capacity(1), bytes: 0, too_large: false };
        record.push(row);
        record
    }

    /// Whether the row is of the same building.
    pub(super) fn has(&self, row: &Row) -> bool {
        self.key.is_some() && self.key == row.key
    }

    /// Takes another row of it.
    pub(super) fn push(&mut self, row: Row) {
        // rows that are called differently are parts, none of which gives the whole its name
        if row.name != self.name {
            self.name.clone_from(&self.key);
        }
        self.bytes += row.geometry.as_ref().map_or(0, Vec::len) + ROW_BYTES;
        self.too_large |= self.bytes > MOST_BYTES;
        if self.too_large {
            self.rows = Vec::new();
        } else {
            self.rows.push(row);
        }
    }

    /// How many edges take as much memory.
    #[must_use]
    pub fn weight(&self) -> usize {
        if self.rows.is_empty() { 1 } else { self.bytes / EDGE_BYTES }
    }

    /// Its name, if it has one.
    #[must_use]
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// Makes a control point of it.
    ///
    /// # Errors
    /// What is wrong with it and what would be right.
    pub(in crate::control) fn control_point(
        self,
        geoid_undulation_m: Option<f64>,
        defaults: Defaults,
    ) -> Result<StoredControlPoint, String> {
        if self.too_large {
            return Err(format!("its rows have more than {MOST_BYTES} bytes, which those of one building have not"));
        }
        let name = self.name.ok_or_else(|| self.layer.without_name())?;
        let mut gathered = Gathered::default();
        for row in self.rows {
            let (id, srs_id) = (row.id, self.layer.srs_id);
            gathered.add(row, srs_id, defaults.sigma_m).map_err(|detail| format!("row {id}: {detail}"))?;
        }
        let defaults = Defaults {
            sigma_m: gathered.sigma_m.or(defaults.sigma_m),
            purpose: gathered.purpose.unwrap_or(defaults.purpose),
            validity: Validity {
                from: gathered.valid_from.or(defaults.validity.from),
                to: gathered.valid_to.or(defaults.validity.to),
            },
        };
        let source = Source { crs: &self.layer.crs, geoid_undulation_m };
        match (gathered.lines.is_empty(), gathered.polygons.is_empty()) {
            (true, true) => Err("it has no geometry".to_owned()),
            (false, false) => Err("some of its rows are lines and some are surfaces; give either".to_owned()),
            (false, true) => of_lines(name, &gathered.lines, &source, defaults),
            (true, false) => {
                let edges = buildings::roof_edges(&gathered.polygons, source.crs.is_geographic())?;
                of_building(&Building { index: 0, name, crs: None, roof_rmse_m: None, edges }, &source, defaults)
            }
        }
    }
}

/// A line with what its row says of it.
struct Line {
    positions: Vec<[f64; 3]>,
    kind: Option<EdgeKind>,
    sigma_m: f64,
}

/// What the rows of a building have together.
#[derive(Default)]
struct Gathered {
    lines: Vec<Line>,
    polygons: Vec<Vec<Vec<[f64; 3]>>>,
    points: usize,
    /// The worst, where surfaces have one.
    sigma_m: Option<f64>,
    purpose: Option<Use>,
    valid_from: Option<NaiveDate>,
    valid_to: Option<NaiveDate>,
}

impl Gathered {
    fn add(&mut self, row: Row, srs_id: i64, default_sigma_m: Option<f64>) -> Result<(), String> {
        agree(&mut self.purpose, "use", row.purpose.as_deref().map(purpose).transpose()?)?;
        agree(&mut self.valid_from, "valid_from", row.valid_from.as_deref().map(day).transpose()?)?;
        agree(&mut self.valid_to, "valid_to", row.valid_to.as_deref().map(day).transpose()?)?;
        match blob::shape(&row.geometry?, srs_id)? {
            Shape::Lines(lines) => {
                let sigma_m = geojson::checked_sigma(row.sigma_m.or(default_sigma_m))?;
                let kind = row.kind.as_deref().map(kind).transpose()?;
                self.lines.extend(lines.into_iter().map(|positions| Line { positions, kind, sigma_m }));
            }
            Shape::Polygons(polygons) => {
                self.sigma_m = self.sigma_m.into_iter().chain(row.sigma_m).reduce(f64::max);
                self.points += polygons.iter().flatten().map(Vec::len).sum::<usize>();
                self.polygons.extend(polygons);
                let Limits { building_vertices, building_polygons, .. } = Limits::default();
                if self.points > building_vertices || self.polygons.len() > building_polygons {
                    return Err(format!(
                        "the building has more than {building_vertices} points or {building_polygons} surfaces"
                    ));
                }
            }
        }
        Ok(())
    }
}

/// What one row says holds for the building, and no other row may say something else.
fn agree<T: PartialEq>(known: &mut Option<T>, column: &str, given: Option<T>) -> Result<(), String> {
    match (&*known, given) {
        (_, None) => Ok(()),
        (Some(known), Some(given)) if *known == given => Ok(()),
        (Some(_), Some(_)) => Err(format!("{column} is another one than in an earlier row of the same building")),
        (None, given) => {
            *known = given;
            Ok(())
        }
    }
}

fn kind(word: &str) -> Result<EdgeKind, String> {
    EdgeKind::from_name(&word.trim().to_ascii_lowercase())
        .ok_or_else(|| format!("edge_type is {word:?}; it may be eave, ridge, gable, hip, valley, rim and NULL"))
}

fn purpose(word: &str) -> Result<Use, String> {
    match word.trim().to_ascii_lowercase().as_str() {
        "control" => Ok(Use::Control),
        "check" => Ok(Use::Check),
        _ => Err(format!("use is {word:?}; it may be control, check and NULL")),
    }
}

/// A `DATE`, or the day of a `DATETIME`.
fn day(text: &str) -> Result<NaiveDate, String> {
    let date = text.trim().split(['T', ' ']).next().unwrap_or_default();
    date.parse().map_err(|_| format!("{text:?} is no day; valid_from and valid_to are YYYY-MM-DD"))
}

fn of_lines(
    name: String,
    lines: &[Line],
    source: &Source<'_>,
    defaults: Defaults,
) -> Result<StoredControlPoint, String> {
    let name = geojson::checked_name(Some(name))?;
    let segments: usize = lines.iter().map(|line| line.positions.len().saturating_sub(1)).sum();
    if segments > MOST_EDGES {
        return Err(format!("it has {segments} segments; a control point has at most {MOST_EDGES}"));
    }
    let of_crs_m = source.crs.accuracy_m();
    let positions: Vec<[f64; 3]> = lines.iter().flat_map(|line| line.positions.iter().copied()).collect();
    let positions_m = corners_geocentric_m(source, &positions)?;
    let mut rest_m = positions_m.as_slice();
    let (mut edges, mut stated_m) = (Vec::with_capacity(segments), 0.0_f64);
    for (index, Line { positions, kind, sigma_m }) in lines.iter().enumerate() {
        let before = edges.len();
        let (line_m, others_m) = rest_m.split_at(positions.len());
        rest_m = others_m;
        for ends_m in line_m.windows(2) {
            let geocentric_m = Segment3 { start: ends_m[0], end: ends_m[1] };
            // points that a line has twice
            if geocentric_m.length() >= SHORTEST_EDGE_M {
                let sigma_m = kind.map_or(*sigma_m, |kind| edge_sigma_m(kind, *sigma_m)).hypot(of_crs_m);
                edges.push(StoredEdge { geocentric_m, kind: *kind, sigma_m });
            }
        }
        if edges.len() == before {
            return Err(format!("line {index}: all its positions are the same; a line needs a length"));
        }
        stated_m = stated_m.max(*sigma_m);
    }
    geojson::checked(StoredControlPoint {
        name,
        // as sure as the worst of its rows
        sigma_m: stated_m.hypot(of_crs_m),
        reference_geocentric_m: StoredControlPoint::middle_of(&edges),
        edges,
        purpose: defaults.purpose,
        validity: defaults.validity,
    })
}
