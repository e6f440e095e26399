use super::*;
use crate::estimation::simulated::Draws;

/// Images whose one sample is the more often right the larger its first feature; the second one says nothing.
fn examples(seed: u64, area: &str, count: usize) -> Vec<Example> {
    let mut draws = Draws::new(seed);
    (0..count)
        .map(|k| {
            let features = vec![draws.even(-4.0, 4.0), draws.normal()];
            let right = draws.even(0.0, 1.0) < 1.0 / (1.0 + (-features[0]).exp());
            Example { image: format!("{area}-{k}"), area: area.to_owned(), right, samples: vec![(features, right)] }
        })
        .collect()
}

fn plan(kind: Kind) -> Plan {
    Plan { folds: 5, most_samples_of_grid: 200, ..Plan::new(kind, &["a", "b"], Costs::default()) }
}

fn go_on(_: f64) -> bool {
    true
}

/// The share of pairs of a right and a wrong image in which the right one has the higher score.
fn separation(scored: &[(f64, bool)]) -> f64 {
    let of = |label: bool| scored.iter().filter(move |(_, right)| *right == label).map(|(score, _)| *score);
    let pairs = of(true).flat_map(|right| of(false).map(move |wrong| f64::from(right > wrong)));
    let pairs: Vec<f64> = pairs.collect();
    pairs.iter().sum::<f64>() / pairs.len() as f64
}

#[test]
fn probabilities_are_those_that_the_images_were_drawn_with() {
    let trained = train(&examples(1, "here", 6000), &plan(Kind::EvidenceLogistic), &go_on).unwrap();
    for a in [-3.0_f64, -1.0, 0.0, 1.0, 3.0] {
        let found = trained.classifier.judge(&[vec![a, 0.0]]).unwrap().probability;
        let drawn = 1.0 / (1.0 + (-a).exp());
        assert!((found - drawn).abs() < 0.06, "{found} instead of {drawn}");
    }
    assert_eq!((trained.samples, trained.samples_used, trained.held_out.len()), (6000, 6000, 6000));
}

#[test]
fn every_kind_learns_and_says_so_on_images_that_were_held_out() {
    // the best that can be: the pairs told rightly by the feature itself
    let set = examples(2, "here", 600);
    let by_feature: Vec<(f64, bool)> = set.iter().map(|e| (e.samples[0].0[0], e.right)).collect();
    for kind in Kind::ALL {
        let trained = train(&set, &plan(kind), &go_on).unwrap();
        let found = separation(&trained.held_out);
        assert!(found > separation(&by_feature) - 0.04, "{kind:?}: {found}");
        assert_eq!(trained.hyperparameters.is_some(), matches!(kind, Kind::Paper | Kind::EvidenceSvm));
    }
}

#[test]
fn nothing_is_learned_from_noise() {
    let mut draws = Draws::new(3);
    let noise: Vec<Example> = (0..400)
        .map(|k| {
            let (features, right) = (vec![draws.normal(), draws.normal()], draws.even(0.0, 1.0) < 0.5);
            // several orientations of one image are alike: a fold that parted them would seem to know
            let samples = (0..3).map(|_| (features.iter().map(|f| f + 1e-3 * draws.normal()).collect(), right));
            Example { image: format!("{k}"), area: "a".to_owned(), right, samples: samples.collect() }
        })
        .collect();
    let trained = train(&noise, &plan(Kind::EvidenceSvm), &go_on).unwrap();
    assert!((separation(&trained.held_out) - 0.5).abs() < 0.1, "{}", separation(&trained.held_out));
}

#[test]
fn the_same_set_gives_the_same_classifier() {
    let set = examples(4, "here", 300);
    for kind in Kind::ALL {
        let plan = Plan { most_samples: 100, ..plan(kind) };
        assert_eq!(train(&set, &plan, &go_on).unwrap(), train(&set, &plan, &go_on).unwrap());
    }
}

#[test]
fn a_part_of_the_samples_is_stratified_by_label_and_image() {
    let image = |k: usize, right: usize, wrong: usize| {
        let samples = (0..right + wrong).map(|s| (vec![k as f64, s as f64], s < right)).collect();
        Example { image: format!("{k}"), area: "a".to_owned(), right: right > 0, samples }
    };
    // two images with many trials, and forty with few
    let mut set = vec![image(0, 60, 40), image(1, 0, 60)];
    set.extend((2..42).map(|k| image(k, 1, 3)));
    let all: Vec<&Example> = set.iter().collect();
    let chosen = stratified(&all, 100, 7);
    // 100 of 320 are right, 220 wrong: 31.25 and 68.75 of 100
    assert_eq!(chosen.len(), 31 + 68);
    assert_eq!(chosen.iter().filter(|(_, right)| *right).count(), 31);
    let of_image = |k: usize, label: bool| {
        chosen.iter().filter(|(features, right)| features[0] == k as f64 && *right == label).count()
    };
    assert!(of_image(0, true) <= 2 && of_image(1, false) <= 2);
    assert!((2..42).all(|k| of_image(k, false) >= 1));
    assert_eq!(stratified(&all, 320, 7).len(), 320);
}

#[test]
fn a_transfer_is_of_areas_that_were_not_trained_on() {
    // in the second area the feature means the opposite: whoever had trained on it would know
    let mut set = examples(5, "here", 500);
    let mut turned = examples(6, "there", 500);
    turned.iter_mut().for_each(|example| example.samples[0].0[0] *= -1.0);
    set.extend(turned);
    let transfers = transfers(&set, &plan(Kind::EvidenceLogistic), &go_on).unwrap();
    assert_eq!(transfers.iter().map(|t| t.area.as_str()).collect::<Vec<_>>(), ["here", "there"]);
    assert!(transfers.iter().all(|transfer| separation(&transfer.predicted) < 0.3));
    assert!(super::transfers(&examples(5, "here", 500), &plan(Kind::EvidenceLogistic), &go_on).unwrap().is_empty());
}

#[test]
fn caution_is_what_an_unknown_area_deserves() {
    let costs = Costs::default();
    let mut draws = Draws::new(8);
    // where the odds of being wrong are so many times those that were predicted
    let mut area = |times: f64| {
        let predicted = (0..40_000).map(|_| {
            let odds = draws.even(0.5, 4.0).exp();
            let probability = odds / (1.0 + odds);
            (probability, draws.even(0.0, 1.0) < odds / times / (1.0 + odds / times))
        });
        Transfer { area: "there".to_owned(), predicted: predicted.collect() }
    };
    let honest = caution(&[area(1.0)], &costs).0;
    let worse = caution(&[area(6.0)], &costs).0;
    assert!((1.0..=3.0).contains(&honest), "{honest}");
    assert!((4.0..=12.0).contains(&worse), "{worse}");
    assert_eq!(caution(&[], &costs), (CAUTION_OF_ONE_AREA, None));
}

#[test]
fn a_training_can_be_ended_and_says_what_is_missing() {
    let set = examples(9, "here", 200);
    assert_eq!(train(&set, &plan(Kind::EvidenceLogistic), &|_| false), Err(SvmError::Stopped));
    let right: Vec<Example> = set.iter().filter(|e| e.right).cloned().collect();
    let few = |right: usize, wrong: usize| SvmError::FewOfOne { right, wrong, least: LEAST_OF_EACH };
    for kind in Kind::ALL {
        assert_eq!(train(&right, &plan(kind), &go_on), Err(few(right.len(), 0)));
    }
    // wrong trials are no wrong images
    let mut with_wrong_trials = right.clone();
    with_wrong_trials.iter_mut().for_each(|e| e.samples.push((e.samples[0].0.clone(), false)));
    assert_eq!(train(&with_wrong_trials, &plan(Kind::OneFeature), &go_on), Err(few(right.len(), 0)));
    assert!(train(&[], &plan(Kind::Paper), &go_on).is_err());
}

#[test]
fn progress_rises_to_the_end() {
    let done = std::cell::RefCell::new(vec![0.0]);
    let watched = |fraction: f64| {
        done.borrow_mut().push(fraction);
        true
    };
    train(&examples(10, "here", 200), &plan(Kind::EvidenceSvm), &watched).unwrap();
    let done = done.into_inner();
    assert!(done.windows(2).all(|two| two[0] < two[1]) && done.len() > 10);
    assert!((0.9..=1.0).contains(done.last().unwrap()));
}
