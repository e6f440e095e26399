//! The study: thousands of simulated images, one row for each, and the table of Förstner and Läbe's kind.
//!
//! A [`Mixture`] draws the settings of a scene from stated distributions. [`oriented`] runs the pipeline on the scene,
//! [`paper::orient`] the paper's own method on the same picture, and a [`Row`] says what came out, with the truth
//! beside it. [`table::table`] counts rows, [`plot::plot`] draws predicted against true errors. Whether a mixture is
//! like real photographs, [`likeness::measure`] tells: it takes the same statistics of both.

pub mod likeness;
pub mod mixture;
pub mod paper;
pub mod plot;
pub mod row;
pub mod table;

pub use mixture::Mixture;
pub use row::{Fate, Light, Row};

use crate::features::Picture;
use crate::pipeline::{Fault, Observer, Outcome, Stage, Task, Tolerance, orient};
use crate::simulation::Scene;

/// What an orientation may err on the ground, in ground sample distances: the contract's default, and the tolerance
/// of the benchmark.
pub const TOLERANCE_GSD: f64 = 10.0;

/// Runs the pipeline on a scene, told what it is told of a real image.
///
/// # Errors
/// [`Fault`] if the picture cannot be read.
pub fn oriented(scene: &Scene, picture: &dyn Picture) -> Result<Outcome, Fault> {
    let task = Task {
        camera: scene.camera,
        approximation: scene.approximation.clone(),
        tolerance: Tolerance::Gsd(TOLERANCE_GSD),
    };
    orient(picture, &scene.control_points(), &task, &Nobody)
}

/// Nobody watches a single image of thousands.
struct Nobody;

impl Observer for Nobody {
    fn progress(&self, _: Stage, _: f64) {}
}
