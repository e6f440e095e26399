//! Cost curve and calibration of a classifier, as pictures.

use std::fmt::Write as _;

use super::evaluation::Evaluation;
use crate::learning::Costs;

/// Size of a picture and its margins, in the units of the drawing.
const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 460.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 46.0;
const BOTTOM: f64 = 58.0;

/// An axis from values to the drawing.
struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Axis {
    fn across(low: f64, high: f64) -> Self {
        Self { low, high, from: LEFT, to: WIDTH - RIGHT }
    }

    fn up(low: f64, high: f64) -> Self {
        Self { low, high, from: HEIGHT - BOTTOM, to: TOP }
    }

    fn at(&self, value: f64) -> f64 {
        let share = (value.clamp(self.low, self.high) - self.low) / (self.high - self.low);
        self.from + share * (self.to - self.from)
    }
}

/// The expected cost over the threshold T_d, with the threshold that decides and the cost of accepting or rejecting all.
#[must_use]
pub fn cost_curve(evaluation: &Evaluation, costs: &Costs, threshold: f64) -> String {
    let points: Vec<(f64, f64)> = evaluation
        .curve
        .iter()
        .filter_map(|point| Some((point.threshold?, point.confusion().expected_cost(costs))))
        .collect();
    let mut svg = begin("Expected cost of an image over the threshold T_d");
    let Some((first, last)) = points.first().zip(points.last()) else { return end(svg) };
    let low = if threshold.is_finite() { first.0.min(threshold) } else { first.0 };
    let high = if last.0 > first.0 { last.0 } else { first.0 + 1.0 };
    let most = points.iter().map(|point| point.1).fold(0.0, f64::max).max(1e-9);
    let (x, y) = (Axis::across(low, high.max(low + 1e-9)), Axis::up(0.0, 1.05 * most));
    for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let (score, cost) = (low + share * (high - low), share * most);
        vertical(&mut svg, x.at(score), &format!("{score:.1}"));
        horizontal(&mut svg, y.at(cost), &format!("{cost:.2}"));
    }
    let path: Vec<String> =
        points.iter().map(|(score, cost)| format!("{:.1},{:.1}", x.at(*score), y.at(*cost))).collect();
    let _ =
        writeln!(svg, "<polyline points=\"{}\" fill=\"none\" stroke=\"#0072b2\" stroke-width=\"2\"/>", path.join(" "));
    if threshold.is_finite() {
        let cost = evaluation.confusion(threshold).expected_cost(costs);
        let at = x.at(threshold);
        let _ = writeln!(
            svg,
            "<path d=\"M{at:.1} {TOP}V{:.1}\" stroke=\"#d55e00\" stroke-dasharray=\"5 4\"/>\n\
             <text x=\"{:.1}\" y=\"{:.1}\" fill=\"#d55e00\">T_d = {threshold:.2}, cost {cost:.2}</text>",
            HEIGHT - BOTTOM,
            (at + 6.0).min(WIDTH - 190.0),
            TOP + 14.0
        );
    }
    labels(&mut svg, "threshold T_d", "expected cost");
    end(svg)
}

/// The share of right ones over the probability that they were given, in bins of equal count, both as log odds; bars
/// are the intervals that hold 99.9 % of the shares if the probabilities are honest.
#[must_use]
pub fn calibration(evaluation: &Evaluation) -> String {
    const ENDS: f64 = 8.0;
    let log_odds = |share: f64| (share / (1.0 - share)).ln().clamp(-ENDS, ENDS);
    let (x, y) = (Axis::across(-ENDS, ENDS), Axis::up(-ENDS, ENDS));
    let mut svg = begin("Share of right orientations over predicted probability");
    for share in [0.001, 0.01, 0.1, 0.5, 0.9, 0.99, 0.999] {
        vertical(&mut svg, x.at(log_odds(share)), &format!("{share}"));
        horizontal(&mut svg, y.at(log_odds(share)), &format!("{share}"));
    }
    let _ = writeln!(
        svg,
        "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"#555\"/>",
        x.at(-ENDS),
        y.at(-ENDS),
        x.at(ENDS),
        y.at(ENDS)
    );
    for bin in &evaluation.bins {
        let colour = if bin.is_honest() { "#009e73" } else { "#d55e00" };
        let at = x.at(log_odds(bin.predicted));
        let [low, high] = bin.interval.map(|share| y.at(log_odds(share)));
        let _ = writeln!(
            svg,
            "<path d=\"M{at:.1} {low:.1}V{high:.1}\" stroke=\"{colour}\" stroke-width=\"2\"/>\n\
             <circle cx=\"{at:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"{colour}\"><title>predicted {:.4}, observed {:.4}, {} \
             images</title></circle>",
            y.at(log_odds(bin.observed)),
            bin.predicted,
            bin.observed,
            bin.images
        );
    }
    labels(&mut svg, "predicted probability", "observed share");
    end(svg)
}

fn begin(title: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"13\" role=\"img\" aria-label=\"{title}\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" \
         fill=\"white\"/>\n<text x=\"{LEFT}\" y=\"24\" font-size=\"16\">{title}</text>\n"
    )
}

fn end(mut svg: String) -> String {
    svg.push_str("</svg>\n");
    svg
}

fn vertical(svg: &mut String, x: f64, text: &str) {
    let bottom = HEIGHT - BOTTOM;
    let _ = writeln!(
        svg,
        "<path d=\"M{x:.1} {TOP}V{bottom}\" stroke=\"#ddd\"/>\n<text x=\"{x:.1}\" y=\"{:.1}\" \
         text-anchor=\"middle\">{text}</text>",
        bottom + 18.0
    );
}

fn horizontal(svg: &mut String, y: f64, text: &str) {
    let _ = writeln!(
        svg,
        "<path d=\"M{LEFT} {y:.1}H{:.1}\" stroke=\"#ddd\"/>\n<text x=\"{:.1}\" y=\"{:.1}\" \
         text-anchor=\"end\">{text}</text>",
        WIDTH - RIGHT,
        LEFT - 6.0,
        y + 4.0
    );
}

fn labels(svg: &mut String, across: &str, up: &str) {
    let middle = (TOP + HEIGHT - BOTTOM) / 2.0;
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{across}</text>\n\
         <text transform=\"translate(18 {middle:.1}) rotate(-90)\" text-anchor=\"middle\">{up}</text>",
        (LEFT + WIDTH - RIGHT) / 2.0,
        HEIGHT - 14.0
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::classifiers::Scored;

    fn evaluation() -> Evaluation {
        let scored: Vec<Scored> = (0..200)
            .map(|k| {
                let score = f64::from(k) / 100.0 - 1.0;
                Scored { score, probability: 1.0 / (1.0 + (-4.0 * score).exp()), right: k * 7 % 200 < k }
            })
            .collect();
        Evaluation::of(&scored)
    }

    #[test]
    fn a_cost_curve_has_a_line_and_the_threshold_on_it() {
        let svg = cost_curve(&evaluation(), &Costs::default(), 0.5);
        assert!(svg.contains("<polyline") && svg.contains("T_d = 0.50, cost"), "{svg}");
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"));
        // where accepting never pays there is no threshold to draw
        assert!(!cost_curve(&evaluation(), &Costs::default(), f64::INFINITY).contains("T_d ="));
        assert!(cost_curve(&Evaluation::of(&[]), &Costs::default(), 0.0).ends_with("</svg>\n"));
    }

    /// Whether tags are closed in order, values of attributes quoted, and nothing is written outside the one element.
    fn is_well_formed(svg: &str) -> bool {
        let mut open = Vec::new();
        let mut rest = svg;
        while let Some((text, tag)) = rest.split_once('<') {
            let Some((tag, after)) = tag.split_once('>') else { return false };
            rest = after;
            let outside = open.is_empty() && !text.trim().is_empty();
            let name = tag.trim_start_matches('/').split([' ', '/']).next().unwrap_or_default();
            let attributes =
                tag.split('"').step_by(2).skip(1).all(|between| between.is_empty() || between.starts_with([' ', '/']));
            if outside || text.contains(['>', '&']) || name.is_empty() || tag.contains('<') || !attributes {
                return false;
            }
            if tag.matches('"').count() % 2 != 0 || tag.starts_with('/') && open.pop() != Some(name) {
                return false;
            }
            if !tag.starts_with('/') && !tag.ends_with('/') {
                open.push(name);
            }
        }
        open.is_empty() && rest.trim().is_empty()
    }

    #[test]
    fn pictures_are_well_formed_whatever_they_show() {
        let one = |score: f64| Scored { score, probability: 0.9, right: true };
        let certain = |right: bool| Scored { score: 1.0, probability: if right { 1.0 } else { 0.0 }, right };
        let evaluations = [
            evaluation(),
            Evaluation::of(&[]),
            Evaluation::of(&[one(0.5)]),
            Evaluation::of(&[one(f64::NEG_INFINITY), one(f64::NEG_INFINITY)]),
            Evaluation::of(&[certain(true), certain(false)]),
        ];
        for evaluation in &evaluations {
            let free = Costs { cc: 0.0, cw: 0.0, wc: 0.0, ww: 0.0 };
            let thresholds = [0.5, -50.0, 50.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
            let curves = thresholds
                .iter()
                .flat_map(|threshold| [Costs::default(), free].map(|costs| cost_curve(evaluation, &costs, *threshold)));
            for svg in curves.chain([calibration(evaluation)]) {
                assert!(is_well_formed(&svg) && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
            }
        }
        let svg = calibration(&evaluations[0]);
        for damaged in [svg.replace("</svg>", ""), svg.replacen("\"/>", "/>", 1), svg.replacen("</text>", "</path>", 1)]
        {
            assert!(!is_well_formed(&damaged));
        }
    }

    #[test]
    fn the_threshold_is_drawn_where_its_score_is() {
        let svg = cost_curve(&evaluation(), &Costs::default(), 0.0);
        // scores go from -1 to 0.99
        let at = LEFT + (WIDTH - RIGHT - LEFT) / 1.99;
        assert!(svg.contains(&format!("<path d=\"M{at:.1} {TOP}V")), "{at} {svg}");
    }

    #[test]
    fn a_calibration_has_a_bar_for_every_bin() {
        let svg = calibration(&evaluation());
        assert_eq!(svg.matches("<circle").count(), 10);
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
