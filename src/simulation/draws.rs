//! Random draws that are the same on every machine: ChaCha8 for the order of things, hashing for texture and noise,
//! and `libm` in place of the platform's mathematics.

use nalgebra::{Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What the draws are for. Each purpose has its own stream, so that more trees do not change the flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    Town = 1,
    Control = 2,
    Flight = 3,
    Approximation = 4,
    ModelErrors = 5,
    Foliage = 6,
    Mixture = 7,
    WildNavigation = 8,
    Strain = 9,
    Tolerance = 10,
    Hostility = 11,
    FilmMixture = 21,
    FilmPlate = 22,
    FilmLaying = 23,
    FilmScanner = 24,
    FilmDirt = 25,
    FilmCorruption = 26,
    FilmContent = 27,
    FilmStrain = 28,
    Terrestrial = 41,
}

/// A stream of draws. A clone of it gives the same draws once more.
#[derive(Clone)]
pub(crate) struct Draws(ChaCha8Rng);

impl Draws {
    pub(crate) fn new(seed: u64, purpose: Purpose) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(purpose as u64);
        Self(generator)
    }

    /// Evenly between two bounds.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Evenly within `±reach`.
    pub(crate) fn within(&mut self, reach: f64) -> f64 {
        self.between(-reach, reach)
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.0.random::<f64>() < probability
    }

    /// A whole number below `bound` (which must not be 0).
    pub(crate) fn below(&mut self, bound: u32) -> u32 {
        self.0.random_range(0..bound)
    }

    /// One of the values.
    pub(crate) fn one_of(&mut self, values: &[f64]) -> f64 {
        let index = (self.0.random::<f64>() * values.len() as f64) as usize;
        values.get(index).copied().unwrap_or_default()
    }

    /// A standard normal deviate, by Box and Muller.
    pub(crate) fn normal(&mut self) -> f64 {
        let above_zero = 1.0 - self.0.random::<f64>();
        let turn = std::f64::consts::TAU * self.0.random::<f64>();
        (-2.0 * libm::log(above_zero)).sqrt() * libm::cos(turn)
    }

    /// A direction in space, all alike.
    pub(crate) fn direction(&mut self) -> Vector3<f64> {
        let z = self.within(1.0);
        let across = (1.0 - z * z).sqrt();
        let east_north = direction(self.between(0.0, std::f64::consts::TAU)) * across;
        Vector3::new(east_north.x, east_north.y, z)
    }

    /// Shuffles, by Fisher and Yates.
    pub(crate) fn shuffle<T>(&mut self, items: &mut [T]) {
        for last in (1..items.len()).rev() {
            items.swap(last, self.below(last as u32 + 1) as usize);
        }
    }
}

/// The unit vector at an angle from the first axis.
pub(crate) fn direction(angle_rad: f64) -> Vector2<f64> {
    Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad))
}

/// A well-mixed number for a cell of a grid.
pub(crate) fn hash(x: i32, y: i32, seed: u32) -> u32 {
    let mut h =
        (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77) ^ seed.wrapping_mul(0xC2B2_AE3D);
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    h ^ (h >> 15)
}

/// The whole number below a value, and what is left of it. (Faster than the function of the processor's library, which
/// is called where the oldest processors have no instruction for it.)
pub(crate) fn floor_and_rest(value: f64) -> (i32, f64) {
    let cut = value as i32;
    let floor = if f64::from(cut) > value { cut - 1 } else { cut };
    (floor, value - f64::from(floor))
}

/// Smooth noise in -1 to 1 with features about one unit wide.
pub(crate) fn value_noise(x: f64, y: f64, seed: u32) -> f32 {
    let ((i, right), (j, down)) = (floor_and_rest(x), floor_and_rest(y));
    let ease = |t: f64| {
        let t = t as f32;
        t * t * (3.0 - 2.0 * t)
    };
    let (right, down) = (ease(right), ease(down));
    let at = |i: i32, j: i32| hash(i, j, seed) as f32 * (2.0 / u32::MAX as f32) - 1.0;
    let top = at(i, j) + right * (at(i + 1, j) - at(i, j));
    let bottom = at(i, j + 1) + right * (at(i + 1, j + 1) - at(i, j + 1));
    top + down * (bottom - top)
}

/// A nearly normal deviate (mean 0, standard deviation 1, never beyond ±3.5) for a pixel: the sum of four even ones.
pub(crate) fn pixel_deviate(x: i32, y: i32, seed: u32) -> f32 {
    let (first, second) = (hash(x, y, seed), hash(y, x, !seed));
    let halves = (first >> 16) + (first & 0xFFFF) + (second >> 16) + (second & 0xFFFF);
    // four even deviates on 0..65536: mean 131070, standard deviation 65536 / sqrt(3)
    (halves as f32 - 131_070.0) / 37_837.23
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_and_sigma(values: &[f64]) -> (f64, f64) {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
    }

    #[test]
    fn both_kinds_of_normal_deviates_have_mean_0_and_sigma_1() {
        let mut draws = Draws::new(3, Purpose::Town);
        let drawn: Vec<f64> = (0..20_000).map(|_| draws.normal()).collect();
        let hashed: Vec<f64> = (0..20_000).map(|i| f64::from(pixel_deviate(i % 141, i / 141, 9))).collect();
        for values in [drawn, hashed] {
            let (mean, sigma) = mean_and_sigma(&values);
            assert!(mean.abs() < 0.03 && (sigma - 1.0).abs() < 0.02, "mean {mean}, sigma {sigma}");
        }
    }

    #[test]
    fn neighbouring_pixels_have_independent_deviates() {
        let product = |dx: i32, dy: i32| {
            let cells = (0..200).flat_map(|y| (0..200).map(move |x| (x, y)));
            cells.map(|(x, y)| pixel_deviate(x, y, 5) * pixel_deviate(x + dx, y + dy, 5)).sum::<f32>() / 40_000.0
        };
        for (dx, dy) in [(1, 0), (0, 1), (1, 1), (1, -1)] {
            assert!(product(dx, dy).abs() < 0.025, "correlation {} at {dx}, {dy}", product(dx, dy));
        }
    }

    #[test]
    fn noise_is_continuous_and_bounded() {
        for step in 0..4000 {
            let x = f64::from(step) * 0.01 - 20.0;
            let here = value_noise(x, 0.3 * x, 7);
            assert!(here.abs() <= 1.0 && (value_noise(x + 1e-4, 0.3 * x, 7) - here).abs() < 1e-3);
        }
    }

    #[test]
    fn streams_of_one_seed_differ() {
        let first = |purpose| Draws::new(11, purpose).between(0.0, 1.0);
        assert!(first(Purpose::Town).to_bits() != first(Purpose::Flight).to_bits());
    }
}
