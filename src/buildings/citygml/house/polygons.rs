//! The polygons of a building, from their coordinates in text.

use crate::buildings::model::{FARTHEST, Limits};
use crate::buildings::roof::Surfaces;

/// How much, relative to its coordinates, the last point of a ring may differ from the first: what is left of a number
/// that was computed twice.
const CLOSED: f64 = 1e-9;

/// Polygons that were read, and the one that is being read.
#[derive(Debug, Default)]
pub(super) struct Polygons {
    whole: Surfaces,
    /// At which depth the polygon, its ring and the coordinates were opened.
    polygon: Option<usize>,
    ring: Option<usize>,
    positions: Option<usize>,
    /// The numbers of the ring.
    numbers: Vec<f64>,
}

impl Polygons {
    pub(super) fn takes_text(&self) -> bool {
        self.positions.is_some()
    }

    pub(super) fn open_polygon(&mut self, depth: usize) {
        if self.polygon.is_none() {
            self.polygon = Some(depth);
        }
    }

    pub(super) fn open_ring(&mut self, depth: usize) {
        if self.polygon.is_some() && self.ring.is_none() {
            self.ring = Some(depth);
            self.numbers.clear();
        }
    }

    pub(super) fn open_positions(&mut self, depth: usize) {
        if self.ring.is_some() {
            self.positions = Some(depth);
        }
    }

    /// Numbers, between which there is white space or, in `coordinates`, a comma.
    pub(super) fn text(&mut self, text: &[u8], limits: &Limits) -> Result<(), String> {
        let between = |byte: &u8| byte.is_ascii_whitespace() || *byte == b',';
        for word in text.split(between).filter(|word| !word.is_empty()) {
            let number = std::str::from_utf8(word).ok().and_then(|word| word.parse::<f64>().ok());
            match number {
                Some(number) if number.abs() <= FARTHEST => self.numbers.push(number),
                _ => {
                    let shown: String = String::from_utf8_lossy(word).chars().take(40).collect();
                    return Err(format!("the coordinate \"{shown}\" is no number within ±{FARTHEST:e}"));
                }
            }
        }
        if self.whole.points().len() + self.numbers.len() / 3 > limits.building_vertices {
            return Err(format!("the building has more than {} points", limits.building_vertices));
        }
        Ok(())
    }

    /// An element ends that was opened at this depth. Gives the number of the polygon if it was one.
    pub(super) fn close(&mut self, depth: usize, limits: &Limits) -> Result<Option<usize>, String> {
        if self.positions.take_if(|open| *open == depth).is_some() {
            return Ok(None);
        }
        if self.ring.take_if(|open| *open == depth).is_some() {
            return self.end_ring().map(|()| None);
        }
        if self.polygon.take_if(|open| *open == depth).is_none() {
            return Ok(None);
        }
        if self.whole.len() == limits.building_polygons {
            return Err(format!("the building has more than {} polygons", limits.building_polygons));
        }
        let polygon = self.whole.len();
        self.whole.end_polygon();
        match self.whole.rings_of(polygon).next() {
            Some(_) => Ok(Some(polygon)),
            None => Err(format!("polygon {polygon} has no ring; it must have at least one gml:LinearRing")),
        }
    }

    fn end_ring(&mut self) -> Result<(), String> {
        let polygon = self.whole.len();
        let (points, rest) = self.numbers.as_chunks::<3>();
        if !rest.is_empty() {
            let given = self.numbers.len();
            return Err(format!("a ring of polygon {polygon} has {given} numbers; there must be three for each point"));
        }
        let [first, open @ ..] = points else {
            return Err(format!("a ring of polygon {polygon} has no points"));
        };
        let Some(last) = open.last() else {
            return Err(format!("a ring of polygon {polygon} has one point; a ring needs at least three"));
        };
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= CLOSED * a.abs().max(1.0);
        if !first.iter().zip(last).all(near) {
            return Err(format!(
                "a ring of polygon {polygon} is not closed: it begins at {first:?} and ends at {last:?}; the last point \
                 must be the first once more"
            ));
        }
        for point in &points[..points.len() - 1] {
            self.whole.point(*point);
        }
        self.whole.end_ring();
        Ok(())
    }

    /// Adds a polygon to others.
    pub(super) fn copy(&self, polygon: usize, to: &mut Surfaces) {
        to.copy(&self.whole, self.whole.rings_of(polygon));
    }
}
