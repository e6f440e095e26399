//! Against lines on the ground: where across each of them is the strongest edge of grey values?

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::{Offset, OrthoPhoto, Shift};
use crate::features::PictureError;

/// Samples of a profile in a pixel.
const FINE: f64 = 4.0;
/// An edge is found where the grey values change so many times as much as they do in the median across it.
const STRONG: f64 = 4.0;
/// The least change, in grey values for each pixel.
const LEAST_CHANGE: f64 = 1.5;
/// The centroid of the change is taken so many samples to both sides of its top.
const NEAR: usize = 12;
/// Edges shorter than this many pixels are left out.
const SHORTEST_PX: f64 = 12.0;
const ITERATIONS: usize = 10;

/// How far the edges that `ortho` shows are off the lines that are known, given by the easting and northing of their ends.
/// An edge tells nothing along itself: the common shift is the one that explains all, robustly.
///
/// # Errors
/// [`PictureError`] if the picture cannot be read.
pub fn against_edges(
    ortho: OrthoPhoto<'_>,
    edges_m: &[[Vector2<f64>; 2]],
    search_m: f64,
) -> Result<Shift, PictureError> {
    let found = edges_m.par_iter().map(|edge| across(ortho, edge, search_m)).collect::<Result<Vec<_>, _>>()?;
    let found: Vec<(Vector2<f64>, Offset)> = found.into_iter().flatten().collect();
    let common_m = common(&found, ortho.gsd_m());
    let offsets = found.into_iter().map(|(_, offset)| offset).collect();
    Ok(Shift::of(edges_m.len(), offsets, common_m, ortho.gsd_m()))
}

/// The normal of a line and what is off along it; `None` where no edge stands out.
fn across(
    ortho: OrthoPhoto<'_>,
    [start, end]: &[Vector2<f64>; 2],
    search_m: f64,
) -> Result<Option<(Vector2<f64>, Offset)>, PictureError> {
    let (gsd_m, length_m) = (ortho.gsd_m(), (end - start).norm());
    if length_m < SHORTEST_PX * gsd_m {
        return Ok(None);
    }
    let at_m = (start + end) / 2.0;
    let Some(around) = ortho.around(at_m, length_m / 2.0 + search_m + 2.0 * gsd_m)? else { return Ok(None) };
    let along = (end - start) / length_m;
    let normal = Vector2::new(-along.y, along.x);
    // the ends are left out: there other edges meet
    let (steps, reach) = ((0.8 * length_m / gsd_m) as i32, (search_m / gsd_m * FINE).ceil() as i32 + 2);
    let step_m = gsd_m / FINE;
    let mean = |offset: i32| -> Option<f64> {
        let line = (0..=steps).map(|k| start + along * (0.1 * length_m + f64::from(k) * gsd_m));
        let values: Vec<f64> =
            line.filter_map(|point| around.grey(point + normal * (f64::from(offset) * step_m))).collect();
        (values.len() as i32 > steps / 2).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    let Some(profile) = (-reach..=reach).map(mean).collect::<Option<Vec<f64>>>() else { return Ok(None) };
    let wide = FINE as usize;
    let change: Vec<f64> = profile.windows(wide + 1).map(|w| (w[wide] - w[0]).abs()).collect();
    let Some(peak) = peak(&change) else { return Ok(None) };
    // the middle of a window is half of it later
    let offset = peak + FINE / 2.0 - f64::from(reach);
    let shift_m = normal * (offset * step_m);
    Ok((offset.abs() * step_m <= search_m).then_some((normal, Offset { at_m, shift_m })))
}

/// The place of the greatest change, between samples; `None` if it does not stand out, or lies at the rim.
fn peak(change: &[f64]) -> Option<f64> {
    let top = (0..change.len()).max_by(|a, b| change[*a].total_cmp(&change[*b]))?;
    let median = super::median(change.iter().copied());
    if top == 0 || top + 1 == change.len() || change[top] < LEAST_CHANGE.max(STRONG * median) {
        return None;
    }
    // between pixels the grey values are linear and the change has steps: its centroid knows better than its top
    let near = top.saturating_sub(NEAR)..(top + NEAR + 1).min(change.len());
    let above = |k: usize| (change[k] - median).max(0.0);
    let weight: f64 = near.clone().map(above).sum();
    Some(near.map(|k| k as f64 * above(k)).sum::<f64>() / weight)
}

/// The shift that explains most of what is off across the lines; those far from it weigh less and less.
fn common(found: &[(Vector2<f64>, Offset)], gsd_m: f64) -> Vector2<f64> {
    let mut shift = Vector2::zeros();
    for _ in 0..ITERATIONS {
        let (mut normal_matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for (normal, offset) in found {
            let value = normal.dot(&offset.shift_m);
            let weight = 1.0 / (1.0 + ((value - normal.dot(&shift)) / (2.0 * gsd_m)).powi(2));
            normal_matrix += normal * normal.transpose() * weight;
            right += normal * (weight * value);
        }
        match normal_matrix.try_inverse() {
            Some(inverse) => shift = inverse * right,
            None => return Vector2::zeros(),
        }
    }
    shift
}
