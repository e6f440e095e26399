//! The town: ground, streets, buildings, gardens and fields, under a sun that stands still.

use nalgebra::{Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::building::{Building, Use};
use super::draws::{Draws, Purpose, direction};
use super::plots::Site;
use super::streets::{Street, draw_streets, street_patches};
use super::surface::{Face, Material, Patch, PlanFrame, Puff};
use super::terrain::Terrain;

/// What kind of town is built.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TownSettings {
    /// Half the length of the built-up part. 150 m: somewhat more than what an image of the default camera covers, so
    /// that its rims show fields in some flights and houses in others.
    pub half_length_m: f64,
    /// Long streets, 78 m apart; 3 of them with houses on both sides fill the same frame across.
    pub street_rows: u32,
    /// Mean height of the ground above the frame's zero. Not 0, so that a confusion of heights shows.
    pub mean_height_m: f64,
    /// Difference between the highest and the lowest ground. 6 m: roofs of one street are not coplanar.
    pub relief_m: f64,
    /// The lowest and the highest sun that is drawn. Photographs are flown between these on a clear day.
    pub sun_elevation_deg: [f64; 2],
    /// How many trees stand in the gardens, as a multiple of what is usual.
    pub trees: f64,
    /// The share of the balls of leaves that are there: 1 in summer, few in winter.
    pub foliage: f64,
    /// The share of the rows of houses in which all are alike, at even distances, as a builder puts them up.
    pub share_alike: f64,
}

impl Default for TownSettings {
    fn default() -> Self {
        Self {
            half_length_m: 150.0,
            street_rows: 3,
            mean_height_m: 62.0,
            relief_m: 6.0,
            sun_elevation_deg: [32.0, 55.0],
            trees: 1.0,
            foliage: 1.0,
            share_alike: 0.0,
        }
    }
}

/// A town in a local east, north, up frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Town {
    /// The ground.
    pub terrain: Terrain,
    /// The direction to the sun: a unit vector.
    pub to_sun: Vector3<f64>,
    /// The middle of the built-up part.
    pub centre_m: Vector2<f64>,
    /// The streets.
    pub streets: Vec<Street>,
    /// The buildings, houses and outbuildings.
    pub buildings: Vec<Building>,
    /// All that is made of planes: the buildings' roofs and walls first, then chimneys, windows, fences, cars.
    pub faces: Vec<Face>,
    /// What is painted on the ground, in this order, over a meadow.
    pub patches: Vec<Patch>,
    /// The leaves of trees and hedges.
    pub puffs: Vec<Puff>,
}

impl Town {
    /// The town of a seed.
    #[must_use]
    pub fn build(seed: u64, settings: &TownSettings) -> Self {
        let draws = &mut Draws::new(seed, Purpose::Town);
        let to_sun = draw_sun(settings.sun_elevation_deg, draws);
        let terrain = Terrain::draw(draws, settings.mean_height_m, settings.relief_m);
        let axis = PlanFrame {
            origin_m: Vector2::new(draws.within(40.0), draws.within(40.0)),
            along: direction(draws.between(0.0, std::f64::consts::TAU)),
        };
        let streets = draw_streets(axis, settings.half_length_m, settings.street_rows, draws);
        let mut site = Site {
            terrain: &terrain,
            streets: &streets,
            buildings: Vec::new(),
            faces: Vec::new(),
            patches: fields(axis, draws),
            puffs: Vec::new(),
            trees: settings.trees,
            share_alike: settings.share_alike,
        };
        for street in streets.iter().take(settings.street_rows as usize) {
            site.build_along(street, axis, settings.half_length_m, draws);
        }
        park_along(&mut site, &streets, draws);
        plant_outside(&mut site, axis, settings.half_length_m, draws);
        let Site { buildings, faces: details, mut patches, mut puffs, .. } = site;
        let season = &mut Draws::new(seed, Purpose::Foliage);
        puffs.retain(|_| season.chance(settings.foliage));
        patches.extend(street_patches(&streets, draws));
        let mut faces: Vec<Face> = buildings.iter().flat_map(Building::faces).collect();
        faces.extend(details);
        Self { terrain, to_sun, centre_m: axis.origin_m, streets, buildings, faces, patches, puffs }
    }

    /// A town of given buildings on level ground, without anything else: for experiments.
    #[must_use]
    pub fn of_buildings(buildings: Vec<Building>, ground_m: f64, to_sun: Vector3<f64>) -> Self {
        Self {
            terrain: Terrain::level(ground_m),
            to_sun: to_sun.normalize(),
            centre_m: Vector2::zeros(),
            streets: Vec::new(),
            faces: buildings.iter().flat_map(Building::faces).collect(),
            buildings,
            patches: Vec::new(),
            puffs: Vec::new(),
        }
    }

    /// Its houses and halls.
    pub fn main_buildings(&self) -> impl Iterator<Item = &Building> {
        self.buildings.iter().filter(|building| building.purpose == Use::Main)
    }
}

/// On the northern hemisphere, between morning and afternoon.
fn draw_sun(elevation_deg: [f64; 2], draws: &mut Draws) -> Vector3<f64> {
    let elevation_rad = draws.between(elevation_deg[0], elevation_deg[1]).to_radians();
    let azimuth_rad = draws.between(115.0, 245.0).to_radians();
    let (flat, up) = (libm::cos(elevation_rad), libm::sin(elevation_rad));
    Vector3::new(libm::sin(azimuth_rad) * flat, libm::cos(azimuth_rad) * flat, up)
}

/// Strips of fields and meadows all over; the town is painted over them.
fn fields(axis: PlanFrame, draws: &mut Draws) -> Vec<Patch> {
    const REACH_M: f64 = 560.0;
    let mut patches = Vec::new();
    let mut bottom_m = -REACH_M;
    while bottom_m < REACH_M {
        let top_m = bottom_m + draws.between(90.0, 150.0);
        let (mut from_m, lean) = (-REACH_M, draws.within(0.1));
        while from_m < REACH_M {
            let to_m = from_m + draws.between(18.0, 70.0);
            let turned = axis.turned(lean);
            let corners = turned.rectangle([from_m, to_m], [bottom_m, top_m]);
            patches.push(Patch { corners_m: corners.to_vec(), material: crop(turned.along, draws) });
            from_m = to_m;
        }
        bottom_m = top_m;
    }
    patches
}

fn crop(across_rows: Vector2<f64>, draws: &mut Draws) -> Material {
    let ground = Material::grass(draws.one_of(&[0.3, 0.36, 0.4, 0.47, 0.55]) * draws.between(0.95, 1.05));
    match draws.below(3) {
        0 => ground,
        1 => ground.striped(across_rows, draws.between(0.5, 0.9), draws.between(0.03, 0.1)),
        _ => {
            Material { mottle: 0.08, ..ground }.striped(across_rows, draws.between(2.5, 4.0), draws.between(0.03, 0.08))
        }
    }
}

/// Cars beside the kerbs.
fn park_along(site: &mut Site<'_>, streets: &[Street], draws: &mut Draws) {
    for street in streets {
        let mut at_m = draws.between(10.0, 60.0);
        while let Some(frame) = street.frame_at(at_m) {
            let side = if draws.chance(0.5) { 1.0 } else { -1.0 };
            let car = PlanFrame { along: frame.along * side, ..frame }.moved(0.0, -(street.half_roadway_m - 1.05));
            site.park(car.turned(draws.within(0.03)), draws);
            at_m += draws.between(14.0, 90.0);
        }
    }
}

/// A grove at one end of the town, rows of trees at field edges, and bushes anywhere.
fn plant_outside(site: &mut Site<'_>, axis: PlanFrame, half_length_m: f64, draws: &mut Draws) {
    let grove = axis.moved(-(half_length_m + draws.between(30.0, 60.0)), draws.within(90.0));
    for _ in 0..60 {
        let place = grove.at(draws.within(24.0), draws.within(30.0));
        let crown_m = draws.between(2.0, 4.2);
        site.plant_tree(place, crown_m, draws);
    }
    for _ in 0..3 {
        let row =
            axis.moved(draws.within(half_length_m), draws.one_of(&[-130.0, 128.0, 150.0])).turned(draws.within(0.1));
        for tree in 0..9 {
            let place = row.at(f64::from(tree) * 8.0 + draws.within(1.0), draws.within(0.8));
            let crown_m = draws.between(1.6, 3.4);
            site.plant_tree(place, crown_m, draws);
        }
    }
    for _ in 0..60 {
        let place = axis.at(draws.within(half_length_m + 60.0), draws.within(160.0));
        let crown_m = draws.between(0.5, 2.6);
        site.plant_tree(place, crown_m, draws);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn towns_have_40_to_80_houses_that_stand_free() {
        for seed in 1..=20 {
            let town = Town::build(seed, &TownSettings::default());
            let houses: Vec<_> = town.main_buildings().collect();
            assert!((40..=80).contains(&houses.len()), "seed {seed}: {} houses", houses.len());
            for (i, house) in houses.iter().enumerate() {
                for street in &town.streets {
                    let nearest =
                        house.footprint_m().into_iter().map(|c| street.distance_m(c)).fold(f64::MAX, f64::min);
                    assert!(nearest > street.half_roadway_m, "seed {seed}: house {i} in the street");
                }
                let middles = houses[..i].iter().map(|other| (other.centre_m - house.centre_m).norm());
                let reach_m = house.width_m;
                assert!(middles.fold(f64::MAX, f64::min) > reach_m, "seed {seed}: house {i} in another");
            }
        }
    }

    #[test]
    fn a_seed_names_one_town() {
        let settings = TownSettings::default();
        assert_eq!(Town::build(5, &settings), Town::build(5, &settings));
        assert!(Town::build(5, &settings) != Town::build(6, &settings));
    }
}
