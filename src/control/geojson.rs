//! Control points out of GeoJSON (contract, section Control points) and back. One bad feature never loses the others.

use std::collections::HashSet;
use std::fmt;

use nalgebra::Vector3;
use serde::de::{DeserializeSeed, Deserializer, Error as _, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::model::StoredControlPoint;
use crate::geometry::{Crs, Segment3};

/// More edges than any building needs; a file with more is no file of control points.
const MOST_EDGES: usize = 2_000;
/// The largest control point, from its reference point to its farthest end.
const LARGEST_EXTENT_M: f64 = 2_000.0;
/// An edge shorter than this has no direction.
const SHORTEST_EDGE_M: f64 = 0.001;
/// Coordinates worse than this cannot orient anything.
const LARGEST_SIGMA_M: f64 = 100.0;
const LONGEST_NAME: usize = 200;

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
}

/// Reads a `FeatureCollection`, a feature at a time: a large body is never held twice.
///
/// # Errors
/// [`CollectionError`] if the body as a whole is something else.
pub fn parse(body: &[u8], source: &Source<'_>) -> Result<Parsed, CollectionError> {
    let mut reader = Reader { source, parsed: Parsed::default(), names: HashSet::new() };
    let mut deserializer = serde_json::Deserializer::from_slice(body);
    let read = reader.deserialize(&mut deserializer).and_then(|()| deserializer.end());
    match read {
        Ok(()) => Ok(reader.parsed),
        Err(error) if error.is_data() => Err(CollectionError::NotACollection { detail: error.to_string() }),
        Err(error) => Err(CollectionError::Syntax(error)),
    }
}

struct Reader<'a> {
    source: &'a Source<'a>,
    parsed: Parsed,
    names: HashSet<String>,
}

impl Reader<'_> {
    fn take(&mut self, index: usize, feature: Value) {
        let name = feature.pointer("/properties/name").and_then(Value::as_str).map(str::to_owned);
        let result =
            control_point(feature, self.source).and_then(|point| match self.names.insert(point.name.clone()) {
                true => Ok(point),
                false => Err("the name occurs earlier in this collection; names are unique".to_owned()),
            });
        match result {
            Ok(point) => self.parsed.control_points.push((index, point)),
            Err(detail) => self.parsed.rejected.push(Rejection { index, name, detail }),
        }
    }
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

/// The array of features, each of which goes straight to the reader.
struct Features<'r, 'a>(&'r mut Reader<'a>);

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
            self.0.take(index, feature);
            index += 1;
        }
        Ok(())
    }
}

fn control_point(feature: Value, source: &Source<'_>) -> Result<StoredControlPoint, String> {
    let feature: Feature = serde_json::from_value(feature).map_err(|e| format!("not a feature: {e}"))?;
    let properties = feature.properties.ok_or("properties are missing; name and sigma_m are needed")?;
    let name = checked_name(properties.name)?;
    let sigma_m = checked_sigma(properties.sigma_m)?;
    let edges_geocentric_m = edges(feature.geometry, source)?;
    let reference_geocentric_m = match properties.reference {
        Some(position) => geocentric(&position, source).map_err(|detail| format!("reference: {detail}"))?,
        None => {
            edges_geocentric_m.iter().map(Segment3::midpoint).sum::<Vector3<f64>>() / edges_geocentric_m.len() as f64
        }
    };
    let point = StoredControlPoint {
        name,
        sigma_m: sigma_m.hypot(source.crs.accuracy_m()),
        reference_geocentric_m,
        edges_geocentric_m,
    };
    let extent_m = point.points().map(|p| (p - reference_geocentric_m).norm()).fold(0.0, f64::max);
    if extent_m > LARGEST_EXTENT_M {
        return Err(format!(
            "its edges reach {extent_m:.0} m from its reference point, but a control point is one building: at most \
             {LARGEST_EXTENT_M:.0} m"
        ));
    }
    Ok(point)
}

fn checked_name(name: Option<String>) -> Result<String, String> {
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

fn checked_sigma(sigma_m: Option<f64>) -> Result<f64, String> {
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

/// A control point as a GeoJSON feature, its positions in the CRS asked for.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ControlPointFeature {
    /// Always `Feature`.
    #[schema(example = "Feature")]
    pub r#type: &'static str,
    /// Its edges.
    pub geometry: MultiLineString,
    /// Its name, accuracy and reference point.
    pub properties: ControlPointProperties,
}

/// A GeoJSON `MultiLineString` whose lines are segments of two positions.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct MultiLineString {
    /// Always `MultiLineString`.
    #[schema(example = "MultiLineString")]
    pub r#type: &'static str,
    /// Lines of two positions `[x, y, z]` each.
    #[schema(value_type = Vec<Vec<Vec<f64>>>)]
    pub coordinates: Vec<[[f64; 3]; 2]>,
}

/// What a control point is called, how good it is, and where its reference point lies.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ControlPointProperties {
    /// Its unique name.
    pub name: String,
    /// Standard deviation of its coordinates, the accuracy of the transformation from the CRS of its import included.
    pub sigma_m: f64,
    /// Its reference point `[x, y, z]`.
    #[schema(value_type = Vec<f64>)]
    pub reference: [f64; 3],
}

/// The feature of a control point; `None` where the CRS does not reach.
#[must_use]
pub fn feature(point: &StoredControlPoint, target: &Source<'_>) -> Option<ControlPointFeature> {
    let position = |geocentric_m| target.crs.position_from_geocentric(geocentric_m, target.geoid_undulation_m).ok();
    let line = |edge: &Segment3| Some([position(edge.start)?, position(edge.end)?]);
    Some(ControlPointFeature {
        r#type: "Feature",
        geometry: MultiLineString {
            r#type: "MultiLineString",
            coordinates: point.edges_geocentric_m.iter().map(line).collect::<Option<_>>()?,
        },
        properties: ControlPointProperties {
            name: point.name.clone(),
            sigma_m: point.sigma_m,
            reference: position(point.reference_geocentric_m)?,
        },
    })
}
