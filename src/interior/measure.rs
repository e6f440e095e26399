//! The lowest level: marks to a fraction of a pixel, by grey correlation in the scan's own resolution.

use nalgebra::{Matrix2, Vector2};

use super::binary::local_mean;
use super::consensus::Similarity;
use super::correlation::{Correlator, Fit};
use super::figure::EDGE_BAND_MM;
use super::plate::Fiducial;
use super::search::{pixel, pixels_from_mark};
use super::template::{Placing, Template};
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};

/// Blurs of scanners that are tried, pixels.
pub(super) const BLURS_PX: [f64; 4] = [0.4, 0.8, 1.2, 1.7];
/// What is cut about a mark beyond the template.
const MARGIN_PX: usize = 8;
/// A mark is followed so many pixels from where the level above has it.
const MOST_STEPS: usize = 12;
/// A template is drawn anew until its centre is the peak to this.
const SETTLED_PX: f64 = 0.05;
const MOST_DRAWINGS: usize = 4;
/// Cells of the template that differ from the scan by more than this share of the mark's contrast, and by more sigmas
/// than noise does, are dust or scratches.
const DIRT_OF_CONTRAST: f64 = 0.3;
const DIRT_SIGMAS: f64 = 4.0;
/// More dirt than this is no dirt.
const MOST_DIRT: f64 = 0.2;

/// A mark in the scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Measured {
    pub(super) at_px: Vector2<f64>,
    pub(super) covariance_px2: Matrix2<f64>,
    /// Correlation coefficient at full resolution, positive.
    pub(super) rho: f64,
}

/// A mark that is being measured: its part of the scan, and where it is thought to be.
pub(super) struct Measurement<'a> {
    fiducial: &'a Fiducial,
    pixels_from_mark: Matrix2<f64>,
    window: GreyWindow,
    sign: f64,
    at_px: Vector2<f64>,
    /// Half side of the surroundings, in cells, to whose mean and contrast everything is brought: for marks that are
    /// nothing but edges of an image that is bright here and dark there.
    even_out: Option<usize>,
}

impl<'a> Measurement<'a> {
    /// Cuts the part of the scan about a place.
    pub(super) fn about(
        picture: &dyn Picture,
        fiducial: &'a Fiducial,
        similarity: &Similarity,
        at_px: Vector2<f64>,
        negative: bool,
    ) -> Result<Self, PictureError> {
        let pixels_from_mark = pixels_from_mark(similarity, fiducial.rotation_rad);
        let placing =
            Placing { cells_from_mm: pixels_from_mark, centre: Vector2::zeros(), blur: BLURS_PX[1], core: true };
        let half = (Template::half_of(&fiducial.mark, &placing) + MARGIN_PX) as f64;
        let size_px = picture.size_px();
        let bound = |value: f64, axis: usize| value.floor().clamp(0.0, f64::from(size_px[axis])) as u32;
        let (left, top) = (bound(at_px.x - half, 0), bound(at_px.y - half, 1));
        let (right, bottom) = (bound(at_px.x + half + 1.0, 0), bound(at_px.y + half + 1.0, 1));
        let rect = PixelRect { x: left, y: top, width: right - left, height: bottom - top };
        let mut window = picture.window(rect, 1)?;
        let px_per_mm = pixels_from_mark.determinant().abs().sqrt();
        let even_out = fiducial.mark.is_edges().then_some((EDGE_BAND_MM * px_per_mm).ceil() as usize);
        if let Some(around) = even_out {
            window.grey = evened_out(&window.grey, window.width, window.height, around, FAINT_GREY);
        }
        Ok(Self { fiducial, pixels_from_mark, window, even_out, sign: if negative { -1.0 } else { 1.0 }, at_px })
    }

    /// The cell that a place lies in, and where in it, from its middle.
    fn cell(&self) -> Option<([usize; 2], Vector2<f64>)> {
        let from_origin = self.at_px - Vector2::from(self.window.origin_px.map(f64::from));
        let (x, y) = (from_origin.x.floor(), from_origin.y.floor());
        let inside = x >= 0.0 && y >= 0.0 && x < self.window.width as f64 && y < self.window.height as f64;
        inside.then(|| ([x as usize, y as usize], from_origin - Vector2::new(x + 0.5, y + 0.5)))
    }

    fn template(&self, centre: Vector2<f64>, blur: f64) -> Template {
        let placing = Placing { cells_from_mm: self.pixels_from_mark, centre, blur, core: true };
        let mut template = Template::draw(&self.fiducial.mark, &placing);
        if let Some(around) = self.even_out {
            let side = template.side();
            template.grey = evened_out(&template.grey, side, side, around, 0.0);
        }
        template
    }

    /// How well the mark fits where it is thought to be, under a blur.
    pub(super) fn likeness(&self, blur_px: f64) -> Option<f64> {
        let (cell, centre) = self.cell()?;
        Some(self.sign * Correlator::new(&self.template(centre, blur_px))?.fit(&self.window, cell)?.rho)
    }

    /// Goes to the peak of the correlation. `None` if there is none near.
    pub(super) fn climb(&mut self, blur_px: f64) -> Option<()> {
        let (cell, centre) = self.cell()?;
        let correlator = Correlator::new(&self.template(centre, blur_px))?;
        let (at, _) = correlator.climb(&self.window, cell, MOST_STEPS, self.sign)?;
        let peak = correlator.peak(&self.window, at, self.sign)?;
        self.at_px = pixel(&self.window, at, centre + peak.shift);
        Some(())
    }

    /// Goes to the best place within a reach (pixels) first.
    pub(super) fn sweep(&mut self, blur_px: f64, reach: usize) -> Option<()> {
        let (cell, centre) = self.cell()?;
        let correlator = Correlator::new(&self.template(centre, blur_px))?;
        let (at, _) = correlator.best(&self.window, cell, reach, self.sign)?;
        self.at_px = pixel(&self.window, at, centre);
        Some(())
    }

    /// The place to a fraction of a pixel with its covariance: the template is drawn anew where the peak is, until the
    /// peak is its centre, so that the raster biases nothing; dust and scratches are left out.
    pub(super) fn settle(&mut self, blur_px: f64) -> Option<Measured> {
        let mut clean: Option<Dirt> = None;
        for drawing in 0..MOST_DRAWINGS {
            let (cell, centre) = self.cell()?;
            let mut template = self.template(centre, blur_px);
            if let Some(dirt) = &clean {
                dirt.leave_out(&mut template, cell);
            }
            let correlator = Correlator::new(&template)?;
            let fit = correlator.fit(&self.window, cell)?;
            let peak = correlator.peak(&self.window, cell, self.sign)?;
            self.at_px = pixel(&self.window, cell, centre + peak.shift);
            if clean.is_none() {
                clean = Some(Dirt::of(&correlator, &template, &self.window, cell, &fit));
            } else if peak.shift.norm() < SETTLED_PX || drawing + 1 == MOST_DRAWINGS {
                let inflation = correlator.inflation(&template, &self.window, cell, &fit);
                let covariance_px2 = peak.covariance(fit.rho, correlator.count())? * inflation;
                return Some(Measured { at_px: self.at_px, covariance_px2, rho: self.sign * fit.rho });
            }
        }
        None
    }
}

/// Contrasts below this are not brought to those of others, grey values.
const FAINT_GREY: f64 = 6.0;

/// Every cell less the mean of its surroundings, in units of their standard deviation (and of `faint`).
fn evened_out(grey: &[f32], width: usize, height: usize, around: usize, faint: f64) -> Vec<f32> {
    let squares: Vec<f32> = grey.iter().map(|grey| grey * grey).collect();
    let mean = local_mean(grey, width, height, around);
    let square = local_mean(&squares, width, height, around);
    let one = |k: usize| {
        let variance = f64::from(square[k] - mean[k] * mean[k]).max(0.0) + faint * faint;
        // to about the range of the grey values of a mark
        if variance > 1e-9 { f64::from(grey[k] - mean[k]) / variance.sqrt() * 50.0 } else { 0.0 }
    };
    (0..grey.len()).map(|k| one(k) as f32).collect()
}

/// Pixels of the window that are not of the mark.
struct Dirt {
    /// Columns and rows in the window.
    pixels: Vec<[usize; 2]>,
}

impl Dirt {
    fn of(correlator: &Correlator, template: &Template, window: &GreyWindow, cell: [usize; 2], fit: &Fit) -> Self {
        let residuals = correlator.residuals(template, window, cell, fit);
        let mut sizes: Vec<f64> = residuals.iter().flatten().map(|residual| residual.abs()).collect();
        let middle = sizes.len() / 2;
        let median = if sizes.is_empty() { 0.0 } else { *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 };
        // the median of normal deviates is 0.6745 sigma
        let limit = (DIRT_SIGMAS * median / 0.6745).max(DIRT_OF_CONTRAST * fit.gain.abs());
        let side = template.side();
        let place = |k: usize| [cell[0] + k % side - template.half, cell[1] + k / side - template.half];
        let dirty = residuals.iter().enumerate().filter(|(_, r)| r.is_some_and(|r| r.abs() > limit));
        let pixels: Vec<_> = dirty.map(|(k, _)| place(k)).collect();
        let few = (pixels.len() as f64) < MOST_DIRT * sizes.len() as f64;
        Self { pixels: if few { pixels } else { Vec::new() } }
    }

    fn leave_out(&self, template: &mut Template, cell: [usize; 2]) {
        let side = template.side();
        for [x, y] in &self.pixels {
            let (column, row) = (x + template.half, y + template.half);
            if column >= cell[0] && row >= cell[1] && column - cell[0] < side && row - cell[1] < side {
                template.care[(row - cell[1]) * side + column - cell[0]] = false;
            }
        }
    }
}
