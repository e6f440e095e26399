use approx::assert_abs_diff_eq;
use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::*;
use crate::estimation::simulated::Draws;

/// A smooth picture of the ground, known at every place, as an ortho-photo that is shifted.
struct Drawn {
    size_px: [u32; 2],
    ground_from_pixel: Matrix2x3<f64>,
    shift_m: Vector2<f64>,
    of: fn(Vector2<f64>) -> f64,
    /// What the grey values are off, pixel by pixel; nothing if it is empty.
    noise: Vec<f64>,
}

impl Picture for Drawn {
    fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
        let pixels = (rect.y..rect.y + rect.height).flat_map(|y| (rect.x..rect.x + rect.width).map(move |x| (x, y)));
        let grey = pixels
            .map(|(x, y)| {
                let at = self.ground_from_pixel * Vector3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 1.0);
                let noise = self.noise.get((y * self.size_px[0] + x) as usize).unwrap_or(&0.0);
                ((self.of)(at - self.shift_m) + noise) as f32
            })
            .collect();
        let (width, height) = (rect.width as usize, rect.height as usize);
        Ok(GreyWindow { origin_px: [rect.x, rect.y], reduction, width, height, grey })
    }
}

fn waves(at: Vector2<f64>) -> f64 {
    128.0 + 40.0 * (at.x / 2.3).sin() * (at.y / 3.1).cos() + 30.0 * ((at.x + 2.0 * at.y) / 5.7).sin()
}

/// Bright squares of 10 m on dark ground, their rims at whole tens of metres, blurred over half a metre.
fn squares(at: Vector2<f64>) -> f64 {
    let side = |v: f64| ((v / 20.0).floor() * 20.0, v);
    let inside = |(begin, v): (f64, f64)| {
        let step = |d: f64| 1.0 / (1.0 + (-d / 0.12).exp());
        step(v - begin - 5.0) * step(begin + 15.0 - v)
    };
    60.0 + 120.0 * inside(side(at.x)) * inside(side(at.y))
}

fn drawn(of: fn(Vector2<f64>) -> f64, gsd_m: f64, shift_m: Vector2<f64>) -> Drawn {
    let ground_from_pixel = Matrix2x3::new(gsd_m, 0.0, 1000.0, 0.0, -gsd_m, 2000.0);
    Drawn { size_px: [800, 600], ground_from_pixel, shift_m, of, noise: Vec::new() }
}

fn noisy(mut drawn: Drawn, sigma: f64, seed: u64) -> Drawn {
    let mut draws = Draws::new(seed);
    drawn.noise = (0..drawn.size_px[0] * drawn.size_px[1]).map(|_| sigma * draws.normal()).collect();
    drawn
}

fn ortho(drawn: &Drawn) -> OrthoPhoto<'_> {
    OrthoPhoto { picture: drawn, ground_from_pixel: drawn.ground_from_pixel }
}

#[test]
fn the_shift_between_two_ortho_photos_is_found_whatever_their_pixels() {
    let shift_m = Vector2::new(0.37, -0.21);
    let old = drawn(waves, 0.2, Vector2::zeros());
    for gsd_m in [0.2, 0.17] {
        let new = drawn(waves, gsd_m, shift_m);
        let found = against_ortho_photo(ortho(&new), ortho(&old), 1.0).unwrap();
        assert!(found.offsets.len() > found.tried / 2, "{} of {}", found.offsets.len(), found.tried);
        assert_abs_diff_eq!(found.common_m, shift_m, epsilon = 0.02);
        assert!((found.rms_m - shift_m.norm()).abs() < 0.03, "{}", found.rms_m);
    }
}

#[test]
fn grey_without_contrast_and_another_ground_tell_nothing() {
    let level = drawn(|_| 100.0, 0.2, Vector2::zeros());
    let old = drawn(waves, 0.2, Vector2::zeros());
    let mut elsewhere = drawn(waves, 0.2, Vector2::zeros());
    elsewhere.ground_from_pixel[(0, 2)] = 9000.0;
    for [new, old] in [[&level, &old], [&old, &level], [&elsewhere, &old]] {
        let told = against_ortho_photo(ortho(new), ortho(old), 1.0);
        assert!(matches!(told, Err(OrthoError::Few { found: 0, .. })), "{told:?}");
    }
}

/// Patches of any grey, a metre large, blurred into each other.
fn patches(at: Vector2<f64>) -> f64 {
    let node = |x: f64, y: f64| ((12.9898 * x + 78.233 * y).sin() * 43758.5453).rem_euclid(1.0);
    let (x, y) = (at.x.floor(), at.y.floor());
    let (fx, fy) = (at.x - x, at.y - y);
    let row = |y: f64| node(x, y) * (1.0 - fx) + node(x + 1.0, y) * fx;
    50.0 + 150.0 * (row(y) * (1.0 - fy) + row(y + 1.0) * fy)
}

/// Straight kerbs, 10 m between them, blurred over half a metre.
fn kerbs(at: Vector2<f64>) -> f64 {
    let across = (0.8 * at.x + 0.6 * at.y).rem_euclid(20.0);
    let step = |d: f64| 1.0 / (1.0 + (-d / 0.12).exp());
    80.0 + 80.0 * step(across - 4.0) * step(14.0 - across)
}

#[test]
fn what_is_alike_all_along_a_kerb_is_not_taken_and_corners_are() {
    let shift_m = Vector2::new(0.5, -0.6);
    let told = |of| {
        let [old, new] =
            [(Vector2::zeros(), 1), (shift_m, 2)].map(|(shift_m, seed)| noisy(drawn(of, 0.2, shift_m), 4.0, seed));
        against_ortho_photo(ortho(&new), ortho(&old), 1.2)
    };
    let kerbs = told(kerbs);
    assert!(matches!(kerbs, Err(OrthoError::Few { found: 0, .. })), "{kerbs:?}");
    for of in [squares, patches] {
        let shift = told(of).unwrap();
        assert_eq!((shift.offsets.len(), shift.tried), (192, 192));
        assert_abs_diff_eq!(shift.common_m, shift_m, epsilon = 0.01);
        for offset in shift.offsets {
            assert!((offset.shift_m - shift_m).norm() < 0.1, "{offset:?}");
        }
    }
}

#[test]
fn a_shift_beyond_the_search_is_refused_and_not_told_as_a_small_one() {
    for (of, shift_m) in [(patches as fn(_) -> _, Vector2::new(2.5, 0.0)), (squares, Vector2::new(-1.5, 2.0))] {
        let [old, new] = [Vector2::zeros(), shift_m].map(|shift_m| drawn(of, 0.2, shift_m));
        let told = against_ortho_photo(ortho(&new), ortho(&old), 1.2);
        assert!(matches!(told, Err(OrthoError::Few { .. } | OrthoError::Scattered { .. })), "{told:?}");
        let told = against_edges(ortho(&new), &rims(), 1.2);
        assert!(matches!(told, Err(OrthoError::Few { .. } | OrthoError::Scattered { .. })), "{told:?}");
    }
}

#[test]
fn what_is_found_by_chance_has_no_shift_in_common() {
    let mut draws = Draws::new(3);
    let chance = |draws: &mut Draws| Vector2::new(draws.even(-1.0, 1.0), draws.even(-1.0, 1.0)).norm();
    let refused = (0..200).filter(|_| check_agreement((0..20).map(|_| chance(&mut draws)), 20, 1.0).is_err()).count();
    assert_eq!(refused, 200);
}

/// The western and northern rims of some of the squares.
fn rims() -> Vec<[Vector2<f64>; 2]> {
    let of_square = |k: i32| {
        let [x, y] = [1000.0 + 20.0 * f64::from(k), 1960.0];
        let [low, high, east] =
            [Vector2::new(x + 5.0, y + 5.0), Vector2::new(x + 5.0, y + 15.0), Vector2::new(x + 15.0, y + 15.0)];
        [[low, high], [high, east]]
    };
    (0..3).flat_map(of_square).collect()
}

#[test]
fn edges_tell_the_shift_across_them_and_together_all_of_it() {
    let shift_m = Vector2::new(-0.25, 0.4);
    let new = drawn(squares, 0.1, shift_m);
    let found = against_edges(ortho(&new), &rims(), 1.0).unwrap();
    assert_eq!((found.offsets.len(), found.tried), (6, 6));
    assert_abs_diff_eq!(found.common_m, shift_m, epsilon = 0.02);
    for offset in &found.offsets {
        assert!(offset.shift_m.norm() < 0.42, "an edge tells nothing along itself: {offset:?}");
    }
}

#[test]
fn lines_that_the_ortho_photo_does_not_show_count_neither_way_and_those_that_run_alike_are_refused() {
    let new = drawn(squares, 0.1, Vector2::new(-0.25, 0.4));
    let elsewhere = rims().into_iter().map(|ends| ends.map(|end| end + Vector2::new(5000.0, 0.0)));
    let found = against_edges(ortho(&new), &elsewhere.chain(rims()).collect::<Vec<_>>(), 1.0).unwrap();
    assert_eq!((found.offsets.len(), found.tried), (6, 6));
    let alike: Vec<_> = rims().into_iter().filter(|[start, end]| start.x == end.x).cycle().take(6).collect();
    let told = against_edges(ortho(&new), &alike, 1.0);
    assert!(matches!(told, Err(OrthoError::OneDirection { found: 6 })), "{told:?}");
}
