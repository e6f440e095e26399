//! Which of the located control points are right? The two searches of Förstner and Läbe (section 2.2, step 2).

use nalgebra::Vector2;

use super::normal::Prior;
use super::resection::{PointObservation, Resection, resect};
use crate::geometry::ExteriorOrientation;

/// The orientation that the points agree upon.
#[derive(Debug, Clone, PartialEq)]
pub struct Consensus {
    /// The resection with the inliers.
    pub resection: Resection,
    /// Indices of the points that are right, ascending.
    pub inliers: Vec<usize>,
    /// Subsets of the points that were tried.
    pub trials: usize,
    /// Whether the search came to its end; false if its budget ended it.
    pub complete: bool,
}

/// Fewer points than this do not check each other.
const LEAST_POINTS: usize = 4;

/// Version A: the orientation by four points whose robust sum `min(e², t²)` over all points is the smallest, among
/// the quadruples that are `acceptable`; then that by all points with a residual below `tolerance_px`, t. (The pull of
/// a prior goes unpunished: the sum is over the points.)
///
/// `None` if fewer than four points agree, none of the quadruples is acceptable, or the search is `cancelled`.
#[must_use]
pub fn quadruples(
    points: &[PointObservation],
    prior: Option<&Prior>,
    start: &ExteriorOrientation,
    principal_distance_px: f64,
    acceptable: &dyn Fn(&Resection) -> bool,
    tolerance_px: f64,
    cancelled: &dyn Fn() -> bool,
) -> Option<Consensus> {
    let residuals = Residuals { points, principal_distance_px };
    let mut best: Option<(f64, ExteriorOrientation)> = None;
    let mut trials = 0;
    for chosen in combinations(points.len(), LEAST_POINTS) {
        if cancelled() {
            return None;
        }
        trials += 1;
        let four = select(points, &chosen);
        let Some(trial) = resect(&four, prior, start, principal_distance_px).filter(acceptable) else { continue };
        let bound = best.as_ref().map_or(f64::INFINITY, |(sum, _)| *sum);
        if let Some(sum) = residuals.robust_sum(&trial.orientation, tolerance_px, bound) {
            best = Some((sum, trial.orientation));
        }
    }
    let (_, orientation) = best?;
    let inliers = residuals.below(&orientation, tolerance_px);
    if inliers.len() < LEAST_POINTS {
        return None;
    }
    let resection = resect(&select(points, &inliers), prior, &orientation, principal_distance_px)?;
    Some(Consensus { resection, inliers, trials, complete: true })
}

/// Version B: all points, and if they do not agree all subsets with one point less, with two less, down to four. The
/// search ends on the level on which a `sigma0` falls below `largest_sigma0`, with the smallest of that level, or
/// after `most_subsets` trials. Where nothing falls below it, the smallest of all is handed on: ask its `sigma0`.
///
/// `None` if there are fewer than four points, or no subset determines an orientation.
#[must_use]
pub fn complete_search(
    points: &[PointObservation],
    prior: Option<&Prior>,
    start: &ExteriorOrientation,
    principal_distance_px: f64,
    largest_sigma0: f64,
    most_subsets: usize,
) -> Option<Consensus> {
    let mut best: Option<(Resection, Vec<usize>)> = None;
    let mut trials = 0;
    let end = |best: Option<(Resection, Vec<usize>)>, trials, complete| {
        best.map(|(resection, inliers)| Consensus { resection, inliers, trials, complete })
    };
    for size in (LEAST_POINTS..=points.len()).rev() {
        for chosen in combinations(points.len(), size) {
            if trials == most_subsets {
                return end(best, trials, false);
            }
            trials += 1;
            let smallest = best.as_ref().map_or(f64::INFINITY, |(resection, _)| resection.sigma0());
            let trial = resect(&select(points, &chosen), prior, start, principal_distance_px);
            if let Some(trial) = trial.filter(|t| t.sigma0() < smallest) {
                best = Some((trial, chosen));
            }
        }
        if best.as_ref().is_some_and(|(resection, _)| resection.sigma0() < largest_sigma0) {
            break;
        }
    }
    end(best, trials, true)
}

fn select(points: &[PointObservation], chosen: &[usize]) -> Vec<PointObservation> {
    chosen.iter().map(|&index| points[index]).collect()
}

/// All subsets of `size` of the indices below `count`, in lexical order.
fn combinations(count: usize, size: usize) -> impl Iterator<Item = Vec<usize>> {
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

/// How far points lie from where an orientation projects them.
struct Residuals<'a> {
    points: &'a [PointObservation],
    principal_distance_px: f64,
}

impl Residuals<'_> {
    fn squared_px(&self, point: &PointObservation, at: &ExteriorOrientation) -> f64 {
        let projected = at.reduced_px(self.principal_distance_px, point.object_m);
        projected.map_or(f64::INFINITY, |image: Vector2<f64>| (image - point.image_px).norm_squared())
    }

    /// The sum of `min(e², t²)`; `None` as soon as it reaches `bound`.
    fn robust_sum(&self, at: &ExteriorOrientation, tolerance_px: f64, bound: f64) -> Option<f64> {
        self.points.iter().try_fold(0.0, |sum, point| {
            let sum = sum + self.squared_px(point, at).min(tolerance_px.powi(2));
            (sum < bound).then_some(sum)
        })
    }

    fn below(&self, at: &ExteriorOrientation, tolerance_px: f64) -> Vec<usize> {
        let near = |index: &usize| self.squared_px(&self.points[*index], at) < tolerance_px.powi(2);
        (0..self.points.len()).filter(near).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::{Draws, PRINCIPAL_DISTANCE_PX as C, flight, points};
    use nalgebra::{Matrix6, Vector3, Vector6};

    const SIGMA_PX: f64 = 0.8;

    /// Points of which every third may be a gross error of 30 to 150 px, and the indices of those that are right.
    fn with_gross_errors(seed: u64, count: usize) -> (Vec<PointObservation>, Vec<usize>) {
        let mut draws = Draws::new(seed);
        let mut points = points(&mut draws, &flight(), count, SIGMA_PX);
        let wrong = draws.below(3 * count / 10 + 1);
        for point in &mut points[..wrong] {
            let angle = draws.even(0.0, std::f64::consts::TAU);
            point.image_px += draws.even(30.0, 150.0) * Vector2::new(angle.cos(), angle.sin());
        }
        (points, (wrong..count).collect())
    }

    fn start() -> ExteriorOrientation {
        flight().moved(&Vector6::new(15.0, -20.0, 10.0, 0.03, -0.02, 0.05))
    }

    fn spread_out(resection: &Resection) -> bool {
        // four points in the corners determine the projection centre to half a metre
        resection.covariance.diagonal().fixed_rows::<3>(0).sum().sqrt() < 3.0
    }

    fn by_quadruples(points: &[PointObservation]) -> Option<Consensus> {
        quadruples(points, None, &start(), C, &spread_out, 10.0, &|| false)
    }

    fn by_search(points: &[PointObservation], largest_sigma0: f64, most: usize) -> Option<Consensus> {
        complete_search(points, None, &start(), C, largest_sigma0, most)
    }

    /// Whether the right points were found; panics if the orientation is off although they were.
    fn found(result: Option<Consensus>, expected: &[usize]) -> bool {
        result.is_some_and(|consensus| {
            let right = consensus.inliers == expected;
            let step = consensus.resection.orientation.step_to(&flight());
            let information = consensus.resection.covariance.try_inverse().unwrap();
            assert!(!right || step.dot(&(information * step)) < 35.0, "right points, wrong orientation");
            right
        })
    }

    #[test]
    fn both_versions_find_the_gross_errors() {
        let seeds = 60;
        let (mut a, mut b) = (0, 0);
        for seed in 0..seeds {
            let (points, expected) = with_gross_errors(seed, 10);
            a += usize::from(found(by_quadruples(&points), &expected));
            b += usize::from(found(by_search(&points, 2.0, 1000), &expected));
        }
        assert!(a + 1 >= seeds as usize, "version A: {a} of {seeds}");
        assert!(b + 2 >= seeds as usize, "version B: {b} of {seeds}");
    }

    #[test]
    fn every_quadruple_is_tried_once() {
        let (points, _) = with_gross_errors(1, 9);
        assert_eq!(by_quadruples(&points).unwrap().trials, 126);
        let all: Vec<_> = combinations(5, 3).collect();
        assert_eq!(all.len(), 10);
        assert!(all.is_sorted() && all.iter().all(|c| c.is_sorted() && c[2] < 5));
        assert_eq!((combinations(4, 4).count(), combinations(3, 4).count()), (1, 0));
    }

    #[test]
    fn a_search_in_vain_takes_the_published_number_of_trials() {
        for (count, trials) in [(5, 6), (6, 22), (8, 163), (10, 848), (12, 3797)] {
            let (points, _) = with_gross_errors(2, count);
            let consensus = by_search(&points, 0.0, usize::MAX).unwrap();
            assert_eq!((consensus.trials, consensus.complete), (trials, true), "{count} points");
        }
    }

    #[test]
    fn a_search_over_its_budget_hands_on_the_best_so_far() {
        let (points, _) = with_gross_errors(2, 12);
        let consensus = by_search(&points, 0.0, 50).unwrap();
        assert_eq!((consensus.trials, consensus.complete), (50, false));
        assert!(consensus.inliers.len() >= 10);
        assert!(by_search(&points, 0.0, 0).is_none());
    }

    #[test]
    fn points_without_gross_errors_take_one_trial() {
        let points = points(&mut Draws::new(3), &flight(), 20, SIGMA_PX);
        let consensus = by_search(&points, 2.0, 1000).unwrap();
        assert_eq!((consensus.trials, consensus.inliers.len(), consensus.complete), (1, 20, true));
    }

    #[test]
    fn a_prior_holds_what_the_points_leave_open() {
        // along a street: without a prior, the roll about it is nearly free
        let mut draws = Draws::new(5);
        let mut street: Vec<PointObservation> = points(&mut draws, &flight(), 6, SIGMA_PX);
        for (k, point) in street.iter_mut().enumerate() {
            let exact = Vector2::new(-2500.0 + 1000.0 * k as f64, 0.0);
            point.object_m = flight().ground_point_m(C, exact, 0.0).unwrap();
            point.image_px = exact + SIGMA_PX * Vector2::new(draws.normal(), draws.normal());
        }
        street[2].image_px.y += 60.0;
        let mut information = Matrix6::identity();
        information.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(0.01_f64.powi(-2));
        let prior = Prior { orientation: flight(), information };
        let all_are = |_: &Resection| true;
        let a = quadruples(&street, Some(&prior), &start(), C, &all_are, 10.0, &|| false).unwrap();
        let b = complete_search(&street, Some(&prior), &start(), C, 2.0, 1000).unwrap();
        assert_eq!((a.inliers, b.inliers), (vec![0, 1, 3, 4, 5], vec![0, 1, 3, 4, 5]));
        assert!(by_search(&street, 2.0, 1000).is_none());
    }

    #[test]
    fn what_cannot_be_oriented_gives_nothing() {
        let good = points(&mut Draws::new(4), &flight(), 8, SIGMA_PX);
        let line: Vec<_> = (0..8)
            .map(|k| PointObservation { object_m: Vector3::new(20.0 * f64::from(k), 10.0, 5.0), ..good[k as usize] })
            .collect();
        let behind: Vec<_> = good
            .iter()
            .map(|p| PointObservation { object_m: p.object_m + Vector3::new(0.0, 0.0, 900.0), ..*p })
            .collect();
        let not_numbers: Vec<_> =
            good.iter().map(|p| PointObservation { image_px: Vector2::repeat(f64::NAN), ..*p }).collect();
        for points in [&[][..], &good[..3], &[good[0]; 8], &line, &behind, &not_numbers] {
            assert!(by_quadruples(points).is_none());
            assert!(by_search(points, 2.0, 1000).is_none());
        }
        assert!(quadruples(&good, None, &start(), C, &|_| false, 10.0, &|| false).is_none());
        assert!(quadruples(&good, None, &start(), C, &|_| true, 10.0, &|| true).is_none());
    }

    #[test]
    fn points_without_use_do_not_spoil_the_others() {
        let mut mixed = points(&mut Draws::new(6), &flight(), 8, SIGMA_PX);
        mixed[0].object_m.z = 900.0;
        mixed[1].image_px.x = f64::NAN;
        assert_eq!(by_quadruples(&mixed).unwrap().inliers, [2, 3, 4, 5, 6, 7]);
        assert_eq!(by_search(&mixed, 2.0, 1000).unwrap().inliers, [2, 3, 4, 5, 6, 7]);
    }
}
