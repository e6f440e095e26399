//! Control scenes in real photographs (`../shared/bench` or `$GABLE_BENCH`): those that are there are found, and those
//! that are not are never used.

#![allow(clippy::unwrap_used, reason = "a test fails by panic")]
#![allow(clippy::print_stderr, reason = "what was measured, and what was skipped")]
#![allow(unreachable_pub, dead_code, reason = "a module that is shared with the benches")]

#[path = "../benches/ratios/dataset.rs"]
mod dataset;

use std::path::PathBuf;
use std::sync::Arc;

use gable::diagnosis::Verdict;
use gable::imagery::{ImageFile, Limits};
use gable::orientation::ControlPoint;
use gable::pipeline::{Observer, Outcome, Stage, orient};
use gable::scenes::Scene;

use self::dataset::{Dataset, Image};

struct Unwatched;

impl Observer for Unwatched {
    fn progress(&self, _: Stage, _: f64) {}
}

/// The folder of a dataset; nothing, and a word about it, where there is none.
fn folder(name: &str) -> Option<PathBuf> {
    let bench = std::env::var_os("GABLE_BENCH").map_or_else(|| PathBuf::from("../shared/bench"), PathBuf::from);
    let folder = bench.join(name);
    let there = folder.join("dataset.json").exists();
    if !there {
        eprintln!("skipped: {} is not there; GABLE_BENCH names the folder of the datasets", folder.display());
    }
    there.then_some(folder)
}

fn oriented(image: &Image, control: &[ControlPoint]) -> Outcome {
    let picture = ImageFile::open(&image.file, &Limits::default()).unwrap();
    orient(&picture, control, &image.task, &Unwatched).unwrap()
}

fn in_view<'a>(dataset: &'a Dataset, image: &'a Image) -> impl Iterator<Item = usize> + 'a {
    let truth = image.true_orientation(dataset);
    let seen = move |k: &usize| {
        let pixel = truth.pixel(&dataset.camera, image.scenes[*k].reference_m);
        pixel.is_some_and(|pixel| dataset.camera.contains(pixel, 0.0))
    };
    (0..image.scenes.len()).filter(seen)
}

/// How a scene is made one that is not in the image.
#[derive(Debug, Clone, Copy)]
enum Wrong {
    /// Its picture is one of another place, said to be as fine as its own.
    OfAnotherPlace,
    /// Its picture is that of a scene elsewhere in the same place.
    Moved,
}

/// The control scenes of an image of which every second one in view is wrong, with their names.
fn with_wrong_ones(
    wrong: Wrong,
    image: &Image,
    seen: &[usize],
    others: &[Arc<Scene>],
    turn: usize,
) -> (Vec<ControlPoint>, Vec<String>) {
    const FAR_M: f64 = 40.0;
    let mut control = image.scenes.clone();
    let mut names = Vec::new();
    for (number, k) in seen.iter().enumerate().skip(turn % 2).step_by(2) {
        let own = &image.scenes[*k];
        let picture = match wrong {
            Wrong::OfAnotherPlace => {
                let other = &others[(5 * number + turn) % others.len()];
                Some(Arc::new(Scene { gsd_m: own.scene.as_ref().unwrap().gsd_m, ..(**other).clone() }))
            }
            Wrong::Moved => {
                let far = |other: &&ControlPoint| (other.reference_m - own.reference_m).norm() > FAR_M;
                image.scenes.iter().filter(far).nth((7 * number + turn) % 3).and_then(|other| other.scene.clone())
            }
        };
        let Some(picture) = picture else { continue };
        control[*k].scene = Some(picture);
        names.push(own.name.clone());
    }
    (control, names)
}

/// Pairs of images and scenes that are not in them, and how many of these were used.
fn wrongly_used(approximation: &str, wrongs: &[Wrong], turns: &[usize]) -> Option<[usize; 2]> {
    let (mut pairs, mut used) = (0, 0);
    for (own, other) in [("boruszyn", "caliterra"), ("caliterra", "boruszyn")] {
        let dataset = Dataset::read(&folder(own)?, approximation, 0).unwrap();
        let others = Dataset::read(&folder(other)?, approximation, 0).unwrap();
        let others: Vec<Arc<Scene>> = others.images[0].scenes.iter().filter_map(|point| point.scene.clone()).collect();
        for (number, image) in dataset.images.iter().enumerate() {
            let seen: Vec<usize> = in_view(&dataset, image).collect();
            for (wrong, turn) in wrongs.iter().flat_map(|wrong| turns.iter().map(move |turn| (*wrong, *turn))) {
                let (control, names) = with_wrong_ones(wrong, image, &seen, &others, number + turn);
                let outcome = oriented(image, &control);
                let wrongly: Vec<_> =
                    outcome.control_points.iter().filter(|point| point.used && names.contains(&point.name)).collect();
                if !wrongly.is_empty() {
                    eprintln!("{} {wrong:?} {wrongly:?}", image.file.display());
                }
                pairs += names.len();
                used += wrongly.len();
            }
        }
    }
    Some([pairs, used])
}

#[test]
fn a_scene_that_is_not_in_the_image_is_not_used() {
    let Some([pairs, used]) = wrongly_used("attitude", &[Wrong::OfAnotherPlace], &[0]) else { return };
    eprintln!("{used} of {pairs} scenes of another place were used");
    assert_eq!(used, 0);
    assert!(pairs > 60);
}

#[test]
#[ignore = "some ten minutes: cargo test --release --test control_scenes -- --ignored --nocapture"]
fn of_500_scenes_that_are_not_in_the_image_none_is_used() {
    let wrongs = [Wrong::OfAnotherPlace, Wrong::Moved];
    let Some(attitude) = wrongly_used("attitude", &wrongs, &[0, 1]) else { return };
    let Some(nadir) = wrongly_used("nadir", &wrongs, &[2, 3]) else { return };
    let [pairs, used] = [0, 1].map(|k| attitude[k] + nadir[k]);
    eprintln!("{used} of {pairs} scenes that are not in the image were used");
    assert_eq!(used, 0);
    assert!(pairs >= 500, "{pairs}");
}

/// Images that see five scenes or more are oriented by these alone.
#[test]
fn images_are_oriented_by_their_scenes() {
    let (mut right, mut images) = (0, 0);
    for name in ["boruszyn", "caliterra"] {
        let Some(folder) = folder(name) else { return };
        let dataset = Dataset::read(&folder, "attitude", 0).unwrap();
        for image in &dataset.images {
            if in_view(&dataset, image).count() < 6 {
                continue;
            }
            let outcome = oriented(image, &image.scenes);
            let within = dataset.d_max_gsd(image, &outcome).is_some_and(|d_max| d_max <= dataset.tolerance_gsd);
            images += 1;
            right += usize::from(within);
            assert!(within || outcome.diagnosis.verdict != Verdict::Green, "{}", image.file.display());
        }
    }
    eprintln!("{right} of {images} images were oriented within the tolerance by their scenes");
    assert!(images >= 10 && 10 * right >= 9 * images, "{right} of {images}");
}
