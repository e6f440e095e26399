//! Which of several parallel lines is the image of an edge?
//!
//! Gutter, rim, wall and shadow run along a roof's edge a few pixels apart, and the nearest of them need not be the
//! right one. What one edge leaves open the others of the building decide: all its right lines lie off their edges by
//! one common shift.

use nalgebra::{Matrix2, Vector2};

use super::extract::ObservedSegment;
use super::matching::Match;
use crate::geometry::Segment2;

/// Standard deviation of the lines of one building about their common shift, measured under the reference orientations
/// of `../shared/bench` (0.6 to 1.0 px), beside the stated accuracy of its coordinates.
const SIGMA_EDGE_PX: f64 = 0.8;
/// How far the building may lie off the place where it was located.
const SIGMA_SHIFT_PX: f64 = 2.0;
/// Pieces nearer to one another than this lie on one line.
const ONE_LINE_PX: f64 = 1.2;
/// The odds that a line that covers a whole edge and lies where the others say is the right one rather than an
/// accident: half of the edges are seen, and lines near edges by chance are ten times rarer.
const ODDS: f64 = 10.0;
/// A line is given up where another of the same edge is so many times as likely; what is less clear stays, and the
/// mean of an ambiguity is a better guess than either of its ends.
const DECIDED: f64 = 3.0;
/// Edges that meet under less than this (a sine) do not fix a shift together.
const LEAST_SINE: f64 = 0.3;

/// The matches of a building without the lines that the other edges of the building contradict.
///
/// `sigma_control_px` is the stated accuracy of its coordinates in the image.
#[must_use]
pub fn resolved(
    edges_px: &[Option<Segment2>],
    observed: &[ObservedSegment],
    mut matches: Vec<Match>,
    sigma_control_px: f64,
) -> Vec<Match> {
    let lines = Lines { all: lines(edges_px, observed, &matches), sigma_px: SIGMA_EDGE_PX.hypot(sigma_control_px) };
    let shift = lines.common_shift();
    let mut likeliest = vec![0.0_f64; edges_px.len()];
    for line in &lines.all {
        likeliest[line.edge] = likeliest[line.edge].max(lines.likelihood(line, shift));
    }
    let mut given_up = vec![false; matches.len()];
    for line in lines.all.iter().filter(|line| DECIDED * lines.likelihood(line, shift) < likeliest[line.edge]) {
        line.members.iter().for_each(|&member| given_up[member] = true);
    }
    let mut flags = given_up.into_iter();
    matches.retain(|_| flags.next() == Some(false));
    matches
}

/// Pieces on one line near an edge.
struct Line {
    edge: usize,
    normal: Vector2<f64>,
    /// Its distance from the edge, along the normal.
    offset_px: f64,
    /// The share of the edge that its pieces cover.
    cover: f64,
    members: Vec<usize>,
}

/// The lines near the edges of a building, edge by edge.
fn lines(edges_px: &[Option<Segment2>], observed: &[ObservedSegment], matches: &[Match]) -> Vec<Line> {
    let mut found: Vec<Line> = Vec::new();
    for (edge, model) in edges_px.iter().enumerate() {
        let Some(model) = model else { continue };
        let normal = model.normal();
        let of_edge = matches.iter().enumerate().filter(|(_, m)| m.edge == edge);
        let mut pieces: Vec<(f64, usize)> = of_edge
            .map(|(member, m)| (normal.dot(&(observed[m.segment].segment_px.midpoint() - model.start)), member))
            .collect();
        pieces.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut last_px = f64::NEG_INFINITY;
        for (offset_px, member) in pieces {
            let [from, to] = matches[member].at;
            let cover = (from.max(to).min(1.0) - from.min(to).max(0.0)).max(f64::MIN_POSITIVE);
            match found.last_mut().filter(|_| offset_px - last_px < ONE_LINE_PX) {
                Some(line) => {
                    line.cover += cover;
                    line.offset_px += (offset_px - line.offset_px) * cover / line.cover;
                    line.members.push(member);
                }
                None => found.push(Line { edge, normal, offset_px, cover, members: vec![member] }),
            }
            last_px = offset_px;
        }
    }
    found
}

/// The lines near the edges of one building, with their spread about the common shift.
struct Lines {
    all: Vec<Line>,
    sigma_px: f64,
}

impl Lines {
    fn likelihood(&self, line: &Line, shift: Vector2<f64>) -> f64 {
        let away = (line.offset_px - line.normal.dot(&shift)) / self.sigma_px;
        line.cover.min(1.0) * (-away * away / 2.0).exp()
    }

    /// The log odds that a shift is right: of each edge only its likeliest line counts.
    fn log_odds(&self, shift: Vector2<f64>) -> f64 {
        let of_edges = self.all.chunk_by(|a, b| a.edge == b.edge).map(|of_edge| {
            let likeliest = of_edge.iter().map(|line| self.likelihood(line, shift)).fold(0.0, f64::max);
            (1.0 + ODDS * likeliest).ln()
        });
        of_edges.sum::<f64>() - shift.norm_squared() / (2.0 * SIGMA_SHIFT_PX.powi(2))
    }

    /// The likeliest of all shifts that two lines of different directions give, that one gives across itself, and none.
    fn common_shift(&self) -> Vector2<f64> {
        let mut best = (self.log_odds(Vector2::zeros()), Vector2::zeros());
        let mut consider = |shift: Vector2<f64>| {
            let log_odds = self.log_odds(shift);
            if log_odds > best.0 {
                best = (log_odds, shift);
            }
        };
        for (k, a) in self.all.iter().enumerate() {
            consider(a.normal * a.offset_px);
            for b in self.all[..k].iter().filter(|b| b.edge != a.edge) {
                let normals = Matrix2::from_rows(&[a.normal.transpose(), b.normal.transpose()]);
                if normals.determinant().abs() > LEAST_SINE
                    && let Some(inverse) = normals.try_inverse()
                {
                    consider(inverse * Vector2::new(a.offset_px, b.offset_px));
                }
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::matching::tests::observed;
    use crate::orientation::matching::{Nearness, matches};

    const NEARNESS: Nearness = Nearness { distance_px: 5.0, direction_tolerance_rad: 0.1 };

    /// A rectangular roof, 120 x 80 px.
    fn roof() -> Vec<Segment2> {
        let corners = [[0.0, 0.0], [120.0, 0.0], [120.0, 80.0], [0.0, 80.0]].map(Vector2::from);
        (0..4).map(|k| Segment2 { start: corners[k], end: corners[(k + 1) % 4] }).collect()
    }

    fn moved(edge: &Segment2, by: Vector2<f64>) -> Segment2 {
        Segment2 { start: edge.start + by, end: edge.end + by }
    }

    /// The segments that stay when those of the given lines are in the image.
    fn kept(lines: &[Segment2]) -> Vec<usize> {
        let edges: Vec<_> = roof().into_iter().map(Some).collect();
        let segments: Vec<_> = lines.iter().map(|line| observed(*line, false)).collect();
        let found = matches(&edges, segments.iter().enumerate(), &NEARNESS);
        assert_eq!(found.len(), lines.len());
        resolved(&edges, &segments, found, 0.3).iter().map(|m| m.segment).collect()
    }

    #[test]
    fn the_other_edges_decide_between_two_parallels() {
        // the whole roof lies off by (1.5, 2.5), and the line nearest to its first edge is a gutter
        let shift = Vector2::new(1.5, 2.5);
        let mut lines: Vec<_> = roof().iter().map(|edge| moved(edge, shift)).collect();
        lines.push(moved(&roof()[0], Vector2::new(0.0, -1.0)));
        assert_eq!(kept(&lines), [0, 1, 2, 3]);
    }

    #[test]
    fn the_nearest_line_is_kept_where_the_others_agree_with_it() {
        let mut lines: Vec<_> = roof().iter().map(|edge| moved(edge, Vector2::new(0.3, -0.2))).collect();
        lines.push(moved(&roof()[2], Vector2::new(0.0, 3.5)));
        lines.push(moved(&roof()[3], Vector2::new(-4.0, 0.0)));
        assert_eq!(kept(&lines), [0, 1, 2, 3]);
    }

    #[test]
    fn what_nothing_decides_stays() {
        let edge = roof()[0];
        let both = [moved(&edge, Vector2::new(0.0, -1.5)), moved(&edge, Vector2::new(0.0, 1.5))];
        // a single edge cannot tell, and its two lines lie as far off as each other
        let edges: Vec<_> = vec![Some(edge)];
        let segments: Vec<_> = both.iter().map(|line| observed(*line, false)).collect();
        let found = matches(&edges, segments.iter().enumerate(), &NEARNESS);
        let lines = Lines { all: lines(&edges, &segments, &found), sigma_px: 1.0 };
        assert_eq!((lines.all.len(), lines.all[0].members.len()), (2, 1));
        assert!((lines.log_odds(Vector2::new(0.0, 1.5)) - lines.log_odds(Vector2::new(0.0, -1.5))).abs() < 1e-12);
        // one pixel apart, they are one line
        let near = [moved(&edge, Vector2::new(0.0, -0.5)), moved(&edge, Vector2::new(0.0, 0.5))];
        let segments: Vec<_> = near.iter().map(|line| observed(*line, false)).collect();
        let found = matches(&edges, segments.iter().enumerate(), &NEARNESS);
        assert_eq!(resolved(&edges, &segments, found, 0.0).len(), 2);
    }

    #[test]
    fn nothing_is_resolved_to_nothing() {
        assert_eq!(resolved(&[None, Some(roof()[0])], &[], Vec::new(), 0.5), []);
    }
}
