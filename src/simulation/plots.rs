//! The plots along the streets: house, garage or shed, drive, path, terrace, beds, fence or hedge, trees, cars.

use nalgebra::Vector2;

use super::building::{Building, Roof, Use, roof_details};
use super::draws::Draws;
use super::greenery::{broadleaf, conifer, hedge};
use super::streets::Street;
use super::surface::{Face, Material, Patch, PlanFrame, Puff, block, raised};
use super::terrain::Terrain;

/// What has been built so far.
pub(crate) struct Site<'a> {
    pub(crate) terrain: &'a Terrain,
    pub(crate) streets: &'a [Street],
    pub(crate) buildings: Vec<Building>,
    /// Beside the buildings' own: roof details, cars, fences.
    pub(crate) faces: Vec<Face>,
    pub(crate) patches: Vec<Patch>,
    pub(crate) puffs: Vec<Puff>,
    /// See `TownSettings`.
    pub(crate) trees: f64,
    /// See `TownSettings`.
    pub(crate) share_alike: f64,
}

/// A plot: `along` the street, the left of it leading into the plot; the origin lies on the street's centre line.
struct Plot {
    frame: PlanFrame,
    half_front_m: f64,
    front_m: f64,
    back_m: f64,
    /// Where the house is drawn from, if it is like its neighbours.
    pattern: Option<Draws>,
}

const CLEARANCE_M: f64 = 2.2;

impl Site<'_> {
    /// Fills both sides of a street, where it runs through the built-up part, with plots.
    pub(crate) fn build_along(&mut self, street: &Street, axis: PlanFrame, half_length_m: f64, draws: &mut Draws) {
        for side in [1.0, -1.0] {
            let mut at_m = draws.between(0.0, 12.0);
            // nothing is drawn where no rows are alike: the other draws stay what they are
            let alike = self.share_alike > 0.0 && draws.chance(self.share_alike);
            let pattern = alike.then(|| draws.clone());
            loop {
                let half_front_m = pattern.clone().as_mut().unwrap_or(draws).between(9.5, 13.5);
                let Some(middle) = street.frame_at(at_m + half_front_m) else { break };
                at_m += 2.0 * half_front_m;
                let inside = axis.along.dot(&(middle.origin_m - axis.origin_m)).abs() < half_length_m;
                if !inside || draws.chance(0.07) {
                    continue; // a gap between the houses
                }
                let frame = PlanFrame { origin_m: middle.origin_m, along: middle.along * side };
                let front_m = street.half_width_m();
                self.lay_out(
                    &Plot {
                        frame,
                        half_front_m,
                        front_m,
                        back_m: front_m + draws.between(25.0, 32.0),
                        pattern: pattern.clone(),
                    },
                    draws,
                );
            }
        }
    }

    fn lay_out(&mut self, plot: &Plot, draws: &mut Draws) {
        let house = self.house_on(plot, plot.pattern.clone().as_mut().unwrap_or(draws));
        let Some(house) = house else { return };
        let Plot { frame, half_front_m, front_m, back_m, .. } = *plot;
        self.paint(frame, [-half_front_m, half_front_m], [front_m, back_m], Material::grass(draws.between(0.3, 0.44)));
        let away = house.centre_m - frame.origin_m;
        let (house_along_m, house_across_m) = (frame.along.dot(&away), super::surface::left_of(frame.along).dot(&away));
        self.lay_paths(plot, house_along_m, house_across_m, draws);
        self.lay_gardens(plot, house_across_m + house.length_m.max(house.width_m) / 2.0, draws);
        self.build(house, draws);
        self.build_garage(plot, house_along_m, house_across_m, draws);
        self.build_shed(plot, draws);
        self.enclose(plot, draws);
        self.plant(plot, draws);
    }

    fn house_on(&self, plot: &Plot, draws: &mut Draws) -> Option<Building> {
        let hall = draws.chance(0.08);
        let (length_m, width_m) = if hall {
            (draws.between(17.0, 23.0), draws.between(10.0, 12.5))
        } else {
            let width_m = draws.between(7.5, 10.5);
            (width_m + draws.between(1.5, 5.5), width_m)
        };
        let gable_to_street = length_m < 2.0 * plot.half_front_m && draws.chance(0.35);
        let quarter = if gable_to_street { std::f64::consts::FRAC_PI_2 } else { 0.0 };
        let depth_m = if gable_to_street { length_m } else { width_m };
        let across_m = plot.front_m + draws.between(2.5, 6.5) + depth_m / 2.0;
        let along_m = draws.within((plot.half_front_m - length_m / 2.0 - 1.0).max(0.5));
        let skew_rad = if draws.chance(0.15) { draws.within(0.2) } else { draws.within(0.04) };
        let place = plot.frame.moved(along_m, across_m).turned(quarter + skew_rad);
        let house = self.draw_building(place, length_m, width_m, draws);
        self.is_free(&house).then_some(house)
    }

    fn draw_building(&self, place: PlanFrame, length_m: f64, width_m: f64, draws: &mut Draws) -> Building {
        let form = draws.between(0.0, 1.0);
        let roof = match form {
            f if f < 0.58 => Roof::Gable { slope: draws.between(0.55, 1.05) },
            f if f < 0.86 => Roof::Hip { slope: draws.between(0.42, 0.8) },
            _ => Roof::Flat,
        };
        let flat = matches!(roof, Roof::Flat);
        Building {
            purpose: Use::Main,
            centre_m: place.origin_m,
            ridge_direction: place.along,
            length_m,
            width_m,
            ground_m: self.terrain.height_m(place.origin_m),
            wall_height_m: if flat { draws.between(3.2, 7.0) } else { draws.between(2.8, 5.6) },
            roof,
            overhang_m: if flat { draws.between(0.0, 0.2) } else { draws.between(0.25, 0.7) },
            roof_material: roof_material(flat, draws),
            wall_material: Material::plain(draws.between(0.5, 0.8)),
        }
    }

    fn is_free(&self, building: &Building) -> bool {
        let corners = building.footprint_grown_m(building.overhang_m + CLEARANCE_M / 2.0);
        let off_the_streets =
            self.streets.iter().all(|street| probes(&corners).all(|p| street.distance_m(p) > street.half_width_m()));
        let off_others = |other: &Building| {
            let others = other.footprint_grown_m(other.overhang_m + CLEARANCE_M / 2.0);
            !overlap(&corners, &others)
        };
        off_the_streets && self.buildings.iter().all(off_others)
    }

    /// Adds a building with what is on its roof.
    fn build(&mut self, building: Building, draws: &mut Draws) {
        self.faces.extend(roof_details(&building, draws));
        self.buildings.push(building);
    }

    fn build_garage(&mut self, plot: &Plot, house_along_m: f64, house_across_m: f64, draws: &mut Draws) {
        if !draws.chance(0.6) {
            return;
        }
        // at the plot's side with more room
        let side = if house_along_m > 0.0 { -1.0 } else { 1.0 };
        let along_m = side * (plot.half_front_m - 2.2);
        let place = plot.frame.moved(along_m, house_across_m + draws.within(2.0)).turned(std::f64::consts::FRAC_PI_2);
        let roof = if draws.chance(0.7) { Roof::Flat } else { Roof::Gable { slope: draws.between(0.4, 0.7) } };
        let garage = Building {
            purpose: Use::Outbuilding,
            wall_height_m: draws.between(2.3, 2.9),
            overhang_m: 0.12,
            roof,
            roof_material: roof_material(roof == Roof::Flat, draws),
            ..self.draw_building(place, draws.between(5.8, 7.0), draws.between(3.0, 3.6), draws)
        };
        if self.is_free(&garage) {
            let door_m = house_across_m - 3.5;
            self.paint(plot.frame, [along_m - 1.5, along_m + 1.5], [plot.front_m, door_m], drive(draws));
            if draws.chance(0.55) && door_m - plot.front_m > 5.0 {
                self.park(plot.frame.moved(along_m, plot.front_m + 2.8).turned(std::f64::consts::FRAC_PI_2), draws);
            }
            self.build(garage, draws);
        }
    }

    fn build_shed(&mut self, plot: &Plot, draws: &mut Draws) {
        if !draws.chance(0.55) {
            return;
        }
        let along_m = draws.within(plot.half_front_m - 3.5);
        let place = plot.frame.moved(along_m, plot.back_m - draws.between(2.5, 6.0)).turned(draws.within(0.15));
        let (length_m, width_m) = (draws.between(3.0, 5.5), draws.between(2.2, 3.0));
        let shed = Building {
            purpose: Use::Outbuilding,
            wall_height_m: draws.between(1.9, 2.3),
            overhang_m: 0.2,
            ..self.draw_building(place, length_m, width_m, draws)
        };
        if self.is_free(&shed) {
            self.buildings.push(shed);
        }
    }

    fn lay_paths(&mut self, plot: &Plot, house_along_m: f64, house_across_m: f64, draws: &mut Draws) {
        let path_m = house_along_m + draws.within(3.0);
        self.paint(plot.frame, [path_m - 0.6, path_m + 0.6], [plot.front_m, house_across_m], drive(draws));
        if draws.chance(0.7) {
            let half_terrace_m = draws.between(2.0, 4.0);
            let terrace_m = [house_along_m - half_terrace_m, house_along_m + half_terrace_m];
            self.paint(plot.frame, terrace_m, [house_across_m, house_across_m + draws.between(7.5, 9.5)], drive(draws));
        }
    }

    fn lay_gardens(&mut self, plot: &Plot, from_m: f64, draws: &mut Draws) {
        let room_m = plot.back_m - from_m;
        if room_m < 4.0 {
            return;
        }
        if draws.chance(0.45) {
            let (middle_m, half_m) = (draws.within(plot.half_front_m - 4.0), draws.between(1.5, 3.5));
            let rows = Material { grain: 0.2, ..Material::grass(draws.between(0.24, 0.4)) }.striped(
                plot.frame.along,
                draws.between(0.5, 1.2),
                draws.between(0.1, 0.3),
            );
            let end_m = plot.back_m - draws.between(0.5, 2.0);
            self.paint(plot.frame, [middle_m - half_m, middle_m + half_m], [end_m - room_m * 0.5, end_m], rows);
        }
        if draws.chance(0.3) {
            let (along_m, across_m) = (draws.within(plot.half_front_m - 3.0), plot.back_m - room_m * 0.6);
            let worn = Material::grass(draws.between(0.45, 0.58));
            self.paint(plot.frame, [along_m - 1.5, along_m + 1.5], [across_m - 1.2, across_m + 1.2], worn);
        }
    }

    /// Fences or hedges on two sides and at the back (the third side is the neighbour's).
    fn enclose(&mut self, plot: &Plot, draws: &mut Draws) {
        let (left_m, right_m) = (plot.half_front_m - 0.2, -plot.half_front_m + 0.2);
        let at = |along_m, across_m| plot.frame.at(along_m, across_m);
        let back_m = plot.back_m - 0.2;
        let (near_m, kind) = (plot.front_m + draws.between(0.4, 5.0), draws.between(0.0, 1.0));
        for (from, to) in [(at(left_m, near_m), at(left_m, back_m)), (at(left_m, back_m), at(right_m, back_m))] {
            let line = if draws.chance(0.8) { kind } else { draws.between(0.0, 1.0) };
            match line {
                k if k < 0.4 => self.raise_fence(from, to, draws),
                k if k < 0.75 => self.plant_hedge(from, to, draws),
                _ => {}
            }
        }
    }

    fn raise_fence(&mut self, from_m: Vector2<f64>, to_m: Vector2<f64>, draws: &mut Draws) {
        if !self.is_off_the_streets(from_m) || !self.is_off_the_streets(to_m) {
            return;
        }
        let (height_m, material) = (draws.between(0.8, 1.5), Material::plain(draws.between(0.3, 0.75)));
        let [from_ground_m, to_ground_m] = [from_m, to_m].map(|place| self.terrain.height_m(place));
        let axis = PlanFrame { origin_m: from_m, along: (to_m - from_m).normalize() };
        let footprint = axis.rectangle([0.0, (to_m - from_m).norm()], [-0.05, 0.05]);
        let heights = [from_ground_m.min(to_ground_m) - 0.3, from_ground_m.max(to_ground_m) + height_m];
        self.faces.extend(block(footprint, heights, material, material));
    }

    fn plant_hedge(&mut self, from_m: Vector2<f64>, to_m: Vector2<f64>, draws: &mut Draws) {
        if self.is_off_the_streets(from_m) && self.is_off_the_streets(to_m) {
            self.puffs.extend(hedge(from_m, to_m, self.terrain, draws));
        }
    }

    fn plant(&mut self, plot: &Plot, draws: &mut Draws) {
        let trees = f64::from(draws.below(7)) * self.trees;
        for _ in 0..trees.round() as u32 {
            let in_front = draws.chance(0.2);
            let across_m = if in_front { plot.front_m + 1.8 } else { plot.back_m - draws.between(1.5, 15.0) };
            let place = plot.frame.at(draws.within(plot.half_front_m - 1.0), across_m);
            let crown_m = if in_front { draws.between(0.9, 1.7) } else { draws.between(1.2, 3.8) };
            self.plant_tree(place, crown_m, draws);
        }
        for _ in 0..draws.below(4) {
            let place = plot.frame.at(draws.within(plot.half_front_m - 0.6), draws.between(plot.front_m, plot.back_m));
            self.plant_tree(place, draws.between(0.4, 0.8), draws);
        }
    }

    /// A tree, unless it would stand in a street or too near to a wall.
    pub(crate) fn plant_tree(&mut self, place_m: Vector2<f64>, crown_m: f64, draws: &mut Draws) {
        let square = PlanFrame { origin_m: place_m, along: Vector2::x() };
        let trunk = square.rectangle([-0.5, 0.5], [-0.5, 0.5]);
        let margin_m = 0.55 * crown_m;
        let clear = |building: &Building| !overlap(&trunk, &building.footprint_grown_m(margin_m));
        if self.is_off_the_streets(place_m) && self.buildings.iter().all(clear) {
            let tree = if draws.chance(0.22) { conifer } else { broadleaf };
            self.puffs.extend(tree(place_m, crown_m, self.terrain, draws));
        }
    }

    /// A car that looks along a frame.
    pub(crate) fn park(&mut self, frame: PlanFrame, draws: &mut Draws) {
        let ground_m = self.terrain.height_m(frame.origin_m);
        let paint =
            Material { mottle: 0.0, grain: 0.02, ..Material::plain(draws.one_of(&[0.1, 0.16, 0.3, 0.45, 0.62, 0.85])) };
        let glass = Material::plain(0.09);
        let body = frame.rectangle([-2.2, 2.2], [-0.88, 0.88]);
        self.faces.extend(block(body, [ground_m + 0.25, ground_m + 0.9], paint, paint));
        let cabin = frame.rectangle([-1.75, 0.75], [-0.75, 0.75]);
        self.faces.extend(block(cabin, [ground_m + 0.9, ground_m + 1.05], glass, glass));
        let top = frame.rectangle([-1.35, 0.25], [-0.65, 0.65]).map(|corner| raised(corner, ground_m + 1.45));
        self.faces.push(Face::new(top.to_vec(), paint));
    }

    fn is_off_the_streets(&self, place_m: Vector2<f64>) -> bool {
        self.streets.iter().all(|street| street.distance_m(place_m) > street.half_width_m())
    }

    fn paint(&mut self, frame: PlanFrame, along_m: [f64; 2], across_m: [f64; 2], material: Material) {
        self.patches.push(Patch { corners_m: frame.rectangle(along_m, across_m).to_vec(), material });
    }
}

fn drive(draws: &mut Draws) -> Material {
    Material::paved(draws.between(0.42, 0.68))
}

fn roof_material(flat: bool, draws: &mut Draws) -> Material {
    if flat {
        return Material { mottle: 0.1, ..Material::paved(draws.one_of(&[0.28, 0.38, 0.5, 0.62])) };
    }
    let albedo = draws.one_of(&[0.2, 0.3, 0.36, 0.4, 0.44, 0.5]) * draws.between(0.9, 1.1);
    let tiles = Material { mottle: 0.1, grain: 0.06, ..Material::plain(albedo) };
    // rows of tiles run along the eaves, so the stripes change across them
    tiles.striped(Vector2::y(), draws.between(0.3, 0.42), draws.between(0.0, 0.07))
}

/// Corners and points between them.
fn probes(corners: &[Vector2<f64>; 4]) -> impl Iterator<Item = Vector2<f64>> {
    (0..4).flat_map(|i| {
        let (from, to) = (corners[i], corners[(i + 1) % 4]);
        (0..4).map(move |step| from + (to - from) * (f64::from(step) / 4.0))
    })
}

/// Whether two rectangles overlap: no side of either separates them.
fn overlap(first: &[Vector2<f64>; 4], second: &[Vector2<f64>; 4]) -> bool {
    let separated_by = |axis: Vector2<f64>| {
        let range = |corners: &[Vector2<f64>; 4]| {
            let along = corners.map(|corner| corner.dot(&axis));
            (along.into_iter().fold(f64::INFINITY, f64::min), along.into_iter().fold(f64::NEG_INFINITY, f64::max))
        };
        let ((a, b), (c, d)) = (range(first), range(second));
        b < c || d < a
    };
    let sides = |corners: &[Vector2<f64>; 4]| [corners[1] - corners[0], corners[2] - corners[1]];
    !sides(first).into_iter().chain(sides(second)).any(separated_by)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::draws::direction;

    #[test]
    fn rectangles_overlap_if_they_share_ground() {
        let rectangle = |east: f64, angle: f64| {
            let frame = PlanFrame { origin_m: Vector2::new(east, 0.0), along: direction(angle) };
            frame.rectangle([-2.0, 2.0], [-1.0, 1.0])
        };
        assert!(overlap(&rectangle(0.0, 0.0), &rectangle(3.9, 0.0)));
        assert!(!overlap(&rectangle(0.0, 0.0), &rectangle(4.1, 0.0)));
        // a corner that points between two parallel sides: only the turned sides separate
        assert!(!overlap(&rectangle(0.0, std::f64::consts::FRAC_PI_4), &rectangle(3.9, std::f64::consts::FRAC_PI_4)));
        assert!(overlap(&rectangle(0.0, 0.0), &rectangle(1.0, 1.0)));
    }
}
