//! Labelled sets (JSON Lines) that are uploaded to train from.
#![no_main]

use gable::classifiers::samples_of;
use gable::jobs::training::{TrainingPlan, parse_set};
use gable::learning::Kind;

const KINDS: [&str; 2] = ["one_feature", "evidence_logistic"];

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = serde_json::from_slice::<TrainingPlan>(data);
    let Ok(images) = parse_set(data) else { return };
    for image in &images {
        let _ = image.right();
        for kind in KINDS.iter().filter_map(|name| Kind::from_name(name)) {
            for (sample, _) in samples_of(image, kind) {
                assert!(sample.iter().all(|value| !value.is_nan()), "{sample:?}");
            }
        }
    }
});
