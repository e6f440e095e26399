//! What the adjustment with lines says of each building: the normal equations at its end, seen by displacements of
//! whole buildings in the image.

use nalgebra::{DMatrix, DVector, Matrix2};

use super::adjust::{Adjustment, Model};
use crate::estimation::Reliability;
use crate::estimation::robust::Weighting;

impl Model<'_> {
    /// The sensitivity of an adjustment to its buildings, in their order. A displacement of a building has the same
    /// effect on its edges as its shift, but nothing is known of it beforehand. `None` where the equations at the end
    /// of the adjustment cannot be solved.
    #[must_use]
    pub fn reliability(&self, adjustment: &Adjustment) -> Option<Reliability> {
        let Adjustment { buildings, orientation, .. } = adjustment;
        let count = buildings.len();
        let shift_prior = self.shift_prior(buildings, orientation)?;
        let information = shift_prior.information(&adjustment.excess)?;
        let mut matrix = DMatrix::zeros(6 + 2 * count, 6 + 2 * count);
        matrix.view_mut((6, 6), (2 * count, 2 * count)).copy_from(&information.kronecker(&DMatrix::identity(2, 2)));
        let mut parameters = matrix.fixed_view_mut::<6, 6>(0, 0);
        parameters += self.prior.information;
        // what a displacement of each building has in common with all unknowns
        let mut common = DMatrix::zeros(2 * count, 6 + 2 * count);
        let mut right_side = DVector::zeros(2 * count);
        for (k, linear) in self.linearised(buildings, orientation, Weighting::Rejecting).into_iter().enumerate() {
            let (own, at) = (linear.equations, 6 + 2 * k);
            let mut parameters = matrix.fixed_view_mut::<6, 6>(0, 0);
            parameters += own.matrix;
            let mut shift = matrix.fixed_view_mut::<2, 2>(at, at);
            shift += own.shift_matrix;
            matrix.fixed_view_mut::<6, 2>(0, at).copy_from(&own.coupling);
            matrix.fixed_view_mut::<2, 6>(at, 0).copy_from(&own.coupling.transpose());
            common.fixed_view_mut::<2, 6>(2 * k, 0).copy_from(&own.coupling.transpose());
            common.fixed_view_mut::<2, 2>(2 * k, at).copy_from(&own.shift_matrix);
            right_side.fixed_rows_mut::<2>(2 * k).copy_from(&own.shift_right_side);
        }
        let own: Vec<Matrix2<f64>> =
            (0..count).map(|k| common.fixed_view::<2, 2>(2 * k, 6 + 2 * k).into_owned()).collect();
        let explained = scaled_inverse(&matrix)? * common.transpose();
        let mut weights = -(&common * &explained);
        for (k, own) in own.iter().enumerate() {
            let mut block = weights.fixed_view_mut::<2, 2>(2 * k, 2 * k);
            block += own;
        }
        Some(Reliability {
            covariance: adjustment.covariance,
            weights,
            right_side,
            influence: explained.rows(0, 6).into_owned(),
            own,
            excess: adjustment.excess.clone(),
        })
    }
}

/// The inverse by way of a matrix whose diagonal is one: metres, radians and pixels differ by orders of magnitude.
fn scaled_inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = DMatrix::from_diagonal(&matrix.diagonal().map(|d| 1.0 / d.sqrt()));
    Some(&scale * (&scale * matrix * &scale).cholesky()?.inverse() * &scale)
}
