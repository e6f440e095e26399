//! Brown's lens distortion as the HTTP contract defines it.

use nalgebra::{Matrix2, Vector2};

/// Brown's lens distortion with affine terms, on ideal coordinates (contract, section Camera).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Brown {
    /// Radial coefficient of r².
    pub k1: f64,
    /// Radial coefficient of r⁴.
    pub k2: f64,
    /// Radial coefficient of r⁶.
    pub k3: f64,
    /// Tangential coefficient that goes with 2xy in x.
    pub p1: f64,
    /// Tangential coefficient that goes with r² + 2x² in x.
    pub p2: f64,
    /// Difference of the principal distances in x and y, in pixels.
    pub b1_px: f64,
    /// Shear, in pixels.
    pub b2_px: f64,
}

impl Brown {
    /// An ideal point bent by the lens, without the affine terms.
    pub(super) fn distorted(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let Self { k1, k2, k3, p1, p2, .. } = *self;
        let (x, y, r2) = (ideal.x, ideal.y, ideal.norm_squared());
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    /// The derivatives of the bent point by the ideal one.
    pub(super) fn jacobian(&self, ideal: Vector2<f64>) -> Matrix2<f64> {
        let Self { k1, k2, k3, p1, p2, .. } = *self;
        let (x, y, r2) = (ideal.x, ideal.y, ideal.norm_squared());
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let radial_by_r2 = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
        let mixed = 2.0 * x * y * radial_by_r2 + 2.0 * p1 * x + 2.0 * p2 * y;
        Matrix2::new(
            radial + 2.0 * x * x * radial_by_r2 + 2.0 * p1 * y + 6.0 * p2 * x,
            mixed,
            mixed,
            radial + 2.0 * y * y * radial_by_r2 + 6.0 * p1 * y + 2.0 * p2 * x,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn jacobian_agrees_with_finite_differences() {
        let brown = Brown { k1: -0.0468, k2: 0.0207, k3: 0.001, p1: 0.00102, p2: 0.00199, b1_px: 1.5, b2_px: -0.7 };
        let (at, step) = (Vector2::new(0.4, -0.3), 1e-6);
        for axis in 0..2 {
            let h = Vector2::ith(axis, step);
            let numeric = (brown.distorted(at + h) - brown.distorted(at - h)) / (2.0 * step);
            assert_relative_eq!(brown.jacobian(at).column(axis).into_owned(), numeric, epsilon = 1e-8);
        }
    }
}
