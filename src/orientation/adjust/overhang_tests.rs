//! Towns whose roofs overhang their walls by more than their model knows: eaves and verges lie 0.3 to 0.8 m outside.

use nalgebra::{Matrix6, Vector3, Vector6};

use super::*;
use crate::estimation::simulated::Draws;
use crate::geometry::{Brown, Segment2, Segment3, rotation};

const C_PX: f64 = 3000.0;
/// Standard deviation of the corners of the model.
const STATED_M: f64 = 0.15;
/// Root mean square of 0.3 to 0.8 m.
const OVERHANG_M: f64 = 0.57;
const RUNS: u32 = 150;

fn camera() -> Camera {
    Camera::new([4000, 3000], C_PX, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap()
}

/// A pixel is 15 cm on the ground.
fn truth() -> ExteriorOrientation {
    ExteriorOrientation {
        projection_centre_m: Vector3::new(3.0, -5.0, 450.0),
        camera_from_object: rotation::camera_from_object(0.03, -0.05, 0.4),
    }
}

/// A gabled roof: ridge, two eaves, four verges; of a house that is so much longer and wider on each side.
fn roof(at_m: Vector3<f64>, turned_rad: f64, overhang_m: f64) -> Vec<Segment3> {
    let (half_length, half_width) = (8.0 + overhang_m, 5.0 + overhang_m);
    // the roof goes on falling beyond the wall
    let (ridge_height, eave_height) = (10.0, 6.0 - 0.8 * overhang_m);
    let (sin, cos) = turned_rad.sin_cos();
    let corner = |x: f64, y: f64, z: f64| at_m + Vector3::new(cos * x - sin * y, sin * x + cos * y, z);
    let ridge = [-1.0, 1.0].map(|end| corner(end * half_length, 0.0, ridge_height));
    let eave = |side: f64| [-1.0, 1.0].map(|end| corner(end * half_length, side * half_width, eave_height));
    let eaves = [eave(-1.0), eave(1.0)];
    let line = |start, end| Segment3 { start, end };
    let verges = eaves.iter().flat_map(|eave| (0..2).map(|end| line(eave[end], ridge[end])));
    [line(ridge[0], ridge[1]), line(eaves[0][0], eaves[0][1]), line(eaves[1][0], eaves[1][1])]
        .into_iter()
        .chain(verges)
        .collect()
}

/// Only the ridge is where the model has it.
fn sigmas_by_kind_m() -> Vec<f64> {
    let outer = STATED_M.hypot(OVERHANG_M);
    vec![STATED_M, outer, outer, outer, outer, outer, outer]
}

struct Town {
    control: Vec<ControlPoint>,
    observed: Vec<ObservedSegment>,
    buildings: Vec<Building>,
}

/// Twelve houses and what a photograph shows of two thirds of their edges.
fn town(draws: &mut Draws) -> Town {
    let mut town = Town { control: Vec::new(), observed: Vec::new(), buildings: Vec::new() };
    for k in 0..12_u32 {
        let place = Vector3::new(f64::from(k % 4) * 130.0 - 195.0, f64::from(k / 4) * 130.0 - 130.0, f64::from(k % 5));
        let turned_rad = draws.even(0.0, std::f64::consts::PI);
        let seen = roof(place, turned_rad, draws.even(0.3, 0.8));
        // half of the variance of the coordinates is that of the whole building
        let mut error = |share: f64| Vector3::from_fn(|_, _| share.sqrt() * STATED_M * draws.normal());
        let whole = error(0.5);
        let mut edges_m = roof(place, turned_rad, 0.0);
        for edge in &mut edges_m {
            let common = whole + error(0.25);
            edge.start += common + error(0.25);
            edge.end += common + error(0.25);
        }
        let mut matches = Vec::new();
        for (edge, line) in seen.iter().enumerate() {
            if draws.even(0.0, 1.0) > 0.67 {
                continue;
            }
            let image = |point| truth().reduced_px(C_PX, point).unwrap();
            let exact = Segment2 { start: image(line.start), end: image(line.end) };
            // the gutter, not the rim
            let off = exact.normal() * 0.67 * draws.normal();
            let segment_px = Segment2 { start: exact.start + off, end: exact.end + off };
            matches.push(Match { edge, segment: town.observed.len(), at: [0.0, 1.0] });
            town.observed.push(ObservedSegment {
                segment_px,
                direction: segment_px.direction(),
                length_px: segment_px.length(),
                covariance_across: Matrix2::identity() * 0.02,
                coarse: false,
                file_px: segment_px,
            });
        }
        let building = Building { control_point: k as usize, matches, measured: None, shift_px: Vector2::zeros() };
        town.buildings.push(building);
        let reference_m = edges_m.iter().map(Segment3::midpoint).sum::<Vector3<f64>>() / edges_m.len() as f64;
        let name = format!("house {k}");
        let edge_sigmas_m = sigmas_by_kind_m();
        town.control.push(ControlPoint { name, sigma_m: STATED_M, reference_m, edges_m, edge_sigmas_m, scene: None });
    }
    town
}

/// Root mean square error of the projection centre, and mean squared error of all six parameters in units of their
/// covariance: 6 where that is honest.
fn errors(with: impl Fn(&mut ControlPoint)) -> (f64, f64) {
    let sigmas = Vector6::new(20.0, 20.0, 20.0, 0.2, 0.2, 0.2);
    let prior = Prior { orientation: truth(), information: Matrix6::from_diagonal(&sigmas.map(|s: f64| s.powi(-2))) };
    let (mut squares_m2, mut weighted) = (0.0, 0.0);
    for run in 0..RUNS {
        let Town { mut control, observed, buildings } = town(&mut Draws::new(run.into()));
        control.iter_mut().for_each(&with);
        let model = Model { camera: &camera(), control: &control, observed: &observed, prior: &prior };
        let adjusted = model.adjust(buildings, &truth()).unwrap();
        let error = truth().step_to(&adjusted.orientation);
        let covariance = adjusted.prediction().covariance;
        squares_m2 += error.fixed_rows::<3>(0).norm_squared() / f64::from(RUNS);
        weighted += error.dot(&(covariance.try_inverse().unwrap() * error)) / f64::from(RUNS);
    }
    (squares_m2.sqrt(), weighted)
}

#[test]
fn eaves_that_are_less_sure_leave_the_orientation_to_the_ridges() {
    let (by_kind_m, by_kind) = errors(|_| {});
    let (stated_m, stated) = errors(|point| point.edge_sigmas_m.clear());
    let (vague_m, vague) = errors(|point| {
        point.sigma_m = STATED_M.hypot(OVERHANG_M);
        point.edge_sigmas_m.clear();
    });
    let told = format!(
        "by kind {by_kind_m:.3} m ({by_kind:.1}), stated {stated_m:.3} m ({stated:.1}), vague {vague_m:.3} m ({vague:.1})"
    );
    assert!(by_kind_m < 0.8 * stated_m, "{told}");
    assert!(by_kind_m < 0.9 * vague_m, "{told}");
    assert!((2.0..8.0).contains(&by_kind), "{told}");
    assert!(stated > 1.5 * by_kind, "{told}");
}

#[test]
fn edges_as_good_as_their_control_point_change_nothing() {
    let alike = errors(|point| point.edge_sigmas_m = vec![point.sigma_m; point.edges_m.len()]);
    assert_eq!(alike, errors(|point| point.edge_sigmas_m.clear()));
}
