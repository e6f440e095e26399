//! What the tests of this room and of those above it draw from.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix2x6, Matrix6, Vector2, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{PointObservation, Reliability};
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

/// A linear problem: points at places, two coordinates each, explained by six parameters and observed with a
/// standard deviation of one.
pub(crate) struct Linear {
    pub(crate) designs: Vec<Matrix2x6<f64>>,
}

impl Linear {
    pub(crate) fn new(draws: &mut Draws, count: usize) -> Self {
        Self { designs: (0..count).map(|_| Matrix2x6::from_fn(|_, _| draws.normal())).collect() }
    }

    pub(crate) fn normal(&self, without: &[usize]) -> Matrix6<f64> {
        let used = self.designs.iter().enumerate().filter(|(k, _)| !without.contains(k));
        used.fold(Matrix6::zeros(), |sum, (_, design)| sum + design.transpose() * design)
    }

    pub(crate) fn estimate(&self, observed: &[Vector2<f64>], without: &[usize]) -> Vector6<f64> {
        let used = self.designs.iter().zip(observed).enumerate().filter(|(k, _)| !without.contains(k));
        let side = used.fold(Vector6::zeros(), |sum, (_, (design, observed))| sum + design.transpose() * observed);
        self.normal(without).cholesky().unwrap().solve(&side)
    }

    pub(crate) fn reliability(&self, observed: &[Vector2<f64>]) -> Reliability {
        let (count, estimate) = (self.designs.len(), self.estimate(observed, &[]));
        let covariance = self.normal(&[]).try_inverse().unwrap();
        let mut design = DMatrix::zeros(2 * count, 6);
        let mut right_side = DVector::zeros(2 * count);
        for (k, (own, observed)) in self.designs.iter().zip(observed).enumerate() {
            design.fixed_view_mut::<2, 6>(2 * k, 0).copy_from(own);
            right_side.fixed_rows_mut::<2>(2 * k).copy_from(&(observed - own * estimate));
        }
        let covariance_of_all = DMatrix::from_iterator(6, 6, covariance.iter().copied());
        Reliability {
            covariance,
            weights: DMatrix::identity(2 * count, 2 * count) - &design * &covariance_of_all * design.transpose(),
            right_side,
            influence: covariance_of_all * design.transpose(),
            own: vec![Matrix2::identity(); count],
            excess: vec![0.0; count],
        }
    }
}

/// Observations of points that are where they should be.
pub(crate) fn observed(draws: &mut Draws, count: usize) -> Vec<Vector2<f64>> {
    (0..count).map(|_| Vector2::new(draws.normal(), draws.normal())).collect()
}
