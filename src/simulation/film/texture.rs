//! Something like an aerial photograph: fields, woods, roads and houses of no place, from noise.

use nalgebra::Vector2;

use crate::simulation::draws::{Draws, direction, floor_and_rest, hash, value_noise};

/// Image content from a seed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Texture {
    seed: u32,
    /// The direction in which fields are ploughed and streets run.
    axis: Vector2<f64>,
    field_mm: f64,
    road_half_mm: f32,
    house_mm: f64,
}

/// What changes slowly from place to place.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Land {
    /// Bends of the fields, in fields.
    bend: [f32; 2],
    light: f32,
    /// How much of a wood and of a town there is: positive where there is some.
    wood: f32,
    town: f32,
}

impl Land {
    /// Between this one and another.
    pub(super) fn towards(&self, other: &Self, share: f32) -> Self {
        let between = |a: f32, b: f32| a + share * (b - a);
        Self {
            bend: [between(self.bend[0], other.bend[0]), between(self.bend[1], other.bend[1])],
            light: between(self.light, other.light),
            wood: between(self.wood, other.wood),
            town: between(self.town, other.town),
        }
    }
}

impl Texture {
    pub(super) fn new(seed: u32, draws: &mut Draws) -> Self {
        Self {
            seed,
            axis: direction(draws.between(0.0, std::f64::consts::TAU)),
            field_mm: draws.between(2.0, 8.0),
            road_half_mm: draws.between(0.03, 0.15) as f32,
            house_mm: draws.between(0.3, 0.8),
        }
    }

    /// What changes slowly; meant to be interpolated over a few tenths of a millimetre.
    pub(super) fn land(&self, place_mm: Vector2<f64>) -> Land {
        let noise = |wave_mm: f64, k: u32| value_noise(place_mm.x / wave_mm, place_mm.y / wave_mm, self.seed ^ k);
        let bend = [0.5 * noise(17.0, 1), 0.5 * noise(17.0, 2)];
        let light = 0.5 + 0.2 * noise(35.0, 3) + 0.1 * noise(5.0, 4);
        Land { bend, light, wood: noise(11.0, 5) - 0.1, town: noise(23.0, 6) - 0.15 }
    }

    /// Grey, 0 to 1, at a place; details smaller than the spot are left out.
    pub(super) fn grey(&self, place_mm: Vector2<f64>, land: &Land, spot_mm: f64) -> f32 {
        let noise = |wave_mm: f64, k: u32| {
            if wave_mm < 1.5 * spot_mm {
                return 0.0;
            }
            value_noise(place_mm.x / wave_mm, place_mm.y / wave_mm, self.seed ^ k)
        };
        let own = Vector2::new(self.axis.dot(&place_mm), self.axis.perp(&place_mm));
        let mut grey = self.field(own, land);
        if land.wood > 0.0 {
            let dense = (8.0 * land.wood).min(1.0);
            grey += dense * (0.28 + 0.17 * noise(0.17, 7) - grey);
        } else if land.town > 0.0 {
            grey = self.house(own, grey);
        }
        grey += 0.07 * noise(0.31, 8) + 0.05 * noise(0.071, 9);
        grey.clamp(0.12, 0.96)
    }

    /// Fields in strips of different widths, with roads between some of them.
    fn field(&self, own: Vector2<f64>, land: &Land) -> f32 {
        let (row, across) = floor_and_rest(own.y / self.field_mm + f64::from(land.bend[0]));
        let of_row = hash(row, 17, self.seed);
        let length = 1.0 + f64::from(of_row & 3);
        let (column, along) =
            floor_and_rest((own.x / self.field_mm + f64::from(land.bend[1])) / length + f64::from(of_row >> 8) * 1e-7);
        let of_field = hash(row, column, self.seed ^ 0x5EED);
        let beside = (across as f32).min((along * length) as f32) * self.field_mm as f32;
        let road = if of_row & 0x30 == 0 { 2.5 * self.road_half_mm } else { self.road_half_mm };
        if beside < road && of_field & 3 != 0 {
            return 0.3 + 0.6 * ((of_row >> 4) & 0xFF) as f32 / 255.0;
        }
        land.light + 0.45 * ((of_field >> 8) as f32 / (1 << 24) as f32 - 0.5)
    }

    /// Bright and dark roofs on the ground between them.
    fn house(&self, own: Vector2<f64>, ground: f32) -> f32 {
        let ((i, right), (j, up)) = (floor_and_rest(own.x / self.house_mm), floor_and_rest(own.y / self.house_mm));
        let of_house = hash(i, j, self.seed ^ 0x40_5E);
        let size = |bits: u32| 0.2 + 0.5 * f64::from(bits & 0xFF) / 255.0;
        if of_house & 3 == 0 || right > size(of_house >> 8) || up > size(of_house >> 16) {
            return ground;
        }
        0.15 + 0.8 * (of_house >> 24) as f32 / 255.0
    }
}
