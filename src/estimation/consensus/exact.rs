//! The largest consistent set, by branch and bound.
//!
//! A set is consistent if the residual sum of its least-squares fit stays below a limit that grows with its size. The
//! residual sum never shrinks when a point joins: a core that exceeds the limit of the largest set it could grow to
//! excludes all sets that contain it, and a point that does not go with the core goes with none that contains the core.
//!
//! The bounds are those of the problem linearised at one orientation; what they let pass is resected before it counts.
//! When a better set has been found the problem is linearised anew at its orientation, until the same set is the
//! answer. What is proven then is this: no set is larger, and none as large has a smaller residual sum, in the problem
//! linearised at the orientation that is handed on. A set that agrees at quite another orientation, so that the images
//! of its points move by d pixels, is judged with residuals wrong by about d²/c pixels; such a rival is looked for by the
//! quadruples at the beginning, which are resected in full, but it is not excluded.

use super::quadruples::quadruples;
use super::sample::Sample;
use super::whitened::Candidates;
use super::{Consensus, Guarantee, LEAST_POINTS, MOST_POINTS, Survey};
use crate::estimation::Resection;
use crate::geometry::ExteriorOrientation;

/// Quadruples that are tried to find the neighbourhood: even if 70 % of the points are wrong, sixteen of these are
/// right.
const QUADRUPLES: usize = 2_000;
/// A residual of a right point hardly ever exceeds so many standard deviations.
const LARGEST_T: f64 = 3.3;
/// The linearised residual sum of a set near the orientation may err by a hundredth before the set is lost.
const MARGIN: f64 = 1.01;

/// The largest set of at least four points whose resection has a `sigma0` below `largest_sigma0`, and among the largest
/// the one with the smallest residual sum: what version B finds by trying all sets, the largest first. At most
/// `most_subsets` are examined (not counting the quadruples at the beginning); if these do not suffice the result is
/// `bounded`, the best so far with an upper bound of the size. Of more than forty points the first forty are searched,
/// those of the others that fit are added, and the result is `sampled`.
///
/// `None` if no consistent set was found.
#[must_use]
pub fn largest_consistent(survey: &Survey, largest_sigma0: f64, most_subsets: usize) -> Option<Consensus> {
    let searched = Survey { points: &survey.points[..survey.points.len().min(MOST_POINTS)], ..*survey };
    let mut search = Search {
        survey: &searched,
        largest_sigma0,
        best: None,
        left: most_subsets,
        at_most: 0,
        levels: Vec::new(),
        sample: Sample::default(),
    };
    let mut at = search.begin();
    while search.linearised(&at)? {
        at = search.best.as_ref()?.resection.orientation;
    }
    let best = search.best?;
    let subsets = most_subsets - search.left;
    let examined = search.sample.into_sets();
    if searched.points.len() < survey.points.len() {
        let Set { resection, inliers } = with_others(survey, best, largest_sigma0);
        return Some(Consensus { resection, inliers, guarantee: Guarantee::Sampled, subsets, examined });
    }
    let count = best.inliers.len();
    let guarantee =
        if search.left > 0 { Guarantee::Complete } else { Guarantee::Bounded { at_most: search.at_most.max(count) } };
    Some(Consensus { resection: best.resection, inliers: best.inliers, guarantee, subsets, examined })
}

/// A consistent set.
struct Set {
    resection: Resection,
    inliers: Vec<usize>,
}

/// The set with the points that were not searched but fit, if it is consistent with them.
fn with_others(survey: &Survey, set: Set, largest_sigma0: f64) -> Set {
    let fits = |index: &usize| {
        let point = &survey.points[*index];
        survey.squared_px(point, &set.resection.orientation) < (LARGEST_T * point.sigma_px).powi(2)
    };
    let others = (MOST_POINTS..survey.points.len()).filter(fits);
    let inliers: Vec<usize> = set.inliers.iter().copied().chain(others).collect();
    let resection = survey.resect(&inliers, &set.resection.orientation);
    match resection.filter(|resection| resection.sigma0() < largest_sigma0) {
        Some(resection) => Set { resection, inliers },
        None => set,
    }
}

struct Search<'a> {
    survey: &'a Survey<'a>,
    largest_sigma0: f64,
    best: Option<Set>,
    /// Subsets that may yet be examined.
    left: usize,
    /// No set among those that were left out when the budget ended is larger.
    at_most: usize,
    /// Room for the candidates of a core of every size.
    levels: Vec<Candidates>,
    sample: Sample,
}

impl Search<'_> {
    /// Where to linearise first: the orientation with the most points near, which often is the answer already.
    fn begin(&mut self) -> ExteriorOrientation {
        let mut sigmas_px: Vec<f64> = self.survey.points.iter().map(|point| point.sigma_px).collect();
        sigmas_px.sort_by(f64::total_cmp);
        let tolerance_px = LARGEST_T * sigmas_px.get(sigmas_px.len() / 2).copied().unwrap_or_default();
        let Some(found) = quadruples(self.survey, &|_| true, tolerance_px, QUADRUPLES, &|| false) else {
            return self.survey.start;
        };
        let orientation = found.resection.orientation;
        self.sample.hear_all(&found.examined);
        self.propose(&found.inliers, &orientation);
        orientation
    }

    /// Searches the problem linearised at an orientation; whether a better set was found that calls for another round.
    /// `None` if nothing can be linearised there.
    fn linearised(&mut self, at: &ExteriorOrientation) -> Option<bool> {
        let mut root = Candidates::linearised(self.survey, &self.order(at), at)?;
        self.at_most = 0;
        self.levels.resize_with(root.count() + 1, Candidates::default);
        let before = self.best.as_ref().map(|best| best.inliers.clone());
        if let Some(most) = self.bound(0, 0.0, &root) {
            root.retain(most);
            self.branch(&mut Vec::new(), 0.0, &root, at);
        }
        let after = self.best.as_ref().map(|best| &best.inliers);
        Some(self.left > 0 && after != before.as_ref())
    }

    /// Points that fit, first: the cores of the first branches are good, and what is branched on last is pruned first.
    fn order(&self, at: &ExteriorOrientation) -> Vec<usize> {
        let points = self.survey.points;
        let squared_t = |index: &usize| self.survey.squared_px(&points[*index], at) / points[*index].sigma_px.powi(2);
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by(|a, b| squared_t(a).total_cmp(&squared_t(b)));
        order
    }

    /// The residual sum below which a set of so many points would be better than the best.
    fn target(&self, count: usize) -> f64 {
        match &self.best {
            _ if count < self.least_count() => f64::NEG_INFINITY,
            Some(best) if count == best.inliers.len() => best.resection.squares,
            _ => self.largest_sigma0.powi(2) * self.redundancy(count),
        }
    }

    /// Of the fit of so many points.
    fn redundancy(&self, count: usize) -> f64 {
        (2 * count - if self.survey.prior.is_some() { 0 } else { 6 }) as f64
    }

    fn least_count(&self) -> usize {
        self.best.as_ref().map_or(LEAST_POINTS, |best| best.inliers.len())
    }

    /// By how much the residual sum of a core may grow in a set that would be better than the best; `None` if the
    /// core is in no such set. The more points a set has the larger is its limit, but the fewer candidates go with a
    /// limit the smaller is the set.
    fn bound(&self, count: usize, squares: f64, candidates: &Candidates) -> Option<f64> {
        let with = |most: f64| count + candidates.increments.iter().filter(|increment| **increment <= most).count();
        let mut size = with(f64::MAX);
        while size >= self.least_count() {
            let most = MARGIN * self.target(size) - squares;
            let possible = with(most);
            if most < 0.0 {
                return None;
            } else if possible >= size {
                return Some(most);
            }
            size = possible;
        }
        None
    }

    /// All sets of the core and some of the candidates: those with the first of them, those without it but with the
    /// second, and so on.
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
            self.left = self.left.saturating_sub(candidates.count() - place);
            let squares = squares + candidates.increments[place];
            core.push(candidates.points[place]);
            let mut level = std::mem::take(&mut self.levels[core.len()]);
            candidates.joined_by(place, &mut level);
            if core.len() >= LEAST_POINTS {
                self.sample.hear(core, Some(squares / self.redundancy(core.len())));
            }
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

    /// Takes a set for the best if it is, by its resection.
    fn propose(&mut self, chosen: &[usize], near: &ExteriorOrientation) {
        let mut inliers = chosen.to_vec();
        inliers.sort_unstable();
        let Some(resection) = self.survey.resect(&inliers, near) else { return };
        self.sample.hear(&inliers, Some(resection.sigma0().powi(2)));
        if resection.squares < self.target(inliers.len()) {
            self.best = Some(Set { resection, inliers });
        }
    }
}
