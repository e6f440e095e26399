//! How well the edges of a roof are known, by their kind.
//!
//! Models of level of detail 2 stand on the outlines of the cadastre, which are the walls. The roof goes on beyond them
//! by 0.3 to 0.8 m, which these models do not have: eaves and verges of the image lie outside of those of the model, by
//! an amount that nobody knows. Ridges, hips and valleys do not depend on it: an overhang goes on in the planes of the
//! roof, so that the lines in which they meet stay where they are.

use crate::buildings::EdgeKind;

/// What a building model's coordinates are good to if nobody says: roofs from laser scanning with some points a square
/// metre, fitted to the outlines of the cadastre. Where the model says how far a roof is off the points that it was made
/// from, as 3DBAG does, that comes on top.
pub const MODEL_SIGMA_M: f64 = 0.15;
/// Of an eave or verge: the root mean square of 0.3 to 0.8 m.
const OVERHANG_M: f64 = 0.57;
/// Of the rim of a flat roof, which as a rule has none; but its parapet has two edges, and sheet metal on top.
const PARAPET_M: f64 = 0.3;

/// The standard deviation of an edge across itself, if the model is good to `stated_m`.
#[must_use]
pub fn edge_sigma_m(kind: EdgeKind, stated_m: f64) -> f64 {
    match kind {
        EdgeKind::Eave | EdgeKind::Gable => stated_m.hypot(OVERHANG_M),
        EdgeKind::Rim => stated_m.hypot(PARAPET_M),
        EdgeKind::Ridge | EdgeKind::Hip | EdgeKind::Valley => stated_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_an_overhang_moves_is_less_sure_by_it() {
        // uniform from 0.3 to 0.8 m
        let mean_square = (0.8_f64.powi(3) - 0.3_f64.powi(3)) / (3.0 * 0.5);
        assert!((OVERHANG_M - mean_square.sqrt()).abs() < 0.01);
        assert_eq!(edge_sigma_m(EdgeKind::Ridge, 0.15), 0.15);
        assert!(edge_sigma_m(EdgeKind::Eave, 0.15) > edge_sigma_m(EdgeKind::Rim, 0.15));
    }
}
