//! How a control scene is seen by the camera: its picture is that of a horizontal plane at the height of its reference.

use nalgebra::{Matrix2, Vector2, Vector3};

use super::Scene;
use crate::geometry::{Camera, ExteriorOrientation};

/// A camera that looks at the plane of a scene.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Where it is thought to be.
    pub orientation: &'a ExteriorOrientation,
    /// The scene's reference, in the frame of the orientation.
    pub reference_m: Vector3<f64>,
}

impl View<'_> {
    /// The image, in reduced pixels, of a place of the plane, metres east and north of the reference; `None` behind the
    /// camera.
    #[must_use]
    pub fn reduced_from_ground(&self, ground_m: Vector2<f64>) -> Option<Vector2<f64>> {
        let point_m = self.reference_m + Vector3::new(ground_m.x, ground_m.y, 0.0);
        self.orientation.reduced_px(self.camera.principal_distance_px, point_m)
    }

    /// Derivatives of the reduced image of the reference by its place, pixels a metre.
    #[must_use]
    pub fn reduced_by_ground(&self) -> Option<Matrix2<f64>> {
        let c = self.camera.principal_distance_px;
        let (_, by_parameters) = self.orientation.reduced_px_with_jacobian(c, self.reference_m)?;
        // what moves the point moves the projection centre the other way
        Some(-by_parameters.fixed_columns::<2>(0).into_owned())
    }

    /// How the pixels of a scene's picture lie in the file around the reference: pixels of the file for each of the
    /// scene, turned, reflected and foreshortened as the camera sees it. The distortion is left out.
    #[must_use]
    pub fn file_by_scene(&self, scene: &Scene) -> Option<Matrix2<f64>> {
        Some(self.camera.pixel_by_reduced() * self.reduced_by_ground()? * scene.ground_by_pixel_m())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Brown, rotation};

    #[test]
    fn the_derivatives_are_those_of_the_image() {
        let camera = Camera::new([4000, 3000], 3000.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap();
        let orientation = ExteriorOrientation {
            projection_centre_m: Vector3::new(3.0, -4.0, 150.0),
            camera_from_object: rotation::camera_from_object(0.2, -0.1, 2.5),
        };
        let view = View { camera: &camera, orientation: &orientation, reference_m: Vector3::new(20.0, 30.0, 5.0) };
        let analytic = view.reduced_by_ground().unwrap();
        for axis in 0..2 {
            let step = Vector2::ith(axis, 1e-4);
            let difference = view.reduced_from_ground(step).unwrap() - view.reduced_from_ground(-step).unwrap();
            assert!((difference / 2e-4 - analytic.column(axis)).norm() < 1e-5);
        }
    }
}
