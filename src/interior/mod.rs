//! The interior orientation of scanned film: from the scan's pixels to the plate's millimetres, after Schickler and
//! Poth, "The Automatic Interior Orientation and its Daily Use" (1996).
//!
//! A scan flows through the files in this order: the marks are drawn as they should look ([`mark`], `figure`,
//! `template`), looked for through an image pyramid (`binary`, `correlation`, `search`) with a consensus on each level
//! (`consensus`), measured (`measure`), brought to the plate ([`transformation`]) in the laying that is right
//! ([`laying`], `symmetry`, [`decide`]), and the result is doubted ([`sensitivity`]) and judged ([`judge`]).

mod binary;
mod consensus;
mod correlation;
pub mod decide;
mod figure;
pub mod judge;
pub mod laying;
pub mod mark;
mod measure;
pub mod plate;
mod run;
mod search;
pub mod sensitivity;
mod symmetry;
mod template;
pub mod transformation;

use nalgebra::{Matrix2, Vector2};

pub use decide::{Basis, Decision, LayingCandidate};
pub use laying::Laying;
pub use mark::{Cut, Library, Mark};
pub use plate::{AsymmetricFeature, Fiducial, FilmCamera, Plate, Side};
pub use run::{SIGMA_FILM_MM, interior_orientation};
pub use sensitivity::Sensitivity;
pub use transformation::{Kind, Observation, Transformation};

use crate::diagnosis::{Reason, Verdict};

/// What is asked for, and what is known of the scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wanted {
    /// Side of a pixel on the film as the scan's file or its user states it; without it, the film is taken to fill the
    /// scan.
    pub pixel_mm: Option<f64>,
    /// The transformation.
    pub kind: Kind,
    /// Whether the scan is known to be wrong-reading (`true`) or right-reading.
    pub mirrored: Option<bool>,
    /// Known quarter turns of the film, counter-clockwise as one sees the scan.
    pub quarter_turns: Option<u8>,
}

impl Default for Wanted {
    fn default() -> Self {
        Self { pixel_mm: None, kind: Kind::Affine, mirrored: None, quarter_turns: None }
    }
}

/// What became of a mark.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkResult {
    /// Its name.
    pub name: String,
    /// Its calibrated position.
    pub plate_mm: Vector2<f64>,
    /// Where the transformation has it; `None` without one.
    pub predicted_px: Option<Vector2<f64>>,
    /// Where it was found.
    pub located_px: Option<Vector2<f64>>,
    /// Covariance of that.
    pub covariance_px2: Option<Matrix2<f64>>,
    /// Correlation coefficient of its template with the scan, in its own polarity.
    pub correlation: Option<f64>,
    /// Whether the transformation rests on it.
    pub used: bool,
    /// Found less predicted, on the film along the plate's axes.
    pub residual_mm: Option<Vector2<f64>>,
    /// How the transformation depends on it; `None` if it is not used or nothing checks it.
    pub sensitivity: Option<Sensitivity>,
}

/// How the transformation depends on two marks together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairSensitivity {
    /// Indices of the marks.
    pub marks: [usize; 2],
    /// The transformation that was asked: a similarity where the pair leaves the wanted one undetermined.
    pub kind: Kind,
    /// `None` if the other marks do not determine even that.
    pub sensitivity: Option<Sensitivity>,
}

/// All that is known of a scan afterwards.
#[derive(Debug, Clone, PartialEq)]
pub struct InteriorOrientation {
    /// Side of a pixel that was assumed at the beginning.
    pub pixel_mm: f64,
    /// Whether bright and dark are exchanged.
    pub negative: bool,
    /// How the film lies; `None` if no marks were found. Its first candidate is the one that all else is given for.
    pub decision: Option<Decision>,
    /// From the plate to the scan's pixels.
    pub transformation: Option<Transformation>,
    /// The marks, in the order of the plate.
    pub marks: Vec<MarkResult>,
    /// All pairs of those used.
    pub pairs: Vec<PairSensitivity>,
    /// No place of the image moves by more than this if one mark is left out; `None` if a mark cannot be.
    pub largest_change_px: Option<f64>,
    /// Nor by more than this through an error of one mark that nothing shows.
    pub largest_undetected_px: Option<f64>,
    /// Standard deviation of the worst place of the image.
    pub largest_sigma_px: f64,
    /// The traffic light.
    pub verdict: Verdict,
    /// The reason that decided first.
    pub reasons: Vec<Reason>,
}

impl InteriorOrientation {
    /// Takes over from one in which the laying was open what all candidates were, now that the image has decided.
    pub(crate) fn decided_by_content(&mut self, open: &Self) {
        self.take_candidates(open, 1, Basis::Content);
        (self.verdict, self.reasons) = judge::judge(self);
    }

    /// The same where the image could not decide.
    pub(crate) fn left_open(&mut self, open: &Self) {
        self.take_candidates(open, open.decision.as_ref().map_or(1, |decision| decision.open), Basis::Nothing);
        (self.verdict, self.reasons) = judge::judge(self);
    }

    fn take_candidates(&mut self, from: &Self, open: usize, basis: Basis) {
        let Some((laying, decision)) = self.laying().zip(from.decision.clone()) else { return };
        let mut candidates = decision.candidates;
        candidates.sort_by_key(|candidate| candidate.laying != laying);
        self.decision = Some(Decision { candidates, open, basis, test: None });
    }

    /// How the film lies, if marks were found.
    #[must_use]
    pub fn laying(&self) -> Option<Laying> {
        self.decision.as_ref().map(|decision| decision.candidates[0].laying)
    }
}
