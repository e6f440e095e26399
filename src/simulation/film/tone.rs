//! From light to grey values: the scanner's response, uneven light and grain.

use super::settings::ScannerSettings;
use super::truth::drawn;
use crate::features::PixelRect;
use crate::simulation::draws::{Draws, Purpose, pixel_deviate};

const STEPS: usize = 1024;

/// How a scanner turns light into grey values.
#[derive(Debug, Clone)]
pub(super) struct Tone {
    black_grey: f32,
    white_grey: f32,
    gamma: f64,
    /// Grey values for light from 0 to 1.
    response: Vec<f32>,
    /// Loss of light where it is darkest.
    loss: f32,
    /// The direction of the loss.
    slope: [f32; 2],
    pub(super) blur_px: f64,
    grain_grey: f32,
    correlated: bool,
    grain_seed: u32,
}

impl Tone {
    pub(super) fn draw(settings: &ScannerSettings, seed: u64) -> Self {
        let mut draws = Draws::new(seed, Purpose::FilmScanner);
        let black_grey = drawn(settings.black_grey, &mut draws) as f32;
        let white_grey = drawn(settings.white_grey, &mut draws) as f32;
        let gamma = drawn(settings.gamma, &mut draws);
        let at = |k: usize| libm::pow(k as f64 / STEPS as f64, gamma) as f32;
        let response = (0..=STEPS + 1).map(|k| black_grey + (white_grey - black_grey) * at(k)).collect();
        let blur_px = drawn(settings.blur_px, &mut draws);
        let slope = crate::simulation::draws::direction(draws.between(0.0, std::f64::consts::TAU));
        let loss = drawn(settings.uneven_light, &mut draws) as f32;
        let grain_grey = drawn(settings.grain_grey, &mut draws) as f32;
        let correlated = draws.chance(settings.correlated_share);
        let grain_seed = draws.below(u32::MAX);
        let slope = [slope.x as f32, slope.y as f32];
        Self { black_grey, white_grey, gamma, response, loss, slope, blur_px, grain_grey, correlated, grain_seed }
    }

    /// The grey value of a light from 0 to 1.
    pub(super) fn grey(&self, light: f32) -> f32 {
        let place = light.clamp(0.0, 1.0) * STEPS as f32;
        let index = place as usize;
        match self.response.get(index..index + 2) {
            Some(&[below, above]) => below + (place - index as f32) * (above - below),
            _ => self.white_grey,
        }
    }

    /// The share of the light that is left at a place: -1 to 1 from rim to rim along both axes.
    pub(super) fn light(&self, x: f32, y: f32) -> f32 {
        let across = 0.5 + 0.35 * (self.slope[0] * x + self.slope[1] * y);
        1.0 - self.loss * (0.6 * across + 0.2 * (x * x + y * y))
    }

    /// What in a positive is brighter than `dark` by so many grey values of the scan, as far as there is brighter.
    pub(super) fn above(&self, dark: f32, contrast_grey: f32, negative: bool) -> f32 {
        let seen = |positive: f32| if negative { 1.0 - positive } else { positive };
        let sign = if negative { -1.0 } else { 1.0 };
        let grey = self.grey(seen(dark)) + sign * contrast_grey;
        let share = ((grey - self.black_grey) / (self.white_grey - self.black_grey)).clamp(0.0, 1.0);
        seen(libm::pow(f64::from(share), 1.0 / self.gamma) as f32)
    }

    /// Adds the grain to the pixels of a rectangle.
    pub(super) fn add_grain(&self, rect: PixelRect, grey: &mut [f32]) {
        if self.grain_grey <= 0.0 {
            return;
        }
        let at = |x: u32, y: u32| pixel_deviate(x as i32, y as i32, self.grain_seed);
        let row_of = |y: u32| -> Vec<f32> { (rect.x..=rect.x + rect.width).map(|x| at(x, y)).collect() };
        let mut above = row_of(rect.y);
        for (y, row) in (rect.y + 1..).zip(grey.chunks_mut(rect.width as usize)) {
            let below = row_of(y);
            if self.correlated {
                // the mean of four neighbours has half the standard deviation
                let sums = above.windows(2).zip(below.windows(2)).map(|(a, b)| (a[0] + a[1]) + (b[0] + b[1]));
                row.iter_mut().zip(sums).for_each(|(grey, sum)| *grey += 0.5 * self.grain_grey * sum);
            } else {
                row.iter_mut().zip(&above).for_each(|(grey, deviate)| *grey += self.grain_grey * deviate);
            }
            above = below;
        }
    }

    /// The grain of a cell of `reduction` pixels a side from the pixel (x, y) on.
    pub(super) fn cell_grain(&self, [x, y]: [u32; 2], reduction: u32) -> f32 {
        let together = if self.correlated { 2.0 } else { 1.0 };
        let deviate = pixel_deviate(x as i32, y as i32, self.grain_seed ^ reduction);
        self.grain_grey * together / reduction as f32 * deviate
    }
}
