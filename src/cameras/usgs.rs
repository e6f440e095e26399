//! The text of a calibration report of the U.S. Geological Survey (SMAC), of a film camera.
//!
//! The reports are printed; this reads their words, whatever the columns: the calibrated focal length, `K0 = …` to `P4 = …`,
//! the principal points and the table of fiducial marks, all in millimetres. The polynomial is the contract's `smac`: it
//! corrects what was measured, and what the report tabulates as distortion is its negative.

use super::{CameraFileError, field};
use crate::geometry::Smac;

/// What a report says of a film camera.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmCalibration {
    /// Type and serial number of the camera.
    pub name: Option<String>,
    /// Calibrated principal distance.
    pub principal_distance_mm: f64,
    /// Principal point of autocollimation in the plate.
    pub principal_point_mm: [f64; 2],
    /// Principal point of symmetry in the plate.
    pub symmetry_point_mm: [f64; 2],
    /// Distortion.
    pub distortion: Smac,
    /// Fiducial marks with their places in the plate.
    pub marks: Vec<(String, [f64; 2])>,
}

/// Marks are that far from the middle of a plate of 230 mm, at least and at most.
const MARK_RANGE_MM: std::ops::RangeInclusive<f64> = 80.0..=170.0;

/// Reads a report.
///
/// # Errors
/// [`CameraFileError::Field`] names what is missing or makes no sense.
pub fn read(text: &str) -> Result<FilmCalibration, CameraFileError> {
    let small = text.to_lowercase();
    let principal_distance_mm =
        after(&small, "calibrated focal length").ok_or_else(|| field("Calibrated Focal Length", "it is missing"))?;
    let point = |names: &[&str]| names.iter().find_map(|name| pair_after(&small, name));
    let of_terms = || Some([term(&small, "xp")?, term(&small, "yp")?]);
    let symmetry = point(&["calibrated principal point", "point of symmetry"]).or_else(of_terms);
    let autocollimation = point(&["principal point of autocollimation", "point of autocollimation", "autocollimation"]);
    let missing = || field("Principal point of autocollimation", "it is missing, and so is that of symmetry");
    let principal_point_mm = autocollimation.or(symmetry).ok_or_else(missing)?;
    let mut distortion = Smac::default();
    let mut any = false;
    for (letter, values) in [('k', distortion.k.as_mut_slice()), ('p', distortion.p.as_mut_slice())] {
        let first = usize::from(letter == 'p');
        for (at, value) in values.iter_mut().enumerate() {
            if let Some(found) = term(&small, &format!("{letter}{}", at + first)) {
                (*value, any) = (found, true);
            }
        }
    }
    if !any {
        return Err(field("K0, K1, …", "there is no coefficient: older reports have a table, which is given by hand"));
    }
    let marks = marks(&small);
    if marks.len() < 2 {
        return Err(field("Fiducial marks", format!("{} are found, of at least 2", marks.len())));
    }
    Ok(FilmCalibration {
        name: name(text),
        principal_distance_mm,
        principal_point_mm,
        symmetry_point_mm: symmetry.unwrap_or(principal_point_mm),
        distortion,
        marks,
    })
}

/// The words of a text from a place on, without colons, equal signs and brackets.
fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c.is_whitespace() || matches!(c, ':' | '=' | '(' | ')' | ',')).filter(|word| !word.is_empty())
}

/// The first number within a few words of a name.
fn after(small: &str, name: &str) -> Option<f64> {
    let start = small.find(name)? + name.len();
    words(&small[start..]).take(6).find_map(finite)
}

/// The two numbers in a line behind a name; the name may also be a heading.
fn pair_after(small: &str, name: &str) -> Option<[f64; 2]> {
    small.match_indices(name).find_map(|(at, _)| {
        let line = small[at + name.len()..].lines().next()?;
        let numbers: Vec<f64> = words(line).filter_map(finite).collect();
        <[f64; 2]>::try_from(numbers).ok()
    })
}

/// The value of `k1 = 0.123e-04`, also written `0.123 x 10-4`.
fn term(small: &str, name: &str) -> Option<f64> {
    small.match_indices(name).find_map(|(at, _)| {
        let alone = !small[..at].ends_with(|c: char| c.is_alphanumeric());
        let rest = small[at + name.len()..].trim_start().strip_prefix(['=', ':'])?;
        let mut rest = words(rest);
        let value = finite(rest.next()?)?;
        let power = match (rest.next(), rest.next()) {
            (Some("x" | "*"), Some(power)) => power.strip_prefix("10")?.trim_start_matches('^').parse().ok()?,
            _ => 0,
        };
        alone.then(|| value * 10_f64.powi(power))
    })
}

fn finite(word: &str) -> Option<f64> {
    // the reports of older Fortran have d for the power
    word.trim_end_matches("mm").replace('d', "e").parse().ok().filter(|value: &f64| value.is_finite())
}

/// Numbers from 1 to 16 that are followed by a place where marks are, behind the words "fiducial marks".
fn marks(small: &str) -> Vec<(String, [f64; 2])> {
    let start = small.find("fiducial marks").map_or(0, |at| at + "fiducial marks".len());
    let mut marks: Vec<(String, [f64; 2])> = Vec::new();
    for line in small[start..].lines() {
        let words: Vec<&str> = words(line).filter(|word| *word != "mm").collect();
        let mut at = 0;
        while let Some(&[name, x, y]) = words.get(at..at + 3) {
            let number = name.trim_end_matches('.').parse::<u32>().ok().filter(|number| (1..=16).contains(number));
            let place = finite(x).zip(finite(y)).filter(|(x, y)| MARK_RANGE_MM.contains(&x.hypot(*y)));
            match (number, place) {
                (Some(number), Some((x, y))) if !marks.iter().any(|(known, _)| *known == number.to_string()) => {
                    marks.push((number.to_string(), [x, y]));
                    at += 3;
                }
                _ => at += 1,
            }
        }
    }
    marks
}

/// "Camera type: Wild RC30 … Camera serial no.: 5123".
fn name(text: &str) -> Option<String> {
    let small = text.to_lowercase();
    // letters whose small form has another length would shift what follows
    let told = |name: &str| {
        let start = small.find(name)? + name.len();
        let rest = text.get(start..)?.trim_start_matches([':', '.', ' ']);
        let end = rest.find("  ").into_iter().chain(rest.find(['\n', '\t'])).min().unwrap_or(rest.len());
        Some(rest[..end].trim().to_owned()).filter(|told| !told.is_empty() && told.len() <= 80)
    };
    let kind = told("camera type");
    let serial = told("camera serial no").or_else(|| told("serial number"));
    match (kind, serial) {
        (Some(kind), Some(serial)) => Some(format!("{kind} {serial}")),
        (kind, serial) => kind.or(serial),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REPORT: &str = include_str!("tests/usgs.txt");

    #[test]
    fn a_report_is_read_to_the_last_mark() {
        let found = read(REPORT).unwrap();
        assert_eq!(found.name.as_deref(), Some("Example Aviogon 153 4711"));
        assert_eq!(found.principal_distance_mm, 152.824);
        assert_eq!(found.principal_point_mm, [0.003, -0.001]);
        assert_eq!(found.symmetry_point_mm, [-0.006, 0.004]);
        assert_eq!(found.distortion.k, [-2.41e-5, 4.21e-9, -1.9e-13, 0.0, 0.0]);
        assert_eq!(found.distortion.p, [1.61e-8, -2.5e-7, 0.0, 0.0]);
        assert_eq!(found.marks.len(), 8);
        assert_eq!(found.marks[0], ("1".to_owned(), [-105.998, -105.997]));
        assert_eq!(found.marks[7], ("8".to_owned(), [0.004, 112.995]));
    }

    #[test]
    fn what_is_missing_is_named() {
        let without_distance = REPORT.replace("Calibrated Focal Length", "…");
        assert!(read(&without_distance).unwrap_err().to_string().contains("Calibrated Focal Length"));
        let without_marks = REPORT.split("Fiducial marks").next().unwrap();
        assert!(read(without_marks).unwrap_err().to_string().contains("Fiducial marks"));
        let without_terms = REPORT.replace(" = ", " ");
        assert!(read(&without_terms).unwrap_err().to_string().contains("K0"));
    }
}
