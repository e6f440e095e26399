//! What staff who look at the image say of its control points: which are not to be used, and where others are.

use nalgebra::{Matrix2, Vector2};

use super::search::Search;
use crate::scenes::Measured;

/// How well somebody points who has the image before him, magnified.
const SIGMA_BY_HAND_PX: f64 = 1.5;

/// What was said, by the indices of the control points.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ByHand {
    /// Not to be used.
    pub off: Vec<usize>,
    /// Where reference points are, reduced pixels.
    pub places: Vec<(usize, Vector2<f64>)>,
}

impl Search<'_> {
    /// The same, with what staff say.
    #[must_use]
    pub fn with(self, by_hand: ByHand) -> Self {
        Self { by_hand, ..self }
    }

    /// Whether a control point may be used.
    #[must_use]
    pub fn is_on(&self, control_point: usize) -> bool {
        !self.by_hand.off.contains(&control_point)
    }

    /// Where somebody has seen a control point.
    #[must_use]
    pub fn placed(&self, control_point: usize) -> Option<Measured> {
        let place = self.by_hand.places.iter().find(|(k, _)| *k == control_point);
        place.map(|(_, at_px)| Measured {
            at_px: *at_px,
            covariance: Matrix2::identity() * SIGMA_BY_HAND_PX.powi(2),
            correlation: 1.0,
        })
    }
}
