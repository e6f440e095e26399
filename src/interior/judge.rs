//! The traffic light of an interior orientation (method 1.9; Schickler and Poth, section 5).
//!
//! Green promises two things: the film lies as stated, and no place of the image is farther than
//! a pixel, or 20 micrometres on the film if that is more, from where the transformation has it.

use super::decide::{Basis, Decision};
use super::{InteriorOrientation, MarkResult};
use crate::diagnosis::{Reason, Verdict};

/// What green promises: so many pixels, or so many millimetres if that is more. (Film does not hold its shape to less, so
/// that a finer scan is no more exact.)
const PROMISED: [f64; 2] = [1.0, 0.020];
/// Largest change of any place of the image when a mark is left out, as a share of what is promised: up to this green, up
/// to that yellow.
const CHANGE: [f64; 2] = [0.7, 2.0];
/// Largest standard deviation of any place of the image, as a share of what is promised.
const SIGMA: f64 = 0.35;
/// Films shrink evenly to a few per mille; more, or a shear like this, is no film but a wrong mark.
const DIFFERENCE_OF_SCALES: f64 = 3e-3;
const SHEAR_RAD: f64 = 3e-3;
/// The variance factor beyond which the marks do not fit.
const SIGMA0: f64 = 2.5;

/// How far a place may be from where the transformation has it if the verdict is green.
#[must_use]
pub fn promised_px(pixel_mm: f64) -> f64 {
    PROMISED[0].max(PROMISED[1] / pixel_mm)
}

/// A fault that was found, and the best verdict that it leaves.
struct Finding(Verdict, Reason);

fn finding(verdict: Verdict, code: &'static str, detail: String) -> Finding {
    Finding(verdict, Reason { code, detail })
}

/// The verdict with its reasons, the gravest first.
pub(super) fn judge(found: &InteriorOrientation) -> (Verdict, Vec<Reason>) {
    let mut findings = Vec::new();
    if let Some(decision) = &found.decision {
        findings.extend(of_laying(decision));
    }
    findings.extend(of_marks(found));
    findings.extend(of_precision(found));
    findings.sort_by_key(|Finding(verdict, _)| *verdict);
    let verdict = findings.iter().map(|Finding(verdict, _)| *verdict).min().unwrap_or(Verdict::Green);
    let mut reasons: Vec<Reason> = findings.into_iter().map(|Finding(_, reason)| reason).collect();
    if verdict == Verdict::Green {
        reasons.insert(0, verified(found));
    }
    (verdict, reasons)
}

fn verified(found: &InteriorOrientation) -> Reason {
    let used = found.marks.iter().filter(|mark| mark.used).count();
    let basis = found.decision.as_ref().map_or("", |decision| decision.basis.name());
    let detail = format!(
        "{used} of {} marks agree, and without any one of them no place of the image would move by more than {:.2} px; how \
         the film lies was decided by: {}",
        found.marks.len(),
        found.largest_change_px.unwrap_or(0.0),
        basis.replace('_', " "),
    );
    Reason { code: "verified", detail }
}

fn of_laying(decision: &Decision) -> Option<Finding> {
    if decision.open == 1 && decision.basis != Basis::Nothing {
        return None;
    }
    let layings: Vec<String> = decision.candidates[..decision.open]
        .iter()
        .map(|c| format!("{} degrees{}", c.laying.turn_deg(), if c.laying.mirrored { " mirrored" } else { "" }))
        .collect();
    let detail = format!(
        "the marks allow {} ways in which the film may lie, and nothing tells them apart ({}): give the camera an \
         asymmetric feature or the side of its data strip, or say how the film lies (`quarter_turns`, `reading`)",
        decision.open,
        layings.join(", ")
    );
    Some(finding(Verdict::Yellow, "plate_orientation_ambiguous", detail))
}

fn names<'a>(marks: impl Iterator<Item = &'a MarkResult>) -> String {
    marks.map(|mark| mark.name.as_str()).collect::<Vec<_>>().join(", ")
}

fn of_marks(found: &InteriorOrientation) -> Vec<Finding> {
    let used = found.marks.iter().filter(|mark| mark.used).count();
    let mut findings = Vec::new();
    if found.transformation.is_none() || used < 3 {
        let detail = format!(
            "{used} of {} marks were found to agree, and at least three are needed: check the camera, its templates, and \
             whether the whole film was scanned",
            found.marks.len()
        );
        return vec![finding(Verdict::Red, "marks_not_found", detail)];
    }
    let missing = || found.marks.iter().filter(|mark| !mark.used);
    let count = missing().count();
    if count > 0 {
        let enough = used >= 6;
        let verdict = if enough { Verdict::Green } else { Verdict::Yellow };
        let rest = if enough { "the others check each other" } else { "the others do not check each other well" };
        let detail = format!("{count} marks were not found or do not agree ({}); {rest}", names(missing()));
        findings.push(finding(verdict, "marks_missing", detail));
    }
    let contradicting = || found.marks.iter().filter(|m| m.used && m.sensitivity.is_some_and(|s| s.contradicts));
    if contradicting().count() > 0 {
        let detail = format!(
            "marks contradict the others more than chance explains ({}): one of them, or its calibrated position, is \
             probably wrong",
            names(contradicting())
        );
        findings.push(finding(Verdict::Yellow, "marks_contradict", detail));
    }
    findings
}

fn of_precision(found: &InteriorOrientation) -> Vec<Finding> {
    let Some(transformation) = &found.transformation else { return Vec::new() };
    let mut findings = Vec::new();
    let promised_px = promised_px(found.pixel_mm);
    let [change_px, hopeless_px] = CHANGE.map(|share| share * promised_px);
    let sigma_px = SIGMA * promised_px;
    match found.largest_change_px {
        None => {
            let detail = "the marks only just determine the transformation: nothing would show that one is wrong";
            findings.push(finding(Verdict::Yellow, "unchecked", detail.to_owned()));
        }
        Some(change) if change > change_px => {
            let verdict = if change > hopeless_px { Verdict::Red } else { Verdict::Yellow };
            let detail = format!(
                "places of the image may move by up to {change:.2} px if one mark is left out ({change_px:.2} at most are \
                 wanted)"
            );
            findings.push(finding(verdict, "depends_on_one_mark", detail));
        }
        Some(_) => {}
    }
    if found.largest_sigma_px > sigma_px {
        let detail = format!(
            "the transformation is known to {:.2} px (standard deviation) in the worst place of the image, \
             {sigma_px:.2} px is wanted",
            found.largest_sigma_px
        );
        findings.push(finding(Verdict::Yellow, "imprecise", detail));
    }
    let sigma0 = transformation.sigma0();
    if transformation.redundancy > 0 && sigma0 > SIGMA0 {
        let detail = format!("the marks fit {sigma0:.1} times worse than they were measured and calibrated");
        findings.push(finding(Verdict::Yellow, "marks_do_not_fit", detail));
    }
    let ([x, y], shear_rad) = transformation.shape();
    if (x / y - 1.0).abs() > DIFFERENCE_OF_SCALES || shear_rad.abs() > SHEAR_RAD {
        let detail = format!(
            "the film would be stretched by {:.2} % in one direction and sheared by {:.2} mrad, which films are not: a mark \
             is probably wrong",
            100.0 * (x / y - 1.0),
            1e3 * shear_rad
        );
        findings.push(finding(Verdict::Yellow, "implausible_deformation", detail));
    }
    findings
}
