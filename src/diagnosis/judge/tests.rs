use super::*;
use crate::diagnosis::features::{OF_TRIAL_SIMPLIFIED, names_of_evidence};
use crate::diagnosis::thresholds::tests::sound;
use crate::estimation::simulated::Draws;
use crate::learning::training::{Example, Plan, train};

/// Evidence that is the better the larger a quality, which is normally distributed; right with odds of `exp(2 quality)`.
fn drawn(draws: &mut Draws) -> (Evidence, bool) {
    let quality = 1.0 + 2.0 * draws.normal();
    let mut about = |value: f64| value * (0.3 * draws.normal() - 0.4 * quality).exp();
    let risk = |chance: f64| chance.clamp(1e-6, 0.99);
    let mut evidence = sound();
    evidence.risk.by_chance = risk(about(0.01));
    evidence.risk.with_displacement = risk(about(0.05));
    evidence.risk.with_pair = risk(about(0.02));
    evidence.sigma_planimetric_m = about(0.1);
    evidence.sensitivity.undetected_by_one_m = about(0.3);
    evidence.sensitivity.undetected_by_two_m = about(0.5);
    evidence.sensitivity.change_by_one_m = about(0.1);
    evidence.sensitivity.change_by_two_m = about(0.2);
    evidence.moved_by_lines_m = about(0.1);
    evidence.sensitivity.mean_test = about(2.0);
    evidence.sensitivity.largest_test = about(6.0);
    evidence.sigma0 = about(1.2);
    evidence.log_odds = 60.0 / about(1.0);
    evidence.runner_up_log_odds = evidence.log_odds / 10.0;
    evidence.distance_from_approximation = about(6.0);
    evidence.control_points = 4 + draws.below(12);
    evidence.control_points_in_view = evidence.control_points + draws.below(8);
    evidence.hull_share = draws.even(0.1, 0.8);
    evidence.inlier_share = draws.even(0.6, 1.0);
    evidence.matched_share_in_view = draws.even(0.2, 0.8);
    evidence.features.eliminated = draws.below(5);
    (evidence, draws.even(0.0, 1.0) < 1.0 / (1.0 + (-2.0 * quality).exp()))
}

fn classifier() -> Classifier {
    let mut draws = Draws::new(61);
    let example = |k: usize| {
        let (evidence, right) = drawn(&mut draws);
        Example { image: k.to_string(), area: String::new(), right, samples: vec![(of_evidence(&evidence), right)] }
    };
    let examples: Vec<Example> = (0..3000).map(example).collect();
    let plan = Plan::new(Kind::EvidenceLogistic, &names_of_evidence(), Costs::default());
    train(&examples, &plan, &|_| true).unwrap().classifier
}

fn judged_by(classifier: &Classifier, evidence: &Evidence, policy: &Policy) -> Diagnosis {
    judge(&Case { evidence, trials: &[], witnesses: &[] }, classifier, policy)
}

fn codes(diagnosis: &Diagnosis) -> Vec<&'static str> {
    diagnosis.reasons.iter().map(|reason| reason.code).collect()
}

#[test]
fn lights_follow_the_probability() {
    let classifier = classifier();
    let mut draws = Draws::new(62);
    let mut seen = [0; 3];
    for _ in 0..2000 {
        let (evidence, _) = drawn(&mut draws);
        let found = judged_by(&classifier, &evidence, &Policy::default());
        // 40 for a wrong acceptance against 5 and 10: 6 to 1
        let light = match found.verdict {
            Verdict::Green => {
                assert!(found.probability_correct >= 6.0 / 7.0 && found.score > found.threshold);
                0
            }
            Verdict::Yellow => {
                assert!(found.probability_correct >= 0.5);
                1
            }
            Verdict::Red => {
                assert!(found.probability_correct < 0.5);
                2
            }
        };
        seen[light] += 1;
        assert!(!found.reasons.is_empty(), "no verdict without a reason");
    }
    assert!(seen.iter().all(|count| *count > 50), "{seen:?}");
}

#[test]
fn what_is_accepted_is_as_often_wrong_as_the_costs_allow() {
    let classifier = classifier();
    let mut draws = Draws::new(63);
    let images: Vec<(Evidence, bool)> = (0..4000).map(|_| drawn(&mut draws)).collect();
    let cost = |threshold: Option<f64>| {
        let policy = Policy { threshold, ..Policy::default() };
        let accepted =
            images.iter().map(|(e, right)| (judged_by(&classifier, e, &policy).verdict == Verdict::Green, *right));
        crate::learning::Confusion::of(accepted).expected_cost(&Costs::default())
    };
    let by_costs = cost(None);
    let own = threshold(&classifier, &Policy::default());
    for other in [-2.0, -1.0, 1.0, 2.0] {
        assert!(by_costs < cost(Some(own + other)) + 0.1, "{other}: {by_costs}, {}", cost(Some(own + other)));
    }
}

#[test]
fn costs_caution_and_threshold_are_obeyed() {
    let classifier = classifier();
    let default = threshold(&classifier, &Policy::default());
    let of = |policy: Policy| threshold(&classifier, &policy);
    let dear = Costs { cw: 400.0, ..Costs::default() };
    assert!(of(Policy { costs: dear, ..Policy::default() }) > default);
    assert!(of(Policy { caution: Some(8.0), ..Policy::default() }) > default);
    assert_eq!(of(Policy { threshold: Some(0.25), ..Policy::default() }), 0.25);
    let never = Policy { costs: Costs { cw: 1e9, ..Costs::default() }, ..Policy::default() };
    assert_eq!(of(never), f64::INFINITY);
    let found = judged_by(&classifier, &sound(), &never);
    assert_ne!(found.verdict, Verdict::Green);
    assert!(codes(&found).contains(&"score_too_low"));
}

#[test]
fn what_the_classifier_has_not_seen_is_never_green() {
    let classifier = classifier();
    let mut draws = Draws::new(66);
    let green = |evidence: &Evidence| {
        let found = judged_by(&classifier, evidence, &Policy::default());
        found.verdict == Verdict::Green && codes(&found) == ["verified"]
    };
    let alike = std::iter::repeat_with(|| drawn(&mut draws).0).find(green).unwrap();
    // one number is worse than in all of them
    let strange = Evidence { control_points_in_view: 400, ..alike };
    let found = judged_by(&classifier, &strange, &Policy { threshold: Some(-90.0), ..Policy::default() });
    assert_ne!(found.verdict, Verdict::Green);
    assert_eq!(codes(&found)[0], "outside_experience");
}

#[test]
fn where_another_orientation_is_half_as_well_founded_nothing_is_green() {
    let lenient = Policy { threshold: Some(-1e9), ..Policy::default() };
    let classifier = classifier();
    let mut draws = Draws::new(67);
    let green = |e: &Evidence| judged_by(&classifier, e, &lenient).verdict == Verdict::Green;
    let alike = std::iter::repeat_with(|| drawn(&mut draws).0).find(green).unwrap();
    let rivalled = Evidence { runner_up_log_odds: 0.52 * alike.log_odds, ..alike };
    let found = judged_by(&classifier, &rivalled, &lenient);
    assert_ne!(found.verdict, Verdict::Green);
    assert!(codes(&found).contains(&"ambiguous"));
}

#[test]
fn where_a_quarter_contradicts_nothing_is_green() {
    let lenient = Policy { threshold: Some(-1e9), ..Policy::default() };
    let classifier = classifier();
    let mut draws = Draws::new(68);
    let green = |e: &Evidence| judged_by(&classifier, e, &lenient).verdict == Verdict::Green;
    let mut evidence =
        std::iter::repeat_with(|| drawn(&mut draws).0).find(|e| e.control_points == 9 && green(e)).unwrap();
    for (contradicting, accepted) in [(1, true), (2, true), (3, false), (9, false)] {
        evidence.sensitivity.contradicting = contradicting;
        assert_eq!(green(&evidence), accepted, "{contradicting} of 9");
    }
}

#[test]
fn three_control_points_are_never_green() {
    let lenient = Policy { threshold: Some(-1e9), ..Policy::default() };
    for control_points in 0..4 {
        let few = Evidence { control_points, control_points_in_view: control_points, ..sound() };
        assert_ne!(judged_by(&classifier(), &few, &lenient).verdict, Verdict::Green);
    }
}

#[test]
fn ten_thousand_broken_pieces_of_evidence_are_never_green() {
    let classifier = classifier();
    let mut draws = Draws::new(64);
    let lenient = Policy { threshold: Some(-1e9), ..Policy::default() };
    for _ in 0..10_000 {
        let (sane, _) = drawn(&mut draws);
        let mut broken = sane;
        let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][draws.below(3)];
        let fields: [&mut f64; 14] = [
            &mut broken.sigma0,
            &mut broken.inlier_share,
            &mut broken.matched_share_in_view,
            &mut broken.hull_share,
            &mut broken.sigma_planimetric_m,
            &mut broken.tolerance_m,
            &mut broken.moved_by_lines_m,
            &mut broken.sensitivity.change_by_one_m,
            &mut broken.sensitivity.undetected_by_one_m,
            &mut broken.sensitivity.mean_test,
            &mut broken.risk.by_chance,
            &mut broken.risk.with_displacement,
            &mut broken.risk.with_pair,
            &mut broken.distance_from_approximation,
        ];
        let count = fields.len();
        let at = draws.below(count);
        *fields.into_iter().nth(at).unwrap() = if at == 5 || bad.is_nan() { f64::NAN } else { bad };
        let found = judged_by(&classifier, &broken, &lenient);
        let harmless = bad.is_infinite() && of_evidence(&broken).iter().all(|value| value.is_finite());
        assert!(harmless || found.verdict != Verdict::Green, "{at}: {bad}");
        assert!(found.score.is_finite() && (0.0..=1.0).contains(&found.probability_correct));
    }
}

#[test]
fn control_points_that_carry_or_contradict_are_named() {
    let witness = |name: &str, contradicts: bool, theoretical_m: f64| Witness {
        name: name.to_owned(),
        used: true,
        weight: Some(WitnessWeight { contradicts, change_m: 0.3, theoretical_m }),
    };
    let mut witnesses = vec![witness("sound", false, 0.1), witness("alone", false, 7.0), witness("moved", true, 0.1)];
    witnesses.push(Witness { name: "unused".to_owned(), used: false, weight: None });
    let never = Policy { threshold: Some(1e9), ..Policy::default() };
    let case = Case { evidence: &sound(), trials: &[], witnesses: &witnesses };
    let found = judge(&case, &classifier(), &never);
    assert_eq!(
        (found.probably_right.clone(), found.probably_wrong.clone()),
        (names(&["sound", "alone"]), names(&["moved"]))
    );
    let detail = |code: &str| found.reasons.iter().find(|reason| reason.code == code).unwrap().detail.clone();
    assert!(
        detail("control_points_decisive").contains("rests on alone alone"),
        "{}",
        detail("control_points_decisive")
    );
    witnesses.push(Witness { name: "unchecked".to_owned(), used: true, weight: None });
    let case = Case { evidence: &sound(), trials: &[], witnesses: &witnesses };
    for threshold in [1e9, -1e9] {
        let found = judge(&case, &classifier(), &Policy { threshold: Some(threshold), ..Policy::default() });
        let reason = found.reasons.iter().find(|reason| reason.code == "control_points_decisive").unwrap();
        assert!(reason.detail.contains("rests on unchecked, alone alone"), "{}", reason.detail);
        assert!(reason.detail.contains("by any distance"), "{}", reason.detail);
        assert_eq!(found.probably_right, names(&["sound", "alone"]));
    }
    assert!(detail("control_points_contradict").starts_with("moved is not where"));
    assert!(detail("control_points_contradict").contains("0.30 m"));
    let many: Vec<Witness> = (0..9).map(|k| witness(&format!("m{k}"), true, 0.1)).collect();
    let case = Case { evidence: &sound(), trials: &[], witnesses: &many };
    let reasons = judge(&case, &classifier(), &never).reasons;
    let contradict = reasons.iter().find(|reason| reason.code == "control_points_contradict").unwrap();
    assert!(contradict.detail.starts_with("m0, m1, m2, m3, m4 and 4 more are not where"), "{}", contradict.detail);
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

#[test]
fn a_classifier_of_trials_looks_at_the_best_of_them() {
    let mut draws = Draws::new(65);
    let orientation = crate::estimation::simulated::flight();
    let trial = |log_sigma0: f64| Trial {
        features: crate::diagnosis::Features { control_points: 8, eliminated: 1, log_sigma0, log_configuration: 1.0 },
        orientation,
    };
    let example = |k: usize| {
        let log_sigma0 = draws.normal();
        let right = log_sigma0 + 0.3 * draws.normal() < 0.0;
        let samples = vec![(of_trial_simplified(&trial(log_sigma0).features), right)];
        Example { image: k.to_string(), area: String::new(), right, samples }
    };
    let examples: Vec<Example> = (0..500).map(example).collect();
    let plan = Plan::new(Kind::OneFeature, &OF_TRIAL_SIMPLIFIED, Costs::default());
    let classifier = train(&examples, &plan, &|_| true).unwrap().classifier;
    let verdict = |trials: &[Trial]| {
        judge(&Case { evidence: &sound(), trials, witnesses: &[] }, &classifier, &Policy::default()).verdict
    };
    assert_eq!(verdict(&[trial(1.0), trial(-1.5), trial(0.7)]), Verdict::Green);
    assert_eq!(verdict(&[trial(1.0), trial(0.7)]), Verdict::Red);
    assert_eq!(verdict(&[]), Verdict::Red);
}
