//! Key points of scenes and of the aerial image, in frames in which they can be compared: those of a scene by their
//! places on the ground, those of the image in reduced pixels.

use std::collections::HashSet;
use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::rendering::Rendering;
use super::{Scene, View};
use crate::features::sift::{Descriptor, KeyPoint, Settings, key_points};
use crate::features::{Picture, PictureError, PixelRect, Tiling};
use crate::geometry::Camera;

/// A key point of a scene.
#[derive(Debug, Clone)]
pub struct SceneKey {
    /// Its place, metres east and north of the reference.
    pub ground_m: Vector2<f64>,
    /// Its orientation, as long as its scale, in the same frame.
    pub along_m: Vector2<f64>,
    /// What it looks like.
    pub descriptor: Descriptor,
}

/// Cells of a rendered scene, at most.
const MOST_CELLS: usize = 4_000_000;
/// Key points of a scene, at most: the strongest.
const MOST_KEYS: usize = 400;
/// What lies nearer to the rim of a scene, in scales of the key point, has seen beyond it.
const RIM_SCALES: f64 = 3.0;

/// The key points of a scene, seen at the resolution of an image that is reduced by `reduction` and as its approximate
/// orientation turns it. None where the camera does not see the reference.
#[must_use]
pub fn scene_keys(scene: &Scene, view: &View, reduction: u32) -> Vec<SceneKey> {
    let cell_by_scene = view.file_by_scene(scene).map(|file_by_scene| file_by_scene / f64::from(reduction));
    let rendering = cell_by_scene.and_then(|cell_by_scene| Rendering::whole(scene, &cell_by_scene, MOST_CELLS));
    let Some(rendering) = rendering else { return Vec::new() };
    let settings = Settings { most: Some(2 * MOST_KEYS), ..settings() };
    let found = key_points(&rendering.grey, rendering.width, rendering.height, &settings);
    let key = |point: KeyPoint| {
        let (sin, cos) = point.orientation_rad.sin_cos();
        let along_px = rendering.scene_direction(Vector2::new(cos, sin) * point.scale_px);
        let at_px = rendering.scene_px(point.at_px);
        let rim = RIM_SCALES * along_px.norm();
        let inside = |v: f64, size: usize| v >= rim && v <= size as f64 - rim;
        (inside(at_px.x, scene.width) && inside(at_px.y, scene.height)).then(|| SceneKey {
            ground_m: scene.ground_from_pixel_m(at_px),
            along_m: scene.ground_by_pixel_m() * along_px,
            descriptor: point.descriptor,
        })
    };
    let mut keys: Vec<SceneKey> = found.into_iter().filter_map(key).collect();
    keys.truncate(MOST_KEYS);
    keys
}

/// Aerial photographs are soft, and grass has little contrast: less of it than Lowe asks for is enough, and nothing is
/// found by doubling the resolution.
fn settings() -> Settings {
    Settings { upsampled: false, contrast: 0.01, ..Settings::default() }
}

/// A key point of the image, without its descriptor.
#[derive(Debug, Clone, Copy)]
pub struct ImageKey {
    /// Its place, reduced pixels.
    pub at_px: Vector2<f64>,
    /// Its orientation, as long as its scale, reduced pixels.
    pub along_px: Vector2<f64>,
}

/// Key points of a tile, at most: the strongest.
const MOST_OF_A_TILE: usize = 1500;
/// Cells along a side of a tile.
const TILE_CELLS: u32 = 768;
/// Cells around a tile that are looked at with it: key points near its rim are described by what lies beyond.
const AROUND_CELLS: u32 = 64;
/// Side of a cell of the raster of places, in cells of the picture.
const RASTER_CELLS: f64 = 48.0;
/// Sectors of the circle by which key points are kept apart.
const SECTORS: usize = 16;

/// The key points of one image, growing with the regions that are asked for.
pub struct ImageKeys<'a> {
    picture: &'a dyn Picture,
    camera: &'a Camera,
    reduction: u32,
    done: HashSet<[u32; 2]>,
    /// By sectors of orientation, rows and columns of the raster.
    keys: Vec<ImageKey>,
    /// In the same order.
    descriptors: Vec<Descriptor>,
    /// Where the key points of each sector and cell begin, and where the last ones end.
    starts: Vec<u32>,
}

impl<'a> ImageKeys<'a> {
    /// Nothing is looked at yet; when it is, at a resolution reduced by `reduction`.
    #[must_use]
    pub fn new(picture: &'a dyn Picture, camera: &'a Camera, reduction: u32) -> Self {
        let (done, keys, descriptors, starts) = (HashSet::new(), Vec::new(), Vec::new(), Vec::new());
        Self { picture, camera, reduction: reduction.max(1), done, keys, descriptors, starts }
    }

    /// Pixels of the file along a side of a cell.
    #[must_use]
    pub fn reduction(&self) -> u32 {
        self.reduction
    }

    /// Pixels of the file that were looked at.
    #[must_use]
    pub fn pixels_read(&self) -> u64 {
        self.tiling().pixels(&self.done)
    }

    fn tiling(&self) -> Tiling {
        Tiling { size_px: self.picture.size_px(), side_px: TILE_CELLS * self.reduction }
    }

    /// Finds the key points of all tiles that touch rectangles, least and largest x and y in pixels of the file, with all
    /// cores; their order does not depend on the number of cores.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read there.
    pub fn cover(&mut self, rectangles_px: &[[Vector2<f64>; 2]]) -> Result<(), PictureError> {
        let mut missing = Vec::new();
        for rectangle in rectangles_px {
            for tile in self.tiling().touching(*rectangle) {
                if self.done.insert(tile) {
                    missing.push(tile);
                }
            }
        }
        if missing.is_empty() {
            return Ok(());
        }
        let found: Vec<_> = missing.par_iter().map(|tile| self.of_tile(*tile)).collect();
        let mut all: Vec<(ImageKey, Descriptor)> = self.keys.drain(..).zip(self.descriptors.drain(..)).collect();
        for of_tile in found {
            all.extend(of_tile?);
        }
        self.sort(all);
        Ok(())
    }

    fn sort(&mut self, mut all: Vec<(ImageKey, Descriptor)>) {
        all.sort_by_cached_key(|(key, _)| self.slot_of(key));
        let mut counts = vec![0_u32; SECTORS * self.raster_side().pow(2) + 1];
        for (key, _) in &all {
            counts[self.slot_of(key) + 1] += 1;
        }
        let mut sum = 0;
        for count in &mut counts {
            sum += *count;
            *count = sum;
        }
        self.starts = counts;
        (self.keys, self.descriptors) = all.into_iter().unzip();
    }

    /// Cells along a side of the raster, which holds the frame.
    fn raster_side(&self) -> usize {
        2 * (self.camera.frame_radius_px() / self.raster_px()).ceil().max(1.0) as usize
    }

    fn raster_px(&self) -> f64 {
        RASTER_CELLS * f64::from(self.reduction)
    }

    /// The row or column of a coordinate; what is beyond the raster belongs to its rim.
    fn cell(&self, at_px: f64) -> usize {
        let side = self.raster_side();
        ((at_px / self.raster_px()).floor() + (side / 2) as f64).clamp(0.0, (side - 1) as f64) as usize
    }

    fn slot(&self, sector: usize, row: usize, column: usize) -> usize {
        (sector * self.raster_side() + row) * self.raster_side() + column
    }

    fn slot_of(&self, key: &ImageKey) -> usize {
        let turn = key.along_px.y.atan2(key.along_px.x).rem_euclid(TAU) / TAU;
        let sector = ((turn * SECTORS as f64) as usize).min(SECTORS - 1);
        self.slot(sector, self.cell(key.at_px.y), self.cell(key.at_px.x))
    }

    /// Indices of all key points in a rectangle of reduced pixels whose orientation differs by at most `reach_rad` from
    /// that of `along_px`, and of some others.
    pub(super) fn near(
        &self,
        [least_px, largest_px]: [Vector2<f64>; 2],
        along_px: Vector2<f64>,
        reach_rad: f64,
    ) -> impl Iterator<Item = Range<usize>> {
        let width = TAU / SECTORS as f64;
        let turn = along_px.y.atan2(along_px.x);
        let first = ((turn - reach_rad) / width).floor() as i64;
        let last = ((turn + reach_rad) / width).floor() as i64;
        let sectors = (0..(last - first + 1).clamp(0, SECTORS as i64))
            .map(move |k| (first + k).rem_euclid(SECTORS as i64) as usize);
        let rows = if self.starts.is_empty() { 0..0 } else { self.cell(least_px.y)..self.cell(largest_px.y) + 1 };
        let [left, right] = [self.cell(least_px.x), self.cell(largest_px.x)];
        sectors.flat_map(move |sector| {
            rows.clone().map(move |row| {
                let [start, end] = [self.slot(sector, row, left), self.slot(sector, row, right) + 1];
                self.starts[start] as usize..self.starts[end] as usize
            })
        })
    }

    /// The key points with their descriptors, of a range of indices.
    pub(super) fn of(&self, range: Range<usize>) -> impl Iterator<Item = (&ImageKey, &Descriptor)> {
        self.keys[range.clone()].iter().zip(&self.descriptors[range])
    }

    fn of_tile(&self, [column, row]: [u32; 2]) -> Result<Vec<(ImageKey, Descriptor)>, PictureError> {
        let r = self.reduction;
        let (side, around) = (TILE_CELLS * r, AROUND_CELLS * r);
        let first = [column * side, row * side];
        let [x, y] = first.map(|v| v.saturating_sub(around));
        let rect = PixelRect { x, y, width: first[0] + side + around - x, height: first[1] + side + around - y };
        let window = self.picture.window(rect, r)?;
        let settings = Settings { most: Some(MOST_OF_A_TILE), ..settings() };
        let found = key_points(&window.grey, window.width, window.height, &settings);
        let own = |v: f64, first: u32| v >= f64::from(first) && v < f64::from(first + side);
        let key = |point: KeyPoint| {
            let origin = Vector2::from(window.origin_px.map(f64::from));
            let pixel = origin + point.at_px * f64::from(r);
            let (sin, cos) = point.orientation_rad.sin_cos();
            let along = Vector2::new(cos, sin) * (point.scale_px * f64::from(r));
            if !own(pixel.x, first[0]) || !own(pixel.y, first[1]) {
                return None;
            }
            let at_px = self.camera.reduced_from_pixel(pixel)?;
            let along_px = self.camera.reduced_from_pixel(pixel + along)? - at_px;
            Some((ImageKey { at_px, along_px }, point.descriptor))
        };
        Ok(found.into_iter().filter_map(key).collect())
    }
}

/// By how much an image should be reduced to show the scenes as they are: where its pixels are finer than theirs.
#[must_use]
pub fn reduction_for(file_by_scene: impl IntoIterator<Item = Matrix2<f64>>) -> u32 {
    let mut scales: Vec<f64> = file_by_scene.into_iter().map(|m| m.determinant().abs().sqrt()).collect();
    let middle = scales.len() / 2;
    if scales.is_empty() {
        return 1;
    }
    let (_, median, _) = scales.select_nth_unstable_by(middle, f64::total_cmp);
    (*median / LARGEST_MAGNIFICATION).floor().clamp(1.0, 16.0) as u32
}

/// Scenes may be magnified by so much before the image is reduced instead.
const LARGEST_MAGNIFICATION: f64 = 1.0;
