//! Control points as GeoJSON again, as they would be imported.

use chrono::NaiveDate;
use serde::Serialize;
use utoipa::ToSchema;

use super::Source;
use crate::buildings::EdgeKind;
use crate::control::model::{StoredControlPoint, StoredEdge, Use};

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
    /// Its name, unique within its set.
    pub name: String,
    /// Standard deviation of its coordinates, the accuracy of the transformation from the CRS of its import included.
    pub sigma_m: f64,
    /// Its reference point `[x, y, z]`.
    #[schema(value_type = Vec<f64>)]
    pub reference: [f64; 3],
    /// The set that it belongs to.
    #[schema(example = "default")]
    pub set: String,
    /// `control`: images are oriented by it. `check`: it is never used, and what an image shows of it is reported.
    #[schema(value_type = String, pattern = "^(control|check)$", example = "control")]
    pub r#use: Use,
    /// The first day on which the building stands like this; left out if that is open.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub valid_from: Option<NaiveDate>,
    /// The last day; left out if that is open.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub valid_to: Option<NaiveDate>,
    /// For each line what kind of edge it is: `eave`, `ridge`, `gable`, `hip`, `valley`, `rim` or null; left out if nothing
    /// is known of any.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<Option<String>>>)]
    pub edge_kinds: Option<Vec<Option<&'static str>>>,
    /// For each line its standard deviation across itself in metres; left out if all are as good as `sigma_m` says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub edge_sigma_m: Option<Vec<f64>>,
}

/// The feature of a control point of a set; `None` where the CRS does not reach.
#[must_use]
pub fn feature(point: &StoredControlPoint, set: &str, target: &Source<'_>) -> Option<ControlPointFeature> {
    let position = |geocentric_m| target.crs.position_from_geocentric(geocentric_m, target.geoid_undulation_m).ok();
    let line = |edge: &StoredEdge| Some([position(edge.geocentric_m.start)?, position(edge.geocentric_m.end)?]);
    let edges = &point.edges;
    let with_kinds = edges.iter().any(|edge| edge.kind.is_some());
    let with_sigmas = edges.iter().any(|edge| edge.sigma_m != point.sigma_m);
    Some(ControlPointFeature {
        r#type: "Feature",
        geometry: MultiLineString {
            r#type: "MultiLineString",
            coordinates: edges.iter().map(line).collect::<Option<_>>()?,
        },
        properties: ControlPointProperties {
            name: point.name.clone(),
            sigma_m: point.sigma_m,
            reference: position(point.reference_geocentric_m)?,
            set: set.to_owned(),
            r#use: point.purpose,
            valid_from: point.validity.from,
            valid_to: point.validity.to,
            edge_kinds: with_kinds.then(|| edges.iter().map(|edge| edge.kind.map(EdgeKind::name)).collect()),
            edge_sigma_m: with_sigmas.then(|| edges.iter().map(|edge| edge.sigma_m).collect()),
        },
    })
}
