//! Trees and hedges: heaps of leafy balls.

use nalgebra::{Vector2, Vector3};

use super::draws::Draws;
use super::surface::{Puff, raised};
use super::terrain::Terrain;

/// A broad-leaved tree: balls all over an ellipsoid.
pub(crate) fn broadleaf(place_m: Vector2<f64>, crown_radius_m: f64, terrain: &Terrain, draws: &mut Draws) -> Vec<Puff> {
    let ground_m = terrain.height_m(place_m);
    let half_height_m = crown_radius_m * draws.between(0.85, 1.2);
    let centre = raised(place_m, ground_m + half_height_m + draws.between(0.8, 2.0));
    let albedo = draws.between(0.2, 0.34);
    let count = 14 + draws.below(10) + (3.0 * crown_radius_m) as u32;
    let mut crown = vec![leaves(centre, 0.72 * crown_radius_m, Vector3::z(), albedo)];
    crown.extend((0..count).map(|_| {
        let outward = draws.direction();
        let reach = crown_radius_m * draws.between(0.5, 0.8);
        let offset =
            Vector3::new(outward.x * reach, outward.y * reach, outward.z * reach * half_height_m / crown_radius_m);
        let radius_m = crown_radius_m * draws.between(0.2, 0.42);
        leaves(centre + offset, radius_m, outward, albedo * draws.between(0.8, 1.2))
    }));
    crown
}

/// A conifer: rings of balls that narrow to the top.
pub(crate) fn conifer(place_m: Vector2<f64>, crown_radius_m: f64, terrain: &Terrain, draws: &mut Draws) -> Vec<Puff> {
    let (ground_m, height_m) = (terrain.height_m(place_m), crown_radius_m * draws.between(3.0, 4.5));
    let albedo = draws.between(0.13, 0.2);
    let mut crown = Vec::new();
    for ring in 0..7 {
        let up = f64::from(ring) / 7.0;
        let ring_radius_m = crown_radius_m * (1.0 - up) * 0.7;
        for _ in 0..(7 - ring).max(2) {
            let side = super::draws::direction(draws.between(0.0, std::f64::consts::TAU));
            let centre = raised(place_m + side * ring_radius_m, ground_m + height_m * (0.12 + 0.8 * up));
            let outward = raised(side, 0.6).normalize();
            let radius_m = crown_radius_m * draws.between(0.25, 0.36) * (1.15 - up);
            crown.push(leaves(centre, radius_m, outward, albedo * draws.between(0.8, 1.2)));
        }
    }
    crown
}

/// A clipped hedge between two places.
pub(crate) fn hedge(from_m: Vector2<f64>, to_m: Vector2<f64>, terrain: &Terrain, draws: &mut Draws) -> Vec<Puff> {
    let (side, height_m) = (to_m - from_m, draws.between(0.9, 1.8));
    let count = (side.norm() / 0.55).ceil() as u32;
    let albedo = draws.between(0.2, 0.28);
    let ball = |i: u32| {
        let place = from_m + side * (f64::from(i) / f64::from(count.max(1)));
        let jitter = Vector3::new(draws.within(0.12), draws.within(0.12), height_m - 0.5 + draws.within(0.12));
        leaves(
            terrain.point_m(place) + jitter,
            draws.between(0.42, 0.62),
            Vector3::z(),
            albedo * draws.between(0.85, 1.15),
        )
    };
    (0..=count).map(ball).collect()
}

fn leaves(centre_m: Vector3<f64>, radius_m: f64, outward: Vector3<f64>, albedo: f64) -> Puff {
    Puff { centre_m, radius_m, outward, albedo: albedo as f32 }
}
