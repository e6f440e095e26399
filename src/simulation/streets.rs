//! The streets: a slightly irregular net of long and cross streets, with kerbs and pavements.

use nalgebra::Vector2;

use super::draws::Draws;
use super::surface::{Material, Patch, PlanFrame, left_of};

/// A street along a bent line.
#[derive(Debug, Clone, PartialEq)]
pub struct Street {
    /// Points of its centre line, a few metres apart.
    pub centre_line_m: Vec<Vector2<f64>>,
    /// Half the width of the roadway, between the kerbs.
    pub half_roadway_m: f64,
    /// Whether a broken line is painted along its middle.
    pub marked: bool,
}

const KERB_M: f64 = 0.18;
const PAVEMENT_M: f64 = 1.5;
const STEP_M: f64 = 7.0;
const CENTRE_MARK_M: [f64; 2] = [3.0, 6.0]; // painted, and from one to the next
const HALF_MARK_WIDTH_M: f64 = 0.07;

impl Street {
    /// A street that leaves `frame` along its first axis, from `from_m` to `to_m`, drifting and bending sideways.
    fn bent(frame: PlanFrame, reach_m: [f64; 2], half_roadway_m: f64, draws: &mut Draws) -> Self {
        let (drift, bend_m) = (draws.within(0.045), draws.between(1.5, 5.0));
        let (wave_m, phase) = (draws.between(140.0, 260.0), draws.between(0.0, std::f64::consts::TAU));
        let steps = ((reach_m[1] - reach_m[0]) / STEP_M).ceil() as u32;
        let point = |i: u32| {
            let along = reach_m[0] + f64::from(i) * STEP_M;
            frame.at(along, drift * along + bend_m * libm::sin(std::f64::consts::TAU * along / wave_m + phase))
        };
        Self { centre_line_m: (0..=steps).map(point).collect(), half_roadway_m, marked: false }
    }

    /// Half the width between the front gardens.
    #[must_use]
    pub fn half_width_m(&self) -> f64 {
        self.half_roadway_m + KERB_M + PAVEMENT_M
    }

    /// The length of its centre line.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.centre_line_m.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
    }

    /// The place at a distance along the centre line, looking along it.
    pub(crate) fn frame_at(&self, distance_m: f64) -> Option<PlanFrame> {
        let mut passed_m = 0.0;
        for pair in self.centre_line_m.windows(2) {
            let side = pair[1] - pair[0];
            let length_m = side.norm();
            if passed_m + length_m >= distance_m {
                let along = side / length_m;
                return Some(PlanFrame { origin_m: pair[0] + along * (distance_m - passed_m), along });
            }
            passed_m += length_m;
        }
        None
    }

    /// How far a place is from the centre line.
    #[must_use]
    pub fn distance_m(&self, plan_m: Vector2<f64>) -> f64 {
        let to_side = |pair: &[Vector2<f64>]| {
            let side = pair[1] - pair[0];
            let share = (side.dot(&(plan_m - pair[0])) / side.norm_squared()).clamp(0.0, 1.0);
            (plan_m - pair[0] - side * share).norm()
        };
        self.centre_line_m.windows(2).map(to_side).fold(f64::INFINITY, f64::min)
    }

    /// The strip between two distances to the left of the centre line, as one patch for each of its pieces.
    fn ribbon(&self, to_left_m: [f64; 2], material: Material) -> Vec<Patch> {
        let line = &self.centre_line_m;
        let aside = |i: usize, distance_m: f64| {
            let along = line[(i + 1).min(line.len() - 1)] - line[i.saturating_sub(1)];
            line[i] + left_of(along.normalize()) * distance_m
        };
        let [right, left] = to_left_m;
        let piece = |i: usize| Patch {
            corners_m: vec![aside(i, right), aside(i + 1, right), aside(i + 1, left), aside(i, left)],
            material,
        };
        (0..line.len() - 1).map(piece).collect()
    }

    fn centre_marks(&self) -> Vec<Patch> {
        let [mark_m, period_m] = CENTRE_MARK_M;
        let count = (self.length_m() / period_m) as u32;
        let marks = (0..count).filter_map(|i| self.frame_at(f64::from(i) * period_m + 1.0));
        marks
            .map(|frame| Patch {
                corners_m: frame.rectangle([0.0, mark_m], [-HALF_MARK_WIDTH_M, HALF_MARK_WIDTH_M]).to_vec(),
                material: Material::plain(0.85),
            })
            .collect()
    }
}

/// Long streets along the town's axis and cross streets between them. `half_length_m` is half the built-up length.
pub(crate) fn draw_streets(axis: PlanFrame, half_length_m: f64, rows: u32, draws: &mut Draws) -> Vec<Street> {
    const ROW_SPACING_M: f64 = 78.0;
    let beyond_m = half_length_m + 350.0;
    let first_row_m = -ROW_SPACING_M * f64::from(rows - 1) / 2.0;
    let mut streets: Vec<Street> = (0..rows)
        .map(|row| {
            let origin = axis.moved(0.0, first_row_m + ROW_SPACING_M * f64::from(row) + draws.within(4.0));
            // only the middle street leads out of the town
            let reach_m = if row == rows / 2 { beyond_m } else { half_length_m + draws.between(5.0, 25.0) };
            Street::bent(origin, [-reach_m, reach_m], draws.between(2.5, 3.3), draws)
        })
        .collect();
    if let Some(main) = streets.get_mut(rows as usize / 2) {
        main.half_roadway_m = 3.4;
        main.marked = true;
    }
    let across = axis.turned(std::f64::consts::FRAC_PI_2);
    let crossings = (2.0 * half_length_m / 105.0).round().max(1.0) as u32;
    for crossing in 0..crossings {
        let share = (f64::from(crossing) + 0.5) / f64::from(crossings) * 2.0 - 1.0;
        // the frame of a cross street looks across the town: its own left is the town's backward direction
        let origin = across.moved(0.0, -share * half_length_m + draws.within(9.0));
        let reach_m = if crossing == 0 { beyond_m } else { -first_row_m + draws.between(2.0, 30.0) };
        streets.push(Street::bent(origin, [first_row_m - draws.between(2.0, 30.0), reach_m], 2.6, draws));
    }
    streets
}

/// What the streets look like from above; crossings stay free of kerbs because all roadways come last.
pub(crate) fn street_patches(streets: &[Street], draws: &mut Draws) -> Vec<Patch> {
    let symmetric = |half_width_m: f64| [-half_width_m, half_width_m];
    let mut patches = Vec::new();
    for street in streets {
        patches.extend(street.ribbon(symmetric(street.half_width_m()), Material::paved(0.5)));
    }
    for street in streets {
        patches.extend(street.ribbon(symmetric(street.half_roadway_m + KERB_M), Material::plain(0.64)));
    }
    for street in streets {
        patches.extend(street.ribbon(symmetric(street.half_roadway_m), Material::paved(0.36)));
    }
    for street in streets {
        patches.extend(repairs(street, draws));
        if street.marked {
            patches.extend(street.centre_marks());
        }
    }
    patches
}

/// Patched asphalt and manhole covers.
fn repairs(street: &Street, draws: &mut Draws) -> Vec<Patch> {
    let mut patches = Vec::new();
    let mut at_m = draws.between(5.0, 40.0);
    while let Some(frame) = street.frame_at(at_m) {
        let aside_m = draws.within(street.half_roadway_m * 0.6);
        let (half_length_m, half_width_m, albedo) = if draws.chance(0.5) {
            (0.32, 0.32, 0.22)
        } else {
            (draws.between(0.6, 4.0), 0.5, draws.between(0.27, 0.33))
        };
        let corners =
            frame.moved(0.0, aside_m).rectangle([-half_length_m, half_length_m], [-half_width_m, half_width_m]);
        patches.push(Patch { corners_m: corners.to_vec(), material: Material::paved(albedo) });
        at_m += draws.between(15.0, 50.0);
    }
    patches
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::draws::{Purpose, direction};
    use approx::assert_relative_eq;

    #[test]
    fn places_along_a_street_lie_on_it() {
        let axis = PlanFrame { origin_m: Vector2::new(5.0, 8.0), along: direction(0.7) };
        let streets = draw_streets(axis, 150.0, 3, &mut Draws::new(2, Purpose::Town));
        assert!(streets.len() >= 5);
        for street in &streets {
            let length_m = street.length_m();
            for share in [0.0, 0.3, 0.99] {
                let place = street.frame_at(share * length_m).unwrap();
                assert_relative_eq!(street.distance_m(place.origin_m), 0.0, epsilon = 1e-9);
                assert_relative_eq!(street.distance_m(place.at(0.0, 2.0)), 2.0, epsilon = 0.1);
            }
            assert!(street.frame_at(length_m + 1.0).is_none());
        }
    }
}
