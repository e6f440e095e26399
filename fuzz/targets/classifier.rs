//! The three texts of a classifier, which `gable classifier add` takes: a byte says which of them is the stranger's, the
//! others are those of the classifier that Gable brings along.
#![no_main]

use gable::classifiers::{Texts, shipped};
use gable::learning::{Machine, Scaling};

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let Some((which, text)) = data.split_first() else { return };
    let Ok(text) = str::from_utf8(text) else { return };
    let mut texts = shipped::texts();
    match which % 3 {
        0 => {
            if let Ok(machine) = Machine::from_text(text) {
                let features = machine.features().min(1000);
                let _ = machine.decision(&vec![0.5; features]);
                let _ = machine.to_text();
            }
            texts.model = text.to_owned();
        }
        1 => {
            if let Ok(scaling) = Scaling::from_text(text) {
                let _ = scaling.scaled(&vec![0.5; scaling.features()]);
            }
            texts.scaling = text.to_owned();
        }
        _ => texts.description = text.to_owned(),
    }
    judged(&texts);
});

/// One that is accepted must be able to judge.
fn judged(texts: &Texts) {
    let Ok(loaded) = texts.load() else { return };
    let features = vec![0.5; loaded.classifier.features.len()];
    assert!(!loaded.classifier.decision(&features).is_nan(), "a classifier that was accepted does not decide");
    let _ = loaded.classifier.judge(&[features]);
}
