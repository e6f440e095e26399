use approx::assert_abs_diff_eq;
use nalgebra::{Matrix2x3, Vector2, Vector3};

use super::*;

/// A smooth picture of the ground, known at every place, as an ortho-photo that is shifted.
struct Drawn {
    size_px: [u32; 2],
    ground_from_pixel: Matrix2x3<f64>,
    shift_m: Vector2<f64>,
    of: fn(Vector2<f64>) -> f64,
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
                (self.of)(at - self.shift_m) as f32
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
    Drawn { size_px: [800, 600], ground_from_pixel, shift_m, of }
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
    assert!(against_ortho_photo(ortho(&level), ortho(&old), 1.0).unwrap().offsets.is_empty());
    assert!(against_ortho_photo(ortho(&old), ortho(&level), 1.0).unwrap().offsets.is_empty());
    let mut elsewhere = drawn(waves, 0.2, Vector2::zeros());
    elsewhere.ground_from_pixel[(0, 2)] = 9000.0;
    assert_eq!(against_ortho_photo(ortho(&elsewhere), ortho(&old), 1.0).unwrap().tried, 0);
}

#[test]
fn edges_tell_the_shift_across_them_and_together_all_of_it() {
    let shift_m = Vector2::new(-0.25, 0.4);
    let new = drawn(squares, 0.1, shift_m);
    let mut edges = Vec::new();
    for k in 0..3 {
        let (x, y) = (1000.0 + 20.0 * f64::from(k), 1960.0);
        edges.push([Vector2::new(x + 5.0, y + 5.0), Vector2::new(x + 5.0, y + 15.0)]);
        edges.push([Vector2::new(x + 5.0, y + 15.0), Vector2::new(x + 15.0, y + 15.0)]);
    }
    let found = against_edges(ortho(&new), &edges, 1.0).unwrap();
    assert_eq!(found.offsets.len(), 6);
    assert_abs_diff_eq!(found.common_m, shift_m, epsilon = 0.02);
    for offset in &found.offsets {
        assert!(offset.shift_m.norm() < 0.42, "an edge tells nothing along itself: {offset:?}");
    }
}
