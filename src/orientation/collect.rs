//! Collecting the line segments of every control point anew under an orientation, and adjusting with them, until the
//! two agree: the step from located points to adjusted lines (Förstner and Läbe, end of step 2 and step 3).

use nalgebra::Vector2;

use super::adjust::{Adjustment, Building, Model, sigma_control_px};
use super::by_hand::SeenScene;
use super::extract::Extraction;
use super::gate::{Round, Scale};
use super::matching::{Match, Nearness, matches};
use super::parallels::resolved;
use super::predict::{Prediction, edges_on_frame_px};
use super::search::{Search, reach};
use crate::features::PictureError;
use crate::geometry::Segment2;
use crate::scenes::Measured;

/// A round of collecting: how the buildings are located, and what their edges then accept.
#[derive(Debug, Clone, Copy)]
pub(super) struct Collection {
    pub(super) round: Round,
    pub(super) nearness: Nearness,
}

/// The windows close as the orientation becomes certain; the last round is repeated until nothing changes.
pub(super) const COLLECTIONS: [Collection; 3] = [
    collection(3.0, 4.0, 0.07, 5.0, 0.06),
    collection(2.0, 3.0, 0.06, 4.0, 0.05),
    collection(2.0, 2.0, 0.05, 3.0, 0.05),
];
const MOST_ROUNDS: usize = 10;
/// A round that moves the orientation by less than this part of its standard deviations changes nothing.
const SETTLED: f64 = 0.02;

const fn collection(cell_px: f64, sigma_px: f64, shift_rad: f64, distance_px: f64, edge_rad: f64) -> Collection {
    Collection {
        round: Round { scale: Scale { cell_px, sigma_px }, direction_tolerance_rad: shift_rad },
        nearness: Nearness { distance_px, direction_tolerance_rad: edge_rad },
    }
}

/// The adjustment with all line segments that belong to the control points under a prediction and those that follow
/// from it; `None` if too little is found to determine an orientation.
///
/// # Errors
/// [`PictureError`] if the picture cannot be read where control points are expected.
pub fn adjust_with_lines(
    search: &Search,
    start: &Prediction,
    extraction: &mut Extraction,
) -> Result<Option<Adjustment>, PictureError> {
    let Some(prior) = search.approximation.prior(&start.orientation) else { return Ok(None) };
    let mut prediction = start.clone();
    let mut adjustment = None;
    for round in 0..MOST_ROUNDS {
        let collection = COLLECTIONS[round.min(COLLECTIONS.len() - 1)];
        let buildings = collect(search, &prediction, extraction, collection)?;
        let model =
            Model { camera: search.camera, control: search.control, observed: extraction.segments(), prior: &prior };
        let Some(adjusted) = model.adjust(buildings, &prediction.orientation) else { return Ok(None) };
        let step = prediction.orientation.step_to(&adjusted.orientation);
        let settled = adjusted.covariance.try_inverse().is_some_and(|w| step.dot(&(w * step)) < SETTLED * SETTLED);
        prediction = adjusted.prediction();
        adjustment = Some(adjusted);
        if settled && round >= COLLECTIONS.len() {
            break;
        }
    }
    Ok(adjustment)
}

/// The logarithm of the odds that a prediction is right: what all control points say that are found exactly where it
/// has them.
///
/// # Errors
/// [`PictureError`] if the picture cannot be read where control points are expected.
pub fn log_odds(search: &Search, prediction: &Prediction, extraction: &mut Extraction) -> Result<f64, PictureError> {
    let located = search.locate_where_predicted(prediction, extraction, COLLECTIONS[2].round)?;
    Ok(located.iter().map(|l| l.log_odds).sum())
}

/// The scenes that an adjustment rests on, as they were found: with them the same image need not be searched for scenes
/// again.
///
/// # Errors
/// [`PictureError`] if the picture cannot be read where control points are expected.
pub fn seen_scenes(
    search: &Search,
    adjustment: &Adjustment,
    extraction: &mut Extraction,
) -> Result<Vec<SeenScene>, PictureError> {
    if !search.has_scenes() {
        return Ok(Vec::new());
    }
    let located = search.locate_where_predicted(&adjustment.prediction(), extraction, COLLECTIONS[2].round)?;
    let seen = adjustment.buildings.iter().filter_map(|building| {
        let control_point = building.control_point;
        let located = located.iter().find(|located| located.control_point == control_point).copied();
        building.measured.map(|measured| SeenScene { control_point, measured, located })
    });
    Ok(seen.collect())
}

/// The buildings that are found where they are predicted, each with the pieces of its edges, and the scenes, each
/// measured. Those that somebody has seen are where he has seen them.
fn collect(
    search: &Search,
    prediction: &Prediction,
    extraction: &mut Extraction,
    collection: Collection,
) -> Result<Vec<Building>, PictureError> {
    let mut located = search.locate_where_predicted(prediction, extraction, collection.round)?;
    located.retain(|found| search.placed(found.control_point).is_none());
    let unseen = search.measured_where_predicted(prediction, &located, extraction)?;
    let unseen = unseen.into_iter().filter(|(k, _)| search.placed(*k).is_none());
    let mut buildings: Vec<Building> = unseen.map(|(k, measured)| of_point(k, measured)).collect();
    for found in located {
        let at = &prediction.orientation;
        if let Some(measured) = search.measured(found.control_point, found.at_px, at, extraction)? {
            buildings.push(of_point(found.control_point, measured));
            continue;
        }
        let matches = pieces(search, prediction, extraction, collection, (found.control_point, found.at_px));
        if !matches.is_empty() {
            buildings.push(building(found.control_point, matches, None));
        }
    }
    for (control_point, at_px) in &search.by_hand.places {
        search.cover_place(*control_point, *at_px, prediction, extraction)?;
        let matches = pieces(search, prediction, extraction, collection, (*control_point, *at_px));
        buildings.push(building(*control_point, matches, search.placed(*control_point)));
    }
    Ok(buildings)
}

fn building(control_point: usize, matches: Vec<Match>, measured: Option<Measured>) -> Building {
    Building { control_point, matches, measured, shift_px: Vector2::zeros() }
}

fn of_point(control_point: usize, measured: Measured) -> Building {
    building(control_point, Vec::new(), Some(measured))
}

/// The line segments that lie on the edges of a control point whose reference is at a place.
pub(super) fn pieces(
    search: &Search,
    prediction: &Prediction,
    extraction: &Extraction,
    collection: Collection,
    (index, at_px): (usize, Vector2<f64>),
) -> Vec<Match> {
    let control_point = &search.control[index];
    let c = search.camera.principal_distance_px;
    let Some(predicted) = prediction.orientation.reduced_px(c, control_point.reference_m) else { return Vec::new() };
    let shift = at_px - predicted;
    let shifted = |e: Segment2| Segment2 { start: e.start + shift, end: e.end + shift };
    let edges = edges_on_frame_px(search.camera, &prediction.orientation, control_point);
    let edges: Vec<Option<Segment2>> = edges.into_iter().map(|edge| edge.map(shifted)).collect();
    let reach_px = reach(edges.iter().flatten(), at_px) + collection.nearness.distance_px;
    let near = matches(&edges, extraction.near(at_px, reach_px), &collection.nearness);
    let sigma_control_px = sigma_control_px(search.camera, control_point, &prediction.orientation);
    resolved(&edges, extraction.segments(), near, sigma_control_px)
}
