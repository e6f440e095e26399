//! `gable train`.

use std::path::{Path, PathBuf};

use crate::classifiers::{Comparison, Loaded, Texts, Training, TrainingSet, trained};
use crate::diagnosis::Policy;
use crate::diagnosis::judge::threshold;
use crate::jobs::request::CostsRequest;
use crate::jobs::training::{Source, TrainingPlan, history};
use crate::learning::{Costs, Kind};
use crate::store::Store;
use crate::store::classifiers::ClassifierTexts;
use anyhow::{Context as _, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use uuid::Uuid;

use super::classifier::{refuse_taken, taken};
use super::evaluate::costs;
use super::{print, sets};

const EXAMPLES: &str = "\
Examples:
  gable train study-good study-poor --not-trained-on study-wide --out my-classifier
      From studies of simulated images. Kind and caution are chosen by what the classifiers say of areas that they were not
      trained on: one study by the other, and the third by both. Leaves model.svm (LIBSVM's format), scaling.range
      (svm-scale's) and classifier.json (calibration, provenance, all figures) in the folder.

  gable train --data /srv/gable --name rhineland --activate
      From the history of a service: the orientations of images that have a reference (POST /references). The classifier is
      kept in the data folder, and decides from now on.

  gable train mine.jsonl --kind paper,one_feature --out papers
      Only the paper's classifiers, from a labelled set of your own.

`gable evaluate --classifier FOLDER` shows what it decides on other images.";

/// Train a classifier for the self-diagnosis
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Train {
    /// Labelled sets: files, or folders of studies. [default: the history of --data]
    #[arg(value_name = "SET", required_unless_present = "data")]
    sets: Vec<PathBuf>,
    /// Labelled sets of further areas, not learned from: kind and caution are chosen by what is said of them.
    #[arg(long, value_name = "SET")]
    not_trained_on: Vec<PathBuf>,
    /// Kinds that are compared, with commas between: paper, one_feature, evidence_svm, evidence_logistic. [default: all]
    #[arg(long, value_name = "KIND", value_delimiter = ',', value_parser = kind)]
    kind: Vec<Kind>,
    /// What decisions cost: accepted and right, accepted though wrong, rejected though right, rejected and wrong.
    /// [default: 0,40,5,10]
    #[arg(long, value_name = "CC,CW,WC,WW", value_parser = costs)]
    costs: Option<Costs>,
    /// Folder for the classifier.
    #[arg(long, value_name = "FOLDER", required_unless_present = "data")]
    out: Option<PathBuf>,
    /// Data folder to keep the classifier in.
    #[arg(long, value_name = "FOLDER", requires = "name")]
    data: Option<PathBuf>,
    /// Its unique name there.
    #[arg(long, value_name = "NAME", requires = "data")]
    name: Option<String>,
    /// It decides from now on.
    #[arg(long, requires = "data")]
    activate: bool,
}

fn kind(text: &str) -> Result<Kind, String> {
    let known = Kind::ALL.map(Kind::name).join(", ");
    Kind::from_name(text).ok_or_else(|| format!("it is not one of {known}"))
}

impl Train {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let store = match &self.data {
            Some(folder) if !folder.join("gable.db").exists() => bail!("there is no data folder {}", folder.display()),
            Some(folder) => Some(Store::open(folder).await?),
            None => None,
        };
        if let (Some(store), Some(name)) = (&store, &self.name) {
            refuse_taken(store, name).await?;
        }
        let set = match &store {
            Some(store) if self.sets.is_empty() => history(store).await?,
            _ => sets::read_sets(&self.sets)?,
        };
        if set.images.is_empty() {
            bail!("there are no labelled images; give references of images that were oriented (POST /references)");
        }
        let kinds = if self.kind.is_empty() { Kind::ALL.to_vec() } else { self.kind.clone() };
        let costs = self.costs.unwrap_or_default();
        let not_trained_on = sets::read_sets(&self.not_trained_on)?;
        if let Some(both) = not_trained_on.sets.iter().find(|other| set.sets.iter().any(|s| s.sha256 == other.sha256)) {
            bail!("{} is learned from: it cannot tell what happens on areas not trained on", both.name);
        }
        let wanted = kinds.clone();
        let texts = tokio::task::spawn_blocking(move || train(&set, &not_trained_on, &wanted, costs)).await??;
        if let Some(folder) = &self.out {
            sets::write_classifier(&texts, folder)?;
        }
        if let (Some(store), Some(name)) = (&store, &self.name) {
            self.keep(store, name, &texts, &kinds, costs).await?;
        }
        print(&summary(&texts.load()?, costs, self.out.as_deref()))
    }

    async fn keep(&self, store: &Store, name: &str, texts: &Texts, kinds: &[Kind], costs: Costs) -> anyhow::Result<()> {
        let plan = TrainingPlan {
            kinds: kinds.iter().map(|kind| kind.name().to_owned()).collect(),
            costs: CostsRequest::from(costs),
            source: if self.sets.is_empty() { Source::History } else { Source::Upload },
            activate: self.activate,
        };
        let id = Uuid::now_v7();
        let Texts { model, scaling, description } = texts.clone();
        let stored = ClassifierTexts { model, scaling, description };
        let plan = serde_json::to_string(&plan).context("the plan cannot be written")?;
        if !store.add_classifier(id, name, &plan, &stored, texts.sha256()).await? {
            return Err(taken(name));
        }
        if self.activate {
            store.activate_classifier(Some(id)).await?;
        }
        Ok(())
    }
}

fn train(set: &TrainingSet, not_trained_on: &TrainingSet, kinds: &[Kind], costs: Costs) -> anyhow::Result<Texts> {
    const STEPS: u64 = 1000;
    let bar = ProgressBar::new(STEPS);
    if let Ok(style) = ProgressStyle::with_template("training {wide_bar} {elapsed}") {
        bar.set_style(style);
    }
    let training = Training { set, not_trained_on, kinds, costs };
    let texts = trained(&training, &|done| {
        bar.set_position((done * STEPS as f64) as u64);
        true
    });
    bar.finish_and_clear();
    Ok(texts?)
}

/// What was trained, and how the kinds compare.
fn summary(loaded: &Loaded, costs: Costs, folder: Option<&Path>) -> String {
    let description = &loaded.description;
    let provenance = &description.provenance;
    let mut lines = vec![
        format!("{} {}, caution {}", description.kind, loaded.hash(), description.caution),
        format!(
            "{} of {} samples, {} support vectors, {} folds by image, calibration error {:.4}",
            provenance.samples_used,
            provenance.samples,
            provenance.support_vectors,
            provenance.folds,
            description.evaluation.calibration_error
        ),
        String::new(),
        "| kind | cost, cross-validated | caution | cost on areas not trained on: accepted right, accepted wrong, rejected \
         right, rejected wrong | mean |"
            .to_owned(),
        "|---|---|---|---|---|".to_owned(),
    ];
    lines.extend(provenance.compared.iter().map(compared));
    lines.extend(provenance.not_trained.iter().map(|kind| format!("\nNot trained: {}: {}", kind.kind, kind.reason)));
    let policy = Policy { costs, ..Policy::default() };
    let confusion = description.evaluation.confusion(threshold(&loaded.classifier, &policy));
    lines.push(format!(
        "\nIn the cross-validation, with its caution: {} accepted and right, {} accepted though wrong, {} rejected though \
         right, {} rejected and wrong; cost {:.3}",
        confusion.cc,
        confusion.cw,
        confusion.wc,
        confusion.ww,
        confusion.expected_cost(&costs)
    ));
    lines.extend(folder.map(|folder| format!("Kept in {}", folder.display())));
    lines.join("\n")
}

fn compared(comparison: &Comparison) -> String {
    let areas = comparison.areas_not_trained_on.iter().map(|area| {
        let [cc, cw, wc, ww] = area.confusion;
        format!("{} {:.3}: {cc}, {cw}, {wc}, {ww}", area.area, area.cost)
    });
    format!(
        "| {} | {:.3} | {} | {} | {:.3} |",
        comparison.kind,
        comparison.cost_cross_validated,
        comparison.caution,
        areas.collect::<Vec<_>>().join("; "),
        comparison.deciding_cost()
    )
}
