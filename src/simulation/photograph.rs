//! The aerial photograph: rays through every pixel, then the lens and the sensor.

use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::draws::pixel_deviate;
use super::shading::{SKY_GREY, Shading};
use super::sunlight::Sunlight;
use super::town::Town;
use super::visibility::{Eye, Part, SeenTown, Sight, Surface, TILE_PX, Tile};
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};
use crate::geometry::{Camera, ExteriorOrientation};

/// How the photograph is taken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PhotographSettings {
    /// Rays through each pixel. 4, and never the same four places in two pixels: with the blur on top, edges come out
    /// true to some hundredths of a pixel.
    pub rays_per_pixel: u32,
    /// Standard deviation of the blur of lens, motion and demosaicing. 1 px: the real photographs of the benchmark are
    /// as soft or softer.
    pub blur_sigma_px: f64,
    /// Scale of all textures; 0 paints every surface evenly.
    pub texture: f64,
    /// Standard deviation of the sensor's noise at medium grey, grey values. It grows with the root of the light.
    pub noise_grey: f64,
    /// Loss of light in the corners, a share.
    pub vignetting: f64,
    /// What haze leaves of all contrasts, a share; the rest is an even grey. 1: a clear day.
    pub clearness: f64,
}

impl Default for PhotographSettings {
    fn default() -> Self {
        Self { rays_per_pixel: 4, blur_sigma_px: 1.0, texture: 1.0, noise_grey: 2.0, vignetting: 0.12, clearness: 1.0 }
    }
}

/// A grey picture in memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photograph {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Row by row, 0 for black to 255 for white.
    pub grey: Vec<u8>,
}

/// The photograph that a camera takes of a town. `seed` draws the sensor's noise.
#[must_use]
pub fn photograph(
    town: &Town,
    camera: &Camera,
    orientation: &ExteriorOrientation,
    settings: &PhotographSettings,
    seed: u64,
) -> Photograph {
    let frame = PixelRect { x: 0, y: 0, width: camera.width_px, height: camera.height_px };
    photograph_window(town, camera, orientation, settings, seed, frame)
}

/// A part of the photograph: the same grey values as in the whole, for the cost of the part.
#[must_use]
pub fn photograph_window(
    town: &Town,
    camera: &Camera,
    orientation: &ExteriorOrientation,
    settings: &PhotographSettings,
    seed: u64,
    window: PixelRect,
) -> Photograph {
    let kernel = gaussian(settings.blur_sigma_px);
    let area = Area::around(window, margin_px(&kernel));
    let light = Scenery::new(town, camera, orientation, settings).light(area);
    developed(&light, window, &kernel, &Sensor { camera, settings, seed })
}

/// By so much more than a window the light must be known for the window to be blurred.
pub(crate) fn margin_px(kernel: &[f32]) -> i32 {
    kernel.len() as i32 - 1
}

/// What the sensor makes of the light around a window: blur, then grey values.
pub(crate) fn developed(light: &[f32], window: PixelRect, kernel: &[f32], sensor: &Sensor) -> Photograph {
    let area = Area::around(window, margin_px(kernel));
    let margin_px = margin_px(kernel) as usize;
    let soft = blurred(light, area.width, area.height, kernel);
    let width = window.width as usize;
    let mut grey = vec![0; width * window.height as usize];
    grey.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, line)| {
        let from = (row + margin_px) * area.width + margin_px;
        for (column, (cell, &light)) in line.iter_mut().zip(&soft[from..from + width]).enumerate() {
            *cell = sensor.exposed(light, [window.x + column as u32, window.y + row as u32]);
        }
    });
    Photograph { width_px: window.width, height_px: window.height, grey }
}

/// Turns light into grey values.
pub(crate) struct Sensor<'a> {
    pub(crate) camera: &'a Camera,
    pub(crate) settings: &'a PhotographSettings,
    /// Draws the noise.
    pub(crate) seed: u64,
}

/// The grey of haze that hides everything.
const AIRLIGHT_GREY: f32 = 150.0;

impl Sensor<'_> {
    /// The value that is stored for a pixel.
    fn exposed(&self, light: f32, [x, y]: [u32; 2]) -> u8 {
        let Self { camera, settings, seed } = *self;
        let half = [f64::from(camera.width_px) / 2.0, f64::from(camera.height_px) / 2.0];
        let (dx, dy) = (f64::from(x) + 0.5 - half[0], f64::from(y) + 0.5 - half[1]);
        let to_corner = (dx * dx + dy * dy) / (half[0] * half[0] + half[1] * half[1]);
        let through_haze = AIRLIGHT_GREY + settings.clearness as f32 * (light - AIRLIGHT_GREY);
        let dimmed = through_haze * (1.0 - settings.vignetting * to_corner) as f32;
        let sigma = settings.noise_grey as f32 * (0.3 + 0.7 * dimmed.max(0.0) / 128.0).sqrt();
        let noise = sigma * pixel_deviate(x as i32, y as i32, (seed ^ (seed >> 32)) as u32);
        (dimmed + noise).round().clamp(0.0, 255.0) as u8
    }
}

/// A rectangle of pixels that may reach beyond the frame.
#[derive(Clone, Copy)]
pub(crate) struct Area {
    pub(crate) x: i32,
    pub(crate) y: i32,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Area {
    /// A window with a margin around it.
    pub(crate) fn around(window: PixelRect, margin_px: i32) -> Self {
        Self {
            x: window.x as i32 - margin_px,
            y: window.y as i32 - margin_px,
            width: window.width as usize + 2 * margin_px as usize,
            height: window.height as usize + 2 * margin_px as usize,
        }
    }

    /// The rows and columns of the raster of tiles that it touches.
    pub(crate) fn tiles(&self) -> [std::ops::RangeInclusive<i32>; 2] {
        let tile = TILE_PX as i32;
        let range = |from: i32, length: usize| from.div_euclid(tile)..=(from + length as i32 - 1).div_euclid(tile);
        [range(self.y, self.height), range(self.x, self.width)]
    }
}

/// A town before a camera, ready to be looked at.
pub(crate) struct Scenery<'a> {
    town: &'a Town,
    eye: Eye<'a>,
    seen: SeenTown,
    sunlight: Sunlight,
    shading: Shading<'a>,
    rays_per_pixel: u32,
}

impl<'a> Scenery<'a> {
    pub(crate) fn new(
        town: &'a Town,
        camera: &'a Camera,
        orientation: &ExteriorOrientation,
        settings: &PhotographSettings,
    ) -> Self {
        let eye = Eye::new(camera, orientation);
        let seen = SeenTown::new(&town.faces, &town.patches, &town.puffs, &town.terrain, &eye);
        Self {
            town,
            seen,
            sunlight: Sunlight::new(town.to_sun, &town.faces, &town.puffs),
            shading: Shading::new(town, eye.centre_m, settings.texture),
            rays_per_pixel: settings.rays_per_pixel.max(1),
            eye,
        }
    }

    /// The light that falls on every pixel of an area, before the lens blurs it.
    fn light(&self, area: Area) -> Vec<f32> {
        let tile = TILE_PX as i32;
        let [rows, _] = area.tiles();
        let first_row = *rows.start();
        let strips: Vec<Vec<f32>> = rows.into_par_iter().map(|row| self.strip(row, area)).collect();
        let skip = (area.y - first_row * tile) as usize * area.width;
        strips.concat()[skip..skip + area.width * area.height].to_vec()
    }

    /// A row of tiles, cut to the columns of the area.
    fn strip(&self, row: i32, area: Area) -> Vec<f32> {
        let tile_px = TILE_PX as i32;
        let [_, columns] = area.tiles();
        let mut strip = vec![SKY_GREY; area.width * TILE_PX];
        for (column, light) in self.tiles_light(row, columns) {
            let shift = column * tile_px - area.x;
            let (from, to) = (shift.max(0), (shift + tile_px).min(area.width as i32));
            for line in 0..TILE_PX {
                let source = line * TILE_PX + (from - shift) as usize;
                let target = line * area.width + from as usize;
                let count = (to - from) as usize;
                strip[target..target + count].copy_from_slice(&light[source..source + count]);
            }
        }
        strip
    }

    /// The light on tiles of one row, each with its column; those that look into the sky are left out.
    pub(crate) fn tiles_light(&self, row: i32, columns: impl Iterator<Item = i32>) -> Vec<(i32, Vec<f32>)> {
        let tile_px = TILE_PX as i32;
        let tile = |column: i32| {
            let corner_px = [column * tile_px, row * tile_px];
            Tile::new(corner_px, self.rays_per_pixel, &self.eye, &self.town.terrain)
        };
        let tiles: Vec<Tile> = columns.filter_map(tile).collect();
        let part = Part::of_row(&self.seen, &tiles);
        let light = |tile: &Tile| (tile.corner_px[0] / tile_px, self.tile_light(tile, &part));
        tiles.iter().map(light).collect()
    }

    /// What the rays of a tile meet, and whether the sun reaches it.
    fn sight(&self, tile: &Tile, part: &Part<'_>) -> (Sight, Vec<bool>) {
        let sight = Sight::through(tile, part, &self.eye);
        let facing: Vec<_> = sight.point_m.iter().map(|point| self.sunlight.facing(point)).collect();
        let in_sun = self.sunlight.reaches(&facing);
        (sight, in_sun)
    }

    fn tile_light(&self, tile: &Tile, part: &Part<'_>) -> Vec<f32> {
        let (sight, in_sun) = self.sight(tile, part);
        let rays = tile.rays_per_pixel;
        // the ground is so smooth that between the corners of a tile the sun's light on it is linear
        let [a, b, c, d] = tile.ground_corners_m.map(|place| self.shading.sun_on_ground(place));
        let share = |at: usize| (at as f32 + 0.5) / TILE_PX as f32;
        let light = |number: usize| {
            let own = number * rays..(number + 1) * rays;
            let (right, down) = (share(number % TILE_PX), share(number / TILE_PX));
            let (top, bottom) = (a + (b - a) * right, c + (d - c) * right);
            self.pixel_light(
                &sight.surface[own.clone()],
                &in_sun[own.clone()],
                &sight.point_m[own],
                top + (bottom - top) * down,
            )
        };
        (0..TILE_PX * TILE_PX).map(light).collect()
    }

    /// What the rays of the tile at a corner meet, and whether the sun reaches it.
    #[cfg(test)]
    pub(crate) fn look(&self, corner_px: [i32; 2]) -> Option<(Sight, Vec<bool>)> {
        let tile = [Tile::new(corner_px, self.rays_per_pixel, &self.eye, &self.town.terrain)?];
        Some(self.sight(&tile[0], &Part::of_row(&self.seen, &tile)))
    }

    /// The mean over the rays of a pixel; rays that meet the same surface in the same light are shaded together.
    fn pixel_light(&self, surfaces: &[Surface], in_sun: &[bool], points: &[Vector3<f64>], sun_on_ground: f32) -> f32 {
        if let ([surface], [in_sun], [point]) = (surfaces, in_sun, points) {
            return self.shading.grey(*surface, point, *in_sun, sun_on_ground);
        }
        let key = |ray: usize| (surfaces[ray], in_sun[ray]);
        let mut light = 0.0;
        for ray in 0..points.len() {
            if (0..ray).any(|earlier| key(earlier) == key(ray)) {
                continue;
            }
            let alike = (ray..points.len()).filter(|&other| key(other) == key(ray));
            let (sum, count) = alike.fold((Vector3::zeros(), 0.0), |(sum, n), other| (sum + points[other], n + 1.0));
            light += count as f32 * self.shading.grey(surfaces[ray], &(sum / count), in_sun[ray], sun_on_ground);
        }
        light / points.len() as f32
    }
}

/// The middle and one wing of a normal curve that sums to 1, cut where it has fallen below a thousandth.
pub(crate) fn gaussian(sigma_px: f64) -> Vec<f32> {
    if sigma_px.is_nan() || sigma_px <= 0.0 {
        return vec![1.0];
    }
    let reach = (3.5 * sigma_px).ceil() as u32;
    let weight = |i: u32| {
        let t = f64::from(i) / sigma_px;
        libm::exp(-0.5 * t * t)
    };
    let wing: Vec<f64> = (0..=reach).map(weight).collect();
    let sum = 2.0 * wing.iter().sum::<f64>() - wing[0];
    wing.into_iter().map(|weight| (weight / sum) as f32).collect()
}

/// Folds rows and columns with a kernel; nearer to the rim than the kernel reaches, the result is not used.
fn blurred(sharp: &[f32], width: usize, height: usize, wing: &[f32]) -> Vec<f32> {
    let reach = wing.len() - 1;
    let mut across = vec![0.0; sharp.len()];
    across.par_chunks_mut(width).zip(sharp.par_chunks(width)).for_each(|(target, line)| {
        for column in reach..width.saturating_sub(reach) {
            let sides = (1..=reach).map(|i| wing[i] * (line[column - i] + line[column + i]));
            target[column] = wing[0] * line[column] + sides.sum::<f32>();
        }
    });
    let mut both = vec![0.0; sharp.len()];
    both.par_chunks_mut(width).enumerate().for_each(|(row, target)| {
        if row < reach || row + reach >= height {
            return;
        }
        let line = |row: usize| &across[row * width..(row + 1) * width];
        for (cell, &value) in target.iter_mut().zip(line(row)) {
            *cell = wing[0] * value;
        }
        for (i, &weight) in wing.iter().enumerate().skip(1) {
            for ((cell, &above), &below) in target.iter_mut().zip(line(row - i)).zip(line(row + i)) {
                *cell += weight * (above + below);
            }
        }
    });
    both
}

impl Picture for Photograph {
    fn size_px(&self) -> [u32; 2] {
        [self.width_px, self.height_px]
    }

    fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
        let reduction = reduction.max(1);
        let (x, y) = (rect.x.min(self.width_px), rect.y.min(self.height_px));
        let columns = rect.width.min(self.width_px - x);
        let rows = rect.height.min(self.height_px - y);
        let (width, height) = (columns.div_ceil(reduction), rows.div_ceil(reduction));
        let cells = (0..height).flat_map(|row| (0..width).map(move |column| (column * reduction, row * reduction)));
        let mean = |(left, top): (u32, u32)| {
            let (right, bottom) = ((left + reduction).min(columns), (top + reduction).min(rows));
            let line = |row: u32| {
                let from = (y + row) as usize * self.width_px as usize + x as usize;
                &self.grey[from + left as usize..from + right as usize]
            };
            let sum: u32 = (top..bottom).flat_map(|row| line(row).iter().map(|&grey| u32::from(grey))).sum();
            sum as f32 / ((right - left) * (bottom - top)) as f32
        };
        Ok(GreyWindow {
            origin_px: [x, y],
            reduction,
            width: width as usize,
            height: height as usize,
            grey: cells.map(mean).collect(),
        })
    }
}
