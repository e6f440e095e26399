//! Rotations by omega, phi and kappa, in the order of ISPRS and PATB (method 4.1).
//!
//! `R(omega, phi, kappa) = R_x(omega) R_y(phi) R_z(kappa)` turns the photogrammetric camera frame (x right, y up,
//! z backwards) into object space; what the code carries about is its transpose, `camera_from_object`.

use nalgebra::{Matrix3, Rotation3, Vector3};

/// The rotation from object space to the camera frame for the three angles in radians.
#[must_use]
pub fn camera_from_object(omega_rad: f64, phi_rad: f64, kappa_rad: f64) -> Rotation3<f64> {
    let object_from_camera = Rotation3::from_axis_angle(&Vector3::x_axis(), omega_rad)
        * Rotation3::from_axis_angle(&Vector3::y_axis(), phi_rad)
        * Rotation3::from_axis_angle(&Vector3::z_axis(), kappa_rad);
    object_from_camera.inverse()
}

/// The angles `[omega, phi, kappa]` in radians of a rotation from object space to the camera frame.
#[must_use]
pub fn angles(camera_from_object: &Rotation3<f64>) -> [f64; 3] {
    // r is R_img->obj of method 4.1
    let r = camera_from_object.matrix().transpose();
    [(-r[(1, 2)]).atan2(r[(2, 2)]), r[(0, 2)].clamp(-1.0, 1.0).asin(), (-r[(0, 1)]).atan2(r[(0, 0)])]
}

/// The differentials of (omega, phi, kappa) by the small rotation theta about the camera's axes, where
/// `object_from_camera <- object_from_camera * exp([theta]x)`; `None` near `phi = ±90°`, where the angles fail.
#[must_use]
pub fn angles_by_theta(camera_from_object: &Rotation3<f64>) -> Option<Matrix3<f64>> {
    let [_, phi, kappa] = angles(camera_from_object);
    let (turn_back_kappa, turn_back_phi) =
        (Rotation3::from_axis_angle(&Vector3::z_axis(), -kappa), Rotation3::from_axis_angle(&Vector3::y_axis(), -phi));
    let theta_by_angles = Matrix3::from_columns(&[
        turn_back_kappa * (turn_back_phi * Vector3::x()),
        turn_back_kappa * Vector3::y(),
        Vector3::z(),
    ]);
    if phi.cos().abs() < 1e-9 {
        return None;
    }
    theta_by_angles.try_inverse()
}

/// `camera_from_object` after the small rotation `theta` about the camera's axes (see [`angles_by_theta`]).
#[must_use]
pub fn turned(camera_from_object: &Rotation3<f64>, theta_rad: Vector3<f64>) -> Rotation3<f64> {
    Rotation3::from_scaled_axis(-theta_rad) * camera_from_object
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// The matrix as method 4.1 prints it, element by element.
    fn printed(o: f64, p: f64, k: f64) -> Matrix3<f64> {
        let ((so, co), (sp, cp), (sk, ck)) = (o.sin_cos(), p.sin_cos(), k.sin_cos());
        Matrix3::new(
            cp * ck,
            -cp * sk,
            sp,
            co * sk + so * sp * ck,
            co * ck - so * sp * sk,
            -so * cp,
            so * sk - co * sp * ck,
            so * ck + co * sp * sk,
            co * cp,
        )
    }

    #[test]
    fn matrix_is_the_printed_one_and_angles_return() {
        for (o, p, k) in [(0.05, -0.03, 2.9), (-0.4, 0.3, -1.2), (0.0, 0.0, 0.0), (0.2, -0.39, -3.1)] {
            let rotation = camera_from_object(o, p, k);
            assert_relative_eq!(rotation.matrix().transpose(), printed(o, p, k), epsilon = 1e-14);
            for (angle, expected) in angles(&rotation).into_iter().zip([o, p, k]) {
                assert_relative_eq!(angle, expected, epsilon = 1e-12);
            }
        }
    }

    #[test]
    fn an_image_that_looks_down_with_its_top_to_the_north_has_the_identity() {
        assert_relative_eq!(*camera_from_object(0.0, 0.0, 0.0).matrix(), Matrix3::identity());
    }

    #[test]
    fn differentials_of_the_angles_agree_with_finite_differences() {
        let rotation = camera_from_object(0.21, -0.33, 2.2);
        let jacobian = angles_by_theta(&rotation).unwrap();
        let step = 1e-6;
        for axis in 0..3 {
            let theta = Vector3::ith(axis, step);
            let (plus, minus) = (angles(&turned(&rotation, theta)), angles(&turned(&rotation, -theta)));
            for angle in 0..3 {
                let numeric = (plus[angle] - minus[angle]) / (2.0 * step);
                assert_relative_eq!(jacobian[(angle, axis)], numeric, epsilon = 1e-7);
            }
        }
    }
}
