//! Polygons with holes, flat in memory: a building in a file has hundreds of small ones.

use std::ops::Range;

/// Polygons of rings of points. A ring is open: its last point is not its first once more.
#[derive(Debug, Clone, Default, PartialEq)]
pub(in super::super) struct Surfaces {
    points: Vec<[f64; 3]>,
    /// Where each ring ends in `points`.
    rings: Vec<usize>,
    /// Where each polygon ends in `rings`.
    polygons: Vec<usize>,
}

impl Surfaces {
    /// Adds a point to the ring that is being written.
    pub(in super::super) fn point(&mut self, point: [f64; 3]) {
        self.points.push(point);
    }

    /// Ends the ring.
    pub(in super::super) fn end_ring(&mut self) {
        self.rings.push(self.points.len());
    }

    /// Ends the polygon, whose first ring is the outer one.
    pub(in super::super) fn end_polygon(&mut self) {
        self.polygons.push(self.rings.len());
    }

    /// Forgets all, and keeps the memory.
    pub(in super::super) fn clear(&mut self) {
        self.points.clear();
        self.rings.clear();
        self.polygons.clear();
    }

    /// All points, ring after ring.
    pub(in super::super) fn points(&self) -> &[[f64; 3]] {
        &self.points
    }

    /// The same, to be moved into another frame.
    pub(in super::super) fn points_mut(&mut self) -> &mut [[f64; 3]] {
        &mut self.points
    }

    /// How many polygons there are.
    pub(in super::super) fn len(&self) -> usize {
        self.polygons.len()
    }

    /// For each polygon its rings, as spans of [`Self::points`].
    pub(in super::super) fn polygons(&self) -> impl Iterator<Item = impl Iterator<Item = Range<usize>> + '_> + '_ {
        (0..self.polygons.len()).map(|polygon| self.rings_of(polygon))
    }

    /// Adds a polygon of another.
    pub(in super::super) fn copy(&mut self, other: &Self, rings: impl Iterator<Item = Range<usize>>) {
        for ring in rings {
            self.points.extend_from_slice(&other.points[ring]);
            self.end_ring();
        }
        self.end_polygon();
    }

    /// The rings of one polygon, as spans of [`Self::points`].
    pub(in super::super) fn rings_of(&self, polygon: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        let first = if polygon == 0 { 0 } else { self.polygons[polygon - 1] };
        (first..self.polygons[polygon]).map(|ring| {
            let start = if ring == 0 { 0 } else { self.rings[ring - 1] };
            start..self.rings[ring]
        })
    }
}
