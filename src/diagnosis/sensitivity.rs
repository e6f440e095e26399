//! What do single control points do to the ground (Schickler and Poth 1996, section 5.1; method 1.9)? All bounds are
//! planimetric distances at the nine points of the ground, the worst of them.

use nalgebra::{Matrix6, Vector2};

use super::precision::GroundPoint;
use crate::estimation::{Reliability, Sensitivity, largest_sigma};

/// How the ground depends on one control point, or on two together.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundSensitivity<const MEMBERS: usize> {
    /// The control points, as places in the order of the reliability's groups.
    pub members: [usize; MEMBERS],
    /// How far each is in the image from where all others expect it.
    pub discrepancy_px: [Vector2<f64>; MEMBERS],
    /// The squared discrepancy in units of its covariance, T: chi-square with two degrees of freedom a member.
    pub test: f64,
    /// Whether chance hardly explains that (0.1 %).
    pub contradicts: bool,
    /// So far the ground would move if they were left out.
    pub change_m: f64,
    /// Empirical sensitivity: what the discrepancy can have done to any function of the ground point, at most.
    pub empirical_m: f64,
    /// Theoretical sensitivity: what an error that the test does not show (80 %) can do.
    pub theoretical_m: f64,
}

/// The sensitivities of an orientation. Control points that the others do not predict at all are left out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sensitivities {
    /// To single control points, in their order.
    pub single: Vec<GroundSensitivity<1>>,
    /// To pairs of them.
    pub pairs: Vec<GroundSensitivity<2>>,
}

impl Sensitivities {
    /// Of all control points and of all pairs.
    #[must_use]
    pub fn of(reliability: &Reliability, ground: &[GroundPoint]) -> Self {
        let count = reliability.count();
        let on_ground = |members: [usize; 1]| on_ground(members, &reliability.of(&members)?, ground);
        let of_pair = |members: [usize; 2]| self::on_ground(members, &reliability.of(&members)?, ground);
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
        Self { single: (0..count).filter_map(|k| on_ground([k])).collect(), pairs: pairs.filter_map(of_pair).collect() }
    }
}

fn on_ground<const MEMBERS: usize>(
    members: [usize; MEMBERS],
    sensitivity: &Sensitivity,
    ground: &[GroundPoint],
) -> Option<GroundSensitivity<MEMBERS>> {
    let added_m = worst(ground, |point| largest_sigma_m(point, &sensitivity.added_covariance));
    let pixel = |k: usize| Vector2::new(sensitivity.discrepancy[2 * k], sensitivity.discrepancy[2 * k + 1]);
    let result = GroundSensitivity {
        members,
        discrepancy_px: std::array::from_fn(pixel),
        test: sensitivity.test,
        contradicts: sensitivity.contradicts(),
        change_m: change_m(sensitivity, ground),
        empirical_m: sensitivity.weighted_test.max(0.0).sqrt() * added_m,
        theoretical_m: sensitivity.detectable() * added_m,
    };
    (result.change_m.is_finite() && result.theoretical_m.is_finite()).then_some(result)
}

/// So far the ground moves if the group is left out.
#[must_use]
pub fn change_m(sensitivity: &Sensitivity, ground: &[GroundPoint]) -> f64 {
    worst(ground, |point| (point.by_parameters * sensitivity.step).norm())
}

fn worst(ground: &[GroundPoint], of_point: impl Fn(&GroundPoint) -> f64) -> f64 {
    ground.iter().map(of_point).fold(0.0, f64::max)
}

/// The standard deviation of a ground point in the direction in which it is largest.
fn largest_sigma_m(point: &GroundPoint, covariance: &Matrix6<f64>) -> f64 {
    largest_sigma(&(point.by_parameters * covariance * point.by_parameters.transpose()))
}
