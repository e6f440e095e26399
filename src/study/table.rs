//! The table of a study, of the kind of Förstner and Läbe's table 1.

use std::fmt::Write as _;

use super::Mixture;
use super::row::{Fate, Light, Row};

/// Decisions against reality, in the paper's order: accepted and right, accepted but wrong, rejected but right,
/// rejected and wrong.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Confusion {
    /// Accepted and right.
    pub cc: usize,
    /// Accepted but wrong: a false positive.
    pub cw: usize,
    /// Rejected but right: a false negative.
    pub wc: usize,
    /// Rejected and wrong.
    pub ww: usize,
}

/// What a decision costs, in the order of [`Confusion`] (paper 4.1).
const COSTS: [f64; 4] = [0.0, 40.0, 5.0, 10.0];

impl Confusion {
    /// Counts pairs of decision and reality.
    #[must_use]
    pub fn of(decisions: impl Iterator<Item = (bool, bool)>) -> Self {
        let mut counts = Self::default();
        for (accepted, right) in decisions {
            match (accepted, right) {
                (true, true) => counts.cc += 1,
                (true, false) => counts.cw += 1,
                (false, true) => counts.wc += 1,
                (false, false) => counts.ww += 1,
            }
        }
        counts
    }

    fn counts(self) -> [usize; 4] {
        [self.cc, self.cw, self.wc, self.ww]
    }

    /// The expected cost of an image; 0 for none.
    #[must_use]
    pub fn cost(self) -> f64 {
        let total: f64 = self.counts().iter().zip(COSTS).map(|(count, cost)| *count as f64 * cost).sum();
        total / self.counts().iter().sum::<usize>().max(1) as f64
    }
}

/// Images with fewer control points in view are not asked to be oriented: four leave nothing to check with.
const ENOUGH_CONTROL: usize = 5;

/// The table of rows of one mixture, in Markdown.
#[must_use]
pub fn table(mixture: Mixture, rows: &[Row]) -> String {
    let mut text = format!("# {} images of the mixture `{}`\n", rows.len(), mixture.name());
    if rows.is_empty() {
        return text;
    }
    decisions(&mut text, rows);
    lights(&mut text, rows);
    fates(&mut text, rows);
    measures(&mut text, rows);
    text
}

fn decisions(text: &mut String, rows: &[Row]) {
    text.push_str("\n| | accepted, right | accepted, wrong | rejected, right | rejected, wrong | cost |\n");
    text.push_str("|---|---|---|---|---|---|\n");
    let ours = Confusion::of(rows.iter().map(|row| (row.verdict == Light::Green, row.right())));
    let paper = Confusion::of(rows.iter().map(|row| (row.paper_accepted, row.paper_right())));
    for (name, counts) in [("Gable, green", ours), ("the paper's method", paper)] {
        let cells = counts.counts().map(|count| with_percent(count, rows.len())).join(" | ");
        let _ = writeln!(text, "| {name} | {cells} | {:.2} |", counts.cost());
    }
    text.push_str("| *the paper, 17 000 images* | *69 %* | *2 %* | *11 %* | *18 %* | *3.15* |\n");
}

fn lights(text: &mut String, rows: &[Row]) {
    text.push_str("\n| verdict | right | wrong |\n|---|---|---|\n");
    for (name, light) in [("green", Light::Green), ("yellow", Light::Yellow), ("red", Light::Red)] {
        let of_light = || rows.iter().filter(|row| row.verdict == light);
        let right = of_light().filter(|row| row.right()).count();
        let _ = writeln!(text, "| {name} | {right} | {} |", of_light().count() - right);
    }
}

fn fates(text: &mut String, rows: &[Row]) {
    let enough: Vec<&Row> = rows.iter().filter(|row| row.control_points_in_view >= ENOUGH_CONTROL).collect();
    let _ = writeln!(
        text,
        "\n| what became of the images | all | with at least {ENOUGH_CONTROL} control points in view |\n|---|---|---|"
    );
    let _ = writeln!(text, "| images | {} | {} |", rows.len(), enough.len());
    for (name, fate) in [
        ("oriented rightly", Fate::Right),
        ("lost: no control point in view", Fate::NoControlInView),
        ("lost: nothing located", Fate::NothingLocated),
        ("lost: wrong hypothesis", Fate::WrongHypothesis),
        ("lost: adjusted wrongly", Fate::AdjustedWrong),
    ] {
        let all = rows.iter().filter(|row| row.fate == fate).count();
        let of_enough = enough.iter().filter(|row| row.fate == fate).count();
        let (all, of_enough) = (with_percent(all, rows.len()), with_percent(of_enough, enough.len()));
        let _ = writeln!(text, "| {name} | {all} | {of_enough} |");
    }
    let by_paper = |rows: &mut dyn Iterator<Item = &Row>| rows.filter(|row| row.paper_right()).count();
    let all = with_percent(by_paper(&mut rows.iter()), rows.len());
    let of_enough = with_percent(by_paper(&mut enough.iter().copied()), enough.len());
    let _ = writeln!(text, "| oriented rightly by the paper's method | {all} | {of_enough} |");
}

fn measures(text: &mut String, rows: &[Row]) {
    let sum = |count: fn(&Row) -> usize| rows.iter().map(count).sum::<usize>();
    let right: Vec<&Row> = rows.iter().filter(|row| row.right()).collect();
    let of_right = |value: fn(&Row) -> Option<f64>| right.iter().filter_map(|row| value(row)).collect::<Vec<f64>>();
    let distances = of_right(|row| row.mahalanobis_squared);
    let ratios = of_right(|row| Some(row.d_max_m? / row.sigma_planimetric_m?));
    let errors = of_right(|row| row.error_of_nine_m);
    let sigmas = of_right(|row| row.sigma_of_nine_m);
    let mean_seconds = |value: fn(&Row) -> f64| mean(&rows.iter().map(value).collect::<Vec<f64>>());
    let seconds = [
        mean_seconds(|row| row.render_seconds),
        mean_seconds(|row| row.pipeline_seconds),
        mean_seconds(|row| row.paper_seconds),
    ];
    text.push_str("\n| measure | value |\n|---|---|\n");
    let mut line = |name: &str, value: String| {
        let _ = writeln!(text, "| {name} | {value} |");
    };
    let in_view = sum(|row| row.control_points_in_view);
    line("control points in view, of an image", format!("{:.1}", in_view as f64 / rows.len() as f64));
    line("of them out of date", with_percent(in_view - sum(|row| row.sound_in_view), in_view));
    line("located rightly, of those in view", with_percent(sum(|row| row.located_right), in_view));
    line("right, of those that took part", with_percent(sum(|row| row.used_right), sum(|row| row.used)));
    let paper_located = sum(|row| row.paper_located);
    line(
        "right, of those that the paper's method locates",
        with_percent(sum(|row| row.paper_located_right), paper_located),
    );
    line("mean squared Mahalanobis distance of the right ones (6 expected)", format!("{:.2}", mean(&distances)));
    line("median of the same (5.35 expected)", format!("{:.2}", median(distances)));
    line("median of D_max over the largest predicted sigma, right ones", format!("{:.2}", median(ratios)));
    line(
        "predicted planimetric sigma of the right ones, root mean square",
        format!("{:.3} m", root_mean_square(&sigmas)),
    );
    line("true planimetric error of the right ones, root mean square", format!("{:.3} m", root_mean_square(&errors)));
    line("median D_max of the right ones", format!("{:.2} GSD", median(of_right(|row| row.d_max_gsd))));
    let [render, pipeline, paper] = seconds;
    line(
        "processor time of an image",
        format!(
            "{:.3} s: rendering {render:.3} s, pipeline {pipeline:.3} s, the paper's method {paper:.3} s",
            render + pipeline + paper
        ),
    );
}

fn with_percent(count: usize, of: usize) -> String {
    if of == 0 { format!("{count}") } else { format!("{count} ({:.1} %)", 100.0 * count as f64 / of as f64) }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn root_mean_square(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { f64::NAN } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}
