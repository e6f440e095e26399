//! Control points out of GeoJSON (contract, section Control points) and back. One bad feature never loses the others.

mod feature;

use std::collections::HashSet;
use std::fmt;
use std::io::Read;
use std::ops::ControlFlow;

use chrono::NaiveDate;
use nalgebra::Vector3;
use serde::de::{DeserializeSeed, Deserializer, Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

pub use feature::{ControlPointFeature, ControlPointProperties, MultiLineString, feature};

use super::accuracy::edge_sigma_m;
use super::model::{StoredControlPoint, StoredEdge, Use, Validity};
use super::reading::EDGE_BYTES;
use crate::buildings::{EdgeKind, LONGEST_NAME, shortened_detail, shortened_name};
use crate::geometry::{Crs, Segment3};

/// More edges than any building needs; a file with more is no file of control points.
pub(super) const MOST_EDGES: usize = 2_000;
/// The largest control point, from its reference point to its farthest end.
pub(super) const LARGEST_EXTENT_M: f64 = 2_000.0;
/// An edge shorter than this has no direction.
pub(super) const SHORTEST_EDGE_M: f64 = 0.001;
/// Coordinates worse than this cannot orient anything.
pub(super) const LARGEST_SIGMA_M: f64 = 100.0;

/// Where the coordinates of a collection are.
#[derive(Debug)]
pub struct Source<'a> {
    /// The CRS of the coordinates.
    pub crs: &'a Crs,
    /// What makes its heights ellipsoidal, where the request says so.
    pub geoid_undulation_m: Option<f64>,
}

/// A feature that did not become a control point.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct Rejection {
    /// Its place in the collection, from 0.
    pub index: usize,
    /// Its name, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// What is wrong with it and what would be right.
    pub detail: String,
}

impl Rejection {
    /// One with a name and a detail of any length, which are cut: a stranger has written them.
    #[must_use]
    pub fn new(index: usize, name: Option<String>, detail: String) -> Self {
        Self { index, name: name.map(shortened_name), detail: shortened_detail(detail) }
    }
}

/// A body that is not a collection of features at all.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CollectionError {
    /// Not JSON.
    #[error("the body is not valid JSON: {0}")]
    Syntax(#[source] serde_json::Error),
    /// JSON, but something else.
    #[error("the body must be a GeoJSON FeatureCollection: {detail}")]
    NotACollection {
        /// What it is instead.
        detail: String,
    },
}

/// What a collection holds: the good features with their place in it, and the others.
#[derive(Debug, Default)]
pub struct Parsed {
    /// Control points by their index.
    pub control_points: Vec<(usize, StoredControlPoint)>,
    /// Those that are none.
    pub rejected: Vec<Rejection>,
}

#[derive(Deserialize)]
struct Feature {
    geometry: Option<Geometry>,
    properties: Option<Properties>,
}

#[derive(Deserialize)]
struct Geometry {
    r#type: String,
    #[serde(default)]
    coordinates: Value,
}

#[derive(Deserialize)]
struct Properties {
    name: Option<String>,
    sigma_m: Option<f64>,
    reference: Option<Vec<f64>>,
    r#use: Option<Use>,
    valid_from: Option<NaiveDate>,
    valid_to: Option<NaiveDate>,
    edge_kinds: Option<Vec<Option<String>>>,
    edge_sigma_m: Option<Vec<f64>>,
}

/// What is known of a control point where its own properties do not say it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Defaults {
    /// Standard deviation of its coordinates. If nobody says, a building model is good to
    /// [`MODEL_SIGMA_M`](super::accuracy::MODEL_SIGMA_M), and lines are refused.
    pub sigma_m: Option<f64>,
    /// What it is there for.
    pub purpose: Use,
    /// When it stands like this.
    pub validity: Validity,
}

impl Defaults {
    /// What is wrong with the standard deviation, and what would be right.
    ///
    /// # Errors
    /// A sentence for people.
    pub fn check(&self) -> Result<(), String> {
        match self.sigma_m {
            Some(sigma_m) if !(sigma_m > 0.0 && sigma_m <= LARGEST_SIGMA_M) => {
                Err(format!("sigma_m is {sigma_m}; it must be above 0 and at most {LARGEST_SIGMA_M} m"))
            }
            _ => Ok(()),
        }
    }
}

/// Reads a `FeatureCollection` as a whole.
///
/// # Errors
/// [`CollectionError`] if the body is something else.
pub fn parse(body: &[u8], source: &Source<'_>) -> Result<Parsed, CollectionError> {
    let (mut parsed, mut names) = (Parsed::default(), HashSet::new());
    read(body, &mut |index, feature| {
        let name = name_of(&feature);
        let point = control_point(feature, source, Defaults::default());
        let point = point.and_then(|point| match names.insert(point.name.clone()) {
            true => Ok(point),
            false => Err("the name occurs earlier in this collection; names are unique".to_owned()),
        });
        match point {
            Ok(point) => parsed.control_points.push((index, point)),
            Err(detail) => parsed.rejected.push(Rejection::new(index, name, detail)),
        }
        ControlFlow::Continue(())
    })?;
    Ok(parsed)
}

/// The name of a feature, if it has one.
#[must_use]
pub fn name_of(feature: &Value) -> Option<String> {
    feature.pointer("/properties/name").and_then(Value::as_str).map(str::to_owned)
}

/// How many edges take as much memory as a feature that was read: about as many as it has numbers, texts and lists.
pub(super) fn weight(value: &Value) -> usize {
    1 + match value {
        Value::Array(values) => values.iter().map(weight).sum(),
        Value::Object(members) => members.iter().map(|(key, value)| key.len() / EDGE_BYTES + weight(value)).sum(),
        Value::String(text) => text.len() / EDGE_BYTES,
        Value::Null | Value::Bool(_) | Value::Number(_) => 0,
    }
}

/// Reads a `FeatureCollection` and gives `each` its features with their places, until that breaks off: however large it
/// is, one feature is in memory at a time.
///
/// # Errors
/// [`CollectionError`] if it is something else; what was given before stands.
pub fn read(input: impl Read, each: &mut dyn FnMut(usize, Value) -> ControlFlow<()>) -> Result<(), CollectionError> {
    let mut reader = Reader { each, ended: false };
    let mut deserializer = serde_json::Deserializer::from_reader(input);
    let read = reader.deserialize(&mut deserializer).and_then(|()| deserializer.end());
    match read {
        Err(_) if reader.ended => Ok(()),
        Ok(()) => Ok(()),
        Err(error) if error.is_data() => {
            Err(CollectionError::NotACollection { detail: shortened_detail(error.to_string()) })
        }
        Err(error) => Err(CollectionError::Syntax(error)),
    }
}

struct Reader<'e> {
    each: &'e mut dyn FnMut(usize, Value) -> ControlFlow<()>,
    /// Whether no more are wanted.
    ended: bool,
}

impl<'de> DeserializeSeed<'de> for &mut Reader<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for &mut Reader<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object with type FeatureCollection and features")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let (mut kind, mut features) = (None, false);
        while let Some(key) = map.next_key::<String>()? {
            match key.as_str() {
                "type" => kind = Some(map.next_value::<String>()?),
                "features" => {
                    map.next_value_seed(Features(&mut *self))?;
                    features = true;
                }
                _ => drop(map.next_value::<IgnoredAny>()?),
            }
        }
        match kind.as_deref() {
            Some("FeatureCollection") if features => Ok(()),
            Some("FeatureCollection") => Err(A::Error::missing_field("features")),
            Some(other) => Err(A::Error::custom(format_args!("its type is {other:?}"))),
            None => Err(A::Error::missing_field("type")),
        }
    }
}

/// The array of features, each of which goes straight on.
struct Features<'r, 'e>(&'r mut Reader<'e>);

impl<'de> DeserializeSeed<'de> for Features<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Features<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of features")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> Result<(), A::Error> {
        let mut index = 0;
        while let Some(feature) = sequence.next_element()? {
            if (self.0.each)(index, feature).is_break() {
                self.0.ended = true;
                return Err(A::Error::custom("no more are wanted"));
            }
            index += 1;
        }
        Ok(())
    }
}

/// The control point of a feature.
///
/// # Errors
/// What is wrong with it and what would be right.
pub fn control_point(feature: Value, source: &Source<'_>, defaults: Defaults) -> Result<StoredControlPoint, String> {
    let feature: Feature = serde_json::from_value(feature).map_err(|e| format!("not a feature: {e}"))?;
    let properties = feature.properties.ok_or("properties are missing; name and sigma_m are needed")?;
    let name = checked_name(properties.name)?;
    let stated_m = checked_sigma(properties.sigma_m.or(defaults.sigma_m))?;
    let segments_m = edges(feature.geometry, source)?;
    let kinds = edge_kinds(properties.edge_kinds, segments_m.len())?;
    let sigmas_m = edge_sigmas_m(properties.edge_sigma_m, &kinds, stated_m)?;
    let of_crs_m = source.crs.accuracy_m();
    let edge = |((geocentric_m, kind), sigma_m): ((Segment3, Option<EdgeKind>), f64)| StoredEdge {
        geocentric_m,
        kind,
        sigma_m: sigma_m.hypot(of_crs_m),
    };
    let edges: Vec<StoredEdge> = segments_m.into_iter().zip(kinds).zip(sigmas_m).map(edge).collect();
    let reference_geocentric_m = match properties.reference {
        Some(position) => geocentric(&position, source).map_err(|detail| format!("reference: {detail}"))?,
        None => StoredControlPoint::middle_of(&edges),
    };
    let validity = Validity {
        from: properties.valid_from.or(defaults.validity.from),
        to: properties.valid_to.or(defaults.validity.to),
    };
    checked(StoredControlPoint {
        name,
        sigma_m: stated_m.hypot(of_crs_m),
        reference_geocentric_m,
        edges,
        purpose: properties.r#use.unwrap_or(defaults.purpose),
        validity,
    })
}

/// The control point, if it is one building and stands at some time.
///
/// # Errors
/// What is wrong with it.
pub(super) fn checked(point: StoredControlPoint) -> Result<StoredControlPoint, String> {
    let extent_m = point.extent_m();
    if extent_m > LARGEST_EXTENT_M {
        return Err(format!(
            "its edges reach {extent_m:.0} m from its reference point, but a control point is one building: at most \
             {LARGEST_EXTENT_M:.0} m"
        ));
    }
    match (point.validity.from, point.validity.to) {
        (Some(from), Some(to)) if from > to => Err(format!("valid_from {from} is after valid_to {to}")),
        _ => Ok(point),
    }
}

fn edge_kinds(given: Option<Vec<Option<String>>>, edges: usize) -> Result<Vec<Option<EdgeKind>>, String> {
    let Some(names) = given else { return Ok(vec![None; edges]) };
    if names.len() != edges {
        return Err(format!("properties.edge_kinds has {} entries for {edges} lines", names.len()));
    }
    let kind = |name: &Option<String>| match name {
        None => Ok(None),
        Some(name) => EdgeKind::from_name(name).map(Some).ok_or_else(|| {
            format!("properties.edge_kinds has {name:?}; it may have eave, ridge, gable, hip, valley, rim and null")
        }),
    };
    names.iter().map(kind).collect()
}

/// As given; else by the kinds of the edges, where these are given.
fn edge_sigmas_m(given: Option<Vec<f64>>, kinds: &[Option<EdgeKind>], stated_m: f64) -> Result<Vec<f64>, String> {
    let Some(sigmas_m) = given else {
        return Ok(kinds.iter().map(|kind| kind.map_or(stated_m, |kind| edge_sigma_m(kind, stated_m))).collect());
    };
    if sigmas_m.len() != kinds.len() {
        return Err(format!("properties.edge_sigma_m has {} entries for {} lines", sigmas_m.len(), kinds.len()));
    }
    match sigmas_m.iter().find(|sigma_m| !(**sigma_m > 0.0 && **sigma_m <= LARGEST_SIGMA_M)) {
        Some(bad) => {
            Err(format!("properties.edge_sigma_m has {bad}; each must be above 0 and at most {LARGEST_SIGMA_M} m"))
        }
        None => Ok(sigmas_m),
    }
}

pub(super) fn checked_name(name: Option<String>) -> Result<String, String> {
    let name = name.ok_or("properties.name is missing; each control point needs a unique name")?;
    if name.trim().is_empty() {
        return Err("properties.name is empty; each control point needs a unique name".to_owned());
    }
    if name.chars().count() > LONGEST_NAME || name.chars().any(char::is_control) {
        return Err(format!(
            "properties.name must have at most {LONGEST_NAME} characters, none of them a control character"
        ));
    }
    Ok(name)
}

pub(super) fn checked_sigma(sigma_m: Option<f64>) -> Result<f64, String> {
    let sigma_m =
        sigma_m.ok_or("properties.sigma_m is missing: the standard deviation of the coordinates in metres")?;
    if !(sigma_m > 0.0 && sigma_m <= LARGEST_SIGMA_M) {
        return Err(format!("properties.sigma_m is {sigma_m}; it must be above 0 and at most {LARGEST_SIGMA_M} m"));
    }
    Ok(sigma_m)
}

fn edges(geometry: Option<Geometry>, source: &Source<'_>) -> Result<Vec<Segment3>, String> {
    let geometry = geometry.ok_or("geometry is missing; it must be a MultiLineString")?;
    if geometry.r#type != "MultiLineString" {
        return Err(format!("the geometry is a {:?}; it must be a MultiLineString", geometry.r#type));
    }
    let lines: Vec<Vec<Vec<f64>>> = serde_json::from_value(geometry.coordinates)
        .map_err(|e| format!("the coordinates of a MultiLineString are lists of positions [x, y, z]: {e}"))?;
    if lines.is_empty() || lines.len() > MOST_EDGES {
        return Err(format!("it has {} lines; a control point has 1 to {MOST_EDGES}", lines.len()));
    }
    let edge =
        |(index, line): (usize, &Vec<Vec<f64>>)| edge(line, source).map_err(|detail| format!("line {index}: {detail}"));
    lines.iter().enumerate().map(edge).collect()
}

fn edge(line: &[Vec<f64>], source: &Source<'_>) -> Result<Segment3, String> {
    let [start, end] = line else {
        return Err(format!(
            "it has {} positions; each line is one segment of two positions, so split a longer line",
            line.len()
        ));
    };
    let edge = Segment3 { start: geocentric(start, source)?, end: geocentric(end, source)? };
    match edge.length() < SHORTEST_EDGE_M {
        true => Err("its two positions are the same; a segment needs a length".to_owned()),
        false => Ok(edge),
    }
}

fn geocentric(position: &[f64], source: &Source<'_>) -> Result<Vector3<f64>, String> {
    let position = <[f64; 3]>::try_from(position)
        .map_err(|_| format!("a position has {} numbers; it must have three, [x, y, z]", position.len()))?;
    source.crs.geocentric_from_position(position, source.geoid_undulation_m).map_err(|e| e.to_string())
}
