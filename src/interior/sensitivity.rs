//! How the transformation depends on every mark and on every pair of marks (method 1.9; Schickler and Poth, equations
//! 12 to 19): each is left out in turn.

use nalgebra::{DMatrix, DVector};

use super::transformation::{Observation, Transformation};
use crate::estimation::reliability::{critical_value, detectable};

/// What depends on a mark, or on a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensitivity {
    /// T: its squared discrepancy from what the others predict, in units of its covariance. Chi-square with two degrees
    /// of freedom for a mark, four for a pair.
    pub test: f64,
    /// Whether chance hardly explains that (0.1 %).
    pub contradicts: bool,
    /// mu: the relative loss of precision without it.
    pub loss: f64,
    /// delta: no function of the transformation changes by more than this many of its standard deviations without it.
    pub empirical: f64,
    /// delta_0: nor by an error of it that the test does not find.
    pub theoretical: f64,
}

/// That of the marks with these indices; `None` if the others do not determine the transformation.
#[must_use]
pub fn sensitivity(
    whole: &Transformation,
    mirrored: bool,
    observations: &[Observation],
    left_out: &[usize],
) -> Option<Sensitivity> {
    let others = observations.iter().enumerate().filter(|(k, _)| !left_out.contains(k)).map(|(_, o)| *o);
    let rest = Transformation::fit(whole.kind, mirrored, &others.collect::<Vec<_>>())?;
    let freedom = 2 * left_out.len();
    let test = discrepancy(&rest, observations, left_out)?;
    let loss = whole.loss_without(&rest)?;
    Some(Sensitivity {
        test,
        contradicts: test > critical_value(freedom),
        loss,
        empirical: (test * loss).sqrt(),
        theoretical: detectable(freedom) * loss.sqrt(),
    })
}

/// The squared distance of the marks from where the rest predicts them, in units of the covariance of that.
fn discrepancy(rest: &Transformation, observations: &[Observation], left_out: &[usize]) -> Option<f64> {
    let places: Vec<_> = left_out.iter().map(|k| observations[*k].plate_mm).collect();
    let mut covariance = rest.joint_covariance_px2(&places);
    let mut away = DVector::zeros(2 * left_out.len());
    for (row, k) in left_out.iter().enumerate() {
        let own = observations[*k].covariance_px2;
        let mut block = covariance.fixed_view_mut::<2, 2>(2 * row, 2 * row);
        block += own;
        away.fixed_rows_mut::<2>(2 * row).copy_from(&rest.residual_px(&observations[*k]));
    }
    Some(away.dot(&covariance.cholesky()?.solve(&away)))
}

/// All pairs of `count` marks.
pub fn pairs(count: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..count).flat_map(move |a| (a + 1..count).map(move |b| [a, b]))
}

impl Transformation {
    /// Covariance of several points' pixels together, of the transformation alone.
    fn joint_covariance_px2(&self, places: &[nalgebra::Vector2<f64>]) -> DMatrix<f64> {
        let designs: Vec<_> = places.iter().map(|place| self.design_at(*place)).collect();
        let mut stacked = DMatrix::zeros(2 * places.len(), self.kind.parameters());
        for (k, design) in designs.iter().enumerate() {
            stacked.rows_mut(2 * k, 2).copy_from(design);
        }
        &stacked * self.covariance() * stacked.transpose()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector2};

    use super::*;
    use crate::estimation::simulated::Draws;
    use crate::interior::transformation::Kind;

    const CORNERS: [(f64, f64); 4] = [(-106.0, -106.0), (106.0, 106.0), (-106.0, 106.0), (106.0, -106.0)];
    const MIDS: [(f64, f64); 4] = [(-113.0, 0.0), (113.0, 0.0), (0.0, 113.0), (0.0, -113.0)];

    fn observed(places: &[(f64, f64)], mut error: impl FnMut() -> f64) -> Vec<Observation> {
        let observe = |(x, y): &(f64, f64)| Observation {
            plate_mm: Vector2::new(*x, *y),
            image_px: Vector2::new(50.0 * x, -50.0 * y) + Vector2::new(error(), error()),
            covariance_px2: Matrix2::identity(),
        };
        places.iter().map(observe).collect()
    }

    fn losses(kind: Kind, places: &[(f64, f64)]) -> Vec<f64> {
        let observations = observed(places, || 0.0);
        let whole = Transformation::fit(kind, false, &observations).unwrap();
        (0..places.len()).map(|k| sensitivity(&whole, false, &observations, &[k]).unwrap().loss).collect()
    }

    #[test]
    fn losses_of_precision_are_those_of_the_table() {
        for four in [CORNERS, MIDS] {
            assert!(losses(Kind::Similarity, &four).iter().all(|mu| (mu - 1.0).abs() < 0.005));
            assert!(losses(Kind::Affine, &four).iter().all(|mu| (mu - 3.0).abs() < 0.005));
        }
        let eight = [CORNERS, MIDS].concat();
        for (kind, [corner, mid]) in [(Kind::Similarity, [0.40, 0.27]), (Kind::Affine, [0.80, 0.44])] {
            let mu = losses(kind, &eight);
            assert!((mu[0] - corner).abs() < 0.005 && (mu[4] - mid).abs() < 0.005, "{kind:?} {mu:?}");
        }
    }

    #[test]
    fn a_pair_of_four_leaves_the_affine_undetermined_and_the_similarity_not() {
        let observations = observed(&CORNERS, || 0.0);
        let of = |kind| {
            let whole = Transformation::fit(kind, false, &observations).unwrap();
            sensitivity(&whole, false, &observations, &[0, 1])
        };
        assert_eq!(of(Kind::Affine), None);
        assert!(of(Kind::Similarity).unwrap().loss.is_finite());
    }

    #[test]
    fn tests_follow_chi_square_and_nothing_changes_by_more_than_the_bound() {
        let mut draws = Draws::new(11);
        let eight = [CORNERS, MIDS].concat();
        let (mut mark, mut pair, mut largest) = (0.0, 0.0, 0.0_f64);
        let runs = 500;
        for _ in 0..runs {
            let observations = observed(&eight, || draws.normal());
            let whole = Transformation::fit(Kind::Affine, false, &observations).unwrap();
            let one = sensitivity(&whole, false, &observations, &[2]).unwrap();
            mark += one.test / f64::from(runs);
            pair += sensitivity(&whole, false, &observations, &[0, 5]).unwrap().test / f64::from(runs);
            let rest: Vec<_> = (0..8).filter(|k| *k != 2).map(|k| observations[k]).collect();
            let rest = Transformation::fit(Kind::Affine, false, &rest).unwrap();
            for place in [Vector2::new(-115.0, 115.0), Vector2::new(20.0, -60.0)] {
                let change = rest.pixel_from_plate(place).x - whole.pixel_from_plate(place).x;
                let sigma = whole.covariance_px2(place)[(0, 0)].sqrt();
                largest = largest.max(change.abs() / (one.empirical * sigma));
            }
        }
        assert!((mark - 2.0).abs() < 0.3 && (pair - 4.0).abs() < 0.5, "{mark} {pair}");
        assert!((0.5..1.0).contains(&largest), "{largest}");
    }
}
