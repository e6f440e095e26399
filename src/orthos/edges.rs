//! Against lines on the ground: where across each of them is the strongest edge of grey values?

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::{Look, Offset, OrthoError, OrthoPhoto, Shift, check_agreement, evidence};
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
/// Lines that are farther from the common shift than this weigh less than a quarter.
const SCALE_PX: f64 = 2.0;
/// The lines' share across their common direction, as the mean square of the sine of the angle to it, is at least this: the
/// shift along it is known seven times worse than across.
const LEAST_ACROSS: f64 = 0.02;
const ITERATIONS: usize = 100;
/// The shift is settled when it changes by less than this.
const SETTLED_PX: f64 = 1e-4;

/// A line that was found.
struct Line {
    at_m: Vector2<f64>,
    /// Its normal.
    normal: Vector2<f64>,
    /// What it is off along that.
    off_m: f64,
}

/// How far the edges that `ortho` shows are off the lines that are known, given by the easting and northing of their ends.
/// An edge tells nothing along itself: the common shift is the one that explains all, robustly.
///
/// # Errors
/// [`OrthoError`] if the picture cannot be read, and if the lines do not tell a common shift.
pub fn against_edges(ortho: OrthoPhoto<'_>, edges_m: &[[Vector2<f64>; 2]], search_m: f64) -> Result<Shift, OrthoError> {
    let looks = edges_m.par_iter().map(|edge| across(ortho, edge, search_m)).collect::<Result<Vec<_>, _>>()?;
    let (lines, tried) = evidence(looks, search_m)?;
    let found = lines.len();
    let common_m = common(&lines, ortho.gsd_m(), search_m).ok_or(OrthoError::OneDirection { found })?;
    check_agreement(lines.iter().map(|line| line.left_m(&common_m)), found, search_m)?;
    let offset = |line: &Line| Offset { at_m: line.at_m, shift_m: line.normal * line.off_m };
    Ok(Shift::of(tried, lines.iter().map(offset).collect(), common_m, ortho.gsd_m()))
}

/// Looks across a line for its edge. Where the ortho-photo does not show all around it, nothing could be recognized.
fn across(ortho: OrthoPhoto<'_>, [start, end]: &[Vector2<f64>; 2], search_m: f64) -> Result<Look<Line>, PictureError> {
    let (gsd_m, length_m) = (ortho.gsd_m(), (end - start).norm());
    if length_m < SHORTEST_PX * gsd_m {
        return Ok(Look::Blind);
    }
    let at_m = (start + end) / 2.0;
    let Some(around) = ortho.around(at_m, length_m / 2.0 + search_m + 2.0 * gsd_m)? else {
        return Ok(Look::Blind);
    };
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
    let Some(profile) = (-reach..=reach).map(mean).collect::<Option<Vec<f64>>>() else {
        return Ok(Look::Blind);
    };
    let wide = FINE as usize;
    let change: Vec<f64> = profile.windows(wide + 1).map(|w| (w[wide] - w[0]).abs()).collect();
    let Some(peak) = peak(&change) else { return Ok(Look::Lost) };
    // the middle of a window is half of it later
    let off_m = (peak + FINE / 2.0 - f64::from(reach)) * step_m;
    Ok(if off_m.abs() <= search_m { Look::Found(Line { at_m, normal, off_m }) } else { Look::Lost })
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

impl Line {
    /// What is left of it when a shift is taken away.
    fn left_m(&self, shift: &Vector2<f64>) -> f64 {
        self.off_m - self.normal.dot(shift)
    }
}

/// The shift that explains most of what is off across the lines: that of the least cost t² / (1 + t²) (Geman and
/// McClure 1985), in which those far from it pull no more. `None` where the lines that agree with it all run alike.
fn common(lines: &[Line], gsd_m: f64, search_m: f64) -> Option<Vector2<f64>> {
    let scale_m = SCALE_PX * gsd_m;
    let t_squared = |line: &Line, shift: &Vector2<f64>| (line.left_m(shift) / scale_m).powi(2);
    let cost = |shift: &Vector2<f64>| -> f64 {
        lines.iter().map(|line| t_squared(line, shift)).map(|t_squared| t_squared / (1.0 + t_squared)).sum()
    };
    // the cost has a valley for each group of lines that agree: the deepest is looked for from pixel to pixel
    let reach = (search_m * std::f64::consts::SQRT_2 / gsd_m).ceil() as i32;
    let starts = (-reach..=reach)
        .into_par_iter()
        .flat_map_iter(|x| (-reach..=reach).map(move |y| Vector2::new(f64::from(x), f64::from(y)) * gsd_m));
    let (_, mut shift) = starts.map(|start| (cost(&start), start)).min_by(|a, b| a.0.total_cmp(&b.0))?;
    // each step lowers the cost
    for _ in 0..ITERATIONS {
        let (mut normal_matrix, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for line in lines {
            let weight = (1.0 + t_squared(line, &shift)).powi(-2);
            normal_matrix += line.normal * line.normal.transpose() * weight;
            right += line.normal * (weight * line.off_m);
        }
        // the trace is the sum of the weights
        if normal_matrix.symmetric_eigenvalues().min() < LEAST_ACROSS * normal_matrix.trace() {
            return None;
        }
        let before = std::mem::replace(&mut shift, normal_matrix.try_inverse()? * right);
        if (shift - before).norm() < SETTLED_PX * gsd_m {
            break;
        }
    }
    Some(shift)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    const GSD_M: f64 = 0.1;
    const SEARCH_M: f64 = 1.5;
    const SIGMA_M: f64 = 0.03;

    /// Lines in any direction that are off by a shift, with the noise of a measurement.
    fn lines(draws: &mut Draws, count: usize, shift: Vector2<f64>, directions: std::ops::Range<f64>) -> Vec<Line> {
        let line = |_| {
            let (sin, cos) = draws.even(directions.start, directions.end).sin_cos();
            let normal = Vector2::new(cos, sin);
            Line { at_m: Vector2::zeros(), normal, off_m: normal.dot(&shift) + SIGMA_M * draws.normal() }
        };
        (0..count).map(line).collect()
    }

    #[test]
    fn most_lines_win_though_the_others_are_nearer_to_no_shift() {
        let mut draws = Draws::new(1);
        let all_round = 0.0..std::f64::consts::PI;
        let (trials, mut squares) = (100, 0.0);
        for _ in 0..trials {
            let angle = draws.even(0.0, std::f64::consts::TAU);
            let true_m = 14.0 * GSD_M * Vector2::new(angle.cos(), angle.sin());
            let mut found = lines(&mut draws, 28, true_m, all_round.clone());
            found.extend(lines(&mut draws, 12, Vector2::zeros(), all_round.clone()));
            squares += (common(&found, GSD_M, SEARCH_M).unwrap() - true_m).norm_squared();
        }
        // least squares with the 28 alone: each component has the variance 2 sigma² / 28
        let expected_m = SIGMA_M * (2.0 * 2.0 / 28.0_f64).sqrt();
        let rms_m = (squares / f64::from(trials)).sqrt();
        assert!(rms_m < 1.5 * expected_m, "{rms_m} m, {expected_m} m expected");
    }

    #[test]
    fn lines_that_run_alike_tell_no_shift_though_a_few_others_disagree() {
        let mut draws = Draws::new(2);
        let shift = Vector2::new(0.5, 0.3);
        assert_eq!(common(&lines(&mut draws, 20, shift, 0.5..0.6), GSD_M, SEARCH_M), None);
        let mut found = lines(&mut draws, 20, shift, 0.5..0.501);
        found.extend(lines(&mut draws, 2, Vector2::new(-1.4, 1.4), 2.2..2.201));
        assert!(common(&found, GSD_M, SEARCH_M).is_some(), "two that agree with each other are lines across");
        assert!(common(&lines(&mut draws, 20, shift, 0.5..1.5), GSD_M, SEARCH_M).is_some());
    }
}
