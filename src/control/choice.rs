//! The best of thousands of buildings that may be in view of an image of a city. The search takes a few dozen; which ones
//! it cannot know from distances alone.

use std::cmp::Reverse;
use std::collections::HashMap;

use nalgebra::{Vector2, Vector3};

use crate::orientation::ControlPoint;
use crate::orientation::select::distinctiveness;

/// Cells along a side of the grid over the ground that spreads the choice.
const CELLS: f64 = 20.0;
/// A building that others hide counts so much: the models of the others may be wrong, and a part of it may show.
const HIDDEN: f64 = 0.1;
/// Cells in which buildings are looked for that hide others: a little larger than most of them.
const NEIGHBOURS_M: f64 = 40.0;
/// Steps along the ray to the camera.
const STEP_M: f64 = 8.0;
/// No building is so much higher than another that it hides it from farther away.
const FARTHEST_M: f64 = 400.0;

/// At most `most` of the buildings, in their order; all if there are no more. In turn the best of each cell of a grid over
/// the ground: the most distinctive ones, that are large in the image and not hidden by taller neighbours as the camera
/// sees them.
#[must_use]
pub fn chosen_of_many(points: Vec<ControlPoint>, camera_m: Vector3<f64>, most: usize) -> Vec<ControlPoint> {
    if points.len() <= most {
        return points;
    }
    let bodies: Vec<Body> = points.iter().map(Body::of).collect();
    let town = Town::of(&bodies);
    let value = |(index, point): (usize, &ControlPoint)| {
        let distance_m = (point.reference_m - camera_m).norm().max(1.0);
        let shown = if town.hides(&bodies, index, camera_m) { HIDDEN } else { 1.0 };
        // in the image all lengths are divided by the distance
        distinctiveness(point) as f64 * shown / distance_m
    };
    let values: Vec<f64> = points.iter().enumerate().map(value).collect();
    let mut cells: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
    for (index, body) in bodies.iter().enumerate() {
        cells.entry(cell(body.middle_m - town.least_m, town.side_m / CELLS)).or_default().push(index);
    }
    let mut ranked = Vec::with_capacity(points.len());
    for of_cell in cells.values_mut() {
        of_cell.sort_by(|a, b| values[*b].total_cmp(&values[*a]).then(a.cmp(b)));
        ranked.extend(of_cell.iter().enumerate().map(|(rank, index)| (rank, Reverse(values[*index]), *index)));
    }
    ranked.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.0.total_cmp(&b.1.0).reverse()).then(a.2.cmp(&b.2)));
    let mut taken = vec![false; points.len()];
    ranked.into_iter().take(most).for_each(|(_, _, index)| taken[index] = true);
    points.into_iter().zip(taken).filter_map(|(point, taken)| taken.then_some(point)).collect()
}

/// What a building takes up: an upright cylinder.
struct Body {
    middle_m: Vector2<f64>,
    radius_m: f64,
    top_m: f64,
}

impl Body {
    fn of(point: &ControlPoint) -> Self {
        let ends = || point.edges_m.iter().flat_map(|edge| [edge.start, edge.end]).chain([point.reference_m]);
        let start = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        let (least_m, largest_m) = ends().fold(start, |(a, b), end| (a.inf(&end.xy()), b.sup(&end.xy())));
        Self {
            middle_m: (least_m + largest_m) / 2.0,
            // of the circle in it: what the corners of a box would hide is air as a rule
            radius_m: (largest_m - least_m).min() / 2.0,
            top_m: ends().map(|end| end.z).fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

/// All buildings, by where they are.
struct Town {
    least_m: Vector2<f64>,
    side_m: f64,
    highest_m: f64,
    cells: HashMap<[i64; 2], Vec<usize>>,
}

fn cell(place_m: Vector2<f64>, side_m: f64) -> [i64; 2] {
    [(place_m.x / side_m).floor() as i64, (place_m.y / side_m).floor() as i64]
}

impl Town {
    fn of(bodies: &[Body]) -> Self {
        let places = || bodies.iter().map(|body| body.middle_m);
        let least_m = places().fold(Vector2::repeat(f64::INFINITY), |a, b| a.inf(&b));
        let largest_m = places().fold(Vector2::repeat(f64::NEG_INFINITY), |a, b| a.sup(&b));
        let mut cells: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
        for (index, body) in bodies.iter().enumerate() {
            cells.entry(cell(body.middle_m, NEIGHBOURS_M)).or_default().push(index);
        }
        let highest_m = bodies.iter().map(|body| body.top_m).fold(f64::NEG_INFINITY, f64::max);
        Self { least_m, side_m: (largest_m - least_m).max().max(1.0), highest_m, cells }
    }

    /// Whether another building stands between the roof of one and the camera.
    fn hides(&self, bodies: &[Body], index: usize, camera_m: Vector3<f64>) -> bool {
        let body = &bodies[index];
        let towards_m = camera_m.xy() - body.middle_m;
        let (distance_m, above_m) = (towards_m.norm(), camera_m.z - body.top_m);
        if above_m <= 0.0 || distance_m < 1.0 {
            return false;
        }
        let rise = above_m / distance_m;
        // where the ray is above all roofs nothing hides it
        let end_m = ((self.highest_m - body.top_m) / rise).min(FARTHEST_M).min(distance_m);
        let ahead = towards_m / distance_m;
        let steps = (end_m / STEP_M).ceil() as usize;
        (1..=steps).any(|step| {
            let along_m = STEP_M * step as f64;
            let (place_m, height_m) = (body.middle_m + ahead * along_m, body.top_m + rise * along_m);
            self.stands_at(bodies, index, place_m, height_m)
        })
    }

    fn stands_at(&self, bodies: &[Body], except: usize, place_m: Vector2<f64>, height_m: f64) -> bool {
        let [x, y] = cell(place_m, NEIGHBOURS_M);
        let near = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [x + i, y + j]));
        near.filter_map(|cell| self.cells.get(&cell)).flatten().any(|other| {
            let body = &bodies[*other];
            *other != except && body.top_m > height_m && (body.middle_m - place_m).norm() < body.radius_m
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Segment3;

    fn house(name: String, at_m: Vector3<f64>, side_m: f64) -> ControlPoint {
        let corner = |x: f64, y: f64| at_m + Vector3::new(x * side_m, y * side_m, 0.0);
        let rim = [corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)];
        let edges_m = (0..4).map(|i| Segment3 { start: rim[i], end: rim[(i + 1) % 4] }).collect();
        ControlPoint { name, sigma_m: 0.1, reference_m: at_m, edges_m, edge_sigmas_m: Vec::new(), scene: None }
    }

    /// A town of 70 by 70 houses, every 20 m, of which every 49th is large.
    fn town() -> Vec<ControlPoint> {
        let places = (0..4_900_u32).map(|k| (k, f64::from(k % 70) * 20.0, f64::from(k / 70) * 20.0));
        places
            .map(|(k, x, y)| {
                let side_m = if (k % 70) % 7 == 3 && (k / 70) % 7 == 3 { 18.0 } else { 9.0 };
                house(format!("{k}"), Vector3::new(x, y, 10.0), side_m)
            })
            .collect()
    }

    #[test]
    fn few_are_all_taken_as_they_are() {
        let few: Vec<ControlPoint> = town().into_iter().take(300).collect();
        assert_eq!(chosen_of_many(few.clone(), Vector3::new(0.0, 0.0, 900.0), 300), few);
    }

    #[test]
    fn the_large_ones_are_taken_everywhere() {
        let camera_m = Vector3::new(700.0, 700.0, 1_500.0);
        let chosen = chosen_of_many(town(), camera_m, 400);
        assert_eq!(chosen.len(), 400);
        let large = chosen.iter().filter(|c| c.edges_m[0].length() > 10.0).count();
        assert_eq!(large, 100);
        for quarter in [[0.0, 0.0], [700.0, 0.0], [0.0, 700.0], [700.0, 700.0]] {
            let within = |c: &&ControlPoint| {
                let offset_m = c.reference_m.xy() - Vector2::from(quarter);
                offset_m.min() >= 0.0 && offset_m.max() < 700.0
            };
            let count = chosen.iter().filter(within).count();
            assert!((80..120).contains(&count), "{count} of 400 in a quarter");
        }
    }

    #[test]
    fn behind_a_tower_nothing_shows_from_the_side() {
        let mut town = town();
        // a tower of 90 m in the row of 20 m to the south
        town[35 * 70 + 35] = house("tower".into(), Vector3::new(700.0, 700.0, 90.0), 18.0);
        let bodies: Vec<Body> = town.iter().map(Body::of).collect();
        let places = Town::of(&bodies);
        let behind = 36 * 70 + 35;
        let oblique = Vector3::new(700.0, -1_500.0, 1_000.0);
        assert!(places.hides(&bodies, behind, oblique));
        assert!(!places.hides(&bodies, behind, Vector3::new(700.0, 760.0, 1_500.0)));
        assert!(!places.hides(&bodies, 34 * 70 + 35, oblique));
        assert!(!places.hides(&bodies, 10 * 70 + 10, oblique));
    }
}
