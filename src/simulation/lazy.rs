//! A photograph that is taken only where it is looked at: for studies of thousands of images, of which most pixels are
//! never read.

use std::sync::OnceLock;

use super::photograph::{Area, Photograph, PhotographSettings, Scenery, Sensor, developed, gaussian, margin_px};
use super::shading::SKY_GREY;
use super::town::Town;
use super::visibility::TILE_PX;
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};
use crate::geometry::{Camera, ExteriorOrientation};

/// Pixels along a side of the pieces that are developed at once: large against the margin that the blur needs, small
/// against the windows that are asked for.
const PIECE_PX: u32 = 256;

/// Pieces are made by whoever asks first while others wait: it is to be read by one thread, or by threads that read
/// different pieces.
///
/// The photograph that a camera takes of a town, pixel by pixel the same as [`super::photograph`]'s. What has been
/// rendered once is kept.
pub struct LazyPhotograph<'a> {
    scenery: Scenery<'a>,
    sensor: Sensor<'a>,
    kernel: Vec<f32>,
    light: TileGrid,
    pieces_across: u32,
    pieces: Vec<OnceLock<Photograph>>,
}

impl<'a> LazyPhotograph<'a> {
    /// Nothing is rendered yet.
    #[must_use]
    pub fn new(
        town: &'a Town,
        camera: &'a Camera,
        orientation: &ExteriorOrientation,
        settings: &'a PhotographSettings,
        seed: u64,
    ) -> Self {
        let kernel = gaussian(settings.blur_sigma_px);
        let frame = PixelRect { x: 0, y: 0, width: camera.width_px, height: camera.height_px };
        let light = TileGrid::over(Area::around(frame, margin_px(&kernel)));
        let pieces_across = camera.width_px.div_ceil(PIECE_PX);
        let count = pieces_across * camera.height_px.div_ceil(PIECE_PX);
        Self {
            scenery: Scenery::new(town, camera, orientation, settings),
            sensor: Sensor { camera, settings, seed },
            kernel,
            light,
            pieces_across,
            pieces: (0..count).map(|_| OnceLock::new()).collect(),
        }
    }

    /// The piece at a place in the raster of pieces.
    fn piece(&self, column: u32, row: u32) -> &Photograph {
        self.pieces[(row * self.pieces_across + column) as usize].get_or_init(|| {
            let [width, height] = self.size_px();
            let (x, y) = (column * PIECE_PX, row * PIECE_PX);
            let window = PixelRect { x, y, width: PIECE_PX.min(width - x), height: PIECE_PX.min(height - y) };
            let light = self.light_on(Area::around(window, margin_px(&self.kernel)));
            developed(&light, window, &self.kernel, &self.sensor)
        })
    }

    fn light_on(&self, area: Area) -> Vec<f32> {
        let [rows, columns] = area.tiles();
        let mut light = vec![SKY_GREY; area.width * area.height];
        for row in rows {
            let missing = columns.clone().filter(|&column| self.light.at(column, row).get().is_none());
            for (column, rendered) in self.scenery.tiles_light(row, missing) {
                // another thread may have been faster: it has rendered the same
                let _ = self.light.at(column, row).set(rendered);
            }
            for column in columns.clone() {
                if let Some(tile) = self.light.at(column, row).get() {
                    copy(tile, [column, row], area, &mut light);
                }
            }
        }
        light
    }
}

/// A cell for the light on every tile of an area.
struct TileGrid {
    first: [i32; 2],
    across: i32,
    cells: Vec<OnceLock<Vec<f32>>>,
}

impl TileGrid {
    fn over(area: Area) -> Self {
        let [rows, columns] = area.tiles();
        let (across, down) = (columns.end() - columns.start() + 1, rows.end() - rows.start() + 1);
        let cells = (0..across * down).map(|_| OnceLock::new()).collect();
        Self { first: [*columns.start(), *rows.start()], across, cells }
    }

    fn at(&self, column: i32, row: i32) -> &OnceLock<Vec<f32>> {
        &self.cells[((row - self.first[1]) * self.across + column - self.first[0]) as usize]
    }
}

/// Copies the part of a tile that lies in an area.
fn copy(tile: &[f32], [column, row]: [i32; 2], area: Area, light: &mut [f32]) {
    let tile_px = TILE_PX as i32;
    let (shift_x, shift_y) = (column * tile_px - area.x, row * tile_px - area.y);
    let inside = |shift: i32, length: usize| shift.max(0)..(shift + tile_px).min(length as i32);
    let (across, down) = (inside(shift_x, area.width), inside(shift_y, area.height));
    let count = across.len();
    for line in down {
        let source = (line - shift_y) as usize * TILE_PX + (across.start - shift_x) as usize;
        let target = line as usize * area.width + across.start as usize;
        light[target..target + count].copy_from_slice(&tile[source..source + count]);
    }
}

impl Picture for LazyPhotograph<'_> {
    fn size_px(&self) -> [u32; 2] {
        [self.sensor.camera.width_px, self.sensor.camera.height_px]
    }

    fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
        let [width_px, height_px] = self.size_px();
        let (x, y) = (rect.x.min(width_px), rect.y.min(height_px));
        let (width, height) = (rect.width.min(width_px - x), rect.height.min(height_px - y));
        let mut cut = Photograph { width_px: width, height_px: height, grey: vec![0; (width * height) as usize] };
        for piece_row in y / PIECE_PX..(y + height).div_ceil(PIECE_PX) {
            for piece_column in x / PIECE_PX..(x + width).div_ceil(PIECE_PX) {
                let piece = self.piece(piece_column, piece_row);
                let (left, top) = (piece_column * PIECE_PX, piece_row * PIECE_PX);
                let (from, to) = (left.max(x), (left + piece.width_px).min(x + width));
                for line in top.max(y)..(top + piece.height_px).min(y + height) {
                    let source = ((line - top) * piece.width_px + from - left) as usize;
                    let target = ((line - y) * width + from - x) as usize;
                    let count = (to - from) as usize;
                    cut.grey[target..target + count].copy_from_slice(&piece.grey[source..source + count]);
                }
            }
        }
        let whole = PixelRect { x: 0, y: 0, width, height };
        Ok(GreyWindow { origin_px: [x, y], ..cut.window(whole, reduction)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::{Scene, SceneSettings};

    #[test]
    fn windows_are_those_of_the_whole_picture_and_only_what_is_asked_for_is_rendered() {
        let mut settings = SceneSettings::default();
        settings.camera.image_size_px = [700, 530];
        settings.camera.principal_distance_px = 600.0;
        settings.camera.principal_point_px = [352.0, 263.0];
        settings.photograph.blur_sigma_px = 1.7;
        let scene = Scene::draw(5, &settings).unwrap();
        let (whole, lazy) = (scene.render(), scene.picture());
        let rendered = |lazy: &LazyPhotograph| lazy.light.cells.iter().filter(|cell| cell.get().is_some()).count();
        let corner = PixelRect { x: 600, y: 400, width: 300, height: 300 };
        assert_eq!(lazy.window(corner, 2).unwrap(), whole.window(corner, 2).unwrap());
        assert!(rendered(&lazy) < lazy.light.cells.len() / 2);
        for (x, y, width, height) in [(0, 0, 700, 530), (250, 130, 20, 300), (700, 0, 5, 5), (13, 255, 257, 1)] {
            for reduction in [1, 3] {
                let rect = PixelRect { x, y, width, height };
                assert_eq!(lazy.window(rect, reduction).unwrap(), whole.window(rect, reduction).unwrap());
            }
        }
        assert_eq!(rendered(&lazy), lazy.light.cells.len());
    }
}
