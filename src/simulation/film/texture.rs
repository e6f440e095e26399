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
    fields_per_mm: f64,
    road_half_mm: f32,
    houses_per_mm: f64,
}

/// One by the length of a field, in widths.
const PER_LENGTH: [f64; 4] = [1.0, 1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0];
/// Widths of the finest waves; those of woods are coarser.
const LEAF_MM: f64 = 0.17;
const FINE_MM: f64 = 0.071;
const MIDDLE_MM: f64 = 0.31;

/// What changes slowly from place to place: bends of the fields in x and y (in fields), brightness, unrest of some
/// tenths of a millimetre, and how much of a wood and of a town there is (positive where there is some).
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Land([f32; 6]);

impl Land {
    /// Between this one and another.
    pub(super) fn towards(&self, other: &Self, share: f32) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + share * (other.0[k] - self.0[k])))
    }
}

impl Texture {
    pub(super) fn new(seed: u32, draws: &mut Draws) -> Self {
        let field_mm = draws.between(2.0, 8.0);
        Self {
            seed,
            axis: direction(draws.between(0.0, std::f64::consts::TAU)),
            field_mm,
            fields_per_mm: 1.0 / field_mm,
            road_half_mm: draws.between(0.03, 0.15) as f32,
            houses_per_mm: 1.0 / draws.between(0.3, 0.8),
        }
    }

    fn own(&self, place_mm: Vector2<f64>) -> Vector2<f64> {
        Vector2::new(self.axis.dot(&place_mm), self.axis.perp(&place_mm))
    }

    /// What changes slowly; meant to be interpolated over a few tenths of a millimetre. Details smaller than the spot
    /// are left out.
    pub(super) fn land(&self, place_mm: Vector2<f64>, spot_mm: f64) -> Land {
        let own = self.own(place_mm);
        let noise = |wave_mm: f64, k: u32| value_noise(own.x / wave_mm, own.y / wave_mm, self.seed ^ k);
        let (bend_x, bend_y) = (0.5 * noise(17.0, 1), 0.5 * noise(17.0, 2));
        let light = 0.5 + 0.15 * noise(47.0, 3) + 0.1 * noise(6.0, 4);
        let ragged = 0.25 * noise(2.9, 10);
        let unrest = if MIDDLE_MM < 1.5 * spot_mm { 0.0 } else { noise(MIDDLE_MM, 8) };
        let (wood, town) = (noise(13.0, 5) + ragged - 0.3, noise(29.0, 6) + ragged - 0.15);
        Land([bend_x, bend_y, light, unrest, wood, town])
    }

    /// Grey, 0 to 1, at a place; details smaller than the spot are left out.
    pub(super) fn grey(&self, place_mm: Vector2<f64>, land: &Land, spot_mm: f64) -> f32 {
        let own = self.own(place_mm);
        let Land([bend_x, bend_y, light, unrest, wood, town]) = *land;
        let field = || self.field(own, [bend_x, bend_y], light);
        let noise = |wave_mm: f64, k: u32| {
            if wave_mm < 1.5 * spot_mm {
                return 0.0;
            }
            value_noise(own.x * (1.0 / wave_mm), own.y * (1.0 / wave_mm), self.seed ^ k)
        };
        let grey = if wood > 0.03 {
            0.65 * light + 0.17 * noise(LEAF_MM, 7)
        } else if town > 0.0 {
            self.house(own, field())
        } else {
            field()
        };
        (grey + 0.07 * unrest + 0.05 * noise(FINE_MM, 9)).clamp(0.12, 0.96)
    }

    /// Fields in strips of different widths, with roads between some of them.
    fn field(&self, own: Vector2<f64>, bend: [f32; 2], light: f32) -> f32 {
        let (row, across) = floor_and_rest(own.y * self.fields_per_mm + f64::from(bend[0]));
        let of_row = hash(row, 17, self.seed);
        let fields = (of_row & 3) as usize;
        let length = 1.0 + fields as f64;
        let (column, along) = floor_and_rest(
            (own.x * self.fields_per_mm + f64::from(bend[1])) * PER_LENGTH[fields] + f64::from(of_row >> 8) * 1e-7,
        );
        let of_field = hash(row, column, self.seed ^ 0x5EED);
        let beside = (across as f32).min((along * length) as f32) * self.field_mm as f32;
        let road = if of_row & 0x30 == 0 { 2.5 * self.road_half_mm } else { self.road_half_mm };
        if beside < road && of_field & 3 != 0 {
            return 0.3 + 0.6 * ((of_row >> 4) & 0xFF) as f32 / 255.0;
        }
        light + 0.45 * ((of_field >> 8) as f32 / (1 << 24) as f32 - 0.5)
    }

    /// Bright and dark roofs on the ground between them.
    fn house(&self, own: Vector2<f64>, ground: f32) -> f32 {
        let ((i, right), (j, up)) =
            (floor_and_rest(own.x * self.houses_per_mm), floor_and_rest(own.y * self.houses_per_mm));
        let of_house = hash(i, j, self.seed ^ 0x40_5E);
        let size = |bits: u32| 0.2 + 0.5 * f64::from(bits & 0xFF) / 255.0;
        if of_house & 3 == 0 || right > size(of_house >> 8) || up > size(of_house >> 16) {
            return ground;
        }
        0.15 + 0.8 * (of_house >> 24) as f32 / 255.0
    }
}
