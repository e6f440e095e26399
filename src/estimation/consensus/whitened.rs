//! The linearised problem of a branch of the search: what a set of points, the core, says of each point outside it.
//!
//! The parameters are scaled such that the covariance of the core's fit is the unit matrix. A point's two observation
//! equations then are rows `h` with misclosures `v` whose covariance is `I + h h'`, and the residual sum grows by
//! `v' (I + h h')^-1 v` when the point joins the core. That is never negative, without any cancellation of digits:
//! the residual sum is monotone in fact and not only in theory.

use nalgebra::Matrix6;

use super::Survey;
use super::lanes::{Lanes, WIDTH};
use crate::estimation::resection::equations;
use crate::geometry::ExteriorOrientation;

/// What no observation says of the parameters, a ridge does: in units of the information of all points together,
/// so that it weighs nothing (a fit 1000 standard deviations away has its residual sum increased by 1e-3), but three
/// points on a line still have a fit.
const RIDGE: f64 = 1e-9;

/// The points outside a core. Eight of them to a pack; what fills up the last pack is never read.
#[derive(Clone, Default)]
pub(super) struct Candidates {
    /// Which points these are.
    pub(super) points: Vec<usize>,
    /// By how much the residual sum would grow with each alone.
    pub(super) increments: Vec<f64>,
    /// Two rows of six and two misclosures.
    packs: Vec<[[Lanes; 7]; 2]>,
}

impl Candidates {
    /// The points that have an image at `at`, in the order given; the core is the prior alone. `None` if there is no
    /// such point, or the prior is not one.
    pub(super) fn linearised(survey: &Survey, order: &[usize], at: &ExteriorOrientation) -> Option<Self> {
        let c = survey.principal_distance_px;
        let mut candidates = Self::default();
        let mut rows = Vec::new();
        for &index in order {
            let point = &survey.points[index];
            let Some((image, jacobian)) = at.reduced_px_with_jacobian(c, point.object_m) else { continue };
            let (misclosure, jacobian) = ((point.image_px - image) / point.sigma_px, jacobian / point.sigma_px);
            if misclosure.iter().chain(jacobian.iter()).all(|value| value.is_finite()) {
                candidates.points.push(index);
                rows.push((jacobian, misclosure));
            }
        }
        let of_prior = equations(&[], survey.prior, at, c)?;
        let all = rows.iter().fold(of_prior.matrix, |sum, (jacobian, _)| sum + jacobian.transpose() * jacobian);
        let ridge = Matrix6::from_diagonal(&(all.diagonal() * RIDGE));
        let core = of_prior.matrix + ridge;
        let scale = core.diagonal().map(|d| 1.0 / d.sqrt());
        let scaling = Matrix6::from_diagonal(&scale);
        let factor = (scaling * core * scaling).cholesky()?.l();
        let offset = factor.solve_lower_triangular(&of_prior.right_side.component_mul(&scale))?;
        for (jacobian, misclosure) in rows {
            // rows times the inverse transpose of the factor
            let whitened = factor.solve_lower_triangular(&(scaling * jacobian.transpose()))?.transpose();
            let misclosure = misclosure - whitened * offset;
            candidates.push(std::array::from_fn(|row| {
                std::array::from_fn(|k| if k < 6 { whitened[(row, k)] } else { misclosure[row] })
            }));
        }
        candidates.measure();
        (!candidates.points.is_empty()).then_some(candidates)
    }

    pub(super) fn count(&self) -> usize {
        self.points.len()
    }

    fn push(&mut self, rows: [[f64; 7]; 2]) {
        let lane = self.increments.len() % WIDTH;
        if lane == 0 {
            self.packs.push([[Lanes::ZERO; 7]; 2]);
        }
        if let Some(pack) = self.packs.last_mut() {
            for (to, from) in pack.iter_mut().flatten().zip(rows.as_flattened()) {
                to.0[lane] = *from;
            }
        }
        self.increments.push(0.0);
    }

    fn row(&self, place: usize) -> [[f64; 7]; 2] {
        let mut rows = [[0.0; 7]; 2];
        for (to, from) in rows.as_flattened_mut().iter_mut().zip(self.packs[place / WIDTH].as_flattened()) {
            *to = from.0[place % WIDTH];
        }
        rows
    }

    fn measure(&mut self) {
        for (pack, increments) in self.packs.iter().zip(self.increments.chunks_mut(WIDTH)) {
            increments.copy_from_slice(&increments_of(pack).0[..increments.len()]);
        }
    }

    /// What the core and the candidate at `place` together say of those after it.
    pub(super) fn joined_by(&self, place: usize, joined: &mut Self) {
        let joining = Joining::new(&self.row(place));
        let first = place + 1;
        let first_pack = first / WIDTH;
        joined.points.clear();
        joined.points.extend_from_slice(&self.points[(first_pack * WIDTH).min(self.count())..]);
        joined.increments.clear();
        joined.increments.resize(joined.points.len(), 0.0);
        joined.packs.clear();
        joined.packs.extend_from_slice(&self.packs[first_pack.min(self.packs.len())..]);
        for row in joined.packs.as_flattened_mut() {
            joining.apply(row);
        }
        joined.measure();
        // those of the first pack that stand before the place
        for increment in joined.increments.iter_mut().take(first % WIDTH) {
            *increment = f64::INFINITY;
        }
    }

    /// Leaves those whose increment is at most `most`, in their order.
    pub(super) fn retain(&mut self, most: f64) {
        let mut kept = 0;
        for place in 0..self.points.len() {
            if self.increments[place] <= most {
                if kept < place {
                    self.points[kept] = self.points[place];
                    self.increments[kept] = self.increments[place];
                    let rows = self.row(place);
                    for (to, from) in self.packs[kept / WIDTH].iter_mut().flatten().zip(rows.as_flattened()) {
                        to.0[kept % WIDTH] = *from;
                    }
                }
                kept += 1;
            }
        }
        self.points.truncate(kept);
        self.increments.truncate(kept);
        self.packs.truncate(kept.div_ceil(WIDTH));
    }
}

/// `v' (I + h h')^-1 v`
#[inline(always)]
fn increments_of(pack: &[[Lanes; 7]; 2]) -> Lanes {
    let (x, y) = (&pack[0], &pack[1]);
    let (mut xx, mut xy, mut yy) = (Lanes::all(1.0), Lanes::ZERO, Lanes::all(1.0));
    for k in 0..6 {
        xx = xx + x[k] * x[k];
        xy = xy + x[k] * y[k];
        yy = yy + y[k] * y[k];
    }
    let (v, w) = (x[6], y[6]);
    let cross = v * w * xy;
    (v * v * yy - cross - cross + w * w * xx) / (xx * yy - xy * xy)
}

/// A point joins the core: its two equations one after the other.
struct Joining([One; 2]);

/// One equation joins: parameters are turned and shrunk by `I - beta g g'`, misclosures reduced by `h'g` times `gain`.
#[derive(Clone, Copy)]
struct One {
    g: [f64; 6],
    beta: f64,
    gain: f64,
}

impl One {
    fn new(row: &[f64; 7]) -> Self {
        let g: [f64; 6] = std::array::from_fn(|k| row[k]);
        let variance = 1.0 + g.iter().map(|g| g * g).sum::<f64>();
        Self { g, beta: 1.0 / (variance + variance.sqrt()), gain: row[6] / variance }
    }

    fn apply_to_one(&self, row: &mut [f64; 7]) {
        let product: f64 = self.g.iter().zip(&*row).map(|(g, h)| g * h).sum();
        for (h, g) in row.iter_mut().zip(&self.g) {
            *h -= product * self.beta * g;
        }
        row[6] -= product * self.gain;
    }

    #[inline(always)]
    fn apply(&self, row: &mut [Lanes; 7]) {
        let mut product = Lanes::ZERO;
        for (h, g) in row.iter().zip(&self.g) {
            product = product + *h * Lanes::all(*g);
        }
        let shrink = product * Lanes::all(self.beta);
        for (h, g) in row.iter_mut().zip(&self.g) {
            *h = *h - shrink * Lanes::all(*g);
        }
        row[6] = row[6] - product * Lanes::all(self.gain);
    }
}

impl Joining {
    fn new([first, second]: &[[f64; 7]; 2]) -> Self {
        let first = One::new(first);
        let mut second = *second;
        first.apply_to_one(&mut second);
        Self([first, One::new(&second)])
    }

    #[inline(always)]
    fn apply(&self, row: &mut [Lanes; 7]) {
        self.0[0].apply(row);
        self.0[1].apply(row);
    }
}
