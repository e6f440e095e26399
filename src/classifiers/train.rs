//! From labelled images to a classifier with its description.

use std::collections::BTreeMap;

use super::evaluation::Scored;
use super::provenance::{AreaNotTrainedOn, Comparison, LabelledSet, NotTrained};
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
/// expected cost. `progress` hears how much is done, and ends the training by answering no. A kind that the images teach
/// nothing, as trials do where none were kept, is left out as long as another one learns.
///
/// # Errors
/// [`ClassifierError`] if there is nothing to learn.
pub fn trained(training: &Training, progress: &dyn Fn(f64) -> bool) -> Result<Texts, ClassifierError> {
    let mut all: Vec<(Trained, Comparison, Plan)> = Vec::new();
    let mut failed = Vec::new();
    let count = training.kinds.len() as f64;
    for (k, kind) in training.kinds.iter().enumerate() {
        let of_kind = of_kind(training, *kind, &|done| progress((k as f64 + done) / count));
        match of_kind {
            Ok(trained) => all.push(trained),
            Err(source @ SvmError::Stopped) => return Err(ClassifierError::Training { kind: kind.name(), source }),
            Err(source) => failed.push((kind.name(), source)),
        }
    }
    let not_trained =
        failed.iter().map(|(kind, error)| NotTrained { kind: (*kind).to_owned(), reason: error.to_string() });
    let not_trained = not_trained.collect();
    let compared: Vec<Comparison> = all.iter().map(|(_, comparison, _)| comparison.clone()).collect();
    let best = all.into_iter().min_by(|a, b| a.1.deciding_cost().total_cmp(&b.1.deciding_cost()));
    let Some((trained, _, plan)) = best else {
        let last = failed.pop().map(|(kind, source)| ClassifierError::Training { kind, source });
        return Err(last.unwrap_or(ClassifierError::NoKind));
    };
    let description = description(training, &trained, &plan, compared, not_trained);
    let texts = Texts::of(&trained.classifier, &description)?;
    // what cannot be read again must not be kept
    texts.load()?;
    Ok(texts)
}

fn of_kind(
    training: &Training,
    kind: Kind,
    progress: &dyn Fn(f64) -> bool,
) -> Result<(Trained, Comparison, Plan), SvmError> {
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

fn description(
    training: &Training,
    trained: &Trained,
    plan: &Plan,
    compared: Vec<Comparison>,
    not_trained: Vec<NotTrained>,
) -> Description {
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
        calibration: classifier.calibration.steps().iter().map(|s| (s.score, s.probability, s.images)).collect(),
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
            not_trained,
        },
    }
}

/// The evidence of a labelled image, if it is complete.
pub(super) fn evidence(image: &LabelledImage) -> Option<Evidence> {
    let numbers = image.evidence.as_ref()?;
    evidence_of(numbers).ok()
}

#[cfg(test)]
pub(crate) mod tests {
    use std::cell::RefCell;

    use super::*;
    use crate::classifiers::labelled::tests::simulated;
    use crate::classifiers::{Loaded, scored};
    use crate::diagnosis::Policy;
    use crate::diagnosis::judge::threshold;
    use crate::learning::Confusion;

    /// The texts of a classifier of some simulated images of two areas.
    pub(crate) fn quickly_trained(kind: Kind) -> Texts {
        of_areas(&two_areas(), &TrainingSet::default(), &[kind]).unwrap()
    }

    fn two_areas() -> TrainingSet {
        let images = [simulated("north", 1, 100), simulated("south", 2, 80)].concat();
        let set = |name: &str, images: usize| LabelledSet { name: name.to_owned(), images, sha256: "ab".to_owned() };
        TrainingSet { sets: vec![set("north", 100), set("south", 80)], images }
    }

    fn of_areas(set: &TrainingSet, not_trained_on: &TrainingSet, kinds: &[Kind]) -> Result<Texts, ClassifierError> {
        trained(&Training { set, not_trained_on, kinds, costs: Costs::default() }, &|_| true)
    }

    fn accepted(loaded: &Loaded, images: &[LabelledImage]) -> Confusion {
        let decides = threshold(&loaded.classifier, &Policy { caution: Some(1.0), ..Policy::default() });
        let judged = images.iter().map(|image| scored(&loaded.classifier, image));
        Confusion::of(judged.map(|s| (s.score > decides, s.right)))
    }

    #[test]
    fn the_same_images_make_the_same_texts() {
        assert_eq!(quickly_trained(Kind::Paper), quickly_trained(Kind::Paper));
        assert_ne!(quickly_trained(Kind::Paper), quickly_trained(Kind::OneFeature));
    }

    #[test]
    fn what_was_learned_is_worth_its_price_on_other_images() {
        for kind in Kind::ALL {
            let loaded = quickly_trained(kind).load().unwrap();
            let confusion = accepted(&loaded, &simulated("north", 3, 400));
            let costs = Costs::default();
            let right = (confusion.cc + confusion.wc) as f64 / 400.0;
            let cost = confusion.expected_cost(&costs);
            assert!(cost < costs.of_rejecting(right) - 0.2, "{}: {confusion:?}", kind.name());
        }
    }

    #[test]
    fn the_kind_that_costs_least_elsewhere_is_kept_with_the_figures_of_all() {
        let further = TrainingSet { sets: vec![], images: simulated("west", 4, 60) };
        let loaded = of_areas(&two_areas(), &further, &[Kind::OneFeature, Kind::EvidenceLogistic]).unwrap().load();
        let description = loaded.unwrap().description;
        let compared = &description.provenance.compared;
        let kinds: Vec<&str> = compared.iter().map(|comparison| comparison.kind.as_str()).collect();
        assert_eq!(kinds, ["one_feature", "evidence_logistic"]);
        let best = compared.iter().min_by(|a, b| a.deciding_cost().total_cmp(&b.deciding_cost())).unwrap();
        assert_eq!((&best.kind, best.caution), (&description.kind, description.caution));
        for comparison in compared {
            let areas: Vec<(&str, usize)> = comparison
                .areas_not_trained_on
                .iter()
                .map(|area| (area.area.as_str(), area.confusion.iter().sum()))
                .collect();
            assert_eq!(areas, [("north", 100), ("south", 80), ("west", 60)]);
            let costs: Vec<f64> = comparison.areas_not_trained_on.iter().map(|area| area.cost).collect();
            assert!((comparison.deciding_cost() - costs.iter().sum::<f64>() / 3.0).abs() < 1e-12);
        }
        let alone = TrainingSet { sets: vec![], images: simulated("north", 1, 100) };
        let alone = of_areas(&alone, &TrainingSet::default(), &[Kind::OneFeature]).unwrap().load().unwrap().description;
        let comparison = &alone.provenance.compared[0];
        assert_eq!((comparison.areas_not_trained_on.len(), alone.caution), (0, caution(&[], &Costs::default()).0));
        assert_eq!(comparison.deciding_cost(), comparison.cost_cross_validated);
    }

    #[test]
    fn the_provenance_counts_what_was_there() {
        let set = two_areas();
        let further = TrainingSet {
            sets: vec![LabelledSet { name: "west".to_owned(), images: 60, sha256: "cd".to_owned() }],
            images: simulated("west", 4, 60),
        };
        let loaded = of_areas(&set, &further, &[Kind::Paper]).unwrap().load().unwrap();
        let provenance = &loaded.description.provenance;
        assert_eq!((&provenance.sets, &provenance.sets_not_trained_on), (&set.sets, &further.sets));
        assert_eq!(provenance.areas, [("north".to_owned(), 100), ("south".to_owned(), 80)].into());
        // every tenth image has no orientation, all others have three trials
        assert_eq!((provenance.samples, provenance.samples_used), (3 * 162, 3 * 162));
        assert_eq!(provenance.costs, [0.0, 40.0, 5.0, 10.0]);
        assert!(provenance.support_vectors > 1 && provenance.c.is_some() && provenance.gamma.is_some());
        let evaluation = &loaded.description.evaluation;
        assert_eq!(evaluation.images, 180);
        assert_eq!(evaluation.right, set.images.iter().filter(|image| image.right()).count());
    }

    #[test]
    fn evidence_that_is_not_complete_is_no_sample() {
        let mut set = two_areas();
        for image in set.images.iter_mut().filter(|image| image.area == "north").take(20) {
            if let Some(numbers) = &mut image.evidence {
                numbers.remove("log_odds");
            }
        }
        let loaded = of_areas(&set, &TrainingSet::default(), &[Kind::EvidenceLogistic]).unwrap().load().unwrap();
        // two of the twenty had none before
        assert_eq!(loaded.description.provenance.samples, 162 - 18);
        let incomplete = set.images.iter().find(|image| image.area == "north").unwrap();
        assert_eq!(scored(&loaded.classifier, incomplete).score, f64::NEG_INFINITY);
    }

    #[test]
    fn a_training_tells_how_far_it_is_and_ends_when_told_to() {
        let (set, nothing) = (two_areas(), TrainingSet::default());
        let kinds = [Kind::OneFeature, Kind::Paper];
        let training = Training { set: &set, not_trained_on: &nothing, kinds: &kinds, costs: Costs::default() };
        let heard = RefCell::new(Vec::new());
        let hear = |most: f64| {
            heard.borrow_mut().clear();
            trained(&training, &|done| {
                heard.borrow_mut().push(done);
                done < most
            })
        };
        assert!(hear(2.0).is_ok());
        let all = heard.borrow().clone();
        assert!(all.is_sorted() && all[0] > 0.0 && all[all.len() - 1] <= 1.0 && all.iter().any(|done| *done > 0.9));
        let ended = hear(0.6).unwrap_err();
        assert!(matches!(ended, ClassifierError::Training { source: SvmError::Stopped, .. }), "{ended}");
        assert!(heard.borrow().iter().filter(|done| **done >= 0.6).count() == 1);
    }

    #[test]
    fn where_nothing_can_be_learned_the_kind_is_named() {
        let nothing = TrainingSet::default();
        let mut right = two_areas();
        right.images.retain(LabelledImage::right);
        let mut without_trials = two_areas();
        without_trials.images.iter_mut().for_each(|image| image.trials.clear());
        for (set, kind, said) in [
            (&right, Kind::EvidenceSvm, "0 are wrong"),
            (&right, Kind::EvidenceLogistic, "0 are wrong"),
            (&nothing, Kind::EvidenceLogistic, "at least 5 of each"),
            (&without_trials, Kind::Paper, "0 images with an orientation are right"),
        ] {
            let error = of_areas(set, &nothing, &[kind]).unwrap_err().to_string();
            assert!(error.contains(kind.name()) && error.contains(said), "{error}");
        }
        assert!(matches!(of_areas(&two_areas(), &nothing, &[]), Err(ClassifierError::NoKind)));
    }

    #[test]
    fn kinds_and_areas_that_teach_nothing_hinder_no_other() {
        let nothing = TrainingSet::default();
        let mut set = two_areas();
        set.images.iter_mut().for_each(|image| image.trials.clear());
        // without the south only right ones are left
        set.images.retain(|image| image.area == "south" || image.right());
        let description =
            of_areas(&set, &nothing, &[Kind::Paper, Kind::EvidenceLogistic]).unwrap().load().unwrap().description;
        let [only] = description.provenance.compared.as_slice() else { panic!("{description:?}") };
        let areas: Vec<&str> = only.areas_not_trained_on.iter().map(|area| area.area.as_str()).collect();
        assert_eq!((only.kind.as_str(), areas), ("evidence_logistic", vec!["north"]));
        let [missing] = description.provenance.not_trained.as_slice() else { panic!("{description:?}") };
        assert!(missing.kind == "paper" && missing.reason.contains("0 images with"), "{missing:?}");
    }
}
