//! Edge pixels: places where the gradient of the smoothed grey values is a maximum along its own direction, with
//! their position to a fraction of a cell.

use super::picture::GreyWindow;

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
    /// The cell it stands for: row times width plus column.
    pub cell: u32,
}

/// The gradient of a window, grey values per cell.
struct Gradient {
    x: Vec<f32>,
    y: Vec<f32>,
    squared: Vec<f32>,
}

/// All edge pixels with at least `least_gradient` (grey values per cell), row by row.
#[must_use]
pub fn edgels(window: &GreyWindow, least_gradient: f32) -> Vec<Edgel> {
    let (width, height) = (window.width, window.height);
    if width < 5 || height < 5 {
        return Vec::new();
    }
    let gradient = gradient(&smoothed(&window.grey, width, height), width, height);
    let least = least_gradient * least_gradient;
    let mut found = Vec::with_capacity(width * height / 16);
    for row in 2..height - 2 {
        let start = row * width;
        for column in 2..width - 2 {
            let cell = start + column;
            if gradient.squared[cell] > least {
                found.extend(maximum_at(&gradient, width, row, column));
            }
        }
    }
    found
}

/// The edgel at a cell if the gradient is largest there among its neighbours across the edge. They are taken along
/// the axis that is nearer to the gradient's direction, so an edge crosses each row or column once.
fn maximum_at(gradient: &Gradient, width: usize, row: usize, column: usize) -> Option<Edgel> {
    let cell = row * width + column;
    let (gx, gy, here) = (gradient.x[cell], gradient.y[cell], gradient.squared[cell]);
    let across_columns = gx.abs() >= gy.abs();
    let stride = if across_columns { 1 } else { width };
    let (before, after) = (gradient.squared[cell - stride], gradient.squared[cell + stride]);
    if !(here > before && here >= after) {
        return None;
    }
    let (a, b, c) = (before.sqrt(), here.sqrt(), after.sqrt());
    // the vertex of the parabola through the three values
    let curvature = a - 2.0 * b + c;
    let shift = if curvature < -1e-6 { (0.5 * (a - c) / curvature).clamp(-0.5, 0.5) } else { 0.0 };
    let (mut x, mut y) = (column as f32 + 0.5, row as f32 + 0.5);
    if across_columns {
        x += shift;
    } else {
        y += shift;
    }
    Some(Edgel { x, y, normal: [gx / b, gy / b], gradient: b, cell: u32::try_from(cell).ok()? })
}

/// Grey values after the binomial filter (1 2 1)/4 in both directions; the rim keeps its values.
fn smoothed(grey: &[f32], width: usize, height: usize) -> Vec<f32> {
    let mut rows = grey.to_vec();
    for (source, target) in grey.chunks_exact(width).zip(rows.chunks_exact_mut(width)) {
        for (out, near) in target[1..width - 1].iter_mut().zip(source.windows(3)) {
            *out = 0.25 * (near[0] + near[2]) + 0.5 * near[1];
        }
    }
    let mut result = rows.clone();
    for row in 1..height - 1 {
        let (above, here, below) = three_rows(&rows, width, row);
        let target = &mut result[row * width..(row + 1) * width];
        for (((out, a), h), b) in target.iter_mut().zip(above).zip(here).zip(below) {
            *out = 0.25 * (a + b) + 0.5 * h;
        }
    }
    result
}

/// Sobel's gradient, in grey values per cell.
fn gradient(grey: &[f32], width: usize, height: usize) -> Gradient {
    let empty = || vec![0.0_f32; width * height];
    let mut result = Gradient { x: empty(), y: empty(), squared: empty() };
    for row in 1..height - 1 {
        let (above, here, below) = three_rows(grey, width, row);
        let inside = row * width + 1..(row + 1) * width - 1;
        let (gx, gy) = (&mut result.x[inside.clone()], &mut result.y[inside.clone()]);
        let squared = &mut result.squared[inside];
        let neighbours = above.windows(3).zip(here.windows(3)).zip(below.windows(3));
        for (((gx, gy), squared), ((a, h), b)) in gx.iter_mut().zip(gy).zip(squared).zip(neighbours) {
            *gx = 0.125 * ((a[2] - a[0]) + 2.0 * (h[2] - h[0]) + (b[2] - b[0]));
            *gy = 0.125 * ((b[0] - a[0]) + 2.0 * (b[1] - a[1]) + (b[2] - a[2]));
            *squared = *gx * *gx + *gy * *gy;
        }
    }
    result
}

fn three_rows(values: &[f32], width: usize, row: usize) -> (&[f32], &[f32], &[f32]) {
    let at = |r: usize| &values[r * width..(r + 1) * width];
    (at(row - 1), at(row), at(row + 1))
}
