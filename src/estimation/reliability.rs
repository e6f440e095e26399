//! Sensitivity of an estimate to groups of its observations (Baarda 1967, 1968; Förstner 1983; Schickler and Poth 1996,
//! equations 12 to 15; method 1.9).
//!
//! A group is what may be wrong together and then is displaced: a control point in both image coordinates, or several.
//! Its displacement is an unknown that is not estimated, but tested: how far is the group from where all others expect
//! it (*discrepancy*), is that more than chance (*test*), how would the parameters change without it (*step*), and how
//! far can an error that the test does not show take them (*theoretical* sensitivity)?

use nalgebra::{DMatrix, DVector, Matrix2, Matrix6, SymmetricEigen, Vector6};

/// Significance of the tests, 0.1 %: critical values of chi-square for 1 to 4 degrees of freedom.
const CRITICAL: [f64; 4] = [10.83, 13.82, 16.27, 18.47];
/// Non-centrality (as a root) of an error that these tests find with a power of 80 %, `delta_0`.
const DETECTABLE: [f64; 4] = [4.13, 4.43, 4.64, 4.81];

/// What chance exceeds in one of a thousand cases: the critical value of chi-square for 1 to 4 degrees of freedom.
#[must_use]
pub fn critical_value(freedom: usize) -> f64 {
    CRITICAL[freedom.clamp(1, 4) - 1]
}

/// `delta_0` for 1 to 4 degrees of freedom: the non-centrality (as a root) of an error that the test finds in four of
/// five cases.
#[must_use]
pub fn detectable(freedom: usize) -> f64 {
    DETECTABLE[freedom.clamp(1, 4) - 1]
}

/// Directions in which a member of a group is ten times less exactly observed than in its best one, or more, are not
/// tested: it says nothing there, as a house of which two parallel edges were found does along them.
const LEAST_OBSERVED: f64 = 1e-2;
/// A group is checked by nothing if in some direction only this part of its information is redundant.
const LEAST_REDUNDANT: f64 = 1e-9;
const MOST_ITERATIONS: usize = 200;

/// The normal equations at the estimate, seen by the displacements of all groups: two of each, x and y.
#[derive(Debug, Clone, PartialEq)]
pub struct Reliability {
    /// Covariance of the parameters.
    pub covariance: Matrix6<f64>,
    /// Normal matrix of the displacements after all other unknowns have been eliminated.
    pub weights: DMatrix<f64>,
    /// Its right-hand side.
    pub right_side: DVector<f64>,
    /// What displacements do to the parameters: their step is `-influence * weights^-1 * right_side`, each group alone.
    pub influence: DMatrix<f64>,
    /// The information on the displacement of each group if all other unknowns were known.
    pub own: Vec<Matrix2<f64>>,
    /// How much smaller the variances of the discrepancies of a group are for its test than for the estimate, in which
    /// a group that does not fit has been given less weight.
    pub excess: Vec<f64>,
}

/// How an estimate depends on one group.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivity {
    /// How far the group is from where all others expect it: x and y of each of its members.
    pub discrepancy: DVector<f64>,
    /// The same in the directions that are observed, and its covariance there.
    seen: DVector<f64>,
    variances: DMatrix<f64>,
    /// The squared discrepancy in units of its covariance: chi-square with a degree of freedom for each direction that is
    /// observed, at most two a member.
    pub test: f64,
    /// The same with the weights of the estimate, T.
    pub weighted_test: f64,
    /// The step of the parameters if the group were left out.
    pub step: Vector6<f64>,
    /// The covariance that would be added to that of the parameters.
    pub added_covariance: Matrix6<f64>,
}

impl Sensitivity {
    /// Whether chance hardly explains its discrepancy (0.1 %).
    #[must_use]
    pub fn contradicts(&self) -> bool {
        self.test > critical_value(self.seen.len())
    }

    /// `delta_0`: non-centrality (as a root) of an error of the group that the test finds in four of five cases only.
    #[must_use]
    pub fn detectable(&self) -> f64 {
        detectable(self.seen.len())
    }

    /// Logarithm of the likelihood of the discrepancy if the group was displaced with a standard deviation in each
    /// coordinate, against that if it was not.
    #[must_use]
    pub fn log_ratio_of_displacement(&self, sigma: f64) -> f64 {
        let displaced = &self.variances + DMatrix::identity(self.seen.len(), self.seen.len()) * sigma.powi(2);
        let log_likelihood = |variances: DMatrix<f64>| {
            let factor = variances.cholesky()?;
            let log_root = factor.l_dirty().diagonal().map(f64::ln).sum();
            Some(-log_root - self.seen.dot(&factor.solve(&self.seen)) / 2.0)
        };
        let ratio = log_likelihood(displaced).zip(log_likelihood(self.variances.clone())).map(|(a, b)| a - b);
        ratio.unwrap_or(f64::INFINITY)
    }
}

impl Reliability {
    /// The number of groups.
    #[must_use]
    pub fn count(&self) -> usize {
        self.right_side.len() / 2
    }

    /// Whether groups take part in the estimate at all.
    #[must_use]
    pub fn informs(&self, groups: &[usize]) -> bool {
        groups.iter().any(|group| self.own[*group].trace() > 0.0)
    }

    /// The sensitivity to one group, or to two together. `None` if the others do not predict them in all directions in
    /// which they are observed, so that nothing checks them, or if they do not take part.
    #[must_use]
    pub fn of(&self, groups: &[usize]) -> Option<Sensitivity> {
        let places: Vec<usize> = groups.iter().flat_map(|group| [2 * group, 2 * group + 1]).collect();
        let weights = self.weights.select_rows(&places).select_columns(&places);
        let right_side = self.right_side.select_rows(&places);
        let influence = self.influence.select_columns(&places);
        let own = groups.iter().map(|group| self.own[*group].trace()).fold(0.0, f64::max);
        let basis = self.observed(groups)?;
        let covariance = inverse(&basis.tr_mul(&(weights * &basis)), LEAST_REDUNDANT * own)?;
        let seen = &covariance * basis.tr_mul(&right_side);
        let discrepancy = &basis * &seen;
        let excess = DMatrix::from_diagonal(&DVector::from_fn(places.len(), |place, _| self.excess[groups[place / 2]]));
        let variances = &covariance - basis.tr_mul(&(excess * &basis));
        let test = seen.dot(&variances.clone().cholesky()?.solve(&seen));
        let step = -(&influence * &discrepancy);
        let influence = influence * basis;
        let added = &influence * covariance * influence.transpose();
        let sensitivity = Sensitivity {
            test,
            weighted_test: right_side.dot(&discrepancy),
            step: Vector6::from_iterator(step.iter().copied()),
            added_covariance: Matrix6::from_iterator(added.iter().copied()),
            seen,
            variances,
            discrepancy,
        };
        let finite = sensitivity.test.is_finite() && sensitivity.added_covariance.iter().all(|v| v.is_finite());
        finite.then_some(sensitivity)
    }

    /// The directions in which the members of a group are observed, as columns; `None` if there is none.
    fn observed(&self, groups: &[usize]) -> Option<DMatrix<f64>> {
        let mut columns = Vec::new();
        for (member, group) in groups.iter().enumerate() {
            // no iteration ends on what is not a number
            let own = Some(self.own[*group]).filter(|own| own.iter().all(|value| value.is_finite()))?;
            let eigen = SymmetricEigen::try_new(own, f64::EPSILON, MOST_ITERATIONS)?;
            let least = eigen.eigenvalues.max() * LEAST_OBSERVED;
            let observed = (0..2).filter(|k| least > 0.0 && eigen.eigenvalues[*k] > least);
            columns.extend(observed.map(|k| {
                let mut column = DVector::zeros(2 * groups.len());
                column.fixed_rows_mut::<2>(2 * member).copy_from(&eigen.eigenvectors.column(k));
                column
            }));
        }
        (!columns.is_empty()).then(|| DMatrix::from_columns(&columns))
    }
}

/// The inverse of a symmetric matrix; `None` unless all its eigenvalues exceed `negligible`.
fn inverse(weights: &DMatrix<f64>, negligible: f64) -> Option<DMatrix<f64>> {
    if !weights.iter().all(|value| value.is_finite()) {
        return None;
    }
    let eigen = SymmetricEigen::try_new((weights + weights.transpose()) / 2.0, f64::EPSILON, MOST_ITERATIONS)?;
    let variances = eigen.eigenvalues.map(|value| 1.0 / value);
    let checked = eigen.eigenvalues.iter().all(|value| *value > negligible);
    checked.then(|| &eigen.eigenvectors * DMatrix::from_diagonal(&variances) * eigen.eigenvectors.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::{Draws, Linear, observed};
    use approx::assert_relative_eq;

    /// Probability that chi-square exceeds twice `half`.
    fn central(half: f64, freedom: u32) -> f64 {
        // Q(a + 1, x) = Q(a, x) + x^a exp(-x) / Gamma(a + 1), from Q(1/2, x) = erfc(sqrt x) or Q(1, x) = exp(-x)
        let odd = freedom % 2 == 1;
        let (mut a, mut sum) = if odd { (0.5, libm::erfc(half.sqrt())) } else { (1.0, (-half).exp()) };
        while a < f64::from(freedom) / 2.0 - 0.25 {
            sum += (a * half.ln() - half - libm::lgamma(a + 1.0)).exp();
            a += 1.0;
        }
        sum
    }

    /// The same for a non-central one: a mixture of central ones by Poisson's distribution.
    fn exceeds(value: f64, freedom: u32, non_centrality: f64) -> f64 {
        let mut weight = (-non_centrality / 2.0).exp();
        let mut total = 0.0;
        for j in 0..150 {
            total += weight * central(value / 2.0, freedom + 2 * j);
            weight *= non_centrality / 2.0 / f64::from(j + 1);
        }
        total
    }

    #[test]
    fn critical_values_and_detectable_errors_are_those_of_chi_square() {
        for (k, freedom) in (1..=4).enumerate() {
            assert!((exceeds(CRITICAL[k], freedom, 0.0) - 0.001).abs() < 3e-6);
            assert!((exceeds(CRITICAL[k], freedom, DETECTABLE[k].powi(2)) - 0.8).abs() < 2e-3);
        }
    }

    #[test]
    fn leaving_groups_out_is_what_it_says() {
        let mut draws = Draws::new(31);
        for groups in [&[2][..], &[0, 5]] {
            let linear = Linear::new(&mut draws, 8);
            let observed = observed(&mut draws, 8);
            let sensitivity = linear.reliability(&observed).of(groups).unwrap();
            let without = linear.estimate(&observed, groups);
            assert_relative_eq!(sensitivity.step, without - linear.estimate(&observed, &[]), epsilon = 1e-9);
            let covariance = linear.normal(groups).try_inverse().unwrap();
            let before = linear.normal(&[]).try_inverse().unwrap();
            assert_relative_eq!(sensitivity.added_covariance, covariance - before, epsilon = 1e-9);
            // the discrepancy is from where the others expect it
            for (k, group) in groups.iter().enumerate() {
                let expected = linear.designs[*group] * without;
                assert_relative_eq!(sensitivity.discrepancy[2 * k], observed[*group].x - expected.x, epsilon = 1e-9);
            }
            assert_relative_eq!(sensitivity.test, sensitivity.weighted_test, max_relative = 1e-9);
        }
    }

    /// Two neighbours that are predicted well against each other, and hardly at all together.
    #[test]
    fn a_pair_that_carries_the_result_together_is_not_overlooked() {
        let mut draws = Draws::new(36);
        let mut linear = Linear::new(&mut draws, 8);
        let pair = [2, 3];
        linear.designs[3] = linear.designs[2].map(|value| value * 1.02);
        for (group, design) in linear.designs.iter_mut().enumerate() {
            if !pair.contains(&group) {
                design.column_mut(4).scale_mut(0.004);
            }
        }
        let observed = observed(&mut draws, 8);
        let sensitivity = linear.reliability(&observed).of(&pair).unwrap();
        let before = linear.normal(&[]).try_inverse().unwrap();
        let added = linear.normal(&pair).try_inverse().unwrap() - before;
        assert!(added[(4, 4)] > 1e3 * before[(4, 4)]);
        assert_relative_eq!(sensitivity.added_covariance, added, max_relative = 1e-6, epsilon = 1e-6);
        let step = linear.estimate(&observed, &pair) - linear.estimate(&observed, &[]);
        assert_relative_eq!(sensitivity.step, step, max_relative = 1e-6, epsilon = 1e-6);
        // each alone is checked by the other
        let alone = linear.reliability(&observed).of(&[2]).unwrap();
        assert!(alone.added_covariance[(4, 4)] < 10.0 * before[(4, 4)]);
    }

    /// As a house is of which two parallel edges were found.
    #[test]
    fn across_what_was_observed_nothing_is_tested() {
        let mut draws = Draws::new(37);
        let linear = Linear::new(&mut draws, 8);
        let mut reliability = linear.reliability(&observed(&mut draws, 8));
        reliability.own[5] = Matrix2::new(1.0, 0.0, 0.0, 1e-4);
        let sensitivity = reliability.of(&[5]).unwrap();
        let expected = reliability.right_side[10] / reliability.weights[(10, 10)];
        assert_relative_eq!(sensitivity.discrepancy, DVector::from_vec(vec![expected, 0.0]), epsilon = 1e-12);
        assert_eq!(sensitivity.detectable(), DETECTABLE[0]);
        reliability.own[5] = Matrix2::zeros();
        assert!(reliability.of(&[5]).is_none() && !reliability.informs(&[5]) && reliability.informs(&[5, 6]));
        assert_eq!(reliability.of(&[5, 6]).unwrap().test, reliability.of(&[6]).unwrap().test);
    }

    #[test]
    fn tests_are_chi_square_and_find_what_they_claim() {
        let mut draws = Draws::new(32);
        let linear = Linear::new(&mut draws, 7);
        let runs = 4000;
        let (mut sum, mut found) = (0.0, 0);
        for _ in 0..runs {
            let mut observed = observed(&mut draws, 7);
            sum += linear.reliability(&observed).of(&[3]).unwrap().test;
            // an error in x that is just detectable: its non-centrality is that of the displacement's weight
            let size = DETECTABLE[1] / linear.reliability(&observed).weights[(6, 6)].sqrt();
            observed[3].x += size;
            found += usize::from(linear.reliability(&observed).of(&[3]).unwrap().contradicts());
        }
        let (mean, power) = (sum / f64::from(runs), found as f64 / f64::from(runs));
        assert!((mean - 2.0).abs() < 0.13, "{mean}");
        assert!((power - 0.8).abs() < 0.03, "{power}");
    }

    #[test]
    fn a_displacement_is_told_by_its_likelihood() {
        let mut draws = Draws::new(35);
        let linear = Linear::new(&mut draws, 9);
        let mut observed = observed(&mut draws, 9);
        let ratio = |observed: &[_]| linear.reliability(observed).of(&[4]).unwrap().log_ratio_of_displacement(6.0);
        let before = ratio(&observed);
        // one in 37 of the plane for a discrepancy of nothing, and of one standard deviation some more
        assert!(before < -1.0, "{before}");
        observed[4].y += 12.0;
        assert!(ratio(&observed) > 10.0, "{}", ratio(&observed));
    }

    #[test]
    fn what_nothing_checks_has_no_test() {
        let mut draws = Draws::new(33);
        let linear = Linear::new(&mut draws, 3);
        let observed = observed(&mut draws, 3);
        let reliability = linear.reliability(&observed);
        assert!(reliability.of(&[0]).is_none());
        assert!(reliability.of(&[0, 1]).is_none());
        let broken = Reliability { weights: DMatrix::from_element(6, 6, f64::NAN), ..reliability };
        assert!(broken.of(&[1]).is_none());
    }

    #[test]
    fn less_weight_in_the_estimate_does_not_hide_a_discrepancy() {
        let mut draws = Draws::new(34);
        let linear = Linear::new(&mut draws, 8);
        let mut reliability = linear.reliability(&observed(&mut draws, 8));
        let before = reliability.of(&[1]).unwrap();
        reliability.excess[1] = 0.5;
        let after = reliability.of(&[1]).unwrap();
        assert!(after.test > before.test);
        assert_eq!((after.step, after.weighted_test), (before.step, before.weighted_test));
    }
}
