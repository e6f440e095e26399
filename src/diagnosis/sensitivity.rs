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

/// The sensitivities of an orientation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sensitivities {
    /// To single control points, in their order.
    pub single: Vec<GroundSensitivity<1>>,
    /// To pairs of them.
    pub pairs: Vec<GroundSensitivity<2>>,
    /// Control points that take part and that the others do not predict: nothing checks them.
    pub unchecked: Vec<[usize; 1]>,
    /// Pairs of which that is true.
    pub unchecked_pairs: Vec<[usize; 2]>,
}

impl Sensitivities {
    /// Of all control points and of all pairs.
    #[must_use]
    pub fn of(reliability: &Reliability, ground: &[GroundPoint]) -> Self {
        let count = reliability.count();
        let (single, unchecked) = of_groups((0..count).map(|k| [k]), reliability, ground);
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
        let (pairs, unchecked_pairs) = of_groups(pairs, reliability, ground);
        Self { single, pairs, unchecked, unchecked_pairs }
    }
}

/// The sensitivities to groups, and those that nothing checks.
fn of_groups<const MEMBERS: usize>(
    groups: impl Iterator<Item = [usize; MEMBERS]>,
    reliability: &Reliability,
    ground: &[GroundPoint],
) -> (Vec<GroundSensitivity<MEMBERS>>, Vec<[usize; MEMBERS]>) {
    let (mut checked, mut unchecked) = (Vec::new(), Vec::new());
    for members in groups.filter(|members| reliability.informs(members)) {
        match reliability.of(&members).and_then(|sensitivity| on_ground(members, &sensitivity, ground)) {
            Some(sensitivity) => checked.push(sensitivity),
            None => unchecked.push(members),
        }
    }
    (checked, unchecked)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::{Draws, Linear, observed};
    use approx::assert_relative_eq;
    use nalgebra::{Matrix2, Matrix2x6, Vector3};

    const COUNT: usize = 8;

    /// Two points of the ground that depend on the parameters in some way.
    fn ground(draws: &mut Draws) -> Vec<GroundPoint> {
        (0..2)
            .map(|_| GroundPoint {
                image_px: Vector2::zeros(),
                ground_m: Vector3::zeros(),
                by_parameters: Matrix2x6::from_fn(|_, _| draws.normal()),
            })
            .collect()
    }

    #[test]
    fn the_ground_moves_as_it_does_without_the_control_points() {
        let mut draws = Draws::new(51);
        let (linear, ground) = (Linear::new(&mut draws, COUNT), ground(&mut draws));
        let observed = observed(&mut draws, COUNT);
        let sensitivities = Sensitivities::of(&linear.reliability(&observed), &ground);
        assert_eq!((sensitivities.single.len(), sensitivities.pairs.len()), (COUNT, COUNT * (COUNT - 1) / 2));
        let moved_m = |members: &[usize]| {
            let step = linear.estimate(&observed, members) - linear.estimate(&observed, &[]);
            ground.iter().map(|point| (point.by_parameters * step).norm()).fold(0.0, f64::max)
        };
        for single in &sensitivities.single {
            assert_relative_eq!(single.change_m, moved_m(&single.members), epsilon = 1e-9);
            assert!(single.change_m <= single.empirical_m + 1e-9, "a bound that does not hold");
        }
        for pair in &sensitivities.pairs {
            assert_relative_eq!(pair.change_m, moved_m(&pair.members), epsilon = 1e-9);
            assert!(pair.change_m <= pair.empirical_m + 1e-9);
        }
    }

    #[test]
    fn what_the_test_hardly_finds_moves_the_ground_to_the_theoretical_bound_at_most() {
        let mut draws = Draws::new(52);
        let (linear, ground) = (Linear::new(&mut draws, COUNT), ground(&mut draws));
        let still = vec![Vector2::zeros(); COUNT];
        let reliability = linear.reliability(&still);
        let bound = Sensitivities::of(&reliability, &ground).single[2].theoretical_m;
        let delta_0 = reliability.of(&[2]).unwrap().detectable();
        let weights = reliability.weights.fixed_view::<2, 2>(4, 4).into_owned();
        let mut largest_m: f64 = 0.0;
        for k in 0..360 {
            let angle = f64::from(k).to_radians();
            let towards = Vector2::new(angle.cos(), angle.sin());
            // an error whose non-centrality is just delta_0
            let error = towards * (delta_0 / (towards.dot(&(weights * towards))).sqrt());
            let mut displaced = still.clone();
            displaced[2] = error;
            let step = linear.estimate(&displaced, &[]);
            largest_m = ground.iter().map(|g| (g.by_parameters * step).norm()).fold(largest_m, f64::max);
        }
        assert!(largest_m <= bound * (1.0 + 1e-9) && largest_m > 0.999 * bound, "{largest_m} of {bound}");
    }

    #[test]
    fn a_displaced_control_point_contradicts_and_the_others_do_not() {
        let mut draws = Draws::new(53);
        let (linear, ground) = (Linear::new(&mut draws, 20), ground(&mut draws));
        let mut observed = observed(&mut draws, 20);
        observed[7] += Vector2::new(12.0, -9.0);
        let sensitivities = Sensitivities::of(&linear.reliability(&observed), &ground);
        let worst = sensitivities.single.iter().max_by(|a, b| a.test.total_cmp(&b.test)).unwrap();
        assert!(worst.members == [7] && worst.contradicts);
        assert!((worst.discrepancy_px[0] - Vector2::new(12.0, -9.0)).norm() < 5.0);
    }

    #[test]
    fn control_points_that_the_others_do_not_predict_are_named() {
        let mut draws = Draws::new(54);
        let (linear, ground) = (Linear::new(&mut draws, 3), ground(&mut draws));
        let reliability = linear.reliability(&observed(&mut draws, 3));
        let unpredicted = Sensitivities {
            unchecked: vec![[0], [1], [2]],
            unchecked_pairs: vec![[0, 1], [0, 2], [1, 2]],
            ..Sensitivities::default()
        };
        assert_eq!(Sensitivities::of(&reliability, &ground), unpredicted);
        let mut silent = reliability;
        silent.own[1] = Matrix2::zeros();
        assert_eq!(Sensitivities::of(&silent, &ground).unchecked, [[0], [2]]);
    }
}
