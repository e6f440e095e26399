//! Requests to orient an image, up to what is kept with the orientation; and those of interior orientations.
#![no_main]

use gable::http::extract::parse_json;
use gable::jobs::interior::InteriorRequest;
use gable::jobs::request::{ImageFacts, OrientationRequest, Prepared};

const IMAGE: ImageFacts = ImageFacts { size_px: [4000, 3000], position: None, heading: None };

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let Ok(request) = parse_json::<InteriorRequest>(data) {
        let _ = request.prepare(None);
    }
    let Ok(request) = parse_json::<OrientationRequest>(data) else { return };
    let _ = request.prepare(None, &IMAGE);
    let Ok(prepared) = request.prepare(Some([4000, 3000]), &IMAGE) else { return };
    let frame = prepared.frame();
    assert!(frame.is_ok(), "accepted, but without a frame: {frame:?}");
    // it is kept as JSON, and must come back as it was
    let kept = serde_json::to_string(&prepared).expect("it can be kept");
    let again: Prepared = serde_json::from_str(&kept).unwrap_or_else(|error| panic!("{error}: {kept}"));
    assert_eq!(again, prepared);
});
