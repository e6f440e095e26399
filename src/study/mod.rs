//! The study: thousands of simulated images, one row for each, and the table of Förstner and Läbe's kind.
//!
//! A [`Mixture`] draws the settings of a scene from stated distributions. [`oriented`] runs the pipeline on the scene,
//! [`paper::orient`] the paper's own method on the same picture, and a [`Row`] says what came out, with the truth
//! beside it. [`table::table`] counts rows, [`plot::plot`] draws predicted against true errors. Whether a mixture is
//! like real photographs, [`likeness::measure`] tells: it takes the same statistics of both.

pub mod film;
mod hostile;
pub mod likeness;
pub mod mixture;
pub mod paper;
pub mod plot;
pub mod row;
pub mod table;

use std::sync::Arc;

pub use hostile::Hostility;
pub use mixture::Mixture;
pub use row::{Fate, Light, Row};

use crate::classifiers::{LabelledImage, Record, Reference};
use crate::diagnosis::Policy;
use crate::features::Picture;
use crate::learning::Classifier;
use crate::pipeline::{Fault, Judge, Observer, Outcome, Stage, Task, Tolerance, orient};
use crate::simulation::Scene;

/// Runs the pipeline on a scene, told what it is told of a real image.
///
/// # Errors
/// [`Fault`] if the picture cannot be read.
pub fn oriented(
    scene: &Scene,
    picture: &dyn Picture,
    tolerance_gsd: f64,
    classifier: &Arc<Classifier>,
) -> Result<Outcome, Fault> {
    let task = Task {
        camera: scene.camera,
        approximation: scene.approximation.clone(),
        check: std::sync::Arc::default(),
        tolerance: Tolerance::Gsd(tolerance_gsd),
        judge: Judge { classifier: classifier.clone(), policy: Policy::default() },
    };
    orient(picture, &scene.control_points(), &task, &Nobody)
}

/// The outcome for a scene held against its truth.
#[must_use]
pub fn labelled(mixture: Mixture, scene: &Scene, outcome: &Outcome) -> LabelledImage {
    let reference = Reference {
        camera: &scene.camera,
        orientation: scene.true_orientation,
        ground_height_m: scene.ground_height_m(),
        tolerance_m: mixture.tolerance_gsd(scene.seed) * scene.ground_sample_distance_m(),
    };
    Record::of(outcome).labelled(image_name(mixture, scene.seed), mixture.name().to_owned(), &reference)
}

/// The name of the image of a mixture with a seed.
#[must_use]
pub fn image_name(mixture: Mixture, seed: u64) -> String {
    format!("{}-{seed}", mixture.name())
}

/// Nobody watches a single image of thousands.
struct Nobody;

impl Observer for Nobody {
    fn progress(&self, _: Stage, _: f64) {}
}
