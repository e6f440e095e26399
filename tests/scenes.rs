//! The whole pipeline on simulated scenes whose truth is known.

#![allow(clippy::unwrap_used, reason = "a test fails by panic")]

use gable::classifiers::shipped;
use gable::diagnosis::{Policy, Verdict, d_max_m};
use gable::geometry::{Camera, Film, PixelFromPlate, Smac, rotation};
use gable::orientation::ControlPoint;
use gable::pipeline::desk::{Correction, Desk};
use gable::pipeline::{Fault, Judge, Observer, Outcome, Stage, Task, Tolerance, orient};
use gable::simulation::{Photograph, Scene, SceneSettings};
use nalgebra::{Matrix2, Vector2, Vector3};

struct Watched;

impl Observer for Watched {
    fn progress(&self, _: Stage, fraction: f64) {
        assert!((0.0..=1.0).contains(&fraction));
    }
}

const TOLERANCE_GSD: f64 = 10.0;

fn task(scene: &Scene) -> Task {
    Task {
        camera: scene.camera,
        approximation: scene.approximation.clone(),
        check: std::sync::Arc::default(),
        tolerance: Tolerance::Gsd(TOLERANCE_GSD),
        judge: Judge { classifier: shipped().unwrap().classifier, policy: Policy::default() },
    }
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

/// The same flight with a film camera whose film was laid into the scanner by a quarter turn and face down, with a rim
/// around the image.
fn on_film(scene: &Scene) -> Scene {
    const FORMAT_MM: [f64; 2] = [150.0, 112.5];
    let distortion = Smac { k: [2e-4, -2e-7, 5e-12, 0.0, 0.0], p: [3e-7, -2e-7, 0.0, 0.0] };
    let film = Film::new(130.0, Vector2::new(0.31, -0.14), Vector2::new(0.05, 0.02), distortion, FORMAT_MM).unwrap();
    let linear = Matrix2::new(0.03, 20.0, -20.1, 0.02);
    assert!(linear.determinant() > 0.0, "mirrored: plate y points up and rows run down");
    let lies = PixelFromPlate::affine(&linear, Vector2::new(1225.0, 1620.0)).unwrap();
    let camera = Camera::of_scan([2450, 3240], &film, &lies).unwrap();
    Scene { camera, ..scene.clone() }
}

#[test]
fn a_turned_and_mirrored_scan_of_film_is_oriented_like_a_digital_image() {
    let digital = Scene::draw(105, &SceneSettings::default()).unwrap();
    let film = on_film(&digital);
    let run = |scene: &Scene| run(&scene.render(), &scene.control_points(), &task(scene));
    let (of_digital, of_film) = (run(&digital), run(&film));
    let (expected, reached) = (d_max_gsd(&digital, &of_digital), d_max_gsd(&film, &of_film));
    assert!(reached < TOLERANCE_GSD / 2.0 && reached < 2.0 * expected + 1.0, "{reached} GSD, {expected} digitally");
    assert_eq!(of_digital.diagnosis.verdict, Verdict::Green);
    assert_eq!(of_film.diagnosis.verdict, Verdict::Green, "{:?}", of_film.diagnosis.reasons);
    let sigma0 = |outcome: &Outcome| outcome.estimate.as_ref().unwrap().sigma0;
    assert!((sigma0(&of_film) / sigma0(&of_digital) - 1.0).abs() < 0.2);
    let used = |outcome: &Outcome| outcome.control_points.iter().filter(|c| c.used).count();
    assert!(used(&of_film).abs_diff(used(&of_digital)) <= 2, "{} and {}", used(&of_film), used(&of_digital));
    // what is told in pixels is told in those of the file
    for point in of_film.control_points.iter().filter_map(|c| c.located_px) {
        assert!(film.camera.contains(point, 30.0), "{point}");
    }
}

#[test]
fn the_same_picture_gives_the_same_answer() {
    let scene = Scene::draw(104, &SceneSettings::default()).unwrap();
    let (picture, control) = (scene.render(), scene.control_points());
    assert_eq!(run(&picture, &control, &task(&scene)), run(&picture, &control, &task(&scene)));
}

/// However little is known, a village is found: tilt, heading, height and position beyond any one window.
#[test]
fn a_poor_approximation_is_searched() {
    let scene = Scene::draw(101, &SceneSettings::default()).unwrap();
    let (picture, control) = (scene.render(), scene.control_points());
    let truth = scene.true_orientation;
    let height_m = truth.projection_centre_m.z - scene.ground_height_m();
    let known = scene.approximation.clone();
    let mut no_heading = known.clone();
    no_heading.orientation.camera_from_object = rotation::camera_from_object(0.0, 0.0, 0.0);
    no_heading.sigma_tilt_rad = 5.0_f64.to_radians();
    no_heading.sigma_kappa_rad = None;
    let mut vague_heading = known.clone();
    let [omega, phi, kappa] = rotation::angles(&truth.camera_from_object);
    vague_heading.orientation.camera_from_object =
        rotation::camera_from_object(omega, phi, kappa + 70.0_f64.to_radians());
    vague_heading.sigma_kappa_rad = Some(45.0_f64.to_radians());
    let mut wrong_height = known.clone();
    wrong_height.orientation.projection_centre_m.z = truth.projection_centre_m.z + height_m / 3.0;
    wrong_height.sigma_position_m[2] = height_m / 3.0;
    let mut far_off = known.clone();
    far_off.orientation.projection_centre_m += Vector3::new(0.3 * height_m, -0.2 * height_m, 0.0);
    far_off.sigma_position_m = [0.2 * height_m, 0.2 * height_m, known.sigma_position_m[2]];
    let cases =
        [("heading", no_heading), ("vague heading", vague_heading), ("height", wrong_height), ("position", far_off)];
    for (name, approximation) in cases {
        let poor = Task { approximation, ..task(&scene) };
        let outcome = run(&picture, &control, &poor);
        let d_max = d_max_gsd(&scene, &outcome);
        assert!(d_max < TOLERANCE_GSD, "{name}: {d_max} GSD");
        let cost = outcome.cost.unwrap();
        let assumed = cost.search.assumed;
        assert_eq!(assumed.kappa_reach_rad.is_none(), name == "heading");
        // three times a third down from four thirds is below what is searched
        assert_eq!(assumed.height_cut, name == "height");
        assert!(cost.search.windows > cost.search.control_points && cost.search.pairs > 0 && cost.adjusted > 0);
        // whatever the number of threads
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(alone.install(|| run(&picture, &control, &poor)), outcome, "{name}");
    }
}

/// A record that errs by ten of the standard deviations that it states.
#[test]
fn an_approximation_that_errs_more_than_it_says_is_searched_again_and_contradicted() {
    let scene = Scene::draw(101, &SceneSettings::default()).unwrap();
    let mut approximation = scene.approximation.clone();
    let [omega, phi, kappa] = rotation::angles(&scene.true_orientation.camera_from_object);
    let off = 5.0_f64.to_radians();
    approximation.orientation.camera_from_object = rotation::camera_from_object(omega + off, phi - off, kappa);
    approximation.sigma_tilt_rad = 0.5_f64.to_radians();
    let task = Task { approximation, ..task(&scene) };
    let outcome = run(&scene.render(), &scene.control_points(), &task);
    let d_max = d_max_gsd(&scene, &outcome);
    assert!(d_max < TOLERANCE_GSD, "{d_max} GSD");
    assert!(outcome.cost.unwrap().widened);
    assert!(outcome.diagnosis.reasons.iter().any(|reason| reason.code == "contradicts_approximation"));
    assert_ne!(outcome.diagnosis.verdict, Verdict::Green);
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

#[test]
fn the_orientations_that_were_examined_are_kept() {
    let scene = Scene::draw(101, &SceneSettings::default()).unwrap();
    let outcome = run(&scene.render(), &scene.control_points(), &task(&scene));
    assert!((8..=64).contains(&outcome.trials.len()), "{}", outcome.trials.len());
    let error_m = |o| d_max_m(&scene.camera, o, &scene.true_orientation, scene.ground_height_m()).unwrap();
    let best = outcome.trials.iter().min_by(|a, b| a.features.log_sigma0.total_cmp(&b.features.log_sigma0)).unwrap();
    assert!(error_m(&best.orientation) < 2.0 * TOLERANCE_GSD * scene.ground_sample_distance_m());
    for trial in &outcome.trials {
        let features = trial.features;
        assert!(features.eliminated <= features.control_points);
        assert!(features.log_sigma0.is_finite() && features.log_configuration.is_finite());
    }
}

/// What the sensitivity predicts, done: the ground moves as far without a control point as it says.
#[test]
fn leaving_out_a_control_point_does_what_its_sensitivity_says() {
    let scene = Scene::draw(101, &SceneSettings::default()).unwrap();
    let (picture, control) = (scene.render(), scene.control_points());
    let whole = run(&picture, &control, &task(&scene));
    let orientation = whole.estimate.as_ref().unwrap().orientation;
    let mut weighty: Vec<_> =
        whole.control_points.iter().filter_map(|c| Some((c.name.clone(), c.sensitivity?))).collect();
    assert!(weighty.len() >= 8);
    assert!(weighty.iter().all(|(_, s)| s.ground.change_m <= s.ground.empirical_m + 1e-9));
    weighty.sort_by(|a, b| b.1.ground.change_m.total_cmp(&a.1.ground.change_m));
    for (name, sensitivity) in &weighty[..3] {
        let others: Vec<ControlPoint> = control.iter().filter(|c| c.name != *name).cloned().collect();
        let without = run(&picture, &others, &task(&scene)).estimate.unwrap().orientation;
        let height_m = whole.ground_height_m.unwrap();
        let moved_m = d_max_m(&scene.camera, &without, &orientation, height_m).unwrap();
        let expected_m = sensitivity.ground.change_m;
        // robust weights and matches of the others change a little, too
        assert!((moved_m - expected_m).abs() < 0.35 * expected_m + 0.01, "{name}: {moved_m} instead of {expected_m} m");
    }
}

#[test]
fn a_control_point_that_was_moved_is_not_believed_and_is_named() {
    let scene = Scene::draw(101, &SceneSettings::default()).unwrap();
    let (picture, mut control) = (scene.render(), scene.control_points());
    let before = run(&picture, &control, &task(&scene));
    let name = &before.control_points.iter().find(|c| c.used).unwrap().name;
    let at = control.iter().position(|c| c.name == *name).unwrap();
    control[at] = moved(&control[at], Vector3::new(0.9, -0.6, 0.0));
    let after = run(&picture, &control, &task(&scene));
    assert!(d_max_gsd(&scene, &after) < TOLERANCE_GSD);
    let found = after.control_points.iter().find(|c| c.name == *name).unwrap();
    assert!(!found.used || found.sensitivity.unwrap().contradicts, "{found:?}");
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

#[test]
fn check_points_are_not_used_and_tell_how_right_the_orientation_is() {
    let scene = Scene::draw(101, &SceneSettings::default()).unwrap();
    let (picture, all) = (scene.render(), scene.control_points());
    let seen = run(&picture, &all, &task(&scene));
    let used = seen.control_points.iter().filter(|c| c.used).map(|c| c.name.clone());
    let names: Vec<String> = used.step_by(3).take(4).collect();
    let (mut check, control): (Vec<_>, Vec<_>) = all.into_iter().partition(|point| names.contains(&point.name));
    let without = run(&picture, &control, &task(&scene));
    // one is not where it is said to be
    let by_m = Vector3::new(0.6, -0.3, 0.0);
    check[0] = moved(&check[0], by_m);
    let task = Task { check: check.clone().into(), ..task(&scene) };
    let outcome = run(&picture, &control, &task);
    // those whose reference point is in view
    assert!(outcome.check_points.len() >= 3, "{:?}", outcome.check_points);
    let gsd_m = scene.ground_sample_distance_m();
    for point in &outcome.check_points {
        if point.name == check[0].name {
            // it is looked for where it is said to be: not found there, or found as far off as it is
            let told = point.residual_m.is_none_or(|residual_m| (residual_m - by_m.norm()).abs() < 3.0 * gsd_m);
            assert!(told, "{point:?} at {gsd_m} m a pixel");
        } else {
            assert!(point.segments_matched >= 2, "{point:?}");
            assert!(point.residual_m.unwrap() < 4.0 * gsd_m, "{point:?} at {gsd_m} m a pixel");
        }
    }
    // they change nothing
    assert_eq!(Outcome { check_points: Vec::new(), ..outcome }, without);
}

#[test]
fn on_the_desk_an_image_is_oriented_as_ever() {
    let scene = Scene::draw(104, &SceneSettings::default()).unwrap();
    let (picture, control, task) = (scene.render(), scene.control_points(), task(&scene));
    let desk = Desk::lay(&picture, &control, &task, &Watched).unwrap();
    assert_eq!(*desk.outcome(), run(&picture, &control, &task));
}

#[test]
fn what_is_switched_off_has_no_part_in_the_orientation_and_is_shown_all_the_same() {
    let scene = Scene::draw(101, &SceneSettings::default()).unwrap();
    let (picture, control, task) = (scene.render(), scene.control_points(), task(&scene));
    let mut desk = Desk::lay(&picture, &control, &task, &Watched).unwrap();
    let before = desk.outcome().clone();
    let used = |outcome: &Outcome| -> Vec<String> {
        outcome.control_points.iter().filter(|c| c.used).map(|c| c.name.clone()).collect()
    };
    let off = used(&before)[..2].to_vec();
    let after = desk.corrected(&Correction { off: off.clone(), moved: Vec::new() }).unwrap();
    assert!(used(&after).iter().all(|name| !off.contains(name)));
    assert!(used(&after).len() + 3 >= used(&before).len());
    assert!(d_max_gsd(&scene, &after) < TOLERANCE_GSD, "{}", d_max_gsd(&scene, &after));
    // as if they were not in the database
    let without: Vec<ControlPoint> = control.iter().filter(|point| !off.contains(&point.name)).cloned().collect();
    let expected = run(&picture, &without, &task);
    let d_max = d_max_m(
        &scene.camera,
        &after.estimate.as_ref().unwrap().orientation,
        &expected.estimate.as_ref().unwrap().orientation,
        scene.ground_height_m(),
    );
    assert!(d_max.unwrap() < 0.2 * scene.ground_sample_distance_m(), "{d_max:?}");
    assert_eq!(after.evidence.as_ref().unwrap().control_points_in_view, {
        expected.evidence.as_ref().unwrap().control_points_in_view
    });
    for name in &off {
        let index = after.control_points.iter().position(|c| c.name == *name).unwrap();
        let point = &after.control_points[index];
        let true_px = scene.true_orientation.pixel(&scene.camera, reference_m(&control, name)).unwrap();
        assert!((point.projected_px.unwrap() - true_px).norm() < TOLERANCE_GSD);
        assert!(after.edges.iter().any(|e| e.control_point == index) && !point.used);
        assert!(after.edges.iter().all(|e| e.control_point != index || e.matched_px.is_empty()));
    }
    // and on again
    let again = desk.corrected(&Correction { off: Vec::new(), moved: Vec::new() }).unwrap();
    assert_eq!(used(&again).len(), used(&before).len());
}

fn reference_m(control: &[ControlPoint], name: &str) -> Vector3<f64> {
    control.iter().find(|point| point.name == name).unwrap().reference_m
}

/// An approximation that is wrong by far more than it says leads nowhere; four places that somebody points at, each 1 px
/// off, lead to the truth.
#[test]
fn pointing_at_control_points_corrects_what_the_approximation_has_misled() {
    let scene = Scene::draw(101, &SceneSettings::default()).unwrap();
    let (picture, control) = (scene.render(), scene.control_points());
    let mut task = task(&scene);
    let truth = scene.true_orientation;
    let height_m = truth.projection_centre_m.z - scene.ground_height_m();
    task.approximation.orientation.projection_centre_m =
        truth.projection_centre_m + Vector3::new(0.2, -0.25, 0.3) * height_m;
    let [omega, phi, kappa] = rotation::angles(&truth.camera_from_object);
    task.approximation.orientation.camera_from_object = rotation::camera_from_object(omega, phi, kappa + 2.5);
    task.approximation.sigma_position_m = [0.01 * height_m; 3];
    task.approximation.sigma_kappa_rad = Some(0.5);
    let mut desk = Desk::lay(&picture, &control, &task, &Watched).unwrap();
    let before = d_max_gsd(&scene, desk.outcome());
    assert!(before > TOLERANCE_GSD, "it is not misled: {before}");
    let seen = |point: &&ControlPoint| {
        let pixel = truth.pixel(&scene.camera, point.reference_m);
        pixel.is_some_and(|pixel| scene.camera.contains(pixel, -200.0))
    };
    let known: Vec<&ControlPoint> = desk.control().iter().filter(seen).collect();
    let corner = |sign: [f64; 2]| {
        let reach = |point: &&&ControlPoint| {
            let pixel = truth.pixel(&scene.camera, point.reference_m).unwrap();
            pixel.dot(&Vector2::from(sign))
        };
        known.iter().max_by(|a, b| reach(a).total_cmp(&reach(b))).unwrap()
    };
    let corners = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]].map(corner);
    let pointed = |point: &&&ControlPoint| {
        let off_px = Vector2::new(0.7, -0.7);
        (point.name.clone(), truth.pixel(&scene.camera, point.reference_m).unwrap() + off_px)
    };
    let moved = corners.iter().map(pointed).collect();
    let after = desk.corrected(&Correction { off: Vec::new(), moved }).unwrap();
    let reached = d_max_gsd(&scene, &after);
    assert!(reached < TOLERANCE_GSD / 2.0, "{reached} GSD");
    assert!(after.control_points.iter().filter(|c| c.used).count() >= 8, "the others are found from there");
}

#[test]
fn the_accumulator_of_a_control_point_peaks_where_it_is() {
    let scene = Scene::draw(101, &SceneSettings::default()).unwrap();
    let (picture, control, task) = (scene.render(), scene.control_points(), task(&scene));
    let mut desk = Desk::lay(&picture, &control, &task, &Watched).unwrap();
    let strong = |c: &&gable::pipeline::ControlPointResult| c.used && c.segments_matched >= 4;
    let names: Vec<String> =
        desk.outcome().control_points.iter().filter(strong).map(|c| c.name.clone()).take(5).collect();
    assert!(names.len() >= 3);
    for name in names {
        let seen = desk.neighbourhood(&name).unwrap().unwrap();
        let accumulator = seen.accumulator.unwrap();
        let true_px = scene.true_orientation.pixel(&scene.camera, reference_m(&control, &name)).unwrap();
        assert_eq!(accumulator.map.values.len(), accumulator.map.size.pow(2));
        let (at_px, log_likelihood) = accumulator.peaks[0];
        assert!((at_px - true_px).norm() < 6.0, "{name}: {at_px} is not {true_px}");
        // the cell of the best place is among the largest: the peaks are those of the smoothed map
        let half = (accumulator.map.size / 2) as f64;
        let [column, row] = ((at_px - seen.predicted_px) / accumulator.map.cell_px).map(|c| (c + half).round()).into();
        let there = accumulator.map.values[row as usize * accumulator.map.size + column as usize];
        let largest = accumulator.map.values.iter().copied().fold(f32::MIN, f32::max);
        assert!(log_likelihood > 0.0 && there > 0.6 * largest, "{name}: {there} of {largest}");
        assert!(!seen.edges_px.is_empty() && !seen.segments_px.is_empty());
    }
    assert_eq!(desk.neighbourhood("nobody").unwrap(), None);
}
