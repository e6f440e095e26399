//! From what a ray meets to a grey value: albedo, texture, sun and sky.

use nalgebra::{Vector2, Vector3};

use super::draws::{floor_and_rest, value_noise};
use super::surface::{Face, Material};
use super::town::Town;
use super::visibility::Surface;

/// Grey value of a black thing through the haze, and what a white level one in the sun has beyond it: exposed for grass
/// and roofs, so that white cars are overexposed. The response between
/// them is linear: a bent one would move the edges of blurred pictures.
const HAZE_GREY: f32 = 14.0;
const WHITE_GREY: f32 = 300.0;

/// The grey of rays that miss the ground.
pub(crate) const SKY_GREY: f32 = 205.0;

/// Light from the whole sky on a level surface; the sun adds the rest to 1.
const SKY_SHARE: f64 = 0.4;

/// Sizes of stains and grain, metres.
const STAIN_M: f64 = 2.7;
const GRAIN_M: [f64; 2] = [0.55, 0.21];

/// Everything that is needed to light a town.
pub(crate) struct Shading<'a> {
    town: &'a Town,
    faces: Vec<LitFace>,
    /// Light of the sun on a surface that faces it.
    sun: f64,
    /// Scale of all textures, 0 for none.
    texture: f32,
}

struct LitFace {
    origin_m: Vector3<f64>,
    axes: [Vector3<f64>; 2],
    from_sun: f32,
    from_sky: f32,
}

impl<'a> Shading<'a> {
    pub(crate) fn new(town: &'a Town, eye_m: Vector3<f64>, texture: f64) -> Self {
        let sun = (1.0 - SKY_SHARE) / town.to_sun.z.max(0.1);
        let faces = town.faces.iter().map(|face| lit(face, eye_m, town.to_sun, sun)).collect();
        Self { town, faces, sun, texture: texture as f32 }
    }

    /// The grey value of a point of a surface; `sun_on_ground` is that of [`Self::sun_on_ground`] there.
    pub(crate) fn grey(&self, surface: Surface, point_m: &Vector3<f64>, in_sun: bool, sun_on_ground: f32) -> f32 {
        let light = |from_sun: f32, from_sky: f32| from_sky + if in_sun { from_sun } else { 0.0 };
        let brightness = match surface {
            Surface::Meadow => {
                self.on_ground(&Material::grass(0.4), 1, point_m) * light(sun_on_ground, SKY_SHARE as f32)
            }
            Surface::Patch(index) => {
                let material = &self.town.patches[index as usize].material;
                self.on_ground(material, index + 2, point_m) * light(sun_on_ground, SKY_SHARE as f32)
            }
            Surface::Face(index) => {
                let lit = &self.faces[index as usize];
                let from_origin = point_m - lit.origin_m;
                let [along, up] = lit.axes.map(|axis| axis.dot(&from_origin));
                let material = &self.town.faces[index as usize].material;
                self.textured(material, index ^ 0x5F5F, along, up) * light(lit.from_sun, lit.from_sky)
            }
            Surface::Puff(index) => {
                let puff = &self.town.puffs[index as usize];
                let normal = (point_m - puff.centre_m) / puff.radius_m + puff.outward;
                let normal = normal.try_normalize(1e-9).unwrap_or_else(Vector3::z);
                let leaves = 1.0 + 0.4 * self.texture * value_noise(point_m.x / 0.28, point_m.y / 0.28, index);
                puff.albedo * leaves * light((normal.dot(&self.town.to_sun).max(0.0) * self.sun) as f32, sky_on(normal))
            }
        };
        HAZE_GREY + WHITE_GREY * brightness
    }

    /// The sun's light on the ground at a place.
    pub(crate) fn sun_on_ground(&self, plan_m: Vector2<f64>) -> f32 {
        (self.town.terrain.normal(plan_m).dot(&self.town.to_sun).max(0.0) * self.sun) as f32
    }

    fn on_ground(&self, material: &Material, seed: u32, point_m: &Vector3<f64>) -> f32 {
        self.textured(material, seed, point_m.x, point_m.y)
    }

    fn textured(&self, material: &Material, seed: u32, x_m: f64, y_m: f64) -> f32 {
        let [coarse, fine] = GRAIN_M.map(|size_m| value_noise(x_m / size_m, y_m / size_m, seed));
        let mut relative = material.mottle * value_noise(x_m / STAIN_M, y_m / STAIN_M, seed)
            + material.grain * (0.6 * coarse + 0.8 * fine);
        if let Some(stripes) = material.stripes {
            let turns = (x_m * stripes.across.x + y_m * stripes.across.y) / stripes.pitch_m;
            relative += stripes.amplitude * (4.0 * (floor_and_rest(turns).1 - 0.5).abs() - 1.0) as f32;
        }
        material.albedo * (1.0 + self.texture * relative)
    }
}

fn lit(face: &Face, eye_m: Vector3<f64>, to_sun: Vector3<f64>, sun: f64) -> LitFace {
    let origin_m = face.corners_m[0];
    let normal = face.normal();
    let seen = if normal.dot(&(eye_m - origin_m)) < 0.0 { -normal } else { normal };
    let along = (face.corners_m[1] - origin_m).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    LitFace {
        origin_m,
        axes: [along, normal.cross(&along)],
        from_sun: (seen.dot(&to_sun).max(0.0) * sun) as f32,
        from_sky: sky_on(seen),
    }
}

/// The share of the sky that a surface sees.
fn sky_on(normal: Vector3<f64>) -> f32 {
    (SKY_SHARE * (0.55 + 0.45 * normal.z)) as f32
}
