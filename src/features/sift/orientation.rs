//! Dominant directions of the gradients around a key point (Lowe 2004, section 5).

use super::gradient::{LANES, Level, WHOLE, falling, index};

const BINS: usize = 36;
/// Standard deviation of the weights, in units of the key point's scale, and how many of them the circle reaches.
const WEIGHT_SIGMA: f64 = 1.5;
const REACH_SIGMAS: f64 = 3.0;
/// Further directions must be so strong compared with the strongest.
const LEAST_PEAK: f32 = 0.8;

/// The dominant directions at (`x`, `y`) of a level, from the middle of the first cell, in radians from +x towards +y,
/// 0 to 2π. `scale` in cells.
pub(super) fn orientations(level: Level<'_>, x: f64, y: f64, scale: f64) -> impl Iterator<Item = f64> {
    let smooth = smoothed(&histogram(level, x, y, scale));
    let strongest = smooth.iter().copied().fold(0.0, f32::max);
    (0..BINS).filter_map(move |k| {
        let (before, here, after) = (smooth[(k + BINS - 1) % BINS], smooth[k], smooth[(k + 1) % BINS]);
        if here <= before || here <= after || here < LEAST_PEAK * strongest {
            return None;
        }
        let offset = 0.5 * (before - after) / (before - 2.0 * here + after);
        let turn = ((k as f64 + f64::from(offset)) / BINS as f64).rem_euclid(1.0);
        Some(turn * std::f64::consts::TAU)
    })
}

/// Sizes of gradients by their direction, weighted by a Gaussian about the point; bin k is centred at k/36 of a turn.
fn histogram(level: Level<'_>, x: f64, y: f64, scale: f64) -> [f32; BINS] {
    let sigma = WEIGHT_SIGMA * scale;
    let reach = (REACH_SIGMAS * sigma).round();
    let range = |at: f64, count: usize| {
        let first = (at.round() - reach).max(1.0) as usize;
        first..((at.round() + reach) as usize + 1).min(count.saturating_sub(1))
    };
    let (columns, rows) = (range(x, level.width), range(y, level.height));
    let per_square = (0.5 / (sigma * sigma)) as f32;
    // whole turns have a bin of their own, and the rest is there so that no index need be checked
    let mut bins = [0.0_f32; 64];
    for row in rows {
        let dy = (row as f64 - y) as f32;
        let mut first = columns.start;
        while first < columns.end {
            let gradients = level.gradients(first, row);
            let dx = (first as f64 - x) as f32;
            let (mut weights, mut places) = ([0.0; LANES], [0.0; LANES]);
            for k in 0..LANES {
                let dx = dx + k as f32;
                weights[k] = gradients.size[k] * falling((per_square * (dx * dx + dy * dy)).min(10.0));
                places[k] = gradients.turn[k] * BINS as f32 + WHOLE;
            }
            for k in 0..LANES.min(columns.end - first) {
                bins[index(places[k], 63)] += weights[k];
            }
            first += LANES;
        }
    }
    bins[0] += bins[BINS];
    std::array::from_fn(|k| bins[k])
}

/// After the filter (1 4 6 4 1)/16.
fn smoothed(bins: &[f32; BINS]) -> [f32; BINS] {
    std::array::from_fn(|k| {
        let at = |offset: usize| bins[(k + BINS + offset - 2) % BINS];
        (at(0) + at(4)) * (1.0 / 16.0) + (at(1) + at(3)) * (4.0 / 16.0) + at(2) * (6.0 / 16.0)
    })
}
