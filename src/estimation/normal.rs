//! Normal equations of the six parameters of an exterior orientation, and prior knowledge as an observation of them.
//!
//! The parameters are the step `[dX0, theta]` of [`ExteriorOrientation::moved`], in metres and radians.

use nalgebra::{Matrix2, Matrix2x6, Matrix6, Vector2, Vector6};

use crate::geometry::ExteriorOrientation;

/// Parameters whose scaled variance exceeds this are not determined.
const LARGEST_INVERSE: f64 = 1e11;

/// `N dx = n` with the weighted sum of squares at `dx = 0`.
#[derive(Debug, Clone, PartialEq)]
pub struct NormalEquations {
    /// The matrix N.
    pub matrix: Matrix6<f64>,
    /// The right-hand side n.
    pub right_side: Vector6<f64>,
    /// `l' W l`.
    pub squares: f64,
}

impl NormalEquations {
    /// No observation yet.
    #[must_use]
    pub fn new() -> Self {
        Self { matrix: Matrix6::zeros(), right_side: Vector6::zeros(), squares: 0.0 }
    }

    /// Adds two observation equations `jacobian * dx = misclosure` with their weight matrix.
    pub fn add(&mut self, jacobian: &Matrix2x6<f64>, misclosure: &Vector2<f64>, weight: &Matrix2<f64>) {
        let (weighted, weighted_misclosure) = (weight * jacobian, weight * misclosure);
        // written out: the library's product of small matrices takes several times as long
        for column in 0..6 {
            let [a, b] = [weighted[(0, column)], weighted[(1, column)]];
            for row in 0..6 {
                self.matrix[(row, column)] += jacobian[(0, row)] * a + jacobian[(1, row)] * b;
            }
            self.right_side[column] +=
                jacobian[(0, column)] * weighted_misclosure.x + jacobian[(1, column)] * weighted_misclosure.y;
        }
        self.squares += misclosure.dot(&weighted_misclosure);
    }

    /// Adds prior knowledge of all six parameters.
    pub fn add_prior(&mut self, prior: &Prior, at: &ExteriorOrientation) {
        let misclosure = at.step_to(&prior.orientation);
        self.matrix += prior.information;
        self.right_side += prior.information * misclosure;
        self.squares += misclosure.dot(&(prior.information * misclosure));
    }

    /// The step, or `None` where the parameters are not determined.
    #[must_use]
    pub fn solve(&self) -> Option<Vector6<f64>> {
        let scale = self.scale()?;
        let factor = self.scaled(&scale).cholesky()?;
        let step = factor.solve(&self.right_side.component_mul(&scale)).component_mul(&scale);
        step.iter().all(|v| v.is_finite()).then_some(step)
    }

    /// The inverse of N, or `None` where the parameters are not determined.
    #[must_use]
    pub fn inverse(&self) -> Option<Matrix6<f64>> {
        let scale = self.scale()?;
        let inverse = self.scaled(&scale).cholesky()?.inverse();
        // the diagonal of N is one here: large values mean that rounding has eaten the digits
        let determined = inverse.diagonal().iter().all(|v| v.is_finite() && *v < LARGEST_INVERSE);
        determined.then(|| Matrix6::from_fn(|row, column| scale[row] * inverse[(row, column)] * scale[column]))
    }

    /// Metres and radians differ by orders of magnitude: the diagonal is brought to one first.
    fn scale(&self) -> Option<Vector6<f64>> {
        let diagonal = self.matrix.diagonal();
        diagonal.iter().all(|d| d.is_finite() && *d > 0.0).then(|| diagonal.map(|d| 1.0 / d.sqrt()))
    }

    fn scaled(&self, scale: &Vector6<f64>) -> Matrix6<f64> {
        Matrix6::from_fn(|row, column| scale[row] * self.matrix[(row, column)] * scale[column])
    }
}

impl Default for NormalEquations {
    fn default() -> Self {
        Self::new()
    }
}

/// What is known of the orientation before an image point is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Prior {
    /// The most probable orientation.
    pub orientation: ExteriorOrientation,
    /// Inverse covariance of the step away from it.
    pub information: Matrix6<f64>,
}

/// The standard deviation of a plane position in the direction in which it is largest.
#[must_use]
pub fn largest_sigma(covariance: &Matrix2<f64>) -> f64 {
    let (a, b, c) = (covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]);
    ((a + c) / 2.0 + ((a - c) / 2.0).hypot(b)).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::{Draws, flight};
    use approx::assert_relative_eq;

    /// Equations `jacobian * parameters = observed` of parameters in metres and radians.
    fn linear(draws: &mut Draws, parameters: &Vector6<f64>, count: usize) -> NormalEquations {
        let mut equations = NormalEquations::new();
        for _ in 0..count {
            let jacobian = Matrix2x6::from_fn(|_, column| draws.normal() * if column < 3 { 10.0 } else { 4000.0 });
            let weight = Matrix2::new(2.0, 0.5, 0.5, 1.0);
            equations.add(&jacobian, &(jacobian * parameters), &weight);
        }
        equations
    }

    #[test]
    fn exact_equations_return_their_parameters_and_leave_no_squares() {
        let mut draws = Draws::new(1);
        let parameters = Vector6::new(1.0, -2.0, 3.0, 0.01, -0.02, 0.03);
        let equations = linear(&mut draws, &parameters, 8);
        let solved = equations.solve().unwrap();
        assert_relative_eq!(solved, parameters, epsilon = 1e-11);
        assert_relative_eq!(equations.squares, solved.dot(&equations.right_side), max_relative = 1e-12);
        let identity = equations.matrix * equations.inverse().unwrap();
        assert_relative_eq!(identity, Matrix6::identity(), epsilon = 1e-7);
    }

    #[test]
    fn a_prior_pulls_to_its_orientation_with_its_weight() {
        let step = Vector6::new(1.0, -2.0, 3.0, 0.01, -0.02, 0.03);
        let prior = Prior { orientation: flight().moved(&step), information: Matrix6::identity() * 4.0 };
        let mut equations = NormalEquations::new();
        equations.add_prior(&prior, &flight());
        assert_relative_eq!(equations.solve().unwrap(), step, epsilon = 1e-12);
        assert_relative_eq!(equations.squares, 4.0 * step.norm_squared(), max_relative = 1e-12);
        // as much again that says zero: the mean
        equations.matrix += Matrix6::identity() * 4.0;
        assert_relative_eq!(equations.solve().unwrap(), step / 2.0, epsilon = 1e-12);
        assert_relative_eq!(equations.inverse().unwrap(), Matrix6::identity() / 8.0, epsilon = 1e-12);
    }

    #[test]
    fn the_largest_sigma_is_that_of_the_long_axis_of_the_ellipse() {
        let (long, short, turn) = (3.0_f64, 0.5_f64, nalgebra::Rotation2::new(0.7));
        let covariance =
            turn.matrix() * Matrix2::new(long.powi(2), 0.0, 0.0, short.powi(2)) * turn.matrix().transpose();
        assert_relative_eq!(largest_sigma(&covariance), long, epsilon = 1e-12);
    }

    #[test]
    fn undetermined_parameters_are_told() {
        let mut draws = Draws::new(2);
        let too_few = linear(&mut draws, &Vector6::repeat(1.0), 2);
        assert_eq!((NormalEquations::new().solve(), NormalEquations::new().inverse()), (None, None));
        assert_eq!(too_few.inverse(), None);
        let mut broken = linear(&mut draws, &Vector6::repeat(1.0), 8);
        broken.matrix[(2, 2)] = f64::NAN;
        assert_eq!((broken.solve(), broken.inverse()), (None, None));
    }
}
