//! Which control points to use where there are many: those that may be in view, distinctive, well spread over the
//! ground.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::ControlPoint;
use super::predict::{Approximation, Prediction};
use crate::estimation::largest_sigma;
use crate::geometry::Camera;

/// So many standard deviations beside the frame a control point may still be in view.
const BESIDE_SIGMAS: f64 = 3.0;

/// The control points whose reference point may be in the image.
#[must_use]
pub fn maybe_in_view(control: &[ControlPoint], camera: &Camera, approximation: &Approximation) -> Vec<ControlPoint> {
    let orientation = approximation.orientation;
    let covariance = approximation.prior(&orientation).and_then(|prior| prior.information.try_inverse());
    let Some(covariance) = covariance else { return Vec::new() };
    let prediction = Prediction { orientation, covariance };
    let radius_px = camera.frame_radius_px();
    let may_be = |point: &&ControlPoint| {
        let expected = prediction.image_of(camera, point.reference_m, point.sigma_m);
        expected
            .is_some_and(|(image, covariance)| image.norm() < radius_px + BESIDE_SIGMAS * largest_sigma(&covariance))
    };
    control.iter().filter(may_be).cloned().collect()
}

/// Cells along a side of the grid over the ground that makes the selection well spread.
const CELLS: f64 = 8.0;
/// A direction counts as a new one if it differs from all others by so much.
const DIRECTION_RAD: f64 = 0.35;

/// At most `most` of the control points, in turn the best of every cell of a grid over the ground.
#[must_use]
pub fn well_spread(control: &[ControlPoint], most: usize) -> Vec<ControlPoint> {
    if control.len() <= most {
        return control.to_vec();
    }
    let references = || control.iter().map(|c| c.reference_m);
    let least = references().fold(Vector3::repeat(f64::INFINITY), |a, b| a.inf(&b));
    let largest = references().fold(Vector3::repeat(f64::NEG_INFINITY), |a, b| a.sup(&b));
    let side_m = ((largest - least).xy().max() / CELLS).max(1.0);
    let mut cells: BTreeMap<(i64, i64), Vec<usize>> = BTreeMap::new();
    for (index, reference) in references().enumerate() {
        let cell = (reference - least) / side_m;
        cells.entry((cell.x as i64, cell.y as i64)).or_default().push(index);
    }
    let mut ranked: Vec<(usize, Reverse<u64>, usize)> = Vec::with_capacity(control.len());
    for of_cell in cells.values_mut() {
        of_cell.sort_by_cached_key(|index| Reverse(distinctiveness(&control[*index])));
        let with_rank = of_cell.iter().enumerate();
        ranked.extend(with_rank.map(|(rank, index)| (rank, Reverse(distinctiveness(&control[*index])), *index)));
    }
    ranked.sort_unstable();
    let mut chosen: Vec<usize> = ranked.into_iter().take(most).map(|(_, _, index)| index).collect();
    chosen.sort_unstable();
    chosen.into_iter().map(|index| control[index].clone()).collect()
}

/// Length of the edges in decimetres, times the number of their directions in plan: a shift must be fixed in both
/// coordinates, and many parallel lines fix one. Edges that are less sure than the coordinates in general count less.
#[must_use]
pub fn distinctiveness(control_point: &ControlPoint) -> u64 {
    const LONGEST_M: f64 = 30.0;
    if control_point.scene.is_some() {
        return OF_A_SCENE;
    }
    let mut directions: Vec<f64> = Vec::new();
    let mut length_m = 0.0;
    for (number, edge) in control_point.edges_m.iter().enumerate() {
        let along = (edge.end - edge.start).xy();
        let sureness = (control_point.sigma_m / control_point.edge_sigma_m(number)).min(1.0);
        length_m += along.norm().min(LONGEST_M) * sureness;
        let direction = along.y.atan2(along.x);
        let half_turn = std::f64::consts::PI;
        let near = |d: &f64| {
            let turn = (direction - d).rem_euclid(half_turn);
            turn.min(half_turn - turn) < DIRECTION_RAD
        };
        if along.norm() > 1.0 && !directions.iter().any(near) {
            directions.push(direction);
        }
    }
    (10.0 * length_m) as u64 * directions.len().min(3) as u64
}

/// A scene counts like a house of 30 by 20 m.
const OF_A_SCENE: u64 = 2000;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Segment3;

    fn house(name: &str, at: Vector3<f64>, sides_m: [f64; 2]) -> ControlPoint {
        let corner = |x: f64, y: f64| at + Vector3::new(x * sides_m[0], y * sides_m[1], 0.0);
        let edges_m = vec![
            Segment3 { start: corner(0.0, 0.0), end: corner(1.0, 0.0) },
            Segment3 { start: corner(0.0, 0.0), end: corner(0.0, 1.0) },
        ];
        ControlPoint {
            name: name.into(),
            sigma_m: 0.05,
            reference_m: at,
            edges_m,
            edge_sigmas_m: Vec::new(),
            scene: None,
        }
    }

    #[test]
    fn every_corner_of_the_ground_is_represented_before_a_crowd_is() {
        let mut control: Vec<ControlPoint> =
            (0..50).map(|k| house(&format!("crowd{k}"), Vector3::new(f64::from(k), 0.0, 0.0), [10.0, 8.0])).collect();
        control.push(house("far", Vector3::new(900.0, 900.0, 0.0), [6.0, 6.0]));
        let names: Vec<String> = well_spread(&control, 4).into_iter().map(|c| c.name).collect();
        assert_eq!(names.len(), 4);
        assert!(names.contains(&"far".to_owned()));
    }

    #[test]
    fn two_directions_are_more_distinctive_than_one() {
        let cross = house("a", Vector3::zeros(), [10.0, 10.0]);
        let fence = house("b", Vector3::zeros(), [20.0, 0.0]);
        assert!(distinctiveness(&cross) > distinctiveness(&fence));
    }

    #[test]
    fn few_are_all_taken() {
        let control = vec![house("a", Vector3::zeros(), [10.0, 10.0])];
        assert_eq!(well_spread(&control, 5), control);
    }
}
