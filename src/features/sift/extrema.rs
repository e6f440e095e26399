//! Extrema of the differences of Gaussians, and where exactly they are (Lowe 2004, sections 3.1, 4 and 4.1).

use nalgebra::{Matrix3, Vector3};

use super::blur::lanes;
use super::scale_space::{INTERVALS, LEVELS, Octave};

/// Differences of neighbouring levels in an octave.
const DIFFERENCES: usize = LEVELS - 1;
/// No key points nearer to the rim than this, in cells.
pub(super) const RIM: usize = 5;
/// How often the parabola may be moved to a neighbouring cell.
const MOST_MOVES: usize = 5;
const LANES: usize = 16;

/// Which extrema become key points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Least |D| at the extremum, in grey values.
    pub(super) contrast: f32,
    /// Largest ratio of the principal curvatures.
    pub(super) edge_ratio: f32,
}

/// An extremum in the cells of its octave.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extremum {
    /// Level, row and column of the cell.
    pub(super) cell: [usize; 3],
    /// Column, row and level, from the middle of the first cell.
    pub(super) at: Vector3<f64>,
    /// |D| there, in grey values.
    pub(super) contrast: f64,
    /// Second derivatives of D by column, row and level.
    pub(super) hessian: Matrix3<f64>,
}

/// The extrema of an octave, by level, row and column.
pub(super) fn extrema(octave: &Octave, limits: &Limits) -> Vec<Extremum> {
    let mut found = Vec::new();
    if octave.width <= 2 * RIM || octave.height <= 2 * RIM {
        return found;
    }
    // refinement changes |D| but little, and most cells are far below
    let least = 0.5 * limits.contrast;
    let mut rows = Rows::new(octave.width);
    rows.fill(octave, RIM - 1);
    rows.fill(octave, RIM);
    for y in RIM..octave.height - RIM {
        rows.fill(octave, y + 1);
        for level in 1..=INTERVALS {
            rows.candidates(level, y, least, &mut |x| found.extend(refined(octave, [level, y, x], limits)));
        }
    }
    found.sort_by_key(|extremum| extremum.cell);
    // the same one can be reached from neighbouring cells
    found.dedup_by_key(|extremum| extremum.cell);
    found
}

/// The last three rows of all differences.
struct Rows {
    rows: [[Vec<f32>; 3]; DIFFERENCES],
    width: usize,
}

impl Rows {
    fn new(width: usize) -> Self {
        Self { rows: std::array::from_fn(|_| std::array::from_fn(|_| vec![0.0; width])), width }
    }

    fn fill(&mut self, octave: &Octave, y: usize) {
        let range = y * self.width..(y + 1) * self.width;
        for (rows, levels) in self.rows.iter_mut().zip(octave.levels.windows(2)) {
            let [lower, upper] = levels else { continue };
            let (lower, upper) = (&lower[range.clone()], &upper[range.clone()]);
            rows[y % 3].iter_mut().zip(upper).zip(lower).for_each(|((out, u), l)| *out = u - l);
        }
    }

    /// Calls `found` with the columns of row `y` whose value is over `least` and extreme among its 26 neighbours.
    fn candidates(&self, level: usize, y: usize, least: f32, found: &mut impl FnMut(usize)) {
        let row = |difference: usize, y: usize| self.rows[difference][y % 3].as_slice();
        let near = [row(level, y - 1), row(level, y + 1), row(level - 1, y), row(level + 1, y)];
        let here = row(level, y);
        let all: [&[f32]; 9] = std::array::from_fn(|k| row(level - 1 + k / 3, y - 1 + k % 3));
        let mut check = |x: usize| {
            if is_extreme(here[x], &all, x) {
                found(x);
            }
        };
        let end = self.width - RIM;
        let mut x = RIM;
        while x + LANES <= end {
            if lanes::<LANES>(here, x).iter().fold(0, |any, v| any | u32::from(v.abs() > least)) != 0 {
                let extreme = extreme_among_six(here, &near, x, least);
                if extreme.iter().fold(0, |any, one| any | one) != 0 {
                    (0..LANES).filter(|&k| extreme[k] != 0).for_each(|k| check(x + k));
                }
            }
            x += LANES;
        }
        (x..end).filter(|&x| here[x].abs() > least).for_each(check);
    }
}

/// Which of the next values are over `least` and extreme among the neighbours beside, above, below and in the
/// neighbouring levels.
#[inline(always)]
fn extreme_among_six(here: &[f32], near: &[&[f32]; 4], x: usize, least: f32) -> [u32; LANES] {
    let value = lanes::<LANES>(here, x);
    let (mut high, mut low) = ([least; LANES], [-least; LANES]);
    let mut widen = |others: [f32; LANES]| {
        for k in 0..LANES {
            high[k] = if others[k] > high[k] { others[k] } else { high[k] };
            low[k] = if others[k] < low[k] { others[k] } else { low[k] };
        }
    };
    widen(lanes(here, x - 1));
    widen(lanes(here, x + 1));
    near.iter().for_each(|row| widen(lanes(row, x)));
    std::array::from_fn(|k| u32::from(value[k] >= high[k]) | u32::from(value[k] <= low[k]))
}

fn is_extreme(value: f32, rows: &[&[f32]; 9], x: usize) -> bool {
    let all = rows.iter().flat_map(|row| lanes::<3>(row, x - 1));
    if value > 0.0 {
        all.fold(true, |so_far, v| so_far & (value >= v))
    } else {
        all.fold(true, |so_far, v| so_far & (value <= v))
    }
}

/// D and its derivatives at a cell.
struct Derivatives {
    value: f64,
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
}

fn derivatives(octave: &Octave, [level, y, x]: [usize; 3]) -> Derivatives {
    let d = |dl: usize, dy: usize, dx: usize| {
        let (level, at) = (level + dl - 1, (y + dy - 1) * octave.width + x + dx - 1);
        f64::from(octave.levels[level + 1][at] - octave.levels[level][at])
    };
    let value = d(1, 1, 1);
    let gradient = 0.5 * Vector3::new(d(1, 1, 2) - d(1, 1, 0), d(1, 2, 1) - d(1, 0, 1), d(2, 1, 1) - d(0, 1, 1));
    let xx = d(1, 1, 2) + d(1, 1, 0) - 2.0 * value;
    let yy = d(1, 2, 1) + d(1, 0, 1) - 2.0 * value;
    let ss = d(2, 1, 1) + d(0, 1, 1) - 2.0 * value;
    let xy = 0.25 * (d(1, 2, 2) - d(1, 2, 0) - d(1, 0, 2) + d(1, 0, 0));
    let xs = 0.25 * (d(2, 1, 2) - d(2, 1, 0) - d(0, 1, 2) + d(0, 1, 0));
    let ys = 0.25 * (d(2, 2, 1) - d(2, 0, 1) - d(0, 2, 1) + d(0, 0, 1));
    Derivatives { value, gradient, hessian: Matrix3::new(xx, xy, xs, xy, yy, ys, xs, ys, ss) }
}

/// The extremum of the paraboloid through the neighbourhood of a cell, which is moved until it contains it. None if
/// it runs away, is too faint, or lies on an edge.
fn refined(octave: &Octave, mut cell: [usize; 3], limits: &Limits) -> Option<Extremum> {
    for _ in 0..MOST_MOVES {
        let Derivatives { value, gradient, hessian } = derivatives(octave, cell);
        let offset = -(hessian.try_inverse()? * gradient);
        if offset.iter().all(|part| part.abs() < 0.5) {
            let contrast = (value + 0.5 * gradient.dot(&offset)).abs();
            let is_corner = contrast >= f64::from(limits.contrast) && !is_edge(&hessian, limits.edge_ratio);
            let at = Vector3::new(cell[2] as f64, cell[1] as f64, cell[0] as f64) + offset;
            return is_corner.then_some(Extremum { cell, at, contrast, hessian });
        }
        let beyond = [INTERVALS + 1, octave.height - RIM, octave.width - RIM];
        let first = [1, RIM, RIM];
        for axis in 0..3 {
            // far beyond any picture if the paraboloid is nearly flat: the cast saturates
            let moved = cell[axis] as i64 + (offset[2 - axis].round() as i64).clamp(-1 << 40, 1 << 40);
            cell[axis] = usize::try_from(moved).ok().filter(|moved| (first[axis]..beyond[axis]).contains(moved))?;
        }
    }
    None
}

/// Whether the curvature along the picture is much larger one way than the other (Lowe's equation in section 4.1).
fn is_edge(hessian: &Matrix3<f64>, edge_ratio: f32) -> bool {
    let ratio = f64::from(edge_ratio);
    let trace = hessian[(0, 0)] + hessian[(1, 1)];
    let determinant = hessian[(0, 0)] * hessian[(1, 1)] - hessian[(0, 1)] * hessian[(0, 1)];
    determinant <= 0.0 || trace * trace * ratio >= (ratio + 1.0).powi(2) * determinant
}
