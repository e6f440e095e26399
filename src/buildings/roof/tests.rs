//! Roofs whose edges are known in closed form.

use super::*;
use crate::buildings::EdgeKind::{self, Eave, Gable, Hip, Ridge, Rim, Valley};

type Point = [f64; 3];

fn surfaces(polygons: &[&[&[Point]]]) -> Surfaces {
    let mut surfaces = Surfaces::default();
    for rings in polygons {
        for ring in *rings {
            ring.iter().for_each(|point| surfaces.point(*point));
            surfaces.end_ring();
        }
        surfaces.end_polygon();
    }
    surfaces
}

fn found(polygons: &[&[&[Point]]]) -> Vec<(EdgeKind, Point, Point)> {
    sorted(edges(&surfaces(polygons), false).unwrap().iter().map(|edge| (edge.kind, edge.start, edge.end)).collect())
}

/// Edges in one order, each with the smaller end first.
fn sorted(mut edges: Vec<(EdgeKind, Point, Point)>) -> Vec<(EdgeKind, Point, Point)> {
    for (_, start, end) in &mut edges {
        if *start > *end {
            std::mem::swap(start, end);
        }
    }
    edges.sort_by(|a, b| a.partial_cmp(b).unwrap());
    edges
}

/// Eaves at 5 m over 12 m by 8 m, the ridge at 9 m in the middle, along x.
const A: Point = [0.0, 0.0, 5.0];
const B: Point = [12.0, 0.0, 5.0];
const C: Point = [12.0, 8.0, 5.0];
const D: Point = [0.0, 8.0, 5.0];
const E: Point = [0.0, 4.0, 9.0];
const F: Point = [12.0, 4.0, 9.0];

fn gable_roof() -> Vec<(EdgeKind, Point, Point)> {
    sorted(vec![(Eave, A, B), (Eave, C, D), (Ridge, E, F), (Gable, A, E), (Gable, D, E), (Gable, B, F), (Gable, C, F)])
}

#[test]
fn a_gable_roof_has_two_eaves_a_ridge_and_four_gables() {
    assert_eq!(found(&[&[&[A, B, F, E]], &[&[C, D, E, F]]]), gable_roof());
}

#[test]
fn it_is_the_same_the_wrong_way_round_and_far_away() {
    assert_eq!(found(&[&[&[E, F, B, A]], &[&[C, D, E, F]]]), gable_roof());
    let move_ = |point: Point| [point[0] + 356_000.0, point[1] + 5_645_000.0, point[2] + 50.0];
    let expected: Vec<_> = gable_roof().into_iter().map(|(kind, a, b)| (kind, move_(a), move_(b))).collect();
    let moved = found(&[&[&[A, B, F, E].map(move_)], &[&[C, D, E, F].map(move_)]]);
    assert_eq!(moved, sorted(expected));
}

#[test]
fn it_is_the_same_in_triangles_and_with_points_that_are_off_by_centimetres() {
    assert_eq!(found(&[&[&[A, B, F]], &[&[A, F, E]], &[&[C, D, E]], &[&[C, E, F]]]), gable_roof());
    let off = |point: Point| [point[0] + 0.02, point[1] - 0.02, point[2] + 0.01];
    let edges = found(&[&[&[A, B, F, E]], &[&[C, D, off(E), off(F)]]]);
    let kinds: Vec<_> = edges.iter().map(|(kind, ..)| *kind).collect();
    assert_eq!(kinds, [Eave, Eave, Ridge, Gable, Gable, Gable, Gable]);
}

#[test]
fn a_point_on_a_side_does_not_cut_the_edge() {
    let (on_eave, on_ridge) = ([5.0, 0.0, 5.0], [7.0, 4.0, 9.0]);
    assert_eq!(found(&[&[&[A, on_eave, B, F, E]], &[&[C, D, E, on_ridge, F]]]), gable_roof());
    // one slope in three strips, so that the ridge and the eave of it are each three pieces
    let (low, high) = (|x: f64| [x, 0.0, 5.0], |x: f64| [x, 4.0, 9.0]);
    let strip = |from: f64, to: f64| [low(from), low(to), high(to), high(from)];
    let strips = [strip(0.0, 3.0), strip(3.0, 7.5), strip(7.5, 12.0)];
    assert_eq!(found(&[&[&strips[0]], &[&strips[1]], &[&strips[2]], &[&[C, D, E, F]]]), gable_roof());
}

#[test]
fn a_hip_roof_has_four_eaves_four_hips_and_a_ridge() {
    let (e, f) = ([4.0, 4.0, 9.0], [8.0, 4.0, 9.0]);
    let expected = vec![
        (Eave, A, B),
        (Eave, B, C),
        (Eave, C, D),
        (Eave, A, D),
        (Ridge, e, f),
        (Hip, A, e),
        (Hip, D, e),
        (Hip, B, f),
        (Hip, C, f),
    ];
    assert_eq!(found(&[&[&[A, B, f, e]], &[&[C, D, e, f]], &[&[B, C, f]], &[&[D, A, e]]]), sorted(expected));
}

#[test]
fn a_flat_roof_has_a_rim_and_its_courtyard_another() {
    let square = |from: f64, to: f64| [[from, from, 6.0], [to, from, 6.0], [to, to, 6.0], [from, to, 6.0]];
    let (outer, inner) = (square(0.0, 20.0), square(5.0, 15.0));
    let rim = |ring: [Point; 4]| (0..4).map(move |at| (Rim, ring[at], ring[(at + 1) % 4]));
    let expected = sorted(rim(outer).chain(rim(inner)).collect());
    let mut turned = inner;
    turned.reverse();
    assert_eq!(found(&[&[&outer, &inner]]), expected);
    assert_eq!(found(&[&[&outer, &turned]]), expected, "whichever way round the hole is");
    // a hole that was cut open: the polygon passes the way there twice
    let cut = [outer[0], inner[0], inner[3], inner[2], inner[1], inner[0], outer[0], outer[1], outer[2], outer[3]];
    assert_eq!(found(&[&[&cut]]), expected);
}

#[test]
fn a_single_pitch_has_an_eave_below_and_gables_on_the_other_sides() {
    let (c, d) = ([12.0, 8.0, 8.0], [0.0, 8.0, 8.0]);
    assert_eq!(found(&[&[&[A, B, c, d]]]), sorted(vec![(Eave, A, B), (Gable, B, c), (Gable, c, d), (Gable, A, d)]));
}

#[test]
fn an_l_has_valleys_where_the_wing_meets_the_main_roof() {
    // the main roof as above; a wing 6 m wide from its side y = 0, whose ridge at 8 m runs into the slope at (6, 3, 8)
    let (p, q, meet) = ([3.0, 0.0, 5.0], [9.0, 0.0, 5.0], [6.0, 3.0, 8.0]);
    let (r, s, top) = ([3.0, -7.0, 5.0], [9.0, -7.0, 5.0], [6.0, -7.0, 8.0]);
    let south = [A, p, meet, q, B, F, E];
    let expected = vec![
        (Eave, A, p),
        (Eave, q, B),
        (Eave, C, D),
        (Ridge, E, F),
        (Gable, A, E),
        (Gable, D, E),
        (Gable, B, F),
        (Gable, C, F),
        (Valley, p, meet),
        (Valley, q, meet),
        (Ridge, top, meet),
        (Eave, p, r),
        (Eave, q, s),
        (Gable, r, top),
        (Gable, s, top),
    ];
    let polygons: [&[&[Point]]; 4] = [&[&south], &[&[C, D, E, F]], &[&[r, top, meet, p]], &[&[s, q, meet, top]]];
    assert_eq!(found(&polygons), sorted(expected));
}

#[test]
fn where_one_side_is_a_part_of_another_the_common_part_is_one_edge() {
    // a low slope leans with its upper side, 4 m long, on the middle of the ridge of a longer one
    let (e, f) = ([3.0, 4.0, 9.0], [7.0, 4.0, 9.0]);
    let (c, d) = ([7.0, 8.0, 5.0], [3.0, 8.0, 5.0]);
    let expected = vec![
        (Eave, A, B),
        (Gable, A, E),
        (Gable, B, F),
        (Gable, E, e),
        (Ridge, e, f),
        (Gable, f, F),
        (Eave, c, d),
        (Gable, c, f),
        (Gable, d, e),
    ];
    assert_eq!(found(&[&[&[A, B, F, E]], &[&[c, d, e, f]]]), sorted(expected));
}

#[test]
fn what_lies_twice_is_there_once_and_short_edges_are_not() {
    assert_eq!(found(&[&[&[A, B, F, E]], &[&[C, D, E, F]], &[&[B, F, E, A]]]), gable_roof());
    let chamfered = [[0.2, 0.0, 6.0], [10.0, 0.0, 6.0], [10.0, 9.0, 6.0], [0.0, 9.0, 6.0], [0.0, 0.2, 6.0]];
    assert_eq!(found(&[&[&chamfered]]).len(), 4, "the chamfer is 0.28 m");
}

#[test]
fn a_sliver_between_two_slopes_does_not_part_them() {
    let (e, f) = ([0.0, 4.0, 8.96], [12.0, 4.0, 8.96]);
    let edges = found(&[&[&[A, B, f, e]], &[&[C, D, E, F]], &[&[e, f, F, E]]]);
    assert_eq!(edges.iter().filter(|(kind, ..)| *kind == Ridge).count(), 1, "{edges:?}");
    assert_eq!(edges.len(), 7);
}

#[test]
fn degrees_are_not_metres() {
    let degrees = |point: Point| [139.7 + point[0] / 90_000.0, 35.6 + point[1] / 111_000.0, point[2]];
    let polygons: [&[&[Point]]; 2] = [&[&[A, B, F, E].map(degrees)], &[&[C, D, E, F].map(degrees)]];
    let edges = edges(&surfaces(&polygons), true).unwrap();
    let mut kinds: Vec<_> = edges.iter().map(|edge| edge.kind).collect();
    kinds.sort();
    assert_eq!(kinds, [Eave, Eave, Ridge, Gable, Gable, Gable, Gable]);
}

#[test]
fn what_is_no_roof_is_said() {
    let two = surfaces(&[&[&[A, B, A, B]]]);
    assert_eq!(edges(&two, false), Err(RoofError::Ring { ring: 0, polygon: 0, points: 2 }));
    let tiny = surfaces(&[&[&[[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.2, 0.0], [0.0, 0.2, 0.0]]]]);
    assert_eq!(edges(&tiny, false), Err(RoofError::NoEdge));
}

#[test]
fn a_roof_that_was_made_to_take_time_is_refused() {
    // nodes that all lie at the same place along the sweep
    let mut ring: Vec<Point> = Vec::new();
    for at in 0..3_000 {
        let at = f64::from(at) * 0.1;
        ring.push([0.531 * at, -0.798 * at, if ring.len().is_multiple_of(2) { 0.0 } else { 0.01 }]);
    }
    ring.push([9.0, 9.0, 9.0]);
    let surfaces = surfaces(&[&[&ring]]);
    assert_eq!(edges_within(&surfaces, false, Work(1_000_000)), Err(RoofError::TooIntricate { points: 3_001 }));
    assert!(edges_within(&surfaces, false, Work(MOST_WORK)).is_ok());
}

#[test]
fn a_round_tower_keeps_its_corners() {
    let corner = |at: u32| {
        let angle = f64::from(at) * std::f64::consts::TAU / 24.0;
        [10.0 * angle.cos(), 10.0 * angle.sin(), 8.0]
    };
    let ring: Vec<Point> = (0..24).map(corner).collect();
    assert_eq!(found(&[&[&ring]]).len(), 24);
}
