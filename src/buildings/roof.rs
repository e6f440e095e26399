//! From the polygons of a roof to its edges.
//!
//! Points closer than 5 cm are one *node*. A side of a polygon on which nodes of others lie is cut there, so that what
//! two polygons share is the same pair of nodes in both, even where one side is only a part of the other. Then every
//! pair of nodes is an edge once: an outer one if one face ends there, a shared one if two meet at an angle, none if
//! the faces continue each other, as triangles of one plane do. What continues straight is joined at last.
//!
//! All is computed in metres about the first point; what comes out are points of the model, to the last bit.

mod join;
mod kind;
mod net;
mod surfaces;
#[cfg(test)]
mod tests;

use nalgebra::Vector3;

use super::model::RoofEdge;
use net::Net;
pub(super) use surfaces::Surfaces;

/// Points closer than this are the same: models are given in centimetres, and their parts made apart.
const TOLERANCE_M: f64 = 0.05;
/// A shorter edge is not seen in an aerial image.
const SHORTEST_EDGE_M: f64 = 0.3;
/// Comparisons of points that one roof may take: half a second. Real roofs, greenhouses too, take a hundredth.
const MOST_WORK: u64 = 200_000_000;

/// Why a roof has no edges.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum RoofError {
    /// A ring that encloses nothing.
    #[error("ring {ring} of roof polygon {polygon} has {points} different points; a ring needs at least three")]
    Ring {
        /// Of its polygon, from 0, the outer one.
        ring: usize,
        /// From 0.
        polygon: usize,
        /// How many.
        points: usize,
    },
    /// A roof that was made to take time.
    #[error("the roof is too intricate: its {points} points lie on each other's edges in too many ways")]
    TooIntricate {
        /// How many.
        points: usize,
    },
    /// Nothing to be seen.
    #[error("the roof has no edge of at least 0.3 m")]
    NoEdge,
}

/// How many comparisons may still be made.
#[derive(Debug)]
struct Work(u64);

impl Work {
    fn spend(&mut self, comparisons: usize) -> Result<(), ()> {
        self.0 = self.0.checked_sub(comparisons as u64).ok_or(())?;
        Ok(())
    }
}

/// The edges of the roof that is made of these polygons; `geographic` if they are in degrees.
///
/// # Errors
/// [`RoofError`] if there is none.
pub(super) fn edges(surfaces: &Surfaces, geographic: bool) -> Result<Vec<RoofEdge>, RoofError> {
    edges_within(surfaces, geographic, Work(MOST_WORK))
}

fn edges_within(surfaces: &Surfaces, geographic: bool, mut work: Work) -> Result<Vec<RoofEdge>, RoofError> {
    check(surfaces)?;
    let intricate = |()| RoofError::TooIntricate { points: surfaces.points().len() };
    let welded = Net::weld(surfaces, geographic, &mut work).map_err(intricate)?;
    let (net, mut sides) = welded.sides(surfaces, &mut work).map_err(intricate)?;
    let pieces = kind::pieces(&net, &mut sides);
    let joined = join::straight(&net, pieces, &mut work).map_err(intricate)?;
    let long = |piece: &kind::Piece| (net.at(piece.ends[0]) - net.at(piece.ends[1])).norm() >= SHORTEST_EDGE_M;
    let edges: Vec<RoofEdge> = joined
        .iter()
        .filter(|piece| long(piece))
        .map(|piece| {
            let [start, end] = piece.ends.map(|node| net.original(node));
            RoofEdge { kind: piece.kind, start, end }
        })
        .collect();
    if edges.is_empty() { Err(RoofError::NoEdge) } else { Ok(edges) }
}

/// Every ring must enclose something as it is written; what vanishes within the tolerance is left out later.
fn check(surfaces: &Surfaces) -> Result<(), RoofError> {
    for (polygon, rings) in surfaces.polygons().enumerate() {
        for (ring, span) in rings.enumerate() {
            let points = &surfaces.points()[span];
            let mut different: Vec<[f64; 3]> = Vec::with_capacity(3);
            for point in points {
                if different.len() < 3 && !different.contains(point) {
                    different.push(*point);
                }
            }
            if different.len() < 3 {
                return Err(RoofError::Ring { ring, polygon, points: different.len() });
            }
        }
    }
    Ok(())
}

/// Twice the area of a ring times its unit normal, by Newell's sum, which forgives points off the plane.
fn newell(points: impl Iterator<Item = Vector3<f64>> + Clone) -> Vector3<f64> {
    let Some(first) = points.clone().next() else {
        return Vector3::zeros();
    };
    let next = points.clone().skip(1).chain(std::iter::once(first));
    points.zip(next).map(|(a, b)| (a - first).cross(&(b - first))).sum()
}
