//! The objects of CityJSON, whole or in a sequence: which belong together, and what of them is roof.

mod boundaries;
mod family;
mod relatives;

use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

use serde::Deserialize;
use serde::de::{Deserializer, Visitor};
use serde_json::Value;
use serde_json::value::RawValue;

pub(super) use self::family::items;
use self::relatives::{Children, Parents};
use super::model::{FARTHEST, LONGEST_NAME, Limits, shortened_detail, shortened_name};
use super::reference_system::ReferenceSystem;
use super::roof::Surfaces;

/// From the integers of a file to its CRS.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(super) struct Transform {
    scale: [f64; 3],
    translate: [f64; 3],
}

impl Default for Transform {
    /// CityJSON 1.0 may leave it out, and then has real numbers.
    fn default() -> Self {
        Self { scale: [1.0; 3], translate: [0.0; 3] }
    }
}

/// What holds for all buildings of a file.
#[derive(Debug, Default)]
pub(super) struct Frame {
    pub(super) system: Option<ReferenceSystem>,
    pub(super) transform: Transform,
}

impl Frame {
    pub(super) fn crs(&self) -> Option<Arc<str>> {
        self.system.as_ref().map(|system| system.text.clone())
    }
}

/// The part of the metadata that is read.
#[derive(Deserialize)]
pub(super) struct Metadata {
    #[serde(rename = "referenceSystem")]
    reference_system: Option<String>,
}

impl Metadata {
    pub(super) fn system(&self) -> Option<ReferenceSystem> {
        self.reference_system.as_deref().and_then(ReferenceSystem::parse)
    }
}

/// What an object is to a building.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Building,
    Part,
}

/// An object that is or belongs to a building, as little of it as is needed until the vertices are known.
#[derive(Debug)]
pub(super) struct Object {
    pub(super) name: Box<str>,
    pub(super) role: Role,
    /// Those after the first would be of no use.
    parent: Option<Box<str>>,
    pub(super) children: Vec<Box<str>>,
    /// Root mean square of what its roof is off the points from which it was made, where that is stated.
    roof_rmse_m: Option<f64>,
    /// Its roof, or what is wrong with it.
    pub(super) found: Result<Found, String>,
}

impl Object {
    /// One that cannot be read.
    pub(super) fn broken(name: &str, detail: String) -> Self {
        let found = Err(shortened_detail(detail));
        let name = shortened_name(name.to_owned()).into();
        Self { name, role: Role::Building, parent: None, children: Vec::new(), roof_rmse_m: None, found }
    }

    /// `None` if the object has nothing to do with buildings.
    pub(super) fn of(name: &str, written: &Written<'_>, limits: &Limits) -> Option<Self> {
        let role = match &*written.r#type {
            "Building" => Role::Building,
            "BuildingPart" => Role::Part,
            _ => return None,
        };
        if name.chars().nth(LONGEST_NAME).is_some() {
            return Some(Self::broken(name, format!("its name has more than {LONGEST_NAME} characters")));
        }
        let found = find(written.geometry.as_deref().unwrap_or_default(), limits);
        let roof_rmse_m = written.attributes.as_ref().and_then(Attributes::roof_rmse_m);
        let (parent, children) = (written.parents.0.clone(), written.children.0.clone());
        Some(Self { name: name.into(), role, parent, children, roof_rmse_m, found })
    }
}

/// What the geometries of an object hold.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub(super) roof: Option<IndexedRoof>,
    /// The highest LoD that has roof surfaces and is below 2.
    below: Option<Lod>,
    /// Whether one is an instance of a template.
    instance: bool,
}

/// Roof polygons as indices of vertices.
#[derive(Debug, Default)]
pub(super) struct IndexedRoof {
    lod: Lod,
    /// Of all rings, one after the other.
    indices: Vec<u32>,
    /// Where each ring ends in `indices`.
    rings: Vec<u32>,
    /// Where each polygon ends in `rings`.
    polygons: Vec<u32>,
}

impl IndexedRoof {
    /// Adds its polygons, with coordinates, to those of the building.
    fn resolve(&self, vertices: &[[f64; 3]], transform: &Transform, surfaces: &mut Surfaces) -> Result<(), String> {
        let (mut index, mut ring) = (0, 0);
        for polygon_end in &self.polygons {
            while ring < *polygon_end as usize {
                while index < self.rings[ring] as usize {
                    surfaces.point(point(self.indices[index], vertices, transform)?);
                    index += 1;
                }
                surfaces.end_ring();
                ring += 1;
            }
            surfaces.end_polygon();
        }
        Ok(())
    }
}

fn point(index: u32, vertices: &[[f64; 3]], transform: &Transform) -> Result<[f64; 3], String> {
    let Some(vertex) = vertices.get(index as usize) else {
        return Err(format!("a roof refers to vertex {index}; there are {} vertices, from 0", vertices.len()));
    };
    let point = std::array::from_fn(|axis| vertex[axis] * transform.scale[axis] + transform.translate[axis]);
    if point.iter().all(|value: &f64| value.abs() <= FARTHEST) {
        Ok(point)
    } else {
        Err(format!("vertex {index} of a roof is at {point:?}; coordinates must be within ±{FARTHEST:e}"))
    }
}

/// A level of detail in tenths: 2.2 is 22.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) struct Lod(u8);

impl Lod {
    /// Below it roofs are blocks.
    const LEAST: Self = Self(20);
}

impl fmt::Display for Lod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 % 10 {
            0 => write!(f, "{}", self.0 / 10),
            tenths => write!(f, "{}.{tenths}", self.0 / 10),
        }
    }
}

impl<'de> Deserialize<'de> for Lod {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(LodVisitor)
    }
}

struct LodVisitor;

impl Visitor<'_> for LodVisitor {
    type Value = Lod;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a level of detail such as \"2.2\"")
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<Lod, E> {
        self.visit_f64(text.trim().parse().map_err(|_| E::custom(format!("the LoD {text:?} is no number")))?)
    }

    fn visit_u64<E: serde::de::Error>(self, number: u64) -> Result<Lod, E> {
        self.visit_f64(number as f64)
    }

    fn visit_f64<E: serde::de::Error>(self, number: f64) -> Result<Lod, E> {
        if (0.0..10.0).contains(&number) {
            Ok(Lod((number * 10.0).round() as u8))
        } else {
            Err(E::custom(format!("the LoD {number} is not between 0 and 4")))
        }
    }
}

/// An object as it is written.
#[derive(Deserialize)]
pub(super) struct Written<'a> {
    #[serde(borrow)]
    r#type: Cow<'a, str>,
    #[serde(default)]
    parents: Parents,
    #[serde(default)]
    children: Children,
    attributes: Option<Attributes>,
    #[serde(borrow, default)]
    geometry: Option<Vec<Geometry<'a>>>,
}

/// The attributes that are read.
#[derive(Deserialize)]
struct Attributes {
    /// Of 3DBAG, and of the program that makes it: of the roof of LoD 2.2, in metres.
    #[serde(alias = "rf_rmse_lod22", default)]
    b3_rmse_lod22: Value,
}

impl Attributes {
    fn roof_rmse_m(&self) -> Option<f64> {
        self.b3_rmse_lod22.as_f64().filter(|rmse_m| *rmse_m >= 0.0)
    }
}

#[derive(Deserialize)]
struct Geometry<'a> {
    #[serde(borrow)]
    r#type: Cow<'a, str>,
    lod: Option<Lod>,
    #[serde(borrow)]
    boundaries: Option<&'a RawValue>,
    #[serde(borrow)]
    semantics: Option<Semantics<'a>>,
}

#[derive(Deserialize)]
struct Semantics<'a> {
    #[serde(borrow)]
    surfaces: Vec<SemanticSurface<'a>>,
    #[serde(borrow)]
    values: Option<&'a RawValue>,
}

#[derive(Deserialize)]
struct SemanticSurface<'a> {
    #[serde(borrow)]
    r#type: Cow<'a, str>,
}

/// The roof of the highest LoD that has one.
fn find(geometries: &[Geometry<'_>], limits: &Limits) -> Result<Found, String> {
    let mut found = Found::default();
    let mut candidates: Vec<(Lod, &Geometry<'_>, &Semantics<'_>)> = Vec::new();
    for geometry in geometries {
        found.instance |= geometry.r#type == "GeometryInstance";
        if let (Some(lod), Some(semantics)) = (geometry.lod, &geometry.semantics)
            && semantics.surfaces.iter().any(|surface| surface.r#type == "RoofSurface")
        {
            candidates.push((lod, geometry, semantics));
        }
    }
    candidates.sort_by_key(|(lod, ..)| std::cmp::Reverse(*lod));
    for (lod, geometry, semantics) in candidates {
        if lod < Lod::LEAST {
            found.below = found.below.max(Some(lod));
            continue;
        }
        // one geometry may have one half of the roof, and another one the other
        if found.roof.as_ref().is_some_and(|roof| roof.lod > lod) {
            break;
        }
        let mut roof = found.roof.take().unwrap_or_default();
        add_roof(geometry, semantics, limits, &mut roof)
            .map_err(|detail| format!("geometry of LoD {lod}: {detail}"))?;
        found.roof = Some(IndexedRoof { lod, ..roof }).filter(|roof| !roof.polygons.is_empty());
    }
    Ok(found)
}

/// Adds what a geometry has of roof.
fn add_roof(
    geometry: &Geometry<'_>,
    semantics: &Semantics<'_>,
    limits: &Limits,
    roof: &mut IndexedRoof,
) -> Result<(), String> {
    let depth = match &*geometry.r#type {
        "MultiSurface" | "CompositeSurface" => 3,
        "Solid" => 4,
        "MultiSolid" | "CompositeSolid" => 5,
        _ => return Ok(()),
    };
    let (Some(boundaries), Some(values)) = (geometry.boundaries, semantics.values) else {
        return Ok(());
    };
    let is_roof: Vec<bool> = semantics.surfaces.iter().map(|surface| surface.r#type == "RoofSurface").collect();
    let all = boundaries::Boundaries::parse(boundaries.get(), depth, limits)?;
    all.add_roof(values.get(), &is_roof, roof)
}
