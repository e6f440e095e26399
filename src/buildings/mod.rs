//! Building models as files: CityJSON and CityGML, a building at a time.

use std::io::BufRead;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Formats of building models.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// One JSON object.
    CityJson,
    /// One JSON object a line, the first of which has what all share.
    CityJsonSeq,
    /// XML.
    CityGml,
}

impl Format {
    /// The format by the first bytes of a file and, where these leave it open, by its name.
    #[must_use]
    pub fn recognise(_first: &[u8], _name: Option<&str>) -> Option<Self> {
        None
    }
}

/// What an edge of a roof is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum EdgeKind {
    /// Horizontal outer edge from which the roof rises.
    Eave,
    /// Horizontal edge between two faces, convex: the top of the roof, or the break of a mansard.
    Ridge,
    /// Sloping outer edge, or the horizontal one at the top of a single-pitch roof.
    Gable,
    /// Sloping convex edge between two faces.
    Hip,
    /// Concave edge between two faces, sloping or not.
    Valley,
    /// Outer edge of a flat roof.
    Rim,
}

impl EdgeKind {
    /// All kinds, in the order of their codes.
    pub const ALL: [Self; 6] = [Self::Eave, Self::Ridge, Self::Gable, Self::Hip, Self::Valley, Self::Rim];

    /// The number under which the kind is stored; it never changes.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Eave => 1,
            Self::Ridge => 2,
            Self::Gable => 3,
            Self::Hip => 4,
            Self::Valley => 5,
            Self::Rim => 6,
        }
    }

    /// The kind that is stored under a number, if there is one.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.code() == code)
    }
}

/// An edge of a roof, in the CRS of its file: east, north, up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoofEdge {
    /// What kind it is.
    pub kind: EdgeKind,
    /// One end.
    pub start: [f64; 3],
    /// The other.
    pub end: [f64; 3],
}

/// A building with the edges of its roof.
#[derive(Debug, Clone, PartialEq)]
pub struct Building {
    /// Its place in the file, from 0.
    pub index: usize,
    /// Its id in the file.
    pub name: String,
    /// The CRS of its coordinates, if the file says.
    pub crs: Option<Arc<str>>,
    /// Standard deviation of its coordinates, if the file says, metres.
    pub accuracy_m: Option<f64>,
    /// The edges of its roof.
    pub edges: Vec<RoofEdge>,
}

/// A building that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused {
    /// Its place in the file, from 0.
    pub index: usize,
    /// Its id in the file, if it has one.
    pub name: Option<String>,
    /// What is wrong with it.
    pub detail: String,
}

/// What a file holds, one after the other.
#[derive(Debug, Clone, PartialEq)]
pub enum Item {
    /// A building.
    Building(Building),
    /// Something that should be one.
    Refused(Refused),
}

/// What is read at most.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Limits {}

/// Why a file cannot be read on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// It cannot be read.
    #[error("the file cannot be read: {0}")]
    Input(#[source] std::io::Error),
    /// It is no building model.
    #[error("{0}")]
    Malformed(String),
}

/// Reads a building model and gives `each` its buildings, until that breaks off.
///
/// # Errors
/// [`ModelError`] if the file is not what it should be; what was given before stands.
pub fn read(
    _format: Format,
    _input: &mut dyn BufRead,
    _limits: &Limits,
    _each: &mut dyn FnMut(Item) -> ControlFlow<()>,
) -> Result<(), ModelError> {
    Err(ModelError::Malformed("building models are not read yet".to_owned()))
}
