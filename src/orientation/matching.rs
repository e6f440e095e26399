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

/// For each edge that is in view the segments along it: those of the fine level, and where there are none the coarse ones. Each
/// segment goes to the edge that it is nearest to.
#[must_use]
pub fn matches(edges_px: &[Option<Segment2>], observed: &[ObservedSegment], nearness: &Nearness) -> Vec<Match> {
    let mut found: Vec<Match> = Vec::new();
    let mut of_edge = vec![[false; 2]; edges_px.len()];
    let around = Around::of(edges_px, nearness.distance_px);
    for (index, segment) in observed.iter().enumerate() {
        if segment.length_px < SHORTEST_PX || !around.touches(&segment.segment_px) {
            continue;
        }
        let candidates = edges_px.iter().enumerate().filter_map(|(edge, model)| {
            let (at, distance) = fits(model.as_ref()?, segment, nearness)?;
            Some((Match { edge, segment: index, at }, distance))
        });
        if let Some((best, _)) = candidates.min_by(|a, b| a.1.total_cmp(&b.1)) {
            of_edge[best.edge][usize::from(segment.coarse)] = true;
            found.push(best);
        }
    }
    found.retain(|m| !(observed[m.segment].coarse && of_edge[m.edge][0]));
    found
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
