//! Nodes, and the sides of the polygons between them.

use nalgebra::Vector3;

use super::surfaces::Surfaces;
use super::{TOLERANCE_M, Work, newell};

/// Metres of a degree of latitude; for tolerances, and the shape of a house, a sphere is good enough.
const METRES_PER_DEGREE: f64 = 111_320.0;
/// A face this steep has no upper side.
const VERTICAL: f64 = 0.05;

/// Nodes and faces of a roof, in metres about its first point.
#[derive(Debug)]
pub(super) struct Net {
    /// In the order of their place along [`sweep`].
    nodes: Vec<Vector3<f64>>,
    /// Of each node its place along [`sweep`].
    places: Vec<f64>,
    /// Of each node the point of the model.
    originals: Vec<[f64; 3]>,
    /// Of each point of the model its node.
    node_of: Vec<u32>,
    /// Of each polygon its unit normal, upwards; zero if there is nothing of it within the tolerance.
    normals: Vec<Vector3<f64>>,
}

/// A part of a side of a polygon, between neighbouring nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    /// The nodes, the lower number first.
    pub(super) ends: [u32; 2],
    /// The polygon.
    pub(super) face: u32,
    /// Whether the polygon, seen from above with its inside on the left, runs from the lower to the higher number.
    pub(super) forward: bool,
}

/// Along a direction that no row of houses has: points of one wall do not all fall on one place.
fn sweep(point: &Vector3<f64>) -> f64 {
    const DIRECTION: [f64; 3] = [0.798, 0.531, 0.284];
    DIRECTION[0] * point.x + DIRECTION[1] * point.y + DIRECTION[2] * point.z
}

impl Net {
    /// Finds nodes and faces.
    pub(super) fn weld(surfaces: &Surfaces, geographic: bool, work: &mut Work) -> Result<Self, ()> {
        let points = surfaces.points();
        let origin = points.first().copied().unwrap_or_default();
        let scale = if geographic {
            [METRES_PER_DEGREE * origin[1].to_radians().cos(), METRES_PER_DEGREE, 1.0]
        } else {
            [1.0; 3]
        };
        let local = |point: &[f64; 3]| Vector3::from_fn(|axis, _| (point[axis] - origin[axis]) * scale[axis]);
        let mut order: Vec<(f64, u32)> = (0..).zip(points).map(|(at, point)| (sweep(&local(point)), at)).collect();
        order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut net = Self {
            nodes: Vec::with_capacity(points.len() / 2),
            places: Vec::with_capacity(points.len() / 2),
            originals: Vec::with_capacity(points.len() / 2),
            node_of: vec![0; points.len()],
            normals: Vec::with_capacity(surfaces.len()),
        };
        for (place, at) in order {
            let point = local(&points[at as usize]);
            let near = net.places.iter().rev().take_while(|other| place - **other <= TOLERANCE_M).count();
            work.spend(near)?;
            let first = net.nodes.len() - near;
            let same = net.nodes[first..].iter().position(|node| (node - point).norm_squared() <= TOLERANCE_M.powi(2));
            let node = same.map_or(net.nodes.len(), |within| first + within);
            if same.is_none() {
                net.nodes.push(point);
                net.places.push(place);
                net.originals.push(points[at as usize]);
            }
            net.node_of[at as usize] = node as u32;
        }
        Ok(net)
    }

    /// Where a node is, in metres.
    pub(super) fn at(&self, node: u32) -> Vector3<f64> {
        self.nodes[node as usize]
    }

    /// The point of the model that a node is.
    pub(super) fn original(&self, node: u32) -> [f64; 3] {
        self.originals[node as usize]
    }

    /// The upward unit normal of a face.
    pub(super) fn normal(&self, face: u32) -> Vector3<f64> {
        self.normals[face as usize]
    }

    /// How many nodes there are.
    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    /// The sides of all polygons, cut at every node that lies on them. Finds the normals too.
    pub(super) fn sides(mut self, surfaces: &Surfaces, work: &mut Work) -> Result<(Self, Vec<Side>), ()> {
        let mut sides = Vec::with_capacity(surfaces.points().len());
        let mut ring = Vec::new();
        let mut on_side = Vec::new();
        for (face, rings) in (0..).zip(surfaces.polygons()) {
            let mut upwards = Vector3::zeros();
            let mut turned = false;
            for (number, span) in rings.enumerate() {
                self.nodes_of_ring(&self.node_of[span], &mut ring);
                let area = newell(ring.iter().map(|node| self.at(*node)));
                if number == 0 {
                    if self.vanishes(&ring, &area) {
                        break;
                    }
                    turned = area.z < -VERTICAL * area.norm();
                    upwards = if turned { -area.normalize() } else { area.normalize() };
                }
                // a hole runs the other way round than the outer ring, whatever the file says
                let reversed = if number == 0 { turned } else { area.dot(&upwards) > 0.0 };
                self.cut(&ring, face, reversed, &mut sides, &mut on_side, work)?;
            }
            self.normals.push(upwards);
        }
        Ok((self, sides))
    }

    /// The nodes of a ring, none twice in a row.
    fn nodes_of_ring(&self, points: &[u32], ring: &mut Vec<u32>) {
        ring.clear();
        for node in points {
            if ring.last() != Some(node) {
                ring.push(*node);
            }
        }
        while ring.len() > 1 && ring.first() == ring.last() {
            ring.pop();
        }
    }

    /// Whether a polygon is a sliver: its neighbours meet across it.
    fn vanishes(&self, ring: &[u32], twice_area: &Vector3<f64>) -> bool {
        let next = ring.iter().cycle().skip(1);
        let length: f64 = ring.iter().zip(next).map(|(a, b)| (self.at(*a) - self.at(*b)).norm()).sum();
        ring.len() < 3 || twice_area.norm() < TOLERANCE_M * length
    }

    fn cut(
        &self,
        ring: &[u32],
        face: u32,
        reversed: bool,
        sides: &mut Vec<Side>,
        on_side: &mut Vec<(f64, u32)>,
        work: &mut Work,
    ) -> Result<(), ()> {
        for (from, to) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            if from == to {
                continue;
            }
            self.nodes_between(*from, *to, on_side, work)?;
            let mut last = *from;
            for next in on_side.iter().map(|(_, node)| *node).chain(std::iter::once(*to)) {
                let ends = [last.min(next), last.max(next)];
                sides.push(Side { ends, face, forward: (last < next) != reversed });
                last = next;
            }
        }
        Ok(())
    }

    /// The nodes that lie on the way from one to another, in their order on it.
    fn nodes_between(&self, from: u32, to: u32, found: &mut Vec<(f64, u32)>, work: &mut Work) -> Result<(), ()> {
        found.clear();
        let (start, way) = (self.at(from), self.at(to) - self.at(from));
        let length = way.norm();
        let along = way / length;
        let (low, high) = (from.min(to) as usize, from.max(to) as usize);
        // a node beside an end of the side may lie a little before it in the sweep
        let (first, end) = (self.places[low] - TOLERANCE_M, self.places[high] + TOLERANCE_M);
        let first = low - self.places[..low].iter().rev().take_while(|place| **place >= first).count();
        let end = high + self.places[high..].iter().take_while(|place| **place <= end).count();
        work.spend(end - first)?;
        for (node, place) in (first as u32..).zip(&self.nodes[first..end]) {
            let offset = place - start;
            let at = offset.dot(&along);
            let within = at > TOLERANCE_M / 2.0 && at < length - TOLERANCE_M / 2.0;
            if within && node != from && node != to && offset.norm_squared() - at * at <= TOLERANCE_M.powi(2) {
                found.push((at, node));
            }
        }
        // each is held in memory as a side of its own
        work.spend(found.len() * 100)?;
        found.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        Ok(())
    }
}
