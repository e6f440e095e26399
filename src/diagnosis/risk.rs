//! How probable is it that the ground is off by more than the user can accept, if the right control points were found?
//!
//! By chance alone, as the covariance has it; and with the possibility that one of the control points is displaced, out
//! of date or taken for something beside it. Then the orientation would be right without that control point, and the
//! discrepancy that it has from all others says how likely that is.

use nalgebra::{Matrix2, Matrix6, Vector2, Vector6};

use super::precision::GroundPoint;
use crate::estimation::Reliability;

/// The share of control points that are displaced although they took part, and by how much: in the simulated images one
/// in twenty is off by 3 px or more.
const DISPLACED_SHARE: f64 = 0.05;
const DISPLACED_PX: f64 = 6.0;
/// The share of pairs that are displaced together: more than by chance, a pair in two hundred.
const DISPLACED_TOGETHER: f64 = 0.005;
/// What is less likely than this changes nothing.
const NEGLIGIBLE: f64 = 1e-5;

/// Probabilities that a planimetric error of the nine points exceeds the tolerance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Risk {
    /// By random errors.
    pub by_chance: f64,
    /// By random errors or by a displaced control point.
    pub with_displacement: f64,
    /// By random errors or by two control points that are displaced together, as neighbours are whose shadows were taken
    /// for them.
    pub with_pair: f64,
}

/// The risk of an orientation with a covariance. `covariance_scale` is the factor by which all covariances of the
/// reliability are too small.
#[must_use]
pub fn risk(reliability: &Reliability, covariance_scale: f64, ground: &[GroundPoint], tolerance_m: f64) -> Risk {
    let covariance = reliability.covariance * covariance_scale;
    let by_chance = exceeding(ground, &Vector6::zeros(), &covariance, tolerance_m);
    // the probability that groups are displaced and that this takes the ground beyond the tolerance
    let displaced = |groups: &[usize], share: f64| {
        let Some(sensitivity) = reliability.of(groups) else {
            // nothing would show it
            return reliability.informs(groups).then_some(share);
        };
        let odds = share / (1.0 - share) * sensitivity.log_ratio_of_displacement(DISPLACED_PX).exp().min(f64::MAX);
        let probability = odds / (1.0 + odds);
        let without = covariance + sensitivity.added_covariance * covariance_scale;
        let matters = probability > NEGLIGIBLE;
        matters.then(|| probability * exceeding(ground, &sensitivity.step, &without, tolerance_m))
    };
    let count = reliability.count();
    let single = (0..count).filter_map(|a| displaced(&[a], DISPLACED_SHARE));
    let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
    let pairs = pairs.filter_map(|pair| displaced(&pair, DISPLACED_TOGETHER));
    let with =
        |risks: &mut dyn Iterator<Item = f64>| 1.0 - risks.fold(1.0 - by_chance, |spared, risk| spared * (1.0 - risk));
    Risk { by_chance, with_displacement: with(&mut { single }), with_pair: with(&mut { pairs }) }
}

/// The probability at the worst of the points, for an error of the parameters with a mean and a covariance.
fn exceeding(ground: &[GroundPoint], mean: &Vector6<f64>, covariance: &Matrix6<f64>, tolerance_m: f64) -> f64 {
    let of_point = |point: &GroundPoint| {
        let j = &point.by_parameters;
        beyond(j * mean, &(j * covariance * j.transpose()), tolerance_m)
    };
    ground.iter().map(of_point).fold(0.0, f64::max)
}

/// Steps across the circle.
const STEPS: usize = 48;

/// The probability that a normal deviate of the plane lies farther than `radius` from the origin.
///
/// Inside the circle it is integrated across the short axis of the ellipse in closed form, and along the long one by
/// the angle under which the circle is seen, in which the integrand is smooth.
fn beyond(mean: Vector2<f64>, covariance: &Matrix2<f64>, radius: f64) -> f64 {
    let (a, b, c) = (covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]);
    if ![a, b, c, mean.x, mean.y, radius].iter().all(|value| value.is_finite()) || radius <= 0.0 {
        return 1.0;
    }
    let (middle, half) = ((a + c) / 2.0, ((a - c) / 2.0).hypot(b));
    // beyond sixteen standard deviations there is nothing, and the steps must see the ellipse
    let least = radius / 16.0;
    let [long, short] = [middle + half, middle - half].map(|variance| variance.max(least * least).sqrt());
    let axis = Vector2::new(b, middle + half - a).try_normalize(1e-9 * middle);
    let axis = axis.unwrap_or(if a >= c { Vector2::x() } else { Vector2::y() });
    let (along, across) = (axis.dot(&mean), axis.perp(&mean));
    let upper_tail = |z: f64| 0.5 * libm::erfc(z * std::f64::consts::FRAC_1_SQRT_2);
    let within = |low: f64, high: f64| {
        // by the tails on the same side, so that small probabilities keep their digits
        if low > 0.0 { upper_tail(low) - upper_tail(high) } else { upper_tail(-high) - upper_tail(-low) }
    };
    let step = std::f64::consts::PI / STEPS as f64;
    let inside = |k: usize| {
        let angle = -std::f64::consts::FRAC_PI_2 + (k as f64 + 0.5) * step;
        let (place, chord) = (radius * angle.sin(), radius * angle.cos());
        let z = (place - along) / long;
        let density = (-z * z / 2.0).exp() / (long * std::f64::consts::TAU.sqrt());
        step * chord * density * within((-chord - across) / short, (chord - across) / short)
    };
    (1.0 - (0..STEPS).map(inside).sum::<f64>()).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    #[test]
    fn a_round_deviate_is_rayleighs() {
        for ratio in [0.1, 1.0, 2.0, 3.0, 4.0, 5.0] {
            let found = beyond(Vector2::zeros(), &(Matrix2::identity() * 4.0), 2.0 * ratio);
            let exact = (-ratio * ratio / 2.0_f64).exp();
            assert!((found / exact - 1.0).abs() < 1e-3, "{ratio}: {found} instead of {exact}");
        }
    }

    #[test]
    fn it_is_the_share_of_drawn_deviates() {
        let mut draws = Draws::new(41);
        for _ in 0..20 {
            let root = Matrix2::from_fn(|_, _| draws.normal());
            let mean = Vector2::new(draws.normal(), draws.normal());
            let radius = draws.even(0.5, 4.0);
            let runs = 20_000;
            let outside = (0..runs)
                .filter(|_| (mean + root * Vector2::new(draws.normal(), draws.normal())).norm() > radius)
                .count();
            let (share, found) = (outside as f64 / f64::from(runs), beyond(mean, &(root * root.transpose()), radius));
            assert!((share - found).abs() < 0.015, "{found} instead of {share}");
        }
    }

    #[test]
    fn degenerate_deviates_have_a_probability_too() {
        assert!(beyond(Vector2::new(3.0, 0.0), &Matrix2::zeros(), 2.0) > 1.0 - 1e-9);
        assert!(beyond(Vector2::new(1.0, 0.0), &Matrix2::zeros(), 2.0) < 1e-6);
        let line = Matrix2::new(1.0, 1.0, 1.0, 1.0);
        assert!((beyond(Vector2::zeros(), &line, 2.0_f64.sqrt()) - 0.3173).abs() < 0.03);
        assert_eq!(beyond(Vector2::zeros(), &Matrix2::from_element(f64::NAN), 1.0), 1.0);
        assert_eq!(beyond(Vector2::new(f64::INFINITY, 0.0), &Matrix2::identity(), 1.0), 1.0);
    }
}
