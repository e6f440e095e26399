//! Where in the image is a control point? Probabilistic clustering (method 1.2, after Sester and Förstner 1989).
//!
//! Under an approximate orientation the edges of a control point are known but for a shift. Every pair of a model
//! edge and a parallel image segment says which shifts would lay the edge on the segment. For each edge and each
//! shift the share of the edge that segments cover is collected; how telling such a share is, is read from its own
//! distribution over all shifts of the window: where lines are everywhere, a covered edge means little. The sum of
//! the logarithms of these likelihood ratios over the edges is the map whose peaks are candidates.

use nalgebra::Vector2;

use super::extract::ObservedSegment;
use crate::features::smooth::Grid;
use crate::geometry::Segment2;

/// How the shifts are searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clustering {
    /// Shifts up to so far in x and y are examined.
    pub half_width_px: f64,
    /// Side of a cell of shifts.
    pub cell_px: f64,
    /// Largest angle between a model edge and a segment that may be its image.
    pub direction_tolerance_rad: f64,
    /// Use the segments of the fine level beside the coarse ones.
    pub fine: bool,
}

/// A candidate for the place of a control point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The reference point there, in reduced pixels.
    pub at_px: Vector2<f64>,
    /// Logarithm of the likelihood ratio: the control point is here, against it is anywhere else in the window.
    pub log_likelihood: f64,
}

/// The map of shifts of one control point.
#[derive(Debug, Clone, PartialEq)]
pub struct ShiftMap {
    /// The predicted reference point, reduced: shift zero.
    pub predicted_px: Vector2<f64>,
    /// Side of a cell.
    pub cell_px: f64,
    /// Cells along a side; odd, the middle one is shift zero.
    pub size: usize,
    /// Logarithms of likelihood ratios, row by row.
    pub values: Vec<f32>,
}

/// Model edges shorter than this are left out: a corner of noise would cover them.
pub(super) const SHORTEST_EDGE_PX: f64 = 20.0;
/// Share of the edges of a control point that leave a segment in the image: 50 to 70 % were measured on real
/// photographs (`../shared/bench/README.md` and our detector), less where the control has grown old.
const SHARE_SEEN: f64 = 0.5;
/// Steps of the share of an edge that is covered.
const COVERAGE_STEPS: usize = 16;
/// A seen edge is covered by at least so many of these steps; above that, evenly distributed.
const LEAST_SEEN_STEPS: usize = 4;
/// No single edge may say more than this.
const MOST_LOG_LIKELIHOOD: f32 = 4.0;
/// Weight of a cell beside the one that a segment votes for.
const BESIDE: f32 = 0.6;

/// Votes of all edges for all shifts.
///
/// `edges_px` are the projected edges, `predicted_px` the projected reference point, both reduced.
#[must_use]
pub fn shift_map<'s>(
    edges_px: &[Segment2],
    predicted_px: Vector2<f64>,
    observed: impl IntoIterator<Item = &'s ObservedSegment>,
    clustering: &Clustering,
) -> ShiftMap {
    let half = (clustering.half_width_px / clustering.cell_px).ceil().max(1.0) as usize;
    let size = 2 * half + 1;
    let mut map = ShiftMap { predicted_px, cell_px: clustering.cell_px, size, values: vec![0.0; size * size] };
    let mut votes = Votes::new(map.size, map.cell_px);
    let reach = edges_px.iter().map(|e| (e.start - predicted_px).norm().max((e.end - predicted_px).norm()));
    let reach = reach.fold(0.0, f64::max) + clustering.half_width_px;
    let near: Vec<Near> = observed
        .into_iter()
        .filter(|s| s.coarse || clustering.fine)
        .map(|s| Near {
            middle: s.segment_px.midpoint() - predicted_px,
            along: s.direction,
            length_px: s.length_px,
            level: usize::from(s.coarse),
        })
        .filter(|n| n.middle.amax() < reach + n.length_px / 2.0)
        .collect();
    let least_cosine = clustering.direction_tolerance_rad.cos();
    let mut untouched = 0.0;
    for edge in edges_px.iter().filter(|e| e.length() >= SHORTEST_EDGE_PX) {
        let (along, length_px, middle) = (edge.direction(), edge.length(), edge.midpoint() - predicted_px);
        for segment in near.iter().filter(|s| s.along.dot(&along).abs() >= least_cosine) {
            votes.add(middle, length_px, segment);
        }
        untouched += votes.move_to(&mut map.values, length_px);
    }
    map.values.iter_mut().for_each(|value| *value += untouched);
    map
}

/// What matters of a line segment in the neighbourhood; places are relative to the predicted reference point.
struct Near {
    middle: Vector2<f64>,
    along: Vector2<f64>,
    length_px: f64,
    level: usize,
}

/// The lengths of one edge that segments cover under each shift. Few shifts are touched by any segment: they are
/// remembered, so that the others cost nothing.
struct Votes {
    size: usize,
    cell_px: f64,
    /// For each cell what segments of the fine and of the coarse level cover.
    covered_px: Vec<[f32; 2]>,
    /// The cells where that is more than nothing: the first `count` of these.
    touched: Vec<u32>,
    count: usize,
    /// For each of them how much of the edge is covered.
    steps: Vec<u8>,
}

/// Numbers with a fractional part of 32 bits.
const ONE_FIXED: f64 = (1_u64 << 32) as f64;

impl Votes {
    fn new(size: usize, cell_px: f64) -> Self {
        let cells = size * size;
        let (covered_px, touched) = (vec![[0.0; 2]; cells], vec![0; cells + 1]);
        Self { size, cell_px, covered_px, touched, count: 0, steps: Vec::new() }
    }

    /// Adds to each cell the length of the edge that the segment covers under that shift.
    fn add(&mut self, edge_middle: Vector2<f64>, edge_length_px: f64, segment: &Near) {
        let (shorter, longer) = (edge_length_px.min(segment.length_px), edge_length_px.max(segment.length_px));
        let reach = (longer + shorter) / 2.0;
        let middle = (self.size / 2) as f64;
        let shift = (segment.middle - edge_middle) / self.cell_px;
        let along = segment.along;
        // one cell for every column (or row) that the band of shifts crosses, and its two neighbours across
        let by_column = along.x.abs() >= along.y.abs();
        let (major, minor, slope, cosine) = if by_column {
            (shift.x, shift.y, along.y / along.x, along.x.abs())
        } else {
            (shift.y, shift.x, along.x / along.y, along.y.abs())
        };
        let span = reach / self.cell_px * cosine;
        let last = self.size - 1;
        let first_step = (major - span + middle).ceil().max(0.0);
        let last_step = (major + span + middle).floor().min(last as f64);
        // a cast cuts off: half a cell makes it the nearest
        let place_at = |step: f64| minor + (step - middle - major) * slope + middle + 0.5;
        let ends = [place_at(first_step), place_at(last_step)];
        let outside = ends.iter().all(|place| *place < 1.0) || ends.iter().all(|place| *place >= last as f64);
        if first_step > last_step || outside {
            return;
        }
        let (step_stride, stride) = if by_column { (1, self.size) } else { (self.size, 1) };
        let (mut place, slope) = ((ends[0] * ONE_FIXED) as i64, (slope * ONE_FIXED) as i64);
        let (shorter, reach, step_px) = (shorter as f32, reach as f32, (self.cell_px / cosine) as f32);
        let mut from = (first_step - middle - major) as f32;
        let (covered_px, touched) = (&mut self.covered_px[..], &mut self.touched[..]);
        let mut count = self.count;
        let mut cover = |cell: usize, length_px: f32| {
            let covered_px = &mut covered_px[cell];
            // without a branch: whether bands cross here cannot be foreseen
            touched[count] = cell as u32;
            count += usize::from(covered_px[0].to_bits() | covered_px[1].to_bits() == 0);
            covered_px[segment.level] += length_px;
        };
        for step in first_step as usize..=last_step as usize {
            // more than nothing: a cell that is touched must not look as if it were not
            let overlap = shorter.min(reach - from.abs() * step_px).max(f32::MIN_POSITIVE / BESIDE);
            let nearest = (place >> 32) as usize;
            from += 1.0;
            place += slope;
            if (1..last).contains(&nearest) {
                let cell = step * step_stride + nearest * stride;
                cover(cell - stride, BESIDE * overlap);
                cover(cell, overlap);
                cover(cell + stride, BESIDE * overlap);
            }
        }
        self.count = count;
    }

    /// Adds what the covered share of the edge says of each shift to the touched cells of a map, and forgets it.
    /// Returns what is due to *all* cells: the touched ones were given only what they have beyond that.
    fn move_to(&mut self, values: &mut [f32], edge_length_px: f64) -> f32 {
        let to_step = COVERAGE_STEPS as f32 / edge_length_px as f32;
        let touched = &self.touched[..self.count];
        let mut counts = [1_usize; COVERAGE_STEPS];
        counts[0] += values.len() - touched.len();
        self.steps.clear();
        self.steps.extend(touched.iter().map(|cell| {
            let [fine, coarse] = std::mem::take(&mut self.covered_px[*cell as usize]);
            let step = ((fine.max(coarse) * to_step) as usize).min(COVERAGE_STEPS - 1);
            counts[step] += 1;
            step as u8
        }));
        let total: usize = counts.iter().sum();
        let seen = 1.0 / (COVERAGE_STEPS - LEAST_SEEN_STEPS) as f64;
        let ratio = std::array::from_fn::<f32, COVERAGE_STEPS, _>(|k| {
            let by_chance = counts[k] as f64 / total as f64;
            let if_seen = if k < LEAST_SEEN_STEPS { 0.0 } else { seen };
            ((1.0 - SHARE_SEEN + SHARE_SEEN * if_seen / by_chance).ln() as f32).min(MOST_LOG_LIKELIHOOD)
        });
        for (cell, step) in touched.iter().zip(&self.steps) {
            values[*cell as usize] += ratio[usize::from(*step) % COVERAGE_STEPS] - ratio[0];
        }
        self.count = 0;
        ratio[0]
    }
}

impl ShiftMap {
    /// The highest local maxima above zero, best first.
    #[must_use]
    pub fn peaks(&self, most: usize) -> Vec<Peak> {
        let smooth = self.smoothed();
        let n = self.size;
        let mut peaks: Vec<Peak> = Vec::new();
        for row in 1..n.saturating_sub(1) {
            for column in 1..n - 1 {
                let here = smooth[row * n + column];
                if here <= 0.0 || !is_maximum(&smooth, n, row, column) {
                    continue;
                }
                let at = |r: usize, c: usize| f64::from(smooth[r * n + c]);
                let dx = vertex(at(row, column - 1), at(row, column), at(row, column + 1));
                let dy = vertex(at(row - 1, column), at(row, column), at(row + 1, column));
                peaks.push(Peak {
                    at_px: self.predicted_px + self.shift_px(column as f64 + dx, row as f64 + dy),
                    log_likelihood: f64::from(here),
                });
            }
        }
        peaks.sort_by(|a, b| b.log_likelihood.total_cmp(&a.log_likelihood));
        peaks.truncate(most);
        peaks
    }

    fn shift_px(&self, column: f64, row: f64) -> Vector2<f64> {
        let middle = (self.size / 2) as f64;
        Vector2::new(column - middle, row - middle) * self.cell_px
    }

    /// Mean of each cell with its eight neighbours, weighted 1 2 1 each way: a control point's edges need not agree
    /// to the cell.
    fn smoothed(&self) -> Vec<f32> {
        let n = self.size;
        let grid = Grid { values: &self.values, width: n, height: n };
        let (mut result, mut buffer) = (vec![0.0; n * n], vec![0.0; n]);
        for (row, smooth) in result.chunks_exact_mut(n).enumerate() {
            grid.smooth_row(row, &mut buffer, smooth);
        }
        result
    }
}

fn is_maximum(values: &[f32], n: usize, row: usize, column: usize) -> bool {
    let here = values[row * n + column];
    (row - 1..=row + 1).all(|r| {
        (column - 1..=column + 1).all(|c| {
            // on a plateau the last cell is the maximum
            let other = values[r * n + c];
            if (r, c) > (row, column) { here > other } else { here >= other }
        })
    })
}

/// Place of the maximum of the parabola through three values at -1, 0, 1.
fn vertex(before: f64, here: f64, after: f64) -> f64 {
    let curvature = before - 2.0 * here + after;
    if curvature < -1e-9 { (0.5 * (before - after) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;
    use crate::orientation::matching::tests::observed;

    const CLUSTERING: Clustering =
        Clustering { half_width_px: 100.0, cell_px: 2.0, direction_tolerance_rad: 0.1, fine: true };
    const PREDICTED: Vector2<f64> = Vector2::new(700.0, -350.0);

    fn between(start: Vector2<f64>, end: Vector2<f64>) -> Segment2 {
        Segment2 { start, end }
    }

    /// A gabled roof about the predicted point: eaves, gables in two halves, ridge.
    fn roof(angle_rad: f64) -> Vec<Segment2> {
        let (along, across) =
            (Vector2::new(angle_rad.cos(), angle_rad.sin()), Vector2::new(-angle_rad.sin(), angle_rad.cos()));
        let at = |u: f64, v: f64| PREDICTED + u * along + v * across;
        vec![
            between(at(-70.0, -40.0), at(70.0, -40.0)),
            between(at(-70.0, 40.0), at(70.0, 40.0)),
            between(at(-70.0, 3.0), at(70.0, 3.0)),
            between(at(-70.0, -40.0), at(-70.0, 3.0)),
            between(at(-70.0, 40.0), at(-70.0, 3.0)),
            between(at(70.0, -40.0), at(70.0, 3.0)),
            between(at(70.0, 40.0), at(70.0, 3.0)),
        ]
    }

    /// Pieces of a share of the edges, a pixel or so off, among other lines of all directions.
    fn photograph(
        draws: &mut Draws,
        edges: &[Segment2],
        shift: Vector2<f64>,
        seen: f64,
        clutter: usize,
    ) -> Vec<ObservedSegment> {
        let mut lines = Vec::new();
        for edge in edges {
            if draws.even(0.0, 1.0) < seen {
                let (from, to) = (draws.even(0.0, 0.2), draws.even(0.7, 1.0));
                let mut at = |share: f64| {
                    edge.start + share * (edge.end - edge.start) + shift + Vector2::new(draws.normal(), draws.normal())
                };
                lines.push(observed(between(at(from), at(to)), lines.len() % 2 == 0));
            }
        }
        for _ in 0..clutter {
            let middle = PREDICTED + Vector2::new(draws.even(-200.0, 200.0), draws.even(-200.0, 200.0));
            let (angle, half) = (draws.even(0.0, std::f64::consts::PI), draws.even(8.0, 50.0));
            let half = half * Vector2::new(angle.cos(), angle.sin());
            lines.push(observed(between(middle - half, middle + half), lines.len() % 2 == 0));
        }
        lines
    }

    /// In how many of 200 photographs the roof lies within `off_px` of one of the `most` best peaks.
    fn located(seen: f64, clutter: usize, most: usize, off_px: f64) -> usize {
        let found = |seed: &u64| {
            let mut draws = Draws::new(*seed);
            let edges = roof(draws.even(0.0, std::f64::consts::PI));
            let shift = Vector2::new(draws.even(-80.0, 80.0), draws.even(-80.0, 80.0));
            let lines = photograph(&mut draws, &edges, shift, seen, clutter);
            let peaks = shift_map(&edges, PREDICTED, &lines, &CLUSTERING).peaks(most);
            peaks.iter().any(|peak| (peak.at_px - PREDICTED - shift).amax() < off_px)
        };
        (0..200).filter(found).count()
    }

    #[test]
    fn a_roof_is_found_among_other_lines() {
        let best = located(0.8, 30, 1, CLUSTERING.cell_px);
        assert!(best >= 190, "{best} of 200");
        // where a third of the edges is not seen and there are ten times as many other lines, among the candidates
        let candidates = located(0.67, 60, 5, 2.0 * CLUSTERING.cell_px);
        assert!(candidates >= 185, "{candidates} of 200");
    }

    #[test]
    fn the_peak_lies_at_the_shift_between_the_cells() {
        let edges = roof(0.0);
        for shift in [Vector2::new(0.0, 0.0), Vector2::new(31.0, -57.0), Vector2::new(-80.0, 44.6)] {
            let lines: Vec<_> = edges.iter().map(|e| observed(between(e.start + shift, e.end + shift), true)).collect();
            let peaks = shift_map(&edges, PREDICTED, &lines, &CLUSTERING).peaks(3);
            assert!((peaks[0].at_px - PREDICTED - shift).amax() < CLUSTERING.cell_px, "{:?} for {shift}", peaks[0]);
            assert!(peaks[0].log_likelihood > 10.0 && peaks.is_sorted_by(|a, b| a.log_likelihood >= b.log_likelihood));
        }
    }

    #[test]
    fn fine_segments_count_only_where_asked_for() {
        let edges = roof(0.3);
        let lines: Vec<_> = edges.iter().map(|e| observed(*e, false)).collect();
        let without = Clustering { fine: false, ..CLUSTERING };
        assert!(shift_map(&edges, PREDICTED, &lines, &CLUSTERING).peaks(1)[0].log_likelihood > 10.0);
        assert_eq!(shift_map(&edges, PREDICTED, &lines, &without).peaks(1), []);
    }

    #[test]
    fn lines_of_other_directions_say_nothing() {
        let edges = [between(PREDICTED, PREDICTED + Vector2::new(80.0, 0.0))];
        let turned = |angle: f64| {
            let lines = [observed(between(PREDICTED, PREDICTED + 80.0 * Vector2::new(angle.cos(), angle.sin())), true)];
            shift_map(&edges, PREDICTED, &lines, &CLUSTERING).peaks(1).len()
        };
        assert_eq!((turned(0.09), turned(std::f64::consts::PI - 0.09), turned(0.11), turned(1.5)), (1, 1, 0, 0));
    }

    #[test]
    fn without_edges_or_lines_there_is_no_peak() {
        let line = observed(between(PREDICTED, PREDICTED + Vector2::new(50.0, 0.0)), true);
        let short = between(PREDICTED, PREDICTED + Vector2::new(19.0, 0.0));
        for (edges, lines) in [(vec![], vec![line]), (vec![short], vec![line]), (roof(0.0), vec![])] {
            let map = shift_map(&edges, PREDICTED, &lines, &CLUSTERING);
            assert_eq!((map.size, map.values.len()), (101, 101 * 101));
            assert_eq!(map.peaks(5), []);
        }
        let narrow = Clustering { half_width_px: 0.0, ..CLUSTERING };
        assert_eq!(shift_map(&roof(0.0), PREDICTED, &[line], &narrow).size, 3);
    }
}
