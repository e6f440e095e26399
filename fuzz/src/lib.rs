//! What the targets have in common: a file for parsers that want one, small limits, and windows that are compared.

use std::path::PathBuf;
use std::sync::LazyLock;

use gable::features::{Picture as _, PixelRect};
use gable::imagery::{Format, ImageFile, Limits, georeference::Georeference, probe};

/// Pictures of strangers as the service reads them, but smaller: a run is to see many, not large ones.
pub static LIMITS: LazyLock<Limits> = LazyLock::new(|| {
    let mut limits = Limits::default();
    limits.max_side_px = 4096;
    limits.max_pixels = 1 << 20;
    limits.max_whole_pixels = 1 << 18;
    limits.max_decode_bytes = 16 << 20;
    limits.max_jpeg_scans = 20;
    limits.max_chunk_bytes = 4 << 20;
    limits.chunk_cache_bytes = 1 << 20;
    limits.small_picture_pixels = 1 << 16;
    limits
});

/// Writes the bytes where the parsers can open them: one file a process, in the folder of temporary files.
///
/// # Panics
/// If it cannot be written, for then nothing can be tried.
#[must_use]
pub fn as_file(data: &[u8]) -> &'static PathBuf {
    static FILE: LazyLock<PathBuf> =
        LazyLock::new(|| std::env::temp_dir().join(format!("gable-fuzz-{}", std::process::id())));
    assert!(std::fs::write(&*FILE, data).is_ok(), "{} cannot be written", FILE.display());
    &FILE
}

/// Reads a picture of one format in every way that the service does, and compares what must be the same.
///
/// # Panics
/// If a window differs from the same part of the whole, or header and picture contradict each other.
pub fn picture(data: &[u8], wanted: Format) {
    let path = as_file(data);
    let header = probe(path, &LIMITS);
    if header.as_ref().is_ok_and(|header| header.format != wanted) {
        return;
    }
    let _ = Georeference::of_geotiff(path, &LIMITS);
    let Ok(file) = ImageFile::open(path, &LIMITS) else { return };
    let [width, height] = file.size_px();
    if let Ok(header) = header {
        assert_eq!([header.width_px, header.height_px], [width, height], "the header tells another size");
    }
    let whole = PixelRect { x: 0, y: 0, width, height };
    let Ok(whole) = file.window(whole, 1) else { return };
    assert!(whole.grey.iter().all(|grey| grey.is_finite() && *grey >= 0.0), "grey values that are none");
    assert_eq!(whole.grey.len() as u64, u64::from(width) * u64::from(height));
    // the end of the file chooses the windows, so that libFuzzer can
    let mut choices = data.iter().rev().map(|byte| u32::from(*byte));
    for _ in 0..3 {
        let mut choose = |below: u32| choices.next().unwrap_or(7) * 257 % below.max(1);
        let (x, y) = (choose(width), choose(height));
        let rect = PixelRect { x, y, width: choose(width - x) + 1, height: choose(height - y) + 1 };
        let window = file.window(rect, 1);
        let window = window.unwrap_or_else(|error| panic!("{rect:?} cannot be read, but the whole can: {error:?}"));
        for row in 0..rect.height as usize {
            let of_whole = (y as usize + row) * width as usize + x as usize;
            let columns = rect.width as usize;
            let (found, expected) = (&window.grey[row * columns..][..columns], &whole.grey[of_whole..][..columns]);
            assert_eq!(found, expected, "row {row} of {rect:?} in {width} x {height}");
        }
        let reduction = choose(9) + 1;
        let reduced = file.window(rect, reduction);
        assert!(
            reduced.is_ok_and(|reduced| reduced.grey.iter().all(|grey| grey.is_finite())),
            "{rect:?} / {reduction}"
        );
    }
}
