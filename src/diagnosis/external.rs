//! External evaluation: how far is an orientation from a reference, where it matters, on the ground?

use nalgebra::Vector2;

use super::precision::grid_px;
use crate::geometry::{Camera, ExteriorOrientation};

/// D_max of Förstner and Läbe (equation 3): the largest planimetric distance, over a 3 x 3 grid of image points, of the
/// points in which the rays of both orientations meet the horizontal plane at `ground_height_m`. Both orientations and
/// the height are in one local tangent plane.
///
/// `None` if no ray of the true orientation meets the plane; infinite if one does where the estimate's does not.
#[must_use]
pub fn d_max_m(
    camera: &Camera,
    estimate: &ExteriorOrientation,
    truth: &ExteriorOrientation,
    ground_height_m: f64,
) -> Option<f64> {
    let distance = |pixel: Vector2<f64>| {
        let reduced = camera.reduced_from_pixel(pixel)?;
        let ground = |o: &ExteriorOrientation| o.ground_point_m(camera.principal_distance_px, reduced, ground_height_m);
        let true_point = ground(truth)?;
        Some(ground(estimate).map_or(f64::INFINITY, |point| (point - true_point).xy().norm()))
    };
    grid_px(camera).into_iter().filter_map(distance).reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Brown, rotation};
    use approx::assert_relative_eq;
    use nalgebra::Vector3;

    const C: f64 = 2600.0;

    fn camera() -> Camera {
        Camera::new([3000, 2000], C, Vector2::new(1500.0, 1000.0), Brown::default()).unwrap()
    }

    fn looking(centre_m: [f64; 3], omega: f64, phi: f64, kappa: f64) -> ExteriorOrientation {
        ExteriorOrientation {
            projection_centre_m: Vector3::from(centre_m),
            camera_from_object: rotation::camera_from_object(omega, phi, kappa),
        }
    }

    #[test]
    fn agrees_with_what_a_nadir_image_shows() {
        let truth = looking([10.0, 20.0, 300.0], 0.0, 0.0, 0.0);
        let d_max = |estimate| d_max_m(&camera(), &estimate, &truth, 100.0).unwrap();
        assert_eq!(d_max(truth), 0.0);
        // a shift moves all rays alike
        assert_relative_eq!(d_max(looking([13.0, 16.0, 300.0], 0.0, 0.0, 0.0)), 5.0, epsilon = 1e-9);
        // a height scales the picture: the corner of the grid is at 0.45 of both sides, 200 m above the plane
        let corner = (0.45_f64 * 3000.0).hypot(0.45 * 2000.0) / C;
        assert_relative_eq!(d_max(looking([10.0, 20.0, 302.0], 0.0, 0.0, 0.0)), 2.0 * corner, epsilon = 1e-9);
        // a turn moves that corner along a circle
        let chord = 2.0 * (0.005_f64).sin() * 200.0 * corner;
        assert_relative_eq!(d_max(looking([10.0, 20.0, 300.0], 0.0, 0.0, 0.01)), chord, epsilon = 1e-9);
        // a tilt about the x axis moves the middle by height times tangent, and the far rim farther
        assert!(d_max(looking([10.0, 20.0, 300.0], 0.01, 0.0, 0.0)) > 200.0 * (0.01_f64).tan());
    }

    #[test]
    fn rays_into_the_sky_are_left_out_of_the_truth_but_not_forgiven_to_the_estimate() {
        let down = looking([0.0, 0.0, 300.0], 0.0, 0.0, 0.0);
        let up = looking([0.0, 0.0, 300.0], std::f64::consts::PI, 0.0, 0.0);
        assert_eq!(d_max_m(&camera(), &down, &up, 100.0), None);
        assert_eq!(d_max_m(&camera(), &up, &down, 100.0), Some(f64::INFINITY));
    }

    #[test]
    fn rays_obey_the_distortion() {
        let bent = Brown { k1: -0.1, ..Brown::default() };
        let bent_camera = Camera::new([3000, 2000], C, Vector2::new(1500.0, 1000.0), bent).unwrap();
        let (truth, higher) = (looking([0.0, 0.0, 200.0], 0.0, 0.0, 0.0), looking([0.0, 0.0, 201.0], 0.0, 0.0, 0.0));
        let straight = d_max_m(&camera(), &higher, &truth, 0.0).unwrap();
        // barrel distortion: the same pixel looks farther outwards
        let pixel = Vector2::new(0.05 * 3000.0, 0.05 * 2000.0);
        let expected = bent_camera.ideal_from_pixel(pixel).unwrap().norm();
        assert!(expected > straight);
        assert_relative_eq!(d_max_m(&bent_camera, &higher, &truth, 0.0).unwrap(), expected, epsilon = 1e-9);
    }
}
