//! The table of a study, of the kind of Förstner and Läbe's table 1.

use std::fmt::Write as _;

use super::Mixture;
use super::row::{Fate, Light, Row};
use crate::learning::{Confusion, Costs};

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
    let thresholds = Confusion::of(rows.iter().map(|row| (row.thresholds_accept, row.right())));
    for (name, counts) in [("Gable, green", ours), ("Gable by thresholds", thresholds), ("the paper's method", paper)] {
        let Confusion { cc, cw, wc, ww } = counts;
        let cells = [cc, cw, wc, ww].map(|count| with_percent(count, rows.len())).join(" | ");
        let _ = writeln!(text, "| {name} | {cells} | {:.2} |", counts.expected_cost(&Costs::default()));
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
    line("mean squared Mahalanobis distance of the right ones (6 expected)", figure(mean(&distances), 2));
    line("median of the same (5.35 expected)", figure(median(distances), 2));
    line("median of D_max over the largest predicted sigma, right ones", figure(median(ratios), 2));
    line(
        "predicted planimetric sigma of the right ones, root mean square",
        figure(root_mean_square(&sigmas), 3) + " m",
    );
    line("true planimetric error of the right ones, root mean square", figure(root_mean_square(&errors), 3) + " m");
    line("median D_max of the right ones", figure(median(of_right(|row| row.d_max_gsd)), 2) + " GSD");
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

/// A dash where nothing could be averaged.
fn figure(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}") } else { "-".to_owned() }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::row::tests::right_row;

    fn wrong_row(seed: u64, fate: Fate) -> Row {
        Row { fate, d_max_m: Some(10.0), d_max_gsd: Some(50.0), verdict: Light::Red, ..right_row(seed) }
    }

    #[test]
    fn a_table_of_rows_made_by_hand() {
        let mut rows: Vec<Row> = (0..6).map(right_row).collect();
        rows[1].verdict = Light::Yellow;
        rows[2].control_points_in_view = 3;
        rows[2].sound_in_view = 3;
        rows.push(wrong_row(6, Fate::WrongHypothesis));
        rows.push(Row { verdict: Light::Green, thresholds_accept: false, ..wrong_row(7, Fate::AdjustedWrong) });
        let table = table(Mixture::Good, &rows);
        let has = |line: &str| assert!(table.contains(line), "{line}\n{table}");
        has("# 8 images of the mixture `good`");
        // one green and wrong: 40; one rejected though right: 5; one rejected and wrong: 10
        has("| Gable, green | 5 (62.5 %) | 1 (12.5 %) | 1 (12.5 %) | 1 (12.5 %) | 6.88 |");
        has("| Gable by thresholds | 6 (75.0 %) | 1 (12.5 %) | 0 (0.0 %) | 1 (12.5 %) | 6.25 |");
        has("| yellow | 1 | 0 |");
        has("| oriented rightly | 6 (75.0 %) | 5 (71.4 %) |");
        has("| lost: wrong hypothesis | 1 (12.5 %) | 1 (14.3 %) |");
        has("| mean squared Mahalanobis distance of the right ones (6 expected) | 6.50 |");
        has("| of them out of date | 7 (9.6 %) |");
        has("| true planimetric error of the right ones, root mean square | 0.300 m |");
        assert!(super::table(Mixture::Poor, &[]).starts_with("# 0 images"));
    }
}
