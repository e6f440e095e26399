//! Dust and scratches.

use nalgebra::Vector2;

use super::shape::{Blot, Shape};
use crate::simulation::draws::{Draws, direction, hash};

/// Specks and fibres all over the scan. They are nowhere listed: those of a square millimetre follow from its place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Dust {
    pub(super) seed: u32,
    pub(super) per_mm2: f64,
    /// Half the width and height of the image; beyond it there is more dust.
    pub(super) half_mm: [f64; 2],
}

/// No speck reaches farther than this from where it begins.
const REACH_MM: f64 = 0.7;

impl Dust {
    /// What may be felt within a distance of a place.
    pub(super) fn near(&self, centre_mm: Vector2<f64>, radius_mm: f64) -> Vec<Blot> {
        let mut found = Vec::new();
        if self.per_mm2 <= 0.0 {
            return found;
        }
        let cells = |at: f64| {
            let bound = |at: f64| at.floor() as i32;
            bound(at - radius_mm - REACH_MM)..=bound(at + radius_mm + REACH_MM)
        };
        for j in cells(centre_mm.y) {
            for i in cells(centre_mm.x) {
                self.of_cell(i, j, &mut found);
            }
        }
        found
    }

    fn of_cell(&self, i: i32, j: i32, found: &mut Vec<Blot>) {
        let outside = f64::from(i).abs() > self.half_mm[0] || f64::from(j).abs() > self.half_mm[1];
        let expected = if outside { 3.0 * self.per_mm2 } else { self.per_mm2 };
        let count = (expected + share(hash(i, j, self.seed))) as u32;
        for k in 0..count {
            let place = |part: u32| share(hash(i, j, self.seed.wrapping_add(16 * k + part + 1)));
            let centre_mm = Vector2::new(f64::from(i) + place(0), f64::from(j) + place(1));
            let kind = place(2);
            let tone = if place(3) < 0.6 { 0.02 } else { 0.98 };
            let opacity = (0.5 + 0.5 * place(4)) as f32;
            let blot = if kind < 0.15 {
                let towards = direction(std::f64::consts::TAU * place(5)) * (0.1 + 0.5 * place(6));
                Blot::stroke(centre_mm - 0.5 * towards, centre_mm + 0.5 * towards, 0.007 + 0.01 * place(7), tone)
            } else {
                // mostly small: from 10 to 150 micrometres
                let radius = (0.01 * libm::exp(2.7 * place(5) * place(5))) as f32;
                Blot::new(Shape::Disc { radius }, centre_mm, tone).softened(0.004)
            };
            found.push(blot.thinned(opacity));
        }
    }
}

fn share(hash: u32) -> f64 {
    f64::from(hash) / (f64::from(u32::MAX) + 1.0)
}

/// A long thin scratch anywhere.
pub(super) fn scratch(half_mm: [f64; 2], draws: &mut Draws) -> Vec<Blot> {
    let tone = if draws.chance(0.6) { 0.98 } else { 0.02 };
    let opacity = draws.between(0.3, 1.0) as f32;
    let half_width_mm = draws.between(0.004, 0.03);
    let mut pen = Vector2::new(draws.within(half_mm[0] + 5.0), draws.within(half_mm[1] + 5.0));
    let mut angle_rad = draws.between(0.0, std::f64::consts::TAU);
    let piece_mm = draws.between(3.0, 40.0);
    let mut blots = Vec::new();
    for _ in 0..1 + draws.below(4) {
        let next = pen + direction(angle_rad) * piece_mm;
        blots.push(Blot::stroke(pen, next, half_width_mm, tone).thinned(opacity));
        (pen, angle_rad) = (next, angle_rad + draws.within(0.2));
    }
    blots
}

/// Scratches through a mark.
pub(super) fn scratches_through(centre_mm: Vector2<f64>, reach_mm: f64, draws: &mut Draws) -> Vec<Blot> {
    let scratch = |_| {
        let along = direction(draws.between(0.0, std::f64::consts::TAU));
        let middle = centre_mm + Vector2::new(-along.y, along.x) * draws.within(0.7 * reach_mm);
        let tone = if draws.chance(0.6) { 0.98 } else { 0.02 };
        let half_width_mm = draws.between(0.02, 0.15);
        Blot::stroke(middle - along * reach_mm * 1.2, middle + along * reach_mm * 1.2, half_width_mm, tone)
    };
    (0..16).map(scratch).collect()
}

/// A blob that hides a mark.
pub(super) fn blob(centre_mm: Vector2<f64>, reach_mm: f64, draws: &mut Draws) -> Vec<Blot> {
    let tone = if draws.chance(0.5) { 1.0 } else { 0.0 };
    let disc =
        |centre_mm, radius_mm: f64| Blot::new(Shape::Disc { radius: radius_mm as f32 }, centre_mm, tone).softened(0.02);
    let mut blots = vec![disc(centre_mm, 1.05 * reach_mm)];
    for _ in 0..5 {
        let off = direction(draws.between(0.0, std::f64::consts::TAU)) * reach_mm * draws.between(0.4, 1.0);
        blots.push(disc(centre_mm + off, reach_mm * draws.between(0.3, 0.7)));
    }
    blots
}
