//! Training: hyperparameters by cross-validation, a calibration on held-out images, and what it all would cost on areas
//! that were not trained on.
//!
//! Folds are of whole images: all trials of one image, and all orientations of it, are in one fold. Classifiers that
//! see trials are trained on all of them, but what counts is the image: its score is that of its best trial, and the
//! calibration is on these (method 4.7.5).

use std::collections::BTreeMap;

use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;

use super::calibration::Calibration;
use super::classifier::{Classifier, Kind};
use super::costs::{Confusion, Costs, cheapest, cost_curve};
use super::domain::Domain;
use super::drift::Distribution;
use super::logistic::logistic;
use super::scaling::Scaling;
use super::svm::{Kernel, Machine, Settings, SvmError};

/// An image of a labelled set, as one kind of classifier sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    /// The image; several orientations of one image have it in common.
    pub image: String,
    /// The area that it is of.
    pub area: String,
    /// Whether its orientation is right.
    pub right: bool,
    /// What there is to see: trials or evidence, each with whether it is right. None without an orientation.
    pub samples: Vec<(Vec<f64>, bool)>,
}

/// How a classifier is trained.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// What is trained.
    pub kind: Kind,
    /// The names of its features.
    pub features: Vec<String>,
    /// What decisions cost, for the choice of hyperparameters.
    pub costs: Costs,
    /// Parts of the cross-validation.
    pub folds: usize,
    /// Support vector machines are trained on at most so many samples, stratified by label and image...
    pub most_samples: usize,
    /// ...and their hyperparameters chosen on at most so many.
    pub most_samples_of_grid: usize,
    /// Of the draws.
    pub seed: u64,
}

/// How long a support vector machine may take: with 20 000 samples of trials some minutes.
pub const MOST_SAMPLES: usize = 20_000;
/// Enough to tell good hyperparameters from bad ones.
pub const MOST_SAMPLES_OF_GRID: usize = 2_000;
/// Ten, as usual.
pub const FOLDS: usize = 10;
/// Trained once for every area, with less care.
const FOLDS_OF_TRANSFER: usize = 5;
const MOST_SAMPLES_OF_TRANSFER: usize = 5_000;
/// With fewer right or fewer wrong images than these, no probability of an image means anything.
const LEAST_OF_EACH: usize = 5;
/// C and gamma of the grid.
const PRICES: [f64; 3] = [1.0, 10.0, 100.0];
const GAMMAS: [f64; 4] = [0.05, 0.2, 0.8, 3.2];

impl Plan {
    /// As is usual, for a kind with these features.
    #[must_use]
    pub fn new(kind: Kind, features: &[&str], costs: Costs) -> Self {
        Self {
            kind,
            features: features.iter().map(|name| (*name).to_owned()).collect(),
            costs,
            folds: FOLDS,
            most_samples: MOST_SAMPLES,
            most_samples_of_grid: MOST_SAMPLES_OF_GRID,
            seed: 1,
        }
    }
}

/// The hyperparameters of a support vector machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hyperparameters {
    /// C.
    pub price: f64,
    /// gamma.
    pub gamma: f64,
}

/// A trained classifier with all that is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    /// The classifier.
    pub classifier: Classifier,
    /// What was chosen, of a support vector machine.
    pub hyperparameters: Option<Hyperparameters>,
    /// Samples there were.
    pub samples: usize,
    /// Samples that were trained on.
    pub samples_used: usize,
    /// Each image with an orientation: the score that a classifier gave it that was not trained on it.
    pub held_out: Vec<(f64, bool)>,
    /// Images without an orientation; none of them is right.
    pub without_orientation: usize,
    /// For each feature its distribution over the images.
    pub distributions: Vec<Option<Distribution>>,
}

/// What a classifier says of an area that it was not trained on.
#[derive(Debug, Clone, PartialEq)]
pub struct Transfer {
    /// The area.
    pub area: String,
    /// For each image the probability that it is given, 0 where nothing is known, and whether it is right.
    pub predicted: Vec<(f64, bool)>,
}

impl Transfer {
    /// The confusion if those are accepted whose probability is at least this.
    #[must_use]
    pub fn confusion(&self, least_probability: f64) -> Confusion {
        Confusion::of(self.predicted.iter().map(|(probability, right)| (*probability >= least_probability, *right)))
    }
}

/// Cautions that are tried.
const CAUTIONS: [f64; 8] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0];
/// What a caution may cost more than the cheapest one, where it is not the same areas that will be met.
const MARGIN: f64 = 1.01;

/// What an area deserves where there is no other to learn it from: what the simulated areas, trained on one and judged on
/// another, deserved.
const CAUTION_OF_ONE_AREA: f64 = 5.0;

/// The caution that an area deserves which was not trained on, and the mean expected cost there: the largest of those
/// that cost hardly more than the cheapest.
#[must_use]
pub fn caution(transfers: &[Transfer], costs: &Costs) -> (f64, Option<f64>) {
    let cost = |caution: f64| {
        let least = costs.least_probability_with(caution).unwrap_or(f64::INFINITY);
        let of_area = |transfer: &Transfer| transfer.confusion(least).expected_cost(costs);
        transfers.iter().map(of_area).sum::<f64>() / transfers.len() as f64
    };
    if transfers.is_empty() {
        return (CAUTION_OF_ONE_AREA, None);
    }
    let least = CAUTIONS.into_iter().map(cost).fold(f64::INFINITY, f64::min);
    let chosen = CAUTIONS.into_iter().rfind(|caution| cost(*caution) <= MARGIN * least).unwrap_or(1.0);
    (chosen, Some(cost(chosen)))
}

/// What a classifier says of the images of an area.
#[must_use]
pub fn transfer(classifier: &Classifier, area: &str, examples: &[&Example]) -> Transfer {
    let predicted = examples.iter().map(|example| {
        let samples: Vec<Vec<f64>> = example.samples.iter().map(|(features, _)| features.clone()).collect();
        let known = classifier.judge(&samples).filter(|judgement| judgement.outside.is_none());
        (known.map_or(0.0, |judgement| judgement.probability), example.right)
    });
    Transfer { area: area.to_owned(), predicted: predicted.collect() }
}

impl Trained {
    /// Scores of all images, those without an orientation as the lowest.
    #[must_use]
    pub fn scored(&self) -> Vec<(f64, bool)> {
        let without = std::iter::repeat_n((f64::NEG_INFINITY, false), self.without_orientation);
        self.held_out.iter().copied().chain(without).collect()
    }
}

/// Trains as planned. `progress` hears how much is done, and ends the training by answering no.
///
/// # Errors
/// [`SvmError`] if there is nothing to learn.
pub fn train(examples: &[Example], plan: &Plan, progress: &dyn Fn(f64) -> bool) -> Result<Trained, SvmError> {
    let all: Vec<&Example> = examples.iter().collect();
    let count = |wanted: bool| all.iter().filter(|e| !e.samples.is_empty() && e.right == wanted).count();
    let (right, wrong) = (count(true), count(false));
    if right.min(wrong) < LEAST_OF_EACH {
        return Err(SvmError::FewOfOne { right, wrong, least: LEAST_OF_EACH });
    }
    let hyperparameters = match plan.kind {
        Kind::Paper | Kind::EvidenceSvm => Some(chosen(&all, plan, progress)?),
        Kind::OneFeature | Kind::EvidenceLogistic => None,
    };
    let mut held_out = Vec::new();
    for fold in 0..plan.folds {
        let (inside, outside) = parted(&all, plan.folds, fold);
        let fitted = Fitted::of(&inside, plan, hyperparameters, plan.most_samples)?;
        held_out.extend(outside.iter().filter_map(|example| Some((fitted.score(example)?, example.right))));
        stopped(progress(0.5 + 0.45 * (fold + 1) as f64 / plan.folds as f64))?;
    }
    let fitted = Fitted::of(&all, plan, hyperparameters, plan.most_samples)?;
    let calibration =
        Calibration::of(&held_out).ok_or_else(|| untrainable("no image has a finite score".to_owned()))?;
    let classifier = Classifier {
        kind: plan.kind,
        features: plan.features.clone(),
        scaling: fitted.scaling,
        machine: fitted.machine,
        calibration,
        domain: fitted.domain,
        caution: 1.0,
    };
    Ok(Trained {
        distributions: distributions(&all, &classifier),
        classifier,
        hyperparameters,
        samples: all.iter().map(|example| example.samples.len()).sum(),
        samples_used: fitted.samples_used,
        without_orientation: all.iter().filter(|example| example.samples.is_empty()).count(),
        held_out,
    })
}

/// For each area what a classifier says of it that was trained on all others. Empty where there is only one; an area is
/// left out if the others alone teach nothing.
///
/// # Errors
/// [`SvmError::Stopped`] if `progress` said so.
pub fn transfers(examples: &[Example], plan: &Plan, progress: &dyn Fn(f64) -> bool) -> Result<Vec<Transfer>, SvmError> {
    let by_area = by_area(examples);
    if by_area.len() < 2 {
        return Ok(Vec::new());
    }
    let most_samples = plan.most_samples.min(MOST_SAMPLES_OF_TRANSFER);
    let plan = &Plan { folds: FOLDS_OF_TRANSFER, most_samples, ..plan.clone() };
    let count = by_area.len() as f64;
    let of_area = |(k, (area, inside)): (usize, (&&str, &Vec<&Example>))| {
        let others: Vec<Example> = examples.iter().filter(|example| example.area != **area).cloned().collect();
        match train(&others, plan, &|done| progress((k as f64 + done) / count)) {
            Ok(trained) => Some(Ok(transfer(&trained.classifier, area, inside))),
            Err(SvmError::Stopped) => Some(Err(SvmError::Stopped)),
            Err(_) => None,
        }
    };
    by_area.iter().enumerate().filter_map(of_area).collect()
}

/// The examples of each area.
#[must_use]
pub fn by_area(examples: &[Example]) -> BTreeMap<&str, Vec<&Example>> {
    let mut areas: BTreeMap<&str, Vec<&Example>> = BTreeMap::new();
    for example in examples {
        areas.entry(&example.area).or_default().push(example);
    }
    areas
}

/// The part of a classifier that is fitted to samples.
struct Fitted {
    scaling: Scaling,
    domain: Domain,
    machine: Machine,
    samples_used: usize,
}

impl Fitted {
    fn of(
        examples: &[&Example],
        plan: &Plan,
        hyperparameters: Option<Hyperparameters>,
        most_samples: usize,
    ) -> Result<Self, SvmError> {
        let samples: Vec<&(Vec<f64>, bool)> = examples.iter().flat_map(|example| &example.samples).collect();
        let features: Vec<&[f64]> = samples.iter().map(|(features, _)| features.as_slice()).collect();
        let too_few =
            || untrainable(format!("{} samples are too few for {} features", samples.len(), plan.features.len()));
        let scaling = Scaling::of(&features).ok_or_else(too_few)?;
        let domain = Domain::of(&features).ok_or_else(too_few)?;
        let prepared = |(features, right): &(Vec<f64>, bool)| (scaling.scaled(&domain.clamped(features)), *right);
        let (machine, samples_used) = match (plan.kind, hyperparameters) {
            (Kind::Paper | Kind::EvidenceSvm, Some(Hyperparameters { price, gamma })) => {
                let chosen: Vec<(Vec<f64>, bool)> =
                    stratified(examples, most_samples, plan.seed).into_iter().map(prepared).collect();
                let settings = Settings { kernel: Kernel::Rbf { gamma }, price, weight_of_wrong: 1.0 };
                (Machine::train(&chosen, &settings)?, chosen.len())
            }
            _ => {
                let all: Vec<(Vec<f64>, bool)> = samples.iter().map(|sample| prepared(sample)).collect();
                let weights = logistic(&all)?;
                (Machine::linear(&weights.weights, weights.bias)?, all.len())
            }
        };
        Ok(Self { scaling, domain, machine, samples_used })
    }

    /// The score of an image: that of its best sample.
    fn score(&self, example: &Example) -> Option<f64> {
        let decision = |(features, _): &(Vec<f64>, bool)| {
            self.machine.decision(&self.scaling.scaled(&self.domain.clamped(features)))
        };
        example.samples.iter().map(decision).max_by(f64::total_cmp)
    }
}

/// The hyperparameters with the least expected cost in a cross-validation on a part of the samples.
fn chosen(examples: &[&Example], plan: &Plan, progress: &dyn Fn(f64) -> bool) -> Result<Hyperparameters, SvmError> {
    let mut best: Option<(f64, Hyperparameters)> = None;
    let grid: Vec<Hyperparameters> =
        PRICES.iter().flat_map(|&price| GAMMAS.iter().map(move |&gamma| Hyperparameters { price, gamma })).collect();
    for (k, &hyperparameters) in grid.iter().enumerate() {
        let mut scored = Vec::new();
        for fold in 0..FOLDS_OF_GRID {
            let (inside, outside) = parted(examples, FOLDS_OF_GRID, fold);
            let fitted = Fitted::of(&inside, plan, Some(hyperparameters), plan.most_samples_of_grid)?;
            scored.extend(outside.iter().filter_map(|example| Some((fitted.score(example)?, example.right))));
        }
        let cost = cheapest(&cost_curve(&scored), &plan.costs)
            .map_or(f64::INFINITY, |point| point.confusion.expected_cost(&plan.costs));
        if best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, hyperparameters));
        }
        stopped(progress(0.5 * (k + 1) as f64 / grid.len() as f64))?;
    }
    best.map(|(_, hyperparameters)| hyperparameters).ok_or_else(|| untrainable("the grid is empty".to_owned()))
}

const FOLDS_OF_GRID: usize = 4;

fn stopped(go_on: bool) -> Result<(), SvmError> {
    if go_on { Ok(()) } else { Err(SvmError::Stopped) }
}

fn untrainable(detail: String) -> SvmError {
    SvmError::Untrainable { detail }
}

/// The examples outside and inside a fold: those that are trained on, and those that are held out.
fn parted<'e>(examples: &[&'e Example], folds: usize, fold: usize) -> (Vec<&'e Example>, Vec<&'e Example>) {
    examples.iter().partition(|example| hash(&example.image) % folds as u64 != fold as u64)
}

/// FNV-1a: the same on every machine.
fn hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// At most so many samples, stratified by label and image: of every image as many right and as many wrong ones as of any
/// other, as far as there are, and in all as many right as wrong ones in proportion to what there is.
fn stratified<'e>(examples: &[&'e Example], most: usize, seed: u64) -> Vec<&'e (Vec<f64>, bool)> {
    let total: usize = examples.iter().map(|example| example.samples.len()).sum();
    if total <= most {
        return examples.iter().flat_map(|example| &example.samples).collect();
    }
    let mut draws = ChaCha8Rng::seed_from_u64(seed);
    let mut chosen = Vec::with_capacity(most);
    for label in [true, false] {
        let mut of_label: Vec<Vec<&(Vec<f64>, bool)>> = examples
            .iter()
            .map(|example| example.samples.iter().filter(|(_, right)| *right == label).collect())
            .filter(|samples: &Vec<_>| !samples.is_empty())
            .collect();
        of_label.iter_mut().for_each(|samples| samples.shuffle(&mut draws));
        of_label.shuffle(&mut draws);
        let count: usize = of_label.iter().map(Vec::len).sum();
        // some of each label, however rare it is
        let wanted = ((most as f64 * count as f64 / total as f64).floor() as usize).max(1);
        // a round takes one sample of every image that has any left
        let rounds = of_label.iter().map(Vec::len).max().unwrap_or(0);
        let in_turn = (0..rounds).flat_map(|round| of_label.iter().filter_map(move |samples| samples.get(round)));
        chosen.extend(in_turn.copied().take(wanted));
    }
    chosen
}

/// For each feature its distribution over the samples that decide about the images.
fn distributions(examples: &[&Example], classifier: &Classifier) -> Vec<Option<Distribution>> {
    let deciding: Vec<&[f64]> = examples
        .iter()
        .filter_map(|example| {
            let samples = example.samples.iter().map(|(features, _)| features.as_slice());
            samples.map(|features| (classifier.decision(features), features)).max_by(|a, b| a.0.total_cmp(&b.0))
        })
        .map(|(_, features)| features)
        .collect();
    let of_feature = |k: usize| deciding.iter().map(|features| features[k]).collect::<Vec<f64>>();
    (0..classifier.features.len()).map(|k| Distribution::of(&of_feature(k))).collect()
}

#[cfg(test)]
mod tests;
