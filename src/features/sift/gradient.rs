//! Gradients of a level, eight cells at a time: size and direction.

use super::blur::lanes;
use super::scale_space::Octave;

/// Cells that are computed at once.
pub(super) const LANES: usize = 8;

/// One level of an octave.
#[derive(Clone, Copy)]
pub(super) struct Level<'a> {
    pub(super) values: &'a [f32],
    pub(super) width: usize,
    pub(super) height: usize,
}

/// Sizes (twice the gradient, in grey values per cell) and directions, in turns from +x towards +y, 0 to 1 inclusive.
pub(super) struct Gradients {
    pub(super) size: [f32; LANES],
    pub(super) turn: [f32; LANES],
}

impl<'a> Level<'a> {
    pub(super) fn of(octave: &'a Octave, level: usize) -> Self {
        Self { values: &octave.levels[level], width: octave.width, height: octave.height }
    }

    /// The gradients of the cells from (`x`, `y`) on, neither of which is at the rim.
    #[inline(always)]
    pub(super) fn gradients(&self, x: usize, y: usize) -> Gradients {
        let at = y * self.width + x;
        let right: [f32; LANES] = lanes(self.values, at + 1);
        let left: [f32; LANES] = lanes(self.values, at - 1);
        let below: [f32; LANES] = lanes(self.values, at + self.width);
        let above: [f32; LANES] = lanes(self.values, at - self.width);
        let (mut size, mut turn) = ([0.0; LANES], [0.0; LANES]);
        for k in 0..LANES {
            let (dx, dy) = (right[k] - left[k], below[k] - above[k]);
            size[k] = (dx * dx + dy * dy).sqrt();
            turn[k] = turns(dx, dy);
        }
        Gradients { size, turn }
    }
}

/// The direction of (`x`, `y`) in turns: the arcus tangens by Abramowitz & Stegun 4.4.49, good to 2e-6 turns.
#[inline(always)]
pub(super) fn turns(x: f32, y: f32) -> f32 {
    const PER_RADIAN: f32 = 0.5 / std::f32::consts::PI;
    let (a, b) = (x.abs(), y.abs());
    let (small, large) = if a < b { (a, b) } else { (b, a) };
    let t = small / (large + f32::MIN_POSITIVE);
    let t2 = t * t;
    let poly = 0.999_866 + t2 * (-0.330_299_5 + t2 * (0.180_141 + t2 * (-0.085_133 + t2 * 0.020_835_1)));
    let eighth = PER_RADIAN * t * poly;
    let quarter = if a < b { 0.25 - eighth } else { eighth };
    let half = if x < 0.0 { 0.5 - quarter } else { quarter };
    if y < 0.0 { 1.0 - half } else { half }
}

/// e^−t for 0 ≤ t ≤ 5, good to 1e-3 (there to 1e-4 of one): the power series of a quarter, to the fourth power.
#[inline(always)]
pub(super) fn falling(t: f32) -> f32 {
    let u = 0.125 * t;
    let series = 1.0 - u * (1.0 - u * (0.5 - u * (1.0 / 6.0 - u * (1.0 / 24.0 - u * (1.0 / 120.0)))));
    let fourth = (series * series) * (series * series);
    fourth * fourth
}

/// Adding it to a number from 0 to 2²² leaves the nearest whole number in the lowest bits.
pub(super) const WHOLE: f32 = 8_388_608.0;

/// The lowest bits of a whole number that has had [`WHOLE`] added. (A cast would have to look after NaN and overflow
/// lane by lane.)
#[inline(always)]
pub(super) fn index(whole: f32, mask: u32) -> usize {
    (whole.to_bits() & mask) as usize
}
