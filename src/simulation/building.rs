//! Buildings: a rectangle of walls under a gable, hip or flat roof.

use nalgebra::{Vector2, Vector3};

use super::draws::Draws;
use super::surface::{Face, Material, PlanFrame, block, raised};
use crate::geometry::Segment3;

/// What a building is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// Houses and halls: what a survey would measure as control.
    Main,
    /// Garages and sheds.
    Outbuilding,
}

/// The form of a roof.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Roof {
    /// Two planes that meet in a ridge over the whole length.
    Gable {
        /// Metres that a plane rises for each metre inwards.
        slope: f64,
    },
    /// Four planes of one slope.
    Hip {
        /// Metres that a plane rises for each metre inwards.
        slope: f64,
    },
    /// Level.
    Flat,
}

/// A building.
#[derive(Debug, Clone, PartialEq)]
pub struct Building {
    /// What it is for.
    pub purpose: Use,
    /// The middle of its footprint.
    pub centre_m: Vector2<f64>,
    /// The direction of its ridge, or of its longer side: a unit vector.
    pub ridge_direction: Vector2<f64>,
    /// Outside measure of the walls along the ridge.
    pub length_m: f64,
    /// Outside measure of the walls across the ridge, not more than the length.
    pub width_m: f64,
    /// Height of the ground at its middle.
    pub ground_m: f64,
    /// Height of the walls above the ground, where they meet the roof at the eaves.
    pub wall_height_m: f64,
    /// Its roof.
    pub roof: Roof,
    /// By how much the roof reaches beyond the walls.
    pub overhang_m: f64,
    /// The look of its roof.
    pub roof_material: Material,
    /// The look of its walls.
    pub wall_material: Material,
}

/// Walls go down so far below the ground at the middle, so that none hangs in the air on a slope.
const FOUNDATION_M: f64 = 2.0;

/// Windows in roofs lie so far above the plane: enough to be seen, too little to be measured.
const ON_THE_ROOF_M: f64 = 0.03;

impl Building {
    /// The corners of its roof, and the pairs of them that its edges join: ridge, eaves, verges or hips.
    #[must_use]
    pub fn roof_wireframe(&self) -> (Vec<Vector3<f64>>, Vec<[usize; 2]>) {
        let (plan, eaves_height_m) = (self.plan_frame(), self.eaves_height_m());
        let (half_length_m, half_width_m) = self.half_roof_m();
        let eaves = plan.rectangle([-half_length_m, half_length_m], [-half_width_m, half_width_m]);
        let mut corners: Vec<_> = eaves.into_iter().map(|corner| raised(corner, eaves_height_m)).collect();
        let half_ridge_m = match self.roof {
            Roof::Flat => return (corners, vec![[0, 1], [1, 2], [2, 3], [3, 0]]),
            Roof::Gable { .. } => half_length_m,
            Roof::Hip { .. } => half_length_m - half_width_m,
        };
        corners.extend([-half_ridge_m, half_ridge_m].map(|at| raised(plan.at(at, 0.0), self.ridge_height_m())));
        let mut edges = vec![[4, 5], [0, 1], [2, 3], [0, 4], [4, 3], [1, 5], [5, 2]];
        if let Roof::Hip { .. } = self.roof {
            edges.extend([[1, 2], [3, 0]]);
        }
        (corners, edges)
    }

    /// The edges of its roof.
    #[must_use]
    pub fn roof_edges_m(&self) -> Vec<Segment3> {
        let (corners, edges) = self.roof_wireframe();
        edges.into_iter().map(|[from, to]| Segment3 { start: corners[from], end: corners[to] }).collect()
    }

    /// Height of the highest line of its roof.
    #[must_use]
    pub fn ridge_height_m(&self) -> f64 {
        self.ground_m + self.wall_height_m + self.slope() * self.width_m / 2.0
    }

    /// Height of the rim of its roof.
    #[must_use]
    pub fn eaves_height_m(&self) -> f64 {
        self.ground_m + self.wall_height_m - self.slope() * self.overhang_m
    }

    /// The corners of its walls on the map.
    #[must_use]
    pub fn footprint_m(&self) -> [Vector2<f64>; 4] {
        self.footprint_grown_m(0.0)
    }

    pub(crate) fn footprint_grown_m(&self, margin_m: f64) -> [Vector2<f64>; 4] {
        let (half_length_m, half_width_m) = (self.length_m / 2.0 + margin_m, self.width_m / 2.0 + margin_m);
        self.plan_frame().rectangle([-half_length_m, half_length_m], [-half_width_m, half_width_m])
    }

    pub(crate) fn plan_frame(&self) -> PlanFrame {
        PlanFrame { origin_m: self.centre_m, along: self.ridge_direction }
    }

    /// Roof and walls, without what stands on the roof.
    #[must_use]
    pub fn faces(&self) -> Vec<Face> {
        let mut faces = self.roof_faces();
        faces.extend(self.walls());
        faces
    }

    fn roof_faces(&self) -> Vec<Face> {
        let (corners, _) = self.roof_wireframe();
        let planes: &[&[usize]] = match self.roof {
            Roof::Flat => &[&[0, 1, 2, 3]],
            Roof::Gable { .. } => &[&[0, 1, 5, 4], &[2, 3, 4, 5]],
            Roof::Hip { .. } => &[&[0, 1, 5, 4], &[2, 3, 4, 5], &[1, 2, 5], &[3, 0, 4]],
        };
        let face = |plane: &&[usize]| Face::new(plane.iter().map(|&i| corners[i]).collect(), self.roof_material);
        planes.iter().map(face).collect()
    }

    fn walls(&self) -> Vec<Face> {
        let (bottom, top) = (self.ground_m - FOUNDATION_M, self.ground_m + self.wall_height_m);
        let mut walls = block(self.footprint_m(), [bottom, top], self.wall_material, self.wall_material);
        walls.truncate(4); // the lid is the roof's affair
        if let Roof::Gable { .. } = self.roof {
            // sides 1 and 3 are the gables: between their two upper corners comes the top of the ridge
            for (side, along) in [(1, self.length_m / 2.0), (3, -self.length_m / 2.0)] {
                walls[side].corners_m.insert(3, raised(self.plan_frame().at(along, 0.0), self.ridge_height_m()));
            }
        }
        walls
    }

    fn half_roof_m(&self) -> (f64, f64) {
        (self.length_m / 2.0 + self.overhang_m, self.width_m / 2.0 + self.overhang_m)
    }

    fn slope(&self) -> f64 {
        match self.roof {
            Roof::Gable { slope } | Roof::Hip { slope } => slope,
            Roof::Flat => 0.0,
        }
    }

    /// A rectangle on one of the two long roof planes (`side` -1 or 1, seen across the ridge), measured from the
    /// ridge outwards on the map.
    fn on_plane(&self, side: f64, along_m: [f64; 2], from_ridge_m: [f64; 2], lift_m: f64) -> Vec<Vector3<f64>> {
        let across_m = from_ridge_m.map(|d| side * d);
        let height = |from_ridge: f64| self.ridge_height_m() - self.slope() * from_ridge + lift_m;
        let heights = [from_ridge_m[0], from_ridge_m[0], from_ridge_m[1], from_ridge_m[1]].map(height);
        self.plan_frame().rectangle(along_m, across_m).into_iter().zip(heights).map(|(p, h)| raised(p, h)).collect()
    }
}

/// Chimneys, windows and solar panels: what stands and lies on a roof, and is in no control.
pub(crate) fn roof_details(building: &Building, draws: &mut Draws) -> Vec<Face> {
    match building.roof {
        Roof::Flat => flat_roof_details(building, draws),
        Roof::Gable { .. } | Roof::Hip { .. } => pitched_roof_details(building, draws),
    }
}

fn pitched_roof_details(building: &Building, draws: &mut Draws) -> Vec<Face> {
    let mut faces = Vec::new();
    let half_ridge_m = (building.length_m - building.width_m).max(2.0) / 2.0;
    if draws.chance(0.75) {
        let stack = building.plan_frame().moved(draws.within(half_ridge_m), draws.within(building.width_m / 6.0));
        let footprint = stack.rectangle([-0.25, 0.25], [-0.4, 0.4]);
        let ridge_m = building.ridge_height_m();
        let brick = Material::plain(draws.between(0.3, 0.6));
        faces.extend(block(footprint, [ridge_m - 2.0, ridge_m + draws.between(0.5, 1.1)], brick, Material::plain(0.2)));
    }
    let side = if draws.chance(0.5) { 1.0 } else { -1.0 };
    let reach_m = building.width_m / 2.0;
    if draws.chance(0.15) {
        let (from, columns) = (-half_ridge_m + 0.3, f64::from(2 + draws.below(4)));
        let to = (from + columns * 1.05).min(half_ridge_m);
        let panel = Material::plain(0.13).striped(Vector2::new(1.0, 0.0), 1.05, 0.15);
        faces.push(decal(building.on_plane(side, [from, to], [0.15 * reach_m, 0.75 * reach_m], ON_THE_ROOF_M), panel));
    } else {
        for _ in 0..draws.below(4) {
            let (along, from_ridge) = (draws.within(half_ridge_m), reach_m * draws.between(0.25, 0.6));
            let window = building.on_plane(side, [along, along + 0.8], [from_ridge, from_ridge + 0.9], ON_THE_ROOF_M);
            faces.push(decal(window, Material::plain(draws.one_of(&[0.15, 0.2, 0.75]))));
        }
    }
    faces
}

fn flat_roof_details(building: &Building, draws: &mut Draws) -> Vec<Face> {
    let (plan, top_m) = (building.plan_frame(), building.ridge_height_m());
    let mut faces = Vec::new();
    if building.purpose == Use::Outbuilding {
        return faces;
    }
    for _ in 0..1 + draws.below(3) {
        let unit = plan.moved(draws.within(building.length_m * 0.3), draws.within(building.width_m * 0.3));
        let size_m = draws.between(0.4, 1.2);
        let metal = Material::plain(draws.between(0.35, 0.8));
        faces.extend(block(
            unit.rectangle([-size_m, size_m], [-0.5, 0.5]),
            [top_m, top_m + draws.between(0.2, 0.9)],
            metal,
            metal,
        ));
    }
    faces
}

fn decal(corners_m: Vec<Vector3<f64>>, material: Material) -> Face {
    Face { corners_m, material, casts_shadow: false }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    pub(crate) fn house(roof: Roof) -> Building {
        Building {
            purpose: Use::Main,
            centre_m: Vector2::new(3.0, -4.0),
            ridge_direction: crate::simulation::draws::direction(0.4),
            length_m: 14.0,
            width_m: 9.0,
            ground_m: 60.0,
            wall_height_m: 5.0,
            roof,
            overhang_m: 0.5,
            roof_material: Material::plain(0.4),
            wall_material: Material::plain(0.7),
        }
    }

    #[test]
    fn roofs_have_the_lines_of_their_kind() {
        let lengths = |roof| house(roof).roof_edges_m().iter().map(Segment3::length).collect::<Vec<_>>();
        let (slope, half_width) = (0.8_f64, 5.0_f64);
        let verge = half_width * (1.0 + slope * slope).sqrt();
        let gable = lengths(Roof::Gable { slope });
        for (length, expected) in gable.iter().zip([15.0, 15.0, 15.0, verge, verge, verge, verge]) {
            assert_relative_eq!(*length, expected, epsilon = 1e-9);
        }
        let hip = half_width * (2.0 + slope * slope).sqrt();
        for (length, expected) in
            lengths(Roof::Hip { slope }).iter().zip([5.0, 15.0, 15.0, hip, hip, hip, hip, 10.0, 10.0])
        {
            assert_relative_eq!(*length, expected, epsilon = 1e-9);
        }
        assert_eq!(lengths(Roof::Flat).len(), 4);
    }

    #[test]
    fn every_face_is_plane_and_roofs_face_upwards() {
        for roof in [Roof::Gable { slope: 0.9 }, Roof::Hip { slope: 0.6 }, Roof::Flat] {
            let building = house(roof);
            for face in building.faces() {
                let normal = face.normal();
                for corner in &face.corners_m {
                    assert_relative_eq!(normal.dot(&(corner - face.corners_m[0])), 0.0, epsilon = 1e-9);
                }
            }
            assert!(building.roof_faces().iter().all(|face| face.normal().z > 0.5));
            // walls look outwards
            for wall in building.walls() {
                let middle = wall.corners_m.iter().sum::<Vector3<f64>>() / wall.corners_m.len() as f64;
                assert!(wall.normal().xy().dot(&(middle.xy() - building.centre_m)) > 0.0);
            }
        }
    }

    #[test]
    fn walls_meet_the_roof_from_below() {
        let building = house(Roof::Gable { slope: 0.8 });
        let roof = building.roof_faces();
        for corner in building.walls().iter().flat_map(|wall| wall.corners_m.clone()) {
            let below = |face: &Face| face.normal().dot(&(corner - face.corners_m[0])) < 1e-9;
            assert!(roof.iter().all(below));
        }
    }
}
