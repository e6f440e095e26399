//! The marks as figures on the film.
//!
//! They are drawn by shapes of their own, from the same descriptions as the finder's templates but by no code of theirs.

use nalgebra::Vector2;

use super::shape::{Blot, Shape};
use crate::interior::Library;
use crate::simulation::draws::direction;

/// By how much a camera's marks differ from the design.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Making {
    /// Factor of all line widths.
    pub(super) widths: f64,
    /// Factor of the radii of dots and rings.
    pub(super) radii: f64,
    /// By how much the dark ground of a mark reaches beyond what belongs to the mark.
    pub(super) rim_mm: f64,
    /// Grey of ground and figure, 0 for black to 1 for white.
    pub(super) dark: f32,
    pub(super) bright: f32,
}

/// A mark's figures about its own origin, from the lowest to the uppermost.
pub(super) fn figures(library: Library, making: &Making) -> Vec<Blot> {
    let pen = Pen { making: *making };
    match library {
        Library::WildRc5 => {
            let bars = (0..4).map(|k| pen.arm(std::f64::consts::FRAC_PI_4 * f64::from(2 * k + 1), 0.25, 2.6, 0.14));
            std::iter::once(pen.ground_disc(3.2)).chain(bars).collect()
        }
        Library::WildRc10 => pen.cross(pen.ground_disc(2.6), [0.35, 2.2, 0.10], 0.07, Some([1.2, 0.12])),
        Library::WildRc20 => pen.cross(pen.ground_square(2.2), [0.4, 1.8, 0.10], 0.09, None),
        Library::LeicaRc30 => pen.cross(pen.ground_disc(2.4), [0.9, 2.0, 0.10], 0.08, Some([0.6, 0.09])),
        Library::ZeissRmk => {
            // longer than it is seen: it stays joined to the frame where it is shifted
            let wedge = Shape::Wedge { slope: 0.6, length: 8.0 };
            vec![Blot::new(wedge, Vector2::new(-1.6, 0.0), making.dark), pen.dot(0.12)]
        }
        Library::ZeissRmkTop => {
            let mut figures = pen.cross(pen.ground_square(2.0), [0.95, 1.7, 0.08], 0.10, None);
            let outline = Shape::Outline { half: 0.8, half_width: (0.5 * 0.08 * making.widths) as f32 };
            figures.push(Blot::new(outline, Vector2::zeros(), making.bright));
            figures
        }
        Library::FairchildPinhole => {
            let tongue = Shape::Disc { radius: 0.9 };
            vec![Blot::new(tongue, Vector2::zeros(), making.dark), pen.dot(0.12)]
        }
        Library::FairchildWing => {
            let wing = Shape::Wedge { slope: (1.0 / 0.577) as f32, length: 8.0 };
            vec![Blot::new(wing, Vector2::zeros(), making.dark)]
        }
        Library::Arrow => vec![pen.ground_square(2.2), pen.head(), pen.bar([-1.5, 0.2], 0.25)],
        Library::Bar => vec![pen.ground([3.0, 1.2]), pen.bar([-2.0, 2.0], 0.3)],
    }
}

/// What a mark is drawn with.
struct Pen {
    making: Making,
}

impl Pen {
    fn ground_disc(&self, radius_mm: f64) -> Blot {
        let shape = Shape::Disc { radius: (radius_mm + self.making.rim_mm) as f32 };
        Blot::new(shape, Vector2::zeros(), self.making.dark)
    }

    fn ground_square(&self, half_mm: f64) -> Blot {
        self.ground([half_mm, half_mm])
    }

    fn ground(&self, half_mm: [f64; 2]) -> Blot {
        let half = half_mm.map(|half_mm| (half_mm + self.making.rim_mm) as f32);
        Blot::new(Shape::Rectangle { half }, Vector2::zeros(), self.making.dark)
    }

    fn dot(&self, radius_mm: f64) -> Blot {
        let shape = Shape::Disc { radius: (radius_mm * self.making.radii) as f32 };
        Blot::new(shape, Vector2::zeros(), self.making.bright)
    }

    /// A bright bar along a direction, from one distance to another.
    fn arm(&self, angle_rad: f64, from_mm: f64, to_mm: f64, width_mm: f64) -> Blot {
        let axis = direction(angle_rad);
        let half = [0.5 * (to_mm - from_mm), 0.5 * width_mm * self.making.widths].map(|half_mm| half_mm as f32);
        Blot::new(Shape::Rectangle { half }, axis * (0.5 * (from_mm + to_mm)), self.making.bright).turned(axis)
    }

    /// A dot within an upright cross and perhaps a ring (radius, width).
    fn cross(&self, ground: Blot, [from, to, width]: [f64; 3], dot: f64, ring: Option<[f64; 2]>) -> Vec<Blot> {
        let mut figures = vec![ground];
        figures.extend(ring.map(|[radius, width]| {
            let radius = (radius * self.making.radii) as f32;
            let half_width = (0.5 * width * self.making.widths) as f32;
            Blot::new(Shape::Ring { radius, half_width }, Vector2::zeros(), self.making.bright)
        }));
        figures.extend((0..4).map(|k| self.arm(std::f64::consts::FRAC_PI_2 * f64::from(k), from, to, width)));
        figures.push(self.dot(dot));
        figures
    }

    /// A bright bar along x.
    fn bar(&self, [from, to]: [f64; 2], half_width_mm: f64) -> Blot {
        self.arm(0.0, from, to, 2.0 * half_width_mm)
    }

    /// The head of the arrow, which points to +x.
    fn head(&self) -> Blot {
        let shape = Shape::Wedge { slope: (0.9 / 1.3) as f32, length: 1.3 };
        Blot::new(shape, Vector2::new(1.5, 0.0), self.making.bright).turned(-Vector2::x())
    }
}

/// Figures about an origin, brought to their place.
pub(super) fn placed(figures: Vec<Blot>, place_mm: Vector2<f64>, rotation_rad: f64) -> impl Iterator<Item = Blot> {
    let x = direction(rotation_rad);
    let turned = move |v: Vector2<f64>| Vector2::new(x.x * v.x - x.y * v.y, x.y * v.x + x.x * v.y);
    figures.into_iter().map(move |blot| Blot {
        centre_mm: place_mm + turned(blot.centre_mm),
        axis: turned(blot.axis),
        ..blot
    })
}

/// How far what belongs to a mark reaches from its centre.
pub(super) fn reach_mm(library: Library) -> f64 {
    match library {
        Library::WildRc5 => 3.2,
        Library::WildRc10 => 2.6,
        Library::WildRc20 | Library::Arrow => 3.1,
        Library::LeicaRc30 => 2.4,
        Library::ZeissRmk | Library::Bar => 3.3,
        Library::ZeissRmkTop => 2.9,
        Library::FairchildPinhole | Library::FairchildWing => 2.6,
    }
}
