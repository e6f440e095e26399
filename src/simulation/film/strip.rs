//! Writing: the camera's data strip, words by hand, stamps.

use nalgebra::Vector2;

use super::settings::outwards;
use super::shape::{Blot, Shape};
use crate::interior::Side;
use crate::simulation::draws::{Draws, direction};

/// A line of writing: where it begins, its direction, and how high it is.
#[derive(Debug, Clone, Copy)]
struct Line {
    start_mm: Vector2<f64>,
    along: Vector2<f64>,
    up: Vector2<f64>,
    height_mm: f64,
}

impl Line {
    /// A place in the line, in heights of it.
    fn at(&self, along: f64, up: f64) -> Vector2<f64> {
        self.start_mm + (self.along * along + self.up * up) * self.height_mm
    }
}

/// The segments of a digit of a clock, from one corner to another, in heights.
const SEGMENTS: [[f64; 4]; 7] = [
    [0.0, 0.0, 0.5, 0.0],
    [0.0, 0.5, 0.5, 0.5],
    [0.0, 1.0, 0.5, 1.0],
    [0.0, 0.0, 0.0, 0.5],
    [0.0, 0.5, 0.0, 1.0],
    [0.5, 0.0, 0.5, 0.5],
    [0.5, 0.5, 0.5, 1.0],
];

/// Printed figures, so many of them.
fn printed(line: &Line, count: u32, tone: f32, draws: &mut Draws) -> Vec<Blot> {
    let mut blots = Vec::new();
    for place in 0..count {
        for [x0, y0, x1, y1] in SEGMENTS {
            if draws.chance(0.65) {
                let left = 0.75 * f64::from(place);
                let (from, to) = (line.at(left + x0, y0), line.at(left + x1, y1));
                blots.push(Blot::stroke(from, to, 0.05 * line.height_mm, tone));
            }
        }
    }
    blots
}

/// What a camera writes beside the image, 4 to 12 mm outside of its edge: counters, a clock, lit windows, a note.
pub(super) fn data_strip(side: Side, edge_mm: f64, tone: f32, draws: &mut Draws) -> Vec<Blot> {
    let out = outwards(side);
    let along = -perpendicular(out);
    let mut blots = Vec::new();
    let mut left_mm = draws.between(-100.0, -70.0);
    for _ in 0..4 + draws.below(4) {
        let start_mm = out * (edge_mm + draws.between(5.0, 6.0)) + along * left_mm;
        let length_mm = match draws.below(4) {
            0 => {
                blots.extend(clock(start_mm + out * 2.0 + along * 3.0, tone, draws));
                6.0
            }
            1 => {
                let half_mm = [draws.between(4.0, 10.0), draws.between(1.5, 2.8)];
                let centre_mm = start_mm + along * half_mm[0] + out * 2.2;
                let half = half_mm.map(|half_mm| half_mm as f32);
                blots.push(Blot::new(Shape::Rectangle { half }, centre_mm, 0.7 * tone).turned(along));
                let line = Line { start_mm: start_mm + along + out * 1.4, along, up: out, height_mm: 1.6 };
                blots.extend(printed(&line, (half_mm[0] / 0.8) as u32, 0.05, draws));
                2.0 * half_mm[0]
            }
            _ => {
                let line = Line { start_mm, along, up: out, height_mm: draws.between(2.0, 4.5) };
                let count = 4 + draws.below(10);
                blots.extend(printed(&line, count, tone, draws));
                0.75 * f64::from(count) * line.height_mm
            }
        };
        left_mm += length_mm + draws.between(2.0, 15.0);
        if left_mm > 75.0 {
            break;
        }
    }
    blots
}

/// A dial with two hands.
fn clock(centre_mm: Vector2<f64>, tone: f32, draws: &mut Draws) -> Vec<Blot> {
    let rim = Blot::new(Shape::Ring { radius: 2.7, half_width: 0.12 }, centre_mm, tone);
    let hands = [1.4, 2.1].map(|length_mm| {
        let towards = direction(draws.between(0.0, std::f64::consts::TAU));
        Blot::stroke(centre_mm, centre_mm + towards * length_mm, 0.1, tone)
    });
    let hours = (0..12).map(|hour| {
        let towards = direction(f64::from(hour) * std::f64::consts::FRAC_PI_6);
        Blot::stroke(centre_mm + towards * 2.2, centre_mm + towards * 2.5, 0.05, tone)
    });
    std::iter::once(rim).chain(hands).chain(hours).collect()
}

/// Where somebody writes: along one of the sides, in the border or in the rim of the image.
fn beside_an_edge(half_mm: [f64; 2], height_mm: f64, draws: &mut Draws) -> Line {
    let side = [Side::Left, Side::Right, Side::Top, Side::Bottom][draws.below(4) as usize % 4];
    let out = outwards(side);
    let edge_mm = if matches!(side, Side::Left | Side::Right) { half_mm[0] } else { half_mm[1] };
    let slant = direction(draws.within(0.12));
    let along = -perpendicular(out) * if draws.chance(0.5) { 1.0 } else { -1.0 };
    let along = Vector2::new(slant.x * along.x - slant.y * along.y, slant.y * along.x + slant.x * along.y);
    let start_mm = out * (edge_mm + draws.between(-14.0, 6.0)) + along * draws.between(-110.0, 70.0);
    Line { start_mm, along, up: perpendicular(along), height_mm }
}

/// A word by a thick pen.
pub(super) fn word(half_mm: [f64; 2], draws: &mut Draws) -> Vec<Blot> {
    let height_mm = draws.between(2.5, 7.0);
    let line = beside_an_edge(half_mm, height_mm, draws);
    let tone = if draws.chance(0.6) { 0.03 } else { 0.97 };
    let opacity = draws.between(0.6, 1.0) as f32;
    let half_width_mm = draws.between(0.1, 0.35);
    let mut blots = Vec::new();
    for letter in 0..3 + draws.below(6) {
        let left = 0.8 * f64::from(letter);
        let mut pen = line.at(left + draws.between(0.0, 0.5), draws.between(0.0, 1.0));
        for _ in 0..3 + draws.below(3) {
            let next = line.at(left + draws.between(0.0, 0.6), draws.between(0.0, 1.0));
            blots.push(Blot::stroke(pen, next, half_width_mm, tone).thinned(opacity).softened(0.02));
            pen = next;
        }
    }
    blots
}

/// A frame with two lines of print.
pub(super) fn stamp(half_mm: [f64; 2], draws: &mut Draws) -> Vec<Blot> {
    let line = beside_an_edge(half_mm, draws.between(2.0, 3.5), draws);
    let tone = if draws.chance(0.7) { 0.05 } else { 0.95 };
    let count = 6 + draws.below(8);
    let right = 0.75 * f64::from(count) + 0.5;
    let corners = [[-0.6, -0.7], [right, -0.7], [right, 3.2], [-0.6, 3.2]].map(|[x, y]| line.at(x, y));
    let mut blots: Vec<Blot> =
        (0..4).map(|k| Blot::stroke(corners[k], corners[(k + 1) % 4], 0.05 * line.height_mm, tone)).collect();
    blots.extend(printed(&line, count, tone, draws));
    blots.extend(printed(&Line { start_mm: line.at(0.0, 1.5), ..line }, count, tone, draws));
    let opacity = draws.between(0.4, 0.9) as f32;
    blots.into_iter().map(|blot| blot.thinned(opacity).softened(0.03)).collect()
}

/// A quarter turn counter-clockwise.
fn perpendicular(vector: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-vector.y, vector.x)
}
