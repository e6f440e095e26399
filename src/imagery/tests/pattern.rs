//! The pattern that all test pictures show, and windows of it computed the plain way.

use std::path::{Path, PathBuf};

use crate::features::{Picture, PixelRect};
use crate::imagery::{ImageFile, ImageryError, Limits};

pub(super) const WIDTH: u32 = 77;
pub(super) const HEIGHT: u32 = 53;

/// Red, green, blue: gentle slopes, and a rectangle of another colour. The same as in `fixtures/make.py`.
pub(super) fn rgb(x: u32, y: u32) -> [u8; 3] {
    if (20..40).contains(&x) && (10..30).contains(&y) {
        return [230, 40, 90];
    }
    [20 + 200 * x / WIDTH, 235 - 200 * y / HEIGHT, 60 + 2 * ((x + y) / 2)].map(|channel| channel as u8)
}

/// Its luma, not rounded.
pub(super) fn luma(x: u32, y: u32) -> f64 {
    let [red, green, blue] = rgb(x, y).map(f64::from);
    0.299 * red + 0.587 * green + 0.114 * blue
}

/// The rows of the pattern, pixel by pixel.
pub(super) fn interleaved() -> Vec<u8> {
    (0..HEIGHT).flat_map(|y| (0..WIDTH).flat_map(move |x| rgb(x, y))).collect()
}

/// The rows of its rounded luma.
pub(super) fn grey() -> Vec<u8> {
    (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| luma(x, y).round() as u8)).collect()
}

pub(super) fn rect(x: u32, y: u32, width: u32, height: u32) -> PixelRect {
    PixelRect { x, y, width, height }
}

/// The cells of a window, each the mean of its pixels.
pub(super) fn plain_window(
    pixel: impl Fn(u32, u32) -> f64,
    [width, height]: [u32; 2],
    rect: PixelRect,
    reduction: u32,
) -> Vec<f64> {
    let right = rect.x.saturating_add(rect.width).min(width);
    let bottom = rect.y.saturating_add(rect.height).min(height);
    let mut cells = Vec::new();
    for top in (rect.y..bottom).step_by(reduction as usize) {
        for left in (rect.x..right).step_by(reduction as usize) {
            let inside: Vec<f64> = (top..bottom.min(top.saturating_add(reduction)))
                .flat_map(|y| (left..right.min(left.saturating_add(reduction))).map(move |x| (x, y)))
                .map(|(x, y)| pixel(x, y))
                .collect();
            cells.push(inside.iter().sum::<f64>() / inside.len() as f64);
        }
    }
    cells
}

/// Whether windows of several places and reductions agree with `pixel` within `tolerance`.
pub(super) fn assert_shows(file: &ImageFile, tolerance: f64, pixel: impl Fn(u32, u32) -> f64) {
    let size = file.size_px();
    assert_eq!(size, [WIDTH, HEIGHT]);
    let rects = [
        rect(0, 0, WIDTH, HEIGHT),
        rect(31, 15, 3, 2),
        rect(13, 7, 41, 29),
        rect(60, 40, 100, 100),
        rect(0, 52, 77, 1),
        rect(200, 10, 5, 5),
        rect(u32::MAX, u32::MAX, u32::MAX, u32::MAX),
    ];
    for rect in rects {
        for reduction in [1, 2, 3, 4, 7, 100] {
            let window = file.window(rect, reduction).unwrap();
            let expected = plain_window(&pixel, size, rect, reduction);
            assert_eq!(window.grey.len(), expected.len(), "{rect:?} / {reduction}");
            assert_eq!(window.grey.len(), window.width * window.height);
            for (found, expected) in window.grey.iter().zip(&expected) {
                let error = (f64::from(*found) - expected).abs();
                assert!(error <= tolerance, "{rect:?} / {reduction}: {found} instead of {expected}");
            }
        }
    }
}

/// A picture made beforehand by `fixtures/make.py`.
pub(super) fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src/imagery/fixtures").join(name)
}

/// Opens a picture that is given as bytes.
pub(super) fn open(bytes: &[u8]) -> Result<ImageFile, ImageryError> {
    open_within(bytes, &Limits::default())
}

pub(super) fn open_within(bytes: &[u8], limits: &Limits) -> Result<ImageFile, ImageryError> {
    with_file(bytes, |path| ImageFile::open(path, limits))
}

/// Calls `use_it` with a file of these bytes, whose name says nothing.
pub(super) fn with_file<T>(bytes: &[u8], use_it: impl FnOnce(&Path) -> T) -> T {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.txt");
    std::fs::write(&path, bytes).unwrap();
    use_it(&path)
}
