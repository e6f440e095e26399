//! World files, and the georeference of a GeoTIFF.
#![no_main]

use gable::imagery::georeference::Georeference;
use gable_fuzz::{LIMITS, as_file};

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let of_file = Georeference::of_geotiff(as_file(data), &LIMITS).ok().flatten();
    let of_text = str::from_utf8(data).ok().and_then(|text| Georeference::from_world_file(text).ok());
    // a world file's numbers may be so large that a half step overflows; a GeoTIFF's go into the same sums
    for found in of_file.into_iter().chain(of_text) {
        assert!(found.ground_from_pixel.iter().all(|value| !value.is_nan()), "{found:?}");
    }
});
