//! Against an ortho-photo: squares of one are looked for in the other by normalized cross-correlation.

use nalgebra::Vector2;
use rayon::prelude::*;

use super::{Look, Offset, OrthoError, OrthoPhoto, Shift, check_agreement, evidence, median};
use crate::features::PictureError;

/// Places along the longer side of what both show.
const PLACES: usize = 16;
/// Half a side of a square, in cells of the coarser of the two pixels.
const HALF: i32 = 16;
/// A square that is looked for must have this much contrast, a standard deviation in grey values.
const CONTRAST: f64 = 3.0;
/// What is found must be so much alike.
const ALIKE: f64 = 0.7;
/// So many cells and more from where a square is found, all must be less like it.
const NEAR: usize = 3;
/// By so many times what noise makes of two places that are alike: see [`noise`].
const DISTINCT: f64 = 8.0;
/// Grey values are whole numbers: a difference below this is none.
const LEAST_DISTINCT: f64 = 0.01;

/// Where `new` has what `old` shows, at places all over what both show; displacements up to `search_m` are found.
///
/// # Errors
/// [`OrthoError`] if a picture cannot be read, and if they have too little in common.
pub fn against_ortho_photo(new: OrthoPhoto<'_>, old: OrthoPhoto<'_>, search_m: f64) -> Result<Shift, OrthoError> {
    let cell_m = new.gsd_m().max(old.gsd_m());
    let ([new_least, new_most], [old_least, old_most]) = (new.extent_m(), old.extent_m());
    let (least, most) = (new_least.sup(&old_least), new_most.inf(&old_most));
    let size = most - least;
    if size.min() <= 0.0 {
        return Err(OrthoError::Few { found: 0, tried: 0, search_m });
    }
    let step_m = size.max() / PLACES as f64;
    let along = |length: f64| ((length / step_m) as usize).max(1);
    let (columns, rows) = (along(size.x), along(size.y));
    let places: Vec<Vector2<f64>> = (0..columns * rows)
        .map(|k| least + Vector2::new((k % columns) as f64 + 0.5, (k / columns) as f64 + 0.5) * step_m)
        .collect();
    let looks =
        places.par_iter().map(|at_m| place(new, old, *at_m, cell_m, search_m)).collect::<Result<Vec<_>, _>>()?;
    let (offsets, tried) = evidence(looks, search_m)?;
    let common = Vector2::new(median(offsets.iter().map(|o| o.shift_m.x)), median(offsets.iter().map(|o| o.shift_m.y)));
    check_agreement(offsets.iter().map(|offset| (offset.shift_m - common).norm()), offsets.len(), search_m)?;
    Ok(Shift::of(tried, offsets, common, new.gsd_m()))
}

/// Looks for what is at one place.
fn place(
    new: OrthoPhoto<'_>,
    old: OrthoPhoto<'_>,
    at_m: Vector2<f64>,
    cell_m: f64,
    search_m: f64,
) -> Result<Look<Offset>, PictureError> {
    // more than what counts as near, or nothing could be distinct
    let reach = (search_m / cell_m).ceil().max(NEAR as f64 + 1.0) as i32;
    let radius_m = f64::from(HALF + reach + 1) * cell_m * std::f64::consts::SQRT_2;
    let (Some(sought), Some(searched)) = (old.around(at_m, radius_m)?, new.around(at_m, radius_m)?) else {
        return Ok(Look::Blind);
    };
    let sample = |from: &super::Around, half: i32| -> Option<Vec<f64>> {
        let cell = |k: i32| f64::from(k) * cell_m;
        let places = (-half..=half).flat_map(|row| (-half..=half).map(move |column| (column, row)));
        places.map(|(column, row)| from.grey(at_m + Vector2::new(cell(column), -cell(row)))).collect()
    };
    let (Some(template), Some(field)) = (sample(&sought, HALF), sample(&searched, HALF + reach)) else {
        return Ok(Look::Blind);
    };
    Ok(match best(&template, &field, reach) {
        Look::Found([column, row]) => Look::Found(Offset { at_m, shift_m: Vector2::new(column, -row) * cell_m }),
        Look::Lost => Look::Lost,
        Look::Blind => Look::Blind,
    })
}

/// The displacement, in cells to the right and down, at which the field is most like the template. It is lost where that is
/// not alike enough, or at the rim. Level grey, and what is as much alike elsewhere, as along a kerb, could not be
/// recognized.
fn best(template: &[f64], field: &[f64], reach: i32) -> Look<[f64; 2]> {
    let side = (2 * HALF + 1) as usize;
    let wide = side + 2 * reach as usize;
    let count = template.len() as f64;
    let mean = template.iter().sum::<f64>() / count;
    let centred: Vec<f64> = template.iter().map(|grey| grey - mean).collect();
    let energy: f64 = centred.iter().map(|grey| grey * grey).sum();
    if (energy / count).sqrt() < CONTRAST {
        return Look::Blind;
    }
    let alike = |dx: usize, dy: usize| {
        let (mut product, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for row in 0..side {
            let line = &field[(row + dy) * wide + dx..][..side];
            for (grey, template) in line.iter().zip(&centred[row * side..]) {
                product += grey * template;
                sum += grey;
                squares += grey * grey;
            }
        }
        let variance = squares - sum * sum / count;
        if variance > 0.0 { product / (variance * energy).sqrt() } else { 0.0 }
    };
    let steps = 2 * reach as usize + 1;
    let scores: Vec<f64> = (0..steps * steps).map(|k| alike(k % steps, k / steps)).collect();
    let Some(top) = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b])) else { return Look::Lost };
    let (x, y) = (top % steps, top / steps);
    if scores[top] < ALIKE || x == 0 || y == 0 || x + 1 == steps || y + 1 == steps {
        return Look::Lost;
    }
    let is_elsewhere = |k: &usize| (k % steps).abs_diff(x).max((k / steps).abs_diff(y)) >= NEAR;
    let second = (0..scores.len()).filter(is_elsewhere).map(|k| scores[k]).fold(-1.0, f64::max);
    if scores[top] - second < (DISTINCT * noise(scores[top], count)).max(LEAST_DISTINCT) {
        return Look::Blind;
    }
    let between = |before: f64, at: f64, after: f64| {
        let curvature = before - 2.0 * at + after;
        if curvature < 0.0 { (before - after) / (2.0 * curvature) } else { 0.0 }
    };
    let dx = between(scores[top - 1], scores[top], scores[top + 1]);
    let dy = between(scores[top - steps], scores[top], scores[top + steps]);
    Look::Found([x as f64 + dx - f64::from(reach), y as f64 + dy - f64::from(reach)])
}

/// Standard deviation of the difference between the correlations at two displacements at which the ground is the same and
/// only the noise of the grey values differs, each cell's for itself. With the correlation r = s² / (s² + n²) of a signal
/// s and noise n in both squares it is sqrt(2 (1 - r) / cells).
fn noise(correlation: f64, cells: f64) -> f64 {
    (2.0 * (1.0 - correlation).max(0.0) / cells).sqrt()
}
