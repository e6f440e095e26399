//! The orientation about the axes of a map grid.
//!
//! Software that makes ortho-photos takes a map grid for a Cartesian frame, which it is not: its scale varies, the
//! Earth is curved, and heights have no share in the scale (method 4.6). The orientation that it should be given is the
//! one with which its straight rays meet the ground where the true rays do: the six parameters are fitted to the pixels
//! of ground points at the lowest, the mean and the highest ground, and what remains is told.

use nalgebra::{Matrix6, Rotation3, Vector2, Vector3, Vector6};

use super::photograph::{Photograph, Sight};
use super::{ExportError, Target};
use crate::geometry::{ExteriorOrientation, rotation};

/// An exterior orientation in the coordinates of a target, as if these were Cartesian.
#[derive(Debug, Clone, PartialEq)]
pub struct GridOrientation {
    /// Easting, northing and height of the projection centre.
    pub centre_m: [f64; 3],
    /// Rotation of the grid's axes to the camera frame (x right, y up, z backwards).
    pub camera_from_grid: Rotation3<f64>,
    /// What remains, root mean square over all points and both coordinates.
    pub residual_rms_px: f64,
    /// What remains at the worst point.
    pub residual_max_px: f64,
    /// The same on the ground.
    pub residual_max_m: f64,
}

const STEPS: usize = 12;
const CONVERGED_PX: f64 = 1e-9;

impl GridOrientation {
    /// Fits the orientation of a photograph in the target's coordinates.
    ///
    /// # Errors
    /// [`ExportError`] where the ground is not in view, or the CRS does not reach.
    pub fn fitted(photograph: &Photograph, target: &Target) -> Result<Self, ExportError> {
        let sights = photograph.sights(&photograph.heights_m())?;
        let centre_m = target.position(photograph.centre_geocentric_m)?;
        // far from the origin of the grid, digits would be lost
        let origin_m = Vector3::from(centre_m);
        let points: Vec<(Vector2<f64>, Vector3<f64>)> = sights
            .iter()
            .map(|Sight { pixel, ground_geocentric_m }| {
                let reduced = photograph.camera.reduced_from_pixel(*pixel).ok_or(ExportError::NoFit)?;
                Ok((reduced, Vector3::from(target.position(*ground_geocentric_m)?) - origin_m))
            })
            .collect::<Result<_, ExportError>>()?;
        let axes = target.crs.axes_from_geocentric(photograph.centre_geocentric_m)?;
        let start = ExteriorOrientation {
            projection_centre_m: Vector3::zeros(),
            camera_from_object: photograph.camera_from_geocentric * axes.inverse(),
        };
        let c_px = photograph.camera.principal_distance_px;
        let fitted = adjusted(&points, c_px, start)?;
        let remaining = |(reduced, point): &(Vector2<f64>, Vector3<f64>)| {
            let at = fitted.reduced_px(c_px, *point).ok_or(ExportError::NoFit)?;
            let depth_m = -fitted.camera_coordinates(*point).z;
            Ok(((at - reduced).norm(), (at - reduced).norm() * depth_m / c_px))
        };
        let remaining = points.iter().map(remaining).collect::<Result<Vec<_>, ExportError>>()?;
        let squares: f64 = remaining.iter().map(|(px, _)| px * px).sum();
        Ok(Self {
            centre_m: (origin_m + fitted.projection_centre_m).into(),
            camera_from_grid: fitted.camera_from_object,
            residual_rms_px: (squares / (2.0 * remaining.len() as f64)).sqrt(),
            residual_max_px: remaining.iter().fold(0.0, |most, (px, _)| f64::max(most, *px)),
            residual_max_m: remaining.iter().fold(0.0, |most, (_, m)| f64::max(most, *m)),
        })
    }

    /// omega, phi and kappa in degrees.
    #[must_use]
    pub fn angles_deg(&self) -> [f64; 3] {
        rotation::angles(&self.camera_from_grid).map(f64::to_degrees)
    }

    /// The pixel of a position in the target's coordinates, as software sees it that takes them for Cartesian.
    #[must_use]
    pub fn pixel(&self, photograph: &Photograph, position_m: [f64; 3]) -> Option<Vector2<f64>> {
        let orientation =
            ExteriorOrientation { projection_centre_m: Vector3::zeros(), camera_from_object: self.camera_from_grid };
        orientation.pixel(&photograph.camera, Vector3::from(position_m) - Vector3::from(self.centre_m))
    }
}

/// Gauss-Newton on the collinearity equations: all points weigh the same.
fn adjusted(
    points: &[(Vector2<f64>, Vector3<f64>)],
    c_px: f64,
    start: ExteriorOrientation,
) -> Result<ExteriorOrientation, ExportError> {
    let mut orientation = start;
    for _ in 0..STEPS {
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for (reduced, point) in points {
            let (at, jacobian) = orientation.reduced_px_with_jacobian(c_px, *point).ok_or(ExportError::NoFit)?;
            normal += jacobian.transpose() * jacobian;
            right += jacobian.transpose() * (reduced - at);
        }
        // metres and radians differ by orders of magnitude: the pivots are made alike
        let scale = Vector6::from_fn(|i, _| 1.0 / normal[(i, i)].max(f64::MIN_POSITIVE).sqrt());
        let scaled = Matrix6::from_fn(|i, j| normal[(i, j)] * scale[i] * scale[j]);
        let factor = scaled.cholesky().ok_or(ExportError::NoFit)?;
        let step = factor.solve(&right.component_mul(&scale));
        orientation = orientation.moved(&step.component_mul(&scale));
        // the scaled unknowns are pixels, summed over the points
        if step.norm() < CONVERGED_PX * (points.len() as f64).sqrt() {
            break;
        }
    }
    Ok(orientation)
}
