//! Binary correlation: pictures of one bit a cell, 64 cells in one step.
//!
//! A cell is set where it stands out from its surroundings by more than the noise; a homogeneous cell, as of the dark
//! ground, is not. Bright and dark figures have pictures of their own, so that a positive and a negative are looked for
//! in one pass.

use super::template::Template;
use crate::features::GreyWindow;

/// One bit a cell, rows padded to whole words, least significant bit first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Bits {
    width: usize,
    height: usize,
    words: usize,
    rows: Vec<u64>,
}

impl Bits {
    fn new(width: usize, height: usize, set: impl Fn(usize, usize) -> bool) -> Self {
        // a word more than is needed, so that a shifted row can always read on
        let words = width.div_ceil(64) + 1;
        let mut rows = vec![0; words * height];
        for y in 0..height {
            for x in (0..width).filter(|&x| set(x, y)) {
                rows[y * words + x / 64] |= 1 << (x % 64);
            }
        }
        Self { width, height, words, rows }
    }

    fn row(&self, y: usize) -> &[u64] {
        &self.rows[y * self.words..(y + 1) * self.words]
    }
}

/// What stands out in a window: brighter, and darker than around.
#[derive(Debug, Clone)]
pub(super) struct Figures {
    pub(super) bright: Bits,
    pub(super) dark: Bits,
}

/// A template of one bit a cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct BinaryTemplate {
    set: Bits,
    care: Bits,
    set_count: u32,
    care_count: u32,
}

/// A template's figure stands out by this share of its range.
const STANDS_OUT: f32 = 0.1;
/// In the picture by so many sigmas of its noise.
const NOISE_FACTOR: f32 = 3.0;
/// And by so many grey values at least.
const LEAST_GREY: f32 = 1.5;

impl Figures {
    /// Those of a window; `around` is the half side of the surroundings, in cells.
    pub(super) fn of(window: &GreyWindow, around: usize) -> Self {
        let (width, height) = (window.width, window.height);
        let mean = local_mean(&window.grey, width, height, around);
        let margin = (NOISE_FACTOR * noise(window)).max(LEAST_GREY);
        let excess = |x: usize, y: usize| window.grey[y * width + x] - mean[y * width + x];
        Self {
            bright: Bits::new(width, height, |x, y| excess(x, y) > margin),
            dark: Bits::new(width, height, |x, y| excess(x, y) < -margin),
        }
    }
}

impl BinaryTemplate {
    /// Of a template whose values are 0 to 1 or grey values; `None` if nothing in it stands out.
    pub(super) fn of(template: &Template, around: usize) -> Option<Self> {
        let side = template.side();
        let cared = || template.grey.iter().zip(&template.care).filter(|(_, care)| **care).map(|(grey, _)| *grey);
        let (low, high) = cared().fold((f32::MAX, f32::MIN), |(low, high), grey| (low.min(grey), high.max(grey)));
        // what does not count is taken as the middle of what does, so that the rim of the mark does not stand out much
        let middle = cared().sum::<f32>() / template.count().max(1) as f32;
        let filled: Vec<f32> =
            template.grey.iter().zip(&template.care).map(|(grey, care)| if *care { *grey } else { middle }).collect();
        let mean = local_mean(&filled, side, side, around);
        let margin = STANDS_OUT * (high - low);
        let set = Bits::new(side, side, |x, y| {
            let k = y * side + x;
            template.care[k] && filled[k] - mean[k] > margin
        });
        let care = Bits::new(side, side, |x, y| template.care[y * side + x]);
        let count = |bits: &Bits| bits.rows.iter().map(|word| word.count_ones()).sum();
        let (set_count, care_count): (u32, u32) = (count(&set), count(&care));
        (set_count > 0 && set_count < care_count).then_some(Self { set, care, set_count, care_count })
    }

    /// The correlation coefficient where the template's middle cell lies over each cell of the window, row by row;
    /// 0 where the template reaches beyond the window.
    pub(super) fn correlate(&self, bits: &Bits) -> Vec<f32> {
        let mut surface = vec![0.0; bits.width * bits.height];
        let (side, half) = (self.set.height, self.set.height / 2);
        if bits.width < side || bits.height < side {
            return surface;
        }
        for top in 0..=bits.height - side {
            for left in 0..=bits.width - side {
                surface[(top + half) * bits.width + left + half] = self.coefficient(bits, left, top);
            }
        }
        surface
    }

    fn coefficient(&self, bits: &Bits, left: usize, top: usize) -> f32 {
        let (first, shift) = (left / 64, left % 64);
        let words = self.set.words - 1;
        let (mut both, mut set) = (0, 0);
        for y in 0..self.set.height {
            let row = &bits.row(top + y)[first..];
            let (template, care) = (self.set.row(y), self.care.row(y));
            for word in 0..words {
                let low = row[word] >> shift;
                let high = if shift == 0 { 0 } else { row.get(word + 1).map_or(0, |next| next << (64 - shift)) };
                let seen = low | high;
                both += (seen & template[word]).count_ones();
                set += (seen & care[word]).count_ones();
            }
        }
        if set == 0 || set == self.care_count {
            return 0.0;
        }
        let [n, a, b, both] = [self.care_count, self.set_count, set, both].map(f64::from);
        ((n * both - a * b) / (a * (n - a) * b * (n - b)).sqrt()) as f32
    }
}

/// The mean over the square of `2 around + 1` cells; at the rim over what there is of it.
pub(super) fn local_mean(grey: &[f32], width: usize, height: usize, around: usize) -> Vec<f32> {
    // sums over all cells above and to the left
    let mut sums = vec![0.0_f64; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = 0.0;
        for x in 0..width {
            row += f64::from(grey[y * width + x]);
            sums[(y + 1) * (width + 1) + x + 1] = sums[y * (width + 1) + x + 1] + row;
        }
    }
    let mut mean = Vec::with_capacity(width * height);
    for y in 0..height {
        let (top, bottom) = (y.saturating_sub(around), (y + around + 1).min(height));
        for x in 0..width {
            let (left, right) = (x.saturating_sub(around), (x + around + 1).min(width));
            let at = |row: usize, column: usize| sums[row * (width + 1) + column];
            let sum = at(bottom, right) - at(top, right) - at(bottom, left) + at(top, left);
            mean.push((sum / ((bottom - top) * (right - left)) as f64) as f32);
        }
    }
    mean
}

/// The noise of the quiet parts of a window: from the lower quartile of the differences of neighbours, since the marks
/// lie in quiet surroundings and the image does not matter.
fn noise(window: &GreyWindow) -> f32 {
    let mut differences: Vec<f32> = window
        .grey
        .chunks_exact(window.width.max(1))
        .flat_map(|row| row.windows(2).map(|pair| (pair[1] - pair[0]).abs()))
        .collect();
    if differences.is_empty() {
        return 0.0;
    }
    let quartile = differences.len() / 4;
    let (_, value, _) = differences.select_nth_unstable_by(quartile, f32::total_cmp);
    // a quarter of normal deviates is below 0.3186 sigma, and a difference has twice the variance
    *value / (0.3186 * std::f32::consts::SQRT_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hash(k: usize) -> bool {
        (k as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40 & 3 == 0
    }

    /// The coefficient from its definition, cell by cell.
    fn plain(template: &BinaryTemplate, bits: &Bits, left: usize, top: usize) -> f64 {
        let get = |bits: &Bits, x: usize, y: usize| f64::from(u8::from(bits.row(y)[x / 64] >> (x % 64) & 1 == 1));
        let side = template.set.height;
        let cells = (0..side).flat_map(|y| (0..side).map(move |x| (x, y)));
        let cared: Vec<(f64, f64)> = cells
            .filter(|&(x, y)| get(&template.care, x, y) == 1.0)
            .map(|(x, y)| (get(&template.set, x, y), get(bits, left + x, top + y)))
            .collect();
        let n = cared.len() as f64;
        let mean = |f: fn(&(f64, f64)) -> f64| cared.iter().map(f).sum::<f64>() / n;
        let (a, b) = (mean(|p| p.0), mean(|p| p.1));
        let covariance: f64 = cared.iter().map(|p| (p.0 - a) * (p.1 - b)).sum();
        let variance = |f: fn(&(f64, f64)) -> f64, m: f64| cared.iter().map(|p| (f(p) - m).powi(2)).sum::<f64>();
        covariance / (variance(|p| p.0, a) * variance(|p| p.1, b)).sqrt()
    }

    #[test]
    fn sixty_four_cells_at_a_time_give_what_one_at_a_time_gives() {
        for side in [9, 63, 67] {
            let set = Bits::new(side, side, |x, y| hash(31 * y + x) && (x + y) % 5 > 0);
            let care = Bits::new(side, side, |x, y| (x + y) % 5 > 0);
            let count = |bits: &Bits| bits.rows.iter().map(|word| word.count_ones()).sum();
            let (set_count, care_count) = (count(&set), count(&care));
            let template = BinaryTemplate { set, care, set_count, care_count };
            let bits = Bits::new(side + 70, side + 3, |x, y| hash(1000 * y + x + 7));
            let surface = template.correlate(&bits);
            for (left, top) in [(0, 0), (1, 2), (63, 1), (64, 3), (70, 3)] {
                let got = surface[(top + side / 2) * bits.width + left + side / 2];
                assert!((f64::from(got) - plain(&template, &bits, left, top)).abs() < 1e-6);
            }
            assert_eq!(surface[0], 0.0);
        }
    }

    #[test]
    fn the_local_mean_is_that_of_what_there_is() {
        let grey: Vec<f32> = (0..12).map(|k| k as f32).collect();
        let mean = local_mean(&grey, 4, 3, 1);
        assert_eq!(mean[0], (0.0 + 1.0 + 4.0 + 5.0) / 4.0);
        assert_eq!(mean[5], 5.0);
    }
}
