//! Nearest neighbours among descriptors (Lowe 2004, section 7.1), by looking at all of them.

use super::{Descriptor, KeyPoint};

const NUMBERS: usize = 128;
/// Descriptors that are compared with another at once, so that it is fetched once for all.
const TOGETHER: usize = 4;
/// As many stay in the first cache.
const TILE: usize = 64;

/// A pair of key points whose descriptors are alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Index of the one.
    pub from: usize,
    /// Index of the other.
    pub to: usize,
    /// Euclidean distance of the descriptors, whose lengths are 512.
    pub distance: f32,
    /// That distance over the one to the second nearest.
    pub ratio: f32,
}

/// Squared Euclidean distance of two descriptors.
#[must_use]
pub fn squared_distance(a: &Descriptor, b: &Descriptor) -> u32 {
    let differences = a.0.iter().zip(&b.0).map(|(a, b)| {
        let difference = i32::from(i16::from(*a) - i16::from(*b));
        difference * difference
    });
    differences.sum::<i32>().unsigned_abs()
}

/// Each key point with its nearest in `to`, if that is so much nearer than the second nearest. None if `to` has fewer
/// than two.
#[must_use]
pub fn ratio_matches(from: &[KeyPoint], to: &[KeyPoint], largest_ratio: f32) -> Vec<Match> {
    if to.len() < 2 {
        return Vec::new();
    }
    let (wide_from, wide_to) = (widened(from), widened(to));
    let mut nearest = vec![Nearest::default(); from.len()];
    for (tile, targets) in wide_to.chunks(TILE).enumerate() {
        let (fours, rest) = wide_from.as_chunks::<TOGETHER>();
        let (nearest_of_fours, nearest_of_rest) = nearest.as_chunks_mut::<TOGETHER>();
        for (four, nearest) in fours.iter().zip(nearest_of_fours) {
            look_at(four, targets, tile * TILE, nearest);
        }
        for (one, nearest) in rest.iter().zip(nearest_of_rest) {
            look_at(std::array::from_ref(one), targets, tile * TILE, std::array::from_mut(nearest));
        }
    }
    nearest.iter().enumerate().filter_map(|(from, nearest)| nearest.matched(from, largest_ratio)).collect()
}

/// A descriptor in the numbers that are multiplied, where they can be fetched eight at a time.
#[derive(Clone, Copy)]
#[repr(align(16))]
struct Wide {
    numbers: [i16; NUMBERS],
    squared: i32,
}

fn widened(points: &[KeyPoint]) -> Vec<Wide> {
    let wide = |point: &KeyPoint| {
        let numbers = point.descriptor.0.map(i16::from);
        Wide { numbers, squared: dot(&numbers, &numbers) }
    };
    points.iter().map(wide).collect()
}

/// Eight sums side by side: so the compiler finds the instruction that multiplies and adds neighbours.
#[inline(always)]
fn dot(a: &[i16; NUMBERS], b: &[i16; NUMBERS]) -> i32 {
    let mut sums = [0_i32; 8];
    for (a, b) in a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0) {
        for k in 0..8 {
            sums[k] += i32::from(a[k]) * i32::from(b[k]);
        }
    }
    sums.iter().sum()
}

/// Squared distances of the nearest and the second nearest.
#[derive(Clone, Copy)]
struct Nearest {
    to: usize,
    squared: [i32; 2],
}

impl Default for Nearest {
    fn default() -> Self {
        Self { to: 0, squared: [i32::MAX; 2] }
    }
}

impl Nearest {
    fn see(&mut self, to: usize, squared: i32) {
        if squared < self.squared[0] {
            *self = Self { to, squared: [squared, self.squared[0]] };
        } else if squared < self.squared[1] {
            self.squared[1] = squared;
        }
    }

    fn matched(&self, from: usize, largest_ratio: f32) -> Option<Match> {
        let [distance, second] = self.squared.map(|squared| (squared as f32).sqrt());
        // two that are both the same as this one tell nothing
        let ratio = if second > 0.0 { distance / second } else { 1.0 };
        (ratio <= largest_ratio).then_some(Match { from, to: self.to, distance, ratio })
    }
}

/// Compares `N` with each of a tile, the first of which has the index `first`.
#[inline(always)]
fn look_at<const N: usize>(these: &[Wide; N], targets: &[Wide], first: usize, nearest: &mut [Nearest; N]) {
    for (k, target) in targets.iter().enumerate() {
        for (nearest, this) in nearest.iter_mut().zip(these) {
            let product = dot(&this.numbers, &target.numbers);
            nearest.see(first + k, this.squared + target.squared - 2 * product);
        }
    }
}
