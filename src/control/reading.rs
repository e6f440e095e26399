//! Control points out of files, whatever their format: what is read one after the other, and what may be done at once
//! by all cores.

use std::collections::HashMap;
use std::io::BufRead;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use nalgebra::Vector3;
use serde_json::Value;

use super::accuracy::{MODEL_SIGMA_M, edge_sigma_m};
use super::geojson::{self, CollectionError, Defaults, Rejection, Source};
use super::geopackage::{self, GeoPackageError, Record};
use super::model::{StoredControlPoint, StoredEdge};
use crate::buildings::{self, Building, Item, Limits, ModelError, RoofEdge};
use crate::geometry::{Crs, CrsError, Segment3};

/// Formats of files of control points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileFormat {
    /// A GeoJSON `FeatureCollection` of `MultiLineString`s.
    GeoJson,
    /// A building model.
    Model(buildings::Format),
    /// A GeoPackage with tables of lines or of the surfaces of roofs.
    GeoPackage,
}

/// One of these stands at the beginning of every CityJSON, in whatever order its members are.
const CITY_WORDS: [&str; 3] = ["\"CityJSON\"", "\"CityJSONFeature\"", "\"CityObjects\""];

impl FileFormat {
    /// The format by the first bytes of a file and, where these leave it open, by its name.
    #[must_use]
    pub fn recognise(first: &[u8], name: Option<&str>) -> Option<Self> {
        if first.starts_with(geopackage::MAGIC) {
            return Some(Self::GeoPackage);
        }
        let says = |word: &str| first.windows(word.len()).any(|bytes| bytes == word.as_bytes());
        let named = name.is_some_and(|name| name.to_ascii_lowercase().contains(".city.json"));
        match buildings::Format::recognise(first, name) {
            // every JSON is one of these to whom knows no other; a collection of features may say what it is at its end
            Some(format) if format == buildings::Format::CityGml || named => return Some(Self::Model(format)),
            Some(format) if CITY_WORDS.iter().any(|word| says(word)) => return Some(Self::Model(format)),
            _ => {}
        }
        // a byte order mark is no white space
        let begins = first.iter().find(|byte| !byte.is_ascii_whitespace());
        (begins == Some(&b'{')).then_some(Self::GeoJson)
    }
}

/// How a file is read.
#[derive(Debug, Clone)]
pub struct Reading {
    /// What it is.
    pub format: FileFormat,
    /// The CRS of its coordinates; may be left out where the file says so itself.
    pub crs: Option<Crs>,
    /// What makes its heights ellipsoidal.
    pub geoid_undulation_m: Option<f64>,
    /// What the file does not say of its control points.
    pub defaults: Defaults,
    /// Is given the CRS, while it is read, if that says nothing about heights, which then are taken as ellipsoidal.
    pub heights_assumed: Arc<OnceLock<String>>,
}

/// Why a file cannot be read, or not to its end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// It is no collection of features.
    #[error(transparent)]
    Collection(#[from] CollectionError),
    /// It is no building model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// It is no GeoPackage.
    #[error(transparent)]
    GeoPackage(#[from] GeoPackageError),
    /// It names a CRS that is not known.
    #[error("the file names the CRS {named:?}: {source}")]
    UnknownCrs {
        /// As the file has it.
        named: String,
        /// What is wrong with it.
        source: CrsError,
    },
    /// It names another CRS than the one that was given.
    #[error("the file names the CRS {named}, but {given} was given; leave it out, or give the right one")]
    Contradiction {
        /// As the file has it.
        named: String,
        /// As given.
        given: String,
    },
    /// Nobody names a CRS.
    #[error("nothing says in which CRS the coordinates are; give crs")]
    NoCrs,
}

/// Something that was read, and is to become a control point.
#[derive(Debug)]
pub enum Raw {
    /// A feature of GeoJSON.
    Feature(Value),
    /// A building with the CRS of its coordinates.
    Building(Building, Arc<Crs>),
    /// The rows of a building in a GeoPackage.
    Rows(Box<Record>),
    /// What is none: its name, if it has one, and what is wrong with it.
    Refused(Option<String>, String),
}

impl Reading {
    /// Reads a GeoPackage, and gives `each` what it finds with its place in the file, until that breaks off. `progress`
    /// is told which share of it is read. It must not be called where futures run.
    ///
    /// # Errors
    /// [`ReadError`]; what was given before stands.
    pub fn read_geopackage(
        &self,
        file: &Path,
        progress: &mut dyn FnMut(f64),
        each: &mut dyn FnMut(usize, Raw) -> ControlFlow<()>,
    ) -> Result<(), ReadError> {
        geopackage::read(self, file, progress, each)
    }

    /// Reads anything but a GeoPackage, and gives `each` what it finds with its place in the file, until that breaks off.
    ///
    /// # Errors
    /// [`ReadError`]; what was given before stands.
    pub fn read(
        &self,
        input: &mut dyn BufRead,
        each: &mut dyn FnMut(usize, Raw) -> ControlFlow<()>,
    ) -> Result<(), ReadError> {
        match self.format {
            FileFormat::GeoJson => {
                self.note_heights(self.crs.as_ref().ok_or(ReadError::NoCrs)?);
                Ok(geojson::read(input, &mut |index, feature| each(index, Raw::Feature(feature)))?)
            }
            FileFormat::Model(format) => {
                let (mut known, mut failed) = (KnownCrs::default(), None);
                let mut give = |item| match item {
                    Item::Refused(refused) => each(refused.index, Raw::Refused(refused.name, refused.detail)),
                    Item::Building(building) => match known.of(self, building.crs.as_ref()) {
                        Ok(crs) => each(building.index, Raw::Building(building, crs)),
                        Err(error) => {
                            failed = Some(error);
                            ControlFlow::Break(())
                        }
                    },
                };
                let read = buildings::read(format, input, &Limits::default(), &mut give);
                failed.map_or(Ok(()), Err)?;
                Ok(read?)
            }
            FileFormat::GeoPackage => Err(GeoPackageError::Streamed.into()),
        }
    }

    fn note_heights(&self, crs: &Crs) {
        if crs.assumes_ellipsoidal_heights() && self.geoid_undulation_m.is_none() {
            self.heights_assumed.get_or_init(|| crs.to_string());
        }
    }

    /// Makes a control point of what was read.
    ///
    /// # Errors
    /// Why it is none.
    pub fn control_point(&self, index: usize, raw: Raw) -> Result<StoredControlPoint, Rejection> {
        let refuse = |name, detail| Rejection { index, name, detail };
        match raw {
            Raw::Refused(name, detail) => Err(refuse(name, detail)),
            Raw::Building(building, crs) => {
                let source = Source { crs: &crs, geoid_undulation_m: self.geoid_undulation_m };
                of_building(&building, &source, self.defaults).map_err(|detail| refuse(Some(building.name), detail))
            }
            Raw::Rows(record) => {
                let name = record.name().map(str::to_owned);
                record.control_point(self.geoid_undulation_m, self.defaults).map_err(|detail| refuse(name, detail))
            }
            Raw::Feature(feature) => {
                let name = geojson::name_of(&feature);
                let Some(crs) = &self.crs else { return Err(refuse(name, ReadError::NoCrs.to_string())) };
                let source = Source { crs, geoid_undulation_m: self.geoid_undulation_m };
                geojson::control_point(feature, &source, self.defaults).map_err(|detail| refuse(name, detail))
            }
        }
    }
}

/// The CRSs that a file names, each understood once.
#[derive(Default)]
pub(super) struct KnownCrs(HashMap<Option<Arc<str>>, Arc<Crs>>);

impl KnownCrs {
    pub(super) fn of(&mut self, reading: &Reading, named: Option<&Arc<str>>) -> Result<Arc<Crs>, ReadError> {
        if let Some(known) = self.0.get(&named.cloned()) {
            return Ok(known.clone());
        }
        let crs = Arc::new(agreed(reading, named.map(|named| &**named))?);
        reading.note_heights(&crs);
        self.0.insert(named.cloned(), crs.clone());
        Ok(crs)
    }
}

/// The CRS of coordinates, of what the file names and what was given. Either may say more than the other of heights, and
/// nothing else.
fn agreed(reading: &Reading, named: Option<&str>) -> Result<Crs, ReadError> {
    let given = reading.crs.as_ref();
    let Some(named) = named else { return given.cloned().ok_or(ReadError::NoCrs) };
    let unknown = |source| ReadError::UnknownCrs { named: named.to_owned(), source };
    let Some(given) = given else { return Crs::parse(named).map_err(unknown) };
    let (given_text, named_text) = (given.to_string(), named.trim().to_owned());
    let parts = |text: &str| -> (String, Option<String>) {
        match text.strip_prefix("EPSG:").and_then(|codes| codes.split_once('+')) {
            Some((horizontal, vertical)) => (format!("EPSG:{horizontal}"), Some(vertical.to_owned())),
            None => (text.to_owned(), None),
        }
    };
    let ((horizontal, heights), (named_horizontal, named_heights)) = (parts(&given_text), parts(&named_text));
    let heights_agree = heights.is_none() || named_heights.is_none() || heights == named_heights;
    if horizontal != named_horizontal || !heights_agree {
        return Err(ReadError::Contradiction { named: named_text, given: given_text });
    }
    // an undulation that was given says what the heights are
    match named_heights.is_some() && heights.is_none() && reading.geoid_undulation_m.is_none() {
        true => Crs::parse(named).map_err(unknown),
        false => Ok(given.clone()),
    }
}

/// The control point of a building: its roof edges, each as good as its kind allows.
pub(super) fn of_building(
    building: &Building,
    source: &Source<'_>,
    defaults: Defaults,
) -> Result<StoredControlPoint, String> {
    let name = geojson::checked_name(Some(building.name.clone()))?;
    if building.edges.len() > geojson::MOST_EDGES {
        return Err(format!(
            "it has {} edges; a control point has at most {}",
            building.edges.len(),
            geojson::MOST_EDGES
        ));
    }
    let stated_m = building.accuracy_m.unwrap_or(MODEL_SIGMA_M);
    if !(stated_m > 0.0 && stated_m <= geojson::LARGEST_SIGMA_M) {
        return Err(format!(
            "its accuracy is {stated_m} m; it must be above 0 and at most {} m",
            geojson::LARGEST_SIGMA_M
        ));
    }
    let of_crs_m = source.crs.accuracy_m();
    let ends: Vec<[f64; 3]> = building.edges.iter().flat_map(|edge| [edge.start, edge.end]).collect();
    let ends_m = corners_geocentric_m(source, &ends)?;
    let mut edges = Vec::with_capacity(building.edges.len());
    for (RoofEdge { kind, .. }, ends_m) in building.edges.iter().zip(ends_m.as_chunks().0) {
        let [start, end] = *ends_m;
        let geocentric_m = Segment3 { start, end };
        // corners that a model has twice
        if geocentric_m.length() >= geojson::SHORTEST_EDGE_M {
            edges.push(StoredEdge {
                geocentric_m,
                kind: Some(*kind),
                sigma_m: edge_sigma_m(*kind, stated_m).hypot(of_crs_m),
            });
        }
    }
    if edges.is_empty() {
        return Err("it has no roof edges".to_owned());
    }
    geojson::checked(StoredControlPoint {
        name,
        sigma_m: stated_m.hypot(of_crs_m),
        reference_geocentric_m: StoredControlPoint::middle_of(&edges),
        edges,
        purpose: defaults.purpose,
        validity: defaults.validity,
    })
}

/// The corners of a roof, in which several edges meet: each is transformed once.
///
/// Their positions in the order in which edges name them, their geocentric coordinates in the same order.
pub(super) fn corners_geocentric_m(source: &Source<'_>, named: &[[f64; 3]]) -> Result<Vec<Vector3<f64>>, String> {
    let mut corners: Vec<[f64; 3]> = Vec::with_capacity(named.len());
    let mut which = Vec::with_capacity(named.len());
    for position in named {
        let searched = corners.len().saturating_sub(CORNERS_SEARCHED);
        let found = corners[searched..].iter().rposition(|corner| corner == position);
        which.push(found.map_or(corners.len(), |place| searched + place));
        if found.is_none() {
            corners.push(*position);
        }
    }
    let Source { crs, geoid_undulation_m } = *source;
    let corners_m = crs.geocentric_from_positions(&corners, geoid_undulation_m).map_err(|e| e.to_string())?;
    Ok(which.into_iter().map(|corner| corners_m[corner]).collect())
}

/// A roof with more corners is not searched through for each.
const CORNERS_SEARCHED: usize = 64;
