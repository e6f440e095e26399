//! A scene's picture as the camera would see it: resampled to the resolution of the image and turned like it. Matching
//! that begins so near finds more, and more of it is right (Berveglieri and Tommaselli, section 4).

use nalgebra::{Matrix2, Vector2};

use super::Scene;
use super::resample::bilinear;

/// A picture that was resampled by a linear map about the scene's reference.
#[derive(Debug, Clone)]
pub(super) struct Rendering {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Row by row, 0 to 255.
    pub(super) grey: Vec<f32>,
    /// Where the scene's reference lies in it.
    pub(super) reference: Vector2<f64>,
    scene_by_cell: Matrix2<f64>,
    reference_px: Vector2<f64>,
}

impl Rendering {
    /// The whole picture, `cell_by_scene` cells for each of its pixels; beyond its rim the rim goes on. `None` if the
    /// map cannot be inverted or leaves nothing, or more than `most` cells.
    pub(super) fn whole(scene: &Scene, cell_by_scene: &Matrix2<f64>, most: usize) -> Option<Self> {
        let corners = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[right, down]| {
            let corner = Vector2::new((right * scene.width) as f64, (down * scene.height) as f64);
            cell_by_scene * (corner - scene.reference_px)
        });
        let least = corners.iter().fold(Vector2::repeat(f64::INFINITY), |a, b| a.inf(b));
        let largest = corners.iter().fold(Vector2::repeat(f64::NEG_INFINITY), |a, b| a.sup(b));
        let size = (largest - least).map(f64::ceil);
        let fits = size.min() >= 1.0 && size.product() <= most as f64;
        if !fits {
            return None;
        }
        Self::part(scene, cell_by_scene, -least, [size.x as usize, size.y as usize])
    }

    /// A part of it, the reference being at a given place.
    pub(super) fn part(
        scene: &Scene,
        cell_by_scene: &Matrix2<f64>,
        reference: Vector2<f64>,
        [width, height]: [usize; 2],
    ) -> Option<Self> {
        let scene_by_cell = cell_by_scene.try_inverse()?;
        let scale = cell_by_scene.determinant().abs().sqrt();
        let smooth = smoothed(scene, scale);
        let reference_px = scene.reference_px;
        let mut grey = Vec::with_capacity(width * height);
        let step = scene_by_cell.column(0).into_owned();
        for row in 0..height {
            let first = Vector2::new(0.5, row as f64 + 0.5) - reference;
            let mut at = scene_by_cell * first + reference_px;
            for _ in 0..width {
                grey.push(bilinear(&smooth, [scene.width, scene.height], at) as f32);
                at += step;
            }
        }
        Some(Self { width, height, grey, reference, scene_by_cell, reference_px })
    }

    /// The pixel of the scene at a place of the rendering.
    pub(super) fn scene_px(&self, cell: Vector2<f64>) -> Vector2<f64> {
        self.scene_by_cell * (cell - self.reference) + self.reference_px
    }

    /// A direction of the rendering in pixels of the scene.
    pub(super) fn scene_direction(&self, along: Vector2<f64>) -> Vector2<f64> {
        self.scene_by_cell * along
    }
}

/// A pixel of a camera is about as sharp as a Gaussian of this standard deviation (Lowe 2004, section 3.3).
const SIGMA_OF_A_PIXEL: f64 = 0.5;

/// The scene's picture, so smooth that it can be resampled by `scale` without aliasing.
fn smoothed(scene: &Scene, scale: f64) -> Vec<f32> {
    let sigma = SIGMA_OF_A_PIXEL * (scale.powi(-2) - 1.0).max(0.0).sqrt();
    if sigma < 0.2 {
        return scene.grey.clone();
    }
    let reach = (3.0 * sigma).ceil() as usize;
    let weights: Vec<f64> = (0..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    let weights: Vec<f32> = weights.iter().map(|w| (w / sum) as f32).collect();
    let (width, height) = (scene.width, scene.height);
    let mut across = Vec::with_capacity(scene.grey.len());
    for row in scene.grey.chunks_exact(width) {
        across.extend((0..width).map(|x| {
            let pair = |k: usize| row[x.saturating_sub(k)] + row[(x + k).min(width - 1)];
            weights[0] * row[x] + (1..=reach).map(|k| weights[k] * pair(k)).sum::<f32>()
        }));
    }
    let mut smooth = vec![0.0; across.len()];
    let row = |y: usize| &across[y * width..(y + 1) * width];
    for (y, out) in smooth.chunks_exact_mut(width).enumerate() {
        for (out, value) in out.iter_mut().zip(row(y)) {
            *out = weights[0] * value;
        }
        for (k, weight) in weights.iter().enumerate().skip(1) {
            let (above, below) = (row(y.saturating_sub(k)), row((y + k).min(height - 1)));
            for ((out, a), b) in out.iter_mut().zip(above).zip(below) {
                *out += weight * (a + b);
            }
        }
    }
    smooth
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wave of 12 pixels along x.
    fn scene() -> Scene {
        let wave = |x: f64| 128.0 + 100.0 * (x / 12.0 * std::f64::consts::TAU).sin();
        Scene {
            width: 120,
            height: 90,
            grey: (0..120 * 90).map(|k| wave((k % 120) as f64 + 0.5) as f32).collect(),
            gsd_m: 0.1,
            azimuth_of_image_up_rad: 0.0,
            sigma_azimuth_rad: 0.05,
            reference_px: Vector2::new(60.0, 30.0),
        }
    }

    #[test]
    fn places_of_the_rendering_are_places_of_the_scene() {
        let turn = nalgebra::Rotation2::new(0.6).into_inner() * 0.8;
        let rendering = Rendering::whole(&scene(), &turn, 1 << 20).unwrap();
        assert!((rendering.scene_px(rendering.reference) - scene().reference_px).norm() < 1e-9);
        for (x, y) in [(40.0, 40.0), (55.5, 60.5), (70.25, 45.0)] {
            let at = rendering.scene_px(Vector2::new(x, y));
            if at.min() > 3.0 && at.x < 117.0 && at.y < 87.0 {
                let seen = bilinear(&rendering.grey, [rendering.width, rendering.height], Vector2::new(x, y));
                let expected = bilinear(&scene().grey, [120, 90], at);
                assert!((seen - expected).abs() < 9.0, "{seen} {expected}");
            }
        }
    }

    #[test]
    fn what_cannot_be_resolved_is_smoothed_away() {
        let rendering = Rendering::whole(&scene(), &(Matrix2::identity() * 0.08), 1 << 20).unwrap();
        let spread = rendering.grey.iter().fold(0.0_f32, |most, grey| most.max((grey - 128.0).abs()));
        assert!(spread < 35.0, "{spread}");
        assert!(Rendering::whole(&scene(), &Matrix2::zeros(), 1 << 20).is_none());
        assert!(Rendering::whole(&scene(), &(Matrix2::identity() * 100.0), 1 << 20).is_none());
    }
}
