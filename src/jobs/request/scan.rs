//! What is known of a scan of film, and what is wanted of its interior orientation.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{Faults, within};
use crate::interior::{Kind, Wanted};

/// Pixels of film scans, micrometres.
const PIXEL_UM: [f64; 2] = [1.0, 500.0];

/// How a scan is to be brought to its camera's plate. All of it may be left out.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ScanRequest {
    /// Side of a pixel on the film. Default: what the file says (resolution of a TIFF); without that the film is taken to
    /// fill the scan.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = 15.0)]
    pub pixel_size_um: Option<f64>,
    /// The transformation from plate to scan.
    pub transformation: TransformationKind,
    /// Whether the scan shows the scene as it is seen or its mirror image. Default: found out.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null))]
    pub reading: Option<Reading>,
    /// Quarter turns by which the film lies turned, counter-clockwise as one sees the scan, 0 to 3. Default: found out.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null), maximum = 3)]
    pub quarter_turns: Option<u8>,
}

/// How the film may be deformed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum TransformationKind {
    /// Shift, turn and one scale.
    Similarity,
    /// Also different scales and a shear, as films shrink.
    #[default]
    Affine,
    /// Also a tilt.
    Projective,
}

/// Whether text on the film can be read in the scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Reading {
    /// As the scene is seen.
    Right,
    /// Mirrored.
    Wrong,
}

impl ScanRequest {
    /// Notes what makes no sense; `pointer` is that of the object.
    pub(in crate::jobs) fn check(&self, pointer: &str, faults: &mut Faults) {
        if let Some(pixel_um) = self.pixel_size_um {
            faults.check(&format!("{pointer}/pixel_size_um"), within(pixel_um, PIXEL_UM[0], PIXEL_UM[1], "µm"));
        }
        if let Some(turns) = self.quarter_turns.filter(|turns| *turns > 3) {
            faults.add(format!("{pointer}/quarter_turns"), format!("{turns} is not 0, 1, 2 or 3"));
        }
    }

    /// For the interior orientation of a file that says `file_pixel_um`.
    #[must_use]
    pub fn wanted(&self, file_pixel_um: Option<f64>) -> Wanted {
        Wanted {
            pixel_mm: self.pixel_size_um.or(file_pixel_um).map(|um| um / 1000.0),
            kind: match self.transformation {
                TransformationKind::Similarity => Kind::Similarity,
                TransformationKind::Affine => Kind::Affine,
                TransformationKind::Projective => Kind::Projective,
            },
            mirrored: self.reading.map(|reading| reading == Reading::Wrong),
            quarter_turns: self.quarter_turns,
        }
    }
}
