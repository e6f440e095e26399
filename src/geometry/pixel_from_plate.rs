//! From the plate of a film camera to the pixels of its scan.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2};

/// A projective transformation from the plate (millimetres, x in the direction of flight, y to the left of it) to
/// pixels of the file (x right, y down, the corner of the top-left pixel being (0, 0)). An affine one is its special
/// case. Plate y points up and rows run down, so a right-reading scan has a Jacobian with a *negative* determinant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelFromPlate {
    matrix: Matrix3<f64>,
    inverse: Matrix3<f64>,
}

impl PixelFromPlate {
    /// The transformation of homogeneous coordinates by a matrix; its scale does not matter. `None` if it is singular,
    /// not finite, or takes the plate's origin to infinity.
    #[must_use]
    pub fn new(matrix: &Matrix3<f64>) -> Option<Self> {
        let matrix = matrix / matrix[(2, 2)];
        let inverse = matrix.try_inverse()?;
        let finite = matrix.iter().chain(&inverse).all(|value| value.is_finite());
        finite.then_some(Self { matrix, inverse })
    }

    /// The affine transformation `pixel = linear * plate + origin_px`; `None` if it is singular or not finite.
    #[must_use]
    pub fn affine(linear: &Matrix2<f64>, origin_px: Vector2<f64>) -> Option<Self> {
        let mut matrix = Matrix3::identity();
        matrix.fixed_view_mut::<2, 2>(0, 0).copy_from(linear);
        matrix.fixed_view_mut::<2, 1>(0, 2).copy_from(&origin_px);
        Self::new(&matrix)
    }

    /// The matrix, its last element 1.
    #[must_use]
    pub fn matrix(&self) -> &Matrix3<f64> {
        &self.matrix
    }

    /// The pixel of a place on the plate.
    #[must_use]
    pub fn pixel(&self, plate_mm: Vector2<f64>) -> Vector2<f64> {
        let h = self.matrix * plate_mm.push(1.0);
        h.xy() / h.z
    }

    /// The place on the plate of a pixel.
    #[must_use]
    pub fn plate_mm(&self, pixel: Vector2<f64>) -> Vector2<f64> {
        let h = self.inverse * pixel.push(1.0);
        h.xy() / h.z
    }

    /// The derivatives of the pixel by the place on the plate, px/mm.
    #[must_use]
    pub fn jacobian(&self, plate_mm: Vector2<f64>) -> Matrix2<f64> {
        let h = self.matrix * plate_mm.push(1.0);
        let by_h = Matrix2x3::new(1.0, 0.0, -h.x / h.z, 0.0, 1.0, -h.y / h.z) / h.z;
        by_h * self.matrix.fixed_columns::<2>(0)
    }

    /// Pixels per millimetre at a place on the plate, the mean over all directions.
    #[must_use]
    pub fn scale_px_per_mm(&self, plate_mm: Vector2<f64>) -> f64 {
        self.jacobian(plate_mm).determinant().abs().sqrt()
    }

    /// Whether the scan shows the scene as it is seen, not its mirror image.
    #[must_use]
    pub fn is_right_reading(&self) -> bool {
        self.jacobian(Vector2::zeros()).determinant() < 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn projective() -> PixelFromPlate {
        PixelFromPlate::new(&Matrix3::new(50.0, 0.3, 5800.0, 0.2, -50.1, 5750.0, 1e-6, -2e-6, 1.0)).unwrap()
    }

    #[test]
    fn points_go_forth_and_back() {
        for (x, y) in [(0.0, 0.0), (-113.0, 113.0), (106.0, -40.0)] {
            let plate = Vector2::new(x, y);
            assert_relative_eq!(projective().plate_mm(projective().pixel(plate)), plate, epsilon = 1e-9);
        }
        let doubled = PixelFromPlate::new(&(projective().matrix() * 2.0)).unwrap();
        assert_relative_eq!(doubled.pixel(Vector2::new(9.0, 7.0)), projective().pixel(Vector2::new(9.0, 7.0)));
    }

    #[test]
    fn an_affine_transformation_is_linear_about_its_origin() {
        let linear = Matrix2::new(0.0, 48.0, 48.5, 0.1);
        let affine = PixelFromPlate::affine(&linear, Vector2::new(5600.0, 5700.0)).unwrap();
        assert_relative_eq!(affine.pixel(Vector2::new(2.0, -1.0)), Vector2::new(5552.0, 5796.9), epsilon = 1e-9);
        assert_relative_eq!(affine.jacobian(Vector2::new(80.0, 3.0)), linear, epsilon = 1e-12);
        assert_relative_eq!(affine.scale_px_per_mm(Vector2::zeros()), (48.0_f64 * 48.5).sqrt(), epsilon = 1e-9);
    }

    #[test]
    fn jacobian_agrees_with_finite_differences() {
        let (at, step) = (Vector2::new(70.0, -95.0), 1e-3);
        for axis in 0..2 {
            let h = Vector2::ith(axis, step);
            let numeric = (projective().pixel(at + h) - projective().pixel(at - h)) / (2.0 * step);
            assert_relative_eq!(projective().jacobian(at).column(axis).into_owned(), numeric, epsilon = 1e-6);
        }
    }

    #[test]
    fn rows_that_run_down_read_right() {
        let reads_right = |linear| PixelFromPlate::affine(&linear, Vector2::zeros()).unwrap().is_right_reading();
        assert!(reads_right(Matrix2::new(50.0, 0.0, 0.0, -50.0)));
        // a quarter turn does not mirror, a reflection does
        assert!(reads_right(Matrix2::new(0.0, 50.0, 50.0, 0.0)));
        assert!(!reads_right(Matrix2::new(-50.0, 0.0, 0.0, -50.0)));
    }

    #[test]
    fn what_is_no_transformation_is_none() {
        assert_eq!(PixelFromPlate::new(&Matrix3::zeros()), None);
        assert_eq!(PixelFromPlate::new(&Matrix3::from_element(1.0)), None);
        assert_eq!(PixelFromPlate::affine(&Matrix2::identity(), Vector2::new(0.0, f64::NAN)), None);
    }
}
