//! Version A: all quadruples, eight at a time.

use super::eight::{EightOrientations, PointLanes, PriorLanes};
use super::lanes::{Lanes, WIDTH};
use super::{Consensus, Guarantee, LEAST_POINTS, select};
use crate::estimation::{PointObservation, Prior, Resection, resect};
use crate::geometry::ExteriorOrientation;

/// Quadruples are drawn from so many points at most, those that come first: C(40, 4) = 91 390.
pub const MOST_POINTS: usize = 40;

/// Version A: the orientation by four points whose robust sum `min(e², t²)` over all points is the smallest, among
/// the quadruples that are `acceptable`; then that by all points with a residual below `tolerance_px`, t. (The pull of
/// a prior goes unpunished: the sum is over the points.) The surest points should come first: where there are more
/// than [`MOST_POINTS`], the quadruples are drawn from the first, and where there are more quadruples than `most`,
/// every second or third is tried, as many as that, and the result is `sampled`.
///
/// `None` if fewer than four points agree, none of the quadruples is acceptable, or the search is `cancelled`.
#[must_use]
#[expect(clippy::too_many_arguments, reason = "the survey, and the paper's three thresholds")]
pub fn quadruples(
    points: &[PointObservation],
    prior: Option<&Prior>,
    start: &ExteriorOrientation,
    principal_distance_px: f64,
    acceptable: &dyn Fn(&Resection) -> bool,
    tolerance_px: f64,
    most: usize,
    cancelled: &dyn Fn() -> bool,
) -> Option<Consensus> {
    let from = points.len().min(MOST_POINTS);
    let stride = fours(from).count().div_ceil(most.max(1)).max(1);
    let mut search = Search {
        points,
        prior,
        prior_lanes: prior.map(PriorLanes::new),
        start: EightOrientations::all(start, principal_distance_px),
        principal_distance_px,
        acceptable,
        tolerance_px,
        best: None,
    };
    let (mut eight, mut filled, mut subsets) = ([[0; LEAST_POINTS]; WIDTH], 0, 0);
    for chosen in fours(from).step_by(stride) {
        eight[filled] = chosen;
        filled += 1;
        subsets += 1;
        if filled == WIDTH {
            if cancelled() {
                return None;
            }
            search.try_eight(&eight, filled);
            filled = 0;
        }
    }
    if filled > 0 && !cancelled() {
        search.try_eight(&eight, filled);
    }
    let guarantee = if stride == 1 && from == points.len() { Guarantee::Complete } else { Guarantee::Sampled };
    let (_, orientation) = search.best.take()?;
    let inliers = search.below(&orientation);
    if inliers.len() < LEAST_POINTS {
        return None;
    }
    let resection = resect(&select(points, &inliers), prior, &orientation, principal_distance_px)?;
    Some(Consensus { resection, inliers, guarantee, subsets })
}

/// All subsets of four of the indices below `count`, in lexical order.
fn fours(count: usize) -> impl Iterator<Item = [usize; LEAST_POINTS]> {
    let pairs = move |from: usize| (from..count).flat_map(move |i| (i + 1..count).map(move |j| [i, j]));
    pairs(0).flat_map(move |[i, j]| pairs(j + 1).map(move |[k, l]| [i, j, k, l]))
}

struct Search<'a> {
    points: &'a [PointObservation],
    prior: Option<&'a Prior>,
    prior_lanes: Option<PriorLanes>,
    start: EightOrientations,
    principal_distance_px: f64,
    acceptable: &'a dyn Fn(&Resection) -> bool,
    tolerance_px: f64,
    /// The smallest robust sum with its orientation.
    best: Option<(f64, ExteriorOrientation)>,
}

impl Search<'_> {
    /// Eight quadruples side by side; what seems better than the best so far is computed once more on its own.
    fn try_eight(&mut self, eight: &[[usize; LEAST_POINTS]; WIDTH], filled: usize) {
        let lanes: [PointLanes; LEAST_POINTS] =
            std::array::from_fn(|place| PointLanes::new(std::array::from_fn(|lane| &self.points[eight[lane][place]])));
        let mut orientations = self.start;
        orientations.resect(&lanes, self.prior_lanes.as_ref());
        let Some(sums) = self.robust_sums(&orientations) else { return };
        for lane in 0..filled {
            if sums.0[lane] < self.promising() {
                self.try_one(&eight[lane], &orientations.one(lane));
            }
        }
    }

    fn bound(&self) -> f64 {
        self.best.as_ref().map_or(f64::INFINITY, |(sum, _)| *sum)
    }

    /// The side-by-side solution has not been carried to its last digit.
    fn promising(&self) -> f64 {
        1.001 * self.bound()
    }

    fn try_one(&mut self, chosen: &[usize], near: &ExteriorOrientation) {
        let four = select(self.points, chosen);
        let trial = resect(&four, self.prior, near, self.principal_distance_px);
        let Some(trial) = trial.filter(|trial| (self.acceptable)(trial)) else { return };
        if let Some(sum) = self.robust_sum(&trial.orientation) {
            self.best = Some((sum, trial.orientation));
        }
    }

    /// The sums of `min(e², t²)`; `None` as soon as none of them is promising.
    fn robust_sums(&self, at: &EightOrientations) -> Option<Lanes> {
        let (bound, most) = (self.promising(), self.tolerance_px.powi(2));
        let squared_px = at.squared_residuals_px();
        let mut sums = Lanes::ZERO;
        for point in self.points {
            sums = sums.with(squared_px(point), |sum, squared| sum + if squared < most { squared } else { most });
            if sums.0.iter().fold(true, |hopeless, sum| hopeless & (*sum >= bound)) {
                return None;
            }
        }
        Some(sums)
    }

    fn squared_px(&self, point: &PointObservation, at: &ExteriorOrientation) -> f64 {
        let projected = at.reduced_px(self.principal_distance_px, point.object_m);
        projected.map_or(f64::INFINITY, |image| (image - point.image_px).norm_squared())
    }

    /// The sum of `min(e², t²)`; `None` unless it is the smallest so far.
    fn robust_sum(&self, at: &ExteriorOrientation) -> Option<f64> {
        let most = self.tolerance_px.powi(2);
        let sum: f64 = self.points.iter().map(|point| self.squared_px(point, at).min(most)).sum();
        (sum < self.bound()).then_some(sum)
    }

    fn below(&self, at: &ExteriorOrientation) -> Vec<usize> {
        let near = |index: &usize| self.squared_px(&self.points[*index], at) < self.tolerance_px.powi(2);
        (0..self.points.len()).filter(near).collect()
    }
}
