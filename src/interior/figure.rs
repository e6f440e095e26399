//! The marks' figures: how bright a mark is at a place, and whether the place belongs to it.

use libm::erf;
use nalgebra::Vector2;

use super::mark::Library;

/// A bright or dark shape; those that come later lie over those before.
#[derive(Debug, Clone, Copy)]
enum Shape {
    /// About the origin.
    Disc { radius: f64 },
    /// About the origin, by the radius of its middle line.
    Ring { radius: f64, width: f64 },
    /// A straight bar: its middle, its direction, and half of its length and width.
    Bar { middle: [f64; 2], along: [f64; 2], half: [f64; 2] },
    /// Where all of these are at least 0: `a x + b y + c`, with (a, b) of unit length; unused ones are `ALWAYS`.
    Convex([[f64; 3]; 4]),
}

const ALWAYS: [f64; 3] = [0.0, 0.0, 1e3];
const DARK: f64 = 0.0;
const BRIGHT: f64 = 1.0;

/// A mark: its ground, its shapes with their brightness, and what belongs to it.
pub(super) struct Figure {
    ground: f64,
    shapes: Vec<(Shape, f64)>,
    care: Vec<Shape>,
    /// Nothing of the mark is farther from its centre than this in x or y.
    pub(super) extent_mm: f64,
    /// Radius of the mark itself, without what surrounds it.
    pub(super) core_mm: f64,
    /// Whether it is nothing but edges between the dark frame and the image, whose brightness is anything: on the lowest
    /// level only a band along them counts.
    pub(super) edges: bool,
}

/// Half width of that band.
pub(super) const EDGE_BAND_MM: f64 = 0.3;

/// The wedge of the RMK: half-width per length from its tip, and where the tip is.
const WEDGE_SLOPE: f64 = 0.6;
const WEDGE_TIP_MM: f64 = -1.6;

impl Figure {
    pub(super) fn of(library: Library) -> Self {
        match library {
            Library::WildRc5 => {
                let arms = [45.0_f64, 135.0, 225.0, 315.0].map(|deg| bright(arm(deg, 0.25, 2.6, 0.14)));
                Self::on_dark(arms.to_vec(), Shape::Disc { radius: 3.2 }, 3.2)
            }
            Library::WildRc10 => {
                let mut shapes = upright_arms(0.35, 2.2, 0.10);
                shapes.push(bright(Shape::Ring { radius: 1.2, width: 0.12 }));
                shapes.push(bright(Shape::Disc { radius: 0.07 }));
                Self::on_dark(shapes, Shape::Disc { radius: 2.6 }, 2.6)
            }
            Library::WildRc20 => {
                let mut shapes = upright_arms(0.4, 1.8, 0.10);
                shapes.push(bright(Shape::Disc { radius: 0.09 }));
                Self::on_dark(shapes, square(2.2), 2.2)
            }
            Library::LeicaRc30 => {
                let mut shapes = upright_arms(0.9, 2.0, 0.10);
                shapes.push(bright(Shape::Ring { radius: 0.6, width: 0.09 }));
                shapes.push(bright(Shape::Disc { radius: 0.08 }));
                Self::on_dark(shapes, Shape::Disc { radius: 2.4 }, 2.4)
            }
            Library::ZeissRmkTop => {
                let mut shapes = upright_arms(0.95, 1.7, 0.08);
                let corners = [[-0.8, -0.8], [0.8, -0.8], [0.8, 0.8], [-0.8, 0.8]];
                let side = |k: usize| bar(corners[k], corners[(k + 1) % 4], 0.08);
                shapes.extend((0..4).map(|k| bright(side(k))));
                shapes.push(bright(Shape::Disc { radius: 0.10 }));
                Self::on_dark(shapes, square(2.0), 2.0)
            }
            Library::ZeissRmk => Self::wedge(),
            Library::FairchildPinhole => Self::pinhole(),
            Library::FairchildWing => Self::wing(),
            Library::Arrow => {
                let shaft = bar([-1.5, 0.0], [0.2, 0.0], 0.5);
                // through (1.5, 0) and (0.2, +-0.9)
                let head = Shape::Convex([
                    [1.0, 0.0, -0.2],
                    line([1.5, 0.0], [0.2, 0.9]),
                    line([0.2, -0.9], [1.5, 0.0]),
                    ALWAYS,
                ]);
                Self::on_dark(vec![bright(shaft), bright(head)], square(2.2), 2.2)
            }
            Library::Bar => {
                let middle = bar([-2.0, 0.0], [2.0, 0.0], 0.6);
                Self::on_dark(vec![bright(middle)], rectangle(-3.0, 3.0, -1.2, 1.2), 3.0)
            }
        }
    }

    fn on_dark(shapes: Vec<(Shape, f64)>, care: Shape, extent_mm: f64) -> Self {
        Self { ground: DARK, shapes, care: vec![care], extent_mm, core_mm: extent_mm, edges: false }
    }

    /// The image beside the wedge is taken as medium grey, and only a band of it counts.
    fn wedge() -> Self {
        let root = WEDGE_SLOPE.hypot(1.0);
        let between = |band_mm: f64| {
            let edge = |sign: f64| [WEDGE_SLOPE / root, sign / root, band_mm - WEDGE_SLOPE * WEDGE_TIP_MM / root];
            Shape::Convex([edge(1.0), edge(-1.0), [-1.0, 0.0, 3.0], ALWAYS])
        };
        let shapes = vec![(between(0.0), DARK), bright(Shape::Disc { radius: 0.12 })];
        Self { ground: 0.5, shapes, care: vec![between(0.5)], extent_mm: 3.5, core_mm: 0.7, edges: false }
    }

    /// What the notch shows is anything, so it does not count; beside the tongue is the image.
    fn pinhole() -> Self {
        let frame = [rectangle(1.0, 2.5, 1.2, 2.4), rectangle(1.0, 2.5, -2.4, -1.2)];
        let tongue = Shape::Disc { radius: 0.9 };
        let shapes = vec![(frame[0], DARK), (frame[1], DARK), (tongue, DARK), bright(Shape::Disc { radius: 0.12 })];
        let care = vec![tongue, frame[0], frame[1], rectangle(-1.3, 0.3, -1.3, 1.3)];
        Self { ground: 0.5, shapes, care, extent_mm: 2.5, core_mm: 0.8, edges: false }
    }

    fn wing() -> Self {
        let root = 0.577_f64.hypot(1.0);
        let dark = Shape::Convex([[1.0 / root, -0.577 / root, 0.0], [1.0 / root, 0.577 / root, 0.0], ALWAYS, ALWAYS]);
        Self {
            ground: 0.6,
            shapes: vec![(dark, DARK)],
            care: vec![Shape::Disc { radius: 2.5 }],
            extent_mm: 2.5,
            core_mm: 2.5,
            edges: true,
        }
    }

    /// The brightness at a place, 0 to 1, under a Gaussian blur.
    pub(super) fn grey(&self, place_mm: Vector2<f64>, blur_mm: f64) -> f64 {
        let over = |grey: f64, (shape, brightness): &(Shape, f64)| {
            grey + shape.covers(place_mm, blur_mm) * (brightness - grey)
        };
        self.shapes.iter().fold(self.ground, over)
    }

    /// Whether a place belongs to the mark.
    pub(super) fn cares(&self, place_mm: Vector2<f64>) -> bool {
        self.care.iter().any(|shape| shape.depth(place_mm) > 0.0)
    }

    /// Whether it belongs to the mark itself, without its surroundings.
    pub(super) fn is_core(&self, place_mm: Vector2<f64>) -> bool {
        let near_edge = || self.shapes.iter().any(|(shape, _)| shape.depth(place_mm).abs() < EDGE_BAND_MM);
        place_mm.norm() <= self.core_mm && (!self.edges || near_edge())
    }
}

fn bright(shape: Shape) -> (Shape, f64) {
    (shape, BRIGHT)
}

fn arm(direction_deg: f64, from: f64, to: f64, width: f64) -> Shape {
    let (sin, cos) = direction_deg.to_radians().sin_cos();
    bar([from * cos, from * sin], [to * cos, to * sin], width)
}

fn bar(from: [f64; 2], to: [f64; 2], width: f64) -> Shape {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let length = dx.hypot(dy);
    Shape::Bar {
        middle: [(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0],
        along: [dx / length, dy / length],
        half: [length / 2.0, width / 2.0],
    }
}

fn upright_arms(from: f64, to: f64, width: f64) -> Vec<(Shape, f64)> {
    [0.0, 90.0, 180.0, 270.0].map(|deg| bright(arm(deg, from, to, width))).to_vec()
}

fn square(half: f64) -> Shape {
    rectangle(-half, half, -half, half)
}

fn rectangle(left: f64, right: f64, bottom: f64, top: f64) -> Shape {
    Shape::Convex([[1.0, 0.0, -left], [-1.0, 0.0, right], [0.0, 1.0, -bottom], [0.0, -1.0, top]])
}

/// The half plane to the left of a line.
fn line(from: [f64; 2], to: [f64; 2]) -> [f64; 3] {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let length = dx.hypot(dy);
    let (a, b) = (-dy / length, dx / length);
    [a, b, -(a * from[0] + b * from[1])]
}

impl Shape {
    /// The share of a blurred point that lies on the shape. Edges are exact where they are straight against the blur.
    fn covers(&self, place: Vector2<f64>, blur: f64) -> f64 {
        let within =
            |from_middle: f64, half: f64| normal((half - from_middle) / blur) - normal((-half - from_middle) / blur);
        match *self {
            Self::Disc { radius } => within(place.norm(), radius),
            Self::Ring { radius, width } => within(place.norm() - radius, width / 2.0),
            Self::Bar { middle, along, half } => {
                let (x, y) = (place.x - middle[0], place.y - middle[1]);
                let across = within(along[0] * y - along[1] * x, half[1]);
                if across > 0.0 { across * within(along[0] * x + along[1] * y, half[0]) } else { 0.0 }
            }
            Self::Convex(_) => normal(self.depth(place) / blur),
        }
    }

    /// Distance from the rim, positive inside.
    fn depth(&self, place: Vector2<f64>) -> f64 {
        match *self {
            Self::Disc { radius } => radius - place.norm(),
            Self::Ring { radius, width } => width / 2.0 - (place.norm() - radius).abs(),
            Self::Bar { middle, along, half } => {
                let (x, y) = (place.x - middle[0], place.y - middle[1]);
                let (s, t) = (along[0] * x + along[1] * y, along[0] * y - along[1] * x);
                (half[0] - s.abs()).min(half[1] - t.abs())
            }
            Self::Convex(sides) => {
                sides.iter().map(|[a, b, c]| a * place.x + b * place.y + c).fold(f64::INFINITY, f64::min)
            }
        }
    }
}

/// Beyond so many standard deviations there is nothing.
const FARTHEST: f64 = 5.0;

/// The normal distribution.
fn normal(deviate: f64) -> f64 {
    if deviate > FARTHEST {
        1.0
    } else if deviate < -FARTHEST {
        0.0
    } else {
        0.5 * (1.0 + erf(deviate * std::f64::consts::FRAC_1_SQRT_2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blurred_bar_has_the_light_of_a_sharp_one() {
        // across the arm of an RC20 mark: its light is its width, whatever the blur
        let figure = Figure::of(Library::WildRc20);
        for blur_mm in [0.005, 0.02, 0.05] {
            let light: f64 =
                (-500..500).map(|k| figure.grey(Vector2::new(1.1, f64::from(k) * 1e-3), blur_mm) * 1e-3).sum();
            assert!((light - 0.10).abs() < 2e-3, "{light}");
        }
    }

    #[test]
    fn figures_are_where_they_are_said_to_be() {
        let sharp = |library, x, y| Figure::of(library).grey(Vector2::new(x, y), 1e-4);
        assert_eq!(sharp(Library::WildRc10, 1.2, 0.3), 1.0);
        assert_eq!(sharp(Library::WildRc10, 1.4, 0.3), 0.0);
        assert_eq!(sharp(Library::WildRc5, 1.0, 1.0), 1.0);
        assert_eq!(sharp(Library::WildRc5, 0.1, 0.1), 0.0);
        // the wedge points to negative x, with image content beside it
        assert_eq!(sharp(Library::ZeissRmk, -1.4, 0.0), 0.0);
        assert_eq!(sharp(Library::ZeissRmk, -1.4, 0.3), 0.5);
        assert_eq!(sharp(Library::ZeissRmk, 0.0, 0.0), 1.0);
        assert_eq!(sharp(Library::FairchildWing, 1.0, 1.0), 0.0);
        assert_eq!(sharp(Library::FairchildWing, 1.0, 2.0), 0.6);
        assert_eq!(sharp(Library::Arrow, 1.3, 0.0), 1.0);
        assert_eq!(sharp(Library::Arrow, 1.3, 0.5), 0.0);
        assert_eq!(sharp(Library::Arrow, 0.3, 0.75), 1.0);
        let pinhole = Figure::of(Library::FairchildPinhole);
        assert!(!pinhole.cares(Vector2::new(1.5, 0.0)) && pinhole.cares(Vector2::new(1.5, 2.0)));
    }
}
