//! Line segments by their place: to a window only those around it matter.

use nalgebra::Vector2;

use super::extract::ObservedSegment;

/// Side of a cell, reduced pixels: about that of a narrow window with its building.
const CELL_PX: f64 = 256.0;

/// Indices of segments by the cells that their middles lie in, a square raster about the principal point.
pub(super) struct Places {
    cells_per_side: usize,
    cells: Vec<Vec<u32>>,
    /// Segments longer than a cell: looked at from everywhere.
    long: Vec<u32>,
}

impl Places {
    /// No segments, in a frame whose corners are at most `radius_px` from the principal point.
    pub(super) fn new(radius_px: f64) -> Self {
        let cells_per_side = 2 * (radius_px / CELL_PX).ceil().max(1.0) as usize;
        Self { cells_per_side, cells: vec![Vec::new(); cells_per_side * cells_per_side], long: Vec::new() }
    }

    pub(super) fn add(&mut self, index: usize, segment: &ObservedSegment) {
        if segment.length_px > CELL_PX {
            self.long.push(index as u32);
        } else {
            let [column, row] = segment.segment_px.midpoint().into();
            let cell = self.cell(row) * self.cells_per_side + self.cell(column);
            self.cells[cell].push(index as u32);
        }
    }

    /// All segments that touch the square about a place with sides of `2 * reach_px`, and some others.
    pub(super) fn near(&self, centre_px: Vector2<f64>, reach_px: f64) -> impl Iterator<Item = usize> {
        let reach_px = reach_px + CELL_PX / 2.0;
        let range = |at: f64| self.cell(at - reach_px)..=self.cell(at + reach_px);
        let (rows, columns) = (range(centre_px.y), range(centre_px.x));
        let rows = rows.map(|row| row * self.cells_per_side);
        let cells = rows.flat_map(move |first| &self.cells[first + columns.start()..=first + columns.end()]);
        self.long.iter().chain(cells.flatten()).map(|index| *index as usize)
    }

    /// The row or column of cells of a coordinate; what is beyond the raster belongs to its rim.
    fn cell(&self, at_px: f64) -> usize {
        let cell = (at_px / CELL_PX).floor() + (self.cells_per_side / 2) as f64;
        cell.clamp(0.0, (self.cells_per_side - 1) as f64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;
    use crate::geometry::Segment2;
    use crate::orientation::matching::tests::observed;

    #[test]
    fn what_touches_a_square_is_near_it() {
        let mut draws = Draws::new(8);
        let mut somewhere = |far: f64| Vector2::new(draws.even(-far, far), draws.even(-far, far));
        let mut places = Places::new(2000.0);
        // some reach beyond the raster
        let segments: Vec<ObservedSegment> = (0..2000)
            .map(|k| {
                let (middle, half) = (somewhere(2300.0), somewhere(if k % 10 == 0 { 600.0 } else { 90.0 }));
                observed(Segment2 { start: middle - half, end: middle + half }, false)
            })
            .collect();
        for (index, segment) in segments.iter().enumerate() {
            places.add(index, segment);
        }
        for _ in 0..50 {
            let (centre, reach) = (somewhere(2100.0), somewhere(300.0).norm());
            let near: Vec<usize> = places.near(centre, reach).collect();
            let mut once = near.clone();
            once.sort_unstable();
            once.dedup();
            assert_eq!(once.len(), near.len());
            assert!(near.len() < segments.len() / 2);
            for (index, segment) in segments.iter().enumerate() {
                let ends = [segment.segment_px.start, segment.segment_px.end].map(|end| end - centre);
                let outside = (0..2).any(|k| ends.iter().map(|e| e[k]).fold(f64::INFINITY, f64::min) > reach)
                    || (0..2).any(|k| ends.iter().map(|e| e[k]).fold(f64::NEG_INFINITY, f64::max) < -reach);
                assert!(outside || near.contains(&index), "{index} touches {centre} +- {reach}");
            }
        }
    }
}
