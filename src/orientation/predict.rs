//! Where in the image are the control points expected? The approximate orientation with its covariance, carried
//! through to a search region for each control point.

use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2, Vector3};

use super::ControlPoint;
use crate::estimation::Prior;
use crate::geometry::{Camera, ExteriorOrientation, Segment2, rotation};

/// What is known of the orientation beforehand, in the local tangent plane at the approximate position.
#[derive(Debug, Clone, PartialEq)]
pub struct Approximation {
    /// Projection centre and rotation (kappa is arbitrary where `sigma_kappa_rad` is `None`).
    pub orientation: ExteriorOrientation,
    /// Standard deviations of the projection centre, east, north, up.
    pub sigma_position_m: [f64; 3],
    /// Standard deviation of omega and of phi.
    pub sigma_tilt_rad: f64,
    /// Standard deviation of kappa; `None`: nothing is known, the whole circle is searched.
    pub sigma_kappa_rad: Option<f64>,
}

/// A heading of which nothing is known enters with the standard deviation of a uniform distribution on the circle.
const SIGMA_UNKNOWN_KAPPA_RAD: f64 = std::f64::consts::PI / 1.732_050_807_568_877_2;

impl Approximation {
    /// As an observation of the six parameters; `None` for angles at which omega, phi and kappa fail.
    #[must_use]
    pub fn prior(&self) -> Option<Prior> {
        let tilt = self.sigma_tilt_rad.powi(2);
        let kappa = self.sigma_kappa_rad.unwrap_or(SIGMA_UNKNOWN_KAPPA_RAD).powi(2);
        let theta_by_angles = rotation::angles_by_theta(&self.orientation.camera_from_object)?.try_inverse()?;
        let theta = theta_by_angles * Matrix3::from_diagonal(&Vector3::new(tilt, tilt, kappa)) * theta_by_angles.transpose();
        let mut information = Matrix6::zeros();
        for (k, sigma) in self.sigma_position_m.iter().enumerate() {
            information[(k, k)] = sigma.powi(-2);
        }
        information.fixed_view_mut::<3, 3>(3, 3).copy_from(&theta.try_inverse()?);
        Some(Prior { orientation: self.orientation, information })
    }
}

/// An orientation with its covariance, good for predicting.
#[derive(Debug, Clone, PartialEq)]
pub struct Prediction {
    /// The orientation.
    pub orientation: ExteriorOrientation,
    /// Covariance of `[dX0, theta]`.
    pub covariance: Matrix6<f64>,
}

impl Prediction {
    /// The image of a point in reduced pixels with its covariance; `None` behind the camera.
    #[must_use]
    pub fn image_of(&self, camera: &Camera, point_m: Vector3<f64>, sigma_m: f64) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let c = camera.principal_distance_px;
        let (image, jacobian) = self.orientation.reduced_px_with_jacobian(c, point_m)?;
        let depth_m = -self.orientation.camera_coordinates(point_m).z;
        let own = (sigma_m * c / depth_m).powi(2);
        Some((image, jacobian * self.covariance * jacobian.transpose() + Matrix2::identity() * own))
    }
}

/// Whether a reduced image point falls on the frame, widened by a margin in pixels.
#[must_use]
pub fn on_frame(camera: &Camera, reduced_px: Vector2<f64>, margin_px: f64) -> bool {
    // far outside, the polynomial of the distortion would bring points back
    reduced_px.norm() < 1.2 * camera.frame_radius_px() + margin_px
        && camera.contains(camera.pixel_from_reduced(reduced_px), margin_px)
}

/// The edges of a control point in reduced pixels, one for each edge that lies before the camera; an edge whose middle
/// is not on the frame, or that lies behind the camera, is a point without length where `keep_places` is set and left
/// out where it is not.
#[must_use]
pub fn edges_px(camera: &Camera, orientation: &ExteriorOrientation, control_point: &ControlPoint, keep_places: bool) -> Vec<Segment2> {
    let c = camera.principal_distance_px;
    let edges = control_point.edges_m.iter().filter_map(|edge| {
        let seen = orientation.reduced_px(c, edge.start).zip(orientation.reduced_px(c, edge.end));
        let seen = seen.map(|(start, end)| Segment2 { start, end }).filter(|e| on_frame(camera, e.midpoint(), 0.0));
        let nowhere = Segment2 { start: Vector2::zeros(), end: Vector2::zeros() };
        seen.or(keep_places.then_some(nowhere))
    });
    edges.collect()
}
