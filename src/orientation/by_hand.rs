//! What staff who look at the image say of its control points: which are not to be used, and where others are.

use nalgebra::{Matrix2, Vector2};

use super::ControlPoint;
use super::gate::Located;
use super::predict::Approximation;
use super::search::Search;
use super::sight::SceneLooks;
use crate::geometry::Camera;
use crate::scenes::Measured;

/// How well somebody points who has the image before him, magnified.
pub const SIGMA_BY_HAND_PX: f64 = 1.5;

/// What was said, by the indices of the control points.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ByHand {
    /// Not to be used.
    pub off: Vec<usize>,
    /// Where reference points are, reduced pixels.
    pub places: Vec<(usize, Vector2<f64>)>,
    /// The scenes as they were found before, if they are not to be looked for again: that takes a second, and where a
    /// scene is does not depend on what was corrected.
    pub scenes: Option<Vec<SeenScene>>,
}

/// A scene that was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenScene {
    /// Its control point.
    pub control_point: usize,
    /// Its reference, measured.
    pub measured: Measured,
    /// Where SIFT has seen it; `None` if it was measured where it was predicted.
    pub located: Option<Located>,
}

impl<'a> Search<'a> {
    /// A search with what staff say. Where the scenes are known, they need not be drawn as the image would show them.
    #[must_use]
    pub fn with(
        camera: &'a Camera,
        control: &'a [ControlPoint],
        approximation: &'a Approximation,
        by_hand: ByHand,
    ) -> Self {
        let looks = match &by_hand.scenes {
            None => SceneLooks::of(camera, control, &approximation.orientation),
            Some(_) => SceneLooks::none(),
        };
        Self { camera, control, approximation, looks, by_hand }
    }

    /// Whether a control point may be used.
    #[must_use]
    pub fn is_on(&self, control_point: usize) -> bool {
        !self.by_hand.off.contains(&control_point)
    }

    /// The scenes that were found before and are neither switched off nor moved.
    pub(super) fn seen_scenes(&self) -> impl Iterator<Item = &SeenScene> {
        let seen = self.by_hand.scenes.iter().flatten();
        seen.filter(|seen| self.is_on(seen.control_point) && self.placed(seen.control_point).is_none())
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
