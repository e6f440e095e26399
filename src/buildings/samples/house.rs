//! Houses, in metres in the town.

use crate::buildings::model::{EdgeKind, RoofEdge};

use super::Town;

pub(super) type Point = [f64; 3];

/// Houses in a row of the grid.
const ROW: u64 = 2_000;
const SPACING_M: f64 = 30.0;

/// A part of a house with one roof.
#[derive(Debug)]
pub(super) struct Body {
    /// The rings of the roof's polygons; none has a hole.
    pub(super) roof: Vec<Vec<Point>>,
    /// The ring on the ground.
    pub(super) ground: Vec<Point>,
    /// The edges that must be found.
    pub(super) edges: Vec<RoofEdge>,
    /// The height at which LoD 1 puts the roof.
    pub(super) mean_height_m: f64,
}

/// A house: one body, or two that are its parts.
#[derive(Debug)]
pub(super) struct House {
    pub(super) bodies: Vec<Body>,
}

/// SplitMix64: a few draws a house, from its number alone.
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    fn between(&mut self, least: f64, most: f64) -> f64 {
        least + (most - least) * ((self.next() >> 11) as f64 / (1_u64 << 53) as f64)
    }
}

impl House {
    /// The house of a number.
    pub(super) fn of(town: Town, number: u64) -> Self {
        let mut draws = Draws(town.seed ^ number.wrapping_mul(0xd134_2543_de82_ef95));
        let kind = draws.next() % 5;
        let (length, width) = (draws.between(11.0, 15.0), draws.between(6.0, 9.0));
        let (eaves, rise) = (draws.between(3.0, 9.0), draws.between(2.5, 4.5));
        let size = [length, width, eaves, rise];
        let mut bodies = match kind {
            0 => vec![gable(size)],
            1 => vec![hip(size)],
            2 => vec![flat(size)],
            3 => vec![angled(size)],
            _ => vec![gable(size), annex(size)],
        };
        let place = Place {
            origin: [(number % ROW) as f64 * SPACING_M, (number / ROW) as f64 * SPACING_M, draws.between(40.0, 90.0)],
            angle: draws.between(0.0, std::f64::consts::TAU),
        };
        bodies.iter_mut().for_each(|body| place.body(body));
        Self { bodies }
    }

    /// The walls: below every outer edge one, down to the ground.
    pub(super) fn walls(body: &Body) -> impl Iterator<Item = Vec<Point>> + '_ {
        let ground = body.ground[0][2];
        body.edges.iter().filter(|edge| matches!(edge.kind, EdgeKind::Eave | EdgeKind::Gable | EdgeKind::Rim)).map(
            move |edge| {
                let down = |point: Point| [point[0], point[1], ground];
                vec![down(edge.start), down(edge.end), edge.end, edge.start]
            },
        )
    }
}

/// Where a house stands.
struct Place {
    origin: Point,
    angle: f64,
}

impl Place {
    fn point(&self, [x, y, z]: Point) -> Point {
        let (sin, cos) = self.angle.sin_cos();
        [self.origin[0] + cos * x - sin * y, self.origin[1] + sin * x + cos * y, self.origin[2] + z]
    }

    fn body(&self, body: &mut Body) {
        body.roof.iter_mut().flatten().chain(&mut body.ground).for_each(|point| *point = self.point(*point));
        for edge in &mut body.edges {
            (edge.start, edge.end) = (self.point(edge.start), self.point(edge.end));
        }
        body.mean_height_m += self.origin[2];
    }
}

fn edges(list: &[(EdgeKind, Point, Point)]) -> Vec<RoofEdge> {
    list.iter().map(|(kind, start, end)| RoofEdge { kind: *kind, start: *start, end: *end }).collect()
}

/// The corners at the eaves, from the origin around.
fn corners([length, width, eaves, _]: [f64; 4]) -> [Point; 4] {
    [[0.0, 0.0, eaves], [length, 0.0, eaves], [length, width, eaves], [0.0, width, eaves]]
}

fn on_ground(ring: &[Point]) -> Vec<Point> {
    ring.iter().rev().map(|[x, y, _]| [*x, *y, 0.0]).collect()
}

fn gable(size: [f64; 4]) -> Body {
    let [length, width, eaves, rise] = size;
    let [a, b, c, d] = corners(size);
    let (e, f) = ([0.0, width / 2.0, eaves + rise], [length, width / 2.0, eaves + rise]);
    use EdgeKind::{Eave, Gable, Ridge};
    Body {
        roof: vec![vec![a, b, f, e], vec![c, d, e, f]],
        ground: on_ground(&[a, b, c, d]),
        edges: edges(&[
            (Eave, a, b),
            (Eave, c, d),
            (Ridge, e, f),
            (Gable, a, e),
            (Gable, e, d),
            (Gable, b, f),
            (Gable, f, c),
        ]),
        mean_height_m: eaves + rise / 2.0,
    }
}

fn hip(size: [f64; 4]) -> Body {
    let [length, width, eaves, rise] = size;
    let [a, b, c, d] = corners(size);
    let half = width / 2.0;
    let (e, f) = ([half, half, eaves + rise], [length - half, half, eaves + rise]);
    use EdgeKind::{Eave, Hip, Ridge};
    Body {
        roof: vec![vec![a, b, f, e], vec![c, d, e, f], vec![b, c, f], vec![d, a, e]],
        ground: on_ground(&[a, b, c, d]),
        edges: edges(&[
            (Eave, a, b),
            (Eave, b, c),
            (Eave, c, d),
            (Eave, d, a),
            (Ridge, e, f),
            (Hip, a, e),
            (Hip, d, e),
            (Hip, b, f),
            (Hip, c, f),
        ]),
        mean_height_m: eaves + rise / 2.0,
    }
}

fn flat(size: [f64; 4]) -> Body {
    let ring = corners(size);
    flat_on(ring)
}

fn flat_on(ring: [Point; 4]) -> Body {
    let [a, b, c, d] = ring;
    let rims = [(a, b), (b, c), (c, d), (d, a)].map(|(start, end)| (EdgeKind::Rim, start, end));
    Body { roof: vec![ring.to_vec()], ground: on_ground(&ring), edges: edges(&rims), mean_height_m: a[2] }
}

/// A lower building with a flat roof against the back wall.
fn annex([length, width, eaves, _]: [f64; 4]) -> Body {
    let (low, depth) = (eaves * 0.6, 5.0);
    flat_on([
        [1.0, width, low],
        [length - 2.0, width, low],
        [length - 2.0, width + depth, low],
        [1.0, width + depth, low],
    ])
}

/// A main roof and a lower wing, whose ridge runs into the slope.
fn angled(size: [f64; 4]) -> Body {
    let [length, width, eaves, rise] = size;
    let main = gable(size);
    let [a, b, c, d] = corners(size);
    let (e, f) = ([0.0, width / 2.0, eaves + rise], [length, width / 2.0, eaves + rise]);
    let (middle, half, out) = (length / 2.0, width * 0.3, -7.0);
    // the ridge of the wing is so high that it meets the main slope at 0.7 of its way up
    let (meet, top) = ([middle, width * 0.35, eaves + rise * 0.7], [middle, out, eaves + rise * 0.7]);
    let (p, q) = ([middle - half, 0.0, eaves], [middle + half, 0.0, eaves]);
    let (r, s) = ([middle - half, out, eaves], [middle + half, out, eaves]);
    use EdgeKind::{Eave, Gable, Ridge, Valley};
    Body {
        roof: vec![vec![a, p, meet, q, b, f, e], vec![c, d, e, f], vec![r, top, meet, p], vec![s, q, meet, top]],
        ground: on_ground(&[a, p, r, s, q, b, c, d]),
        edges: edges(&[
            (Eave, a, p),
            (Eave, q, b),
            (Eave, c, d),
            (Ridge, e, f),
            (Gable, a, e),
            (Gable, e, d),
            (Gable, b, f),
            (Gable, f, c),
            (Valley, p, meet),
            (Valley, q, meet),
            (Ridge, top, meet),
            (Eave, p, r),
            (Eave, q, s),
            (Gable, r, top),
            (Gable, top, s),
        ]),
        mean_height_m: main.mean_height_m,
    }
}
