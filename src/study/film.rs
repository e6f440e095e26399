//! The study of scans of film: what became of the interior orientation of each, and the table of many.

use std::fmt::Write as _;

use nalgebra::Vector2;

use crate::diagnosis::Verdict;
use crate::features::{Picture, PictureError};
use crate::interior::judge::promised_px;
use crate::interior::{InteriorOrientation, Laying, Plate, Wanted, interior_orientation};
use crate::simulation::film::{Corruption, Make, MarkState, ScanSettings, ScanTruth, SimulatedScan};

/// A mark that was found: its error, and the squared error in units of its covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MarkError {
    /// Along columns and rows, from where the mark truly is.
    pub error_px: Vector2<f64>,
    /// Mahalanobis distance, squared.
    pub mahalanobis: f64,
}

/// One scan.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanRow {
    /// Its seed.
    pub seed: u64,
    /// The make of its camera.
    pub make: Make,
    /// Whether its contrast is good.
    pub good: bool,
    /// Whether the plate has an asymmetric feature.
    pub feature: bool,
    /// Whether it has a data strip.
    pub strip: bool,
    /// The traffic light.
    pub verdict: Verdict,
    /// The code of the first reason.
    pub reason: String,
    /// What decided about the laying.
    pub basis: &'static str,
    /// Whether the laying was decided.
    pub decided: bool,
    /// Whether the first laying and the polarity are the true ones.
    pub laying_right: bool,
    /// The largest error of the transformation within the image; infinite without one.
    pub error_px: f64,
    /// What green promises.
    pub promised_px: f64,
    /// The marks that are whole, if the laying is right.
    pub marks: Vec<MarkError>,
    /// Processor time without rendering.
    pub seconds: f64,
}

/// The settings of a seed: those of the mixture; to be spoilt, of a camera with four marks, one of them.
#[must_use]
pub fn settings(seed: u64, corrupt: bool) -> ScanSettings {
    let mut settings = ScanSettings::draw(seed);
    if corrupt {
        let makes = [Make::WildRc5, Make::ZeissRmk, Make::FairchildT11, Make::FairchildK17];
        settings.camera = makes[(seed % 4) as usize];
        // from a hundredth of a millimetre to three, evenly in its logarithm
        let distance_mm = 0.01 * libm::pow(300.0, (seed % 101) as f64 / 100.0);
        let corruption = match seed % 7 {
            0 => Corruption::Covered,
            1 => Corruption::Missing,
            2 => Corruption::Scratched,
            _ => Corruption::shifted(distance_mm, seed),
        };
        settings.corrupt = Some(((seed / 7 % 4) as usize, corruption));
    }
    settings
}

impl ScanRow {
    /// Brings one scan to its plate and holds the result against the truth. `picture` shows `scan`.
    ///
    /// # Errors
    /// [`PictureError`] if the picture fails.
    pub fn of(
        seed: u64,
        settings: &ScanSettings,
        scan: &SimulatedScan,
        picture: &dyn Picture,
    ) -> Result<Self, PictureError> {
        let (truth, plate) = (scan.truth(), scan.plate());
        let pixel_mm = scan.nominal_pixel_um() / 1000.0;
        let found = interior_orientation(picture, plate, &Wanted { pixel_mm: Some(pixel_mm), ..Wanted::default() })?;
        let true_laying = Laying::nearest(&truth.pixel_from_plate.fixed_view::<2, 2>(0, 0).into_owned());
        let laying_right = found.laying() == Some(true_laying) && found.negative == truth.negative;
        let decision = found.decision.as_ref();
        Ok(Self {
            seed,
            make: settings.camera,
            good: settings.scanner.mark_contrast_grey[0] >= GOOD_CONTRAST_GREY,
            feature: settings.asymmetric,
            strip: settings.data_strip.is_some(),
            verdict: found.verdict,
            reason: found.reasons.first().map_or_else(String::new, |reason| reason.code.to_owned()),
            basis: decision.map_or("nothing", |decision| decision.basis.name()),
            decided: decision.is_some_and(|decision| decision.open == 1),
            laying_right,
            error_px: largest_error_px(&found, plate, truth),
            promised_px: promised_px(pixel_mm),
            marks: if laying_right { mark_errors(&found, truth) } else { Vec::new() },
            seconds: 0.0,
        })
    }

    /// Whether the result is what green promises.
    #[must_use]
    pub fn is_right(&self) -> bool {
        self.laying_right && self.error_px <= self.promised_px
    }
}

/// The least contrast of marks, grey values, that is drawn for a good scan.
const GOOD_CONTRAST_GREY: f64 = 60.0;

fn largest_error_px(found: &InteriorOrientation, plate: &Plate, truth: &ScanTruth) -> f64 {
    let Some(transformation) = &found.transformation else { return f64::INFINITY };
    let [width, height] = plate.format_mm;
    let at = [-0.5, 0.0, 0.5];
    let places = at.into_iter().flat_map(|x| at.map(|y| Vector2::new(x * width, y * height)));
    places.map(|place| (transformation.pixel_from_plate(place) - truth.pixel(place)).norm()).fold(0.0, f64::max)
}

fn mark_errors(found: &InteriorOrientation, truth: &ScanTruth) -> Vec<MarkError> {
    let pairs = found.marks.iter().zip(&truth.marks).filter(|(mark, is)| mark.used && is.state == MarkState::Whole);
    let error = |(mark, is): (&crate::interior::MarkResult, &crate::simulation::film::TrueMark)| {
        let error_px = mark.located_px? - is.position_px;
        let mahalanobis = error_px.dot(&(mark.covariance_px2?.try_inverse()? * error_px));
        Some(MarkError { error_px, mahalanobis })
    };
    pairs.filter_map(error).collect()
}

/// What is asked of a scan.
type Is = fn(&ScanRow) -> bool;

/// The table of many scans, in Markdown.
#[must_use]
pub fn table(rows: &[ScanRow]) -> String {
    let mut text = String::from(
        "| scans | number | green and right, % | green and wrong | yellow, % | red, % | laying right, % | laying decided wrongly |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for (contrast, good) in [("good", true), ("poor", false)] {
        let kinds: [(&str, Is); 3] = [
            ("asymmetric feature", |row| row.feature),
            ("data strip", |row| !row.feature && row.strip),
            ("neither", |row| !row.feature && !row.strip),
        ];
        for (kind, is_of) in kinds {
            let of: Vec<&ScanRow> = rows.iter().filter(|row| row.good == good && is_of(row)).collect();
            line(&mut text, &format!("{contrast} contrast, {kind}"), &of);
        }
    }
    line(&mut text, "all", &rows.iter().collect::<Vec<_>>());
    marks(&mut text, rows);
    text
}

fn line(text: &mut String, name: &str, rows: &[&ScanRow]) {
    let count = |is: &dyn Fn(&ScanRow) -> bool| rows.iter().filter(|row| is(row)).count();
    let share = |is: &dyn Fn(&ScanRow) -> bool| 100.0 * count(is) as f64 / rows.len().max(1) as f64;
    let green = |row: &ScanRow| row.verdict == Verdict::Green;
    let _ = writeln!(
        text,
        "| {name} | {} | {:.2} | {} | {:.2} | {:.2} | {:.2} | {} |",
        rows.len(),
        share(&|row| green(row) && row.is_right()),
        count(&|row| green(row) && !row.is_right()),
        share(&|row| row.verdict == Verdict::Yellow),
        share(&|row| row.verdict == Verdict::Red),
        share(&|row| row.laying_right),
        count(&|row| row.decided && !row.laying_right && row.verdict == Verdict::Green),
    );
}

/// How exactly marks are found, by make, at good contrast.
fn marks(text: &mut String, rows: &[ScanRow]) {
    text.push_str(
        "\n| marks at good contrast | number | rms error, px | median squared Mahalanobis distance (1.39 expected) | mean | yellow or red, % |\n\
         |---|---|---|---|---|---|\n",
    );
    let of_makes = Make::ALL.map(|make| (format!("{make:?}"), Some(make)));
    for (name, make) in of_makes.into_iter().chain([("all".to_owned(), None)]) {
        let of: Vec<&ScanRow> = rows.iter().filter(|r| r.good && make.is_none_or(|make| make == r.make)).collect();
        let marks: Vec<&MarkError> = of.iter().flat_map(|row| &row.marks).collect();
        let count = marks.len().max(1) as f64;
        let squares: f64 = marks.iter().map(|mark| mark.error_px.norm_squared() / 2.0).sum();
        let mut distances: Vec<f64> = marks.iter().map(|mark| mark.mahalanobis).collect();
        distances.sort_by(f64::total_cmp);
        let median = distances.get(distances.len() / 2).copied().unwrap_or(0.0);
        let mean = distances.iter().sum::<f64>() / count;
        let doubtful = of.iter().filter(|row| row.verdict != Verdict::Green).count();
        let _ = writeln!(
            text,
            "| {name} | {} | {:.4} | {median:.2} | {mean:.2} | {:.2} |",
            marks.len(),
            (squares / count).sqrt(),
            100.0 * doubtful as f64 / of.len().max(1) as f64,
        );
    }
}

#[cfg(test)]
mod tests {
    use rayon::prelude::*;

    use super::*;

    #[test]
    fn scans_are_brought_to_their_plates_and_nothing_wrong_is_green() {
        let row = |(seed, corrupt): (u64, bool)| {
            let settings = settings(seed, corrupt);
            let scan = SimulatedScan::draw(seed, &settings);
            (corrupt, ScanRow::of(seed, &settings, &scan, &scan).unwrap())
        };
        let drawn: Vec<(u64, bool)> =
            (1..25).map(|seed| (seed, false)).chain((1..9).map(|seed| (seed, true))).collect();
        let rows: Vec<(bool, ScanRow)> = drawn.into_par_iter().map(row).collect();
        for (corrupt, row) in &rows {
            let name = format!("seed {} {corrupt} {:?} {}", row.seed, row.make, row.reason);
            assert!(row.verdict != Verdict::Green || row.is_right(), "{name}: {} px", row.error_px);
        }
        let good: Vec<&ScanRow> =
            rows.iter().filter(|(c, row)| !c && row.good && row.feature).map(|(_, r)| r).collect();
        let green = good.iter().filter(|row| row.verdict == Verdict::Green).count();
        assert!(good.len() >= 5 && green + 1 >= good.len(), "{green} of {}", good.len());
        assert!(good.iter().all(|row| row.laying_right));
    }
}
