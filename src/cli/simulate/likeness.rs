//! `gable simulate --likeness`: a mixture beside real photographs.

use std::ops::Range;
use std::path::Path;

use crate::imagery::{ImageFile, Limits};
use crate::jobs::request::ControlChoice;
use crate::orientation::ControlPoint;
use crate::study::Mixture;
use crate::study::likeness::{Known, Likeness, measure, side_by_side};
use anyhow::Context as _;
use rayon::prelude::*;

use super::super::dataset::{Dataset, DatasetImage};
use super::super::print;

/// Prints the statistics of a dataset and of a mixture side by side.
pub(super) fn compare(mixture: Mixture, seeds: Range<u64>, dataset: &Path) -> anyhow::Result<()> {
    let (name, real) = of_dataset(dataset)?;
    let simulated = merged(seeds.into_par_iter().map(|seed| of_scene(mixture, seed)).collect::<Result<_, _>>()?);
    print(&side_by_side(&[(name, real), (mixture.name().to_owned(), simulated)]))
}

fn merged(images: Vec<Likeness>) -> Likeness {
    let mut all = Likeness::default();
    images.into_iter().for_each(|image| all.add(image));
    all
}

fn of_scene(mixture: Mixture, seed: u64) -> anyhow::Result<Likeness> {
    let scene = mixture.scene(seed)?;
    // control and images of the benchmark are of the same flights: none of it is outdated
    let sound: Vec<ControlPoint> =
        scene.control.iter().filter(|c| c.fault.is_none()).map(|c| c.control_point.clone()).collect();
    Ok(measure(&Known {
        picture: &scene.picture(),
        camera: &scene.camera,
        truth: scene.true_orientation,
        approximate: scene.approximation.orientation,
        control: &sound,
    })?)
}

fn of_dataset(folder: &Path) -> anyhow::Result<(String, Likeness)> {
    let Dataset { name, camera, control, images, .. } = Dataset::read(folder, ControlChoice::Lines.into())?;
    let of_image = |image: &DatasetImage| {
        let picture = ImageFile::open(&image.file, &Limits::default())?;
        let (truth, approximate) = (image.reference, image.attitude.orientation);
        anyhow::Ok(measure(&Known { picture: &picture, camera: &camera, truth, approximate, control: &control })?)
    };
    let measured: anyhow::Result<Vec<Likeness>> =
        images.iter().map(|image| of_image(image).with_context(|| image.file.display().to_string())).collect();
    Ok((name, merged(measured?)))
}
