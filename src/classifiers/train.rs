//! From labelled images to a classifier with its description.

use std::collections::BTreeMap;

use super::evaluation::Scored;
use super::provenance::{AreaNotTrainedOn, Comparison, LabelledSet};
use super::texts::{ClassifierError, Description};
use super::{Evaluation, LabelledImage, Provenance, Texts, evidence_of, feature_names, samples_of};
use crate::diagnosis::Evidence;
use crate::learning::svm::SvmError;
use crate::learning::training::{Example, Plan, Trained, Transfer, by_area, caution, train, transfer, transfers};
use crate::learning::{Costs, Kind, cheapest, cost_curve};

/// Labelled images with the sets that they come from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrainingSet {
    /// The sets.
    pub sets: Vec<LabelledSet>,
    /// The images of all of them.
    pub images: Vec<LabelledImage>,
}

/// The images as a kind of classifier sees them. Of an image without usable evidence nothing is seen.
#[must_use]
pub fn examples(images: &[LabelledImage], kind: Kind) -> Vec<Example> {
    let example = |image: &LabelledImage| Example {
        image: image.image.clone(),
        area: image.area.clone(),
        right: image.right(),
        samples: samples_of(image, kind),
    };
    images.iter().map(example).collect()
}

/// What is to be trained.
#[derive(Debug, Clone, PartialEq)]
pub struct Training<'a> {
    /// What is learned from.
    pub set: &'a TrainingSet,
    /// Further areas, not learned from: kind and caution are chosen by what classifiers say of them.
    pub not_trained_on: &'a TrainingSet,
    /// The kinds that are compared.
    pub kinds: &'a [Kind],
    /// What decisions cost.
    pub costs: Costs,
}

/// Trains all kinds, compares them on areas that they were not trained on, and gives the texts of the one with the least
/// expected cost. `progress` hears how much is done, and ends the training by answering no.
///
/// # Errors
/// [`ClassifierError`] if there is nothing to learn.
pub fn trained(training: &Training, progress: &dyn Fn(f64) -> bool) -> Result<Texts, ClassifierError> {
    let mut all: Vec<(Trained, Comparison, Plan)> = Vec::new();
    let count = training.kinds.len() as f64;
    for (k, kind) in training.kinds.iter().enumerate() {
        all.push(of_kind(training, *kind, &|done| progress((k as f64 + done) / count))?);
    }
    let compared: Vec<Comparison> = all.iter().map(|(_, comparison, _)| comparison.clone()).collect();
    let best = all.into_iter().min_by(|a, b| a.1.deciding_cost().total_cmp(&b.1.deciding_cost()));
    let (trained, _, plan) =
        best.ok_or(SvmError::Untrainable { detail: "no kind of classifier was asked for".to_owned() })?;
    let description = description(training, &trained, &plan, compared);
    Texts::of(&trained.classifier, &description)
}

fn of_kind(
    training: &Training,
    kind: Kind,
    progress: &dyn Fn(f64) -> bool,
) -> Result<(Trained, Comparison, Plan), ClassifierError> {
    let plan = Plan::new(kind, &feature_names(kind), training.costs);
    let inside = examples(&training.set.images, kind);
    let mut trained = train(&inside, &plan, &|done| progress(0.6 * done))?;
    let mut transfers = transfers(&inside, &plan, &|done| progress(0.6 + 0.4 * done))?;
    let outside = examples(&training.not_trained_on.images, kind);
    transfers.extend(by_area(&outside).iter().map(|(area, of_area)| transfer(&trained.classifier, area, of_area)));
    let (caution, _) = caution(&transfers, &training.costs);
    trained.classifier.caution = caution;
    let comparison = comparison(&trained, &transfers, &training.costs);
    Ok((trained, comparison, plan))
}

fn comparison(trained: &Trained, transfers: &[Transfer], costs: &Costs) -> Comparison {
    let cheapest = cheapest(&cost_curve(&trained.scored()), costs);
    let caution = trained.classifier.caution;
    let least_probability = costs.least_probability_with(caution).unwrap_or(f64::INFINITY);
    let area = |transfer: &Transfer| {
        let c = transfer.confusion(least_probability);
        let right_share = (c.cc + c.wc) as f64 / c.total().max(1) as f64;
        AreaNotTrainedOn {
            area: transfer.area.clone(),
            confusion: [c.cc, c.cw, c.wc, c.ww],
            cost: c.expected_cost(costs),
            cost_of_rejecting: costs.of_rejecting(right_share),
        }
    };
    Comparison {
        kind: trained.classifier.kind.name().to_owned(),
        cost_cross_validated: cheapest.map_or(f64::MAX, |point| point.confusion.expected_cost(costs)),
        caution,
        areas_not_trained_on: transfers.iter().map(area).collect(),
    }
}

fn description(training: &Training, trained: &Trained, plan: &Plan, compared: Vec<Comparison>) -> Description {
    let set = training.set;
    let classifier = &trained.classifier;
    let scored = |(score, right): (f64, bool)| {
        let probability = if score.is_finite() { classifier.calibration.probability(score) } else { 0.0 };
        Scored { score, probability, right }
    };
    let mut areas: BTreeMap<String, usize> = BTreeMap::new();
    for image in &set.images {
        *areas.entry(image.area.clone()).or_default() += 1;
    }
    let Costs { cc, cw, wc, ww } = plan.costs;
    Description {
        kind: classifier.kind.name().to_owned(),
        features: classifier.features.clone(),
        calibration: classifier.calibration.steps().iter().map(|s| (s.from, s.probability, s.images)).collect(),
        caution: classifier.caution,
        domain: (&classifier.domain).into(),
        distributions: trained.distributions.iter().map(|d| d.as_ref().map(Into::into)).collect(),
        evaluation: Evaluation::of(&trained.scored().into_iter().map(scored).collect::<Vec<_>>()),
        provenance: Provenance {
            program: concat!("gable ", env!("CARGO_PKG_VERSION")).to_owned(),
            sets: set.sets.clone(),
            sets_not_trained_on: training.not_trained_on.sets.clone(),
            areas,
            samples: trained.samples,
            samples_used: trained.samples_used,
            c: trained.hyperparameters.map(|h| h.price),
            gamma: trained.hyperparameters.map(|h| h.gamma),
            support_vectors: classifier.machine.support_vectors(),
            folds: plan.folds,
            seed: plan.seed,
            costs: [cc, cw, wc, ww],
            compared,
        },
    }
}

/// The evidence of a labelled image, if it is complete.
pub(super) fn evidence(image: &LabelledImage) -> Option<Evidence> {
    let numbers = image.evidence.as_ref()?;
    evidence_of(numbers).ok()
}
