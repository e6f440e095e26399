//! Grey correlation of a template with a window, its peak to a fraction of a cell, and the covariance of that (method
//! 1.8; Schickler and Poth, equations 9 to 11).

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::template::Template;
use crate::features::GreyWindow;

/// A template that is ready to be laid over windows: the cells that count, as runs in rows, freed of their mean.
#[derive(Debug, Clone)]
pub(super) struct Correlator {
    half: usize,
    /// First column, row and values of each run of cells that count.
    runs: Vec<(usize, usize, Vec<f32>)>,
    count: f64,
    squares: f64,
}

/// How a template fits at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// Correlation coefficient; negative where bright and dark are exchanged.
    pub(super) rho: f64,
    /// Grey values of the window for one of the template.
    pub(super) gain: f64,
    /// Grey value of the window where that of the template is its mean.
    pub(super) offset: f64,
}

impl Correlator {
    /// `None` if fewer than nine cells count, or all are alike.
    pub(super) fn new(template: &Template) -> Option<Self> {
        let count = template.count();
        if count < 9 {
            return None;
        }
        let cared = || template.grey.iter().zip(&template.care).filter(|(_, care)| **care);
        let mean = cared().map(|(grey, _)| f64::from(*grey)).sum::<f64>() / count as f64;
        let mut runs: Vec<(usize, usize, Vec<f32>)> = Vec::new();
        let side = template.side();
        for (row, (greys, cares)) in template.grey.chunks(side).zip(template.care.chunks(side)).enumerate() {
            let mut column = 0;
            for same in cares.chunk_by(|a, b| a == b) {
                if same[0] {
                    let values = greys[column..column + same.len()].iter().map(|grey| grey - mean as f32).collect();
                    runs.push((column, row, values));
                }
                column += same.len();
            }
        }
        let squares: f64 = cared().map(|(grey, _)| (f64::from(*grey) - mean).powi(2)).sum();
        (squares > 0.0).then_some(Self { half: template.half, runs, count: count as f64, squares })
    }

    /// Cells that count.
    pub(super) fn count(&self) -> f64 {
        self.count
    }

    /// The fit with the middle cell over a cell of the window; `None` if the template reaches beyond it.
    pub(super) fn fit(&self, window: &GreyWindow, [x, y]: [usize; 2]) -> Option<Fit> {
        let (left, top) = (x.checked_sub(self.half)?, y.checked_sub(self.half)?);
        if x + self.half >= window.width || y + self.half >= window.height {
            return None;
        }
        let reference = f64::from(window.grey[y * window.width + x]);
        let (mut product, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for (column, row, values) in &self.runs {
            let from = (top + row) * window.width + left + column;
            let (p, s, q) = run(values, &window.grey[from..from + values.len()], reference as f32);
            product += f64::from(p);
            sum += f64::from(s);
            squares += f64::from(q);
        }
        let variance = squares - sum * sum / self.count;
        // what is even to a fraction of a grey value correlates with nothing
        let rho = if variance > 1e-4 * self.count { product / (variance * self.squares).sqrt() } else { 0.0 };
        Some(Fit { rho, gain: product / self.squares, offset: reference + sum / self.count })
    }

    /// The cell with the largest `sign * rho` within `reach` cells of another, with its fit.
    pub(super) fn best(
        &self,
        window: &GreyWindow,
        about: [usize; 2],
        reach: usize,
        sign: f64,
    ) -> Option<([usize; 2], Fit)> {
        let mut best: Option<([usize; 2], Fit)> = None;
        for y in about[1].saturating_sub(reach)..=about[1] + reach {
            for x in about[0].saturating_sub(reach)..=about[0] + reach {
                let Some(fit) = self.fit(window, [x, y]) else { continue };
                if best.is_none_or(|(_, other)| sign * fit.rho > sign * other.rho) {
                    best = Some(([x, y], fit));
                }
            }
        }
        best
    }

    /// Climbs to the nearest maximum of `sign * rho`, at most `steps` steps.
    pub(super) fn climb(
        &self,
        window: &GreyWindow,
        from: [usize; 2],
        steps: usize,
        sign: f64,
    ) -> Option<([usize; 2], Fit)> {
        let mut at = from;
        for _ in 0..steps {
            let (next, fit) = self.best(window, at, 1, sign)?;
            if next == at {
                return Some((at, fit));
            }
            at = next;
        }
        None
    }

    /// The second-order polynomial about a maximum of `sign * rho`: from the middle of the cell to the maximum, and the
    /// Hessian there. `None` if it is no maximum.
    pub(super) fn peak(&self, window: &GreyWindow, [x, y]: [usize; 2], sign: f64) -> Option<Peak> {
        let mut rho = [0.0; 9];
        for (k, rho) in rho.iter_mut().enumerate() {
            let cell = [(x + k % 3).checked_sub(1)?, (y + k / 3).checked_sub(1)?];
            *rho = sign * self.fit(window, cell)?.rho;
        }
        Peak::of(&rho)
    }

    /// By how much the variance of the position differs because what the template leaves is no white noise: grain,
    /// scanners and image content beside a mark are alike over many cells. Each cell pulls at the position by its
    /// residual times the template's gradient; what these pulls add up to is compared block by block with what they
    /// would add up to if they were independent. (Lines that are wider than drawn pull at both of their edges, which is
    /// nothing in sum.)
    pub(super) fn inflation(&self, template: &Template, window: &GreyWindow, at: [usize; 2], fit: &Fit) -> f64 {
        let side = template.side();
        let block = side.div_ceil(BLOCKS);
        let residuals = self.residuals(template, window, at, fit);
        let mut pulls = [[Vector2::zeros(); BLOCKS]; BLOCKS];
        let mut independent = 0.0;
        for (y, x) in (1..side - 1).flat_map(|y| (1..side - 1).map(move |x| (y, x))) {
            let k = y * side + x;
            let cared = [k - 1, k + 1, k - side, k + side].iter().all(|k| template.care[*k]);
            let Some(residual) = residuals[k].filter(|_| cared) else { continue };
            let slope = |a: usize, b: usize| f64::from(template.grey[b] - template.grey[a]);
            let pull = Vector2::new(slope(k - 1, k + 1), slope(k - side, k + side)) * residual;
            pulls[y / block][x / block] += pull;
            independent += pull.norm_squared();
        }
        let together: f64 = pulls.iter().flatten().map(|pull| pull.norm_squared()).sum();
        let inflation = together / independent;
        if inflation.is_finite() { inflation.clamp(LEAST_INFLATION, LARGEST_INFLATION) } else { 1.0 }
    }

    /// What the template leaves of the window, where it counts.
    pub(super) fn residuals(
        &self,
        template: &Template,
        window: &GreyWindow,
        [x, y]: [usize; 2],
        fit: &Fit,
    ) -> Vec<Option<f64>> {
        let side = template.side();
        let (left, top) = (x - self.half, y - self.half);
        let cared = template.grey.iter().zip(&template.care).filter(|(_, care)| **care);
        let mean = cared.map(|(grey, _)| f64::from(*grey)).sum::<f64>() / self.count;
        let one = |k: usize| {
            let seen = f64::from(window.grey[(top + k / side) * window.width + left + k % side]);
            seen - fit.offset - fit.gain * (f64::from(template.grey[k]) - mean)
        };
        (0..side * side).map(|k| template.care[k].then(|| one(k))).collect()
    }
}

/// Blocks along a side of a template: an odd number, so that a line through its centre has both of its edges in one block.
const BLOCKS: usize = 7;
/// A template that differs from the marks in what pulls nowhere, as in the width of lines, leaves more than the noise: but
/// no noise is less than this.
const LEAST_INFLATION: f64 = 0.05;
/// What is alike over more cells is no noise but another picture.
const LARGEST_INFLATION: f64 = 100.0;

/// Sums over a run: of products, of the window's values about a reference, and of their squares.
fn run(values: &[f32], grey: &[f32], reference: f32) -> (f32, f32, f32) {
    const LANES: usize = 8;
    let mut sums = [[0.0_f32; LANES]; 3];
    let (a, b) = (values.as_chunks::<LANES>(), grey.as_chunks::<LANES>());
    for (t, g) in a.0.iter().zip(b.0) {
        for lane in 0..LANES {
            let from_reference = g[lane] - reference;
            sums[0][lane] += t[lane] * from_reference;
            sums[1][lane] += from_reference;
            sums[2][lane] += from_reference * from_reference;
        }
    }
    let mut total = sums.map(|lanes| lanes.iter().sum::<f32>());
    for (t, g) in a.1.iter().zip(b.1) {
        let from_reference = g - reference;
        total[0] += t * from_reference;
        total[1] += from_reference;
        total[2] += from_reference * from_reference;
    }
    (total[0], total[1], total[2])
}

/// The peak of a correlation surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Peak {
    /// From the middle of the cell.
    pub(super) shift: Vector2<f64>,
    /// Second derivatives of the coefficient, per cell squared: negative definite.
    pub(super) hessian: Matrix2<f64>,
}

impl Peak {
    /// Of the coefficients of three times three cells, row by row (equations 9 and 10).
    fn of(rho: &[f64; 9]) -> Option<Self> {
        // least squares of a + b u + c v + d u² + e u v + f v²
        let mut design = SMatrix::<f64, 9, 6>::zeros();
        for k in 0..9 {
            let (u, v) = ((k % 3) as f64 - 1.0, (k / 3) as f64 - 1.0);
            design.set_row(k, &SVector::from([1.0, u, v, u * u, u * v, v * v]).transpose());
        }
        let normal = design.transpose() * design;
        let p = normal.cholesky()?.solve(&(design.transpose() * SVector::from(*rho)));
        let hessian = Matrix2::new(2.0 * p[3], p[4], p[4], 2.0 * p[5]);
        let shift = -(hessian.try_inverse()? * Vector2::new(p[1], p[2]));
        let is_maximum = hessian.trace() < 0.0 && hessian.determinant() > 0.0;
        (is_maximum && shift.amax() < 1.5).then_some(Self { shift, hessian })
    }

    /// The covariance of the position, cells squared, for `count` cells of white noise (method 1.8, equation 11 in its
    /// checked form: the template is free of noise).
    pub(super) fn covariance(&self, rho: f64, count: f64) -> Option<Matrix2<f64>> {
        let rho = rho.abs().clamp(1e-3, 1.0);
        Some((-self.hessian).try_inverse()? * ((1.0 - rho * rho) / rho / count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;
    use crate::interior::mark::{Library, Mark};
    use crate::interior::template::Placing;

    fn template(centre: Vector2<f64>) -> Template {
        let placing = Placing { cells_from_mm: Matrix2::new(30.0, 0.0, 0.0, -30.0), centre, blur: 0.7, core: false };
        Template::draw(&Mark::Library(Library::WildRc10), &placing)
    }

    /// The mark with noise, blurred over neighbours if asked for.
    fn scan(draws: &mut Draws, centre: Vector2<f64>, sigma: f64, alike: bool) -> GreyWindow {
        let drawn = template(centre);
        let side = drawn.side() + 8;
        let noise: Vec<f64> = (0..(side + 1) * (side + 1)).map(|_| sigma * draws.normal()).collect();
        let at = |x: usize, y: usize| noise[y * (side + 1) + x];
        let grey = (0..side * side).map(|k| {
            let (x, y) = (k % side, k / side);
            let inside = (4..side - 4).contains(&x) && (4..side - 4).contains(&y);
            let mark = if inside { drawn.grey[(y - 4) * drawn.side() + x - 4] } else { 0.0 };
            let noise =
                if alike { 0.5 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1)) } else { at(x, y) };
            40.0 + 100.0 * mark + noise as f32
        });
        GreyWindow { origin_px: [0, 0], reduction: 1, width: side, height: side, grey: grey.collect() }
    }

    /// Positions found in `runs` scans: mean squared Mahalanobis distance (2 expected), and the largest mean error.
    fn scatter(alike: bool, inflated: bool) -> (f64, f64) {
        let mut draws = Draws::new(7);
        let runs = 300;
        let (mut mahalanobis, mut bias) = (0.0, Vector2::zeros());
        for _ in 0..runs {
            let window = scan(&mut draws, Vector2::zeros(), 40.0, alike);
            let drawn = template(Vector2::zeros());
            let correlator = Correlator::new(&drawn).unwrap();
            let middle = [window.width / 2; 2];
            let (at, fit) = correlator.climb(&window, middle, 5, 1.0).unwrap();
            let peak = correlator.peak(&window, at, 1.0).unwrap();
            let inflation = if inflated { correlator.inflation(&drawn, &window, at, &fit) } else { 1.0 };
            let covariance = peak.covariance(fit.rho, correlator.count()).unwrap() * inflation;
            let error = peak.shift + Vector2::new(at[0] as f64, at[1] as f64).map(|v| v - middle[0] as f64);
            mahalanobis += error.dot(&(covariance.try_inverse().unwrap() * error));
            bias += error / f64::from(runs);
        }
        (mahalanobis / f64::from(runs), bias.amax())
    }

    #[test]
    fn positions_scatter_as_their_covariance_says() {
        let (mahalanobis, bias) = scatter(false, false);
        assert!((1.4..2.6).contains(&mahalanobis), "{mahalanobis}");
        assert!(bias < 0.02, "{bias}");
        let (mahalanobis, _) = scatter(false, true);
        assert!((1.4..2.6).contains(&mahalanobis), "{mahalanobis}");
    }

    #[test]
    fn noise_that_is_alike_from_cell_to_cell_is_allowed_for() {
        let (plain, _) = scatter(true, false);
        let (inflated, _) = scatter(true, true);
        assert!(plain > 3.0, "{plain}");
        assert!((1.4..2.8).contains(&inflated), "{inflated}");
    }

    #[test]
    fn the_coefficient_is_that_of_its_definition_and_turns_with_the_sign_of_the_film() {
        let mut draws = Draws::new(3);
        let mut window = scan(&mut draws, Vector2::new(0.2, 0.1), 5.0, false);
        let drawn = template(Vector2::zeros());
        let correlator = Correlator::new(&drawn).unwrap();
        let at = [window.width / 2 + 1, window.height / 2];
        let fit = correlator.fit(&window, at).unwrap();
        let (mut t, mut g) = (Vec::new(), Vec::new());
        for k in (0..drawn.grey.len()).filter(|&k| drawn.care[k]) {
            t.push(f64::from(drawn.grey[k]));
            let (x, y) = (at[0] - drawn.half + k % drawn.side(), at[1] - drawn.half + k / drawn.side());
            g.push(f64::from(window.grey[y * window.width + x]));
        }
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let (mt, mg) = (mean(&t), mean(&g));
        let dot =
            |a: &[f64], ma: f64, b: &[f64], mb: f64| a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>();
        let rho = dot(&t, mt, &g, mg) / (dot(&t, mt, &t, mt) * dot(&g, mg, &g, mg)).sqrt();
        assert!((fit.rho - rho).abs() < 1e-5);
        window.grey.iter_mut().for_each(|grey| *grey = 255.0 - *grey);
        assert!((correlator.fit(&window, at).unwrap().rho + rho).abs() < 1e-5);
        assert_eq!(correlator.fit(&window, [0, 0]), None);
    }

    #[test]
    fn a_second_order_surface_gives_its_own_maximum() {
        let rho = std::array::from_fn(|k| {
            let (u, v) = ((k % 3) as f64 - 1.0 - 0.3, (k / 3) as f64 - 1.0 + 0.2);
            0.9 - 0.1 * u * u - 0.05 * u * v - 0.2 * v * v
        });
        let peak = Peak::of(&rho).unwrap();
        assert!((peak.shift - Vector2::new(0.3, -0.2)).norm() < 1e-12);
        assert!((peak.hessian - Matrix2::new(-0.2, -0.05, -0.05, -0.4)).norm() < 1e-12);
        assert!(Peak::of(&rho.map(|r| -r)).is_none());
    }
}
