//! The largest consistent set, by branch and bound.

use super::quadruples::quadruples;
use super::whitened::Candidates;
use super::{Consensus, Guarantee, LEAST_POINTS, select};
use crate::estimation::{PointObservation, Prior, Resection, resect};
use crate::geometry::ExteriorOrientation;

/// Points that are searched completely, those that come first; of those after them, the ones that fit are added.
const MOST_POINTS: usize = 40;
/// Quadruples that are tried to find the neighbourhood: even if 70 % of the points are wrong, sixteen of these are
/// right.
const QUADRUPLES: usize = 2_000;
/// A residual of a right point, in standard deviations of its two coordinates, hardly ever exceeds this.
const LARGEST_T: f64 = 3.3;
/// The linearised residual sum of a set may err by so much before a consistent set is lost.
const MARGIN: f64 = 1.01;
/// Linearisations: the second one mostly confirms the first.
const MOST_ROUNDS: usize = 5;

/// The largest set of at least four points whose resection has a `sigma0` below `largest_sigma0`, and among sets as
/// large the one with the smallest sum of squared residuals. This is the answer version B looks for.
#[must_use]
pub fn largest_consistent(
    points: &[PointObservation],
    prior: Option<&Prior>,
    start: &ExteriorOrientation,
    principal_distance_px: f64,
    largest_sigma0: f64,
    most_subsets: usize,
) -> Option<Consensus> {
    let problem = Problem { points, prior, principal_distance_px, largest_sigma0 };
    let searched = &points[..points.len().min(MOST_POINTS)];
    let mut search = Search { problem: &problem, best: None, left: most_subsets, at_most: 0, levels: Vec::new() };
    let mut at = *start;
    if let Some((orientation, best)) = problem.neighbourhood(searched, start) {
        at = orientation;
        search.best = best;
    }
    let mut complete = false;
    for _ in 0..MOST_ROUNDS {
        let before = search.best.as_ref().map(|best| best.inliers.clone());
        search.round(searched, &at)?;
        if search.left == 0 {
            break;
        }
        let Some(best) = &search.best else {
            complete = true;
            break;
        };
        at = best.resection.orientation;
        if before.as_ref() == Some(&best.inliers) {
            complete = true;
            break;
        }
    }
    let subsets = most_subsets - search.left;
    let best = search.best?;
    let guarantee = if searched.len() < points.len() {
        Guarantee::Sampled
    } else if complete {
        Guarantee::Complete
    } else {
        Guarantee::Bounded { at_most: search.at_most.max(best.inliers.len()) }
    };
    Some(Consensus { resection: best.resection, inliers: best.inliers, guarantee, subsets })
}

/// What is asked.
struct Problem<'a> {
    points: &'a [PointObservation],
    prior: Option<&'a Prior>,
    principal_distance_px: f64,
    largest_sigma0: f64,
}

/// A consistent set.
struct Set {
    resection: Resection,
    inliers: Vec<usize>,
}

impl Problem<'_> {
    /// The residual sum that a set of `count` points must stay below.
    fn limit(&self, count: usize) -> f64 {
        let redundancy = 2 * count - if self.prior.is_some() { 0 } else { 6 };
        self.largest_sigma0.powi(2) * redundancy as f64
    }

    fn neighbourhood(
        &self,
        searched: &[PointObservation],
        start: &ExteriorOrientation,
    ) -> Option<(ExteriorOrientation, Option<Set>)> {
        let mut sigmas_px: Vec<f64> = searched.iter().map(|point| point.sigma_px).collect();
        let middle = sigmas_px.len() / 2;
        if sigmas_px.is_empty() {
            return None;
        }
        let tolerance_px = LARGEST_T * *sigmas_px.select_nth_unstable_by(middle, f64::total_cmp).1;
        let c = self.principal_distance_px;
        let found = quadruples(searched, self.prior, start, c, &|_| true, tolerance_px, QUADRUPLES, &|| false)?;
        let orientation = found.resection.orientation;
        let consistent = found.resection.squares < self.limit(found.inliers.len());
        Some((orientation, consistent.then_some(Set { resection: found.resection, inliers: found.inliers })))
    }

    /// The set, if it is consistent in fact.
    fn consistent(&self, mut inliers: Vec<usize>, near: &ExteriorOrientation) -> Option<Set> {
        inliers.sort_unstable();
        let resection = resect(&select(self.points, &inliers), self.prior, near, self.principal_distance_px)?;
        (resection.squares < self.limit(inliers.len())).then_some(Set { resection, inliers })
    }
}

struct Search<'a> {
    problem: &'a Problem<'a>,
    best: Option<Set>,
    /// Subsets that may yet be examined.
    left: usize,
    at_most: usize,
    levels: Vec<Candidates>,
}

impl Search<'_> {
    /// Searches the problem linearised at an orientation.
    fn round(&mut self, searched: &[PointObservation], at: &ExteriorOrientation) -> Option<()> {
        let p = self.problem;
        let order = self.order(searched, at);
        let mut root = Candidates::linearised(searched, &order, p.prior, at, p.principal_distance_px)?;
        self.at_most = 0;
        self.levels.resize_with(root.count() + 1, Candidates::default);
        let mut core = Vec::new();
        if let Some(most) = self.bound(0, 0.0, &root) {
            root.retain(most);
            self.branch(&mut core, 0.0, &root, at);
        }
        Some(())
    }

    fn order(&self, searched: &[PointObservation], at: &ExteriorOrientation) -> Vec<usize> {
        let c = self.problem.principal_distance_px;
        let residual = |index: usize| {
            let point = &searched[index];
            let image = at.reduced_px(c, point.object_m);
            image.map_or(f64::INFINITY, |image| (image - point.image_px).norm() / point.sigma_px)
        };
        let mut order: Vec<usize> = (0..searched.len()).collect();
        order.sort_by(|a, b| residual(*a).total_cmp(&residual(*b)));
        order
    }

    /// The residual sum below which a set of `count` points would be better than the best.
    fn target(&self, count: usize) -> f64 {
        match &self.best {
            Some(best) if count < best.inliers.len() => f64::NEG_INFINITY,
            Some(best) if count == best.inliers.len() => best.resection.squares,
            _ if count < LEAST_POINTS => f64::NEG_INFINITY,
            _ => self.problem.limit(count),
        }
    }

    fn least_count(&self) -> usize {
        self.best.as_ref().map_or(LEAST_POINTS, |best| best.inliers.len())
    }

    /// What increments can still belong to a better set that holds a core; `None` if there is no such set.
    fn bound(&self, count: usize, squares: f64, candidates: &Candidates) -> Option<f64> {
        let mut upper = count + candidates.increments.iter().filter(|i| i.is_finite()).count();
        while upper >= self.least_count() {
            let most = MARGIN * self.target(upper) - squares;
            if most < 0.0 {
                return None;
            }
            let possible = count + candidates.increments.iter().filter(|increment| **increment <= most).count();
            if possible >= upper {
                return Some(most);
            }
            upper = possible;
        }
        None
    }

    fn branch(&mut self, core: &mut Vec<usize>, squares: f64, candidates: &Candidates, at: &ExteriorOrientation) {
        for place in 0..candidates.count() {
            let most_count = core.len() + candidates.count() - place;
            if most_count < self.least_count() {
                return;
            }
            if self.left == 0 {
                self.at_most = self.at_most.max(most_count);
                return;
            }
            let squares = squares + candidates.increments[place];
            core.push(candidates.points[place]);
            let mut level = std::mem::take(&mut self.levels[core.len()]);
            candidates.joined_by(place, &mut level);
            self.left = self.left.saturating_sub(candidates.count() - place);
            if squares < MARGIN * self.target(core.len()) {
                self.propose(core, at);
            }
            if let Some(most) = self.bound(core.len(), squares, &level) {
                level.retain(most);
                self.branch(core, squares, &level, at);
            }
            self.levels[core.len()] = level;
            core.pop();
        }
    }

    fn propose(&mut self, core: &[usize], at: &ExteriorOrientation) {
        let Some(set) = self.problem.consistent(core.to_vec(), at) else { return };
        let better = self.best.as_ref().is_none_or(|best| {
            (set.inliers.len(), -set.resection.squares) > (best.inliers.len(), -best.resection.squares)
        });
        if better {
            self.best = Some(set);
        }
    }
}
