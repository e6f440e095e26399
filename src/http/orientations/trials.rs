//! Correcting by hand: adjustments with control points switched off or moved, and what is around a control point.

use axum::extract::State;
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use utoipa::ToSchema;
use uuid::Uuid;

use super::drawing::{drawn_image, succeeded};
use crate::geometry::Segment2;
use crate::http::extract::{Json, Path};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::desks::{DeskError, Tried};
use crate::pipeline::desk::{Correction, Neighbourhood};
use crate::report::OrientationResult;
use crate::report::drawing::{DrawnImage, ImageDrawing};
use crate::store::orientations::Orientation;

/// Control points in one correction.
const MOST_CORRECTED: usize = 1000;
/// So far beside the image a reference point may be, as a share of its size.
const BESIDE: f64 = 0.25;

/// What is corrected by hand.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct CorrectionRequest {
    /// Names of control points that are not to be used.
    #[serde(default)]
    #[schema(max_items = 1000)]
    off: Vec<String>,
    /// Where the reference points of others are.
    #[serde(default)]
    #[schema(max_items = 1000)]
    moved: Vec<MovedRequest>,
}

/// A control point that was moved to where it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct MovedRequest {
    /// Its name.
    name: String,
    /// Where its reference point is in the image, in pixels of the file.
    #[schema(value_type = Vec<f64>, min_items = 2, max_items = 2)]
    at_px: [f64; 2],
}

impl CorrectionRequest {
    /// The correction for an image, checked.
    pub(super) fn checked(&self, image_px: [u32; 2], pointer: &str) -> Result<Correction, Problem> {
        if self.off.len().max(self.moved.len()) > MOST_CORRECTED {
            return Err(Problem::invalid_field(pointer, format!("at most {MOST_CORRECTED} control points")));
        }
        let [width, height] = image_px.map(f64::from);
        for (index, MovedRequest { at_px: [x, y], name }) in self.moved.iter().enumerate() {
            // the reference point of a building at the rim may lie beside the image
            let near = |at: f64, size: f64| (-size * BESIDE..=size * (1.0 + BESIDE)).contains(&at);
            if !(near(*x, width) && near(*y, height)) {
                let detail = format!("({x}, {y}) lies far from the image, which has {width} x {height} px");
                return Err(Problem::invalid_field(format!("{pointer}/moved/{index}/at_px"), detail));
            }
            if self.moved[..index].iter().any(|other| other.name == *name) {
                let detail = format!("{name:?} is moved twice");
                return Err(Problem::invalid_field(format!("{pointer}/moved/{index}/name"), detail));
            }
        }
        let moved = self.moved.iter().map(|moved| (moved.name.clone(), Vector2::from(moved.at_px)));
        Ok(Correction { off: self.off.clone(), moved: moved.collect() })
    }
}

/// An adjustment with a correction, not kept.
#[derive(Debug, Serialize, ToSchema)]
struct TrialAnswer {
    /// As of an orientation.
    result: OrientationResult,
    /// What there is to see in the image.
    drawing: ImageDrawing,
    /// What there is to see on the map: GeoJSON.
    #[schema(value_type = serde_json::Value)]
    map: Option<Box<RawValue>>,
    /// How long the adjustment took.
    seconds: f64,
}

/// Try a correction
///
/// Adjusts the orientation again without some of its control points, or with others where somebody has seen them. Nothing is
/// kept: `POST /orientations/{id}/reviews` keeps a correction. The first time for an orientation takes as long as orienting
/// the image; then its line segments are at hand for a while. An empty correction gives the orientation as the control of
/// today has it.
#[utoipa::path(
    post, path = "/orientations/{id}/trials", operation_id = "try_correction", tag = "orientations",
    params(("id" = Uuid, Path, description = "The orientation's id")), request_body = CorrectionRequest,
    responses(
        (status = 200, description = "What the correction leads to", body = TrialAnswer),
        (status = 404, description = "There is no such orientation, or it has no result", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "It has not ended yet, or cannot be corrected", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "Its image was removed", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A control point is not known, or lies outside of the image", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn attempt(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Json(request): Json<CorrectionRequest>,
) -> Result<axum::Json<impl Serialize>, Problem> {
    let orientation = succeeded(&state, id).await?;
    let image = drawn_image(&state, &orientation).await?;
    let tried = tried(&state, &orientation, &image, (&request, "")).await?;
    let map = tried.oriented.drawing.map().map(|map| RawValue::from_string(map.to_string())).transpose();
    Ok(axum::Json(TrialAnswer {
        drawing: tried.oriented.drawing.on(image),
        map: map.map_err(|error| Problem::internal(&error))?,
        result: tried.oriented.result,
        seconds: tried.seconds,
    }))
}

/// A correction of an orientation, with where it stands in the request.
pub(super) async fn tried(
    state: &AppState,
    orientation: &Orientation,
    image: &DrawnImage,
    (request, pointer): (&CorrectionRequest, &str),
) -> Result<Tried, Problem> {
    let correction = request.checked([image.width_px, image.height_px], pointer)?;
    state.jobs.corrected(orientation, correction).await.map_err(|error| match error {
        DeskError::UnknownControlPoint { .. } => Problem::invalid_field(pointer, error.to_string()),
        error => error.into(),
    })
}

impl From<DeskError> for Problem {
    fn from(error: DeskError) -> Self {
        match error {
            DeskError::Attempt(error) => error.into(),
            DeskError::UnknownControlPoint { .. } => Self::invalid_field("", error.to_string()),
            DeskError::NoCamera => Self::conflict(error.to_string()),
            DeskError::Cleared => Self::unavailable(format!("{error}; try again."), 1),
        }
    }
}

/// What is around a control point. Pixels of the file.
#[derive(Debug, Serialize, ToSchema)]
struct WindowAnswer {
    /// Column, row, width and height of the part of the image that holds it all.
    #[schema(value_type = Vec<u32>)]
    window_px: [u32; 4],
    /// Where its reference point is expected under the orientation that was found or, without one, the approximate one.
    #[schema(value_type = Vec<f64>)]
    predicted_px: [f64; 2],
    /// Where it was found.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Vec<f64>>)]
    located_px: Option<[f64; 2]>,
    /// Its edges there.
    #[schema(value_type = Vec<Vec<Vec<f64>>>)]
    edges_px: Vec<[[f64; 2]; 2]>,
    /// The line segments of the image around it.
    #[schema(value_type = Vec<Vec<Vec<f64>>>)]
    segments_px: Vec<[[f64; 2]; 2]>,
    /// How much they speak for each shift of the edges; none of a control scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    accumulator: Option<AccumulatorAnswer>,
}

/// How much the line segments speak for each shift of a control point's edges (probabilistic clustering).
#[derive(Debug, Serialize, ToSchema)]
struct AccumulatorAnswer {
    /// Shift zero.
    #[schema(value_type = Vec<f64>)]
    centre_px: [f64; 2],
    /// Side of a cell. Rows and columns are parallel to those of the image but for its distortion and, of a scan, for how
    /// the film lies.
    cell_px: f64,
    /// Cells along a side; odd, the middle one is shift zero.
    size: usize,
    /// Logarithms of likelihood ratios, row by row.
    values: Vec<f32>,
    /// The best shifts first.
    peaks: Vec<PeakAnswer>,
}

/// A shift that much speaks for.
#[derive(Debug, Serialize, ToSchema)]
struct PeakAnswer {
    /// Where the reference point would be.
    #[schema(value_type = Vec<f64>)]
    at_px: [f64; 2],
    /// Logarithm of the likelihood ratio.
    log_likelihood: f64,
}

impl From<Neighbourhood> for WindowAnswer {
    fn from(seen: Neighbourhood) -> Self {
        let Neighbourhood { rect, predicted_px, located_px, edges_px, segments_px, accumulator } = seen;
        let ends = |segment: &Segment2| [segment.start.into(), segment.end.into()];
        let peak = |(at_px, log_likelihood): &(Vector2<f64>, f64)| PeakAnswer {
            at_px: (*at_px).into(),
            log_likelihood: *log_likelihood,
        };
        Self {
            window_px: [rect.x, rect.y, rect.width, rect.height],
            predicted_px: predicted_px.into(),
            located_px: located_px.map(Into::into),
            edges_px: edges_px.iter().map(ends).collect(),
            segments_px: segments_px.iter().map(ends).collect(),
            accumulator: accumulator.map(|accumulator| AccumulatorAnswer {
                centre_px: predicted_px.into(),
                cell_px: accumulator.map.cell_px,
                size: accumulator.map.size,
                peaks: accumulator.peaks.iter().map(peak).collect(),
                values: accumulator.map.values,
            }),
        }
    }
}

/// Look around a control point
///
/// The line segments around a control point, and how much they speak for each shift of its edges: its accumulator. The first
/// look at an orientation takes as long as orienting the image.
#[utoipa::path(
    get, path = "/orientations/{id}/control-points/{name}/window", operation_id = "show_control_point_window",
    tag = "orientations",
    params(
        ("id" = Uuid, Path, description = "The orientation's id"),
        ("name" = String, Path, description = "The control point's name"),
    ),
    responses(
        (status = 200, description = "What is around it", body = WindowAnswer),
        (status = 404, description = "There is no such orientation, or it cannot see such a control point", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "It has not ended yet", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "Its image was removed", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn window(
    State(state): State<AppState>,
    Path((id, name)): Path<(Uuid, String)>,
) -> Result<axum::Json<impl Serialize>, Problem> {
    let orientation = succeeded(&state, id).await?;
    drawn_image(&state, &orientation).await?;
    let seen = state.jobs.neighbourhood(&orientation, name).await?;
    let seen = seen.ok_or_else(|| Problem::not_found("No control point of this name can be in view of the image."))?;
    Ok(axum::Json(WindowAnswer::from(seen)))
}
