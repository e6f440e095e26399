//! How the film lies: which of the layings under which the marks look alike is the true one (method 1.8, plate
//! orientation; Schickler and Poth, section 5).

use nalgebra::Vector2;

use super::consensus::Similarity;
use super::laying::Laying;
use super::plate::Side;
use super::search::Search;
use crate::features::{PictureError, PixelRect};

/// Test values from which the best laying is the true one, and up to which it is not told from the next.
const CERTAIN: f64 = 3.3;
/// The feature itself must be there.
const LEAST_RESEMBLANCE: f64 = 0.45;
/// Cells of the middle level that count as one: neighbours are alike, by the scanner and by the film's grain.
const CELLS_ALIKE: f64 = 9.0;
/// The marks' residuals decide if those of the next laying are so much larger, in units of the variance factor: the
/// probability of a normal deviate is then below 1e-6 of the other's.
const SQUARES_AHEAD: f64 = 28.0;
/// The data strip, beyond the image: from, to, and half of its length, millimetres.
const STRIP_MM: [f64; 3] = [3.5, 12.5, 25.0];
/// In so many pieces.
const STRIP_PIECES: usize = 10;
/// Cells of the strip.
const STRIP_CELL_MM: f64 = 0.15;

/// What decided about the laying.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basis {
    /// The marks are at different places, or look different, in every laying.
    Marks,
    /// The asymmetric feature was found.
    AsymmetricFeature,
    /// The data strip is beside one side only.
    DataStrip,
    /// The calibrated positions fit under one laying only.
    Calibration,
    /// The image shows the control under one laying only.
    Content,
    /// Who asked for it said so.
    Stated,
    /// Nothing: the candidates are left.
    Nothing,
}

impl Basis {
    /// Its name in answers.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Marks => "marks",
            Self::AsymmetricFeature => "asymmetric_feature",
            Self::DataStrip => "data_strip",
            Self::Calibration => "calibration",
            Self::Content => "image_content",
            Self::Stated => "stated",
            Self::Nothing => "nothing",
        }
    }
}

/// A laying that the marks allow, with what speaks for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LayingCandidate {
    /// The laying.
    pub laying: Laying,
    /// Correlation coefficient of the asymmetric feature where this laying has it.
    pub feature: Option<f64>,
    /// Mean gradient of the scan where this laying has the data strip, grey values a cell.
    pub strip: Option<f64>,
    /// Weighted sum of squared residuals of the marks.
    pub squares: f64,
}

/// The decision.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// All that the marks allow, the likeliest first.
    pub candidates: Vec<LayingCandidate>,
    /// How many of them are still possible: 1 if it is decided.
    pub open: usize,
    /// What decided.
    pub basis: Basis,
    /// How sure that is: of the feature and of the strip a standard normal deviate if the best was no better than the
    /// next, of the calibration the root of what its squares are ahead.
    pub test: Option<f64>,
}

/// A laying with the transformation under it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hypothesis {
    pub(super) laying: Laying,
    pub(super) similarity: Similarity,
    pub(super) squares: f64,
}

/// Decides between hypotheses. `sigma0`: of the best of them; `negative`: the film's polarity.
pub(super) fn decide(
    search: &Search,
    hypotheses: &[Hypothesis],
    variance_factor: f64,
    negative: bool,
) -> Result<Decision, PictureError> {
    let plate = search.plate;
    let blank = |h: &Hypothesis| LayingCandidate { laying: h.laying, feature: None, strip: None, squares: h.squares };
    let mut candidates: Vec<LayingCandidate> = hypotheses.iter().map(blank).collect();
    if candidates.len() == 1 {
        return Ok(Decision { candidates, open: 1, basis: Basis::Marks, test: None });
    }
    if let Some(feature) = &plate.asymmetric {
        let mut count = 1.0;
        for (candidate, hypothesis) in candidates.iter_mut().zip(hypotheses) {
            let about_px = hypothesis.similarity.apply(feature.position_mm);
            let reach_mm = (3.0 * feature.sigma_mm).max(0.3);
            let (rho, cells) = search.resemblance(
                &feature.mark,
                feature.rotation_rad,
                about_px,
                &hypothesis.similarity,
                reach_mm,
                negative,
            )?;
            candidate.feature = Some(rho);
            count = cells;
        }
        candidates.sort_by(|a, b| b.feature.unwrap_or(0.0).total_cmp(&a.feature.unwrap_or(0.0)));
        let [best, next] = [candidates[0].feature, candidates[1].feature].map(|rho| rho.unwrap_or(0.0));
        let test = test_of_coefficients(best, next, count / CELLS_ALIKE);
        if best >= LEAST_RESEMBLANCE && test > CERTAIN {
            return Ok(Decision { candidates, open: 1, basis: Basis::AsymmetricFeature, test: Some(test) });
        }
    }
    let mut basis = Basis::Nothing;
    let mut test = None;
    let mut open = candidates.len();
    if let Some(side) = plate.data_strip {
        (open, test) = by_strip(search, &mut candidates, hypotheses, side)?;
        if open < candidates.len() {
            basis = Basis::DataStrip;
        }
    }
    if open > 1 {
        candidates[..open].sort_by(|a, b| a.squares.total_cmp(&b.squares));
        let ahead = (candidates[1].squares - candidates[0].squares) / variance_factor.max(1.0);
        if ahead > SQUARES_AHEAD {
            (open, basis, test) = (1, Basis::Calibration, Some(ahead.sqrt()));
        }
    }
    if open > 1 {
        basis = Basis::Nothing;
    }
    Ok(Decision { candidates, open, basis, test })
}

/// Whether one coefficient is truly larger than another one (method 1.8).
fn test_of_coefficients(best: f64, next: f64, count: f64) -> f64 {
    let variance = |rho: f64| (1.0 - rho * rho).powi(2) / count.max(1.0);
    (best - next) / (variance(best) + variance(next)).sqrt()
}

/// Puts the layings that have the strip on the busiest side of the scan first; how many these are, and how sure that is.
/// (A mirrored laying has the strip on the same side as one that is not.)
fn by_strip(
    search: &Search,
    candidates: &mut [LayingCandidate],
    hypotheses: &[Hypothesis],
    side: Side,
) -> Result<(usize, Option<f64>), PictureError> {
    let lies = |laying: Laying| laying.apply(direction(side)).map(|v| v.round() as i32);
    let mut sides: Vec<(Vector2<i32>, Vec<f64>, f64)> = Vec::new();
    for hypothesis in hypotheses {
        let here = lies(hypothesis.laying);
        if sides.iter().all(|(known, ..)| *known != here) {
            let pieces = strip(search, &hypothesis.similarity, side)?;
            let mean = pieces.iter().sum::<f64>() / pieces.len() as f64;
            sides.push((here, pieces, mean));
        }
    }
    sides.sort_by(|a, b| b.2.total_cmp(&a.2));
    for candidate in candidates.iter_mut() {
        candidate.strip = sides.iter().find(|(here, ..)| *here == lies(candidate.laying)).map(|(_, _, mean)| *mean);
    }
    candidates.sort_by(|a, b| b.strip.unwrap_or(0.0).total_cmp(&a.strip.unwrap_or(0.0)));
    let [best, next, ..] = sides.as_slice() else { return Ok((candidates.len(), None)) };
    let test = test_of_means(&best.1, &next.1);
    let on_best = candidates.iter().filter(|candidate| lies(candidate.laying) == best.0).count();
    Ok((if test > CERTAIN { on_best } else { candidates.len() }, Some(test)))
}

fn direction(side: Side) -> Vector2<f64> {
    match side {
        Side::Left => Vector2::new(-1.0, 0.0),
        Side::Right => Vector2::new(1.0, 0.0),
        Side::Top => Vector2::new(0.0, 1.0),
        Side::Bottom => Vector2::new(0.0, -1.0),
    }
}

/// The difference of the means of two samples of logarithms, in its standard deviations.
fn test_of_means(a: &[f64], b: &[f64]) -> f64 {
    let moments = |values: &[f64]| {
        let logs: Vec<f64> = values.iter().map(|v| (v + 0.5).ln()).collect();
        let count = logs.len() as f64;
        let mean = logs.iter().sum::<f64>() / count;
        (mean, logs.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0) / count)
    };
    if a.len() < 3 || b.len() < 3 {
        return 0.0;
    }
    let ((first, first_variance), (second, second_variance)) = (moments(a), moments(b));
    (first - second) / (first_variance + second_variance + 1e-6).sqrt()
}

/// How busy the pieces of the strip are: their mean gradients. Those that lie beyond the scan are left out.
fn strip(search: &Search, similarity: &Similarity, side: Side) -> Result<Vec<f64>, PictureError> {
    let [from, to, half] = STRIP_MM;
    let out = direction(side);
    let along = Vector2::new(-out.y, out.x);
    let format = Vector2::from(search.plate.format_mm) / 2.0;
    let edge = out.component_mul(&format).abs().sum();
    let reduction = ((STRIP_CELL_MM / search.expectation.pixel_mm).round() as u32).max(1);
    let mut pieces = Vec::new();
    for piece in 0..STRIP_PIECES {
        let step = 2.0 * half / STRIP_PIECES as f64;
        let start = -half + piece as f64 * step;
        let corners = [(from, start), (to, start + step)]
            .map(|(outwards, along_mm)| similarity.apply(out * (edge + outwards) + along * along_mm));
        let [width, height] = search.picture.size_px().map(f64::from);
        let low = corners[0].inf(&corners[1]);
        let high = corners[0].sup(&corners[1]);
        let inside = low.x >= 0.0 && low.y >= 0.0 && high.x <= width && high.y <= height;
        if !inside {
            pieces.push(0.0);
            continue;
        }
        let size = high - low;
        let rect = PixelRect { x: low.x as u32, y: low.y as u32, width: size.x as u32, height: size.y as u32 };
        let window = search.picture.window(rect, reduction)?;
        let rows: Vec<&[f32]> = window.grey.chunks_exact(window.width.max(1)).collect();
        let across = rows.iter().flat_map(|row| row.windows(2).map(|p| (p[1] - p[0]).abs()));
        let down = rows.windows(2).flat_map(|rows| rows[0].iter().zip(rows[1]).map(|(a, b)| (b - a).abs()));
        let (sum, count) = across.chain(down).fold((0.0, 0.0), |(sum, count), d| (sum + f64::from(d), count + 1.0));
        pieces.push(if count > 0.0 { sum / count } else { 0.0 });
    }
    Ok(pieces)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_test_of_two_coefficients_is_that_of_the_method() {
        // T = (0.8 - 0.3) / sqrt((1 - 0.64)² / 100 + (1 - 0.09)² / 100)
        let test = test_of_coefficients(0.8, 0.3, 100.0);
        assert!((test - 0.5 / (0.36_f64.powi(2) / 100.0 + 0.91_f64.powi(2) / 100.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn means_that_differ_by_their_scatter_are_not_told_apart() {
        let quiet = [1.0, 1.2, 0.9, 1.1, 1.0];
        let busy = [9.0, 14.0, 6.0, 11.0, 8.0];
        assert!(test_of_means(&busy, &quiet) > CERTAIN);
        assert!(test_of_means(&[1.1, 1.0, 1.2, 0.9, 1.1], &quiet).abs() < 1.65);
    }
}
