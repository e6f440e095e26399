//! The film with everything on it, as figures in the plate's millimetres.

use nalgebra::Vector2;

use super::camera::{Make, TruePlate};
use super::dirt::{self, Dust};
use super::figures::{Making, figures, placed, reach_mm};
use super::settings::{Corruption, ScanSettings, outwards};
use super::shape::{Blot, Shape};
use super::strip;
use super::tone::Tone;
use super::truth::{MarkState, drawn};
use crate::interior::{Mark, Side};
use crate::simulation::draws::{Draws, Purpose};

/// Long enough for what covers all that is on one side of a line.
const FAR_MM: f64 = 400.0;

/// The film.
#[derive(Debug, Clone)]
pub(super) struct Sheet {
    /// What the light could pass: the frame's opening and notches.
    pub(super) openings: Vec<Blot>,
    /// Grey of what was not exposed.
    pub(super) dark: f32,
    /// The marks and what else was exposed with the image, from the lowest to the uppermost; grey as in a positive.
    pub(super) figures: Vec<Blot>,
    /// What lies over the film, and where it ends.
    pub(super) cover: Vec<Blot>,
    pub(super) dust: Dust,
    /// Where the marks are drawn and where they should be, in the plate.
    pub(super) marks: Vec<SheetMark>,
}

/// A mark on the film.
#[derive(Debug, Clone, Copy)]
pub(super) struct SheetMark {
    pub(super) place_mm: Vector2<f64>,
    pub(super) drawn_mm: Vector2<f64>,
    pub(super) state: MarkState,
}

const SIDES: [Side; 4] = [Side::Left, Side::Right, Side::Top, Side::Bottom];

/// Half the opening along a side's direction.
fn edge_mm(camera: Make, side: Side) -> f64 {
    let [x, y] = camera.opening_mm().map(f64::from);
    if matches!(side, Side::Left | Side::Right) { x } else { y }
}

impl Sheet {
    pub(super) fn draw(settings: &ScanSettings, plate: &TruePlate, tone: &Tone, seed: u64) -> Self {
        let mut draws = Draws::new(seed, Purpose::FilmDirt);
        let half_mm = settings.camera.opening_mm().map(f64::from);
        let tolerance = settings.plate.tolerance;
        let dark = draws.between(0.02, 0.08) as f32;
        let contrast_grey = drawn(settings.scanner.mark_contrast_grey, &mut draws);
        let making = Making {
            widths: 1.0 + draws.within(tolerance),
            radii: 1.0 + draws.within(tolerance),
            rim_mm: draws.between(0.2, 0.7),
            dark,
            bright: tone.above(dark, contrast_grey as f32, settings.negative),
        };
        let mut sheet = Self {
            openings: openings(settings.camera, plate, &mut draws),
            dark,
            figures: Vec::new(),
            cover: Vec::new(),
            dust: Dust {
                seed: draws.below(u32::MAX),
                per_mm2: drawn(settings.dirt.specks_per_mm2, &mut draws),
                half_mm,
            },
            marks: Vec::new(),
        };
        let joined = draws.chance(0.5);
        sheet.put_marks(settings, plate, &making, joined, seed);
        sheet.put_feature(plate, &making);
        if let Some(side) = settings.data_strip {
            let bright = making.bright.max(0.6);
            sheet.figures.extend(strip::data_strip(side, edge_mm(settings.camera, side), bright, &mut draws));
        }
        sheet.put_dirt(settings, &mut draws);
        sheet.put_ends(settings, plate, &mut draws);
        sheet
    }

    /// The part of it that may be felt within a distance of a place.
    pub(super) fn near(&self, centre_mm: Vector2<f64>, radius_mm: f64, sigma_mm: f64) -> Self {
        let felt = |blots: &[Blot]| {
            blots.iter().filter(|blot| blot.is_near(centre_mm, radius_mm, sigma_mm)).copied().collect()
        };
        Self {
            openings: felt(&self.openings),
            dark: self.dark,
            figures: felt(&self.figures),
            cover: felt(&self.cover),
            dust: self.dust,
            marks: Vec::new(),
        }
    }

    fn put_marks(&mut self, settings: &ScanSettings, plate: &TruePlate, making: &Making, joined: bool, seed: u64) {
        let library = settings.camera.figure();
        let reach_mm = reach_mm(library) + making.rim_mm;
        let sigma_mm = settings.strain.sigma_irregular_mm;
        let mut draws = Draws::new(seed, Purpose::FilmStrain);
        for (index, (fiducial, &true_mm)) in plate.known.fiducials.iter().zip(&plate.marks_mm).enumerate() {
            let place_mm = true_mm + Vector2::new(draws.normal(), draws.normal()) * sigma_mm;
            let corruption = settings.corrupt.filter(|&(which, _)| which == index).map(|(_, corruption)| corruption);
            let drawn_mm = match corruption {
                Some(Corruption::Shifted { by_mm }) => place_mm + Vector2::from(by_mm),
                _ => place_mm,
            };
            if joined && settings.camera.has_dark_pieces() {
                self.figures.push(piece(place_mm, reach_mm, settings.camera, making.dark));
            }
            self.figures.extend(placed(figures(library, making), drawn_mm, fiducial.rotation_rad));
            if let Some(corruption) = corruption {
                self.corrupt(corruption, place_mm, reach_mm, seed);
            }
            let state = corruption.map_or(MarkState::Whole, MarkState::Corrupted);
            self.marks.push(SheetMark { place_mm, drawn_mm, state });
        }
    }

    /// Does to a mark what was asked for, but for the shift.
    fn corrupt(&mut self, corruption: Corruption, place_mm: Vector2<f64>, reach_mm: f64, seed: u64) {
        let mut draws = Draws::new(seed, Purpose::FilmCorruption);
        match corruption {
            Corruption::Missing => {
                let ground = Shape::Disc { radius: reach_mm as f32 };
                self.figures.push(Blot::new(ground, place_mm, self.dark));
            }
            Corruption::Covered => self.cover.extend(dirt::blob(place_mm, reach_mm, &mut draws)),
            Corruption::Scratched => self.cover.extend(dirt::scratches_through(place_mm, reach_mm, &mut draws)),
            Corruption::Shifted { .. } => {}
        }
    }

    fn put_feature(&mut self, plate: &TruePlate, making: &Making) {
        if let (Some(feature), Some(true_mm)) = (&plate.known.asymmetric, plate.asymmetric_mm)
            && let Mark::Library(library) = *feature.mark
        {
            self.figures.extend(placed(figures(library, making), true_mm, feature.rotation_rad));
        }
    }

    fn put_dirt(&mut self, settings: &ScanSettings, draws: &mut Draws) {
        let half_mm = settings.camera.opening_mm().map(f64::from);
        let dirt = &settings.dirt;
        let count = |[least, most]: [u32; 2], draws: &mut Draws| least + draws.below(most.saturating_sub(least) + 1);
        for _ in 0..count(dirt.scratches, draws) {
            self.cover.extend(dirt::scratch(half_mm, draws));
        }
        for _ in 0..count(dirt.words, draws) {
            self.cover.extend(strip::word(half_mm, draws));
        }
        for _ in 0..count(dirt.stamps, draws) {
            self.cover.extend(strip::stamp(half_mm, draws));
        }
    }

    /// The ends of the film, and what was cut off it; beyond is the scanner's white or black.
    fn put_ends(&mut self, settings: &ScanSettings, plate: &TruePlate, draws: &mut Draws) {
        let beyond = if draws.chance(0.5) { 1.0 } else { 0.0 };
        let feature_mm = plate.asymmetric_mm;
        for side in SIDES {
            let (ends, at_mm) = (draws.chance(0.6), draws.between(2.0, 8.0));
            let along_the_strip = settings.data_strip.is_some_and(|strip| outwards(strip).dot(&outwards(side)) != 0.0);
            let edge_mm = edge_mm(settings.camera, side);
            let holds_the_feature = feature_mm.is_some_and(|place| place.dot(&outwards(side)) > edge_mm);
            if ends && !along_the_strip && !holds_the_feature {
                self.cover.push(beyond_line(outwards(side), edge_mm + at_mm, beyond));
            }
        }
        if draws.chance(settings.dirt.cut_off) {
            self.cut_off(settings.camera, beyond, draws);
        }
    }

    fn cut_off(&mut self, camera: Make, beyond: f32, draws: &mut Draws) {
        let chosen = draws.below(self.marks.len().max(1) as u32) as usize;
        let Some(place_mm) = self.marks.get(chosen).map(|mark| mark.place_mm) else {
            return;
        };
        let out = place_mm.normalize();
        let at_mm = place_mm.norm() - draws.between(4.0, 12.0);
        self.cover.push(beyond_line(out, at_mm, beyond));
        let reach_mm = reach_mm(camera.figure());
        for mark in &mut self.marks {
            if mark.place_mm.dot(&out) > at_mm - 0.5 * reach_mm {
                mark.state = MarkState::CutOff;
            }
        }
    }
}

/// Everything beyond a line across a direction.
fn beyond_line(out: Vector2<f64>, at_mm: f64, tone: f32) -> Blot {
    let half = [(0.5 * FAR_MM) as f32, FAR_MM as f32];
    Blot::new(Shape::Rectangle { half }, out * (at_mm + 0.5 * FAR_MM), tone).turned(out).softened(0.01)
}

/// The opening of the frame, with a Fairchild's notches beside its pinholes.
fn openings(camera: Make, plate: &TruePlate, draws: &mut Draws) -> Vec<Blot> {
    let soft_mm = draws.between(0.02, 0.08);
    let opening = Shape::Rectangle { half: camera.opening_mm() };
    let mut openings = vec![Blot::new(opening, Vector2::zeros(), 0.0).softened(soft_mm)];
    if camera == Make::FairchildT11 {
        for (fiducial, &place_mm) in plate.known.fiducials.iter().zip(&plate.marks_mm) {
            let notch = Blot::new(Shape::Rectangle { half: [0.85, 1.0] }, Vector2::new(1.65, 0.0), 0.0).softened(0.02);
            openings.extend(placed(vec![notch], place_mm, fiducial.rotation_rad));
        }
    }
    openings
}

/// The dark piece that joins a mark to the frame.
fn piece(place_mm: Vector2<f64>, reach_mm: f64, camera: Make, dark: f32) -> Blot {
    let opening_mm = camera.opening_mm();
    let span = |axis: usize| {
        let (place_mm, edge_mm) = (place_mm[axis], f64::from(opening_mm[axis]) + 1.0);
        let mut bounds = [place_mm - reach_mm, place_mm + reach_mm];
        if place_mm > 0.5 * edge_mm {
            bounds[1] = edge_mm;
        } else if place_mm < -0.5 * edge_mm {
            bounds[0] = -edge_mm;
        }
        bounds
    };
    let [x, y] = [span(0), span(1)];
    let half = [x, y].map(|[low, high]| (0.5 * (high - low)) as f32);
    let centre_mm = Vector2::new(x[0] + x[1], y[0] + y[1]) * 0.5;
    Blot::new(Shape::Rectangle { half }, centre_mm, dark).softened(0.02)
}
