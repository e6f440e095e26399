//! Control that invites a wrong answer, and numbers that are none: nothing wrong is accepted, nothing hangs or panics.
//!
//! `GABLE_HOSTILE=10000 cargo test --release --test hostile` tries as many images; `gable simulate --mixture hostile`
//! does the same and keeps what came out.

#![allow(clippy::unwrap_used, reason = "a test fails by panic")]

use std::time::{Duration, Instant};

use gable::classifiers::shipped;
use gable::diagnosis::{Policy, Verdict};
use gable::learning::Classifier;
use gable::orientation::ControlPoint;
use gable::pipeline::{Judge, Observer, Stage, Task, Tolerance, orient};
use gable::study::{Hostility, Mixture, labelled, oriented};
use rayon::prelude::*;

const IMAGES: u64 = 75;
/// Many times what an image takes.
const PATIENCE: Duration = Duration::from_secs(60);

struct Nobody;

impl Observer for Nobody {
    fn progress(&self, _: Stage, _: f64) {}
}

fn classifier() -> std::sync::Arc<Classifier> {
    shipped().unwrap().classifier
}

#[test]
fn nothing_wrong_is_accepted() {
    let images = std::env::var("GABLE_HOSTILE").map_or(IMAGES, |count| count.parse().unwrap());
    let classifier = classifier();
    let failed: Vec<String> = (1..=images)
        .into_par_iter()
        .filter_map(|seed| {
            let scene = Mixture::Hostile.scene(seed).unwrap();
            let begin = Instant::now();
            let outcome =
                oriented(&scene, &scene.picture(), Mixture::Hostile.tolerance_gsd(seed), &classifier).unwrap();
            assert!(begin.elapsed() < PATIENCE, "seed {seed} takes {:?}", begin.elapsed());
            let right = labelled(Mixture::Hostile, &scene, &outcome).right();
            let green = outcome.diagnosis.verdict == Verdict::Green;
            (green && !right).then(|| format!("seed {seed}, {:?}", Hostility::of(seed)))
        })
        .collect();
    assert!(failed.is_empty(), "wrong and green: {failed:?}");
}

type Spoil = fn(&mut Task, &mut Vec<ControlPoint>, f64);

/// What can be no number, or one that nobody would state.
const SPOILT: [Spoil; 14] = [
    |task, _, bad| task.approximation.orientation.projection_centre_m.x = bad,
    |task, _, bad| task.approximation.orientation.projection_centre_m.z = bad,
    |task, _, bad| task.approximation.sigma_position_m[1] = bad,
    |task, _, bad| task.approximation.sigma_tilt_rad = bad,
    |task, _, bad| task.approximation.sigma_kappa_rad = Some(bad),
    |task, _, bad| task.tolerance = Tolerance::Metres(bad),
    |task, _, bad| task.tolerance = Tolerance::Gsd(bad),
    |task, _, bad| task.judge.policy.threshold = Some(bad),
    |task, _, bad| task.judge.policy.caution = Some(bad),
    |_, control, bad| control[0].reference_m.y = bad,
    |_, control, bad| control[1].sigma_m = bad,
    |_, control, bad| control.iter_mut().for_each(|point| point.reference_m.z = bad),
    |_, control, bad| control.iter_mut().for_each(|point| point.edges_m[0].start.x = bad),
    |_, control, bad| control.iter_mut().for_each(|point| point.edges_m.iter_mut().for_each(|e| e.end.z = bad)),
];

#[test]
fn numbers_that_are_none_do_no_harm() {
    let classifier = classifier();
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -1.0, 1e300];
    let cases: Vec<(usize, f64)> = (0..SPOILT.len()).flat_map(|k| bad.map(|bad| (k, bad))).collect();
    cases.into_par_iter().for_each(|(k, bad)| {
        let scene = Mixture::Hostile.scene(3).unwrap();
        let mut task = Task {
            camera: scene.camera,
            approximation: scene.approximation.clone(),
            tolerance: Tolerance::Gsd(10.0),
            judge: Judge { classifier: classifier.clone(), policy: Policy::default() },
        };
        let mut control = scene.control_points();
        SPOILT[k](&mut task, &mut control, bad);
        let begin = Instant::now();
        let outcome = orient(&scene.picture(), &control, &task, &Nobody);
        assert!(begin.elapsed() < PATIENCE, "case {k} with {bad} takes {:?}", begin.elapsed());
        let Ok(outcome) = outcome else { return };
        let right = labelled(Mixture::Hostile, &scene, &outcome).right();
        assert!(right || outcome.diagnosis.verdict != Verdict::Green, "case {k} with {bad}");
        let diagnosis = &outcome.diagnosis;
        assert!(diagnosis.score.is_finite() && (0.0..=1.0).contains(&diagnosis.probability_correct));
    });
}
