//! Plain figures with soft edges: how much of a small blurred spot each one covers.
//!
//! The blur is worked out, not sampled: a straight edge under a Gaussian is the normal distribution's integral, and a
//! rectangle a product of two such. A spot may therefore be a pixel or a part of a reduced cell.

use std::sync::LazyLock;

use nalgebra::Vector2;

/// Beyond so many standard deviations an edge is not felt.
const FELT_SIGMAS: f64 = 3.5;

const STEPS_PER_SIGMA: f32 = 64.0;
const STEP_REACH: f32 = 4.0;

/// The integral of the normal distribution from -4 to 4.
static INTEGRAL: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let count = (2.0 * STEP_REACH * STEPS_PER_SIGMA) as u32 + 2;
    let at = |k: u32| f64::from(k) / f64::from(STEPS_PER_SIGMA) - f64::from(STEP_REACH);
    (0..count).map(|k| (0.5 * libm::erfc(-at(k) / std::f64::consts::SQRT_2)) as f32).collect()
});

/// Places and weights that stand for a normal distribution of standard deviation 1, by Gauss and Hermite.
const NORMAL_NODES: [(f32, f32); 7] = [
    (0.0, 0.457_142_87),
    (1.154_405_4, 0.240_123_18),
    (-1.154_405_4, 0.240_123_18),
    (2.366_759_4, 0.030_757_124),
    (-2.366_759_4, 0.030_757_124),
    (3.750_44, 0.000_548_268_86),
    (-3.750_44, 0.000_548_268_86),
];

/// How much of a blurred edge lies within, `z` standard deviations inside it.
fn step(z: f32) -> f32 {
    let place = (z + STEP_REACH) * STEPS_PER_SIGMA;
    if place <= 0.0 {
        return 0.0;
    }
    let index = place as usize;
    match INTEGRAL.get(index..index + 2) {
        Some(&[below, above]) => below + (place - index as f32) * (above - below),
        _ => 1.0,
    }
}

/// A blurred strip of a half width, `x` beside its centre line.
fn strip(x: f32, half_mm: f32, per_sigma: f32) -> f32 {
    step((x + half_mm) * per_sigma) - step((x - half_mm) * per_sigma)
}

/// A figure about its own origin; millimetres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Shape {
    Disc {
        radius: f32,
    },
    /// `radius` of the centre line.
    Ring {
        radius: f32,
        half_width: f32,
    },
    Rectangle {
        half: [f32; 2],
    },
    /// The outline of a square; `half` its half side along the centre line.
    Outline {
        half: f32,
        half_width: f32,
    },
    /// What lies between the lines `y = ±slope x`, from the tip at the origin to `x = length`.
    Wedge {
        slope: f32,
        length: f32,
    },
    /// A stroke with round ends along x.
    Line {
        half_length: f32,
        half_width: f32,
    },
}

impl Shape {
    /// How far a place lies inside, at most; outside negative, and there not farther than the figure really is.
    fn depth_mm(&self, x: f32, y: f32) -> f32 {
        match *self {
            Self::Disc { radius } => radius - (x * x + y * y).sqrt(),
            Self::Ring { radius, half_width } => half_width - ((x * x + y * y).sqrt() - radius).abs(),
            Self::Rectangle { half } => (half[0] - x.abs()).min(half[1] - y.abs()),
            Self::Outline { half, half_width } => half_width - (x.abs().max(y.abs()) - half).abs(),
            Self::Wedge { slope, length } => (length - x).min((slope * x - y.abs()) / (1.0 + slope * slope).sqrt()),
            Self::Line { half_length, half_width } => half_width - beyond_line(x, y, half_length),
        }
    }

    /// The share of a spot with a Gaussian of standard deviation `1 / per_sigma` that the figure covers.
    fn coverage(&self, x: f32, y: f32, per_sigma: f32) -> f32 {
        match *self {
            Self::Disc { radius } => disc(x * x + y * y, radius, per_sigma),
            Self::Ring { radius, half_width } => strip((x * x + y * y).sqrt() - radius, half_width, per_sigma),
            Self::Rectangle { half } => strip(x, half[0], per_sigma) * strip(y, half[1], per_sigma),
            Self::Outline { half, half_width } => {
                let square = |half: f32| strip(x, half, per_sigma) * strip(y, half, per_sigma);
                square(half + half_width) - square(half - half_width)
            }
            Self::Wedge { slope, length } => wedge(x, y, slope, per_sigma) * step((length - x) * per_sigma),
            Self::Line { half_length, half_width } => strip(beyond_line(x, y, half_length), half_width, per_sigma),
        }
    }
}

fn beyond_line(x: f32, y: f32, half_length: f32) -> f32 {
    let past = (x.abs() - half_length).max(0.0);
    (past * past + y * y).sqrt()
}

/// A disc; one that is small against the blur becomes a bell of the same content.
fn disc(distance_squared: f32, radius: f32, per_sigma: f32) -> f32 {
    if radius * per_sigma > 1.5 {
        return step((radius - distance_squared.sqrt()) * per_sigma);
    }
    let variance = 1.0 / (per_sigma * per_sigma) + 0.25 * radius * radius;
    let exponent = 0.5 * distance_squared / variance;
    if exponent > 8.0 { 0.0 } else { 0.5 * radius * radius / variance * libm::expf(-exponent) }
}

/// Far from its tip a wedge is what lies within two edges; close to it the blur is summed up across.
fn wedge(x: f32, y: f32, slope: f32, per_sigma: f32) -> f32 {
    let inside = |x: f32, y: f32| (slope * x - y.abs()) * per_sigma;
    let hypotenuse = (1.0 + slope * slope).sqrt();
    if x * per_sigma > 5.0 * hypotenuse / slope.min(1.0) {
        return step(inside(x, y) / hypotenuse);
    }
    NORMAL_NODES.iter().map(|&(node, weight)| weight * step(inside(x, y + node / per_sigma) / slope)).sum()
}

/// A figure at its place on the film.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Blot {
    pub(super) shape: Shape,
    pub(super) centre_mm: Vector2<f64>,
    /// The direction of the figure's own x axis.
    pub(super) axis: Vector2<f64>,
    /// What it makes of what lies under it: 0 for black to 1 for white.
    pub(super) tone: f32,
    /// 1 where nothing shines through.
    pub(super) opacity: f32,
    /// Standard deviation of its own blur.
    pub(super) softness_mm: f64,
}

impl Blot {
    /// An upright figure that nothing shines through.
    pub(super) fn new(shape: Shape, centre_mm: Vector2<f64>, tone: f32) -> Self {
        Self { shape, centre_mm, axis: Vector2::x(), tone, opacity: 1.0, softness_mm: 0.0 }
    }

    pub(super) fn turned(self, axis: Vector2<f64>) -> Self {
        Self { axis, ..self }
    }

    pub(super) fn softened(self, softness_mm: f64) -> Self {
        Self { softness_mm, ..self }
    }

    pub(super) fn thinned(self, opacity: f32) -> Self {
        Self { opacity, ..self }
    }

    /// A stroke between two places.
    pub(super) fn stroke(from_mm: Vector2<f64>, to_mm: Vector2<f64>, half_width_mm: f64, tone: f32) -> Self {
        let along = to_mm - from_mm;
        let length = along.norm();
        let shape = Shape::Line { half_length: (0.5 * length) as f32, half_width: half_width_mm as f32 };
        let axis = if length > 0.0 { along / length } else { Vector2::x() };
        Self::new(shape, 0.5 * (from_mm + to_mm), tone).turned(axis)
    }

    fn own(&self, place_mm: Vector2<f64>) -> [f32; 2] {
        let off = place_mm - self.centre_mm;
        [self.axis.dot(&off) as f32, self.axis.perp(&off) as f32]
    }

    /// How far a place lies inside; outside negative.
    fn depth_mm(&self, place_mm: Vector2<f64>) -> f64 {
        let [x, y] = self.own(place_mm);
        f64::from(self.shape.depth_mm(x, y))
    }

    /// Whether it may be felt within a distance of a place, seen with a blur.
    pub(super) fn is_near(&self, centre_mm: Vector2<f64>, radius_mm: f64, picture_sigma_mm: f64) -> bool {
        self.depth_mm(centre_mm) > -(radius_mm + FELT_SIGMAS * self.sigma_mm(picture_sigma_mm))
    }

    /// Whether it covers everything within a distance of a place.
    pub(super) fn fills(&self, centre_mm: Vector2<f64>, radius_mm: f64, picture_sigma_mm: f64) -> bool {
        self.depth_mm(centre_mm) > radius_mm + FELT_SIGMAS * self.sigma_mm(picture_sigma_mm)
    }

    /// The blur of its edges in a picture with such a blur.
    fn sigma_mm(&self, picture_sigma_mm: f64) -> f64 {
        (picture_sigma_mm.powi(2) + self.softness_mm.powi(2)).sqrt()
    }
}

/// A figure made ready for a picture's blur.
#[derive(Debug, Clone, Copy)]
pub(super) struct Brush {
    blot: Blot,
    per_sigma: f32,
}

impl Brush {
    pub(super) fn new(blot: &Blot, picture_sigma_mm: f64) -> Self {
        Self { blot: *blot, per_sigma: (1.0 / blot.sigma_mm(picture_sigma_mm)) as f32 }
    }

    pub(super) fn coverage(&self, place_mm: Vector2<f64>) -> f32 {
        let [x, y] = self.blot.own(place_mm);
        self.blot.shape.coverage(x, y, self.per_sigma)
    }

    /// What the figure makes of a grey value.
    pub(super) fn over(&self, grey: f32, place_mm: Vector2<f64>) -> f32 {
        grey + self.coverage(place_mm) * self.blot.opacity * (self.blot.tone - grey)
    }
}
