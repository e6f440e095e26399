//! The camera's interior orientation: principal distance, principal point, and Brown's distortion as the HTTP
//! contract defines it.
//!
//! Three kinds of image coordinates are met, all with x to the right and y down:
//! *pixels* as stored in the file, the corner of the top-left pixel being (0, 0);
//! *ideal* coordinates x = X/Z, y = Y/Z, free of distortion;
//! *reduced* coordinates, the ideal ones times the principal distance: pixels about the principal point in which the
//! camera is a perfect pinhole and straight edges are straight. Estimation works in reduced coordinates.

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

/// A frame camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Columns of the image.
    pub width_px: u32,
    /// Rows of the image.
    pub height_px: u32,
    /// Principal distance.
    pub principal_distance_px: f64,
    /// Principal point, in pixels.
    pub principal_point_px: Vector2<f64>,
    /// Lens distortion.
    pub distortion: Brown,
    frame_radius_px: f64,
}

/// Why a camera cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// The frame has no pixels.
    #[error("the image size is {width_px} x {height_px} px; both must be at least 1")]
    EmptyFrame {
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
    },
    /// Not a positive, finite principal distance.
    #[error("the principal distance is {value} px; it must be positive and finite")]
    PrincipalDistance {
        /// What was given.
        value: f64,
    },
    /// A parameter is not a number.
    #[error("{name} is not a finite number")]
    NotFinite {
        /// The parameter's name in the contract.
        name: &'static str,
    },
    /// Two places of the scene would fall on the same pixel.
    #[error("the distortion folds the image at ({x_px:.0}, {y_px:.0}) px: it cannot be inverted there")]
    DistortionFolds {
        /// Column of the offending pixel.
        x_px: f64,
        /// Row of the offending pixel.
        y_px: f64,
    },
}

const INVERSION_STEPS: usize = 20;
const INVERSION_TOLERANCE: f64 = 1e-13;

impl Camera {
    /// A camera whose parameters are finite and whose distortion can be inverted all over the frame.
    ///
    /// # Errors
    /// [`CameraError`] names the parameter that is at fault.
    pub fn new(
        size_px: [u32; 2],
        principal_distance_px: f64,
        principal_point_px: Vector2<f64>,
        distortion: Brown,
    ) -> Result<Self, CameraError> {
        let [width_px, height_px] = size_px;
        if width_px == 0 || height_px == 0 {
            return Err(CameraError::EmptyFrame { width_px, height_px });
        }
        if !(principal_distance_px.is_finite() && principal_distance_px > 0.0) {
            return Err(CameraError::PrincipalDistance { value: principal_distance_px });
        }
        let Brown { k1, k2, k3, p1, p2, b1_px, b2_px } = distortion;
        let named = [
            ("principal_point_px", principal_point_px.x),
            ("principal_point_px", principal_point_px.y),
            ("k1", k1),
            ("k2", k2),
            ("k3", k3),
            ("p1", p1),
            ("p2", p2),
            ("b1_px", b1_px),
            ("b2_px", b2_px),
        ];
        if let Some((name, _)) = named.into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(CameraError::NotFinite { name });
        }
        let mut camera =
            Self { width_px, height_px, principal_distance_px, principal_point_px, distortion, frame_radius_px: 0.0 };
        camera.check_inverse()?;
        camera.frame_radius_px = camera.farthest_corner_px();
        Ok(camera)
    }

    /// The pixel of an ideal point.
    #[must_use]
    pub fn pixel_from_ideal(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let d = &self.distortion;
        let bent = self.distorted(ideal);
        self.principal_point_px
            + self.principal_distance_px * bent
            + Vector2::new(d.b1_px * bent.x + d.b2_px * bent.y, 0.0)
    }

    /// The ideal point of a pixel, by Newton's method; `None` where the distortion cannot be inverted.
    #[must_use]
    pub fn ideal_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let d = &self.distortion;
        let from_centre = pixel - self.principal_point_px;
        let y = from_centre.y / self.principal_distance_px;
        let x = (from_centre.x - d.b2_px * y) / (self.principal_distance_px + d.b1_px);
        let bent = Vector2::new(x, y);
        let mut ideal = bent;
        for _ in 0..INVERSION_STEPS {
            let step = self.distortion_jacobian(ideal).try_inverse()? * (bent - self.distorted(ideal));
            ideal += step;
            if !ideal.iter().all(|v| v.is_finite()) {
                return None;
            }
            if step.norm() < INVERSION_TOLERANCE {
                // past a fold Newton may end on the wrong branch, where the mapping turns over
                return (self.distortion_jacobian(ideal).determinant() > 0.0).then_some(ideal);
            }
        }
        None
    }

    /// The pixel of a reduced point.
    #[must_use]
    pub fn pixel_from_reduced(&self, reduced_px: Vector2<f64>) -> Vector2<f64> {
        self.pixel_from_ideal(reduced_px / self.principal_distance_px)
    }

    /// The reduced point of a pixel; `None` where the distortion cannot be inverted.
    #[must_use]
    pub fn reduced_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        Some(self.ideal_from_pixel(pixel)? * self.principal_distance_px)
    }

    /// Whether a pixel position lies in the frame, widened by a margin.
    #[must_use]
    pub fn contains(&self, pixel: Vector2<f64>, margin_px: f64) -> bool {
        let inside = |v: f64, size: u32| v >= -margin_px && v <= f64::from(size) + margin_px;
        inside(pixel.x, self.width_px) && inside(pixel.y, self.height_px)
    }

    /// Distance from the principal point, in reduced pixels, of the corner that is farthest from it. Beyond about
    /// this radius the polynomial of the distortion says nothing.
    #[must_use]
    pub fn frame_radius_px(&self) -> f64 {
        self.frame_radius_px
    }

    fn farthest_corner_px(&self) -> f64 {
        let (w, h) = (f64::from(self.width_px), f64::from(self.height_px));
        [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)]
            .into_iter()
            .filter_map(|(x, y)| self.reduced_from_pixel(Vector2::new(x, y)))
            .map(|reduced| reduced.norm())
            .fold(0.0, f64::max)
    }

    fn distorted(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let Brown { k1, k2, k3, p1, p2, .. } = self.distortion;
        let (x, y, r2) = (ideal.x, ideal.y, ideal.norm_squared());
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    fn distortion_jacobian(&self, ideal: Vector2<f64>) -> Matrix2<f64> {
        let Brown { k1, k2, k3, p1, p2, .. } = self.distortion;
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

    fn check_inverse(&self) -> Result<(), CameraError> {
        const STEPS: u32 = 16;
        for (i, j) in (0..=STEPS).flat_map(|i| (0..=STEPS).map(move |j| (i, j))) {
            let at = |k: u32, size: u32| f64::from(size) * f64::from(k) / f64::from(STEPS);
            let pixel = Vector2::new(at(i, self.width_px), at(j, self.height_px));
            let returns =
                self.ideal_from_pixel(pixel).is_some_and(|ideal| (self.pixel_from_ideal(ideal) - pixel).norm() < 1e-6);
            if !returns {
                return Err(CameraError::DistortionFolds { x_px: pixel.x, y_px: pixel.y });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn distorted_camera() -> Camera {
        let distortion =
            Brown { k1: -0.0468, k2: 0.0207, k3: 0.001, p1: 0.00102, p2: 0.00199, b1_px: 1.5, b2_px: -0.7 };
        Camera::new([4608, 3456], 3757.1, Vector2::new(2304.0, 1728.0), distortion).unwrap()
    }

    #[test]
    fn distortion_is_the_contract_s_formula() {
        let camera = distorted_camera();
        let (x, y): (f64, f64) = (0.31, -0.22);
        let r2 = x * x + y * y;
        let radial = 1.0 - 0.0468 * r2 + 0.0207 * r2.powi(2) + 0.001 * r2.powi(3);
        let xd = x * radial + 2.0 * 0.00102 * x * y + 0.00199 * (r2 + 2.0 * x * x);
        let yd = y * radial + 0.00102 * (r2 + 2.0 * y * y) + 2.0 * 0.00199 * x * y;
        let pixel = camera.pixel_from_ideal(Vector2::new(x, y));
        assert_relative_eq!(pixel.x, 2304.0 + 3757.1 * xd + 1.5 * xd - 0.7 * yd, epsilon = 1e-9);
        assert_relative_eq!(pixel.y, 1728.0 + 3757.1 * yd, epsilon = 1e-9);
    }

    #[test]
    fn inverse_returns_to_the_pixel() {
        let camera = distorted_camera();
        for (x, y) in [(0.0, 0.0), (4608.0, 3456.0), (17.3, 3000.1), (2304.0, 1728.0)] {
            let pixel = Vector2::new(x, y);
            let ideal = camera.ideal_from_pixel(pixel).unwrap();
            assert_relative_eq!(camera.pixel_from_ideal(ideal), pixel, epsilon = 1e-8);
        }
    }

    #[test]
    fn jacobian_of_the_distortion_agrees_with_finite_differences() {
        let camera = distorted_camera();
        let (at, step) = (Vector2::new(0.4, -0.3), 1e-6);
        let jacobian = camera.distortion_jacobian(at);
        for axis in 0..2 {
            let h = Vector2::ith(axis, step);
            let numeric = (camera.distorted(at + h) - camera.distorted(at - h)) / (2.0 * step);
            assert_relative_eq!(jacobian.column(axis).into_owned(), numeric, epsilon = 1e-8);
        }
    }

    #[test]
    fn cameras_that_make_no_sense_are_refused() {
        let centre = Vector2::new(50.0, 40.0);
        let refused = |size, c, d| Camera::new(size, c, centre, d).unwrap_err();
        let none = Brown::default();
        assert!(matches!(refused([0, 80], 100.0, none), CameraError::EmptyFrame { .. }));
        assert!(matches!(refused([100, 80], -1.0, none), CameraError::PrincipalDistance { .. }));
        let not_a_number = Brown { k2: f64::NAN, ..none };
        assert_eq!(refused([100, 80], 100.0, not_a_number), CameraError::NotFinite { name: "k2" });
        let fold = Brown { k1: -2.0, ..none };
        assert!(matches!(refused([100, 80], 60.0, fold), CameraError::DistortionFolds { .. }));
    }
}
