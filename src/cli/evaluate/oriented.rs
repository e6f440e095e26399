//! The images of a dataset, oriented and held against their references.

use std::path::Path;

use crate::classifiers::{LabelledImage, Loaded, Record, Reference};
use crate::diagnosis::Policy;
use crate::imagery::{ImageFile, Limits};
use crate::pipeline::{Approximation, Judge, Observer, Stage, Task, Tolerance, orient};
use anyhow::Context as _;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};

use super::super::dataset::{Dataset, DatasetImage, drawn};
use super::Evaluate;

/// The approximations of a dataset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Approximations {
    /// Omega and phi known to some degrees, kappa too.
    Attitude,
    /// Omega and phi taken as 0.
    Nadir,
    /// No angle at all.
    Position,
}

impl Approximations {
    fn of(self, image: &DatasetImage) -> Approximation {
        match self {
            Self::Attitude => image.attitude.clone(),
            Self::Nadir => image.nadir.clone(),
            Self::Position => {
                Approximation { sigma_tilt_rad: 5.0_f64.to_radians(), sigma_kappa_rad: None, ..image.nadir.clone() }
            }
        }
    }
}

/// Seeds of draws: those of one kind of approximation lie apart from those of another.
const SEEDS_OF_A_KIND: u64 = 1000;

struct Nobody;

impl Observer for Nobody {
    fn progress(&self, _: Stage, _: f64) {}
}

/// Orients all images with all approximations.
pub(super) fn orient_all(folder: &Path, asked: &Evaluate, loaded: &Loaded) -> anyhow::Result<Vec<LabelledImage>> {
    let dataset = Dataset::read(folder, asked.control.into())?;
    let images: Vec<&DatasetImage> =
        dataset.images.iter().filter(|image| image.control_points_in_view >= asked.min_in_view).collect();
    let runs = (images.len() * asked.approximation.len()) as u64 * (1 + asked.draws);
    let bar = ProgressBar::new(runs);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}") {
        bar.set_style(style);
    }
    bar.set_message(dataset.name.clone());
    let mut labelled = Vec::new();
    for image in images {
        let name = image.file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let picture = ImageFile::open(&image.file, &Limits::default())?;
        let reference = Reference {
            camera: &dataset.camera,
            orientation: image.reference,
            ground_height_m: dataset.ground_height_m,
            tolerance_m: dataset.tolerance_gsd * image.gsd_m,
        };
        for (k, kind) in asked.approximation.iter().enumerate() {
            let stated = kind.of(image);
            let seed = |draw: u64| k as u64 * SEEDS_OF_A_KIND + draw;
            let others = (1..=asked.draws).map(|draw| drawn(&stated, &image.reference, seed(draw)));
            for approximation in std::iter::once(stated.clone()).chain(others) {
                let task = Task {
                    camera: dataset.camera,
                    approximation,
                    check: std::sync::Arc::default(),
                    tolerance: Tolerance::Gsd(dataset.tolerance_gsd),
                    judge: Judge { classifier: loaded.classifier.clone(), policy: Policy::default() },
                };
                let outcome = orient(&picture, &dataset.control, &task, &Nobody)
                    .with_context(|| image.file.display().to_string())?;
                labelled.push(Record::of(&outcome).labelled(name.clone(), dataset.name.clone(), &reference));
                bar.inc(1);
            }
        }
    }
    bar.finish_and_clear();
    Ok(labelled)
}
