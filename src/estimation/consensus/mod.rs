//! Which of the located control points are right? Version A of Förstner and Läbe (section 2.2, step 2), and the largest
//! consistent set, which is what their version B looks for.

mod eight;
mod exact;
mod lanes;
mod quadruples;
mod whitened;

use super::PointObservation;
use super::resection::Resection;

pub use exact::largest_consistent;
pub use quadruples::quadruples;

/// The orientation that the points agree upon.
#[derive(Debug, Clone, PartialEq)]
pub struct Consensus {
    /// The resection with the inliers.
    pub resection: Resection,
    /// Indices of the points that are right, ascending.
    pub inliers: Vec<usize>,
    /// What is known of the sets that are not the answer.
    pub guarantee: Guarantee,
    /// Subsets of the points that were examined.
    pub subsets: usize,
}

/// How far a search has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Guarantee {
    /// To its end: there is no better answer.
    Complete,
    /// To the end of its budget: an answer has `at_most` so many points.
    Bounded {
        /// Upper bound of the number of points that agree.
        at_most: usize,
    },
    /// Some subsets have been looked at, and nothing is known of the others.
    Sampled,
}

impl Guarantee {
    /// Its name in answers: `complete`, `bounded` or `sampled`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Complete => "complete",
            Self::Bounded { .. } => "bounded",
            Self::Sampled => "sampled",
        }
    }
}

/// Fewer points than this do not check each other.
const LEAST_POINTS: usize = 4;

fn select(points: &[PointObservation], chosen: &[usize]) -> Vec<PointObservation> {
    chosen.iter().map(|&index| points[index]).collect()
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
