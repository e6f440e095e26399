//! What became of every control point and every edge.

use nalgebra::Vector2;

use super::{ControlPointResult, EdgeResult, Outcome};
use crate::diagnosis::Diagnosis;
use crate::geometry::{Camera, Segment2};
use crate::orientation::adjust::{Adjustment, Building};
use crate::orientation::extract::ObservedSegment;
use crate::orientation::predict::{edges_on_frame_px, on_frame};
use crate::orientation::search::Search;

impl Outcome {
    /// The outcome for an image for which no orientation was found.
    pub(super) fn without_orientation(diagnosis: Diagnosis) -> Self {
        Self {
            estimate: None,
            control_points: Vec::new(),
            edges: Vec::new(),
            ground_precision: Vec::new(),
            consensus: None,
            diagnosis,
            cost: None,
        }
    }
}

/// All control points of the search that are in view under the adjusted orientation or, without one, under the
/// approximate one.
pub(super) fn control_point_results(
    search: &Search,
    adjustment: Option<&Adjustment>,
    observed: &[ObservedSegment],
) -> Vec<ControlPointResult> {
    in_view(search, adjustment).map(|index| control_point_result(search, adjustment, observed, index)).collect()
}

/// Indices of the control points that the results speak of, in their order: those whose reference point is on the frame
/// and those that took part with the edges that are.
pub(super) fn in_view(search: &Search, adjustment: Option<&Adjustment>) -> impl Iterator<Item = usize> {
    let orientation = adjustment.map_or(search.approximation.orientation, |a| a.orientation);
    let c = search.camera.principal_distance_px;
    (0..search.control.len()).filter(move |index| {
        let image = orientation.reduced_px(c, search.control[*index].reference_m);
        let took_part = || adjustment.is_some_and(|a| a.buildings.iter().any(|b| b.control_point == *index));
        image.is_some_and(|p| on_frame(search.camera, p, 0.0)) || took_part()
    })
}

fn control_point_result(
    search: &Search,
    adjustment: Option<&Adjustment>,
    observed: &[ObservedSegment],
    index: usize,
) -> ControlPointResult {
    let control_point = &search.control[index];
    let (camera, approximate) = (search.camera, &search.approximation.orientation);
    let building =
        adjustment.and_then(|a| a.buildings.iter().zip(&a.kept).find(|(b, _)| b.control_point == index).zip(Some(a)));
    let mut result = ControlPointResult {
        name: control_point.name.clone(),
        predicted_px: approximate.pixel(camera, control_point.reference_m),
        located_px: None,
        used: false,
        segments_matched: 0,
        residual_px: None,
    };
    if let Some(((building, kept), adjustment)) = building {
        let reference = adjustment.orientation.reduced_px(camera.principal_distance_px, control_point.reference_m);
        result.located_px = reference.map(|p| camera.pixel_from_reduced(p + building.shift_px));
        let edges = edges_on_frame_px(camera, &adjustment.orientation, control_point);
        let mut matched: Vec<usize> = Vec::new();
        let (mut squares, mut count) = (0.0, 0.0);
        for (found, _) in building.matches.iter().zip(kept).filter(|(_, kept)| **kept) {
            matched.push(found.edge);
            if let Some(edge) = &edges[found.edge] {
                let ends = observed[found.segment].segment_px;
                for end in [ends.start, ends.end] {
                    squares += edge.normal().dot(&(end - edge.start)).powi(2);
                    count += 1.0;
                }
            }
        }
        matched.sort_unstable();
        matched.dedup();
        result.used = !matched.is_empty();
        result.segments_matched = matched.len();
        result.residual_px = (count > 0.0).then(|| (squares / count).sqrt());
    }
    result
}

/// The edges of all control points in view under the adjusted orientation.
pub(super) fn edge_results(search: &Search, adjustment: &Adjustment, observed: &[ObservedSegment]) -> Vec<EdgeResult> {
    let mut results = Vec::new();
    for (place, index) in in_view(search, Some(adjustment)).enumerate() {
        let control_point = &search.control[index];
        let building = adjustment.buildings.iter().zip(&adjustment.kept).find(|(b, _)| b.control_point == index);
        let edges = edges_on_frame_px(search.camera, &adjustment.orientation, control_point);
        for (number, edge) in edges.iter().enumerate() {
            let Some(edge) = edge else { continue };
            results.push(EdgeResult {
                control_point: place,
                projected_px: in_file(search.camera, edge),
                matched_px: building.map_or(Vec::new(), |(b, kept)| pieces(b, kept, number, observed)),
            });
        }
    }
    results
}

fn pieces(building: &Building, kept: &[bool], edge: usize, observed: &[ObservedSegment]) -> Vec<Segment2> {
    let of_edge = building.matches.iter().zip(kept).filter(|(found, kept)| found.edge == edge && **kept);
    of_edge.map(|(found, _)| observed[found.segment].file_px).collect()
}

fn in_file(camera: &Camera, edge: &Segment2) -> Segment2 {
    let pixel = |p: Vector2<f64>| camera.pixel_from_reduced(p);
    Segment2 { start: pixel(edge.start), end: pixel(edge.end) }
}
