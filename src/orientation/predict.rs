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

/// Of 44 images of a consumer drone (`../shared/bench/README.md`) the worst tilt and the worst position were three and
/// three and a half times the median ones.
const ERRING_MORE: f64 = 3.0;
/// A tilt is known if it is stated to be better than this: three times as much is what is stated where it is taken as 0.
const KNOWN_TILT_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// A position is known if it is that of a receiver in the open.
const KNOWN_POSITION_M: f64 = 6.0;

impl Approximation {
    /// As an observation of the six parameters. Where nothing is known of kappa, that of `near` is taken, so that
    /// the way from the one to the other is short enough to be linear. `None` for angles at which omega, phi and
    /// kappa fail.
    #[must_use]
    pub fn prior(&self, near: &ExteriorOrientation) -> Option<Prior> {
        let [omega, phi, kappa] = rotation::angles(&self.orientation.camera_from_object);
        let (kappa, sigma_kappa_rad) = match self.sigma_kappa_rad {
            Some(sigma) => (kappa, sigma),
            None => (rotation::angles(&near.camera_from_object)[2], SIGMA_UNKNOWN_KAPPA_RAD),
        };
        let camera_from_object = rotation::camera_from_object(omega, phi, kappa);
        let theta_by_angles = rotation::angles_by_theta(&camera_from_object)?.try_inverse()?;
        let tilt = self.sigma_tilt_rad.powi(2);
        let of_angles = Matrix3::from_diagonal(&Vector3::new(tilt, tilt, sigma_kappa_rad.powi(2)));
        let theta = theta_by_angles * of_angles * theta_by_angles.transpose();
        let mut information = Matrix6::zeros();
        for (k, sigma) in self.sigma_position_m.iter().enumerate() {
            information[(k, k)] = sigma.powi(-2);
        }
        information.fixed_view_mut::<3, 3>(3, 3).copy_from(&theta.try_inverse()?);
        Some(Prior { orientation: ExteriorOrientation { camera_from_object, ..self.orientation }, information })
    }

    /// The same if it errs three times as much as is stated, as mistaken records and optimistic receivers do; `None`
    /// if it is so vague that this would allow more than an approximation that knows nothing of the tilt.
    #[must_use]
    pub fn erring_more(&self) -> Option<Self> {
        let [east, north, _] = self.sigma_position_m;
        self.sigma_kappa_rad?;
        let known = self.sigma_tilt_rad < KNOWN_TILT_RAD && east.max(north) < KNOWN_POSITION_M;
        known.then(|| self.erring_by(ERRING_MORE))
    }

    /// The same with standard deviations so many times as large.
    #[must_use]
    pub fn erring_by(&self, factor: f64) -> Self {
        Self {
            orientation: self.orientation,
            sigma_position_m: self.sigma_position_m.map(|sigma| factor * sigma),
            sigma_tilt_rad: factor * self.sigma_tilt_rad,
            sigma_kappa_rad: self.sigma_kappa_rad.map(|sigma| factor * sigma),
        }
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
    pub fn image_of(
        &self,
        camera: &Camera,
        point_m: Vector3<f64>,
        sigma_m: f64,
    ) -> Option<(Vector2<f64>, Matrix2<f64>)> {
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

/// The edges of a control point in reduced pixels; `None` for an edge that lies behind the camera.
#[must_use]
pub fn edges_px(
    camera: &Camera,
    orientation: &ExteriorOrientation,
    control_point: &ControlPoint,
) -> Vec<Option<Segment2>> {
    let image = |point| orientation.reduced_px(camera.principal_distance_px, point);
    let edges = control_point.edges_m.iter();
    edges.map(|edge| Some(Segment2 { start: image(edge.start)?, end: image(edge.end)? })).collect()
}

/// The same, cut to what is on the frame; `None` for an edge of which nothing is.
#[must_use]
pub fn edges_on_frame_px(
    camera: &Camera,
    orientation: &ExteriorOrientation,
    control_point: &ControlPoint,
) -> Vec<Option<Segment2>> {
    let edges = edges_px(camera, orientation, control_point).into_iter();
    edges.map(|edge| edge.and_then(|edge| part_on_frame(camera, &edge))).collect()
}

/// Halvings that find a rim to a part in four thousand of an edge.
const HALVINGS: usize = 12;

/// The part of a segment that is on the frame. In reduced pixels the rims of the frame are curved, hence the halving.
fn part_on_frame(camera: &Camera, segment: &Segment2) -> Option<Segment2> {
    let inside = |p: Vector2<f64>| on_frame(camera, p, 0.0);
    let Segment2 { start, end } = *segment;
    if inside(start) && inside(end) {
        return Some(*segment);
    }
    // where both ends are outside, what lies between may still cross the frame
    let between = [0.0, 0.25, 0.5, 0.75, 1.0].map(|share| start.lerp(&end, share));
    let known = *between.iter().filter(|p| inside(**p)).min_by(|a, b| a.norm().total_cmp(&b.norm()))?;
    let rim = |outside: Vector2<f64>| {
        let (mut inner, mut outer) = (known, outside);
        for _ in 0..HALVINGS {
            let middle = (inner + outer) / 2.0;
            if inside(middle) { inner = middle } else { outer = middle }
        }
        inner
    };
    Some(Segment2 {
        start: if inside(start) { start } else { rim(start) },
        end: if inside(end) { end } else { rim(end) },
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::estimation::simulated::Draws;
    use crate::geometry::{Brown, Segment3};

    fn camera() -> Camera {
        Camera::new([4000, 3000], 3000.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap()
    }

    fn approximation() -> Approximation {
        Approximation {
            orientation: ExteriorOrientation {
                projection_centre_m: Vector3::new(10.0, 20.0, 250.0),
                camera_from_object: rotation::camera_from_object(0.15, -0.2, 2.0),
            },
            sigma_position_m: [2.0, 3.0, 4.0],
            sigma_tilt_rad: 0.01,
            sigma_kappa_rad: Some(0.03),
        }
    }

    /// An orientation drawn with the sigmas of the approximation, angle by angle.
    fn drawn(a: &Approximation, draws: &mut Draws) -> ExteriorOrientation {
        let [omega, phi, kappa] = rotation::angles(&a.orientation.camera_from_object);
        let mut error = |sigma: f64| sigma * draws.normal();
        let centre = Vector3::from_iterator(a.sigma_position_m.iter().map(|s| error(*s)));
        let camera_from_object = rotation::camera_from_object(
            omega + error(a.sigma_tilt_rad),
            phi + error(a.sigma_tilt_rad),
            kappa + error(a.sigma_kappa_rad.unwrap()),
        );
        ExteriorOrientation { projection_centre_m: a.orientation.projection_centre_m + centre, camera_from_object }
    }

    #[test]
    fn the_prior_measures_drawn_errors_as_chi_square() {
        const RUNS: u32 = 4000;
        let a = approximation();
        let prior = a.prior(&a.orientation).unwrap();
        let mut draws = Draws::new(3);
        let distances = (0..RUNS).map(|_| {
            let step: Vector6<f64> = drawn(&a, &mut draws).step_to(&prior.orientation);
            step.dot(&(prior.information * step))
        });
        let mean = distances.sum::<f64>() / f64::from(RUNS);
        assert!((mean - 6.0).abs() < 0.25, "{mean}");
    }

    #[test]
    fn the_search_region_is_the_scatter_of_predicted_points() {
        const RUNS: u32 = 4000;
        let (a, camera, point) = (approximation(), camera(), Vector3::new(60.0, -30.0, 12.0));
        let covariance = a.prior(&a.orientation).unwrap().information.try_inverse().unwrap();
        let prediction = Prediction { orientation: a.orientation, covariance };
        let (image, claimed) = prediction.image_of(&camera, point, 0.0).unwrap();
        let mut draws = Draws::new(4);
        let mut scatter = Matrix2::zeros();
        for _ in 0..RUNS {
            let away = drawn(&a, &mut draws).reduced_px(camera.principal_distance_px, point).unwrap() - image;
            scatter += away * away.transpose() / f64::from(RUNS);
        }
        assert!((scatter - claimed).norm() < 0.06 * claimed.norm(), "{scatter} {claimed}");
    }

    #[test]
    fn an_unknown_heading_is_taken_from_the_hypothesis() {
        let a = Approximation { sigma_kappa_rad: None, ..approximation() };
        let near =
            ExteriorOrientation { camera_from_object: rotation::camera_from_object(0.1, 0.1, -1.2), ..a.orientation };
        let [omega, phi, kappa] = rotation::angles(&a.prior(&near).unwrap().orientation.camera_from_object);
        assert!((omega - 0.15).abs() < 1e-9 && (phi + 0.2).abs() < 1e-9 && (kappa + 1.2).abs() < 1e-9);
    }

    #[test]
    fn only_what_is_stated_to_be_good_may_err_more() {
        let stated = approximation();
        let more = stated.erring_more().unwrap();
        assert_eq!(more.orientation, stated.orientation);
        assert_eq!(more.sigma_position_m, [6.0, 9.0, 12.0]);
        assert!((more.sigma_tilt_rad - 0.03).abs() < 1e-12 && (more.sigma_kappa_rad.unwrap() - 0.09).abs() < 1e-12);
        assert_eq!(Approximation { sigma_tilt_rad: 0.06, ..stated.clone() }.erring_more(), None);
        assert_eq!(Approximation { sigma_position_m: [2.0, 15.0, 4.0], ..stated.clone() }.erring_more(), None);
        assert_eq!(Approximation { sigma_kappa_rad: None, ..stated }.erring_more(), None);
    }

    #[test]
    fn a_view_along_the_horizon_has_no_prior() {
        let level = rotation::camera_from_object(0.0, std::f64::consts::FRAC_PI_2, 0.0);
        let orientation = ExteriorOrientation { camera_from_object: level, ..approximation().orientation };
        let a = Approximation { orientation, ..approximation() };
        assert!(a.prior(&orientation).is_none());
    }

    #[test]
    fn only_edges_on_the_frame_are_expected_there() {
        let (a, camera) = (approximation(), camera());
        let below = a.orientation.ground_point_m(3000.0, Vector2::new(0.0, 0.0), 0.0).unwrap();
        let edge = |from: Vector3<f64>| Segment3 { start: from, end: from + Vector3::new(8.0, 0.0, 0.0) };
        let edges_m =
            vec![edge(below), edge(below + Vector3::new(900.0, 0.0, 0.0)), edge(Vector3::new(0.0, 0.0, 300.0))];
        let point = ControlPoint {
            name: "a".into(),
            sigma_m: 0.1,
            reference_m: below,
            edges_m,
            edge_sigmas_m: Vec::new(),
            scene: None,
        };
        let seen = |edges: Vec<Option<Segment2>>| edges.iter().map(Option::is_some).collect::<Vec<_>>();
        assert_eq!(seen(edges_px(&camera, &a.orientation, &point)), [true, true, false]);
        assert_eq!(seen(edges_on_frame_px(&camera, &a.orientation, &point)), [true, false, false]);
    }

    #[test]
    fn edges_are_cut_at_the_rims_of_the_frame() {
        let camera = camera();
        // the frame reaches from -2000 to 2000 and from -1500 to 1500
        let cut = |from: [f64; 2], to: [f64; 2]| {
            part_on_frame(&camera, &Segment2 { start: from.into(), end: to.into() }).map(|part| [part.start, part.end])
        };
        let near = |part: Option<[Vector2<f64>; 2]>, expected: [[f64; 2]; 2]| {
            let part = part.unwrap();
            for (end, expected) in part.iter().zip(expected) {
                assert!((end - Vector2::from(expected)).norm() < 2.0, "{part:?} is not {expected:?}");
            }
        };
        near(cut([0.0, 0.0], [100.0, 50.0]), [[0.0, 0.0], [100.0, 50.0]]);
        near(cut([1900.0, 0.0], [2100.0, 100.0]), [[1900.0, 0.0], [2000.0, 50.0]]);
        near(cut([-2500.0, 10.0], [2500.0, 10.0]), [[-2000.0, 10.0], [2000.0, 10.0]]);
        assert!(cut([2001.0, 0.0], [2500.0, 0.0]).is_none());
    }
}
