//! What the command line says of a scan of film.

use crate::jobs::request::{Reading, ScanRequest, TransformationKind};
use clap::{Args, ValueEnum};

/// How a scan of film is brought to its camera's plate.
#[derive(Debug, Args)]
#[command(next_help_heading = "Scan of film")]
pub(crate) struct ScanFlags {
    /// Side of a pixel on the film. [default: what the TIFF says; else the film is taken to fill the scan]
    #[arg(long, value_name = "UM")]
    pixel_size_um: Option<f64>,
    /// The transformation from the camera's plate to the scan. [default: affine]
    #[arg(long, value_enum, value_name = "KIND")]
    transformation: Option<KindName>,
    /// Whether the scan shows the scene as it is seen (right) or its mirror image. [default: found out]
    #[arg(long, value_enum, value_name = "WAY")]
    reading: Option<ReadingName>,
    /// Quarter turns of the film, counter-clockwise as one sees the scan, 0 to 3. [default: found out]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=3))]
    quarter_turns: Option<u8>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum KindName {
    Similarity,
    Affine,
    Projective,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ReadingName {
    Right,
    Wrong,
}

impl ScanFlags {
    /// What was said; `None` if nothing was.
    pub(crate) fn request(&self) -> Option<ScanRequest> {
        let scan = ScanRequest {
            pixel_size_um: self.pixel_size_um,
            transformation: match self.transformation {
                Some(KindName::Similarity) => TransformationKind::Similarity,
                Some(KindName::Projective) => TransformationKind::Projective,
                Some(KindName::Affine) | None => TransformationKind::Affine,
            },
            reading: self.reading.map(|reading| match reading {
                ReadingName::Right => Reading::Right,
                ReadingName::Wrong => Reading::Wrong,
            }),
            quarter_turns: self.quarter_turns,
        };
        (scan != ScanRequest::default()).then_some(scan)
    }
}
