//! What the tests of this room and of those above it draw from.

use nalgebra::{Matrix6, Vector2, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::PointObservation;
use crate::geometry::{ExteriorOrientation, rotation};

/// Draws that are the same on every machine.
pub(crate) struct Draws(ChaCha8Rng);

impl Draws {
    pub(crate) fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    /// Evenly distributed between two bounds.
    pub(crate) fn even(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    /// A whole number below `bound`.
    pub(crate) fn below(&mut self, bound: usize) -> usize {
        self.0.random_range(0..bound)
    }

    /// A standard normal deviate, by Box and Muller.
    pub(crate) fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.even(0.0, 1.0)).ln()).sqrt() * self.even(0.0, std::f64::consts::TAU).cos()
    }

    /// A deviate with a given covariance.
    pub(crate) fn normal6(&mut self, covariance: &Matrix6<f64>) -> Vector6<f64> {
        covariance.cholesky().unwrap().l() * Vector6::from_fn(|_, _| self.normal())
    }
}

/// Principal distance of the simulated camera, whose frame is 6000 x 4000 px.
pub(crate) const PRINCIPAL_DISTANCE_PX: f64 = 5000.0;

/// 400 m above the town and a few degrees off the vertical.
pub(crate) fn flight() -> ExteriorOrientation {
    ExteriorOrientation {
        projection_centre_m: Vector3::new(30.0, -20.0, 400.0),
        camera_from_object: rotation::camera_from_object(0.06, -0.04, 1.1),
    }
}

/// Points all over the frame on roofs 0 to 30 m high, measured with `sigma_px`.
pub(crate) fn points(
    draws: &mut Draws,
    at: &ExteriorOrientation,
    count: usize,
    sigma_px: f64,
) -> Vec<PointObservation> {
    let point = |_| {
        let exact = Vector2::new(draws.even(-2900.0, 2900.0), draws.even(-1900.0, 1900.0));
        let object_m = at.ground_point_m(PRINCIPAL_DISTANCE_PX, exact, draws.even(0.0, 30.0)).unwrap();
        let image_px = exact + sigma_px * Vector2::new(draws.normal(), draws.normal());
        PointObservation { object_m, image_px, sigma_px }
    };
    (0..count).map(point).collect()
}
