//! A control point as it is kept: geocentric, whatever CRS it came in, so that it can be brought into the local frame
//! of any image and into any output CRS without loss.

use nalgebra::Vector3;

use crate::geometry::{LocalFrame, Segment3};
use crate::orientation::ControlPoint;

/// A control point in geocentric coordinates (WGS 84, metres).
#[derive(Debug, Clone, PartialEq)]
pub struct StoredControlPoint {
    /// Its unique name.
    pub name: String,
    /// Standard deviation of its coordinates, the accuracy of the transformation from its CRS included.
    pub sigma_m: f64,
    /// Its reference point.
    pub reference_geocentric_m: Vector3<f64>,
    /// Its edges.
    pub edges_geocentric_m: Vec<Segment3>,
}

const BYTES_PER_EDGE: usize = 6 * size_of::<f64>();

impl StoredControlPoint {
    /// The control point in the local frame in which an image is oriented.
    #[must_use]
    pub fn in_frame(&self, frame: &LocalFrame) -> ControlPoint {
        let local = |point: Vector3<f64>| frame.from_geocentric(point);
        ControlPoint {
            name: self.name.clone(),
            sigma_m: self.sigma_m,
            reference_m: local(self.reference_geocentric_m),
            edges_m: self
                .edges_geocentric_m
                .iter()
                .map(|edge| Segment3 { start: local(edge.start), end: local(edge.end) })
                .collect(),
            scene: None,
        }
    }

    /// The edges as the database keeps them: six little-endian f64 an edge.
    #[must_use]
    pub fn edges_to_bytes(&self) -> Vec<u8> {
        self.edges_geocentric_m
            .iter()
            .flat_map(|edge| edge.start.iter().chain(edge.end.iter()).copied().collect::<Vec<_>>())
            .flat_map(f64::to_le_bytes)
            .collect()
    }

    /// The reverse of [`Self::edges_to_bytes`]; `None` if the length is not that of whole edges.
    #[must_use]
    pub fn edges_from_bytes(bytes: &[u8]) -> Option<Vec<Segment3>> {
        let (edges, rest) = bytes.as_chunks::<BYTES_PER_EDGE>();
        if !rest.is_empty() {
            return None;
        }
        let edge = |bytes: &[u8; BYTES_PER_EDGE]| {
            let (numbers, _) = bytes.as_chunks::<8>();
            let number = |i: usize| f64::from_le_bytes(numbers[i]);
            Segment3 {
                start: Vector3::new(number(0), number(1), number(2)),
                end: Vector3::new(number(3), number(4), number(5)),
            }
        };
        Some(edges.iter().map(edge).collect())
    }

    /// All points that make it up: the reference and the ends of its edges.
    pub fn points(&self) -> impl Iterator<Item = Vector3<f64>> + '_ {
        std::iter::once(self.reference_geocentric_m)
            .chain(self.edges_geocentric_m.iter().flat_map(|edge| [edge.start, edge.end]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_come_back_from_their_bytes_to_the_last_bit() {
        let edge = |x: f64| Segment3 {
            start: Vector3::new(3.7e6 + x, -0.1, 5.05e6 / 3.0),
            end: Vector3::new(x, f64::MIN_POSITIVE, 1.0),
        };
        let point = StoredControlPoint {
            name: "church".into(),
            sigma_m: 0.1,
            reference_geocentric_m: Vector3::zeros(),
            edges_geocentric_m: vec![edge(0.123), edge(77.7)],
        };
        let bytes = point.edges_to_bytes();
        assert_eq!(bytes.len(), 96);
        assert_eq!(StoredControlPoint::edges_from_bytes(&bytes), Some(point.edges_geocentric_m));
        assert_eq!(StoredControlPoint::edges_from_bytes(&bytes[1..]), None);
    }
}
