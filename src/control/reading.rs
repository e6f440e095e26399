//! Control points out of files, whatever their format: what is read one after the other, and what may be done at once
//! by all cores.

#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::io::BufRead;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use nalgebra::Vector3;
use serde_json::Value;

use super::FileFormat;
use super::accuracy::{MODEL_SIGMA_M, edge_sigma_m};
use super::geojson::{self, CollectionError, Defaults, Rejection, Source};
use super::geopackage::{self, GeoPackageError, Record};
use super::model::{StoredControlPoint, StoredEdge};
use crate::buildings::{self, Building, Format, Item, Limits, ModelError, RoofEdge};
use crate::geometry::{Crs, CrsError, Segment3};

/// What an edge takes in memory: two positions, about.
pub(super) const EDGE_BYTES: usize = 48;
/// So many buildings without one whose CRS is understood, and it is the file that is wrong.
const MOST_UNPLACED: usize = 100;
/// Names of CRSs that are remembered; a hostile file has as many as it has buildings.
const MOST_KNOWN: usize = 1_000;

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
    /// Heights in its CRS cannot be computed.
    #[error(transparent)]
    Heights(CrsError),
    /// Its coordinates were taken for metres and are degrees, or the other way round.
    #[error(
        "the coordinates are in {given}, which the file does not say, so that what is in degrees was measured in metres; \
         name the CRS in the file (srsName or referenceSystem)"
    )]
    Unmeasured {
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

impl Raw {
    /// How many edges take as much memory, about.
    #[must_use]
    pub fn weight(&self) -> usize {
        match self {
            Self::Feature(feature) => geojson::weight(feature),
            Self::Building(building, _) => building.edges.len() + building.name.len() / EDGE_BYTES,
            Self::Rows(record) => record.weight(),
            Self::Refused(name, detail) => (name.as_ref().map_or(0, String::len) + detail.len()) / EDGE_BYTES,
        }
    }
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
                let crs = agreed(self, None)?;
                self.note_heights(&crs);
                Ok(geojson::read(input, &mut |index, feature| each(index, Raw::Feature(feature)))?)
            }
            FileFormat::Model(format) => self.read_model(format, input, each),
            FileFormat::GeoPackage => Err(GeoPackageError::Streamed.into()),
        }
    }

    /// A building whose CRS cannot be understood is refused by itself; where none has another one, the file is.
    fn read_model(
        &self,
        format: Format,
        input: &mut dyn BufRead,
        each: &mut dyn FnMut(usize, Raw) -> ControlFlow<()>,
    ) -> Result<(), ReadError> {
        let (mut known, mut placed, mut unplaced, mut failed) = (KnownCrs::default(), false, 0, None);
        let mut give = |item| match item {
            Item::Refused(refused) => each(refused.index, Raw::Refused(refused.name, refused.detail)),
            Item::Building(building) => match known.of_building(self, &building) {
                Ok(crs) => {
                    placed = true;
                    each(building.index, Raw::Building(building, crs))
                }
                Err(error) => {
                    unplaced += 1;
                    let detail = error.to_string();
                    failed.get_or_insert(error);
                    match !placed && unplaced == MOST_UNPLACED {
                        true => ControlFlow::Break(()),
                        false => each(building.index, Raw::Refused(Some(building.name), detail)),
                    }
                }
            },
        };
        let read = buildings::read(format, input, &Limits::default(), &mut give);
        failed.filter(|_| !placed).map_or(Ok(()), Err)?;
        Ok(read?)
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
        let refuse = |name, detail| Rejection::new(index, name, detail);
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
        if self.0.len() < MOST_KNOWN {
            self.0.insert(named.cloned(), crs.clone());
        }
        Ok(crs)
    }

    /// That of a building of a model, whose edges were found in degrees or in metres, as the file says.
    fn of_building(&mut self, reading: &Reading, building: &Building) -> Result<Arc<Crs>, ReadError> {
        let crs = self.of(reading, building.crs.as_ref())?;
        let in_degrees = building.crs.as_ref().is_some_and(|named| buildings::is_geographic(named));
        match in_degrees == crs.is_geographic() {
            true => Ok(crs),
            false => Err(ReadError::Unmeasured { given: crs.to_string() }),
        }
    }
}

/// The CRS of coordinates, of what the file names and what was given. Either may say more than the other of heights, and
/// nothing else; but where the name is none that is known here, what was given stands for it.
fn agreed(reading: &Reading, named: Option<&str>) -> Result<Crs, ReadError> {
    let given = reading.crs.as_ref();
    // an undulation that was given says what the heights are, too
    let heights_given =
        given.is_some_and(|given| given.heights_code().is_some()) || reading.geoid_undulation_m.is_some();
    let unknown = |named: &str, source| ReadError::UnknownCrs { named: named.to_owned(), source };
    let crs = match (named.map(|named| (named, Crs::parse(named))), given) {
        (None, given) => given.cloned().ok_or(ReadError::NoCrs)?,
        (Some((named, parsed)), None) => parsed.map_err(|source| unknown(named, source))?,
        (Some((_, Ok(parsed))), Some(given)) => {
            let one_missing = parsed.heights_code().is_none() || given.heights_code().is_none();
            if !parsed.lies_in_plane_of(given) || !(one_missing || parsed.heights_code() == given.heights_code()) {
                return Err(ReadError::Contradiction { named: parsed.to_string(), given: given.to_string() });
            }
            if parsed.heights_code().is_some() && !heights_given { parsed } else { given.clone() }
        }
        // that its heights are none that are known does not make them ellipsoidal
        (Some((named, Err(source @ CrsError::UnknownHeights { .. }))), Some(_)) if !heights_given => {
            return Err(unknown(named, source));
        }
        (Some((_, Err(_))), Some(given)) => given.clone(),
    };
    // before a state is read in vain
    crs.check_heights(reading.geoid_undulation_m).map_err(ReadError::Heights)?;
    Ok(crs)
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
    let model_m = defaults.sigma_m.unwrap_or(MODEL_SIGMA_M);
    let stated_m = building.roof_rmse_m.map_or(model_m, |rmse_m| model_m.hypot(rmse_m));
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
