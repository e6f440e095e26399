//! The residuals of the marks on the plate, as a drawing.

use std::fmt::Write as _;

use super::{InteriorResult, MarkReport};

/// Size of the drawing, of the square that the plate is drawn in, and the margin around that.
const WIDTH: f64 = 960.0;
const HEIGHT: f64 = 770.0;
const SIDE: f64 = 560.0;
const LEFT: f64 = 90.0;
const TOP: f64 = 130.0;
/// Where the legend begins.
const LEGEND: f64 = 752.0;
/// The longest residual and the largest ellipse are drawn about so long.
const LONGEST: f64 = 58.0;
/// The root of the 95 % quantile of chi-square with two degrees of freedom.
const TO_95_PERCENT: f64 = 2.447_747;
// Okabe and Ito's palette, which the colour-blind tell apart as well
const USED: &str = "#0072b2";
const UNUSED: &str = "#d55e00";
const ELLIPSE: &str = "#009e73";

/// An SVG drawing of the plate with the image's format, seen as the scene is seen: a point at each mark, from it its
/// residual (found less predicted) magnified, and about it the 95 % ellipse of the accuracy that it counts with, in the
/// same scale.
/// Marks that were not used are vermilion, hollow where they were not found.
#[must_use]
pub fn residual_plot(result: &InteriorResult) -> String {
    let plate = Plate::of(result);
    let scale = Scale::of(result);
    let mut svg = begin(result);
    format(&mut svg, &plate, result.format_mm);
    for mark in &result.marks {
        drawn(&mut svg, &plate, &scale, mark);
    }
    legend(&mut svg, &scale, result);
    svg.push_str("</svg>\n");
    svg
}

/// From the plate's millimetres to the drawing.
struct Plate {
    centre_mm: [f64; 2],
    per_mm: f64,
}

impl Plate {
    /// So that the image and all marks are seen.
    fn of(result: &InteriorResult) -> Self {
        let half = result.format_mm.map(|side| side / 2.0);
        let corners = [[-half[0], -half[1]], half];
        let places: Vec<[f64; 2]> = corners.into_iter().chain(result.marks.iter().map(|mark| mark.plate_mm)).collect();
        let bounds = |axis: usize| {
            let values = places.iter().map(|place| place[axis]);
            (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
        };
        let ((left, right), (bottom, top)) = (bounds(0), bounds(1));
        let longest = (right - left).max(top - bottom).max(1.0);
        Self { centre_mm: [(left + right) / 2.0, (bottom + top) / 2.0], per_mm: SIDE / longest }
    }

    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            LEFT + SIDE / 2.0 + (x - self.centre_mm[0]) * self.per_mm,
            TOP + SIDE / 2.0 - (y - self.centre_mm[1]) * self.per_mm,
        ]
    }
}

/// How much residuals are magnified.
struct Scale {
    per_um: f64,
    bar_um: f64,
}

impl Scale {
    /// So that the longest residual of a mark that was used, or the largest ellipse, can be seen well.
    fn of(result: &InteriorResult) -> Self {
        let used = result.marks.iter().filter(|mark| mark.used);
        let lengths = used.flat_map(|mark| {
            let residual = mark.residual_um.map(|[x, y]| x.hypot(y));
            [residual, mark.covariance_um2.map(|covariance| Ellipse::of(covariance).axes_um[0])]
        });
        let longest_um = lengths.flatten().fold(0.0, f64::max).max(0.1);
        let per_um = LONGEST / longest_um;
        // the bar is a round number of micrometres, 60 to 150 long
        let least_um = 60.0 / per_um;
        let ten = 10f64.powf(least_um.log10().floor());
        let round = [1.0, 2.0, 5.0].map(|digit| digit * ten).into_iter().find(|um| *um >= least_um);
        Self { per_um, bar_um: round.unwrap_or(10.0 * ten) }
    }
}

struct Ellipse {
    /// Semi-axes, the longer first.
    axes_um: [f64; 2],
    /// Of the longer one, counter-clockwise from the plate's x axis.
    angle_deg: f64,
}

impl Ellipse {
    fn of([[xx, xy], [_, yy]]: [[f64; 2]; 2]) -> Self {
        let (mean, half) = ((xx + yy) / 2.0, (xx - yy) / 2.0);
        let root = half.hypot(xy);
        let axes_um = [mean + root, mean - root].map(|variance| TO_95_PERCENT * variance.max(0.0).sqrt());
        Self { axes_um, angle_deg: 0.5 * xy.atan2(half).to_degrees() }
    }
}

fn begin(result: &InteriorResult) -> String {
    let title = "Residuals of the fiducial marks";
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"14\" role=\"img\" aria-label=\"{title}\">\n<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" \
         fill=\"white\"/>\n<text x=\"30\" y=\"34\" font-size=\"18\">{title}</text>\n"
    );
    let used = result.marks.iter().filter(|mark| mark.used).count();
    let fit = match &result.transformation {
        None => "no transformation".to_owned(),
        Some(fitted) => {
            let rms = fitted.rms_residual_um.map_or_else(String::new, |um| format!(", rms {um:.1} µm"));
            format!("{}, sigma0 {:.2}{rms}, redundancy {}", fitted.kind, fitted.sigma0, fitted.redundancy)
        }
    };
    let _ = writeln!(
        svg,
        "<text x=\"30\" y=\"58\" fill=\"#444\">{}: {used} of {} marks used; {fit}</text>",
        escaped(&result.diagnosis.verdict),
        result.marks.len()
    );
    svg
}

/// The image's frame with its centre and the directions of the plate's axes.
fn format(svg: &mut String, plate: &Plate, [width, height]: [f64; 2]) {
    let [left, top] = plate.place([-width / 2.0, height / 2.0]);
    let [right, bottom] = plate.place([width / 2.0, -height / 2.0]);
    let [x, y] = plate.place([0.0, 0.0]);
    let _ = writeln!(
        svg,
        "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"#f7f7f7\" stroke=\"#999\"/>\n\
         <g stroke=\"#777\" fill=\"#777\"><path fill=\"none\" d=\"M{x:.1} {y:.1}h44m-7 -4l7 4l-7 4M{x:.1} {y:.1}v-44m-4 \
         7l4 -7l4 7\"/>\n<text stroke=\"none\" x=\"{:.1}\" y=\"{:.1}\">x</text><text stroke=\"none\" x=\"{:.1}\" \
         y=\"{:.1}\">y</text></g>",
        right - left,
        bottom - top,
        x + 50.0,
        y + 5.0,
        x - 4.0,
        y - 50.0
    );
}

fn drawn(svg: &mut String, plate: &Plate, scale: &Scale, mark: &MarkReport) {
    let [x, y] = plate.place(mark.plate_mm);
    let colour = if mark.used { USED } else { UNUSED };
    let _ = writeln!(svg, "<g id=\"mark-{0}\"><title>{0}: {1}</title>", escaped(&mark.name), told(mark));
    if let Some(covariance) = mark.covariance_um2 {
        let ellipse = Ellipse::of(covariance);
        let [long, short] = ellipse.axes_um.map(|um| um * scale.per_um);
        // of a mark that is none it may be beyond all measure
        if long < SIDE / 2.0 {
            let _ = writeln!(
                svg,
                "<ellipse transform=\"translate({x:.1} {y:.1}) rotate({:.1})\" rx=\"{long:.1}\" ry=\"{short:.1}\" \
                 fill=\"{ELLIPSE}\" fill-opacity=\"0.12\" stroke=\"{ELLIPSE}\"/>",
                -ellipse.angle_deg
            );
        }
    }
    if let Some(residual_um) = mark.residual_um {
        arrow(svg, [x, y], residual_um.map(|um| um * scale.per_um), colour);
    }
    let fill = if mark.located_px.is_some() { colour } else { "white" };
    // the name stands towards the middle of the plate, where nothing is cut off
    let across = if x > LEFT + SIDE / 2.0 + 1.0 { ("end", -10.0) } else { ("start", 10.0) };
    let down = if y > TOP + SIDE / 2.0 + 1.0 { -12.0 } else { 24.0 };
    let _ = writeln!(
        svg,
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{fill}\" stroke=\"{colour}\" stroke-width=\"1.5\"/>\n\
         <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"{}\" fill=\"{colour}\" paint-order=\"stroke\" stroke=\"white\" \
         stroke-width=\"3\">{}</text></g>",
        x + across.1,
        y + down,
        across.0,
        escaped(&mark.name)
    );
}

/// A residual, upwards along the plate's y axis. One that would leave the drawing ends where it does, dashed.
fn arrow(svg: &mut String, [x, y]: [f64; 2], [right, up]: [f64; 2], colour: &str) {
    let length = right.hypot(up);
    let longest = 1.6 * LONGEST;
    let (share, dashes) = if length > longest { (longest / length, " stroke-dasharray=\"6 4\"") } else { (1.0, "") };
    let (to_x, to_y) = (x + share * right, y - share * up);
    let _ = writeln!(
        svg,
        "<path d=\"M{x:.1} {y:.1}L{to_x:.1} {to_y:.1}\" stroke=\"{colour}\" stroke-width=\"2\"{dashes}/>"
    );
    // a head on a line that is shorter than itself says nothing
    if length < 6.0 {
        return;
    }
    let (along_x, along_y) = (right / length, -up / length);
    let back = (to_x - 8.0 * along_x, to_y - 8.0 * along_y);
    let _ = writeln!(
        svg,
        "<path d=\"M{to_x:.1} {to_y:.1}L{:.1} {:.1}L{:.1} {:.1}z\" fill=\"{colour}\"/>",
        back.0 - 3.5 * along_y,
        back.1 + 3.5 * along_x,
        back.0 + 3.5 * along_y,
        back.1 - 3.5 * along_x
    );
}

fn told(mark: &MarkReport) -> String {
    let state = match (mark.used, mark.located_px) {
        (true, _) => "used",
        (false, Some(_)) => "found, not used",
        (false, None) => "not found",
    };
    mark.residual_um.map_or_else(
        || state.to_owned(),
        |[x, y]| format!("{state}, residual {x:.1}, {y:.1} µm, length {:.1} µm", x.hypot(y)),
    )
}

fn legend(svg: &mut String, scale: &Scale, result: &InteriorResult) {
    let bar = scale.bar_um * scale.per_um;
    let y = TOP + 20.0;
    let _ = writeln!(
        svg,
        "<path d=\"M{LEGEND} {:.1}v8m0 -4h{bar:.1}m0 -4v8\" fill=\"none\" stroke=\"#222\" stroke-width=\"2\"/>\n\
         <text x=\"{LEGEND}\" y=\"{:.1}\">{} µm</text>",
        y - 4.0,
        y + 24.0,
        scale.bar_um
    );
    let x = LEGEND + 8.0;
    let text = |svg: &mut String, row: f64, words: &str| {
        let _ = writeln!(svg, "<text x=\"{:.1}\" y=\"{:.1}\">{words}</text>", LEGEND + 28.0, y + row + 5.0);
    };
    for (row, fill, stroke, words) in
        [(60.0, USED, USED, "used"), (86.0, UNUSED, UNUSED, "found, not used"), (112.0, "white", UNUSED, "not found")]
    {
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{:.1}\" r=\"4\" fill=\"{fill}\" stroke=\"{stroke}\" stroke-width=\"1.5\"/>",
            y + row
        );
        text(svg, row, words);
    }
    arrow(svg, [LEGEND - 2.0, y + 138.0], [22.0, 0.0], USED);
    text(svg, 138.0, "found less predicted");
    let _ = writeln!(
        svg,
        "<ellipse cx=\"{x:.1}\" cy=\"{:.1}\" rx=\"10\" ry=\"7\" fill=\"{ELLIPSE}\" fill-opacity=\"0.12\" \
         stroke=\"{ELLIPSE}\"/>",
        y + 164.0
    );
    text(svg, 164.0, "95 % by its accuracy");
    notes(svg, y + 204.0, result);
}

/// How the film lies in the scan: the plot shows the plate and not that.
fn notes(svg: &mut String, y: f64, result: &InteriorResult) {
    let mut lines = vec![format!("plate {} x {} mm", result.format_mm[0], result.format_mm[1])];
    if let Some(lies) = &result.plate_orientation {
        lines.push(format!("turned {}° in the scan,", lies.turn_deg));
        lines.push(format!("{}-reading", lies.reading));
    }
    if let Some([x, y]) = result.transformation.as_ref().map(|fitted| fitted.pixel_size_um) {
        lines.push(format!("pixels {x:.3} x {y:.3} µm"));
    }
    for (line, row) in lines.iter().zip(0..) {
        let at = y + 20.0 * f64::from(row);
        let _ = writeln!(svg, "<text x=\"{LEGEND}\" y=\"{at:.1}\" fill=\"#444\">{}</text>", escaped(line));
    }
}

/// Names come from calibration reports.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
