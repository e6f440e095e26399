//! Both versions as the paper has them, one resection after the other: the truth for the fast ones.

use super::Survey;
use crate::estimation::Resection;
use crate::geometry::ExteriorOrientation;

impl Survey<'_> {
    /// Version A: the smallest robust sum, and its four points.
    pub(super) fn best_quadruple(
        &self,
        acceptable: &dyn Fn(&Resection) -> bool,
        tolerance_px: f64,
    ) -> Option<(f64, Resection)> {
        let trials = combinations(self.points.len(), 4).filter_map(|chosen| self.resect(&chosen, &self.start));
        let rated = trials.filter(acceptable).map(|trial| (self.robust_sum(&trial.orientation, tolerance_px), trial));
        rated.min_by(|(a, _), (b, _)| a.total_cmp(b))
    }

    fn robust_sum(&self, at: &ExteriorOrientation, tolerance_px: f64) -> f64 {
        self.points.iter().map(|point| self.squared_px(point, at).min(tolerance_px.powi(2))).sum()
    }

    /// The points that lie within the tolerance of an orientation.
    pub(super) fn within(&self, at: &ExteriorOrientation, tolerance_px: f64) -> Vec<usize> {
        let near = |index: &usize| self.squared_px(&self.points[*index], at) < tolerance_px.powi(2);
        (0..self.points.len()).filter(near).collect()
    }

    /// Version B: the largest sets first, and of the first size with a consistent set the best; and how many sets that
    /// took.
    pub(super) fn largest(&self, largest_sigma0: f64) -> (Option<(Vec<usize>, Resection)>, usize) {
        let mut trials = 0;
        for size in (4..=self.points.len()).rev() {
            let mut best: Option<(Vec<usize>, Resection)> = None;
            for chosen in combinations(self.points.len(), size) {
                trials += 1;
                let Some(trial) = self.resect(&chosen, &self.start).filter(|trial| trial.sigma0() < largest_sigma0)
                else {
                    continue;
                };
                if best.as_ref().is_none_or(|(_, best)| trial.squares < best.squares) {
                    best = Some((chosen, trial));
                }
            }
            if best.is_some() {
                return (best, trials);
            }
        }
        (None, trials)
    }
}

/// All subsets of `size` of the indices below `count`, in lexical order.
pub(super) fn combinations(count: usize, size: usize) -> impl Iterator<Item = Vec<usize>> {
    let first = (size <= count).then(|| (0..size).collect());
    std::iter::successors(first, move |last: &Vec<usize>| {
        // the last place that can still move on; those behind it follow at its heels
        let place = (0..size).rev().find(|&place| last[place] < count - size + place)?;
        let mut next = last.clone();
        for (index, value) in next[place..].iter_mut().zip(last[place] + 1..) {
            *index = value;
        }
        Some(next)
    })
}
