//! Straight line segments out of a grey window, each with the covariance of its position (method 1.3).
//!
//! Edge pixels whose gradients point the same way are collected from the strongest on; a line is fitted to their
//! sub-cell positions, and what is bent is cut where it deviates most, until every piece is straight.

use nalgebra::{Matrix2, Vector2};

use super::edgels::{Edgel, edgels};
use super::picture::GreyWindow;
use crate::geometry::Segment2;

/// What counts as a line segment. All lengths in cells of the window that is searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Weakest gradient, grey values per cell after smoothing.
    pub least_gradient: f32,
    /// Shortest segment.
    pub least_length: f64,
    /// Largest angle between the gradient of an edge pixel and that of the segment that it joins.
    pub direction_tolerance_rad: f32,
    /// Largest root mean square distance of the edge pixels from their line.
    pub largest_scatter: f64,
    /// Least number of edge pixels per unit of length.
    pub least_density: f64,
}

impl Default for Detection {
    fn default() -> Self {
        Self {
            // three times the gradient noise of a grey value noise of about 4 after smoothing
            least_gradient: 2.5,
            least_length: 10.0,
            direction_tolerance_rad: 20.0 * std::f32::consts::PI / 180.0,
            largest_scatter: 0.5,
            least_density: 0.6,
        }
    }
}

/// A straight line segment, in pixels of the file, directed so that its brighter side is on its left, as one sees it
/// on the screen (y downwards): the gradient points against [`Segment2::normal`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineSegment {
    /// Its end points.
    pub segment: Segment2,
    /// Covariance of the distances of start and end across the line (Schickler's v), px².
    pub covariance_across: Matrix2<f64>,
    /// Mean gradient along it, grey values per pixel.
    pub gradient: f64,
    /// Pixels of the file along a side of a cell of the window in which it was found.
    pub reduction: u32,
}

/// Scatter, in cells, of the edge pixels about their line, at least: sampling and the parabola leave so much without
/// noise.
const LEAST_SCATTER: f64 = 0.02;
/// Standard deviation, in cells, of the shift that sampling gives to a whole edge along a row or column of pixels.
const SIGMA_SHIFT: f64 = 0.02;
/// Neighbouring edge pixels share the grey values that smoothing and gradient mixed; so many of them count as one.
/// (All three were measured on simulated edges, see the tests.)
const CORRELATED_EDGELS: f64 = 2.9;

/// The line segments of a window.
#[must_use]
pub fn line_segments(window: &GreyWindow, detection: &Detection) -> Vec<LineSegment> {
    let edgels = edgels(window, detection.least_gradient);
    let mut regions = Regions::new(&edgels, window.width, window.height, detection.direction_tolerance_rad.cos());
    let mut found = Vec::new();
    let mut members = Vec::new();
    for seed in strongest_first(&edgels) {
        if regions.grow(seed, &mut members) && members.len() as f64 >= detection.least_density * detection.least_length
        {
            straight_pieces(&edgels, &mut members, detection, &mut |fit| found.push(fit.in_file(window)));
        }
    }
    found
}

/// Indices of the edgels by falling gradient, sorted into steps of an eighth of an octave: an exact order is not needed.
fn strongest_first(edgels: &[Edgel]) -> Vec<u32> {
    const STEPS: usize = 64;
    let step = |e: &Edgel| (STEPS - 1).saturating_sub((e.gradient.max(1.0).log2() * 8.0) as usize) as u8;
    let steps: Vec<u8> = edgels.iter().map(step).collect();
    let mut starts = [0_usize; STEPS + 1];
    for step in &steps {
        starts[usize::from(*step) + 1] += 1;
    }
    for k in 0..STEPS {
        starts[k + 1] += starts[k];
    }
    let mut order = vec![0_u32; edgels.len()];
    for (index, step) in steps.iter().enumerate() {
        let place = &mut starts[usize::from(*step)];
        order[*place] = index as u32;
        *place += 1;
    }
    order
}

/// Which edge pixels are still free, and how they are collected.
struct Regions {
    /// What is looked at of the edgels, beside one another: most of the time goes into fetching it.
    candidates: Vec<Candidate>,
    /// 64 cells a word, row by row, each row with an empty word at its end.
    words: Vec<Word>,
    words_per_row: usize,
    least_cosine: f32,
}

/// An edgel as a candidate for a collection.
#[derive(Clone, Copy)]
struct Candidate {
    normal: [f32; 2],
    row: u32,
    column: u32,
}

/// Which of 64 neighbouring cells have an edgel. A bit a cell, so that the neighbourhood of a cell is a few words.
#[derive(Clone, Copy, Default)]
struct Word {
    /// Those that no collection has taken.
    free: u64,
    present: u64,
    /// How many edgels come before these cells.
    first: u32,
}

/// Cells to either side in which a connected edgel is looked for.
const REACH: u32 = 2;
/// The cells from one side to the other.
const AROUND: u32 = 2 * REACH + 1;
/// How many bits of a number are set.
const BITS_SET: [u32; 1 << AROUND] = {
    let mut set = [0; 1 << AROUND];
    let mut k = 1;
    while k < set.len() {
        set[k] = set[k / 2] + (k % 2) as u32;
        k += 1;
    }
    set
};

/// The bits of [`AROUND`] cells in a row, the first of them at `shift` in the first of two words.
fn window(word: u64, next_word: u64, shift: u32) -> u64 {
    let two = u128::from(word) | u128::from(next_word) << 64;
    (two >> shift) as u64 & ((1 << AROUND) - 1)
}

impl Regions {
    /// `edgels` row by row, at least [`REACH`] cells away from the rim.
    fn new(edgels: &[Edgel], width: usize, height: usize, least_cosine: f32) -> Self {
        let words_per_row = width.div_ceil(64) + 1;
        let mut words = vec![Word::default(); words_per_row * height];
        for e in edgels {
            words[e.row as usize * words_per_row + e.column as usize / 64].present |= 1 << (e.column % 64);
        }
        let mut first = 0;
        for word in &mut words {
            (word.first, word.free) = (first, word.present);
            first += word.present.count_ones();
        }
        let candidate = |e: &Edgel| Candidate { normal: e.normal, row: e.row, column: e.column };
        let candidates = edgels.iter().map(candidate).collect();
        Self { candidates, words, words_per_row, least_cosine }
    }

    fn word_at(&self, row: u32, column: u32) -> usize {
        row as usize * self.words_per_row + column as usize / 64
    }

    /// Marks an edgel as taken; false if it was before.
    fn take(&mut self, index: u32) -> bool {
        let Candidate { row, column, .. } = self.candidates[index as usize];
        let (word, bit) = (self.word_at(row, column), 1 << (column % 64));
        let free = self.words[word].free & bit != 0;
        self.words[word].free &= !bit;
        free
    }

    /// Collects into `members` what is connected to `seed` over at most one missing cell and points the same way as
    /// all collected before; false if the seed is taken already.
    fn grow(&mut self, seed: u32, members: &mut Vec<u32>) -> bool {
        if !self.take(seed) {
            return false;
        }
        members.clear();
        members.push(seed);
        let mut sum = self.candidates[seed as usize].normal;
        let mut next = 0;
        while let Some(&index) = members.get(next) {
            next += 1;
            let Candidate { row, column, .. } = self.candidates[index as usize];
            let mean = sum;
            let least = self.least_cosine * (mean[0] * mean[0] + mean[1] * mean[1]).sqrt();
            let shift = (column - REACH) % 64;
            for near_row in row - REACH..=row + REACH {
                let at = self.word_at(near_row, column - REACH);
                let [word, next_word] = [self.words[at], self.words[at + 1]];
                let mut free = window(word.free, next_word.free, shift);
                if free == 0 {
                    continue;
                }
                let present = window(word.present, next_word.present, shift);
                let before = word.first + (word.present & !(u64::MAX << shift)).count_ones();
                let mut taken = 0;
                while free != 0 {
                    let bit = free & free.wrapping_neg();
                    free ^= bit;
                    let candidate = before + BITS_SET[(present & (bit - 1)) as usize];
                    let normal = self.candidates[candidate as usize].normal;
                    if normal[0] * mean[0] + normal[1] * mean[1] >= least {
                        members.push(candidate);
                        sum = [sum[0] + normal[0], sum[1] + normal[1]];
                        taken |= bit;
                    }
                }
                let taken = u128::from(taken) << shift;
                self.words[at].free &= !(taken as u64);
                self.words[at + 1].free &= !((taken >> 64) as u64);
            }
        }
        true
    }
}

/// A line fitted to edge pixels; lengths in cells.
struct Fit {
    centre: Vector2<f64>,
    along: Vector2<f64>,
    from: f64,
    to: f64,
    scatter: f64,
    count: usize,
    gradient: f64,
}

/// Cuts a collection into straight pieces and hands on those that count.
fn straight_pieces(edgels: &[Edgel], members: &mut [u32], detection: &Detection, found: &mut impl FnMut(Fit)) {
    if (members.len() as f64) < detection.least_density * detection.least_length {
        return;
    }
    let Some(fit) = Fit::to(edgels, members) else { return };
    let length = fit.to - fit.from;
    if length < detection.least_length {
        return;
    }
    if fit.scatter <= detection.largest_scatter {
        if fit.count as f64 >= detection.least_density * length {
            found(fit);
        }
        return;
    }
    let along = |index: &u32| fit.along_of(&edgels[*index as usize]);
    members.sort_unstable_by(|a, b| along(a).total_cmp(&along(b)));
    let worst = members.iter().enumerate().map(|(k, index)| (k, fit.across_of(&edgels[*index as usize]).abs()));
    let margin = members.len() / 8;
    let cut = worst
        .skip(margin)
        .take(members.len() - 2 * margin)
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(members.len() / 2, |(k, _)| k);
    let (left, right) = members.split_at_mut(cut.clamp(1, members.len() - 1));
    straight_pieces(edgels, left, detection, found);
    straight_pieces(edgels, right, detection, found);
}

impl Fit {
    /// Total least squares: through the centroid along the principal axis, directed with the bright side left.
    fn to(edgels: &[Edgel], members: &[u32]) -> Option<Self> {
        let of = |index: &u32| &edgels[*index as usize];
        let count = members.len();
        let n = count as f64;
        let (mut sum, mut normal, mut gradient) = (Vector2::zeros(), Vector2::zeros(), 0.0);
        for e in members.iter().map(of) {
            sum += Vector2::new(f64::from(e.x), f64::from(e.y));
            normal += Vector2::new(f64::from(e.normal[0]), f64::from(e.normal[1]));
            gradient += f64::from(e.gradient);
        }
        let centre = sum / n;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for e in members.iter().map(of) {
            let (dx, dy) = (f64::from(e.x) - centre.x, f64::from(e.y) - centre.y);
            xx += dx * dx;
            xy += dx * dy;
            yy += dy * dy;
        }
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let mut along = Vector2::new(angle.cos(), angle.sin());
        // the bright side: the gradient (a, b) belongs to the direction (-b, a)
        if along.x * -normal.y + along.y * normal.x < 0.0 {
            along = -along;
        }
        let mut fit = Self { centre, along, from: f64::MAX, to: f64::MIN, scatter: 0.0, count, gradient: gradient / n };
        let mut squares = 0.0;
        for e in members.iter().map(of) {
            let u = fit.along_of(e);
            (fit.from, fit.to) = (fit.from.min(u), fit.to.max(u));
            squares += fit.across_of(e).powi(2);
        }
        fit.scatter = (squares / (n - 2.0).max(1.0)).sqrt();
        (fit.to > fit.from).then_some(fit)
    }

    fn along_of(&self, e: &Edgel) -> f64 {
        (f64::from(e.x) - self.centre.x) * self.along.x + (f64::from(e.y) - self.centre.y) * self.along.y
    }

    fn across_of(&self, e: &Edgel) -> f64 {
        (f64::from(e.y) - self.centre.y) * self.along.x - (f64::from(e.x) - self.centre.x) * self.along.y
    }

    /// The segment in pixels of the file, with its covariance: `sigma²/l [[4, -2], [-2, 4]]` for l edge pixels that
    /// are independent (method 1.3), of which the line took two for itself, and a shift of both ends alike.
    fn in_file(&self, window: &GreyWindow) -> LineSegment {
        let cell_px = f64::from(window.reduction);
        let origin = Vector2::new(f64::from(window.origin_px[0]), f64::from(window.origin_px[1]));
        let at = |u: f64| origin + cell_px * (self.centre + u * self.along);
        let independent = self.count as f64 / CORRELATED_EDGELS;
        let variance = self.scatter.max(LEAST_SCATTER).powi(2) / (independent - 2.0).max(1.0);
        let covariance = Matrix2::new(4.0, -2.0, -2.0, 4.0) * variance + Matrix2::repeat(SIGMA_SHIFT.powi(2));
        LineSegment {
            segment: Segment2 { start: at(self.from), end: at(self.to) },
            covariance_across: covariance * cell_px.powi(2),
            gradient: self.gradient / cell_px,
            reduction: window.reduction,
        }
    }
}

#[cfg(test)]
mod tests;
