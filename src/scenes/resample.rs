//! Pictures laid out anew: which part of a grid of cells a picture covers, and the mean grey in each cell.

use std::ops::Range;

use nalgebra::Vector2;
use rayon::prelude::*;

use crate::features::GreyWindow;

/// A cell is averaged over at most so many samples a side.
const MOST_SAMPLES: usize = 32;

/// Columns and rows of a grid of cells, the corners of which are where the picture is asked.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cells {
    pub(super) columns: Range<i32>,
    pub(super) rows: Range<i32>,
}

/// The rectangle of cells that grows from the cell at `seed`, side by side by one line of cells, as long as all corners
/// of the line are covered, to at most `most_cells` in each direction. `None` if the seed itself is not covered.
pub(super) fn grown(seed: [i32; 2], most_cells: i32, covered: impl Fn(i32, i32) -> bool) -> Option<Cells> {
    let [column, row] = seed;
    let mut cells = Cells { columns: column..column + 1, rows: row..row + 1 };
    let in_column = |x: i32, rows: &Range<i32>| (rows.start..=rows.end).all(|y| covered(x, y));
    let in_row = |y: i32, columns: &Range<i32>| (columns.start..=columns.end).all(|x| covered(x, y));
    if !(in_column(column, &cells.rows) && in_column(column + 1, &cells.rows)) {
        return None;
    }
    let mut growing = [true; 4];
    while growing.contains(&true) {
        let [left, right, above, below] = &mut growing;
        let Cells { columns, rows } = &mut cells;
        *left = *left && columns.len() < most_cells as usize && in_column(columns.start - 1, rows);
        columns.start -= i32::from(*left);
        *right = *right && columns.len() < most_cells as usize && in_column(columns.end + 1, rows);
        columns.end += i32::from(*right);
        *above = *above && rows.len() < most_cells as usize && in_row(rows.start - 1, columns);
        rows.start -= i32::from(*above);
        *below = *below && rows.len() < most_cells as usize && in_row(rows.end + 1, columns);
        rows.end += i32::from(*below);
    }
    Some(cells)
}

/// The mean grey in each cell, row by row; `pixel` gives the pixel of a corner, and within a cell pixels are
/// interpolated between its corners. A cell of which a corner has no pixel is black.
///
/// A cell has as many samples as it has pixels along its longer side, so that no pixel of the picture is left out where
/// it is reduced; each sample is interpolated between the four pixels about it.
pub(super) fn resampled(
    picture: &GreyWindow,
    cells: &Cells,
    pixel: impl Fn(i32, i32) -> Option<Vector2<f64>> + Sync,
) -> Vec<f32> {
    let corners_in =
        |row: i32| -> Vec<_> { (cells.columns.start..=cells.columns.end).map(|x| pixel(x, row)).collect() };
    let rows: Vec<Vec<f32>> = cells
        .rows
        .clone()
        .into_par_iter()
        .map(|row| {
            let (upper, lower) = (corners_in(row), corners_in(row + 1));
            let quads = upper.windows(2).zip(lower.windows(2));
            quads.map(|(upper, lower)| mean_in_quad(picture, [upper[0], upper[1], lower[0], lower[1]])).collect()
        })
        .collect();
    rows.concat()
}

/// Corners: upper left and right, lower left and right.
fn mean_in_quad(picture: &GreyWindow, corners: [Option<Vector2<f64>>; 4]) -> f32 {
    let [Some(a), Some(b), Some(c), Some(d)] = corners else { return 0.0 };
    let longest = [b - a, d - c, c - a, d - b].into_iter().map(|side| side.norm()).fold(0.0, f64::max);
    let samples = (longest.ceil() as usize).clamp(1, MOST_SAMPLES);
    let share = |k: usize| (k as f64 + 0.5) / samples as f64;
    let mut sum = 0.0;
    for down in (0..samples).map(share) {
        let (left, right) = (a + (c - a) * down, b + (d - b) * down);
        for across in (0..samples).map(share) {
            sum += interpolated(picture, left + (right - left) * across);
        }
    }
    (sum / (samples * samples) as f64) as f32
}

/// The grey at a pixel position of a window (corner origin).
pub(super) fn interpolated(picture: &GreyWindow, pixel: Vector2<f64>) -> f64 {
    let origin = Vector2::from(picture.origin_px.map(f64::from));
    bilinear(&picture.grey, [picture.width, picture.height], pixel - origin)
}

/// The grey at a place of a picture (corner origin), between the four pixels about it; at the rim the rim's own.
pub(super) fn bilinear(grey: &[f32], [width, height]: [usize; 2], at: Vector2<f64>) -> f64 {
    let along = |v: f64, size: usize| {
        let v = (v - 0.5).clamp(0.0, size.saturating_sub(1) as f64);
        let before = (v as usize).min(size.saturating_sub(2));
        (before, (before + 1).min(size.saturating_sub(1)), v - before as f64)
    };
    let (x0, x1, right) = along(at.x, width);
    let (y0, y1, down) = along(at.y, height);
    let grey = |x: usize, y: usize| f64::from(grey[y * width + x]);
    let upper = grey(x0, y0) + right * (grey(x1, y0) - grey(x0, y0));
    let lower = grey(x0, y1) + right * (grey(x1, y1) - grey(x0, y1));
    upper + down * (lower - upper)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: usize, height: usize) -> GreyWindow {
        let grey = (0..width * height).map(|k| (3 * (k % width) + 2 * (k / width)) as f32).collect();
        GreyWindow { origin_px: [0, 0], reduction: 1, width, height, grey }
    }

    #[test]
    fn the_rectangle_grows_to_what_is_covered() {
        let in_circle = |x: i32, y: i32| x * x + y * y <= 50 * 50;
        let cells = grown([0, 0], 1000, in_circle).unwrap();
        // corners of the largest square in the circle: 50 / sqrt(2) = 35.4
        assert_eq!(cells, Cells { columns: -35..35, rows: -35..35 });
        let cells = grown([3, 2], 1000, |x, y| x.abs() <= 80 && (-4..=9).contains(&y)).unwrap();
        assert_eq!(cells, Cells { columns: -80..80, rows: -4..9 });
        let cells = grown([0, 0], 20, in_circle).unwrap();
        assert_eq!((cells.columns.len(), cells.rows.len()), (20, 20));
        assert_eq!(grown([90, 0], 20, in_circle), None);
    }

    #[test]
    fn means_of_a_ramp_are_its_values_in_the_middle_of_the_cells() {
        let picture = ramp(40, 30);
        let cells = Cells { columns: 1..5, rows: 1..4 };
        let turned = |x: i32, y: i32| {
            let (x, y) = (f64::from(x), f64::from(y));
            Some(Vector2::new(4.0 + 5.0 * x - 0.5 * y, 3.0 + 0.5 * x + 5.0 * y))
        };
        let means = resampled(&picture, &cells, turned);
        assert_eq!(means.len(), 12);
        for (k, mean) in means.into_iter().enumerate() {
            let (x, y) = ((k % 4) as f64 + 1.5, (k / 4) as f64 + 1.5);
            let middle = Vector2::new(4.0 + 5.0 * x - 0.5 * y, 3.0 + 0.5 * x + 5.0 * y);
            let expected = 3.0 * (middle.x - 0.5) + 2.0 * (middle.y - 0.5);
            assert!((f64::from(mean) - expected).abs() < 1e-3, "{mean} {expected}");
        }
        assert_eq!(resampled(&picture, &cells, |_, _| None), vec![0.0; 12]);
    }

    #[test]
    fn a_pixel_s_own_grey_is_in_its_middle_and_the_rim_goes_on() {
        let picture = ramp(4, 3);
        assert!((interpolated(&picture, Vector2::new(2.5, 1.5)) - 8.0).abs() < 1e-12);
        assert!((interpolated(&picture, Vector2::new(3.0, 1.5)) - 9.5).abs() < 1e-12);
        assert!((interpolated(&picture, Vector2::new(9.0, -4.0)) - 9.0).abs() < 1e-12);
        let single = ramp(1, 1);
        assert!(interpolated(&single, Vector2::new(0.2, 0.9)).abs() < 1e-12);
    }
}
