//! What the edges are.

use nalgebra::Vector3;

use super::net::{Net, Side};
use crate::buildings::EdgeKind;

/// Rise over run up to which an edge or a face is level: 3°, below the slope of any roof that is not called flat, and
/// above what centimetres do to a short ridge.
const LEVEL: f64 = 0.0524;
/// Cosine of the angle (2°) up to which two faces are one: triangles of a plane with coordinates in centimetres.
const COPLANAR: f64 = 0.999_391;

/// An edge between two nodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Piece {
    /// What it is.
    pub(super) kind: EdgeKind,
    /// Its nodes.
    pub(super) ends: [u32; 2],
}

/// Every pair of nodes between which there is an edge, once.
pub(super) fn pieces(net: &Net, sides: &mut [Side]) -> Vec<Piece> {
    sides.sort_unstable();
    let mut pieces = Vec::with_capacity(sides.len());
    let mut faces = Vec::new();
    for group in sides.chunk_by(|a, b| a.ends == b.ends) {
        different_faces(net, group, &mut faces);
        if let Some(kind) = kind(net, &faces) {
            pieces.push(Piece { kind, ends: group[0].ends });
        }
    }
    pieces
}

/// The sides that count: not those on which a polygon meets itself, as on the way to a hole that was cut open, and one
/// of several that lie on each other.
fn different_faces(net: &Net, group: &[Side], faces: &mut Vec<Side>) {
    faces.clear();
    // sides of one face follow each other
    for of_face in group.chunk_by(|a, b| a.face == b.face) {
        let side = of_face[0];
        let meets_itself = of_face.iter().any(|other| other.forward != side.forward);
        let lies_on = |other: &Side| {
            other.forward == side.forward && net.normal(other.face).dot(&net.normal(side.face)) > COPLANAR
        };
        if !meets_itself && !faces.iter().any(lies_on) {
            faces.push(side);
        }
    }
}

fn kind(net: &Net, faces: &[Side]) -> Option<EdgeKind> {
    let [first, others @ ..] = faces else {
        return None;
    };
    let bend = |a: &Side, b: &Side| net.normal(a.face).dot(&net.normal(b.face));
    let opposite = others.iter().filter(|other| other.forward != first.forward);
    // where more than two meet, those that meet at the sharpest angle are seen
    match opposite.min_by(|a, b| bend(first, a).total_cmp(&bend(first, b))) {
        Some(other) if bend(first, other) > COPLANAR => None,
        Some(other) => Some(shared(net, first, other)),
        None => Some(outer(net, first)),
    }
}

/// The unit vector in the face, away from its side.
fn inwards(net: &Net, side: &Side) -> Vector3<f64> {
    let way = (net.at(side.ends[1]) - net.at(side.ends[0])).normalize();
    net.normal(side.face).cross(&if side.forward { way } else { -way })
}

fn is_level(net: &Net, side: &Side) -> bool {
    let way = net.at(side.ends[1]) - net.at(side.ends[0]);
    way.z.abs() <= LEVEL * way.xy().norm()
}

fn outer(net: &Net, side: &Side) -> EdgeKind {
    let normal = net.normal(side.face);
    if normal.xy().norm() <= LEVEL * normal.z.abs() {
        EdgeKind::Rim
    } else if is_level(net, side) && inwards(net, side).z > 0.0 {
        EdgeKind::Eave
    } else {
        EdgeKind::Gable
    }
}

fn shared(net: &Net, side: &Side, other: &Side) -> EdgeKind {
    if inwards(net, other).dot(&net.normal(side.face)) > 0.0 {
        EdgeKind::Valley
    } else if is_level(net, side) {
        EdgeKind::Ridge
    } else {
        EdgeKind::Hip
    }
}
