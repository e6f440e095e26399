//! Does the sun reach a point? Everything is decided in the sun's own parallel projection, so that shadows fall
//! rightly on any surface.

use nalgebra::{Vector2, Vector3};

use super::surface::{Face, Puff};

/// A shadow's owner must be so much nearer to the sun than the point: surfaces do not shade themselves, nor what lies
/// flat on them.
const CLEARANCE_M: f64 = 0.06;

const CELL_M: f64 = 6.0;

/// Places in the sun's projection: two across the rays, and the height towards the sun.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facing {
    across: Vector2<f64>,
    height_m: f64,
}

struct Caster {
    low: Vector2<f64>,
    high: Vector2<f64>,
    highest_m: f64,
    shape: Shape,
}

enum Shape {
    /// Sides (not negative inside) and height, as linear forms of `(across, 1)`.
    Polygon {
        sides: Vec<Vector3<f64>>,
        height: Vector3<f64>,
    },
    Ball {
        centre: Facing,
        radius_m: f64,
    },
}

impl Caster {
    fn shades(&self, point: &Facing) -> bool {
        let p = point.across;
        if p.x < self.low.x || p.x > self.high.x || p.y < self.low.y || p.y > self.high.y {
            return false;
        }
        let height_m = match &self.shape {
            Shape::Polygon { sides, height } => {
                let place = p.push(1.0);
                if sides.iter().any(|side| side.dot(&place) < 0.0) {
                    return false;
                }
                height.dot(&place)
            }
            Shape::Ball { centre, radius_m } => {
                let aside = radius_m * radius_m - (p - centre.across).norm_squared();
                if aside < 0.0 {
                    return false;
                }
                centre.height_m + aside.sqrt()
            }
        };
        height_m > point.height_m + CLEARANCE_M
    }
}

/// All that casts shadows.
pub(crate) struct Sunlight {
    axes: [Vector3<f64>; 3],
    casters: Vec<Caster>,
    /// The casters over each cell of a raster in the sun's projection.
    cells: Vec<Vec<u32>>,
    first_cell: Vector2<f64>,
    columns: usize,
    rows: usize,
}

impl Sunlight {
    pub(crate) fn new(to_sun: Vector3<f64>, faces: &[Face], puffs: &[Puff]) -> Self {
        let axes = axes_across(to_sun);
        let mut casters: Vec<Caster> =
            faces.iter().filter(|face| face.casts_shadow).filter_map(|face| polygon(face, &axes)).collect();
        casters.extend(puffs.iter().map(|puff| ball(puff, &axes)));
        let zero = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        let (low, high) = casters.iter().fold(zero, |(low, high), c| (low.inf(&c.low), high.sup(&c.high)));
        let extent = if casters.is_empty() { Vector2::zeros() } else { (high - low) / CELL_M };
        let (columns, rows) = (extent.x as usize + 1, extent.y as usize + 1);
        let mut light =
            Self { axes, casters: Vec::new(), cells: vec![Vec::new(); columns * rows], first_cell: low, columns, rows };
        for (index, caster) in casters.iter().enumerate() {
            for cell in light.cells_between(caster.low, caster.high) {
                light.cells[cell].push(index as u32);
            }
        }
        light.casters = casters;
        light
    }

    pub(crate) fn facing(&self, point_m: &Vector3<f64>) -> Facing {
        project(point_m, &self.axes)
    }

    /// For each point whether the sun reaches it; the points should lie near together.
    pub(crate) fn reaches(&self, points: &[Facing]) -> Vec<bool> {
        let mut reached = vec![true; points.len()];
        let none = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY), f64::INFINITY);
        let (low, high, lowest_m) = points.iter().fold(none, |(low, high, lowest), point| {
            (low.inf(&point.across), high.sup(&point.across), lowest.min(point.height_m))
        });
        let mut near: Vec<u32> =
            self.cells_between(low, high).flat_map(|cell| self.cells[cell].iter().copied()).collect();
        near.sort_unstable();
        near.dedup();
        for caster in near.into_iter().map(|index| &self.casters[index as usize]) {
            let apart =
                caster.high.x < low.x || caster.low.x > high.x || caster.high.y < low.y || caster.low.y > high.y;
            if apart || caster.highest_m < lowest_m {
                continue;
            }
            for (point, reached) in points.iter().zip(&mut reached) {
                *reached = *reached && !caster.shades(point);
            }
        }
        reached
    }

    fn cells_between(&self, low: Vector2<f64>, high: Vector2<f64>) -> impl Iterator<Item = usize> + use<> {
        let (columns, rows) = (self.columns, self.rows);
        let range = |low: f64, high: f64, first: f64, count: usize| {
            // casts saturate: what lies before the first or behind the last cell gives an empty range
            let from = ((low - first) / CELL_M).floor().max(0.0) as usize;
            let to = ((high - first) / CELL_M).floor() + 1.0;
            from..(to.max(0.0) as usize).min(count)
        };
        let across = range(low.x, high.x, self.first_cell.x, columns);
        range(low.y, high.y, self.first_cell.y, rows)
            .flat_map(move |row| across.clone().map(move |column| row * columns + column))
    }
}

fn axes_across(to_sun: Vector3<f64>) -> [Vector3<f64>; 3] {
    let level = Vector3::z().cross(&to_sun).try_normalize(1e-6).unwrap_or_else(Vector3::x);
    [level, to_sun.cross(&level), to_sun]
}

fn project(point_m: &Vector3<f64>, axes: &[Vector3<f64>; 3]) -> Facing {
    let [first, second, to_sun] = axes;
    Facing { across: Vector2::new(first.dot(point_m), second.dot(point_m)), height_m: to_sun.dot(point_m) }
}

/// `None` for faces that the sun sees edge-on.
fn polygon(face: &Face, axes: &[Vector3<f64>; 3]) -> Option<Caster> {
    let corners: Vec<Facing> = face.corners_m.iter().map(|corner| project(corner, axes)).collect();
    let n = corners.len();
    let flat: Vec<Vector3<f64>> = corners.iter().map(|corner| corner.across.push(1.0)).collect();
    let sides: Vec<_> = (0..n).map(|i| flat[i].cross(&flat[(i + 1) % n])).collect();
    let area: f64 = sides.iter().map(|side| side.z).sum();
    let normal = face.normal();
    let towards = normal.dot(&axes[2]);
    if area.abs() < 1e-6 || towards.abs() < 1e-6 {
        return None;
    }
    // the plane normal·X = distance, solved for the height towards the sun
    let distance = normal.dot(&face.corners_m[0]);
    let height = Vector3::new(-normal.dot(&axes[0]), -normal.dot(&axes[1]), distance) / towards;
    let zero = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY), f64::NEG_INFINITY);
    let (low, high, highest_m) = corners.iter().fold(zero, |(low, high, highest), corner| {
        (low.inf(&corner.across), high.sup(&corner.across), highest.max(corner.height_m))
    });
    let sides = sides.into_iter().map(|side| side * area.signum()).collect();
    Some(Caster { low, high, highest_m, shape: Shape::Polygon { sides, height } })
}

fn ball(puff: &Puff, axes: &[Vector3<f64>; 3]) -> Caster {
    let (centre, radius_m) = (project(&puff.centre_m, axes), puff.radius_m);
    Caster {
        low: centre.across.add_scalar(-radius_m),
        high: centre.across.add_scalar(radius_m),
        highest_m: centre.height_m + radius_m,
        shape: Shape::Ball { centre, radius_m },
    }
}
