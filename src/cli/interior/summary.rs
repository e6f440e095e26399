//! An interior orientation for people at a terminal.

use std::fmt::Write as _;

use crate::jobs::interior::{PixelSizeOrigin, PreparedInterior};
use crate::report::InteriorResult;
use crate::report::interior::MarkReport;

use crate::cli::orient::summary::{DIM, RESET, colour};

/// The verdict and why, then how the film lies, the transformation, and the marks.
pub(super) fn summary(prepared: &PreparedInterior, result: &InteriorResult, colours: bool) -> String {
    let mut text = String::new();
    let paint = |code: &'static str| if colours { code } else { "" };
    let verdict = &result.diagnosis.verdict;
    let _ = writeln!(text, "{}{}{}", paint(colour(verdict)), verdict.to_uppercase(), paint(RESET));
    for reason in &result.diagnosis.reasons {
        let _ = writeln!(text, "  {} {}({}){}", reason.detail, paint(DIM), reason.code, paint(RESET));
    }
    film(&mut text, prepared, result);
    marks(&mut text, result);
    text.trim_end().to_owned()
}

fn film(text: &mut String, prepared: &PreparedInterior, result: &InteriorResult) {
    let stated = match prepared.pixel_size_from {
        PixelSizeOrigin::Request => "as given",
        PixelSizeOrigin::File => "by the file's resolution",
        PixelSizeOrigin::Unknown => "as if the film filled the scan",
    };
    let _ = writeln!(text, "\nPixels of about {:.2} µm ({stated})", result.pixel_size_um);
    if let (Some(lies), Some(polarity)) = (&result.plate_orientation, &result.polarity) {
        let basis = lies.decided_by.replace('_', " ");
        let _ = writeln!(
            text,
            "The film lies turned by {}° counter-clockwise, {}-reading (decided by: {basis}); it is a {polarity}",
            lies.turn_deg, lies.reading
        );
    }
    let Some(fitted) = &result.transformation else {
        let _ = writeln!(text, "No transformation was found.");
        return;
    };
    let [x, y] = fitted.pixel_size_um;
    let _ = writeln!(
        text,
        "{}, pixels of {x:.3} x {y:.3} µm, shear {:.2} mrad; sigma0 {:.2}, redundancy {}",
        fitted.kind, fitted.shear_mrad, fitted.sigma0, fitted.redundancy
    );
    let px = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |px| format!("{px:.2}"));
    let precision = &result.precision;
    let _ = writeln!(
        text,
        "In the worst place of the image: sigma {} px; {} px without one mark, {} px by an error that nothing shows",
        px(precision.largest_sigma_px),
        px(precision.largest_change_px),
        px(precision.largest_undetected_px)
    );
}

fn marks(text: &mut String, result: &InteriorResult) {
    let used = result.marks.iter().filter(|mark| mark.used).count();
    let _ = writeln!(text, "\n{} marks, {used} used", result.marks.len());
    let width = result.marks.iter().map(|mark| mark.name.chars().count()).max().unwrap_or(0).max(4);
    let _ = writeln!(
        text,
        "  {:<width$}  {:>19}  {:>15}  {:>11}  {:>5}",
        "mark", "found at, px", "residual, µm", "correlation", "T"
    );
    for mark in &result.marks {
        let _ = writeln!(text, "  {:<width$}  {}", mark.name, line(mark));
    }
    if let Some(rms) = result.transformation.as_ref().and_then(|fitted| fitted.rms_residual_um) {
        let _ = writeln!(text, "Root mean square residual {rms:.1} µm");
    }
}

fn line(mark: &MarkReport) -> String {
    let pair = |value: Option<[f64; 2]>, width: usize, digits: usize| match value {
        Some([x, y]) => format!("{x:>width$.digits$} {y:>width$.digits$}"),
        None => format!("{:>both$}", "-", both = 2 * width + 1),
    };
    let number = |value: Option<f64>, width: usize| {
        value.map_or_else(|| format!("{:>width$}", "-"), |value| format!("{value:>width$.2}"))
    };
    let state = match (mark.used, mark.located_px) {
        (true, _) => "",
        (false, Some(_)) => "  not used",
        (false, None) => "  not found",
    };
    format!(
        "{}  {}  {}  {}{state}",
        pair(mark.located_px, 9, 2),
        pair(mark.residual_um, 7, 1),
        number(mark.correlation, 11),
        number(mark.sensitivity.as_ref().map(|s| s.test), 5)
    )
}
