//! Which of the located control points are right? Version A of Förstner and Läbe (section 2.2, step 2), and the largest
//! consistent set, which is what their version B looks for.

mod eight;
mod exact;
mod lanes;
mod quadruples;
mod whitened;

use super::PointObservation;
use super::resection::Resection;

pub use exact::largest_consistent;
pub use quadruples::quadruples;

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

fn select(points: &[PointObservation], chosen: &[usize]) -> Vec<PointObservation> {
    chosen.iter().map(|&index| points[index]).collect()
}

#[cfg(test)]
mod plain;
#[cfg(test)]
mod tests;
