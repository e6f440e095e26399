//! A mark in the scan, magnified.

use image::RgbImage;
use nalgebra::Vector2;

use super::{InteriorResult, MarkReport};
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};
use crate::report::overlay::canvas::{Canvas, Colour};
use crate::report::overlay::{Format, encode};

/// No picture is wider.
const WIDEST_PX: u32 = 600;
/// What is shown about a mark, and the fewest and most pixels of that.
const SHOWN_MM: f64 = 3.2;
const SHOWN_PX: [f64; 2] = [40.0, WIDEST_PX as f64];
// Okabe and Ito's palette, which the colour-blind tell apart as well
const LOCATED: Colour = Colour([86, 180, 233]);
const PREDICTED: Colour = Colour([230, 159, 0]);
const LETTERS: Colour = Colour([255, 255, 255]);
/// Beyond the scan: two greys of a chequered pattern, and how many pixels a square of it has.
const BEYOND: [f32; 2] = [190.0, 215.0];
const SQUARE: i64 = 8;
/// Shares of the greys that are drawn black and white.
const DARKEST: f64 = 0.01;
const BRIGHTEST: f64 = 0.995;
/// Half the length of a cross, and what is left free about its middle.
const ARM: f64 = 40.0;
const FREE: f64 = 7.0;

/// A mark in the scan at full resolution, magnified by a whole number, as a PNG of at most 600 px a side: an upright
/// blue cross where it was located, a diagonal orange one where the transformation predicts it. One that was not found
/// is shown about its predicted place. `None` if there is no such place, or it lies beyond the scan.
///
/// # Errors
/// [`PictureError`] if the scan cannot be read there.
pub fn close_up(
    picture: &dyn Picture,
    result: &InteriorResult,
    mark: &MarkReport,
) -> Result<Option<Vec<u8>>, PictureError> {
    match drawn(picture, result.pixel_size_um, mark)? {
        Some(image) => encode(&image, Format::Png).map(Some),
        None => Ok(None),
    }
}

pub(super) fn drawn(picture: &dyn Picture, pixel_um: f64, mark: &MarkReport) -> Result<Option<RgbImage>, PictureError> {
    let side = (1e3 * SHOWN_MM / pixel_um).clamp(SHOWN_PX[0], SHOWN_PX[1]).round();
    let Some(middle) = middle(mark, side) else { return Ok(None) };
    let Some(view) = View::about(middle, side, picture.size_px()) else { return Ok(None) };
    let scan = picture.window(view.rect, 1)?;
    let mut canvas = Canvas::from_grey(&view.magnified(&scan));
    if let Some(at) = mark.predicted_px {
        let diagonal = 0.5_f64.sqrt();
        cross(
            &mut canvas,
            view.place(at),
            [Vector2::new(diagonal, diagonal), Vector2::new(diagonal, -diagonal)],
            PREDICTED,
        );
    }
    if let Some(at) = mark.located_px {
        cross(&mut canvas, view.place(at), [Vector2::x(), Vector2::y()], LOCATED);
    }
    canvas.letters(Vector2::new(8.0, 8.0), &mark.name, LETTERS);
    bar(&mut canvas, &view, pixel_um);
    Ok(Some(canvas.into_image()))
}

/// Between where it was found and where it should be, if both can be seen together.
fn middle(mark: &MarkReport, side: f64) -> Option<Vector2<f64>> {
    match (mark.located_px.map(Vector2::from), mark.predicted_px.map(Vector2::from)) {
        (Some(located), Some(predicted)) if (located - predicted).amax() < 0.8 * side => {
            Some((located + predicted) / 2.0)
        }
        (located, predicted) => located.or(predicted),
    }
}

fn cross(canvas: &mut Canvas, at: Vector2<f64>, directions: [Vector2<f64>; 2], colour: Colour) {
    for direction in directions.into_iter().flat_map(|direction| [direction, -direction]) {
        canvas.line(at + FREE * direction, at + ARM * direction, 1.2, colour);
    }
}

/// Half a millimetre on the film.
fn bar(canvas: &mut Canvas, view: &View, pixel_um: f64) {
    let length = 500.0 / pixel_um * f64::from(view.magnification);
    let size = f64::from(view.side * view.magnification);
    let from = Vector2::new(10.0, size - 12.0);
    canvas.line(from, from + Vector2::new(length, 0.0), 5.0, Colour([0, 0, 0]));
    canvas.line(from + Vector2::x(), from + Vector2::new(length - 1.0, 0.0), 3.0, LETTERS);
    canvas.letters(from + Vector2::new(0.0, -18.0), "0.5 MM", LETTERS);
}

/// A square of the scan, part of which may lie beyond it.
struct View {
    /// Its top-left pixel.
    origin: [i64; 2],
    /// Pixels along a side.
    side: u32,
    /// The part that there is.
    rect: PixelRect,
    magnification: u32,
}

impl View {
    /// `None` if nothing of it, or not its middle, is within a scan of this size.
    fn about(middle: Vector2<f64>, side: f64, size_px: [u32; 2]) -> Option<Self> {
        let inside = (0..2).all(|axis| (0.0..=f64::from(size_px[axis])).contains(&middle[axis]));
        if !inside {
            return None;
        }
        let origin = [middle.x, middle.y].map(|at| (at - side / 2.0).round() as i64);
        let side = side as u32;
        let span = |axis: usize| {
            let low = origin[axis].max(0);
            let high = (origin[axis] + i64::from(side)).min(i64::from(size_px[axis]));
            (low as u32, (high - low).max(0) as u32)
        };
        let ((x, width), (y, height)) = (span(0), span(1));
        let rect = PixelRect { x, y, width, height };
        (width > 0 && height > 0).then_some(Self { origin, side, rect, magnification: WIDEST_PX / side.max(1) })
    }

    /// A place of the scan in the picture.
    fn place(&self, [x, y]: [f64; 2]) -> Vector2<f64> {
        let origin = Vector2::new(self.origin[0] as f64, self.origin[1] as f64);
        (Vector2::new(x, y) - origin) * f64::from(self.magnification)
    }

    /// The scan with its greys spread, each pixel a square, and a pattern where there is no scan.
    fn magnified(&self, scan: &GreyWindow) -> GreyWindow {
        let [dark, bright] = ends(&scan.grey);
        let factor = i64::from(self.magnification);
        let size = i64::from(self.side) * factor;
        let pixel = |x: i64, y: i64| {
            let column = self.origin[0] + x / factor - i64::from(scan.origin_px[0]);
            let row = self.origin[1] + y / factor - i64::from(scan.origin_px[1]);
            let (column, row) = (usize::try_from(column).ok()?, usize::try_from(row).ok()?);
            let grey = (column < scan.width).then(|| scan.grey.get(row * scan.width + column)).flatten()?;
            Some(255.0 * (grey - dark) / (bright - dark).max(1.0))
        };
        let beyond = |x: i64, y: i64| BEYOND[usize::from((x / SQUARE + y / SQUARE) % 2 == 0)];
        let grey = (0..size).flat_map(|y| (0..size).map(move |x| (x, y)));
        let grey = grey.map(|(x, y)| pixel(x, y).unwrap_or_else(|| beyond(x, y))).collect();
        GreyWindow { origin_px: [0, 0], reduction: 1, width: size as usize, height: size as usize, grey }
    }
}

/// The greys to be drawn black and white.
fn ends(grey: &[f32]) -> [f32; 2] {
    let mut sorted = grey.to_vec();
    sorted.sort_by(f32::total_cmp);
    let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).or(sorted.last()).copied();
    [at(DARKEST).unwrap_or(0.0), at(BRIGHTEST).unwrap_or(255.0)]
}
