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
