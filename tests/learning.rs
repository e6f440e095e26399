//! What is learned on the command line: `gable train`, `gable evaluate`, `gable classifier`.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test fails by panic")]

#[path = "shared/labelled.rs"]
mod labelled;

use std::path::Path;
use std::process::{Command, Output};

use gable::classifiers::{LabelledImage, Loaded, Texts, evidence_of, samples_of, texts::FILES};
use gable::diagnosis::judge::is_checked;
use labelled::image;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use tempfile::TempDir;

/// Runs the program in a folder: status, output and errors.
fn gable(folder: &TempDir, arguments: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gable"));
    command.current_dir(folder.path()).args(arguments).env("GABLE_DATA", folder.path().join("data"));
    let Output { status, stdout, stderr } = command.output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code(), text(stdout), text(stderr))
}

#[track_caller]
fn printed(folder: &TempDir, arguments: &[&str]) -> String {
    let (status, printed, errors) = gable(folder, arguments);
    assert_eq!(status, Some(0), "{arguments:?}: {errors}");
    printed
}

/// Expects a failure, and gives what is told of it.
#[track_caller]
fn refused(folder: &TempDir, arguments: &[&str], status: i32) -> String {
    let (found, printed, errors) = gable(folder, arguments);
    assert_eq!(found, Some(status), "{arguments:?}: {printed}{errors}");
    errors
}

/// Writes a labelled set, and gives its images.
fn write_set(path: &Path, area: &str, seed: u64, count: usize) -> Vec<LabelledImage> {
    let mut draws = ChaCha8Rng::seed_from_u64(seed);
    let lines: Vec<Value> = (0..count).map(|k| image(area, k, &mut draws)).collect();
    std::fs::write(path, lines.iter().map(|line| format!("{line}\n")).collect::<String>()).unwrap();
    lines.into_iter().map(|line| serde_json::from_value(line).unwrap()).collect()
}

/// A folder with the sets `north.jsonl` and `south.jsonl`.
fn two_sets() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_set(&folder.path().join("north.jsonl"), "north", 1, 160);
    write_set(&folder.path().join("south.jsonl"), "south", 2, 120);
    folder
}

fn texts(folder: &Path) -> Texts {
    let [model, scaling, description] = FILES.map(|name| std::fs::read_to_string(folder.join(name)).unwrap());
    Texts { model, scaling, description }
}

/// Trains a classifier in a short time.
fn quickly(folder: &TempDir, sets: &[&str], out: &str) -> Loaded {
    printed(folder, &[&["train"], sets, &["--kind", "evidence_logistic", "--out", out]].concat());
    texts(&folder.path().join(out)).load().unwrap()
}

/// The four counts and the cost in a row of a table.
#[track_caller]
fn row(table: &str, name: &str) -> ([usize; 4], f64) {
    let begin = format!("| {name} | ");
    let line = table.lines().find_map(|line| line.strip_prefix(&begin)).unwrap_or_else(|| panic!("{name}: {table}"));
    let numbers: Vec<f64> =
        line.split(" | ").map(|cell| cell.split(' ').next().unwrap().parse::<f64>().unwrap()).collect();
    let counts: Vec<usize> = numbers[..4].iter().map(|number| *number as usize).collect();
    (counts.try_into().unwrap(), numbers[4])
}

/// The cost of an image at 0, 40, 5 and 10, to three digits.
fn is_cost(cost: f64, [_, cw, wc, ww]: [usize; 4], images: usize) -> bool {
    (cost - (40 * cw + 5 * wc + 10 * ww) as f64 / images as f64).abs() < 6e-4
}

#[test]
fn the_same_command_makes_the_same_files() {
    let folder = two_sets();
    let train = |out: &str| printed(&folder, &["train", "north.jsonl", "south.jsonl", "--out", out]);
    let summary = train("first");
    train("second");
    for name in FILES {
        let [first, second] = ["first", "second"].map(|out| std::fs::read(folder.path().join(out).join(name)).unwrap());
        assert!(!first.is_empty() && first == second, "{name}");
    }
    let loaded = texts(&folder.path().join("first")).load().unwrap();
    let provenance = &loaded.description.provenance;
    let digest = |name: &str| {
        let digest = Sha256::digest(std::fs::read(folder.path().join(name)).unwrap());
        digest.iter().map(|byte| format!("{byte:02x}")).collect::<String>()
    };
    let sets: Vec<(&str, usize, &str)> =
        provenance.sets.iter().map(|set| (set.name.as_str(), set.images, set.sha256.as_str())).collect();
    assert_eq!(sets, [("north", 160, digest("north.jsonl").as_str()), ("south", 120, digest("south.jsonl").as_str())]);
    assert!(summary.contains(&loaded.hash()) && summary.contains("Kept in first"), "{summary}");
    for kind in ["paper", "one_feature", "evidence_svm", "evidence_logistic"] {
        assert!(summary.contains(&format!("| {kind} | ")), "{kind}: {summary}");
    }
    let compared = provenance.compared.iter().map(|comparison| comparison.areas_not_trained_on.len());
    assert_eq!(compared.collect::<Vec<_>>(), [2; 4]);
}

#[test]
fn further_areas_are_told_apart_from_those_that_were_trained_on() {
    let folder = two_sets();
    let arguments =
        ["train", "north.jsonl", "--not-trained-on", "south.jsonl", "--kind", "one_feature", "--out", "out"];
    let summary = printed(&folder, &arguments);
    let loaded = texts(&folder.path().join("out")).load().unwrap();
    let provenance = &loaded.description.provenance;
    assert_eq!((provenance.sets.len(), provenance.sets_not_trained_on[0].name.as_str()), (1, "south"));
    assert_eq!((&provenance.areas, loaded.description.kind.as_str()), (&[("north".into(), 160)].into(), "one_feature"));
    let [cc, cw, wc, ww] = provenance.compared[0].areas_not_trained_on[0].confusion;
    assert_eq!(cc + cw + wc + ww, 120);
    assert!(summary.contains(&format!(": {cc}, {cw}, {wc}, {ww} |")), "{summary}");
}

#[test]
fn an_evaluation_agrees_with_a_count_by_hand() {
    let folder = two_sets();
    let Loaded { classifier, .. } = quickly(&folder, &["north.jsonl", "south.jsonl"], "out");
    let images = write_set(&folder.path().join("west.jsonl"), "west", 3, 300);
    let table = printed(&folder, &["evaluate", "west.jsonl", "--classifier", "out"]);
    // accepting pays from six in seven on, of odds that are so many times larger
    let least = 6.0 * classifier.caution / (6.0 * classifier.caution + 1.0);
    let mut counts = [0; 4];
    for image in &images {
        let samples: Vec<Vec<f64>> = samples_of(image, classifier.kind).into_iter().map(|(sample, _)| sample).collect();
        let judged = classifier.judge(&samples).filter(|judgement| judgement.outside.is_none());
        let checked = image.evidence.as_ref().is_some_and(|numbers| is_checked(&evidence_of(numbers).unwrap()));
        let accepted = checked && judged.is_some_and(|judgement| judgement.probability >= least);
        let right = image.d_max_m.is_some_and(|d_max_m| d_max_m <= 0.5);
        counts[2 * usize::from(!accepted) + usize::from(!right)] += 1;
    }
    let right = counts[0] + counts[2];
    assert!(counts[0] > 30 && counts[3] > 30, "{counts:?} shows nothing");
    let (found, cost) = row(&table, "**T_d**");
    assert_eq!(found, counts);
    assert!(is_cost(cost, counts, 300), "{table}");
    assert!(table.contains(&format!("300 images, {right} oriented within the tolerance")), "{table}");
    let (rejecting, cost_of_rejecting) = row(&table, "rejecting all");
    assert_eq!(rejecting, [0, 0, right, 300 - right]);
    assert!(is_cost(cost_of_rejecting, rejecting, 300) && cost < cost_of_rejecting, "{table}");
    let (knowing, _) = row(&table, "knowing the truth");
    assert_eq!(knowing, [right, 0, 0, 300 - right]);
    let [stricter, laxer] = ["T_d +1", "T_d -1"].map(|name| row(&table, name).0);
    assert!(stricter[0] < counts[0] && counts[0] < laxer[0] && stricter[1] <= counts[1], "{table}");
    // of two sets, each and both
    let both = printed(&folder, &["evaluate", "west.jsonl", "south.jsonl", "--classifier", "out"]);
    assert!(both.starts_with(table.trim_end()), "{both}");
    let [south, all] =
        ["# south.jsonl", "# all of them"].map(|title| row(both.split_once(title).unwrap().1, "**T_d**").0);
    assert_eq!(all, std::array::from_fn(|k| counts[k] + south[k]));
    // what is accepted though wrong is named
    let listed = printed(&folder, &["evaluate", "west.jsonl", "--classifier", "out", "--threshold", "-1e9", "--list"]);
    let (accepted, _) = row(&listed, "**T_d**");
    assert!(accepted[1] > 30 && listed.matches("- west west-").count() == accepted[1], "{listed}");
}

#[test]
fn costs_caution_and_threshold_decide_what_is_accepted() {
    let folder = two_sets();
    quickly(&folder, &["north.jsonl", "south.jsonl"], "out");
    let accepted = |more: &[&str]| {
        let table = printed(&folder, &[&["evaluate", "north.jsonl", "--classifier", "out"], more].concat());
        let ([cc, cw, _, _], _) = row(&table, "**T_d**");
        cc + cw
    };
    let [bold, timid] = ["1", "12"].map(|caution| accepted(&["--caution", caution]));
    assert!(bold > timid, "{bold} {timid}");
    let [cheap, dear] = ["0,15,5,10", "0,400,5,10"].map(|costs| accepted(&["--caution", "1", "--costs", costs]));
    assert!(cheap > bold && bold > dear, "{cheap} {bold} {dear}");
    let [low, high] = ["-2.5", "1e9"].map(|threshold| accepted(&["--threshold", threshold]));
    assert!(low > timid && high == 0, "{low} {high}");
}

#[test]
fn pictures_and_the_judged_set_are_kept_on_request() {
    let folder = two_sets();
    quickly(&folder, &["north.jsonl", "south.jsonl"], "out");
    let to = ["--plots", "pictures/of/it", "--save", "saved.jsonl"];
    printed(&folder, &[&["evaluate", "north.jsonl", "--classifier", "out"][..], &to].concat());
    for (name, holds) in [("cost.svg", "<polyline"), ("calibration.svg", "<circle")] {
        let svg = std::fs::read_to_string(folder.path().join("pictures/of/it").join(name)).unwrap();
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n") && svg.contains(holds), "{name}: {svg}");
    }
    let read = |name: &str| {
        let text = std::fs::read_to_string(folder.path().join(name)).unwrap();
        text.lines().map(|line| serde_json::from_str::<LabelledImage>(line).unwrap()).collect::<Vec<_>>()
    };
    assert_eq!(read("saved.jsonl"), read("north.jsonl"));
}

#[test]
fn what_cannot_be_used_is_named_and_leaves_nothing() {
    let folder = two_sets();
    let north = std::fs::read_to_string(folder.path().join("north.jsonl")).unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let first: Vec<&str> = north.lines().take(3).collect();
    write("broken.jsonl", &format!("{}\n\n{{\"image\": 5}}\n{north}", first.join("\n")));
    write("negative.jsonl", &north.replacen("\"tolerance_m\":0.5,\"trials\"", "\"tolerance_m\":-0.5,\"trials\"", 1));
    write("empty.jsonl", "\n");
    let right = |line: &&str| serde_json::from_str::<LabelledImage>(line).unwrap().right();
    write("right.jsonl", &north.lines().filter(right).map(|line| format!("{line}\n")).collect::<String>());
    let train = |set: &str| refused(&folder, &["train", set, "--kind", "evidence_svm", "--out", "out"], 1);
    let evaluate = |arguments: &[&str]| refused(&folder, &[&["evaluate"], arguments].concat(), 1);
    for told in [train("broken.jsonl"), evaluate(&["broken.jsonl"])] {
        assert!(told.contains("broken.jsonl, line 5") && told.contains("expected a string"), "{told}");
    }
    let told = train("negative.jsonl");
    assert!(told.contains("negative.jsonl, line 1") && told.contains("-0.5 m is negative"), "{told}");
    let told = train("missing.jsonl");
    assert!(told.contains("cannot read missing.jsonl"), "{told}");
    let told = train("right.jsonl");
    assert!(told.contains("evidence_svm") && told.contains("0 are wrong"), "{told}");
    assert!(train("empty.jsonl").contains("no labelled images"));
    assert!(evaluate(&["empty.jsonl"]).contains("empty.jsonl has no images"));
    assert!(evaluate(&["north.jsonl", "--caution", "0.5"]).contains("--caution must be from 1 to 1e6"));
    assert!(evaluate(&["north.jsonl", "--data", "nowhere"]).contains("no data folder nowhere"));
    assert!(evaluate(&["north.jsonl", "--classifier", "out"]).contains("cannot read out/model.svm"));
    assert!(!folder.path().join("out").exists());
    quickly(&folder, &["north.jsonl"], "damaged");
    write("damaged/model.svm", "svm_type c_svc\n");
    let told = evaluate(&["north.jsonl", "--classifier", "damaged"]);
    assert!(told.contains("damaged") && told.contains("model.svm: this is not a model"), "{told}");
    for (arguments, said) in [
        (&["train", "north.jsonl", "--kind", "oracle", "--out", "out"][..], "paper, one_feature"),
        (&["train", "north.jsonl", "--costs", "0,5,5,10", "--out", "out"], "must cost more than rejecting"),
        (&["train", "north.jsonl"], "--out"),
        (&["train", "--out", "out"], "SET"),
        (&["train", "north.jsonl", "--data", "data"], "--name"),
        (&["evaluate"], "SET"),
        (&["evaluate", "north.jsonl", "--costs", "1,2,3"], "four numbers"),
    ] {
        let told = refused(&folder, arguments, 2);
        assert!(told.contains(said), "{arguments:?}: {told}");
    }
}

/// The name of the active classifier in a list.
fn active(list: &str) -> &str {
    let mut marked = list.lines().filter_map(|line| line.strip_prefix("* "));
    let name = marked.next().unwrap().split_whitespace().next().unwrap();
    assert_eq!(marked.next(), None, "{list}");
    name
}

#[test]
fn classifiers_are_added_activated_listed_and_rolled_back() {
    let folder = two_sets();
    let loaded = quickly(&folder, &["north.jsonl", "south.jsonl"], "made");
    let classifier = |arguments: &[&str]| printed(&folder, &[&["classifier"], arguments].concat());
    let refused = |arguments: &[&str]| refused(&folder, &[&["classifier"], arguments].concat(), 1);
    assert!(refused(&["list"]).contains("there is no data folder"));
    assert!(!folder.path().join("data").exists());
    printed(&folder, &["key", "list"]);
    assert_eq!(active(&classifier(&["list"])), "shipped");
    assert!(refused(&["rollback"]).contains("no classifier was ever activated"));
    assert_eq!(classifier(&["add", "made", "--name", "rhineland"]), "added rhineland\n");
    assert!(refused(&["add", "made", "--name", "rhineland"]).contains("\"rhineland\" already"));
    assert!(refused(&["add", "made", "--name", "shipped"]).contains("brings along"));
    assert!(refused(&["add", "nowhere", "--name", "other"]).contains("cannot read nowhere/model.svm"));
    assert!(refused(&["activate", "other"]).contains("no classifier of the name \"other\""));
    let list = classifier(&["list"]);
    let line = list.lines().find(|line| line.contains("rhineland")).unwrap();
    assert!(line.contains("ready") && line.contains(&loaded.hash()[..12]), "{list}");
    assert_eq!((list.lines().count(), active(&list)), (2, "shipped"));
    let decides = format!("rhineland decides from now on ({})\n", loaded.hash());
    assert_eq!(classifier(&["activate", "rhineland"]), decides);
    assert_eq!(active(&classifier(&["list"])), "rhineland");
    // what decides in the data folder is what images are judged by
    let by_data = printed(&folder, &["evaluate", "north.jsonl", "--data", "data"]);
    assert_eq!(by_data, printed(&folder, &["evaluate", "north.jsonl", "--classifier", "made"]));
    assert_ne!(by_data, printed(&folder, &["evaluate", "north.jsonl"]));
    assert!(classifier(&["activate", "shipped"]).starts_with("shipped decides"));
    assert_eq!(classifier(&["rollback"]), decides);
    assert!(classifier(&["rollback"]).starts_with("shipped decides"));
    assert!(refused(&["rollback"]).contains("no classifier was ever activated"));
}

#[test]
fn a_classifier_is_trained_into_a_data_folder_under_a_name_of_its_own() {
    let folder = two_sets();
    let history = ["train", "--kind", "one_feature", "--data", "data", "--name"];
    let sets = ["train", "north.jsonl", "south.jsonl", "--kind", "one_feature", "--data", "data", "--name"];
    assert!(refused(&folder, &[&sets[..], &["first"]].concat(), 1).contains("no data folder data"));
    printed(&folder, &["key", "list"]);
    assert!(
        refused(&folder, &[&history[..], &["first"]].concat(), 1).contains("no labelled images"),
        "the history is empty"
    );
    printed(&folder, &[&sets[..], &["first"]].concat());
    assert_eq!(active(&printed(&folder, &["classifier", "list"])), "shipped");
    let summary = printed(&folder, &[&sets[..], &["second", "--activate", "--out", "made"]].concat());
    let list = printed(&folder, &["classifier", "list"]);
    assert_eq!(active(&list), "second");
    let loaded = texts(&folder.path().join("made")).load().unwrap();
    assert!(summary.contains(&loaded.hash()));
    // both were learned from the same, and so they are the same
    assert_eq!(list.matches(&loaded.hash()[..12]).count(), 2, "{list}");
    for (name, said) in [("first", "\"first\" already"), ("shipped", "brings along")] {
        let told = refused(&folder, &[&sets[..], &[name, "--out", "more"]].concat(), 1);
        assert!(told.contains(said), "{told}");
    }
    assert!(!folder.path().join("more").exists(), "it is told before the training");
    assert_eq!(printed(&folder, &["classifier", "list"]), list);
}
