//! What there is to see of an orientation, in pixels of the file and on the map: kept with the result, so that it can be
//! shown at any time.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::map;
use super::position::Position;
use crate::geometry::{CrsError, LocalFrame, Segment2};
use crate::orientation::ControlPoint;
use crate::pipeline::{ControlKind, ControlPointResult, Ellipse, Outcome};

/// What is drawn. Drawings of older versions lack what has a default.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Drawing {
    pub(super) points: Vec<DrawnPoint>,
    pub(super) edges: Vec<DrawnEdge>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) tolerance_m: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) map: Option<Value>,
}

/// A control point.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct DrawnPoint {
    pub(super) name: String,
    #[serde(default)]
    pub(super) is_scene: bool,
    pub(super) predicted_px: Option<[f64; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) search_region: Option<SearchRegion>,
    pub(super) located_px: Option<[f64; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) projected_px: Option<[f64; 2]>,
    pub(super) used: bool,
}

/// An edge of a control point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct DrawnEdge {
    pub(super) point: usize,
    pub(super) projected_px: [[f64; 2]; 2],
    pub(super) matched_px: Vec<[[f64; 2]; 2]>,
}

/// Where a reference point is, by the approximate orientation and its standard deviations: the ellipse of three of them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SearchRegion {
    /// Its middle, in pixels of the file.
    #[schema(value_type = Vec<f64>)]
    centre_px: [f64; 2],
    /// The longer semi-axis and the shorter one.
    #[schema(value_type = Vec<f64>)]
    semi_axes_px: [f64; 2],
    /// Direction of the longer one, from x towards y (which points down).
    angle_deg: f64,
}

impl From<Ellipse> for SearchRegion {
    fn from(ellipse: Ellipse) -> Self {
        let Ellipse { centre, semi_axes, angle_rad } = ellipse;
        Self { centre_px: centre.into(), semi_axes_px: semi_axes, angle_deg: angle_rad.to_degrees() }
    }
}

/// What there is to see in the image. Pixels are those of the file as stored.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ImageDrawing {
    /// The image and its size.
    pub image: DrawnImage,
    /// The largest planimetric error on the ground that is accepted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tolerance_m: Option<f64>,
    /// The control points that were expected in the image.
    pub control_points: Vec<ControlPointDrawing>,
    /// Their edges under the orientation.
    pub edges: Vec<EdgeDrawing>,
}

/// The image that is drawn upon.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct DrawnImage {
    /// Its id.
    pub id: uuid::Uuid,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
}

/// A control point in the image.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ControlPointDrawing {
    /// Its name.
    name: String,
    /// `lines` or `scene`.
    #[schema(example = "lines")]
    kind: &'static str,
    /// `matched`: it was used; `rejected`: it was found, but all that was matched to it was rejected; `unmatched`: it took
    /// no part.
    #[schema(example = "matched")]
    state: &'static str,
    /// Its reference point under the approximate orientation.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    predicted_px: Option<[f64; 2]>,
    /// Around that; left out where the approximation knows no heading.
    #[serde(skip_serializing_if = "Option::is_none")]
    search_region: Option<SearchRegion>,
    /// Where it was found.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    located_px: Option<[f64; 2]>,
    /// Its reference point under the adjusted orientation.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    projected_px: Option<[f64; 2]>,
}

/// An edge in the image.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct EdgeDrawing {
    /// Its control point, as an index into the list of them.
    control_point: usize,
    /// Both ends under the orientation.
    #[schema(value_type = Vec<Vec<f64>>)]
    projected_px: [[f64; 2]; 2],
    /// Both ends of each line segment that was matched to it, and kept.
    #[schema(value_type = Vec<Vec<Vec<f64>>>)]
    matched_px: Vec<[[f64; 2]; 2]>,
}

impl Drawing {
    /// What there is to draw of an outcome. `control` are the control points that it could know, in `frame`;
    /// `approximation` is the position that was stated.
    ///
    /// # Errors
    /// [`CrsError`] if the CRS of that is not known any more.
    pub fn of(
        outcome: &Outcome,
        control: &[ControlPoint],
        frame: &LocalFrame,
        approximation: &Position,
    ) -> Result<Self, CrsError> {
        let edges = outcome.edges.iter().map(|edge| DrawnEdge {
            point: edge.control_point,
            projected_px: ends(&edge.projected_px),
            matched_px: edge.matched_px.iter().map(ends).collect(),
        });
        Ok(Self {
            points: outcome.control_points.iter().map(DrawnPoint::of).collect(),
            edges: edges.collect(),
            tolerance_m: outcome.evidence.as_ref().map(|evidence| evidence.tolerance_m),
            map: Some(map::map(outcome, control, frame, approximation)?),
        })
    }

    /// As it was kept.
    ///
    /// # Errors
    /// If it was not, or is none.
    pub fn kept(text: Option<&str>) -> Result<Self, serde_json::Error> {
        serde_json::from_str(text.unwrap_or_default())
    }

    /// On the ground: GeoJSON. `None` in a drawing of an older version.
    #[must_use]
    pub fn map(&self) -> Option<&Value> {
        self.map.as_ref()
    }

    /// In the image.
    #[must_use]
    pub fn on(&self, image: DrawnImage) -> ImageDrawing {
        let edges = self.edges.iter().map(|edge| EdgeDrawing {
            control_point: edge.point,
            projected_px: edge.projected_px,
            matched_px: edge.matched_px.clone(),
        });
        let control_points = self.points.iter().map(|point| ControlPointDrawing {
            name: point.name.clone(),
            kind: if point.is_scene { "scene" } else { "lines" },
            state: point.state(),
            predicted_px: point.predicted_px,
            search_region: point.search_region,
            located_px: point.located_px,
            projected_px: point.projected_px,
        });
        ImageDrawing {
            image,
            tolerance_m: self.tolerance_m,
            control_points: control_points.collect(),
            edges: edges.collect(),
        }
    }

    /// Where a control point was located; of another the middle of its projected edges, since the approximation may
    /// have predicted it far from them.
    pub(super) fn place_of_name(&self, index: usize) -> Option<[f64; 2]> {
        let point = self.points.get(index)?;
        let edges = self.edges.iter().filter(|edge| edge.point == index);
        let ends: Vec<Vector2<f64>> = edges.flat_map(|edge| edge.projected_px).map(Into::into).collect();
        let middle = (!ends.is_empty()).then(|| (ends.iter().sum::<Vector2<f64>>() / ends.len() as f64).into());
        point.located_px.or(middle).or(point.predicted_px)
    }
}

impl DrawnPoint {
    fn of(point: &ControlPointResult) -> Self {
        let pixels = |point: Option<Vector2<f64>>| point.map(Into::into);
        Self {
            name: point.name.clone(),
            is_scene: point.kind == ControlKind::Scene,
            predicted_px: pixels(point.predicted_px),
            search_region: point.search_region_px.map(Into::into),
            located_px: pixels(point.located_px),
            projected_px: pixels(point.projected_px),
            used: point.used,
        }
    }

    /// In the words of the contract.
    pub(super) fn state(&self) -> &'static str {
        map::state(self.used, self.located_px.is_some())
    }
}

fn ends(segment: &Segment2) -> [[f64; 2]; 2] {
    [segment.start.into(), segment.end.into()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawings_of_an_older_version_can_be_read() {
        let kept = r#"{"points": [{"name": "a", "predicted_px": [1, 2], "located_px": null, "used": false}],
            "edges": [{"point": 0, "projected_px": [[0, 0], [1, 1]], "matched_px": []}]}"#;
        let drawing: Drawing = serde_json::from_str(kept).unwrap();
        assert!(drawing.map().is_none());
        let shown = drawing.on(DrawnImage { id: uuid::Uuid::nil(), width_px: 10, height_px: 20 });
        assert_eq!((shown.control_points[0].state, shown.control_points[0].kind), ("unmatched", "lines"));
        assert_eq!(shown.edges[0].control_point, 0);
    }
}
