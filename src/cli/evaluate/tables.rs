//! The tables of an evaluation, in Markdown.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::classifiers::{Evaluation, LabelledImage, Loaded, Scored, evidence_of, plot, scored};
use crate::diagnosis::Policy;
use crate::diagnosis::judge::threshold;
use crate::diagnosis::thresholds::{Thresholds, accepts};
use crate::learning::{Confusion, Costs};

/// Thresholds about the one that decides.
const BESIDE: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];

/// All that is known of a classifier's decisions on some images.
pub(super) fn tables(name: &str, images: &[LabelledImage], loaded: &Loaded, policy: &Policy, list: bool) -> String {
    let judged: Vec<Scored> = images.iter().map(|image| scored(&loaded.classifier, image)).collect();
    let decides = threshold(&loaded.classifier, policy);
    let right = judged.iter().filter(|s| s.right).count();
    let mut text = format!(
        "# {name}\n\n{} images, {right} oriented within the tolerance ({:.1} %). Classifier {} {}, caution {}, T_d {decides:.3}\n",
        images.len(),
        percent(right, images.len()),
        loaded.description.kind,
        &loaded.hash()[..12],
        policy.caution.unwrap_or(loaded.classifier.caution),
    );
    decisions(&mut text, images, &judged, policy, decides);
    within_half(&mut text, images, &judged, decides);
    calibration(&mut text, &Evaluation::of(&judged));
    if list {
        accepted_though_wrong(&mut text, images, &judged, decides);
    }
    text
}

/// The pictures of an evaluation with the names of their files.
pub(super) fn plots(images: &[LabelledImage], loaded: &Loaded, policy: &Policy) -> [(&'static str, String); 2] {
    let judged: Vec<Scored> = images.iter().map(|image| scored(&loaded.classifier, image)).collect();
    let evaluation = Evaluation::of(&judged);
    let decides = threshold(&loaded.classifier, policy);
    [
        ("cost.svg", plot::cost_curve(&evaluation, &policy.costs, decides)),
        ("calibration.svg", plot::calibration(&evaluation)),
    ]
}

fn decisions(text: &mut String, images: &[LabelledImage], judged: &[Scored], policy: &Policy, decides: f64) {
    text.push_str(
        "\n| | accepted, right | accepted, wrong | rejected, right | rejected, wrong | cost |\n|---|---|---|---|---|---|\n",
    );
    let at = |threshold: f64| Confusion::of(judged.iter().map(|s| (s.score > threshold, s.right)));
    for beside in BESIDE {
        let name = if beside == 0.0 { "**T_d**".to_owned() } else { format!("T_d {beside:+}") };
        row(text, &name, at(decides + beside), &policy.costs);
    }
    let by_thresholds = images.iter().map(|image| {
        let evidence = image.evidence.as_ref().and_then(|numbers| evidence_of(numbers).ok());
        (evidence.is_some_and(|evidence| accepts(&evidence, &Thresholds::default())), image.right())
    });
    row(text, "thresholds", Confusion::of(by_thresholds), &policy.costs);
    row(text, "rejecting all", at(f64::INFINITY), &policy.costs);
    let perfect = judged.iter().map(|s| (s.right, s.right));
    row(text, "knowing the truth", Confusion::of(perfect), &policy.costs);
}

fn row(text: &mut String, name: &str, confusion: Confusion, costs: &Costs) {
    let Confusion { cc, cw, wc, ww } = confusion;
    let cells = [cc, cw, wc, ww].map(|count| format!("{count} ({:.2} %)", percent(count, confusion.total())));
    let _ = writeln!(text, "| {name} | {} | {:.3} |", cells.join(" | "), confusion.expected_cost(costs));
}

/// What is well within the tolerance should be accepted.
fn within_half(text: &mut String, images: &[LabelledImage], judged: &[Scored], decides: f64) {
    let well = |image: &LabelledImage| image.d_max_m.is_some_and(|d_max_m| 2.0 * d_max_m <= image.tolerance_m);
    let accepted: Vec<bool> =
        images.iter().zip(judged).filter(|(image, _)| well(image)).map(|(_, s)| s.score > decides).collect();
    let count = accepted.iter().filter(|accepted| **accepted).count();
    let _ = writeln!(
        text,
        "\nOf the {} within half the tolerance {count} are accepted ({:.1} %).",
        accepted.len(),
        percent(count, accepted.len())
    );
}

fn calibration(text: &mut String, evaluation: &Evaluation) {
    let _ = writeln!(
        text,
        "\nCalibration error {:.4}.\n\n| predicted | observed | images | 99.9 % of shares | |\n|---|---|---|---|---|",
        evaluation.calibration_error
    );
    for bin in &evaluation.bins {
        let [low, high] = bin.interval;
        let honest = if bin.is_honest() { "" } else { "outside" };
        let _ = writeln!(
            text,
            "| {:.4} | {:.4} | {} | {low:.4} to {high:.4} | {honest} |",
            bin.predicted, bin.observed, bin.images
        );
    }
}

fn accepted_though_wrong(text: &mut String, images: &[LabelledImage], judged: &[Scored], decides: f64) {
    let mut by_image: BTreeMap<(&str, &str), (usize, f64)> = BTreeMap::new();
    for (image, _) in images.iter().zip(judged).filter(|(_, s)| s.score > decides && !s.right) {
        let ratio = image.d_max_m.unwrap_or(f64::INFINITY) / image.tolerance_m;
        let entry = by_image.entry((&image.area, &image.image)).or_default();
        *entry = (entry.0 + 1, entry.1.max(ratio));
    }
    text.push_str("\nAccepted though wrong:\n");
    for ((area, image), (count, ratio)) in by_image {
        let _ = writeln!(text, "- {area} {image}: {count} times, D_max up to {ratio:.2} tolerances");
    }
}

fn percent(count: usize, of: usize) -> f64 {
    100.0 * count as f64 / of.max(1) as f64
}
