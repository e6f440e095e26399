//! What does an uncertain orientation mean on the ground?

use nalgebra::{Matrix2x6, Matrix3, Matrix6, Vector2, Vector3};

use crate::geometry::{Camera, ExteriorOrientation};

/// The predicted precision of one point of the ground, if the orientation is right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundPrecision {
    /// The image point, in pixels of the file.
    pub image_px: Vector2<f64>,
    /// Where its ray meets the horizontal plane.
    pub ground_m: Vector3<f64>,
    /// sqrt(variance east + variance north).
    pub sigma_planimetric_m: f64,
}

/// The nine image points, in pixels of the file, at which errors on the ground are looked at: a 3 x 3 grid over the frame
/// that leaves a margin, row by row.
pub(super) fn grid_px(camera: &Camera) -> [Vector2<f64>; 9] {
    const SHARES: [f64; 3] = [0.05, 0.5, 0.95];
    std::array::from_fn(|k| camera.frame_px(SHARES[k % 3], SHARES[k / 3]))
}

/// A point of the ground, and how it moves with the orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundPoint {
    /// The image point, in pixels of the file.
    pub image_px: Vector2<f64>,
    /// Where its ray meets the horizontal plane.
    pub ground_m: Vector3<f64>,
    /// The derivatives of its east and north by `[dX0, theta]`.
    pub by_parameters: Matrix2x6<f64>,
}

/// The points of the horizontal plane at `height_m` that the nine image points at 5, 50 and 95 % of width and height
/// show, row by row. Those whose rays miss the plane are left out.
#[must_use]
pub fn ground_points(camera: &Camera, orientation: &ExteriorOrientation, height_m: f64) -> Vec<GroundPoint> {
    let at = |image_px: Vector2<f64>| {
        let reduced_px = camera.reduced_from_pixel(image_px)?;
        let c = camera.principal_distance_px;
        let ground_m = orientation.ground_point_m(c, reduced_px, height_m)?;
        let by_parameters = ground_jacobian(orientation, orientation.ray(c, reduced_px), ground_m);
        Some(GroundPoint { image_px, ground_m, by_parameters })
    };
    grid_px(camera).into_iter().filter_map(at).collect()
}

/// The planimetric precision of points of the ground, from the covariance of `[dX0, theta]`. The image points
/// themselves are taken to be without error.
#[must_use]
pub fn ground_precision(points: &[GroundPoint], covariance: &Matrix6<f64>) -> Vec<GroundPrecision> {
    let of_point = |point: &GroundPoint| {
        let variance = (point.by_parameters * covariance * point.by_parameters.transpose()).trace();
        let sigma_planimetric_m = variance.max(0.0).sqrt();
        GroundPrecision { image_px: point.image_px, ground_m: point.ground_m, sigma_planimetric_m }
    };
    points.iter().map(of_point).collect()
}

/// The derivatives of east and north of the point where a ray meets a horizontal plane, by `[dX0, theta]`.
fn ground_jacobian(orientation: &ExteriorOrientation, ray: Vector3<f64>, ground_m: Vector3<f64>) -> Matrix2x6<f64> {
    // what shifts the point off the plane is led back along the ray
    let onto_plane = Matrix3::identity() - (ray / ray.z) * Vector3::z().transpose();
    // object_from_camera * exp([theta]x) turns d = R (X - X0) by theta x d = -[d]x theta
    let object_from_camera = orientation.camera_from_object.inverse();
    let by_theta = -(object_from_camera.matrix() * orientation.camera_coordinates(ground_m).cross_matrix());
    let mut jacobian = Matrix2x6::zeros();
    jacobian.fixed_columns_mut::<3>(0).copy_from(&onto_plane.fixed_rows::<2>(0));
    jacobian.fixed_columns_mut::<3>(3).copy_from(&(onto_plane * by_theta).fixed_rows::<2>(0));
    jacobian
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::{Draws, flight};
    use crate::geometry::{Brown, rotation};
    use approx::assert_relative_eq;
    use nalgebra::Vector6;

    const HEIGHT_M: f64 = 12.0;

    fn camera() -> Camera {
        let distortion = Brown { k1: -0.03, p1: 1e-3, ..Brown::default() };
        Camera::new([6000, 4000], 5000.0, Vector2::new(3010.0, 1990.0), distortion).unwrap()
    }

    fn covariance() -> Matrix6<f64> {
        let mut draws = Draws::new(8);
        let units = Matrix6::from_diagonal(&Vector6::new(0.3, 0.2, 0.1, 5e-4, 7e-4, 2e-4));
        let mixed = units * Matrix6::from_fn(|_, _| draws.normal());
        mixed * mixed.transpose()
    }

    fn ground(orientation: &ExteriorOrientation, image_px: Vector2<f64>) -> Vector3<f64> {
        let camera = camera();
        let reduced = camera.reduced_from_pixel(image_px).unwrap();
        orientation.ground_point_m(camera.principal_distance_px, reduced, HEIGHT_M).unwrap()
    }

    #[test]
    fn jacobian_agrees_with_finite_differences() {
        let camera = camera();
        for image_px in [Vector2::new(300.0, 200.0), Vector2::new(3000.0, 2000.0), Vector2::new(5700.0, 200.0)] {
            let ray = flight().ray(camera.principal_distance_px, camera.reduced_from_pixel(image_px).unwrap());
            let jacobian = ground_jacobian(&flight(), ray, ground(&flight(), image_px));
            for parameter in 0..6 {
                let step = Vector6::ith(parameter, if parameter < 3 { 1e-3 } else { 1e-6 });
                let at = |step: Vector6<f64>| ground(&flight().moved(&step), image_px).xy();
                let numeric = (at(step) - at(-step)) / (2.0 * step.norm());
                assert_relative_eq!(
                    jacobian.column(parameter).into_owned(),
                    numeric,
                    epsilon = 1e-5,
                    max_relative = 1e-6
                );
            }
        }
    }

    #[test]
    fn sigmas_are_the_scatter_of_drawn_orientations() {
        let precision = ground_precision(&ground_points(&camera(), &flight(), HEIGHT_M), &covariance());
        assert_eq!(precision.len(), 9);
        assert_eq!((precision[1].image_px.x, precision[1].image_px.y), (3000.0, 200.0));
        let mut draws = Draws::new(9);
        let runs = 4000;
        let mut squares = [0.0; 9];
        for _ in 0..runs {
            let drawn = flight().moved(&draws.normal6(&covariance()));
            for (sum, point) in squares.iter_mut().zip(&precision) {
                *sum += (ground(&drawn, point.image_px) - point.ground_m).xy().norm_squared();
            }
        }
        for (sum, point) in squares.iter().zip(&precision) {
            assert_relative_eq!(point.ground_m, ground(&flight(), point.image_px), epsilon = 1e-9);
            let scatter = (sum / f64::from(runs)).sqrt();
            assert_relative_eq!(point.sigma_planimetric_m, scatter, max_relative = 0.05);
        }
    }

    #[test]
    fn a_nadir_image_is_as_sure_of_its_nadir_as_of_its_height_times_tilt() {
        let camera = Camera::new([6000, 4000], 5000.0, Vector2::new(3000.0, 2000.0), Brown::default()).unwrap();
        let nadir = ExteriorOrientation {
            projection_centre_m: Vector3::new(0.0, 0.0, HEIGHT_M + 300.0),
            camera_from_object: rotation::camera_from_object(0.0, 0.0, 0.7),
        };
        let variances = Vector6::new(0.01, 0.04, 9.0, 1e-6, 4e-6, 1.0);
        let points = ground_points(&camera, &nadir, HEIGHT_M);
        let precision = ground_precision(&points, &Matrix6::from_diagonal(&variances));
        // height and heading do not move the middle
        let expected = (0.01 + 0.04 + 300.0_f64.powi(2) * (1e-6 + 4e-6)).sqrt();
        assert_relative_eq!(precision[4].sigma_planimetric_m, expected, max_relative = 1e-9);
    }

    #[test]
    fn rays_into_the_sky_are_left_out() {
        let mut tilted = flight();
        tilted.camera_from_object = rotation::camera_from_object(1.45, 0.0, 0.0);
        let seen = ground_points(&camera(), &tilted, HEIGHT_M).len();
        assert!((1..9).contains(&seen), "{seen}");
    }
}
