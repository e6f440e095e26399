//! A picture in levels for a viewer: each half as large as the one before, and cut into square tiles. Of a large picture
//! there is an overview, from which its higher levels come, so that none of them needs the whole file.

use std::io;
use std::path::Path;

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use rayon::prelude::*;

use super::{ImageFile, ImageryError, Limits};
use crate::features::{GreyWindow, Picture as _, PictureError, PixelRect};

/// Columns and rows of a tile, but at the right and lower rim.
pub const TILE_SIDE_PX: u32 = 512;
/// The longer side of an overview at the most; a picture that is no larger needs none.
pub const OVERVIEW_SIDE_PX: u32 = 4096;

/// The levels of a picture: level 0 has the pixels of the file, level n those averaged over squares of 2^n a side, and the
/// highest one fits into a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Levels {
    /// Columns and rows of the file.
    pub size_px: [u32; 2],
}

impl Levels {
    /// The highest level.
    #[must_use]
    pub fn highest(self) -> u32 {
        self.first_within(TILE_SIDE_PX)
    }

    /// The level that the overview has; `None` where the picture needs none.
    #[must_use]
    pub fn overview(self) -> Option<u32> {
        Some(self.first_within(OVERVIEW_SIDE_PX)).filter(|level| *level > 0)
    }

    /// Columns and rows of a level.
    #[must_use]
    pub fn level_px(self, level: u32) -> [u32; 2] {
        self.size_px.map(|side| side.div_ceil(1 << level))
    }

    /// What a tile shows, in the pixels of its level; `None` where there is no such tile.
    #[must_use]
    pub fn tile(self, level: u32, column: u32, row: u32) -> Option<PixelRect> {
        if level > self.highest() {
            return None;
        }
        let [width, height] = self.level_px(level);
        let along = |index: u32, side: u32| {
            let first = index.checked_mul(TILE_SIDE_PX).filter(|first| *first < side)?;
            Some((first, TILE_SIDE_PX.min(side - first)))
        };
        let ((x, width), (y, height)) = (along(column, width)?, along(row, height)?);
        Some(PixelRect { x, y, width, height })
    }

    fn first_within(self, side_px: u32) -> u32 {
        let [width, height] = self.size_px;
        (0..u32::BITS).find(|level| width.max(height).div_ceil(1 << level) <= side_px).unwrap_or(0)
    }
}

/// The rectangle of `rect`, which is in cells of `reduction` pixels, in the pixels of a picture of this size.
#[must_use]
pub fn enlarged(rect: PixelRect, reduction: u32, [width, height]: [u32; 2]) -> PixelRect {
    let (x, y) = (rect.x * reduction, rect.y * reduction);
    let within = |cells: u32, first: u32, side: u32| (cells * reduction).min(side.saturating_sub(first));
    PixelRect { x, y, width: within(rect.width, x, width), height: within(rect.height, y, height) }
}

/// The most memory that reading an overview may take for strips and tiles, all threads together.
const OVERVIEW_MEMORY_BYTES: u64 = 512 << 20;

/// The whole picture, averaged over squares of `reduction` pixels a side, by all cores. `path` is where it was opened:
/// each thread reads a TIFF by itself, for one handle decodes one strip or tile at a time.
///
/// # Errors
/// [`PictureError`] if it is damaged anywhere, or cannot be read.
pub fn overview(file: &ImageFile, path: &Path, limits: &Limits, reduction: u32) -> Result<ImageFile, PictureError> {
    let [width, height] = file.size_px();
    let at_a_time = (OVERVIEW_MEMORY_BYTES / file.band_bytes().max(1)).clamp(1, rayon::current_num_threads() as u64);
    let rows_of_cells = height.div_ceil(reduction).div_ceil(at_a_time as u32).max(1);
    let strip_px = rows_of_cells * reduction;
    let tops: Vec<u32> = (0..height).step_by(strip_px as usize).collect();
    // a thread passes over its rows once: it needs to keep nothing
    let limits = Limits { chunk_cache_bytes: 0, ..limits.clone() };
    let strip = |top: u32| -> Result<Vec<u8>, PictureError> {
        let rect = PixelRect { x: 0, y: top, width, height: strip_px.min(height - top) };
        let window = match file.is_on_disk() {
            true => ImageFile::open(path, &limits)?.window(rect, reduction)?,
            false => file.window(rect, reduction)?,
        };
        Ok(rounded(&window))
    };
    let strips: Vec<Vec<u8>> = tops.into_par_iter().map(strip).collect::<Result<_, _>>()?;
    Ok(ImageFile::of_grey([width, height].map(|side| side.div_ceil(reduction)), strips.concat()))
}

/// A window as a grey JPEG.
///
/// # Errors
/// [`ImageryError::Read`] if it has no pixels.
pub fn jpeg(window: &GreyWindow, quality: u8) -> Result<Vec<u8>, ImageryError> {
    let (mut file, size) = (Vec::new(), [window.width, window.height].map(|side| u32::try_from(side).unwrap_or(0)));
    let encoder = JpegEncoder::new_with_quality(&mut file, quality);
    let encoded = { encoder }.encode(&rounded(window), size[0], size[1], ExtendedColorType::L8);
    encoded.map_err(|error| ImageryError::Read { source: io::Error::other(error) })?;
    Ok(file)
}

fn rounded(window: &GreyWindow) -> Vec<u8> {
    window.grey.iter().map(|grey| (grey + 0.5) as u8).collect()
}
