//! What an image shows of buildings that its orientation was not found by: how far they lie from where it has them.

use nalgebra::{Matrix2, Vector2};

use super::adjust::sigma_in_image_px;
use super::collect::{COLLECTIONS, pieces};
use super::extract::Extraction;
use super::matching::Match;
use super::predict::{Prediction, edges_on_frame_px};
use super::search::Search;
use crate::features::PictureError;
use crate::geometry::Segment2;

/// A building that was looked for where an orientation has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Checked {
    /// Index of the control point.
    pub control_point: usize,
    /// How far its lines lie from there, reduced pixels: the shift that all its edges have in common, by least squares and
    /// without any prior. Where all are parallel it is across them.
    pub shift_px: Vector2<f64>,
    /// Its edges that have a line segment in the image.
    pub edges_matched: usize,
}

/// Of an edge beside its stated accuracy: the gutter, not the rim (as in the adjustment).
const WHOLE_EDGE_PX: f64 = 0.67;
/// Of two directions of lines that differ so little that the shift along them would be mostly noise: the ratio of what
/// they say of it to what they say of the shift across.
const PARALLEL: f64 = 0.02;
/// Steps of the weights: a line that was matched wrongly must not decide.
const STEPS: usize = 5;
/// Beyond so many standard deviations a line counts less.
const SOUND_SIGMAS: f64 = 2.0;

/// Looks for the control points of `search` where a prediction has them, as the adjustment does for its own; those that
/// are not found are left out.
///
/// # Errors
/// [`PictureError`] if the picture cannot be read there.
pub fn checked(
    search: &Search,
    prediction: &Prediction,
    extraction: &mut Extraction,
) -> Result<Vec<Checked>, PictureError> {
    let [.., last] = COLLECTIONS;
    let located = search.locate_where_predicted(prediction, extraction, last.round)?;
    let of_point = |control_point: usize, at_px: Vector2<f64>| {
        let matches = pieces(search, prediction, extraction, last, (control_point, at_px));
        let shift_px = shift_px(search, prediction, extraction, control_point, &matches)?;
        let mut edges: Vec<usize> = matches.iter().map(|found| found.edge).collect();
        edges.sort_unstable();
        edges.dedup();
        Some(Checked { control_point, shift_px, edges_matched: edges.len() })
    };
    Ok(located.iter().filter_map(|found| of_point(found.control_point, found.at_px)).collect())
}

/// What a line says of the shift.
struct Line {
    normal: Vector2<f64>,
    /// Distances of its ends from the projected edge.
    off_px: [f64; 2],
    sigma_px: f64,
    length_px: f64,
}

fn shift_px(
    search: &Search,
    prediction: &Prediction,
    extraction: &Extraction,
    index: usize,
    matches: &[Match],
) -> Option<Vector2<f64>> {
    let (at, control_point) = (&prediction.orientation, &search.control[index]);
    let edges = edges_on_frame_px(search.camera, at, control_point);
    let line = |found: &Match| {
        let edge: &Segment2 = edges[found.edge].as_ref()?;
        let segment = &extraction.segments()[found.segment];
        let normal = edge.normal();
        let off_px = [segment.segment_px.start, segment.segment_px.end].map(|end| normal.dot(&(end - edge.start)));
        let stated_px = sigma_in_image_px(search.camera, control_point, at, control_point.edge_sigma_m(found.edge));
        let sigma_px = WHOLE_EDGE_PX.hypot(stated_px);
        Some(Line { normal, off_px, sigma_px, length_px: segment.length_px })
    };
    let lines: Vec<Line> = matches.iter().filter_map(line).collect();
    let mut shift_px = Vector2::zeros();
    for _ in 0..STEPS {
        let (mut normals, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for line in &lines {
            for off_px in line.off_px {
                let sigmas = (off_px - line.normal.dot(&shift_px)).abs() / line.sigma_px;
                let weight = line.length_px / line.sigma_px.powi(2) * (SOUND_SIGMAS / sigmas).min(1.0);
                normals += line.normal * line.normal.transpose() * weight;
                right += line.normal * (off_px * weight);
            }
        }
        let decomposed = normals.svd(true, true);
        let largest = decomposed.singular_values.max();
        shift_px = decomposed.solve(&right, PARALLEL * largest).ok().filter(|_| largest > 0.0)?;
    }
    Some(shift_px)
}
