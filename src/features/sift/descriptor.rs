//! The descriptor: 4 × 4 histograms of 8 directions (Lowe 2004, section 6).

use super::gradient::{LANES, Level, WHOLE, falling, index};

/// Histograms along a side, and directions in each.
const SIDE: usize = 4;
const DIRECTIONS: usize = 8;
/// Side of the square of one histogram, in units of the key point's scale.
const WIDTH_SCALES: f64 = 3.0;
/// Largest part of the length that one number may have before it is normalised again.
const LARGEST: f32 = 0.2;
/// Length of the descriptor as stored.
const LENGTH: f32 = 512.0;

/// Places of a histogram: the directions, and one for a whole turn. Even, so that pairs are aligned alike.
const PLACES: usize = DIRECTIONS + 2;
/// Histograms along a side with those about the rim, into which half of the outermost gradients goes.
const SIDE_WITH_RIM: usize = SIDE + 2;

/// A gradient histogram around a key point, quantised: its length is about 512, each number at most 255.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Descriptor(
    /// By row, column and direction, in the frame of the key point: the direction from its orientation towards −y.
    pub [u8; SIDE * SIDE * DIRECTIONS],
);

impl std::fmt::Debug for Descriptor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.as_slice().fmt(f)
    }
}

/// Square, rotated and interpolated into.
struct Frame {
    x: f32,
    y: f32,
    /// A step of one cell, in units of the side of a histogram and along the orientation.
    cos: f32,
    sin: f32,
    turn: f32,
}

/// Sums by histogram and direction; more than there are places, so that no index need be checked.
type Sums = [f32; 640];

/// The descriptor at (`x`, `y`) of a level, from the middle of the first cell, `scale` in cells.
pub(super) fn descriptor(level: Level<'_>, x: f64, y: f64, scale: f64, orientation_rad: f64) -> Descriptor {
    let width = WIDTH_SCALES * scale;
    let (sin, cos) = orientation_rad.sin_cos();
    let frame = Frame {
        x: x as f32,
        y: y as f32,
        cos: (cos / width) as f32,
        sin: (sin / width) as f32,
        turn: (orientation_rad / std::f64::consts::TAU) as f32,
    };
    let reach = 0.5 * (SIDE as f64 + 1.0) * width * (cos.abs() + sin.abs());
    let first = (y - reach).ceil().max(1.0) as usize;
    let last = ((y + reach).floor() as usize).min(level.height.saturating_sub(2));
    let mut sums: Sums = [0.0; 640];
    for row in first..=last {
        frame.add_row(level, row, &mut sums);
    }
    quantised(&sums)
}

impl Frame {
    /// Columns of a row inside the square, one at each end less or more.
    fn columns(&self, dy: f32, width: usize) -> std::ops::Range<usize> {
        const HALF: f32 = 0.5 * (SIDE as f32 + 1.0);
        let (mut low, mut high) = (1.0 - self.x, width as f32 - 2.0 - self.x);
        for (slope, at) in [(self.cos, dy * self.sin), (-self.sin, dy * self.cos)] {
            if slope.abs() > 1e-6 {
                let ends = [(-HALF - at) / slope, (HALF - at) / slope];
                low = low.max(ends[0].min(ends[1]));
                high = high.min(ends[0].max(ends[1]));
            } else if at.abs() >= HALF {
                return 0..0;
            }
        }
        let (low, high) = ((self.x + low).ceil(), (self.x + high).floor());
        if low > high { 0..0 } else { low as usize..high as usize + 1 }
    }

    #[inline(always)]
    fn add_row(&self, level: Level<'_>, row: usize, sums: &mut Sums) {
        // rims of the square at which rounding may leave it
        const FIRST: f32 = 0.0;
        const BEYOND: f32 = (SIDE_WITH_RIM - 1) as f32;
        let dy = row as f32 - self.y;
        let columns = self.columns(dy, level.width);
        let middle = 0.5 * (SIDE as f32 + 1.0);
        let mut first = columns.start;
        while first < columns.end {
            let gradients = level.gradients(first, row);
            let dx = first as f32 - self.x;
            let mut places = [0.0; LANES];
            let mut parts = [[0.0; LANES]; 4];
            let mut later = [0.0; LANES];
            for k in 0..LANES {
                let dx = dx + k as f32;
                let (u, v) = (dx * self.cos + dy * self.sin, dy * self.cos - dx * self.sin);
                let weight = gradients.size[k] * falling(0.125 * (u * u + v * v));
                let turn = self.turn - gradients.turn[k];
                let turn = if turn < 0.0 { turn + 1.0 } else { turn };
                let (column, of_column) = split((u + middle).clamp(FIRST, BEYOND));
                let (line, of_line) = split((v + middle).clamp(FIRST, BEYOND));
                let (direction, of_direction) = split(turn * DIRECTIONS as f32);
                places[k] = (line * SIDE_WITH_RIM as f32 + column) * PLACES as f32 + direction + WHOLE;
                let lower = weight * of_line;
                let upper = weight - lower;
                parts[1][k] = upper * of_column;
                parts[0][k] = upper - parts[1][k];
                parts[3][k] = lower * of_column;
                parts[2][k] = lower - parts[3][k];
                later[k] = of_direction;
            }
            for k in 0..LANES.min(columns.end - first) {
                let place = index(places[k], 511);
                let offsets = [0, PLACES, SIDE_WITH_RIM * PLACES, (SIDE_WITH_RIM + 1) * PLACES];
                for (part, offset) in parts.iter().zip(offsets) {
                    let next = part[k] * later[k];
                    sums[place + offset] += part[k] - next;
                    sums[place + offset + 1] += next;
                }
            }
            first += LANES;
        }
    }
}

/// Whole and fractional part of a number that is not negative. (Of a whole number it may say that it is one less, and
/// the fraction one: when interpolating, that is the same.)
#[inline(always)]
fn split(value: f32) -> (f32, f32) {
    let whole = ((value - 0.5).max(0.0) + WHOLE) - WHOLE;
    (whole, value - whole)
}

fn quantised(sums: &Sums) -> Descriptor {
    let mut numbers = [0.0_f32; SIDE * SIDE * DIRECTIONS];
    for (k, out) in numbers.chunks_exact_mut(DIRECTIONS).enumerate() {
        let start = ((k / SIDE + 1) * SIDE_WITH_RIM + k % SIDE + 1) * PLACES;
        out.copy_from_slice(&sums[start..start + DIRECTIONS]);
        // a whole turn is none
        out[0] += sums[start + DIRECTIONS];
    }
    let length = |numbers: &[f32]| numbers.iter().map(|n| n * n).sum::<f32>().sqrt();
    let largest = LARGEST * length(&numbers);
    numbers.iter_mut().for_each(|n| *n = n.min(largest));
    let factor = LENGTH / length(&numbers).max(f32::MIN_POSITIVE);
    Descriptor(numbers.map(|n| (n * factor).round() as u8))
}
