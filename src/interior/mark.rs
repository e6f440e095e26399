//! What fiducial marks look like.

use nalgebra::Vector2;

/// The figures that Gable brings along, drawn by ourselves after descriptions and pictures of the cameras' marks, bright
/// on dark as in a positive; sizes in millimetres on the film. Where a camera's marks differ, a template cut from one of
/// its scans serves better ([`Cut`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Library {
    /// Wild RC5, RC8: a diagonal cross with its junction left out, in the dark corner.
    WildRc5,
    /// Wild RC10: ring, upright cross and dot.
    WildRc10,
    /// Wild RC20: dot within an upright cross.
    WildRc20,
    /// Leica RC30: dot, small ring and four arms.
    LeicaRc30,
    /// Zeiss RMK: a dark wedge from the frame's side into the image, with a bright dot near its tip.
    ZeissRmk,
    /// Zeiss RMK TOP: dot, square and cross.
    ZeissRmkTop,
    /// Fairchild T-11, T-12: a pinhole inside the frame beside a notch.
    FairchildPinhole,
    /// Fairchild K-17 and others: the tip of a dark wing.
    FairchildWing,
    /// An arrow, as an asymmetric feature (direction of flight).
    Arrow,
    /// A bar, as an asymmetric feature.
    Bar,
}

/// A template cut from a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct Cut {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row, as in the scan, y down.
    pub grey: Vec<f32>,
    /// Which pixels belong to the mark; the others are don't-care.
    pub care: Vec<bool>,
    /// Where the mark's centre is, pixels from the corner of the top-left pixel.
    pub centre_px: Vector2<f64>,
    /// Side of a pixel on the film.
    pub pixel_mm: f64,
}

/// What a mark looks like, in a frame of its own with x to the right and y up.
#[derive(Debug, Clone, PartialEq)]
pub enum Mark {
    /// One of those that Gable brings along.
    Library(Library),
    /// One that a user cut from a scan.
    Cut(Cut),
}

impl Library {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::WildRc5,
        Self::WildRc10,
        Self::WildRc20,
        Self::LeicaRc30,
        Self::ZeissRmk,
        Self::ZeissRmkTop,
        Self::FairchildPinhole,
        Self::FairchildWing,
        Self::Arrow,
        Self::Bar,
    ];

    /// Its name in camera definitions.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::WildRc5 => "wild_rc5",
            Self::WildRc10 => "wild_rc10",
            Self::WildRc20 => "wild_rc20",
            Self::LeicaRc30 => "leica_rc30",
            Self::ZeissRmk => "zeiss_rmk",
            Self::ZeissRmkTop => "zeiss_rmk_top",
            Self::FairchildPinhole => "fairchild_pinhole",
            Self::FairchildWing => "fairchild_wing",
            Self::Arrow => "arrow",
            Self::Bar => "bar",
        }
    }

    /// The one with this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|library| library.name() == name)
    }
}

impl Mark {
    /// Whether the mark is nothing but edges between the frame and the image.
    pub(super) fn is_edges(&self) -> bool {
        matches!(self, Self::Library(Library::FairchildWing))
    }
}
