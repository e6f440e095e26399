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
/// so that it weighs nothing (a fit 1000 standard deviations away has its residual sum increased by 1e-4), but three
/// points on a line still have a fit.
const RIDGE: f64 = 1e-10;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::Prior;
    use crate::estimation::simulated::{Draws, PRINCIPAL_DISTANCE_PX as C, flight, points};
    use approx::assert_relative_eq;
    use nalgebra::Vector6;
    use proptest::prelude::*;

    /// The residual sum of the linearised fit, by the normal equations with the ridge.
    fn residual_sum(survey: &Survey, chosen: &[usize], at: &ExteriorOrientation) -> f64 {
        let points: Vec<_> = chosen.iter().map(|&index| survey.points[index]).collect();
        let mut normal = equations(&points, survey.prior, at, C).unwrap();
        let all = equations(survey.points, survey.prior, at, C).unwrap();
        normal.matrix += Matrix6::from_diagonal(&(all.matrix.diagonal() * RIDGE));
        normal.squares - normal.right_side.dot(&normal.solve().unwrap())
    }

    proptest! {
        /// Cores are joined in any order; candidates are dropped on the way.
        #[test]
        fn increments_are_those_of_the_normal_equations(seed in 0_u64..1000, count in 6_usize..25, with_prior: bool) {
            let mut draws = Draws::new(seed);
            let points = points(&mut draws, &flight(), count, 3.0);
            let sigmas = Vector6::new(5.0, 5.0, 5.0, 0.01, 0.01, 0.01);
            let information = Matrix6::from_diagonal(&sigmas.map(|s| 1.0 / (s * s)));
            let prior = Prior { orientation: flight(), information };
            let at = flight().moved(&Vector6::new(1.0, -2.0, 1.0, 0.002, -0.001, 0.003));
            let prior = with_prior.then_some(&prior);
            let survey = Survey { points: &points, prior, start: at, principal_distance_px: C };
            let order: Vec<usize> = (0..count).rev().collect();
            let mut level = Candidates::linearised(&survey, &order, &at).unwrap();
            let (mut core, mut squares) = (Vec::new(), 0.0);
            while level.count() > 0 {
                for place in 0..level.count() {
                    let joined = [&core[..], &[level.points[place]]].concat();
                    let expected = residual_sum(&survey, &joined, &at);
                    assert_relative_eq!(squares + level.increments[place], expected, max_relative = 1e-4, epsilon = 1e-3);
                }
                let place = draws.below(level.count().min(3));
                core.push(level.points[place]);
                squares += level.increments[place];
                let mut next = Candidates::default();
                level.joined_by(place, &mut next);
                next.retain(f64::MAX);
                if let Some(largest) = next.increments.iter().copied().reduce(f64::max).filter(|_| seed % 2 == 0) {
                    next.retain(largest * (1.0 - 1e-9));
                }
                prop_assert!(next.points.iter().all(|index| !core.contains(index)));
                level = next;
            }
        }
    }

    #[test]
    fn a_point_more_never_makes_a_residual_sum_smaller() {
        let points = points(&mut Draws::new(3), &flight(), 12, 100.0);
        let survey = Survey { points: &points, prior: None, start: flight(), principal_distance_px: C };
        let order: Vec<usize> = (0..12).collect();
        let mut level = Candidates::linearised(&survey, &order, &flight()).unwrap();
        while level.count() > 0 {
            assert!(level.increments.iter().all(|increment| *increment >= 0.0));
            let mut next = Candidates::default();
            level.joined_by(0, &mut next);
            next.retain(f64::MAX);
            level = next;
        }
    }
}
