//! Anti-aliased lines, arrows and letters on an RGB picture.

use image::{Rgb, RgbImage};
use nalgebra::Vector2;

use super::lettering;
use crate::features::GreyWindow;

/// Red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::report) struct Colour(pub(in crate::report) [u8; 3]);

const BLACK: Colour = Colour([0, 0, 0]);
/// Pixels a dot of a letter has on each side.
const LETTER_SCALE: i64 = 2;

pub(in crate::report) struct Canvas {
    image: RgbImage,
}

impl Canvas {
    pub(in crate::report) fn from_grey(window: &GreyWindow) -> Self {
        // the cast saturates, which is what is wanted of greys outside 0 to 255
        let image = RgbImage::from_fn(window.width as u32, window.height as u32, |x, y| {
            let grey = window.grey.get(y as usize * window.width + x as usize).copied().unwrap_or(0.0);
            Rgb([grey.round() as u8; 3])
        });
        Self { image }
    }

    pub(in crate::report) fn into_image(self) -> RgbImage {
        self.image
    }

    /// A line between two positions ((0, 0) is the corner of the first pixel). Each step along the longer axis paints
    /// a short strip across, each of its pixels by how far it lies from the line.
    pub(in crate::report) fn line(&mut self, start: Vector2<f64>, end: Vector2<f64>, width_px: f64, colour: Colour) {
        if !start.iter().chain(end.iter()).all(|v| v.is_finite()) {
            return;
        }
        let along_y = (end.y - start.y).abs() > (end.x - start.x).abs();
        let (major, minor) = if along_y { (1, 0) } else { (0, 1) };
        let (from, to) = if start[major] <= end[major] { (start, end) } else { (end, start) };
        let size = [f64::from(self.image.width()), f64::from(self.image.height())];
        let length = to[major] - from[major];
        let slope = if length > 0.0 { (to[minor] - from[minor]) / length } else { 0.0 };
        let strip = (width_px / 2.0 + 1.0) * slope.hypot(1.0);
        let (first, last) = (from[major].max(0.0).floor(), to[major].min(size[major]).ceil());
        for step in first as i64..last as i64 {
            let middle = from[minor] + slope * (step as f64 + 0.5 - from[major]);
            if !(-strip..size[minor] + strip).contains(&middle) {
                continue;
            }
            for across in (middle - strip).floor() as i64..=(middle + strip).ceil() as i64 {
                let distance = (across as f64 + 0.5 - middle).abs() / slope.hypot(1.0);
                let coverage = (width_px / 2.0 + 0.5 - distance).clamp(0.0, 1.0);
                let (x, y) = if along_y { (across, step) } else { (step, across) };
                self.blend(x, y, colour, coverage);
            }
        }
    }

    /// A line with a head at `tip`.
    pub(in crate::report) fn arrow(&mut self, tail: Vector2<f64>, tip: Vector2<f64>, colour: Colour) {
        self.line(tail, tip, 1.5, colour);
        let Some(back) = (tail - tip).try_normalize(1e-9) else {
            return;
        };
        let across = Vector2::new(-back.y, back.x);
        for side in [-4.0, 4.0] {
            self.line(tip, tip + 9.0 * back + side * across, 1.5, colour);
        }
    }

    /// Letters with a dark rim, `place` being their top-left corner. What begins on the picture does not leave it at
    /// the right.
    pub(in crate::report) fn letters(&mut self, place: Vector2<f64>, text: &str, colour: Colour) {
        if !place.iter().all(|v| v.is_finite()) {
            return;
        }
        let columns = lettering::dots(text).map(|(column, _)| column + 1).max().unwrap_or(0);
        let (mut left, top, width) = (place.x as i64, place.y as i64, i64::from(self.image.width()));
        if (0..width).contains(&left) {
            left = left.min(width - 1 - columns * LETTER_SCALE).max(0);
        }
        let rim = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy, BLACK)));
        for (dx, dy, colour) in rim.chain([(0, 0, colour)]) {
            for (column, row) in lettering::dots(text) {
                self.dot(left.saturating_add(dx), top.saturating_add(dy), column, row, colour);
            }
        }
    }

    fn dot(&mut self, left: i64, top: i64, column: i64, row: i64, colour: Colour) {
        for (dx, dy) in (0..LETTER_SCALE).flat_map(|dx| (0..LETTER_SCALE).map(move |dy| (dx, dy))) {
            let x = left.saturating_add(column * LETTER_SCALE + dx);
            let y = top.saturating_add(row * LETTER_SCALE + dy);
            self.blend(x, y, colour, 1.0);
        }
    }

    fn blend(&mut self, x: i64, y: i64, colour: Colour, coverage: f64) {
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else {
            return;
        };
        if let Some(pixel) = self.image.get_pixel_mut_checked(x, y) {
            for (channel, paint) in pixel.0.iter_mut().zip(colour.0) {
                let mixed = f64::from(*channel) * (1.0 - coverage) + f64::from(paint) * coverage;
                *channel = mixed.round() as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn black(width: usize, height: usize) -> Canvas {
        let grey = vec![0.0; width * height];
        Canvas::from_grey(&GreyWindow { origin_px: [0, 0], reduction: 1, width, height, grey })
    }

    /// Whatever its direction, a line paints its length times its width.
    #[test]
    fn the_painted_area_is_that_of_the_line() {
        for angle in [0.0_f64, 0.3, 0.7, 1.2, 1.57, 2.5, -0.9] {
            let mut canvas = black(100, 100);
            let half = 30.0 * Vector2::new(angle.cos(), angle.sin());
            let centre = Vector2::new(50.0, 50.0);
            canvas.line(centre - half, centre + half, 2.0, Colour([255, 255, 255]));
            let painted: f64 = canvas.into_image().pixels().map(|p| f64::from(p.0[0]) / 255.0).sum();
            assert!((painted - 120.0).abs() < 6.0, "{painted} at {angle}");
        }
    }

    #[test]
    fn letters_are_where_they_were_asked_for() {
        let mut canvas = black(40, 30);
        canvas.letters(Vector2::new(10.0, 10.0), "L", Colour([255, 255, 255]));
        let image = canvas.into_image();
        assert_eq!(image.get_pixel(10, 10).0[0], 255);
        assert_eq!(image.get_pixel(14, 18).0[0], 255);
        assert_eq!(image.get_pixel(14, 10).0[0], 0);
    }

    #[test]
    fn letters_at_the_right_border_are_not_cut_off() {
        let mut canvas = black(40, 30);
        canvas.letters(Vector2::new(39.0, 10.0), "L", Colour([255, 255, 255]));
        let painted = |canvas: Canvas| canvas.into_image().pixels().filter(|p| p.0[0] == 255).count();
        let mut free = black(40, 30);
        free.letters(Vector2::new(10.0, 10.0), "L", Colour([255, 255, 255]));
        assert_eq!(painted(canvas), painted(free));
    }
}
