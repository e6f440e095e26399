//! Predicted against true planimetric errors, as a picture.

use std::fmt::Write as _;

use super::row::{Light, Row};

/// Side of the picture and its margin, in the units of the drawing.
const SIDE: f64 = 760.0;
const MARGIN: f64 = 70.0;

/// An SVG drawing with a dot for each image that has an orientation: the largest predicted planimetric standard
/// deviation of the nine ground points to the right, the true error at the same point upwards, both logarithmic in
/// ground sample distances. On the line they are equal. Colours are those of the verdict.
#[must_use]
pub fn plot(rows: &[Row]) -> String {
    let places: Vec<(f64, f64, Light)> = rows.iter().filter_map(place).collect();
    let axis = Axis { low: 0.1, high: 1000.0 };
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {SIDE} {SIDE}\" font-family=\"sans-serif\" \
         font-size=\"14\">\n<rect width=\"{SIDE}\" height=\"{SIDE}\" fill=\"white\"/>\n"
    );
    grid(&mut svg, &axis);
    for (name, light, colour) in
        [("red", Light::Red, "#d55e00"), ("yellow", Light::Yellow, "#e0b000"), ("green", Light::Green, "#009e73")]
    {
        let _ = writeln!(svg, "<g id=\"{name}\" fill=\"{colour}\" fill-opacity=\"0.45\">");
        for (sigma, error, _) in places.iter().filter(|(_, _, l)| *l == light) {
            let (x, y) = (axis.across(*sigma), axis.up(*error));
            let _ = writeln!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.2\"/>");
        }
        svg.push_str("</g>\n");
    }
    svg.push_str("</svg>\n");
    svg
}

/// Predicted and true error of an image in ground sample distances.
fn place(row: &Row) -> Option<(f64, f64, Light)> {
    Some((row.sigma_planimetric_m? / row.gsd_m, row.error_there_m? / row.gsd_m, row.verdict))
}

/// A logarithmic axis; what lies beyond its ends is drawn on them.
struct Axis {
    low: f64,
    high: f64,
}

impl Axis {
    fn share(&self, value: f64) -> f64 {
        (value.clamp(self.low, self.high) / self.low).ln() / (self.high / self.low).ln()
    }

    fn across(&self, value: f64) -> f64 {
        MARGIN + (SIDE - 2.0 * MARGIN) * self.share(value)
    }

    fn up(&self, value: f64) -> f64 {
        SIDE - self.across(value)
    }
}

fn grid(svg: &mut String, axis: &Axis) {
    let (first, last) = (MARGIN, SIDE - MARGIN);
    for value in [0.1, 1.0, 10.0, 100.0, 1000.0] {
        let (x, y) = (axis.across(value), axis.up(value));
        let _ = writeln!(
            svg,
            "<path d=\"M{x:.1} {first}V{last}M{first} {y:.1}H{last}\" stroke=\"#ddd\"/>\n\
             <text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{value}</text>\n\
             <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{value}</text>",
            last + 20.0,
            first - 8.0,
            y + 5.0
        );
    }
    let _ = writeln!(
        svg,
        "<path d=\"M{first} {last}L{last} {first}\" stroke=\"#555\"/>\n\
         <text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">largest predicted planimetric sigma, GSD</text>\n\
         <text transform=\"translate(22 {middle}) rotate(-90)\" text-anchor=\"middle\">true planimetric error there, \
         GSD</text>",
        SIDE - 18.0,
        middle = SIDE / 2.0
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::row::tests::right_row;

    #[test]
    fn a_row_is_a_dot_of_its_colour_on_the_line_where_prediction_and_truth_agree() {
        let row = Row { gsd_m: 0.2, sigma_planimetric_m: Some(2.0), error_there_m: Some(2.0), ..right_row(1) };
        let without = Row { sigma_planimetric_m: None, ..right_row(2) };
        let svg = plot(&[row, without]);
        // ten pixels of ground: the middle of three of four decades from 0.1 to 1000
        let middle = SIDE / 2.0;
        assert_eq!(svg.matches("<circle").count(), 1);
        let green = svg.split("<g id=\"green\"").nth(1).unwrap();
        assert!(green.contains(&format!("cx=\"{middle:.1}\" cy=\"{middle:.1}\"")), "{green}");
    }

    #[test]
    fn what_lies_beyond_the_axes_is_drawn_on_their_ends() {
        let axis = Axis { low: 0.1, high: 1000.0 };
        assert_eq!((axis.across(0.0), axis.across(1e9)), (MARGIN, SIDE - MARGIN));
        assert_eq!((axis.up(0.0), axis.up(1e9)), (SIDE - MARGIN, MARGIN));
    }
}
