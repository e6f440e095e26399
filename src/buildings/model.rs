//! What is read: buildings and their edges; and what can be wrong with a file.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

/// Farther from the origin no CRS has a building.
pub(crate) const FARTHEST: f64 = 1e8;
/// The longest name of a building, in characters; the longest identifiers of states have about 60.
pub(crate) const LONGEST_NAME: usize = 200;
/// So much is said of what is wrong, in characters: what a stranger has written may stand in it.
const LONGEST_DETAIL: usize = 300;

/// The form of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// CityJSON 1.0, 1.1 or 2.0: one JSON object.
    #[serde(rename = "cityjson")]
    CityJson,
    /// CityJSON text sequences: a line with the metadata, then a line for each feature.
    #[serde(rename = "cityjsonseq")]
    CityJsonSeq,
    /// CityGML 1.0, 2.0 or 3.0.
    #[serde(rename = "citygml")]
    CityGml,
}

impl Format {
    /// The format of a file that begins with `first` and whose name may be known; `None` if it is none of them, compressed, or not in UTF-8.
    ///
    /// What the file holds goes before what it is called. A sequence without its name is known by its second line, so
    /// that as much should be given as there is at hand, at best 64 kB.
    #[must_use]
    pub fn recognise(first: &[u8], name: Option<&str>) -> Option<Self> {
        let text = first.strip_prefix(b"\xef\xbb\xbf").unwrap_or(first).trim_ascii_start();
        match text.first()? {
            b'<' => Some(Self::CityGml),
            b'{' => {
                // the metadata of a sequence end in the first line, and those of a pretty file in none of its lines
                let line = text.split(|byte| *byte == b'\n').next().unwrap_or(text);
                let whole_line = line.len() < text.len() && line.trim_ascii_end().ends_with(b"}");
                let name = name.unwrap_or_default().to_ascii_lowercase();
                let sequence = name.ends_with(".jsonl") || name.ends_with(".jsonseq") || name.ends_with(".ndjson");
                let followed = text[line.len()..].trim_ascii_start().first() == Some(&b'{');
                Some(if sequence || (whole_line && followed) { Self::CityJsonSeq } else { Self::CityJson })
            }
            _ => None,
        }
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

    /// The word for it in files and answers; it never changes either.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Eave => "eave",
            Self::Ridge => "ridge",
            Self::Gable => "gable",
            Self::Hip => "hip",
            Self::Valley => "valley",
            Self::Rim => "rim",
        }
    }

    /// The kind of a word, if there is one.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// The kind that is stored under a number, if there is one.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.code() == code)
    }
}

/// A straight edge of a roof, in the CRS of its building: east or longitude, north or latitude, up; metres or degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoofEdge {
    /// What it is.
    pub kind: EdgeKind,
    /// One end.
    pub start: [f64; 3],
    /// The other end.
    pub end: [f64; 3],
}

/// A building with its roof edges.
#[derive(Debug, Clone, PartialEq)]
pub struct Building {
    /// Its place among the items of the file, from 0.
    pub index: usize,
    /// Its identifier in the file: `gml:id`, or the key of the CityObject. Whether it is unique in the file is not
    /// known here, except in CityJSON.
    pub name: String,
    /// The CRS of its coordinates: `EPSG:25832`, `EPSG:25832+7837`, or, if it is none that is known here, the text of
    /// the file. `None` if the file says nothing.
    pub crs: Option<Arc<str>>,
    /// Root mean square of the distances in metres between its roof and the points that this was made from, where the
    /// file states it.
    pub roof_rmse_m: Option<f64>,
    /// The edges of its roof; at least one.
    pub edges: Vec<RoofEdge>,
}

/// A building that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct Refused {
    /// Its place among the items of the file, from 0.
    pub index: usize,
    /// Its identifier, if it has one, shortened if long.
    pub name: Option<String>,
    /// What is wrong, where, and what would be right; shortened if long.
    pub detail: String,
}

impl Refused {
    /// One with a name and a detail of any length: those of a hostile file could fill the memory, refused by thousands.
    #[must_use]
    pub fn new(index: usize, name: Option<String>, detail: String) -> Self {
        Self { index, name: name.map(shortened_name), detail: shortened_detail(detail) }
    }
}

/// So much of a name as is shown.
pub(crate) fn shortened_name(name: String) -> String {
    shortened(name, LONGEST_NAME)
}

/// So much of what is wrong as is told.
pub(crate) fn shortened_detail(detail: String) -> String {
    shortened(detail, LONGEST_DETAIL)
}

/// At most so many characters of a text, the last of which says that there were more. It takes no more memory than that.
fn shortened(text: String, longest: usize) -> String {
    match text.char_indices().nth(longest) {
        Some(_) => text.chars().take(longest - 1).chain(['…']).collect(),
        None => text,
    }
}

/// What a file holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Item {
    /// A building.
    Building(Building),
    /// One that cannot be used.
    Refused(Refused),
}

/// What a file may take. The defaults are far above what states publish and well below what hurts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Elements of XML within each other; CityGML needs about 25. (JSON is bounded at 128 by its parser.)
    pub depth: usize,
    /// Bytes of one building, of one line of a sequence, and of one piece of text. The largest buildings of 3DBAG and
    /// PLATEAU have a few MB.
    pub building_bytes: u64,
    /// Points of one building in all its surfaces; exhibition halls and greenhouses have up to 50 000.
    pub building_vertices: usize,
    /// Polygons of one building in all its surfaces.
    pub building_polygons: usize,
    /// Vertices of a CityJSON file, which are held in memory at 24 bytes each until its end.
    pub file_vertices: usize,
    /// Objects of a CityJSON file, of which the names and the roof are held in memory until its end; and children that
    /// they list.
    pub file_objects: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            depth: 100,
            building_bytes: 64 << 20,
            building_vertices: 500_000,
            building_polygons: 200_000,
            // 1 GB in memory: a file of about 1 GB
            file_vertices: 40_000_000,
            file_objects: 5_000_000,
        }
    }
}

impl ModelError {
    /// Of an error in JSON that is at `place`: not JSON at all, or JSON but something else.
    pub(super) fn of_json(place: &str, error: &serde_json::Error) -> Self {
        let detail = shortened_detail(format!("{place}{error}"));
        match error.is_data() {
            true => Self::OtherContent { detail: format!("this is not CityJSON: {detail}") },
            false => Self::Json { detail },
        }
    }
}

/// Why a file cannot be read, or not to its end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The bytes do not come.
    #[error("the file cannot be read: {0}")]
    Input(#[source] std::io::Error),
    /// Not XML, or not to its end.
    #[error("line {line}: this is not well-formed XML: {detail}")]
    Xml {
        /// Where, from 1.
        line: u64,
        /// What is wrong.
        detail: String,
    },
    /// Not JSON.
    #[error("this is not JSON: {detail}")]
    Json {
        /// What is wrong, with line and column.
        detail: String,
    },
    /// A document type or an entity, with which XML reads other files or grows without bound.
    #[error("line {line}: {what} is not accepted; only &amp; &lt; &gt; &apos; &quot; and characters by number are")]
    Entity {
        /// Where, from 1.
        line: u64,
        /// What it is.
        what: String,
    },
    /// Bytes that are no text.
    #[error("line {line}: the bytes are not UTF-8; convert the file to UTF-8 first")]
    NotUtf8 {
        /// Where, from 1.
        line: u64,
    },
    /// Another encoding than UTF-8.
    #[error("the file declares the encoding {encoding}; convert it to UTF-8 first")]
    Encoding {
        /// What it declares.
        encoding: String,
    },
    /// Elements within elements without end.
    #[error("line {line}: more than {limit} elements lie within each other")]
    TooDeep {
        /// Where, from 1.
        line: u64,
        /// How many may.
        limit: usize,
    },
    /// One thing larger than the limit.
    #[error("{place}: {what} is larger than {limit} bytes, which none of a building model is")]
    TooLarge {
        /// Where.
        place: String,
        /// What it is.
        what: &'static str,
        /// What is accepted.
        limit: u64,
    },
    /// More things than the limit.
    #[error("the file has more than {limit} {what}; cut it into smaller ones, or give it as CityJSONSeq")]
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many are accepted.
        limit: usize,
    },
    /// Well-formed, but something else.
    #[error("{detail}")]
    OtherContent {
        /// What it is, and what would be right.
        detail: String,
    },
    /// Nothing in it.
    #[error("the file holds no building at all")]
    NoBuilding,
}
