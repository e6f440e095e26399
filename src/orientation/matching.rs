//! Which line segments of the image belong to which model edges, once each building's place is known to a few pixels.

use nalgebra::Vector2;

use super::extract::ObservedSegment;
use crate::geometry::Segment2;

/// How near a segment must be to an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearness {
    /// Largest distance of the segment's ends from the edge's line.
    pub distance_px: f64,
    /// Largest angle between them.
    pub direction_tolerance_rad: f64,
}

/// A segment that may be a piece of the image of an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Index of the edge among those given.
    pub edge: usize,
    /// Index of the segment among those given.
    pub segment: usize,
    /// Where the segment's ends fall on the edge: 0 at its start, 1 at its end.
    pub at: [f64; 2],
}

/// A piece must share so much of the shorter of the two with the edge.
const LEAST_OVERLAP: f64 = 0.5;
/// And be no shorter than this.
const SHORTEST_PX: f64 = 12.0;

/// For each edge that is in view the segments along it: those of the fine level, and where there are none the coarse
/// ones. Each segment goes to the edge that it is nearest to. The segments are given with their indices.
#[must_use]
pub fn matches<'s>(
    edges_px: &[Option<Segment2>],
    observed: impl IntoIterator<Item = (usize, &'s ObservedSegment)>,
    nearness: &Nearness,
) -> Vec<Match> {
    let mut found: Vec<(Match, bool)> = Vec::new();
    let mut of_edge = vec![[false; 2]; edges_px.len()];
    let around = Around::of(edges_px, nearness.distance_px);
    for (index, segment) in observed {
        if segment.length_px < SHORTEST_PX || !around.touches(&segment.segment_px) {
            continue;
        }
        let candidates = edges_px.iter().enumerate().filter_map(|(edge, model)| {
            let (at, distance) = fits(model.as_ref()?, segment, nearness)?;
            Some((Match { edge, segment: index, at }, distance))
        });
        if let Some((best, _)) = candidates.min_by(|a, b| a.1.total_cmp(&b.1)) {
            of_edge[best.edge][usize::from(segment.coarse)] = true;
            found.push((best, segment.coarse));
        }
    }
    found.retain(|(found, coarse)| !(*coarse && of_edge[found.edge][0]));
    found.into_iter().map(|(found, _)| found).collect()
}

/// Where the segment's ends fall on the edge, and the larger of their distances from it, if it fits.
fn fits(edge: &Segment2, segment: &ObservedSegment, nearness: &Nearness) -> Option<([f64; 2], f64)> {
    let (along, length) = (edge.direction(), edge.length());
    if length < SHORTEST_PX || segment.direction.dot(&along).abs() < nearness.direction_tolerance_rad.cos() {
        return None;
    }
    let normal = edge.normal();
    let (from, to) = (segment.segment_px.start - edge.start, segment.segment_px.end - edge.start);
    let distance = normal.dot(&from).abs().max(normal.dot(&to).abs());
    if distance > nearness.distance_px {
        return None;
    }
    let (u, v) = (along.dot(&from), along.dot(&to));
    let overlap = u.max(v).min(length) - u.min(v).max(0.0);
    (overlap >= LEAST_OVERLAP * length.min(segment.length_px)).then_some(([u / length, v / length], distance))
}

/// The rectangle that holds all edges.
struct Around {
    least: Vector2<f64>,
    largest: Vector2<f64>,
}

impl Around {
    fn of(edges: &[Option<Segment2>], margin: f64) -> Self {
        let ends = || edges.iter().flatten().flat_map(|e| [e.start, e.end]);
        let least = ends().fold(Vector2::repeat(f64::INFINITY), |a, b| a.inf(&b));
        let largest = ends().fold(Vector2::repeat(f64::NEG_INFINITY), |a, b| a.sup(&b));
        Self { least: least.add_scalar(-margin), largest: largest.add_scalar(margin) }
    }

    fn touches(&self, segment: &Segment2) -> bool {
        let (least, largest) = (segment.start.inf(&segment.end), segment.start.sup(&segment.end));
        largest.x >= self.least.x && least.x <= self.largest.x && largest.y >= self.least.y && least.y <= self.largest.y
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use nalgebra::Matrix2;

    /// A segment as it would come out of the image.
    pub(in crate::orientation) fn observed(segment_px: Segment2, coarse: bool) -> ObservedSegment {
        ObservedSegment {
            segment_px,
            direction: segment_px.direction(),
            length_px: segment_px.length(),
            covariance_across: Matrix2::identity() * 0.01,
            coarse,
            file_px: segment_px,
        }
    }

    fn level(y: f64, from: f64, to: f64) -> Segment2 {
        Segment2 { start: Vector2::new(from, y), end: Vector2::new(to, y) }
    }

    fn fine(y: f64, from: f64, to: f64) -> ObservedSegment {
        observed(level(y, from, to), false)
    }

    fn coarse(y: f64, from: f64, to: f64) -> ObservedSegment {
        observed(level(y, from, to), true)
    }

    const NEARNESS: Nearness = Nearness { distance_px: 4.0, direction_tolerance_rad: 0.05 };

    /// (edge, segment) of all matches.
    fn pairs(edges: &[Option<Segment2>], observed: &[ObservedSegment]) -> Vec<(usize, usize)> {
        matches(edges, observed.iter().enumerate(), &NEARNESS).iter().map(|m| (m.edge, m.segment)).collect()
    }

    #[test]
    fn pieces_of_an_edge_say_where_they_lie_on_it() {
        let observed = [fine(1.0, 10.0, 40.0), fine(-2.0, 90.0, 50.0)];
        let found = matches(&[Some(level(0.0, 0.0, 100.0))], observed.iter().enumerate(), &NEARNESS);
        assert_eq!(
            found,
            [Match { edge: 0, segment: 0, at: [0.1, 0.4] }, Match { edge: 0, segment: 1, at: [0.9, 0.5] }]
        );
    }

    #[test]
    fn a_segment_goes_to_the_nearest_of_parallel_edges() {
        let edges = [Some(level(0.0, 0.0, 100.0)), Some(level(5.0, 0.0, 100.0)), None];
        assert_eq!(
            pairs(&edges, &[fine(2.0, 0.0, 90.0), fine(3.0, 0.0, 90.0), fine(8.9, 5.0, 95.0)]),
            [(0, 0), (1, 1), (1, 2)]
        );
    }

    #[test]
    fn coarse_segments_serve_only_edges_without_fine_ones() {
        let edges = [Some(level(0.0, 0.0, 100.0)), Some(level(50.0, 0.0, 100.0))];
        let observed = [coarse(0.5, 0.0, 100.0), fine(1.0, 0.0, 60.0), coarse(50.5, 0.0, 100.0)];
        assert_eq!(pairs(&edges, &observed), [(0, 1), (1, 2)]);
    }

    #[test]
    fn what_is_far_short_turned_or_beside_does_not_match() {
        let edges = [Some(level(0.0, 0.0, 100.0))];
        let turned = |angle: f64| {
            let half = 20.0 * Vector2::new(angle.cos(), angle.sin());
            let middle = Vector2::new(50.0, 0.0);
            observed(Segment2 { start: middle - half, end: middle + half }, false)
        };
        assert_eq!(
            pairs(&edges, &[fine(3.9, 0.0, 50.0), turned(0.049), turned(std::f64::consts::PI + 0.049)]).len(),
            3
        );
        // over the distance, under the length, over the angle, and with less than half on the edge
        assert_eq!(
            pairs(&edges, &[fine(4.1, 0.0, 50.0), fine(0.0, 0.0, 11.0), turned(0.051), fine(0.0, 85.0, 116.0)]),
            []
        );
        assert_eq!(pairs(&edges, &[fine(0.0, 85.0, 114.0)]), [(0, 0)]);
    }

    #[test]
    fn nothing_matches_nothing() {
        assert_eq!(pairs(&[], &[fine(0.0, 0.0, 50.0)]), []);
        assert_eq!(pairs(&[None, Some(level(0.0, 0.0, 5.0))], &[fine(0.0, 0.0, 50.0)]), []);
        assert_eq!(pairs(&[Some(level(0.0, f64::NAN, 50.0))], &[fine(0.0, 0.0, 50.0)]), []);
        assert_eq!(pairs(&[Some(level(0.0, 0.0, 50.0))], &[]), []);
    }
}
