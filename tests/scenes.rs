//! The whole pipeline on simulated scenes whose truth is known.

#![allow(clippy::unwrap_used, reason = "a test fails by panic")]

use gable::diagnosis::{Verdict, d_max_m};
use gable::orientation::ControlPoint;
use gable::pipeline::{Fault, Observer, Outcome, Stage, Task, Tolerance, orient};
use gable::simulation::{Photograph, Scene, SceneSettings};
use nalgebra::Vector3;

struct Watched;

impl Observer for Watched {
    fn progress(&self, _: Stage, fraction: f64) {
        assert!((0.0..=1.0).contains(&fraction));
    }
}

const TOLERANCE_GSD: f64 = 10.0;

fn task(scene: &Scene) -> Task {
    Task { camera: scene.camera, approximation: scene.approximation.clone(), tolerance: Tolerance::Gsd(TOLERANCE_GSD) }
}

fn run(picture: &Photograph, control: &[ControlPoint], task: &Task) -> Outcome {
    orient(picture, control, task, &Watched).unwrap()
}

/// D_max in ground sample distances; infinite without an orientation.
fn d_max_gsd(scene: &Scene, outcome: &Outcome) -> f64 {
    let Some(estimate) = &outcome.estimate else { return f64::INFINITY };
    let d_max = d_max_m(&scene.camera, &estimate.orientation, &scene.true_orientation, scene.ground_height_m());
    d_max.unwrap() / scene.ground_sample_distance_m()
}

#[test]
fn villages_are_oriented_and_accepted() {
    for seed in 101..=103 {
        let scene = Scene::draw(seed, &SceneSettings::default()).unwrap();
        let outcome = run(&scene.render(), &scene.control_points(), &task(&scene));
        let d_max = d_max_gsd(&scene, &outcome);
        assert!(d_max < TOLERANCE_GSD, "seed {seed}: {d_max} GSD");
        assert_eq!(outcome.diagnosis.verdict, Verdict::Green, "seed {seed}: {:?}", outcome.diagnosis.reasons);
        assert_eq!(outcome.ground_precision.len(), 9);
        let used = outcome.control_points.iter().filter(|c| c.used).count();
        assert!(used >= 8, "seed {seed}: {used} control points");
    }
}

#[test]
fn the_same_picture_gives_the_same_answer() {
    let scene = Scene::draw(104, &SceneSettings::default()).unwrap();
    let (picture, control) = (scene.render(), scene.control_points());
    assert_eq!(run(&picture, &control, &task(&scene)), run(&picture, &control, &task(&scene)));
}

#[test]
fn what_cannot_be_oriented_is_red_with_a_reason() {
    let scene = Scene::draw(105, &SceneSettings::default()).unwrap();
    let (picture, control) = (scene.render(), scene.control_points());
    let task = task(&scene);
    let code = |outcome: &Outcome| outcome.diagnosis.reasons[0].code;

    let none = run(&picture, &[], &task);
    assert_eq!((none.diagnosis.verdict, code(&none)), (Verdict::Red, "no_control_in_view"));

    let kilometres_away: Vec<ControlPoint> = control.iter().map(|c| moved(c, Vector3::new(9000.0, 0.0, 0.0))).collect();
    let away = run(&picture, &kilometres_away, &task);
    assert_eq!((away.diagnosis.verdict, code(&away)), (Verdict::Red, "no_control_in_view"));

    let two = run(&picture, &control[..2.min(control.len())], &task);
    assert_ne!(two.diagnosis.verdict, Verdict::Green);
}

#[test]
fn control_of_another_village_is_never_accepted() {
    for seed in [106, 107] {
        let scene = Scene::draw(seed, &SceneSettings::default()).unwrap();
        let elsewhere = Scene::draw(seed + 50, &SceneSettings::default()).unwrap();
        let outcome = run(&scene.render(), &elsewhere.control_points(), &task(&scene));
        assert_ne!(outcome.diagnosis.verdict, Verdict::Green, "seed {seed}: {:?}", outcome.diagnosis);
    }
}

#[test]
fn a_wrong_position_is_not_covered_up() {
    let scene = Scene::draw(108, &SceneSettings::default()).unwrap();
    let mut task = task(&scene);
    task.approximation.orientation.projection_centre_m += Vector3::new(120.0, -60.0, 0.0);
    let outcome = run(&scene.render(), &scene.control_points(), &task);
    let right = d_max_gsd(&scene, &outcome) < TOLERANCE_GSD;
    assert!(right || outcome.diagnosis.verdict != Verdict::Green, "{:?}", outcome.diagnosis);
}

#[test]
fn a_cancelled_run_ends() {
    struct Impatient;
    impl Observer for Impatient {
        fn progress(&self, _: Stage, _: f64) {}
        fn cancelled(&self) -> bool {
            true
        }
    }
    let scene = Scene::draw(109, &SceneSettings::default()).unwrap();
    let picture = Photograph { width_px: 8, height_px: 8, grey: vec![0; 64] };
    let fault = orient(&picture, &scene.control_points(), &task(&scene), &Impatient).unwrap_err();
    assert_eq!(fault, Fault::Cancelled);
}

fn moved(control_point: &ControlPoint, by_m: Vector3<f64>) -> ControlPoint {
    let mut moved = control_point.clone();
    moved.reference_m += by_m;
    for edge in &mut moved.edges_m {
        edge.start += by_m;
        edge.end += by_m;
    }
    moved
}
