//! Do the control points lie well? The precision that they give, against that of four in the corners of the image
//! (method 1.6).

use nalgebra::{Matrix6, SymmetricEigen};

use crate::estimation::resection::equations;
use crate::estimation::{PointObservation, Prior};
use crate::geometry::{Camera, ExteriorOrientation};

/// How far inside the frame the reference points lie, as a share of width and height: up to the rim the distortion
/// is calibrated, not beyond.
const MARGIN: f64 = 0.01;

/// The reference: the covariance of `[dX0, theta]` if four control points on the horizontal plane at
/// `ground_height_m` were measured in the corners of the image with `sigma_px`, beside the prior if there is one. It
/// says nothing unless the covariance that is held against it assumes the same `sigma_px` and prior.
///
/// `None` if a corner does not look at that plane, or the four do not determine the orientation.
#[must_use]
pub fn reference_covariance(
    camera: &Camera,
    orientation: &ExteriorOrientation,
    ground_height_m: f64,
    sigma_px: f64,
    prior: Option<&Prior>,
) -> Option<Matrix6<f64>> {
    let c = camera.principal_distance_px;
    let shares = [(MARGIN, MARGIN), (1.0 - MARGIN, MARGIN), (1.0 - MARGIN, 1.0 - MARGIN), (MARGIN, 1.0 - MARGIN)];
    let corner = |(across, down): (f64, f64)| {
        let image_px = camera.reduced_from_pixel(camera.frame_px(across, down))?;
        let object_m = orientation.ground_point_m(c, image_px, ground_height_m)?;
        Some(PointObservation { object_m, image_px, sigma_px })
    };
    let corners: Vec<PointObservation> = shares.into_iter().map(corner).collect::<Option<_>>()?;
    equations(&corners, prior, orientation, c)?.inverse()
}

const MOST_ITERATIONS: usize = 1000;

/// The largest ratio, over all functions of the parameters, of their variances under both covariances: the largest
/// eigenvalue of `estimated * reference^-1`. It does not depend on units or on the choice of parameters.
///
/// `None` if one of the two is not a covariance: not finite or not positive definite.
#[must_use]
pub fn lambda_max(estimated: &Matrix6<f64>, reference: &Matrix6<f64>) -> Option<f64> {
    let variances = reference.diagonal();
    if !variances.iter().all(|v| v.is_finite() && *v > 0.0) {
        return None;
    }
    // metres and radians differ by orders of magnitude
    let scale = Matrix6::from_diagonal(&variances.map(|v| 1.0 / v.sqrt()));
    let (estimated, reference) = (scale * estimated * scale, scale * reference * scale);
    estimated.cholesky()?;
    let factor = reference.cholesky()?.l();
    let half = factor.solve_lower_triangular(&estimated)?;
    let ratio = factor.solve_lower_triangular(&half.transpose())?;
    let symmetric = (ratio + ratio.transpose()) / 2.0;
    // no iteration ends on what is not a number
    if !symmetric.iter().all(|v| v.is_finite()) {
        return None;
    }
    let eigen = SymmetricEigen::try_new(symmetric, f64::EPSILON, MOST_ITERATIONS)?;
    Some(eigen.eigenvalues.max()).filter(|largest| largest.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::{Draws, flight, points};
    use crate::geometry::Brown;
    use approx::assert_relative_eq;
    use nalgebra::{Vector2, Vector3, Vector6};

    fn camera() -> Camera {
        Camera::new([6000, 4000], 5000.0, Vector2::new(3000.0, 2000.0), Brown::default()).unwrap()
    }

    fn reference() -> Matrix6<f64> {
        reference_covariance(&camera(), &flight(), 0.0, 1.0, None).unwrap()
    }

    /// A covariance of metres and radians, without structure.
    fn covariance(draws: &mut Draws) -> Matrix6<f64> {
        let units = Matrix6::from_diagonal(&Vector6::new(0.3, 0.2, 0.1, 5e-4, 7e-4, 2e-4));
        let mixed = units * Matrix6::from_fn(|_, _| draws.normal());
        mixed * mixed.transpose() + units * units * 0.01
    }

    #[test]
    fn equal_covariances_have_1_and_multiples_their_factor() {
        let reference = reference();
        assert_relative_eq!(lambda_max(&reference, &reference).unwrap(), 1.0, epsilon = 1e-9);
        assert_relative_eq!(lambda_max(&(7.5 * reference), &reference).unwrap(), 7.5, epsilon = 1e-8);
    }

    #[test]
    fn it_is_the_largest_ratio_of_variances_of_all_directions() {
        let mut draws = Draws::new(1);
        for _ in 0..20 {
            let (estimated, reference) = (covariance(&mut draws), covariance(&mut draws));
            let largest = lambda_max(&estimated, &reference).unwrap();
            let ratio = |f: &Vector6<f64>| f.dot(&(estimated * f)) / f.dot(&(reference * f));
            // climbing from random directions, each in the units of the parameters
            let units = reference.diagonal().map(|v| 1.0 / v.sqrt());
            let (mut best, mut reach) = (Vector6::from_fn(|_, _| draws.normal()).component_mul(&units), 1.0);
            for _ in 0..6000 {
                let size = best.component_div(&units).norm();
                let trial = best + reach * size * Vector6::from_fn(|_, _| draws.normal()).component_mul(&units);
                assert!(ratio(&trial) <= largest * (1.0 + 1e-9));
                if ratio(&trial) > ratio(&best) {
                    best = trial;
                } else {
                    reach = (0.99_f64 * reach).max(1e-3);
                }
            }
            assert_relative_eq!(ratio(&best), largest, max_relative = 0.01);
        }
    }

    #[test]
    fn it_does_not_depend_on_the_parameters() {
        let mut draws = Draws::new(2);
        let (estimated, reference) = (covariance(&mut draws), covariance(&mut draws));
        let before = lambda_max(&estimated, &reference).unwrap();
        let units = Matrix6::from_diagonal(&Vector6::new(1e3, 1.0, 1e-2, 57.3, 200.0, 1.0));
        let other = units * Matrix6::from_fn(|_, _| draws.normal());
        let after = lambda_max(&(other * estimated * other.transpose()), &(other * reference * other.transpose()));
        assert_relative_eq!(after.unwrap(), before, max_relative = 1e-6);
    }

    #[test]
    fn points_on_one_side_are_worse_than_the_corners_and_many_all_over_better() {
        let ratio = |points: &[PointObservation]| {
            let estimated = equations(points, None, &flight(), 5000.0).unwrap().inverse().unwrap();
            lambda_max(&estimated, &reference()).unwrap()
        };
        let all_over = points(&mut Draws::new(3), &flight(), 200, 1.0);
        let one_side: Vec<_> = all_over.iter().copied().filter(|p| p.image_px.x > 1500.0).collect();
        assert!(ratio(&all_over) < 1.0, "{}", ratio(&all_over));
        assert!(ratio(&one_side[..5]) > 10.0, "{}", ratio(&one_side[..5]));
    }

    #[test]
    fn a_prior_bounds_the_reference() {
        let tight = Prior { orientation: flight(), information: Matrix6::identity() * 1e12 };
        let with_prior = reference_covariance(&camera(), &flight(), 0.0, 1.0, Some(&tight)).unwrap();
        assert!(lambda_max(&with_prior, &reference()).unwrap() < 1.0);
        assert!(with_prior.diagonal().max() < 1.0001e-12);
    }

    #[test]
    fn a_corner_that_sees_the_sky_leaves_no_reference() {
        let mut tilted = flight();
        tilted.camera_from_object = crate::geometry::rotation::camera_from_object(1.4, 0.0, 0.0);
        assert!(reference_covariance(&camera(), &tilted, 0.0, 1.0, None).is_none());
        let mut below = flight();
        below.projection_centre_m = Vector3::new(0.0, 0.0, -10.0);
        assert!(reference_covariance(&camera(), &below, 0.0, 1.0, None).is_none());
    }

    #[test]
    fn what_is_no_covariance_gives_nothing() {
        let good = reference();
        let not_a_number = Matrix6::from_element(f64::NAN);
        let mut one_missing = good;
        one_missing[(2, 4)] = f64::NAN;
        one_missing[(4, 2)] = f64::NAN;
        let singular = Matrix6::from_element(1.0);
        for bad in [not_a_number, one_missing, singular, -good, Matrix6::zeros(), good * f64::INFINITY] {
            assert_eq!(lambda_max(&bad, &good), None);
            assert_eq!(lambda_max(&good, &bad), None);
        }
    }
}
