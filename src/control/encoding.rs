//! The edges of a control point as the database keeps them.
//!
//! Edges of which nothing is known but where they are, as of a GeoJSON file, are six little-endian f64 each: start x, y,
//! z, end x, y, z, geocentric metres. They come back to the last bit.
//!
//! Those with a kind or an accuracy of their own, as of building models, of which there are hundreds of millions, are a
//! byte with the version, and then 27 bytes each: the ends less the reference point as six little-endian i32 in units of
//! 0.1 mm, the kind as a byte (0 for none), and the standard deviation across the edge as a little-endian u16 in mm.
//!
//! The length tells which: 48 m = 1 + 27 n has no solution, for 48 and 27 are both divisible by 3.

use nalgebra::Vector3;

use super::model::StoredEdge;
use crate::buildings::EdgeKind;
use crate::geometry::Segment3;

const EXACT: usize = 6 * size_of::<f64>();
const COMPACT: usize = 6 * size_of::<i32>() + 3;
const VERSION: u8 = 1;
/// Units of a compact coordinate in a metre.
const UNITS: f64 = 10_000.0;

/// The bytes of the edges of a control point.
#[must_use]
pub(super) fn to_bytes(edges: &[StoredEdge], sigma_m: f64, reference_geocentric_m: Vector3<f64>) -> Vec<u8> {
    let numbers = |edge: &StoredEdge| {
        let Segment3 { start, end } = edge.geocentric_m;
        [start.x, start.y, start.z, end.x, end.y, end.z]
    };
    if edges.iter().all(|edge| edge.kind.is_none() && edge.sigma_m == sigma_m) {
        return edges.iter().flat_map(numbers).flat_map(f64::to_le_bytes).collect();
    }
    let mut bytes = Vec::with_capacity(1 + COMPACT * edges.len());
    bytes.push(VERSION);
    for edge in edges {
        for (axis, number) in numbers(edge).into_iter().enumerate() {
            let units = ((number - reference_geocentric_m[axis % 3]) * UNITS).round();
            bytes.extend((units as i32).to_le_bytes());
        }
        bytes.push(edge.kind.map_or(0, EdgeKind::code));
        let sigma_mm = (1_000.0 * edge.sigma_m).round().clamp(1.0, f64::from(u16::MAX));
        bytes.extend((sigma_mm as u16).to_le_bytes());
    }
    bytes
}

/// The reverse of [`to_bytes`]; `None` if it was not that which wrote them.
#[must_use]
pub(super) fn from_bytes(bytes: &[u8], sigma_m: f64, reference_geocentric_m: Vector3<f64>) -> Option<Vec<StoredEdge>> {
    let (exact, rest) = bytes.as_chunks::<EXACT>();
    if rest.is_empty() {
        return Some(exact.iter().map(|edge| exact_edge(edge, sigma_m)).collect());
    }
    let (version, bytes) = bytes.split_first()?;
    let (compact, rest) = bytes.as_chunks::<COMPACT>();
    if *version != VERSION || !rest.is_empty() {
        return None;
    }
    compact.iter().map(|edge| compact_edge(edge, reference_geocentric_m)).collect()
}

fn exact_edge(bytes: &[u8; EXACT], sigma_m: f64) -> StoredEdge {
    let (numbers, _) = bytes.as_chunks::<8>();
    let number = |i: usize| f64::from_le_bytes(numbers[i]);
    let [start, end] = [0, 3].map(|i| Vector3::new(number(i), number(i + 1), number(i + 2)));
    StoredEdge { geocentric_m: Segment3 { start, end }, kind: None, sigma_m }
}

fn compact_edge(bytes: &[u8; COMPACT], reference_geocentric_m: Vector3<f64>) -> Option<StoredEdge> {
    let (numbers, rest) = bytes.as_chunks::<4>();
    let &[kind, low, high] = rest else { return None };
    let number = |i: usize| f64::from(i32::from_le_bytes(numbers[i])) / UNITS;
    let [start, end] = [0, 3].map(|i| reference_geocentric_m + Vector3::new(number(i), number(i + 1), number(i + 2)));
    let kind = match kind {
        0 => None,
        code => Some(EdgeKind::from_code(code)?),
    };
    let sigma_m = f64::from(u16::from_le_bytes([low, high])) / 1_000.0;
    Some(StoredEdge { geocentric_m: Segment3 { start, end }, kind, sigma_m })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn edge(x: f64, kind: Option<EdgeKind>, sigma_m: f64) -> StoredEdge {
        let start = Vector3::new(3.7e6 + x, -0.1, 5.05e6 / 3.0);
        StoredEdge { geocentric_m: Segment3 { start, end: start + Vector3::new(x, 0.3, -1.0) }, kind, sigma_m }
    }

    #[test]
    fn edges_of_which_nothing_else_is_known_come_back_to_the_last_bit() {
        let edges = vec![edge(0.123, None, 0.1), edge(77.7, None, 0.1)];
        let bytes = to_bytes(&edges, 0.1, Vector3::zeros());
        assert_eq!(bytes.len(), 96);
        assert_eq!(from_bytes(&bytes, 0.1, Vector3::zeros()), Some(edges));
        assert_eq!(from_bytes(&bytes[1..], 0.1, Vector3::zeros()), None);
    }

    #[test]
    fn no_two_ways_have_the_same_length() {
        let exact: Vec<usize> = (0..2_001).map(|n| EXACT * n).collect();
        assert!((0..4_000).all(|n| exact.binary_search(&(1 + COMPACT * n)).is_err()));
    }

    #[test]
    fn what_another_version_wrote_is_not_read() {
        let bytes = to_bytes(&[edge(0.0, Some(EdgeKind::Hip), 0.1)], 0.1, Vector3::zeros());
        for (place, value) in [(0, 2), (25, 7)] {
            let mut other = bytes.clone();
            other[place] = value;
            assert_eq!(from_bytes(&other, 0.1, Vector3::zeros()), None);
        }
    }

    proptest! {
        /// Within half a unit, wherever on the earth and up to the largest control point there may be.
        #[test]
        fn compact_edges_come_back_within_a_tenth_of_a_millimetre(
            reference in prop::array::uniform3(-6.4e6_f64..6.4e6),
            ends in prop::collection::vec(prop::array::uniform6(-2_000.0_f64..2_000.0), 1..9),
            kind in 0..6_usize,
            sigma_m in 0.001_f64..60.0,
        ) {
            let reference = Vector3::from(reference);
            let edges: Vec<StoredEdge> = ends.iter().map(|[a, b, c, d, e, f]| {
                let (start, end) = (reference + Vector3::new(*a, *b, *c), reference + Vector3::new(*d, *e, *f));
                StoredEdge { geocentric_m: Segment3 { start, end }, kind: Some(EdgeKind::ALL[kind]), sigma_m }
            }).collect();
            let bytes = to_bytes(&edges, 0.1, reference);
            prop_assert_eq!(bytes.len(), 1 + 27 * edges.len());
            for (back, edge) in from_bytes(&bytes, 0.1, reference).unwrap().iter().zip(&edges) {
                prop_assert!((back.geocentric_m.start - edge.geocentric_m.start).amax() < 5.1e-5);
                prop_assert!((back.geocentric_m.end - edge.geocentric_m.end).amax() < 5.1e-5);
                prop_assert!(back.kind == edge.kind && (back.sigma_m - sigma_m).abs() < 5.1e-4);
            }
        }
    }
}
