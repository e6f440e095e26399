//! `gable evaluate`: what a classifier decides on labelled images, against what is right.

mod oriented;
mod tables;

use std::path::PathBuf;

use crate::classifiers::{LabelledImage, Loaded};
use crate::diagnosis::Policy;
use crate::jobs::active::{ActiveClassifier, shipped_classifier};
use crate::jobs::request::ControlChoice;
use crate::learning::Costs;
use crate::store::Store;
use anyhow::{Context as _, bail};
use clap::Args;

use super::{geoids_of_environment, install_geoids, print, sets};
use oriented::Approximations;

const EXAMPLES: &str = "\
Examples:
  gable evaluate study-good
      What the classifier that Gable brings along decides on the images of a study: confusion tables over T_d with their
      costs, beside those of the thresholds and of rejecting all, and its calibration.

  gable evaluate ../shared/bench/boruszyn_wire ../shared/bench/caliterra --draws 20 --save real.jsonl
      Orients the real photographs of these datasets with their own approximations and with 20 others drawn about the
      reference, compares with the reference, and keeps what came out as a labelled set.

  gable evaluate mine.jsonl --classifier my-classifier --costs 0,40,5,10 --caution 1
      Another classifier, made by `gable train`, at other costs.

  gable evaluate ../shared/bench/boruszyn_wire --control scenes
      The same with the control scenes of the dataset instead of its buildings.

A labelled set is a file of JSON Lines, as `gable simulate --mixture` leaves in its folder (labelled.jsonl).";

/// Judge labelled images by a classifier, and count what is right
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Evaluate {
    /// Labelled sets: files, folders of studies, or folders of datasets, which are oriented first.
    #[arg(required = true, value_name = "SET")]
    sets: Vec<PathBuf>,
    /// Folder of the classifier. [default: the one that Gable brings along, or the active one of --data]
    #[arg(long, value_name = "FOLDER", conflicts_with = "data")]
    classifier: Option<PathBuf>,
    /// Data folder whose active classifier is taken.
    #[arg(long, value_name = "FOLDER")]
    data: Option<PathBuf>,
    /// What decisions cost: accepted and right, accepted though wrong, rejected though right, rejected and wrong.
    #[arg(long, value_name = "CC,CW,WC,WW", value_parser = costs)]
    costs: Option<Costs>,
    /// So many times larger may the odds of being wrong be than the classifier says. [default: the classifier's]
    #[arg(long, value_name = "N")]
    caution: Option<f64>,
    /// T_d, whatever costs and caution.
    #[arg(long, value_name = "SCORE", allow_negative_numbers = true)]
    threshold: Option<f64>,
    /// Of a dataset: approximations that are drawn anew for each image, beside those that it has.
    #[arg(long, value_name = "N", default_value_t = 0)]
    draws: u64,
    /// Of a dataset: the approximations.
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["attitude", "nadir"])]
    approximation: Vec<Approximations>,
    /// Of a dataset: the control, buildings or scenes or both.
    #[arg(long, value_name = "KIND", value_enum, default_value = "lines")]
    control: ControlChoice,
    /// Of a dataset: only images that see at least so many control points of the kinds that are used.
    #[arg(long, value_name = "N", default_value_t = 4)]
    min_in_view: usize,
    /// Keep what came out of datasets as a labelled set.
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    /// Write cost.svg and calibration.svg into this folder.
    #[arg(long, value_name = "FOLDER")]
    plots: Option<PathBuf>,
    /// Name every image that is accepted though wrong.
    #[arg(long)]
    list: bool,
}

/// Four costs, none negative, of which accepting what is wrong is dearer than rejecting it.
pub(super) fn costs(text: &str) -> Result<Costs, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse::<f64>()).collect();
    let [cc, cw, wc, ww] = numbers.ok().and_then(|n| n.try_into().ok()).ok_or("give four numbers, like 0,40,5,10")?;
    let costs = Costs { cc, cw, wc, ww };
    if ![cc, cw, wc, ww].iter().all(|cost| (0.0..1e9).contains(cost)) {
        return Err("costs must be from 0 to 1e9".to_owned());
    }
    match costs.least_probability() {
        Some(_) => Ok(costs),
        None => Err("accepting what is wrong (the second) must cost more than rejecting it (the fourth)".to_owned()),
    }
}

impl Evaluate {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        if self.caution.is_some_and(|caution| !(1.0..=1e6).contains(&caution)) {
            bail!("--caution must be from 1 to 1e6");
        }
        if self.threshold.is_some_and(|threshold| !threshold.is_finite()) {
            bail!("--threshold must be a number");
        }
        install_geoids(geoids_of_environment()?);
        let loaded = self.loaded().await?;
        tokio::task::spawn_blocking(move || self.obey(&loaded)).await?
    }

    async fn loaded(&self) -> anyhow::Result<Loaded> {
        if let Some(folder) = &self.classifier {
            return sets::read_classifier(folder);
        }
        let Some(folder) = &self.data else { return Ok(shipped_classifier()?.loaded) };
        if !folder.join("gable.db").exists() {
            bail!("there is no data folder {}", folder.display());
        }
        let store = Store::open(folder).await?;
        Ok(ActiveClassifier::default().get(&store).await?.loaded)
    }

    fn obey(&self, loaded: &Loaded) -> anyhow::Result<()> {
        let policy = Policy { costs: self.costs.unwrap_or_default(), caution: self.caution, threshold: self.threshold };
        let mut all = Vec::new();
        for path in &self.sets {
            let images = if path.join("dataset.json").exists() {
                oriented::orient_all(path, self, loaded)?
            } else {
                sets::read_sets(std::slice::from_ref(path))?.images
            };
            if images.is_empty() {
                bail!("{} has no images", path.display());
            }
            print(&tables::tables(&path.display().to_string(), &images, loaded, &policy, self.list))?;
            all.extend(images);
        }
        if self.sets.len() > 1 {
            print(&tables::tables("all of them", &all, loaded, &policy, false))?;
        }
        self.keep(&all, loaded, &policy)
    }

    fn keep(&self, images: &[LabelledImage], loaded: &Loaded, policy: &Policy) -> anyhow::Result<()> {
        if let Some(file) = &self.save {
            let mut lines = Vec::new();
            for image in images {
                serde_json::to_writer(&mut lines, image)?;
                lines.push(b'\n');
            }
            std::fs::write(file, lines).with_context(|| format!("cannot write {}", file.display()))?;
        }
        if let Some(folder) = &self.plots {
            std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
            for (name, svg) in tables::plots(images, loaded, policy) {
                let path = folder.join(name);
                std::fs::write(&path, svg).with_context(|| format!("cannot write {}", path.display()))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_costs_are_read_and_senseless_ones_refused() {
        assert_eq!(costs("0, 40,5,10"), Ok(Costs::default()));
        for senseless in ["", "1,2,3", "0,40,5,x", "0,5,5,10", "0,inf,5,10", "-1,40,5,10", "0,nan,5,10"] {
            assert!(costs(senseless).is_err(), "{senseless}");
        }
    }
}
