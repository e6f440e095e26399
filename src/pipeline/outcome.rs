//! What became of every control point and every edge.

use nalgebra::{Vector2, Vector3};

use super::{
    ControlKind, ControlPointResult, ControlPointSensitivity, EdgeResult, Ellipse, GroundBounds, Outcome, PairResult,
};
use crate::diagnosis::{Diagnosis, GroundSensitivity, Sensitivities};
use crate::geometry::{Camera, ExteriorOrientation, Segment2};
use crate::orientation::ControlPoint;
use crate::orientation::adjust::{Adjustment, Building};
use crate::orientation::extract::ObservedSegment;
use crate::orientation::matching::Match;
use crate::orientation::predict::{Prediction, edges_on_frame_px, on_frame};
use crate::orientation::search::Search;

impl Outcome {
    /// The outcome for an image for which no orientation was found.
    pub(super) fn without_orientation(diagnosis: Diagnosis) -> Self {
        Self {
            estimate: None,
            control_points: Vec::new(),
            check_points: Vec::new(),
            pairs: Vec::new(),
            edges: Vec::new(),
            ground_precision: Vec::new(),
            consensus: None,
            diagnosis,
            evidence: None,
            trials: Vec::new(),
            ground_height_m: None,
            footprint_m: Vec::new(),
            cost: None,
        }
    }
}

/// All control points of the search that are in view under the adjusted orientation or, without one, under the
/// approximate one.
pub(super) fn control_point_results(
    search: &Search,
    adjusted: Option<(&Adjustment, &Sensitivities)>,
    observed: &[ObservedSegment],
) -> Vec<ControlPointResult> {
    let adjustment = adjusted.map(|(adjustment, _)| adjustment);
    let mut results: Vec<ControlPointResult> =
        in_view(search, adjustment).map(|index| control_point_result(search, adjustment, observed, index)).collect();
    if let Some((adjustment, sensitivities)) = adjusted {
        let places = places(search, adjustment);
        for of_one in &sensitivities.single {
            let [member] = of_one.members;
            if let Some(place) = places[member] {
                results[place].sensitivity = Some(ControlPointSensitivity {
                    discrepancy_px: of_one.discrepancy_px[0],
                    test: of_one.test,
                    contradicts: of_one.contradicts,
                    ground: bounds(of_one),
                });
            }
        }
    }
    results
}

/// How the result depends on pairs of control points.
pub(super) fn pair_results(search: &Search, adjustment: &Adjustment, sensitivities: &Sensitivities) -> Vec<PairResult> {
    let places = places(search, adjustment);
    let result = |pair: &GroundSensitivity<2>| {
        let [a, b] = pair.members.map(|member| places[member]);
        Some(PairResult { control_points: [a?, b?], test: pair.test, ground: bounds(pair) })
    };
    sensitivities.pairs.iter().filter_map(result).collect()
}

/// For each building of an adjustment its place among the results.
fn places(search: &Search, adjustment: &Adjustment) -> Vec<Option<usize>> {
    let shown: Vec<usize> = in_view(search, Some(adjustment)).collect();
    let place = |control_point: usize| shown.iter().position(|index| *index == control_point);
    adjustment.buildings.iter().map(|building| place(building.control_point)).collect()
}

fn bounds<const MEMBERS: usize>(sensitivity: &GroundSensitivity<MEMBERS>) -> GroundBounds {
    let GroundSensitivity { change_m, empirical_m, theoretical_m, .. } = *sensitivity;
    GroundBounds { change_m, empirical_m, theoretical_m }
}

/// How much of the model edges has a line segment in the image, by length.
pub(super) struct MatchedShares {
    /// Of the control points that took part.
    pub(super) of_used: f64,
    /// Of all that are in view.
    pub(super) of_all: f64,
}

/// The shares of the matched edges under the adjusted orientation.
pub(super) fn matched_shares(search: &Search, adjustment: &Adjustment, observed: &[ObservedSegment]) -> MatchedShares {
    let (mut matched_px, mut of_used_px, mut of_all_px) = (0.0, 0.0, 0.0);
    for index in in_view(search, Some(adjustment)) {
        let building = adjustment.buildings.iter().zip(&adjustment.kept).find(|(b, _)| b.control_point == index);
        let used = building.is_some_and(|(_, kept)| kept.contains(&true));
        if search.control[index].scene.is_some() {
            of_all_px += SCENE_PX;
            of_used_px += if used { SCENE_PX } else { 0.0 };
            matched_px += if used { SCENE_PX } else { 0.0 };
        }
        let edges = edges_on_frame_px(search.camera, &adjustment.orientation, &search.control[index]);
        for (number, edge) in edges.iter().enumerate() {
            let Some(edge) = edge else { continue };
            of_all_px += edge.length();
            of_used_px += if used { edge.length() } else { 0.0 };
            let Some((building, kept)) = building else { continue };
            matched_px += covered_px(edge, kept_matches(building, kept, number), observed);
        }
    }
    let share = |of_px: f64| if of_px > 0.0 { matched_px / of_px } else { 0.0 };
    MatchedShares { of_used: share(of_used_px), of_all: share(of_all_px) }
}

/// A scene counts like so much of an edge: it is found as a whole or not at all.
const SCENE_PX: f64 = 100.0;

/// The length of an edge that segments cover, each part once.
fn covered_px<'m>(edge: &Segment2, matches: impl Iterator<Item = &'m Match>, observed: &[ObservedSegment]) -> f64 {
    let (along, length_px) = (edge.direction(), edge.length());
    let reach = |m: &Match| {
        let Segment2 { start, end } = observed[m.segment].segment_px;
        let [a, b] = [start, end].map(|p| along.dot(&(p - edge.start)).clamp(0.0, length_px));
        [a.min(b), a.max(b)]
    };
    let mut parts: Vec<[f64; 2]> = matches.map(reach).collect();
    parts.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let (mut covered_px, mut end_px) = (0.0, 0.0_f64);
    for [from, to] in parts {
        covered_px += (to - from.max(end_px)).max(0.0);
        end_px = end_px.max(to);
    }
    covered_px
}

/// Indices of the control points that the results speak of, in their order: those whose reference point is on the frame
/// and those that took part with the edges that are.
pub(super) fn in_view(search: &Search, adjustment: Option<&Adjustment>) -> impl Iterator<Item = usize> {
    let orientation = adjustment.map_or(search.approximation.orientation, |a| a.orientation);
    let c = search.camera.principal_distance_px;
    (0..search.control.len()).filter(|index| search.is_on(*index)).filter(move |index| {
        let image = orientation.reduced_px(c, search.control[*index].reference_m);
        let took_part = || adjustment.is_some_and(|a| a.buildings.iter().any(|b| b.control_point == *index));
        image.is_some_and(|p| on_frame(search.camera, p, 0.0)) || took_part()
    })
}

/// What became of one control point.
pub(super) fn control_point_result(
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
        kind: if control_point.scene.is_some() { ControlKind::Scene } else { ControlKind::Lines },
        predicted_px: approximate.pixel(camera, control_point.reference_m),
        search_region_px: search_region_px(search, control_point),
        located_px: None,
        projected_px: adjustment.and_then(|a| a.orientation.pixel(camera, control_point.reference_m)),
        used: false,
        segments_matched: 0,
        residual_px: None,
        sensitivity: None,
    };
    if let Some(((building, kept), adjustment)) = building {
        let reference = adjustment.orientation.reduced_px(camera.principal_distance_px, control_point.reference_m);
        result.located_px = reference.map(|p| camera.pixel_from_reduced(p + building.shift_px));
        let edges = edges_on_frame_px(camera, &adjustment.orientation, control_point);
        let mut matched: Vec<usize> = Vec::new();
        let (mut squares, mut count) = (0.0, 0.0);
        if let Some((measured, reference)) = building.measured.zip(reference) {
            squares += (measured.at_px - reference).norm_squared();
            count += 1.0;
        }
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
        result.used = kept.contains(&true);
        result.segments_matched = matched.len();
        result.residual_px = (count > 0.0).then(|| (squares / count).sqrt());
    }
    result
}

/// Of the ellipses around predicted points.
const REGION_SIGMAS: f64 = 3.0;

/// Where the approximation, with what it says of its errors, has a reference point; `None` where the heading is unknown.
fn search_region_px(search: &Search, control_point: &ControlPoint) -> Option<Ellipse> {
    let Search { camera, approximation, .. } = *search;
    approximation.sigma_kappa_rad?;
    let prior = approximation.prior(&approximation.orientation)?;
    let prediction = Prediction { orientation: prior.orientation, covariance: prior.information.try_inverse()? };
    let (image_px, covariance) = prediction.image_of(camera, control_point.reference_m, control_point.sigma_m)?;
    let by_reduced = camera.pixel_by_reduced();
    let in_file = by_reduced * covariance * by_reduced.transpose();
    Ellipse::of_covariance(camera.pixel_from_reduced(image_px), &in_file, REGION_SIGMAS)
}

/// Points on each side of the frame: straight sides are curved on the ground by the distortion.
const FOOTPRINT_SIDE: usize = 6;

/// The rim of the frame on the horizontal plane at `height_m`, without the first point again; empty if a part of it sees
/// no ground.
pub(super) fn footprint_m(camera: &Camera, orientation: &ExteriorOrientation, height_m: f64) -> Vec<Vector3<f64>> {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Vector2::from);
    let shares = (0..4).flat_map(|k| {
        let (from, to) = (corners[k], corners[(k + 1) % 4]);
        (0..FOOTPRINT_SIDE).map(move |step| from.lerp(&to, step as f64 / FOOTPRINT_SIDE as f64))
    });
    let on_ground = |share: Vector2<f64>| {
        let reduced_px = camera.reduced_from_pixel(camera.frame_px(share.x, share.y))?;
        orientation.ground_point_m(camera.principal_distance_px, reduced_px, height_m)
    };
    shares.map(on_ground).collect::<Option<Vec<_>>>().unwrap_or_default()
}

/// The rim of a scene's picture on the ground, in pixels of the file; nothing of a building.
fn outline_px(camera: &Camera, orientation: &ExteriorOrientation, control_point: &ControlPoint) -> Vec<Segment2> {
    let Some(scene) = &control_point.scene else { return Vec::new() };
    let [right, down] = [scene.width as f64, scene.height as f64];
    let corners = [[0.0, 0.0], [right, 0.0], [right, down], [0.0, down]].map(|corner| {
        let ground_m = scene.ground_from_pixel_m(corner.into());
        orientation.pixel(camera, control_point.reference_m + ground_m.push(0.0))
    });
    let sides = (0..4).filter_map(|k| Some(Segment2 { start: corners[k]?, end: corners[(k + 1) % 4]? }));
    sides.collect()
}

/// The edges of all control points in view under the adjusted orientation; of a scene the rim of its picture.
pub(super) fn edge_results(search: &Search, adjustment: &Adjustment, observed: &[ObservedSegment]) -> Vec<EdgeResult> {
    let shown = in_view(search, Some(adjustment)).enumerate();
    shown.flat_map(|shown| edges_of(search, adjustment, observed, shown)).collect()
}

/// Those of one control point: its place among the results, and its index.
pub(super) fn edges_of(
    search: &Search,
    adjustment: &Adjustment,
    observed: &[ObservedSegment],
    (place, index): (usize, usize),
) -> Vec<EdgeResult> {
    let control_point = &search.control[index];
    let outline = outline_px(search.camera, &adjustment.orientation, control_point).into_iter();
    let mut results: Vec<EdgeResult> =
        outline.map(|projected_px| EdgeResult { control_point: place, projected_px, matched_px: Vec::new() }).collect();
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
    results
}

fn pieces(building: &Building, kept: &[bool], edge: usize, observed: &[ObservedSegment]) -> Vec<Segment2> {
    kept_matches(building, kept, edge).map(|found| observed[found.segment].file_px).collect()
}

fn kept_matches<'b>(building: &'b Building, kept: &'b [bool], edge: usize) -> impl Iterator<Item = &'b Match> {
    let of_edge = building.matches.iter().zip(kept).filter(move |(found, kept)| found.edge == edge && **kept);
    of_edge.map(|(found, _)| found)
}

fn in_file(camera: &Camera, edge: &Segment2) -> Segment2 {
    let pixel = |p: Vector2<f64>| camera.pixel_from_reduced(p);
    Segment2 { start: pixel(edge.start), end: pixel(edge.end) }
}
