//! A control point as it is kept: geocentric, whatever CRS it came in, so that it can be brought into the local frame
//! of any image and into any output CRS without loss.

use chrono::NaiveDate;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::buildings::EdgeKind;
use crate::geometry::{LocalFrame, Segment3};
use crate::orientation::ControlPoint;

/// What a control point is there for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize, ToSchema, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Use {
    /// Images are oriented by it.
    #[default]
    Control,
    /// It is never used: what an image shows of it tells how right an orientation is.
    Check,
}

/// The days on which a building stands as it is described, the first and the last one included.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Validity {
    /// `None`: from the beginning.
    pub from: Option<NaiveDate>,
    /// `None`: until further notice.
    pub to: Option<NaiveDate>,
}

/// An edge of a roof.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredEdge {
    /// Where it is, geocentric.
    pub geocentric_m: Segment3,
    /// What kind it is, if that is known.
    pub kind: Option<EdgeKind>,
    /// Standard deviation across itself, the accuracy of the transformation from its CRS included.
    pub sigma_m: f64,
}

/// A control point in geocentric coordinates (WGS 84, metres).
#[derive(Debug, Clone, PartialEq)]
pub struct StoredControlPoint {
    /// Its name, unique within its set.
    pub name: String,
    /// Standard deviation of its coordinates, the accuracy of the transformation from its CRS included.
    pub sigma_m: f64,
    /// Its reference point.
    pub reference_geocentric_m: Vector3<f64>,
    /// Its edges.
    pub edges: Vec<StoredEdge>,
    /// What it is there for.
    pub purpose: Use,
    /// When it stands like this.
    pub validity: Validity,
}

impl StoredControlPoint {
    /// The control point in the local frame in which an image is oriented.
    #[must_use]
    pub fn in_frame(&self, frame: &LocalFrame) -> ControlPoint {
        let local = |point: Vector3<f64>| frame.from_geocentric(point);
        let alike = self.edges.iter().all(|edge| edge.sigma_m == self.sigma_m);
        ControlPoint {
            name: self.name.clone(),
            sigma_m: self.sigma_m,
            reference_m: local(self.reference_geocentric_m),
            edges_m: self
                .edges
                .iter()
                .map(|edge| Segment3 { start: local(edge.geocentric_m.start), end: local(edge.geocentric_m.end) })
                .collect(),
            edge_sigmas_m: if alike { Vec::new() } else { self.edges.iter().map(|edge| edge.sigma_m).collect() },
            scene: None,
        }
    }

    /// The mean of the middles of edges, which is the reference point where none is given.
    #[must_use]
    pub fn middle_of(edges: &[StoredEdge]) -> Vector3<f64> {
        edges.iter().map(|edge| edge.geocentric_m.midpoint()).sum::<Vector3<f64>>() / edges.len() as f64
    }

    /// All points that make it up: the reference and the ends of its edges.
    pub fn points(&self) -> impl Iterator<Item = Vector3<f64>> + Clone + '_ {
        let ends = self.edges.iter().flat_map(|edge| [edge.geocentric_m.start, edge.geocentric_m.end]);
        std::iter::once(self.reference_geocentric_m).chain(ends)
    }

    /// How far it reaches from its reference point.
    #[must_use]
    pub fn extent_m(&self) -> f64 {
        self.points().map(|point| (point - self.reference_geocentric_m).norm()).fold(0.0, f64::max)
    }
}
