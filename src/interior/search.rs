//! Where the marks are: through an image pyramid, by binary correlation on its upper levels and by grey correlation on
//! the lowest, with a consensus on each (Schickler and Poth, section 4).

use nalgebra::{Matrix2, Rotation2, Vector2};

use super::binary::{BinaryTemplate, Figures};
use super::consensus::{Agreement, Bounds, Candidate, Similarity, agreement};
use super::correlation::Correlator;
use super::laying::Laying;
use super::mark::Mark;
use super::plate::{Fiducial, Plate};
use super::template::{Placing, Template};
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};

/// Side of a cell on the upper level: lines of marks are 0.1 mm wide, and a mark of 6 mm has its rows in one word.
const UPPER_CELL_MM: f64 = 0.13;
/// On the middle level.
const MIDDLE_CELL_MM: f64 = 0.045;
/// Half side of the surroundings that a figure stands out from.
const AROUND_MM: f64 = 0.9;
/// Candidates of a mark on the upper and on the middle level, and how near to each other they may be.
const UPPER_CANDIDATES: usize = 8;
const MIDDLE_CANDIDATES: usize = 4;
const APART_MM: f64 = 0.4;
/// Binary coefficients below this are no candidates.
const LEAST_BINARY: f32 = 0.15;
/// Grey coefficients below this are none either.
const LEAST_GREY: f64 = 0.3;
/// What the film does to a mark's place under a similarity, and what the raster does on the upper level.
const UPPER_TOLERANCE_MM: f64 = 0.3;
const MIDDLE_TOLERANCE_MM: f64 = 0.15;
/// How far about the prediction of the upper level a mark is looked for on the middle one.
const MIDDLE_REACH_MM: f64 = 0.6;
/// Marks that are looked for first; the others where these predict them.
const SEEDS: usize = 4;
/// The scanner's blur that is assumed before it is known, pixels.
const BLUR_PX: f64 = 0.7;

/// What is known of a scan beforehand, and how far it may be from that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Expectation {
    pub(super) pixel_mm: f64,
    /// Largest relative error of the pixel's side.
    pub(super) scale: f64,
    /// Largest distance of the plate's origin from the middle of the scan, in x and y.
    pub(super) offset_mm: f64,
    /// Largest turn.
    pub(super) rotation_rad: f64,
}

/// The marks of a plate in one of its layings.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Finding {
    pub(super) laying: Laying,
    pub(super) negative: bool,
    pub(super) similarity: Similarity,
    /// For each fiducial its place on the middle level, if it agrees.
    pub(super) marks: Vec<Option<Candidate>>,
    /// Sum of the coefficients.
    pub(super) score: f64,
}

/// What the upper level shows of one laying.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FirstLook {
    laying: Laying,
    negative: bool,
    similarity: Similarity,
    /// Sum of the coefficients.
    pub(super) score: f64,
}

impl Finding {
    pub(super) fn count(&self) -> usize {
        self.marks.iter().flatten().count()
    }
}

/// A scan that is being searched.
pub(super) struct Search<'a> {
    pub(super) picture: &'a dyn Picture,
    pub(super) plate: &'a Plate,
    pub(super) expectation: Expectation,
    /// Windows of the upper level that were looked at before: other layings have marks at the same places.
    looked_at: Vec<UpperWindow>,
}

struct UpperWindow {
    rect: PixelRect,
    grey: GreyWindow,
    figures: Figures,
    templates: Vec<(BinaryTemplate, [Vec<Candidate>; 2])>,
}

/// How a mark is drawn, and where it is looked for.
#[derive(Debug, Clone, Copy)]
struct Look<'a> {
    mark: &'a Mark,
    /// Pixels from the mark's own millimetres.
    pixels_from_mark: Matrix2<f64>,
    about_px: Vector2<f64>,
    reach_mm: f64,
}

impl<'a> Search<'a> {
    pub(super) fn new(picture: &'a dyn Picture, plate: &'a Plate, expectation: Expectation) -> Self {
        Self { picture, plate, expectation, looked_at: Vec::new() }
    }

    fn px_per_mm(&self) -> f64 {
        1.0 / self.expectation.pixel_mm
    }

    fn reduction(&self, cell_mm: f64) -> u32 {
        ((cell_mm / self.expectation.pixel_mm).round() as u32).max(1)
    }

    fn expected(&self, laying: Laying, rotation_rad: f64) -> Similarity {
        let middle = self.picture.size_px().map(|side| f64::from(side) / 2.0);
        Similarity::new(laying.axes(), self.px_per_mm(), rotation_rad, Vector2::from(middle))
    }

    fn bounds(&self, laying: Laying) -> Bounds {
        let Expectation { scale, rotation_rad, .. } = self.expectation;
        Bounds { axes: laying.axes(), px_per_mm: self.px_per_mm(), scale, rotation_rad }
    }

    /// The marks under one laying on the upper level, of the polarity that fits better; the templates are drawn with a
    /// turn. `None` if no two marks agree.
    pub(super) fn look(&mut self, laying: Laying, rotation_rad: f64) -> Result<Option<FirstLook>, PictureError> {
        let seeds = self.seeds();
        let mut best = self.agreed(laying, rotation_rad, &seeds)?;
        let all: Vec<usize> = (0..self.plate.fiducials.len()).collect();
        if seeds.len() < all.len() && best.as_ref().is_none_or(|(found, _)| found.count() < 3) {
            best = self.agreed(laying, rotation_rad, &all)?;
        }
        Ok(best.map(|(found, negative)| FirstLook {
            laying,
            negative,
            similarity: found.similarity,
            score: found.score,
        }))
    }

    /// The marks that are farthest from each other.
    fn seeds(&self) -> Vec<usize> {
        let fiducials = &self.plate.fiducials;
        let mut order: Vec<usize> = (0..fiducials.len()).collect();
        order.sort_by(|a, b| fiducials[*b].position_mm.norm().total_cmp(&fiducials[*a].position_mm.norm()));
        order.truncate(SEEDS);
        order
    }

    fn agreed(
        &mut self,
        laying: Laying,
        rotation_rad: f64,
        marks: &[usize],
    ) -> Result<Option<(Agreement, bool)>, PictureError> {
        let plate = self.plate;
        let expected = self.expected(laying, rotation_rad);
        let mut candidates = [Vec::new(), Vec::new()];
        for mark in marks {
            let fiducial = &plate.fiducials[*mark];
            let Expectation { offset_mm, rotation_rad, scale, .. } = self.expectation;
            let straight = self.expected(laying, 0.0);
            let look = Look {
                mark: &fiducial.mark,
                pixels_from_mark: pixels_from_mark(&expected, fiducial.rotation_rad),
                about_px: straight.apply(fiducial.position_mm),
                reach_mm: offset_mm + fiducial.position_mm.norm() * (rotation_rad + scale),
            };
            let [positive, negative] = self.upper_candidates(&look)?;
            candidates[0].push(positive);
            candidates[1].push(negative);
        }
        let places: Vec<_> = marks.iter().map(|mark| plate.fiducials[*mark].position_mm).collect();
        let bounds = self.bounds(laying);
        let tolerance_px = UPPER_TOLERANCE_MM * self.px_per_mm();
        let found = candidates.map(|candidates| agreement(&places, &candidates, &bounds, tolerance_px));
        let polarities = found.into_iter().zip([false, true]);
        let found = polarities.filter_map(|(found, negative)| Some((found?, negative)));
        Ok(found.max_by(|a, b| a.0.score.total_cmp(&b.0.score)))
    }

    /// Candidates of a mark as a positive and as a negative.
    fn upper_candidates(&mut self, look: &Look) -> Result<[Vec<Candidate>; 2], PictureError> {
        let reduction = self.reduction(UPPER_CELL_MM);
        let cell_mm = f64::from(reduction) * self.expectation.pixel_mm;
        let around = (AROUND_MM / cell_mm).round() as usize;
        let (template, correlator) = template(look, reduction, Vector2::zeros(), BLUR_PX);
        let rect = window(look, &template, reduction, self.expectation.pixel_mm, self.picture.size_px());
        let index = match self.looked_at.iter().position(|window| window.rect == rect) {
            Some(index) => index,
            None => {
                let grey = self.picture.window(rect, reduction)?;
                let figures = Figures::of(&grey, around);
                self.looked_at.push(UpperWindow { rect, grey, figures, templates: Vec::new() });
                self.looked_at.len() - 1
            }
        };
        let window = &mut self.looked_at[index];
        let Some((binary, correlator)) = BinaryTemplate::of(&template, around).zip(correlator) else {
            return Ok([Vec::new(), Vec::new()]);
        };
        if let Some((_, known)) = window.templates.iter().find(|(known, _)| *known == binary) {
            return Ok(known.clone());
        }
        let apart = APART_MM / cell_mm;
        let candidates = [(1.0, &window.figures.bright), (-1.0, &window.figures.dark)].map(|(sign, bits)| {
            let surface = binary.correlate(bits);
            let peaks = maxima(&surface, window.grey.width, apart, 3 * UPPER_CANDIDATES);
            best_of(&correlator, &window.grey, &peaks, sign, UPPER_CANDIDATES)
        });
        window.templates.push((binary, candidates.clone()));
        Ok(candidates)
    }

    /// All marks where the first look predicts them, on the middle level.
    pub(super) fn look_closer(&self, first: &FirstLook) -> Result<Finding, PictureError> {
        let FirstLook { laying, negative, similarity: predicted, .. } = *first;
        let plate = self.plate;
        let mut candidates = Vec::new();
        for fiducial in &plate.fiducials {
            candidates.push(self.middle_candidates(&look(fiducial, &predicted, MIDDLE_REACH_MM), negative)?);
        }
        let places: Vec<_> = plate.fiducials.iter().map(|fiducial| fiducial.position_mm).collect();
        let tolerance_px = MIDDLE_TOLERANCE_MM * self.px_per_mm();
        let found = agreement(&places, &candidates, &self.bounds(laying), tolerance_px);
        let marks = |found: &Agreement| {
            let chosen = found.chosen.iter().zip(&candidates);
            chosen.map(|(index, candidates)| index.map(|index| candidates[index])).collect()
        };
        Ok(match found {
            Some(found) => {
                Finding { laying, negative, similarity: found.similarity, marks: marks(&found), score: found.score }
            }
            None => Finding { laying, negative, similarity: predicted, marks: vec![None; places.len()], score: 0.0 },
        })
    }

    fn middle_candidates(&self, look: &Look, negative: bool) -> Result<Vec<Candidate>, PictureError> {
        let reduction = self.reduction(MIDDLE_CELL_MM);
        let cell_mm = f64::from(reduction) * self.expectation.pixel_mm;
        let around = (AROUND_MM / cell_mm).round() as usize;
        let (template, correlator) = template(look, reduction, Vector2::zeros(), BLUR_PX);
        let rect = window(look, &template, reduction, self.expectation.pixel_mm, self.picture.size_px());
        let grey = self.picture.window(rect, reduction)?;
        let Some((binary, correlator)) = BinaryTemplate::of(&template, around).zip(correlator) else {
            return Ok(Vec::new());
        };
        let figures = Figures::of(&grey, around);
        let (sign, bits) = if negative { (-1.0, &figures.dark) } else { (1.0, &figures.bright) };
        let surface = binary.correlate(bits);
        let peaks = maxima(&surface, grey.width, APART_MM / cell_mm / 2.0, 2 * MIDDLE_CANDIDATES);
        Ok(best_of(&correlator, &grey, &peaks, sign, MIDDLE_CANDIDATES))
    }

    /// How well a mark fits about a predicted place on the middle level: the best coefficient and the cells that count.
    pub(super) fn resemblance(
        &self,
        mark: &Mark,
        rotation_rad: f64,
        about_px: Vector2<f64>,
        similarity: &Similarity,
        reach_mm: f64,
        negative: bool,
    ) -> Result<(f64, f64), PictureError> {
        let pixels_from_mark = pixels_from_mark(similarity, rotation_rad);
        let look = Look { mark, pixels_from_mark, about_px, reach_mm };
        let count = template(&look, self.reduction(MIDDLE_CELL_MM), Vector2::zeros(), BLUR_PX).0.count();
        let candidates = self.middle_candidates(&look, negative)?;
        Ok((candidates.iter().map(|c| c.rho).fold(0.0, f64::max), count as f64))
    }
}

/// From a mark's own millimetres to pixels.
pub(super) fn pixels_from_mark(similarity: &Similarity, rotation_rad: f64) -> Matrix2<f64> {
    similarity.linear() * Rotation2::new(rotation_rad).matrix()
}

fn look<'a>(fiducial: &'a Fiducial, similarity: &Similarity, reach_mm: f64) -> Look<'a> {
    Look {
        mark: &fiducial.mark,
        pixels_from_mark: pixels_from_mark(similarity, fiducial.rotation_rad),
        about_px: similarity.apply(fiducial.position_mm),
        reach_mm,
    }
}

fn template(look: &Look, reduction: u32, centre: Vector2<f64>, blur_px: f64) -> (Template, Option<Correlator>) {
    let r = f64::from(reduction);
    let placing = Placing { cells_from_mm: look.pixels_from_mark / r, centre, blur: blur_px / r, core: false };
    let template = Template::draw(look.mark, &placing);
    let correlator = Correlator::new(&template);
    (template, correlator)
}

/// The rectangle of the file in which a mark is looked for, on the raster of the level; what lies beyond the scan is cut
/// off.
fn window(look: &Look, template: &Template, reduction: u32, pixel_mm: f64, size_px: [u32; 2]) -> PixelRect {
    let r = f64::from(reduction);
    let half_px = look.reach_mm / pixel_mm + (template.half as f64 + 2.0) * r;
    let bound = |value: f64, side: u32| {
        let cells = (value / r).round() * r;
        cells.clamp(0.0, f64::from(side)) as u32
    };
    let (x, y) = (look.about_px.x, look.about_px.y);
    let (left, top) = (bound(x - half_px, size_px[0]), bound(y - half_px, size_px[1]));
    let (right, bottom) = (bound(x + half_px, size_px[0]), bound(y + half_px, size_px[1]));
    PixelRect { x: left, y: top, width: right - left, height: bottom - top }
}

/// Local maxima of a surface, the largest first, no two nearer than `apart` cells.
fn maxima(surface: &[f32], width: usize, apart: f64, count: usize) -> Vec<[usize; 2]> {
    let is_maximum = |k: usize| {
        let value = surface[k];
        let near = |k: usize| surface.get(k).is_none_or(|other| *other <= value);
        value >= LEAST_BINARY
            && k > width
            && [k - 1, k + 1, k - width, k + width, k - width - 1, k - width + 1, k + width - 1, k + width + 1]
                .into_iter()
                .all(near)
    };
    let mut places: Vec<usize> = (0..surface.len()).filter(|k| is_maximum(*k)).collect();
    places.sort_by(|a, b| surface[*b].total_cmp(&surface[*a]));
    let mut kept: Vec<[usize; 2]> = Vec::new();
    for [x, y] in places.into_iter().map(|k| [k % width, k / width]) {
        let distance = |other: &[usize; 2]| (other[0].abs_diff(x) as f64).hypot(other[1].abs_diff(y) as f64);
        if kept.iter().all(|other| distance(other) >= apart) {
            kept.push([x, y]);
        }
        if kept.len() == count {
            break;
        }
    }
    kept
}

/// What grey correlation makes of places, the best of them.
fn best_of(
    correlator: &Correlator,
    window: &GreyWindow,
    places: &[[usize; 2]],
    sign: f64,
    count: usize,
) -> Vec<Candidate> {
    let candidate = |place: &[usize; 2]| {
        let (at, fit) = correlator.best(window, *place, 1, sign)?;
        let rho = sign * fit.rho;
        let shift = correlator.peak(window, at, sign).map_or_else(Vector2::zeros, |peak| peak.shift);
        (rho >= LEAST_GREY).then(|| Candidate { at_px: pixel(window, at, shift), rho })
    };
    let mut candidates: Vec<Candidate> = places.iter().filter_map(candidate).collect();
    candidates.sort_by(|a, b| b.rho.total_cmp(&a.rho));
    candidates.truncate(count);
    candidates
}

/// The pixel of the middle of a cell, shifted.
pub(super) fn pixel(window: &GreyWindow, [x, y]: [usize; 2], shift: Vector2<f64>) -> Vector2<f64> {
    let origin = Vector2::from(window.origin_px.map(f64::from));
    origin + (Vector2::new(x as f64 + 0.5, y as f64 + 0.5) + shift) * f64::from(window.reduction)
}
