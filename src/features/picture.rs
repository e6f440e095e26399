//! What the extraction of features needs of a picture: its size, and grey windows of it.

use nalgebra::Vector2;

/// A rectangle of whole pixels of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelRect {
    /// First column.
    pub x: u32,
    /// First row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// Grey values of a rectangle, averaged over square blocks of `reduction` pixels a side.
#[derive(Debug, Clone, PartialEq)]
pub struct GreyWindow {
    /// The top-left pixel of the rectangle in the file.
    pub origin_px: [u32; 2],
    /// Pixels of the file along one side of a cell of this window; 1 for the picture's own resolution.
    pub reduction: u32,
    /// Cells in a row.
    pub width: usize,
    /// Rows of cells.
    pub height: usize,
    /// Row by row, 0 for black to 255 for white (pictures of more bits are scaled, not cut).
    pub grey: Vec<f32>,
}

impl GreyWindow {
    /// The window at half the resolution. (Where the rim cuts blocks of pixels, those at the rim count as whole ones.)
    #[must_use]
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut grey = Vec::with_capacity(width * height);
        for two in self.grey.chunks(2 * self.width.max(1)) {
            // the last of an odd number of rows stands for two
            let (above, below) = two.split_at(self.width);
            let below = if below.is_empty() { above } else { below };
            let (a, b) = (above.as_chunks::<2>(), below.as_chunks::<2>());
            grey.extend(a.0.iter().zip(b.0).map(|(a, b)| 0.25 * ((a[0] + a[1]) + (b[0] + b[1]))));
            grey.extend(a.1.iter().zip(b.1).map(|(a, b)| 0.5 * (a + b)));
        }
        Self { origin_px: self.origin_px, reduction: 2 * self.reduction, width, height, grey }
    }
}

/// A picture cut into square tiles, which are asked for by columns and rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tiling {
    /// Columns and rows of the file.
    pub size_px: [u32; 2],
    /// Pixels along a side of a tile.
    pub side_px: u32,
}

impl Tiling {
    /// Columns and rows of the tiles that touch a rectangle, least and largest x and y in pixels of the file (it may
    /// reach out of the picture).
    pub fn touching(self, [least_px, largest_px]: [Vector2<f64>; 2]) -> impl Iterator<Item = [u32; 2]> + use<> {
        let tiles = |least: f64, largest: f64, size: u32| {
            let last = (f64::from(size) - 1.0).max(0.0);
            let index = |v: f64| (v.clamp(0.0, last) / f64::from(self.side_px)) as u32;
            if largest < 0.0 || least > last { 0..0 } else { index(least)..index(largest) + 1 }
        };
        let [width, height] = self.size_px;
        let columns = tiles(least_px.x, largest_px.x, width);
        let rows = tiles(least_px.y, largest_px.y, height);
        rows.flat_map(move |row| columns.clone().map(move |column| [column, row]))
    }

    /// How many pixels of the file lie in tiles.
    pub fn pixels<'t>(self, tiles: impl IntoIterator<Item = &'t [u32; 2]>) -> u64 {
        let side = |index: u32, size: u32| u64::from(self.side_px.min(size - index * self.side_px));
        let [width, height] = self.size_px;
        tiles.into_iter().map(|[column, row]| side(*column, width) * side(*row, height)).sum()
    }
}

/// A picture that could not be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{detail}")]
pub struct PictureError {
    /// What is wrong with it, in words for the user.
    pub detail: String,
}

/// A source of grey windows.
pub trait Picture: Send + Sync {
    /// Columns and rows of the file.
    fn size_px(&self) -> [u32; 2];

    /// The part of `rect` that lies in the picture, reduced: `width = ceil(rect.width / reduction)` cells, those at
    /// the right and lower rim averaged over the pixels that there are.
    ///
    /// # Errors
    /// [`PictureError`] if the file is damaged there or cannot be read.
    fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_the_resolution_is_the_mean_of_four_cells() {
        let grey = (0..15).map(|k| (k * k) as f32).collect();
        let window = GreyWindow { origin_px: [70, 30], reduction: 2, width: 5, height: 3, grey };
        let half = window.halved();
        assert_eq!((half.origin_px, half.reduction, half.width, half.height), ([70, 30], 4, 3, 2));
        // squares of 0 1 5 6, of 2 3 7 8, of 4 9; of 10 11, of 12 13, of 14
        assert_eq!(half.grey, [62.0 / 4.0, 126.0 / 4.0, 97.0 / 2.0, 221.0 / 2.0, 313.0 / 2.0, 196.0]);
        let empty = GreyWindow { origin_px: [0, 0], reduction: 1, width: 0, height: 0, grey: Vec::new() };
        assert_eq!(empty.halved().grey, Vec::<f32>::new());
    }
}
