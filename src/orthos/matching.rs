//! Against an ortho-photo: squares of one are looked for in the other by normalized cross-correlation.

use nalgebra::Vector2;
use rayon::prelude::*;

use super::{Offset, OrthoPhoto, Shift, median};
use crate::features::PictureError;

/// Places along the longer side of what both show.
const PLACES: usize = 16;
/// Half a side of a square, in cells of the coarser of the two pixels.
const HALF: i32 = 16;
/// A square that is looked for must have this much contrast, a standard deviation in grey values.
const CONTRAST: f64 = 3.0;
/// What is found must be so much alike.
const ALIKE: f64 = 0.7;

/// Where `new` has what `old` shows, at places all over what both show; displacements up to `search_m` are found.
///
/// # Errors
/// [`PictureError`] if a picture cannot be read.
pub fn against_ortho_photo(new: OrthoPhoto<'_>, old: OrthoPhoto<'_>, search_m: f64) -> Result<Shift, PictureError> {
    let cell_m = new.gsd_m().max(old.gsd_m());
    let ([new_least, new_most], [old_least, old_most]) = (new.extent_m(), old.extent_m());
    let (least, most) = (new_least.sup(&old_least), new_most.inf(&old_most));
    let size = most - least;
    if size.min() <= 0.0 {
        return Ok(Shift::of(0, Vec::new(), Vector2::zeros(), new.gsd_m()));
    }
    let step_m = size.max() / PLACES as f64;
    let along = |length: f64| ((length / step_m) as usize).max(1);
    let (columns, rows) = (along(size.x), along(size.y));
    let places: Vec<Vector2<f64>> = (0..columns * rows)
        .map(|k| least + Vector2::new((k % columns) as f64 + 0.5, (k / columns) as f64 + 0.5) * step_m)
        .collect();
    let found =
        places.par_iter().map(|at_m| place(new, old, *at_m, cell_m, search_m)).collect::<Result<Vec<_>, _>>()?;
    let offsets: Vec<Offset> = found.into_iter().flatten().collect();
    let common = Vector2::new(median(offsets.iter().map(|o| o.shift_m.x)), median(offsets.iter().map(|o| o.shift_m.y)));
    Ok(Shift::of(places.len(), offsets, common, new.gsd_m()))
}

/// What is off at one place; `None` where nothing there can be found.
fn place(
    new: OrthoPhoto<'_>,
    old: OrthoPhoto<'_>,
    at_m: Vector2<f64>,
    cell_m: f64,
    search_m: f64,
) -> Result<Option<Offset>, PictureError> {
    let reach = (search_m / cell_m).ceil().max(1.0) as i32;
    let radius_m = f64::from(HALF + reach + 1) * cell_m * std::f64::consts::SQRT_2;
    let (Some(sought), Some(searched)) = (old.around(at_m, radius_m)?, new.around(at_m, radius_m)?) else {
        return Ok(None);
    };
    let sample = |from: &super::Around, half: i32| -> Option<Vec<f64>> {
        let cell = |k: i32| f64::from(k) * cell_m;
        let places = (-half..=half).flat_map(|row| (-half..=half).map(move |column| (column, row)));
        places.map(|(column, row)| from.grey(at_m + Vector2::new(cell(column), -cell(row)))).collect()
    };
    let (Some(template), Some(field)) = (sample(&sought, HALF), sample(&searched, HALF + reach)) else {
        return Ok(None);
    };
    let Some([column, row]) = best(&template, &field, reach) else { return Ok(None) };
    Ok(Some(Offset { at_m, shift_m: Vector2::new(column, -row) * cell_m }))
}

/// The displacement, in cells to the right and down, at which the field is most like the template; `None` where that is
/// not alike enough, or at the rim.
fn best(template: &[f64], field: &[f64], reach: i32) -> Option<[f64; 2]> {
    let side = (2 * HALF + 1) as usize;
    let wide = side + 2 * reach as usize;
    let count = template.len() as f64;
    let mean = template.iter().sum::<f64>() / count;
    let centred: Vec<f64> = template.iter().map(|grey| grey - mean).collect();
    let energy: f64 = centred.iter().map(|grey| grey * grey).sum();
    if (energy / count).sqrt() < CONTRAST {
        return None;
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
    let top = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
    let (x, y) = (top % steps, top / steps);
    if scores[top] < ALIKE || x == 0 || y == 0 || x + 1 == steps || y + 1 == steps {
        return None;
    }
    let between = |before: f64, at: f64, after: f64| {
        let curvature = before - 2.0 * at + after;
        if curvature < 0.0 { (before - after) / (2.0 * curvature) } else { 0.0 }
    };
    let dx = between(scores[top - 1], scores[top], scores[top + 1]);
    let dy = between(scores[top - steps], scores[top], scores[top + steps]);
    Some([x as f64 + dx - f64::from(reach), y as f64 + dy - f64::from(reach)])
}
