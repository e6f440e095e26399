//! Edge pixels: places where the gradient of the smoothed grey values is a maximum along its own direction, with
//! their position to a fraction of a cell.

use super::picture::GreyWindow;
use super::smooth::Grid;

/// One edge pixel, in cells of the window; the middle of the first cell is (0.5, 0.5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edgel {
    /// Position across, to a fraction of a cell.
    pub x: f32,
    /// Position down, to a fraction of a cell.
    pub y: f32,
    /// The gradient's direction (towards the brighter side), a unit vector.
    pub normal: [f32; 2],
    /// The gradient, grey values per cell.
    pub gradient: f32,
    /// The column of the cell that it stands for.
    pub column: u32,
    /// The row of that cell.
    pub row: u32,
}

/// One row of the gradient, grey values per cell; the outermost cells have none.
struct GradientRow {
    x: Vec<f32>,
    y: Vec<f32>,
    squared: Vec<f32>,
}

/// Cells that are passed over together where none of them is an edgel.
const CELLS_AT_ONCE: usize = 16;

/// All edge pixels with at least `least_gradient` (grey values per cell), row by row.
///
/// A few rows at a time go through all steps, so that they stay in the processor's cache; the steps have no branches,
/// so that the compiler does several cells at once.
#[must_use]
pub fn edgels(window: &GreyWindow, least_gradient: f32) -> Vec<Edgel> {
    let (width, height) = (window.width, window.height);
    if width < 5 || height < 5 {
        return Vec::new();
    }
    let grid = Grid { values: &window.grey, width, height };
    let row = || vec![0.0_f32; width];
    let gradient_row = || GradientRow { x: row(), y: row(), squared: row() };
    let mut smooth = [row(), row(), row()];
    let mut gradient = [gradient_row(), gradient_row(), gradient_row()];
    let (mut buffer, mut is_edgel) = (row(), vec![0_u32; width]);
    let mut found = Vec::with_capacity(width * height / 16);
    grid.smooth_row(0, &mut buffer, &mut smooth[1]);
    grid.smooth_row(1, &mut buffer, &mut smooth[2]);
    for last in 2..height {
        smooth.rotate_left(1);
        grid.smooth_row(last, &mut buffer, &mut smooth[2]);
        gradient.rotate_left(1);
        differentiate(&smooth, &mut gradient[2]);
        // the middle one of three rows of gradients
        if last >= 4 {
            mark_maxima(&gradient, least_gradient * least_gradient, &mut is_edgel);
            append_edgels(&gradient, &is_edgel, last - 2, &mut found);
        }
    }
    found
}

/// Sobel's gradient in the middle one of three rows.
fn differentiate([above, here, below]: &[Vec<f32>; 3], row: &mut GradientRow) {
    let inside = 1..here.len() - 1;
    let (gx, gy) = (&mut row.x[inside.clone()], &mut row.y[inside.clone()]);
    let squared = &mut row.squared[inside];
    let neighbours = above.windows(3).zip(here.windows(3)).zip(below.windows(3));
    for (((gx, gy), squared), ((a, h), b)) in gx.iter_mut().zip(gy).zip(squared).zip(neighbours) {
        *gx = 0.125 * ((a[2] - a[0]) + 2.0 * (h[2] - h[0]) + (b[2] - b[0]));
        *gy = 0.125 * ((b[0] - a[0]) + 2.0 * (b[1] - a[1]) + (b[2] - a[2]));
        *squared = *gx * *gx + *gy * *gy;
    }
}

/// Whether the gradient runs more along the rows than across them; its neighbours are then taken in the row, so that
/// an edge crosses each row or column once.
fn across_columns(gx: f32, gy: f32) -> bool {
    gx.abs() >= gy.abs()
}

/// Marks the cells of the middle row where the gradient is large enough, and largest among its neighbours across the
/// edge. Two cells at the rim are left out.
fn mark_maxima([above, here, below]: &[GradientRow; 3], least_squared: f32, is_edgel: &mut [u32]) {
    let inside = 2..here.squared.len() - 2;
    let marks = is_edgel[inside.clone()].iter_mut();
    let gradients = here.x[inside.clone()].iter().zip(&here.y[inside.clone()]);
    let vertical = above.squared[inside.clone()].iter().zip(&below.squared[inside]);
    let horizontal = here.squared[1..].windows(3);
    for (((mark, (gx, gy)), (above, below)), row) in marks.zip(gradients).zip(vertical).zip(horizontal) {
        let (left, here, right) = (row[0], row[1], row[2]);
        let in_row = (here > left) & (here >= right);
        let in_column = (here > *above) & (here >= *below);
        let columns = across_columns(*gx, *gy);
        *mark = u32::from((here > least_squared) & ((columns & in_row) | (!columns & in_column)));
    }
}

/// The edgels of the cells that are marked in the middle row.
fn append_edgels(gradient: &[GradientRow; 3], is_edgel: &[u32], row: usize, found: &mut Vec<Edgel>) {
    for (block, marks) in is_edgel.chunks(CELLS_AT_ONCE).enumerate() {
        if marks.iter().fold(0, |any, mark| any | mark) == 0 {
            continue;
        }
        let marked = marks.iter().enumerate().filter(|(_, mark)| **mark != 0);
        found.extend(marked.map(|(k, _)| edgel(gradient, row, block * CELLS_AT_ONCE + k)));
    }
}

fn edgel([above, here, below]: &[GradientRow; 3], row: usize, column: usize) -> Edgel {
    let (gx, gy, squared) = (here.x[column], here.y[column], here.squared[column]);
    let columns = across_columns(gx, gy);
    let (before, after) = match columns {
        true => (here.squared[column - 1], here.squared[column + 1]),
        false => (above.squared[column], below.squared[column]),
    };
    let (a, b, c) = (before.sqrt(), squared.sqrt(), after.sqrt());
    // the vertex of the parabola through the three values
    let curvature = a - 2.0 * b + c;
    let shift = if curvature < -1e-6 { (0.5 * (a - c) / curvature).clamp(-0.5, 0.5) } else { 0.0 };
    let (mut x, mut y) = (column as f32 + 0.5, row as f32 + 0.5);
    if columns {
        x += shift;
    } else {
        y += shift;
    }
    Edgel { x, y, normal: [gx / b, gy / b], gradient: b, column: column as u32, row: row as u32 }
}
