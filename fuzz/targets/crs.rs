//! Names of reference systems, PROJ strings among them; what is accepted maps a place there and back.
#![no_main]

use gable::geometry::Crs;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let Ok(text) = str::from_utf8(data) else { return };
    let Ok(crs) = Crs::parse(text) else { return };
    assert!(crs.accuracy_m().is_finite(), "{text}");
    let _ = (crs.is_geographic(), crs.assumes_ellipsoidal_heights());
});
