//! Points that are recognised again in other pictures of the same: SIFT (D. G. Lowe, Distinctive image features from
//! scale-invariant keypoints, IJCV 60(2), 2004), each with the covariance of its position.
//!
//! All of it runs in the caller's thread: there are many windows, and they are searched in parallel.

mod blur;
mod descriptor;
mod extrema;
mod gradient;
mod matching;
mod noise;
mod orientation;
mod scale_space;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix2, Vector2, Vector3};

pub use self::descriptor::Descriptor;
use self::extrema::{Extremum, Limits, RIM, extrema};
use self::gradient::Level;
pub use self::matching::{Match, ratio_matches, squared_distance};
use self::noise::{Blurred, covariance, noise};
use self::scale_space::{INTERVALS, Octave, sigma_at};

/// Which extrema of the scale space become key points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The first octave is made at twice the size (Lowe 2004, section 3.3): some four times as many key points, and
    /// four times the work.
    pub upsampled: bool,
    /// Least contrast, as OpenCV counts it: |D| of grey values from 0 to 1 must reach a third of it (one part for each
    /// interval of an octave). Lowe's 0.03 would be 0.09 here; but 0.04 is what is usual.
    pub contrast: f32,
    /// Largest ratio of the principal curvatures of D (Lowe's r).
    pub edge_ratio: f32,
    /// Only so many, the strongest by response.
    pub most: Option<usize>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { upsampled: true, contrast: 0.04, edge_ratio: 10.0, most: None }
    }
}

/// A point with a scale and a direction, and what its surroundings look like in that frame.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyPoint {
    /// Where, in cells of the window; (0, 0) is the corner of the top-left cell.
    pub at_px: Vector2<f64>,
    /// Standard deviation of the Gaussian of the level at which it was found, in cells of the window.
    pub scale_px: f64,
    /// The dominant direction of the gradients around it, from +x towards +y, 0 to 2π.
    pub orientation_rad: f64,
    /// |D| at the extremum, for grey values from 0 to 1.
    pub response: f64,
    /// Covariance of the position from the noise of the window's grey values, px².
    pub covariance: Matrix2<f64>,
    /// Its surroundings.
    pub descriptor: Descriptor,
}

const WHITE: f64 = 255.0;

/// The key points of a window of grey values from 0 to 255, row by row; from the finest octave to the coarsest, or by
/// falling response if only some are asked for. None if there are fewer values than cells.
#[must_use]
pub fn key_points(grey: &[f32], width: usize, height: usize, settings: &Settings) -> Vec<KeyPoint> {
    let mut found = Vec::new();
    if width.min(height) <= RIM || grey.len() < width * height {
        return found;
    }
    let noise = noise(grey, width, height);
    let contrast = (f64::from(settings.contrast) * WHITE / INTERVALS as f64) as f32;
    let limits = Limits { contrast, edge_ratio: settings.edge_ratio };
    let mut octave = Octave::first(grey, width, height, settings.upsampled);
    while octave.width.min(octave.height) > 2 * RIM {
        let extrema = strongest(extrema(&octave, &limits), settings.most);
        let blurred = Blurred::new(noise, octave.cell_px, settings.upsampled);
        let of_gradients: [Vector3<f64>; INTERVALS] = std::array::from_fn(|k| blurred.of_gradient(k + 1));
        for extremum in &extrema {
            described(&octave, extremum, &of_gradients, &mut found);
        }
        octave.halve();
    }
    if let Some(most) = settings.most {
        // stable: ties stay in their order
        found.sort_by(|a, b| b.response.total_cmp(&a.response));
        found.truncate(most);
    }
    found
}

/// Those that may be among the strongest of all, if only so many are wanted.
fn strongest(mut extrema: Vec<Extremum>, most: Option<usize>) -> Vec<Extremum> {
    if let Some(most) = most {
        extrema.sort_by(|a, b| b.contrast.total_cmp(&a.contrast));
        extrema.truncate(most);
    }
    extrema
}

/// Adds a key point for each of the dominant directions at an extremum.
fn described(
    octave: &Octave,
    extremum: &Extremum,
    of_gradients: &[Vector3<f64>; INTERVALS],
    found: &mut Vec<KeyPoint>,
) {
    let [level, ..] = extremum.cell;
    let Some(covariance) = covariance(&extremum.hessian, &of_gradients[level - 1]) else { return };
    let (x, y, scale) = (extremum.at.x, extremum.at.y, sigma_at(extremum.at.z));
    let cells = Level::of(octave, level);
    for orientation_rad in orientation::orientations(cells, x, y, scale) {
        found.push(KeyPoint {
            // the middle of the first cell is that of the picture's first
            at_px: Vector2::new(x, y) * octave.cell_px + Vector2::repeat(0.5),
            scale_px: scale * octave.cell_px,
            orientation_rad,
            response: extremum.contrast / WHITE,
            covariance: covariance * octave.cell_px.powi(2),
            descriptor: descriptor::descriptor(cells, x, y, scale, orientation_rad),
        });
    }
}
