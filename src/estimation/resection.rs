//! Spatial resection: the exterior orientation from image points of known object points (method 1.5).

use nalgebra::{Matrix2, Matrix6, Vector2, Vector3};

use super::normal::{NormalEquations, Prior};
use crate::geometry::ExteriorOrientation;

/// An object point that was measured in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointObservation {
    /// The object point.
    pub object_m: Vector3<f64>,
    /// Its image, in reduced pixels.
    pub image_px: Vector2<f64>,
    /// Standard deviation of each image coordinate, that of the object point included.
    pub sigma_px: f64,
}

/// The result of a resection.
#[derive(Debug, Clone, PartialEq)]
pub struct Resection {
    /// The orientation.
    pub orientation: ExteriorOrientation,
    /// Its a-priori covariance, of `[dX0, theta]`.
    pub covariance: Matrix6<f64>,
    /// Weighted sum of squared residuals, those of the prior included.
    pub squares: f64,
    /// Observations less parameters.
    pub redundancy: usize,
}

impl Resection {
    /// The square root of the variance factor; 1 if nothing is redundant.
    #[must_use]
    pub fn sigma0(&self) -> f64 {
        if self.redundancy == 0 { 1.0 } else { (self.squares / self.redundancy as f64).sqrt() }
    }
}

const MOST_STEPS: usize = 12;
/// Steps below this, in units of the parameters' standard deviations, change nothing.
const SMALL_STEP: f64 = 1e-3;

/// Least squares by Gauss and Newton from `start`. `None` if the points leave parameters undetermined, lie behind the
/// camera, or no minimum is reached.
#[must_use]
pub fn resect(
    points: &[PointObservation],
    prior: Option<&Prior>,
    start: &ExteriorOrientation,
    principal_distance_px: f64,
) -> Option<Resection> {
    let mut orientation = *start;
    for _ in 0..MOST_STEPS {
        let equations = equations(points, prior, &orientation, principal_distance_px)?;
        let step = equations.solve()?;
        orientation = orientation.moved(&step);
        // squared length of the step in its own metric
        if step.dot(&(equations.matrix * step)) < SMALL_STEP * SMALL_STEP {
            let last = self::equations(points, prior, &orientation, principal_distance_px)?;
            let observations = 2 * points.len() + if prior.is_some() { 6 } else { 0 };
            return Some(Resection {
                orientation,
                covariance: last.inverse()?,
                squares: last.squares,
                redundancy: observations.checked_sub(6)?,
            });
        }
    }
    None
}

/// The sum of squares that [`resect`] will reach, as its first step foretells: without curvature it would be that. For
/// telling at a fraction of the cost what is hopeless.
#[must_use]
pub fn foretold_squares(
    points: &[PointObservation],
    prior: Option<&Prior>,
    start: &ExteriorOrientation,
    principal_distance_px: f64,
) -> Option<f64> {
    let equations = equations(points, prior, start, principal_distance_px)?;
    Some(equations.squares - equations.solve()?.dot(&equations.right_side))
}

/// The normal equations of all points at an orientation; `None` if one lies behind the camera.
pub(crate) fn equations(
    points: &[PointObservation],
    prior: Option<&Prior>,
    at: &ExteriorOrientation,
    principal_distance_px: f64,
) -> Option<NormalEquations> {
    let mut equations = NormalEquations::new();
    if let Some(prior) = prior {
        equations.add_prior(prior, at);
    }
    for point in points {
        let (image, jacobian) = at.reduced_px_with_jacobian(principal_distance_px, point.object_m)?;
        let weight = Matrix2::identity() / point.sigma_px.powi(2);
        equations.add(&jacobian, &(point.image_px - image), &weight);
    }
    Some(equations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::{Draws, PRINCIPAL_DISTANCE_PX as C, flight, points};
    use approx::assert_relative_eq;
    use nalgebra::Vector6;

    /// Five degrees and fifty metres away.
    fn far_start() -> ExteriorOrientation {
        flight().moved(&Vector6::new(30.0, -35.0, 20.0, 0.05, -0.05, 0.05))
    }

    fn prior(orientation: ExteriorOrientation) -> Prior {
        let sigmas = Vector6::new(0.5, 0.5, 0.8, 1e-3, 1e-3, 2e-3);
        Prior { orientation, information: Matrix6::from_diagonal(&sigmas.map(|s| 1.0 / (s * s))) }
    }

    /// Means over many drawn surveys of the squared Mahalanobis distance of the result from the truth and of the
    /// estimated variance factor, which should be 6 and 1.
    fn claims_held(with_prior: bool) -> (f64, f64) {
        let mut draws = Draws::new(17);
        let runs = 1000;
        let (mut distance, mut factor) = (0.0, 0.0);
        for _ in 0..runs {
            let points = points(&mut draws, &flight(), if with_prior { 5 } else { 9 }, 0.7);
            let prior = with_prior.then(|| {
                let covariance = prior(flight()).information.try_inverse().unwrap();
                prior(flight().moved(&draws.normal6(&covariance)))
            });
            let result = resect(&points, prior.as_ref(), &far_start(), C).unwrap();
            let step = result.orientation.step_to(&flight());
            distance += step.dot(&(result.covariance.try_inverse().unwrap() * step));
            factor += result.sigma0().powi(2);
        }
        (distance / f64::from(runs), factor / f64::from(runs))
    }

    #[test]
    fn what_the_first_step_foretells_comes_true() {
        let mut draws = Draws::new(18);
        for wrong_px in [0.0, 40.0] {
            let mut points = points(&mut draws, &flight(), 6, 0.7);
            points[0].image_px.x += wrong_px;
            let prior = prior(flight());
            let near = flight().moved(&Vector6::new(1.0, -1.0, 1.0, 3e-3, -2e-3, 4e-3));
            let squares = resect(&points, Some(&prior), &near, C).unwrap().squares;
            let foretold = foretold_squares(&points, Some(&prior), &near, C).unwrap();
            assert_relative_eq!(foretold, squares, max_relative = 0.02);
        }
    }

    #[test]
    fn without_noise_the_truth_comes_back() {
        let mut draws = Draws::new(11);
        for _ in 0..50 {
            let exact: Vec<_> = points(&mut draws, &flight(), 7, 0.0)
                .into_iter()
                .map(|point| PointObservation { sigma_px: 0.5, ..point })
                .collect();
            let result = resect(&exact, None, &far_start(), C).unwrap();
            let (found, truth) = (result.orientation, flight());
            assert_relative_eq!(found.projection_centre_m, truth.projection_centre_m, epsilon = 1e-7);
            assert_relative_eq!(found.camera_from_object, truth.camera_from_object, epsilon = 1e-10);
            assert!(result.squares < 1e-12);
            assert_eq!(result.redundancy, 8);
        }
    }

    #[test]
    fn the_claimed_precision_is_the_true_one() {
        for with_prior in [false, true] {
            let (distance, factor) = claims_held(with_prior);
            assert!((distance - 6.0).abs() < 0.35, "prior {with_prior}: squared distance {distance}");
            assert!((factor - 1.0).abs() < 0.07, "prior {with_prior}: variance factor {factor}");
        }
    }

    #[test]
    fn a_prior_alone_gives_itself() {
        let prior = prior(flight());
        let result = resect(&[], Some(&prior), &far_start(), C).unwrap();
        assert_relative_eq!(result.orientation.step_to(&flight()), Vector6::zeros(), epsilon = 1e-9);
        assert_relative_eq!(result.covariance * prior.information, Matrix6::identity(), epsilon = 1e-9);
        assert_eq!((result.redundancy, result.sigma0()), (0, 1.0));
    }

    #[test]
    fn what_is_not_determined_has_no_result() {
        let good = points(&mut Draws::new(12), &flight(), 6, 0.5);
        let on_a_line = |k: f64| PointObservation { object_m: Vector3::new(30.0 * k, 20.0 * k, 10.0), ..good[0] };
        let line: Vec<_> = [-2.0, -1.0, 0.0, 1.0, 2.0, 3.0]
            .into_iter()
            .map(on_a_line)
            .map(|p| PointObservation { image_px: flight().reduced_px(C, p.object_m).unwrap(), ..p })
            .collect();
        let behind = PointObservation { object_m: Vector3::new(0.0, 0.0, 900.0), ..good[0] };
        let one_behind = [&good[..], &[behind]].concat();
        let nowhere = PointObservation { object_m: Vector3::repeat(f64::NAN), ..good[0] };
        let weightless: Vec<_> = good.iter().map(|p| PointObservation { sigma_px: 0.0, ..*p }).collect();
        for points in [&[][..], &good[..2], &[good[0]; 6], &line, &one_behind, &[nowhere; 6], &weightless] {
            assert_eq!(resect(points, None, &flight(), C), None);
        }
    }
}
