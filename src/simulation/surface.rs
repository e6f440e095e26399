//! What the camera can see: planar faces, patches painted on the ground, and leaves.

use nalgebra::{Vector2, Vector3};

/// How a surface looks when it is lit. All amplitudes are shares of the albedo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// The share of light that it returns.
    pub albedo: f32,
    /// Stains, metres wide.
    pub mottle: f32,
    /// Grain, decimetres wide.
    pub grain: f32,
    /// Rows: of tiles, of plants, of a mower.
    pub stripes: Option<Stripes>,
}

/// Alternating rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stripes {
    /// The direction across the rows, in the surface's own plane coordinates.
    pub across: Vector2<f64>,
    /// From one row to the next.
    pub pitch_m: f64,
    /// Their strength.
    pub amplitude: f32,
}

impl Material {
    /// An even material with a little grain.
    #[must_use]
    pub fn plain(albedo: f64) -> Self {
        Self { albedo: albedo as f32, mottle: 0.03, grain: 0.04, stripes: None }
    }

    /// Short grass.
    #[must_use]
    pub fn grass(albedo: f64) -> Self {
        Self { albedo: albedo as f32, mottle: 0.13, grain: 0.16, stripes: None }
    }

    /// Stone, concrete, asphalt.
    #[must_use]
    pub fn paved(albedo: f64) -> Self {
        Self { albedo: albedo as f32, mottle: 0.06, grain: 0.07, stripes: None }
    }

    /// The same with rows.
    #[must_use]
    pub fn striped(self, across: Vector2<f64>, pitch_m: f64, amplitude: f64) -> Self {
        Self { stripes: Some(Stripes { across, pitch_m, amplitude: amplitude as f32 }), ..self }
    }
}

/// A convex polygon in space, seen from both sides.
#[derive(Debug, Clone, PartialEq)]
pub struct Face {
    /// Its corners, in order.
    pub corners_m: Vec<Vector3<f64>>,
    /// Its look; plane coordinates run along the first side, from the first corner.
    pub material: Material,
    /// Whether it keeps the sun off what lies behind it (a window in a roof does not).
    pub casts_shadow: bool,
}

impl Face {
    pub(crate) fn new(corners_m: Vec<Vector3<f64>>, material: Material) -> Self {
        Self { corners_m, material, casts_shadow: true }
    }

    /// Its unit normal, in the sense of its corners; zero for a face without area.
    #[must_use]
    pub fn normal(&self) -> Vector3<f64> {
        let n = self.corners_m.len();
        let turn = |i: usize| self.corners_m[i].cross(&self.corners_m[(i + 1) % n]);
        (0..n).map(turn).sum::<Vector3<f64>>().try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::zeros)
    }
}

/// A convex polygon painted on the ground; later ones cover earlier ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    /// Its corners, east and north, in order.
    pub corners_m: Vec<Vector2<f64>>,
    /// Its look; plane coordinates are east and north.
    pub material: Material,
}

/// A ball of leaves: trees and hedges are heaps of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Puff {
    /// Its centre.
    pub centre_m: Vector3<f64>,
    /// Its radius.
    pub radius_m: f64,
    /// The direction out of the crown, by which the crown as a whole is shaded.
    pub outward: Vector3<f64>,
    /// The share of light that it returns.
    pub albedo: f32,
}

/// A frame on the map, in which things are laid out: `at(along, across)`, across being to the left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlanFrame {
    pub(crate) origin_m: Vector2<f64>,
    pub(crate) along: Vector2<f64>,
}

impl PlanFrame {
    pub(crate) fn at(&self, along_m: f64, across_m: f64) -> Vector2<f64> {
        self.origin_m + self.along * along_m + left_of(self.along) * across_m
    }

    /// The corners of a rectangle with sides along the axes.
    pub(crate) fn rectangle(&self, along_m: [f64; 2], across_m: [f64; 2]) -> [Vector2<f64>; 4] {
        let ([a, b], [c, d]) = (along_m, across_m);
        [self.at(a, c), self.at(b, c), self.at(b, d), self.at(a, d)]
    }

    /// The same axes elsewhere.
    pub(crate) fn moved(&self, along_m: f64, across_m: f64) -> Self {
        Self { origin_m: self.at(along_m, across_m), along: self.along }
    }

    /// Another direction at the same place.
    pub(crate) fn turned(&self, angle_rad: f64) -> Self {
        let turn = super::draws::direction(angle_rad);
        Self { origin_m: self.origin_m, along: self.along * turn.x + left_of(self.along) * turn.y }
    }
}

/// The direction a quarter turn to the left, seen from above.
pub(crate) fn left_of(direction: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-direction.y, direction.x)
}

/// A point above or below a place on the map.
pub(crate) fn raised(plan_m: Vector2<f64>, height_m: f64) -> Vector3<f64> {
    Vector3::new(plan_m.x, plan_m.y, height_m)
}

/// The sides and the top of a box that stands on a rectangle.
pub(crate) fn block(footprint: [Vector2<f64>; 4], heights_m: [f64; 2], sides: Material, top: Material) -> Vec<Face> {
    let [bottom, lid] = heights_m;
    let side = |i: usize| {
        let (from, to) = (footprint[i], footprint[(i + 1) % 4]);
        Face::new(vec![raised(from, bottom), raised(to, bottom), raised(to, lid), raised(from, lid)], sides)
    };
    let mut faces: Vec<Face> = (0..4).map(side).collect();
    faces.push(Face::new(footprint.map(|corner| raised(corner, lid)).to_vec(), top));
    faces
}
