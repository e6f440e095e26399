//! Which of the located control points are right? Version A of Förstner and Läbe (section 2.2, step 2), and the largest
//! consistent set, which is what their version B looks for.

mod eight;
mod exact;
mod lanes;
mod quadruples;
mod sample;
mod whitened;

use super::{PointObservation, Prior, Resection, resect};
use crate::geometry::ExteriorOrientation;

pub use exact::largest_consistent;
pub use quadruples::quadruples;

/// Points of which some may be wrong, and what is known of the orientation.
#[derive(Debug, Clone, Copy)]
pub struct Survey<'a> {
    /// The points, surest first: where there are too many for all subsets, the first ones are looked at.
    pub points: &'a [PointObservation],
    /// Prior knowledge, an observation in every resection.
    pub prior: Option<&'a Prior>,
    /// Where resections start.
    pub start: ExteriorOrientation,
    /// The camera's principal distance.
    pub principal_distance_px: f64,
}

impl Survey<'_> {
    /// The resection with some of the points.
    fn resect(&self, chosen: &[usize], near: &ExteriorOrientation) -> Option<Resection> {
        let points: Vec<PointObservation> = chosen.iter().map(|&index| self.points[index]).collect();
        resect(&points, self.prior, near, self.principal_distance_px)
    }

    /// The squared distance of a point from where an orientation projects it.
    fn squared_px(&self, point: &PointObservation, at: &ExteriorOrientation) -> f64 {
        let projected = at.reduced_px(self.principal_distance_px, point.object_m);
        projected.map_or(f64::INFINITY, |image| (image - point.image_px).norm_squared())
    }
}

/// The orientation that the points agree upon.
#[derive(Debug, Clone, PartialEq)]
pub struct Consensus {
    /// The resection with the inliers.
    pub resection: Resection,
    /// Indices of the points that are right, ascending.
    pub inliers: Vec<usize>,
    /// What is known of the sets that are not the answer.
    pub guarantee: Guarantee,
    /// Subsets of the points that were examined.
    pub subsets: usize,
    /// A selection of them, at most 64: those with the smallest residuals, and a draw of all that is the same in every
    /// run. Indices of the points, ascending.
    pub examined: Vec<Vec<usize>>,
}

/// How far a search has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Guarantee {
    /// To its end: there is no better answer.
    Complete,
    /// To the end of its budget: an answer has `at_most` so many points.
    Bounded {
        /// Upper bound of the number of points that agree.
        at_most: usize,
    },
    /// Some subsets have been looked at, and nothing is known of the others.
    Sampled,
}

impl Guarantee {
    /// Its name in answers: `complete`, `bounded` or `sampled`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Complete => "complete",
            Self::Bounded { .. } => "bounded",
            Self::Sampled => "sampled",
        }
    }
}

/// Fewer points than this do not check each other.
const LEAST_POINTS: usize = 4;

/// Points that are searched, those that come first: C(40, 4) = 91 390 quadruples.
const MOST_POINTS: usize = 40;

#[cfg(test)]
mod plain;
#[cfg(test)]
mod tests;
