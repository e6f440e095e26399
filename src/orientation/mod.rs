//! The orientation of one image, a file a stage, in the order in which data flows.

pub mod adjust;
pub mod by_hand;
pub mod check;
pub mod collect;
pub mod extract;
pub mod gate;
pub mod hypotheses;
pub mod locate;
pub mod matching;
pub mod parallels;
mod places;
pub mod predict;
mod reliability;
pub mod search;
pub mod select;
pub mod shifts;
mod sight;
pub mod views;

use std::sync::Arc;

use nalgebra::Vector3;

use crate::geometry::Segment3;
use crate::scenes::Scene;

/// A control point: a building's roof edges in space with a reference point, as in Förstner and Läbe, figure 2, or the
/// reference point of a control scene.
/// Coordinates are in the local tangent plane in which the image is oriented.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlPoint {
    /// Its unique name.
    pub name: String,
    /// Standard deviation of its coordinates.
    pub sigma_m: f64,
    /// The reference point.
    pub reference_m: Vector3<f64>,
    /// The edges; none of a control scene.
    pub edges_m: Vec<Segment3>,
    /// Standard deviations of the edges across themselves, where they are not all as good as the coordinates are in
    /// general: eaves of which only the wall is known. One for each edge, or none at all.
    pub edge_sigmas_m: Vec<f64>,
    /// The picture of a control scene; `None` for a building.
    pub scene: Option<Arc<Scene>>,
}

impl ControlPoint {
    /// The standard deviation of an edge across itself.
    #[must_use]
    pub fn edge_sigma_m(&self, edge: usize) -> f64 {
        self.edge_sigmas_m.get(edge).copied().unwrap_or(self.sigma_m)
    }
}
