//! The shifts of whole buildings, and what is known of them beforehand.
//!
//! What all edges of a building have in common, an error of its model or a gutter that was taken for the rim of the
//! roof, is an unknown shift of the building in the image. Measured under the reference orientations of
//! `../shared/bench`, these shifts have a variance of 1.1 px² in each coordinate beside the stated accuracy of the
//! coordinates, of which neighbours share 0.8, 0.4, 0.3, 0.0 px² at distances up to 0.1, 0.2, 0.4 and beyond 0.4
//! principal distances (405 pairs of 203 buildings): strain of the block that the control was measured in, or of the
//! image. Beside most that are small a few are large (their mean square is twice the median one, 1.4 times if they
//! were normal).

use nalgebra::{DMatrix, DVector, Matrix2, Matrix2x6, Matrix6, Matrix6x2, Vector2, Vector6};

use crate::estimation::NormalEquations;

/// Standard deviation of the part of a shift that is a building's own.
const SIGMA_OWN_PX: f64 = 0.7;
/// Standard deviation of the part that it shares with its neighbours.
const SIGMA_SHARED_PX: f64 = 0.8;
/// That much of the stated variance of a control point's coordinates moves it as a whole.
pub(super) const SHARE_OF_THE_BUILDING: f64 = 0.5;
/// The distance, in principal distances, over which the shared part falls to 1/e.
const REACH: f64 = 0.22;
/// Degrees of freedom of Student's distribution for a building's own part.
const FREEDOM: f64 = 4.0;

/// Standard deviation of the shift that all edges of a building share, beside that of its coordinates.
#[must_use]
pub fn sigma_shift_px() -> f64 {
    SIGMA_OWN_PX.hypot(SIGMA_SHARED_PX)
}

/// The observations of a building, linearised: six parameters and its shift.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct BuildingEquations {
    pub(super) matrix: Matrix6<f64>,
    pub(super) right_side: Vector6<f64>,
    pub(super) coupling: Matrix6x2<f64>,
    pub(super) shift_matrix: Matrix2<f64>,
    pub(super) shift_right_side: Vector2<f64>,
}

impl BuildingEquations {
    /// Adds two observations that the parameters and the shift explain.
    pub(super) fn add(
        &mut self,
        by_parameters: &Matrix2x6<f64>,
        by_shift: &Matrix2<f64>,
        misclosure: &Vector2<f64>,
        weight: &Matrix2<f64>,
    ) {
        let weighted = by_parameters.transpose() * weight;
        self.matrix += weighted * by_parameters;
        self.right_side += weighted * misclosure;
        self.coupling += weighted * by_shift;
        let weighted = by_shift.transpose() * weight;
        self.shift_matrix += weighted * by_shift;
        self.shift_right_side += weighted * misclosure;
    }
}

/// The prior of the shifts of all buildings of an adjustment: the same in both coordinates, correlated between
/// neighbours.
pub(super) struct ShiftPrior {
    /// Covariance of the shared parts.
    shared: DMatrix<f64>,
    /// Variances of the buildings' own parts.
    own: Vec<f64>,
}

/// The normal equations without the shifts; these are then `shifts - by_parameters * step`.
pub(super) struct Reduced {
    pub(super) equations: NormalEquations,
    shifts: DVector<f64>,
    by_parameters: DMatrix<f64>,
}

impl Reduced {
    /// The steps of the shifts that belong to a step of the parameters, building after building.
    pub(super) fn shift_steps(&self, step: &Vector6<f64>) -> Vec<Vector2<f64>> {
        let steps = &self.shifts - &self.by_parameters * step;
        steps.as_slice().chunks_exact(2).map(|step| Vector2::new(step[0], step[1])).collect()
    }
}

impl ShiftPrior {
    /// For buildings and scenes at places given in principal distances, with the variances that their stated accuracy
    /// gives them as a whole, px². `of_camera` is the covariance of the errors that the interior orientation makes at two places: they shift all that
    /// is there, and so neighbours alike.
    pub(super) fn new(
        places: &[Vector2<f64>],
        stated_px2: &[f64],
        of_camera: impl Fn(Vector2<f64>, Vector2<f64>) -> f64,
    ) -> Self {
        let count = places.len();
        let shared = DMatrix::from_fn(count, count, |i, j| {
            SIGMA_SHARED_PX.powi(2) * (-(places[i] - places[j]).norm() / REACH).exp() + of_camera(places[i], places[j])
        });
        let own = stated_px2.iter().map(|stated| SIGMA_OWN_PX.powi(2) + stated).collect();
        Self { shared, own }
    }

    /// The covariance of one coordinate, with what is to be added to the variance of each building's own part.
    pub(super) fn covariance(&self, excess: &[f64]) -> DMatrix<f64> {
        let mut covariance = self.shared.clone();
        for (k, (own, excess)) in self.own.iter().zip(excess).enumerate() {
            covariance[(k, k)] += own + excess;
        }
        covariance
    }

    /// Its inverse.
    pub(super) fn information(&self, excess: &[f64]) -> Option<DMatrix<f64>> {
        Some(self.covariance(excess).cholesky()?.inverse())
    }

    /// What is added to the variance of a building whose present shift is larger than usual: it loses weight as Student's
    /// distribution has it; none gains.
    pub(super) fn excess(&self, shifts_px: &[Vector2<f64>]) -> Vec<f64> {
        let of_one = |(k, (own, shift_px)): (usize, (&f64, &Vector2<f64>))| {
            let usual = own + self.shared[(k, k)];
            let inflation = (FREEDOM + shift_px.norm_squared() / usual) / (FREEDOM + 2.0);
            own * (inflation - 1.0).max(0.0)
        };
        self.own.iter().zip(shifts_px).enumerate().map(of_one).collect()
    }
}

/// Eliminates the shifts from the equations of all buildings.
pub(super) fn eliminated(
    buildings: &[BuildingEquations],
    information: &DMatrix<f64>,
    shifts_px: &[Vector2<f64>],
) -> Option<Reduced> {
    let count = buildings.len();
    let mut matrix = information.kronecker(&DMatrix::identity(2, 2));
    let present = DVector::from_iterator(2 * count, shifts_px.iter().flat_map(|shift| [shift.x, shift.y]));
    let mut right_side = &matrix * -present;
    let mut coupling = DMatrix::zeros(2 * count, 6);
    let mut equations = NormalEquations::new();
    for (k, own) in buildings.iter().enumerate() {
        let mut block = matrix.fixed_view_mut::<2, 2>(2 * k, 2 * k);
        block += own.shift_matrix;
        let mut side = right_side.fixed_rows_mut::<2>(2 * k);
        side += own.shift_right_side;
        coupling.fixed_view_mut::<2, 6>(2 * k, 0).copy_from(&own.coupling.transpose());
        equations.matrix += own.matrix;
        equations.right_side += own.right_side;
    }
    let factor = matrix.cholesky()?;
    let (shifts, by_parameters) = (factor.solve(&right_side), factor.solve(&coupling));
    equations.matrix -= coupling.tr_mul(&by_parameters);
    equations.right_side -= coupling.tr_mul(&shifts);
    Some(Reduced { equations, shifts, by_parameters })
}

/// The weighted sum of squares of the shifts.
pub(super) fn squares(information: &DMatrix<f64>, shifts_px: &[Vector2<f64>]) -> f64 {
    let of = |coordinate: usize| {
        let shifts = DVector::from_iterator(shifts_px.len(), shifts_px.iter().map(|shift| shift[coordinate]));
        shifts.dot(&(information * &shifts))
    };
    of(0) + of(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    fn places() -> Vec<Vector2<f64>> {
        [[0.0, 0.0], [0.01, 0.0], [0.6, 0.1], [0.2, -0.5]].map(Vector2::from).to_vec()
    }

    /// Equations of four buildings with two observations each for every parameter and shift.
    fn buildings(draws: &mut Draws) -> Vec<BuildingEquations> {
        let mut one = || {
            let mut equations = BuildingEquations::default();
            for _ in 0..6 {
                let by_parameters = Matrix2x6::from_fn(|_, _| draws.normal());
                let by_shift = Matrix2::from_fn(|_, _| draws.normal());
                let misclosure = Vector2::new(draws.normal(), draws.normal());
                equations.add(&by_parameters, &by_shift, &misclosure, &(Matrix2::identity() * 4.0));
            }
            equations
        };
        (0..4).map(|_| one()).collect()
    }

    #[test]
    fn eliminating_the_shifts_solves_the_whole_system() {
        let mut draws = Draws::new(11);
        let buildings = buildings(&mut draws);
        let shifts_px: Vec<_> = (0..4).map(|_| Vector2::new(draws.normal(), draws.normal())).collect();
        let prior = ShiftPrior::new(&places(), &[0.3, 0.5, 0.2, 1.0], |_, _| 0.0);
        let information = prior.information(&prior.excess(&shifts_px)).unwrap();
        // all unknowns at once: the six parameters, then x and y of the shift of each building
        let mut matrix = DMatrix::zeros(14, 14);
        let mut side = DVector::zeros(14);
        for (k, own) in buildings.iter().enumerate() {
            let at = 6 + 2 * k;
            let mut parameters = matrix.view_mut((0, 0), (6, 6));
            parameters += own.matrix;
            let mut shift = matrix.view_mut((at, at), (2, 2));
            shift += own.shift_matrix;
            matrix.view_mut((0, at), (6, 2)).copy_from(&own.coupling);
            matrix.view_mut((at, 0), (2, 6)).copy_from(&own.coupling.transpose());
            for row in 0..6 {
                side[row] += own.right_side[row];
            }
            for axis in 0..2 {
                side[at + axis] += own.shift_right_side[axis];
                for (other, shift_px) in shifts_px.iter().enumerate() {
                    matrix[(at + axis, 6 + 2 * other + axis)] += information[(k, other)];
                    side[at + axis] -= information[(k, other)] * shift_px[axis];
                }
            }
        }
        let whole = matrix.clone().lu().solve(&side).unwrap();
        let reduced = eliminated(&buildings, &information, &shifts_px).unwrap();
        let step = reduced.equations.solve().unwrap();
        assert!((whole.rows(0, 6) - step).norm() < 1e-9);
        for (k, shift_step) in reduced.shift_steps(&step).iter().enumerate() {
            assert!((whole.rows(6 + 2 * k, 2) - shift_step).norm() < 1e-9);
        }
        let covariance = matrix.try_inverse().unwrap().view((0, 0), (6, 6)).into_owned();
        assert!((covariance - reduced.equations.inverse().unwrap()).norm() < 1e-9);
    }

    #[test]
    fn neighbours_are_alike_and_what_is_far_away_is_not() {
        let covariance = ShiftPrior::new(&places(), &[0.0; 4], |_, _| 0.0).covariance(&[0.0; 4]);
        let correlation = |i: usize, j: usize| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
        assert!((covariance[(0, 0)].sqrt() - sigma_shift_px()).abs() < 1e-12);
        assert!(correlation(0, 1) > 0.5 && correlation(0, 2) < 0.05);
    }

    #[test]
    fn a_large_shift_costs_weight_and_a_small_one_gains_none() {
        let prior = ShiftPrior::new(&places()[..1], &[0.5], |_, _| 0.0);
        let variance = |shift_px: f64| prior.covariance(&prior.excess(&[Vector2::new(shift_px, 0.0)]))[(0, 0)];
        assert!((variance(0.0) - variance(1.0)).abs() < 1e-12);
        assert!(variance(8.0) > 4.0 * variance(0.0));
        // what a shift is pulled back with falls beyond some distance
        assert!(8.0 / variance(8.0) < 4.0 / variance(4.0));
    }

    #[test]
    fn the_sum_of_squares_is_that_of_independent_standardised_shifts() {
        let far: Vec<_> = (0..3).map(|k| Vector2::new(100.0 * f64::from(k), 0.0)).collect();
        let shifts_px = [[0.4, -0.1], [0.2, 0.9], [-0.5, 0.3]].map(Vector2::from);
        let prior = ShiftPrior::new(&far, &[0.0; 3], |_, _| 0.0);
        let information = prior.information(&prior.excess(&shifts_px)).unwrap();
        let expected = shifts_px.iter().map(Vector2::norm_squared).sum::<f64>() / sigma_shift_px().powi(2);
        assert!((squares(&information, &shifts_px) - expected).abs() < 1e-9);
    }
}
