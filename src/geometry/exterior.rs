//! The exterior orientation: where the camera stood and how it was turned, and the collinearity equations
//! (method 1.5) with their derivatives.

use nalgebra::{Matrix2x3, Matrix2x6, Rotation3, UnitQuaternion, Vector2, Vector3};

use super::camera::Camera;
use super::rotation;

/// Projection centre and rotation in a Cartesian frame with z up, nearly always the local tangent plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExteriorOrientation {
    /// The projection centre X0.
    pub projection_centre_m: Vector3<f64>,
    /// Rotation of object space to the camera frame (x right, y up, z backwards).
    pub camera_from_object: Rotation3<f64>,
}

/// A point is in front of the camera if it is at least so far away from the plane of the projection centre.
const NEAREST_M: f64 = 1e-3;

impl ExteriorOrientation {
    /// The camera coordinates `u = R (X - X0)` of a point, its depth being `-u.z`.
    #[must_use]
    pub fn camera_coordinates(&self, point_m: Vector3<f64>) -> Vector3<f64> {
        self.camera_from_object * (point_m - self.projection_centre_m)
    }

    /// The reduced image point (y down, pixels); `None` behind the camera.
    #[must_use]
    pub fn reduced_px(&self, principal_distance_px: f64, point_m: Vector3<f64>) -> Option<Vector2<f64>> {
        let u = self.camera_coordinates(point_m);
        (u.z < -NEAREST_M).then(|| Vector2::new(-u.x, u.y) * (principal_distance_px / u.z))
    }

    /// The reduced image point and its derivatives by the projection centre and by the small rotation theta, with
    /// `object_from_camera <- object_from_camera * exp([theta]x)`; `None` behind the camera.
    #[must_use]
    pub fn reduced_px_with_jacobian(
        &self,
        principal_distance_px: f64,
        point_m: Vector3<f64>,
    ) -> Option<(Vector2<f64>, Matrix2x6<f64>)> {
        let u = self.camera_coordinates(point_m);
        if u.z >= -NEAREST_M {
            return None;
        }
        let scale = principal_distance_px / u.z;
        let point = Vector2::new(-u.x, u.y) * scale;
        // rows of d(point)/du: x = -c U/W, y = c V/W (y points down here); du/dX0 = -R, du/dtheta = [u]x
        let (by_x, by_y) = (scale * u.x / u.z, -scale * u.y / u.z);
        let r = self.camera_from_object.matrix();
        let mut jacobian = Matrix2x6::zeros();
        for column in 0..3 {
            jacobian[(0, column)] = scale * r[(0, column)] - by_x * r[(2, column)];
            jacobian[(1, column)] = -scale * r[(1, column)] - by_y * r[(2, column)];
        }
        jacobian.fixed_columns_mut::<3>(3).copy_from(&Matrix2x3::new(
            -by_x * u.y,
            scale * u.z + by_x * u.x,
            -scale * u.y,
            scale * u.z - by_y * u.y,
            by_y * u.x,
            -scale * u.x,
        ));
        Some((point, jacobian))
    }

    /// The pixel of a point in the file; `None` behind the camera or far outside the frame, where the distortion
    /// says nothing.
    #[must_use]
    pub fn pixel(&self, camera: &Camera, point_m: Vector3<f64>) -> Option<Vector2<f64>> {
        let reduced = self.reduced_px(camera.principal_distance_px, point_m)?;
        (reduced.norm() < 1.5 * camera.frame_radius_px()).then(|| camera.pixel_from_reduced(reduced))
    }

    /// The direction in object space in which a reduced image point looks (not of unit length).
    #[must_use]
    pub fn ray(&self, principal_distance_px: f64, reduced_px: Vector2<f64>) -> Vector3<f64> {
        self.camera_from_object.inverse() * Vector3::new(reduced_px.x, -reduced_px.y, -principal_distance_px)
    }

    /// Where the ray of a reduced image point meets the horizontal plane at `height_m`; `None` if it does not.
    #[must_use]
    pub fn ground_point_m(
        &self,
        principal_distance_px: f64,
        reduced_px: Vector2<f64>,
        height_m: f64,
    ) -> Option<Vector3<f64>> {
        let ray = self.ray(principal_distance_px, reduced_px).normalize();
        let distance = (height_m - self.projection_centre_m.z) / ray.z;
        // a ray within a degree of the horizon meets the plane nowhere useful
        (ray.z.abs() > 0.02 && distance > 0.0).then(|| self.projection_centre_m + distance * ray)
    }

    /// The orientation after a step `[dX0, theta]` of the estimation.
    #[must_use]
    pub fn moved(&self, step: &nalgebra::Vector6<f64>) -> Self {
        Self {
            projection_centre_m: self.projection_centre_m + step.fixed_rows::<3>(0),
            camera_from_object: rotation::turned(&self.camera_from_object, step.fixed_rows::<3>(3).into_owned()),
        }
    }

    /// The step `[dX0, theta]` that leads from this orientation to the other.
    #[must_use]
    pub fn step_to(&self, other: &Self) -> nalgebra::Vector6<f64> {
        let centre = other.projection_centre_m - self.projection_centre_m;
        // by the quaternion: the matrix loses small angles, and at times returns NaN for them
        let turn = other.camera_from_object * self.camera_from_object.inverse();
        let theta = -UnitQuaternion::from_rotation_matrix(&turn).scaled_axis();
        nalgebra::Vector6::new(centre.x, centre.y, centre.z, theta.x, theta.y, theta.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::Vector6;

    fn tilted() -> ExteriorOrientation {
        ExteriorOrientation {
            projection_centre_m: Vector3::new(12.0, -7.0, 310.0),
            camera_from_object: rotation::camera_from_object(0.12, -0.2, 2.4),
        }
    }

    #[test]
    fn a_nadir_image_has_east_to_the_right_and_north_up() {
        let nadir = ExteriorOrientation {
            projection_centre_m: Vector3::new(0.0, 0.0, 100.0),
            camera_from_object: rotation::camera_from_object(0.0, 0.0, 0.0),
        };
        let point = nadir.reduced_px(1000.0, Vector3::new(10.0, 20.0, 0.0)).unwrap();
        assert_relative_eq!(point, Vector2::new(100.0, -200.0), epsilon = 1e-9);
        assert!(nadir.reduced_px(1000.0, Vector3::new(0.0, 0.0, 101.0)).is_none());
    }

    #[test]
    fn jacobian_agrees_with_finite_differences() {
        let (orientation, c) = (tilted(), 3700.0);
        for point in [Vector3::new(40.0, 10.0, 5.0), Vector3::new(-80.0, 60.0, 30.0)] {
            let (_, jacobian) = orientation.reduced_px_with_jacobian(c, point).unwrap();
            for parameter in 0..6 {
                let step = Vector6::ith(parameter, if parameter < 3 { 1e-3 } else { 1e-6 });
                let at = |s: Vector6<f64>| orientation.moved(&s).reduced_px(c, point).unwrap();
                let numeric = (at(step) - at(-step)) / (2.0 * step.norm());
                assert_relative_eq!(jacobian.column(parameter).into_owned(), numeric, max_relative = 1e-6);
            }
        }
    }

    #[test]
    fn rays_come_back_to_the_ground_and_steps_lead_to_their_ends() {
        let orientation = tilted();
        let ground = Vector3::new(33.0, 41.0, 12.0);
        let image = orientation.reduced_px(3700.0, ground).unwrap();
        assert_relative_eq!(orientation.ground_point_m(3700.0, image, 12.0).unwrap(), ground, epsilon = 1e-9);
        let step = Vector6::new(1.0, -2.0, 3.0, 0.02, -0.05, 0.1);
        assert_relative_eq!(orientation.step_to(&orientation.moved(&step)), step, epsilon = 1e-12);
    }

    #[test]
    fn tiny_steps_are_found_again() {
        for size in [1e-12, 1e-9, 1e-8, 1e-6] {
            for k in 0..1000 {
                let angle = f64::from(k) * 0.0013;
                let from = ExteriorOrientation {
                    projection_centre_m: Vector3::zeros(),
                    camera_from_object: rotation::camera_from_object(angle - 0.6, 0.3 * angle, 3.0 * angle),
                };
                let step = Vector6::new(0.0, 0.0, 0.0, size, -size, 2.0 * size);
                assert_relative_eq!(from.step_to(&from.moved(&step)), step, epsilon = 1e-14);
            }
        }
    }
}
