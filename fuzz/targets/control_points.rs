//! GeoJSON with control points: what is accepted is finite, and comes back from the form that it is stored in.
#![no_main]

use std::sync::LazyLock;

use gable::control::StoredControlPoint;
use gable::control::geojson::{self, Source};
use gable::geometry::Crs;

static CRS: LazyLock<[Crs; 2]> =
    LazyLock::new(|| ["EPSG:25832", "EPSG:4979"].map(|name| Crs::parse(name).expect("these are known")));

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    for crs in &*CRS {
        let source = Source { crs, geoid_undulation_m: Some(40.0) };
        let Ok(parsed) = geojson::parse(data, &source) else { continue };
        for (_, point) in &parsed.control_points {
            let finite = point.points().all(|position| position.iter().all(|value| value.is_finite()));
            assert!(finite && point.sigma_m.is_finite(), "{point:?}");
            let again = StoredControlPoint::edges_from_bytes(&point.edges_to_bytes());
            assert_eq!(again.as_deref(), Some(point.edges_geocentric_m.as_slice()));
            if let Some(feature) = geojson::feature(point, &source) {
                let text = serde_json::to_string(&feature).expect("a feature can be written");
                assert!(!text.contains("null"), "a number that JSON does not know: {text}");
            }
        }
    }
});
