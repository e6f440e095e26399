//! Windows against a plain computation, for any rectangle and reduction.

use proptest::prelude::*;

use super::formats::encode_png;
use super::pattern::{HEIGHT, WIDTH, grey, open, plain_window, rect};
use super::tiff_writer::{Variant, write};
use crate::features::Picture;

/// Noise, the same each time.
fn noise(x: u32, y: u32) -> u16 {
    ((x + 1).wrapping_mul(2_654_435_761) ^ (y + 1).wrapping_mul(2_246_822_519)).wrapping_mul(3_266_489_917) as u16
}

proptest! {
    #[test]
    fn any_window_of_a_frame(x in 0..90_u32, y in 0..60_u32, w in 0..90_u32, h in 0..60_u32, reduction in 1..20_u32) {
        let data: Vec<u8> = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| noise(x, y) as u8)).collect();
        let file = open(&encode_png(png::ColorType::Grayscale, png::BitDepth::Eight, &data)).unwrap();
        let (rect, pixel) = (rect(x, y, w, h), |x, y| f64::from(noise(x, y) as u8));
        let window = file.window(rect, reduction).unwrap();
        let expected = plain_window(pixel, [WIDTH, HEIGHT], rect, reduction);
        prop_assert_eq!(window.origin_px, [x.min(WIDTH), y.min(HEIGHT)]);
        prop_assert_eq!(window.width * window.height, expected.len());
        prop_assert_eq!(window.grey.len(), expected.len());
        for (found, expected) in window.grey.iter().zip(expected) {
            prop_assert!((f64::from(*found) - expected).abs() < 1e-3, "{} instead of {}", found, expected);
        }
    }

    #[test]
    fn any_window_of_any_tiles(
        x in 0..90_u32, y in 0..60_u32, w in 0..90_u32, h in 0..60_u32, reduction in 1..20_u32,
        columns in prop::option::of(1..100_u32), rows in 1..70_u32,
    ) {
        let variant = Variant { chunk: (columns, rows), deep: true, photometric: 1, samples: 1, ..Variant::default() };
        let file = open(&write(&variant, [WIDTH, HEIGHT], |x, y, _| noise(x, y))).unwrap();
        let (rect, pixel) = (rect(x, y, w, h), |x, y| f64::from(noise(x, y)) / 257.0);
        let window = file.window(rect, reduction).unwrap();
        let expected = plain_window(pixel, [WIDTH, HEIGHT], rect, reduction);
        prop_assert_eq!(window.grey.len(), expected.len());
        for (found, expected) in window.grey.iter().zip(expected) {
            prop_assert!((f64::from(*found) - expected).abs() < 1e-3, "{} instead of {}", found, expected);
        }
    }
}

#[test]
fn a_reduction_of_zero_is_an_error() {
    let file = open(&encode_png(png::ColorType::Grayscale, png::BitDepth::Eight, &grey())).unwrap();
    assert!(file.window(rect(0, 0, 5, 5), 0).is_err());
}

#[test]
fn threads_get_the_same_windows() {
    let bytes = std::fs::read(super::pattern::fixture("deflate_tiles.tif")).unwrap();
    let file = open(&bytes).unwrap();
    let whole = rect(0, 0, WIDTH, HEIGHT);
    let expected = file.window(whole, 3).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| (0..50).for_each(|_| assert_eq!(file.window(whole, 3).unwrap(), expected)));
        }
    });
}
