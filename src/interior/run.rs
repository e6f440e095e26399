//! One scan from its pixels to its verdict.

use nalgebra::{Matrix2, Vector2};

use super::consensus::{Bounds, Candidate, Similarity, agreement};
use super::decide::{Basis, Decision, Hypothesis, decide};
use super::judge::judge;
use super::laying::Laying;
use super::measure::{BLURS_PX, Measured, Measurement};
use super::plate::Plate;
use super::search::{Expectation, Finding, FirstLook, Search};
use super::sensitivity::{pairs, sensitivity};
use super::symmetry::{Group, groups, permutation};
use super::transformation::{Kind, Observation, Transformation};
use super::{InteriorOrientation, MarkResult, PairSensitivity, Wanted};
use crate::diagnosis::Verdict;
use crate::features::{Picture, PictureError};

/// What the film does to a mark beside the transformation, each coordinate.
pub const SIGMA_FILM_MM: f64 = 0.002;
/// How far a mark may be from a similarity through the others: films shrink by some hundredths of a per cent.
const TOLERANCE_MM: f64 = 0.12;
/// A mark that was not where it was first thought is looked for within this of where the others have it.
const SECOND_REACH_MM: f64 = 0.15;
/// And must be as like its template as this share of the others'.
const LEAST_SHARE_OF_RHO: f64 = 0.6;
/// A coefficient at full resolution below this is no mark.
const LEAST_RHO: f64 = 0.12;
/// Marks that must be left when one that contradicts is left out.
const LEAST_LEFT: usize = 5;
/// The film may be laid on the scanner so far off, and turned so much; where nothing is found, so much.
const NEAR: ([f64; 2], f64) = ([3.5, 0.045], 0.004);
const FAR: ([f64; 2], f64) = ([8.0, 0.18], 0.03);
/// The templates' turns in the wider search.
const TURNS_RAD: [f64; 5] = [0.0, -0.07, 0.07, -0.14, 0.14];
/// Without a stated pixel: what the scan shows beyond the image on each side, and by how much that may be wrong.
const RIM_MM: f64 = 7.0;
const SCALE_UNKNOWN: f64 = 0.06;
/// A stated pixel makes the scan so large, compared with one of the image and its rim; else it is not believed.
const PLAUSIBLE_SIZE: std::ops::RangeInclusive<f64> = 0.8..=2.0;

/// Finds the interior orientation of a scan.
///
/// # Errors
/// [`PictureError`] if the scan cannot be read. (Marks that are not found are a red verdict.)
pub fn interior_orientation(
    picture: &dyn Picture,
    plate: &Plate,
    wanted: &Wanted,
) -> Result<InteriorOrientation, PictureError> {
    let size_px = picture.size_px();
    let longest = f64::from(size_px[0].max(size_px[1]).max(1));
    let longest_mm = plate.format_mm[0].max(plate.format_mm[1]) + 2.0 * RIM_MM;
    // what a file states may mean nothing, as 300 dpi often does
    let could_be = |pixel_mm: &f64| PLAUSIBLE_SIZE.contains(&(pixel_mm * longest / longest_mm));
    let stated = wanted.pixel_mm.filter(could_be);
    let pixel_mm = stated.unwrap_or(longest_mm / longest);
    let expectation = |([offset_mm, rotation_rad], scale): ([f64; 2], f64)| {
        let scale = if stated.is_some() { scale } else { SCALE_UNKNOWN };
        Expectation { pixel_mm, scale, offset_mm, rotation_rad }
    };
    let groups = groups(plate);
    let mut search = Search::new(picture, plate, expectation(NEAR));
    let mut found = best_finding(&mut search, &groups, wanted, &TURNS_RAD[..1])?;
    let enough = (plate.fiducials.len() / 2 + 1).max(3);
    if found.as_ref().is_none_or(|found| found.count() < enough) {
        search = Search::new(picture, plate, expectation(FAR));
        let wider = best_finding(&mut search, &groups, wanted, &TURNS_RAD)?;
        let count = |finding: &Option<Finding>| finding.as_ref().map_or(0, Finding::count);
        if count(&wider) > count(&found) {
            found = wider;
        }
    }
    let Some(found) = found else { return Ok(nothing(plate, pixel_mm)) };
    let group = groups.iter().find(|group| group.iter().any(|(laying, _)| *laying == found.laying));
    oriented(&search, group.unwrap_or(&groups[0]), &found, wanted)
}

/// The group of layings whose marks fit best.
fn best_finding(
    search: &mut Search,
    groups: &[Group],
    wanted: &Wanted,
    turns: &[f64],
) -> Result<Option<Finding>, PictureError> {
    let mut best: Option<FirstLook> = None;
    for group in groups {
        let Some((laying, _)) = group.iter().find(|(laying, _)| is_possible(*laying, wanted)) else { continue };
        for turn in turns {
            let look = search.look(*laying, *turn)?;
            if look.is_some_and(|look| best.is_none_or(|best| look.score > best.score)) {
                best = look;
            }
        }
    }
    best.map(|best| search.look_closer(&best)).transpose()
}

fn is_possible(laying: Laying, wanted: &Wanted) -> bool {
    wanted.mirrored.is_none_or(|mirrored| mirrored == laying.mirrored)
        && wanted.quarter_turns.is_none_or(|turns| turns % 4 == laying.quarter_turns)
}

fn nothing(plate: &Plate, pixel_mm: f64) -> InteriorOrientation {
    let mut empty = InteriorOrientation {
        pixel_mm,
        negative: false,
        decision: None,
        transformation: None,
        marks: plate.fiducials.iter().map(|f| MarkResult::blank(&f.name, f.position_mm)).collect(),
        pairs: Vec::new(),
        largest_change_px: None,
        largest_undetected_px: None,
        largest_sigma_px: f64::INFINITY,
        verdict: Verdict::Red,
        reasons: Vec::new(),
    };
    (empty.verdict, empty.reasons) = judge(&empty);
    empty
}

impl MarkResult {
    fn blank(name: &str, plate_mm: Vector2<f64>) -> Self {
        Self {
            name: name.to_owned(),
            plate_mm,
            predicted_px: None,
            located_px: None,
            covariance_px2: None,
            correlation: None,
            used: false,
            residual_mm: None,
            sensitivity: None,
        }
    }
}

/// Measures the marks, decides about the laying, adjusts and judges.
fn oriented(
    search: &Search,
    group: &Group,
    found: &Finding,
    wanted: &Wanted,
) -> Result<InteriorOrientation, PictureError> {
    let (plate, pixel_mm) = (search.plate, search.expectation.pixel_mm);
    let measured = measured(search, found)?;
    let (hypotheses, others_exist) = hypotheses(search, group, found, &measured, wanted);
    let Some(best) = hypotheses.iter().min_by(|a, b| a.squares.total_cmp(&b.squares)) else {
        return Ok(nothing(plate, pixel_mm));
    };
    let used = measured.iter().flatten().count();
    let redundancy = (2 * used).saturating_sub(wanted.kind.parameters()).max(1);
    let mut decision = decide(search, &hypotheses, best.squares / redundancy as f64, found.negative)?;
    if decision.basis == Basis::Marks && others_exist {
        decision.basis = Basis::Stated;
    }
    let laying = decision.candidates[0].laying;
    // the place of each mark under the laying that was decided upon
    let order = permutation(group, laying, found.laying).unwrap_or_else(|| (0..measured.len()).collect());
    let measured: Vec<Option<Measured>> = order.iter().map(|index| measured[*index]).collect();
    Ok(adjusted(plate, pixel_mm, decision, found.negative, &measured, wanted.kind))
}

impl InteriorOrientation {
    /// The same marks under another of the layings that its decision has left open, without a look at the scan; `None` if
    /// the marks do not look alike under both.
    pub(crate) fn under(&self, plate: &Plate, laying: Laying, kind: Kind) -> Option<Self> {
        let (present, decision) = self.laying().zip(self.decision.as_ref())?;
        let candidate = decision.candidates.iter().find(|candidate| candidate.laying == laying)?;
        let group = groups(plate).into_iter().find_map(|group| permutation(&group, laying, present));
        let measured = |mark: &MarkResult| {
            let (at_px, covariance_px2) = mark.located_px.zip(mark.covariance_px2)?;
            Some(Measured { at_px, covariance_px2, rho: mark.correlation? })
        };
        let measured: Vec<Option<Measured>> = group?.iter().map(|index| measured(&self.marks[*index])).collect();
        let decision = Decision { candidates: vec![*candidate], open: 1, basis: Basis::Stated, test: None };
        Some(adjusted(plate, self.pixel_mm, decision, self.negative, &measured, kind))
    }
}

/// The layings that the marks allow and nobody has excluded; and whether somebody has.
fn hypotheses(
    search: &Search,
    group: &Group,
    found: &Finding,
    measured: &[Option<Measured>],
    wanted: &Wanted,
) -> (Vec<Hypothesis>, bool) {
    let mut hypotheses = Vec::new();
    for laying in group.iter().map(|(laying, _)| *laying).filter(|laying| is_possible(*laying, wanted)) {
        let Some(order) = permutation(group, laying, found.laying) else { continue };
        let seen: Vec<Option<Measured>> = order.iter().map(|index| measured[*index]).collect();
        let observations = observations(search.plate, search.expectation.pixel_mm, &seen);
        let observations: Vec<Observation> = observations.into_iter().map(|(_, o)| o).collect();
        let Some(similarity) = through(search, laying, &seen) else { continue };
        let squares = Transformation::fit(wanted.kind, laying.mirrored, &observations).map_or(0.0, |fit| fit.squares);
        hypotheses.push(Hypothesis { laying, similarity, squares });
    }
    let excluded = hypotheses.len() < group.len();
    (hypotheses, excluded)
}

/// The similarity through all measured marks.
fn through(search: &Search, laying: Laying, seen: &[Option<Measured>]) -> Option<Similarity> {
    let (places, candidates) = as_candidates(search.plate, seen);
    Some(agreement(&places, &candidates, &loose(search, laying), f64::INFINITY)?.similarity)
}

/// No more than the laying is asked of it.
fn loose(search: &Search, laying: Laying) -> Bounds {
    let px_per_mm = 1.0 / search.expectation.pixel_mm;
    Bounds { axes: laying.axes(), px_per_mm, scale: 0.5, rotation_rad: 0.5 }
}

fn as_candidates(plate: &Plate, seen: &[Option<Measured>]) -> (Vec<Vector2<f64>>, Vec<Vec<Candidate>>) {
    let places = plate.fiducials.iter().map(|fiducial| fiducial.position_mm).collect();
    let candidate = |m: Measured| Candidate { at_px: m.at_px, rho: m.rho };
    (places, seen.iter().map(|m| m.map(candidate).into_iter().collect()).collect())
}

/// The marks that were measured, with their indices.
fn observations(plate: &Plate, pixel_mm: f64, seen: &[Option<Measured>]) -> Vec<(usize, Observation)> {
    let px_per_mm = 1.0 / pixel_mm;
    let one = |(index, measured): (usize, &Option<Measured>)| {
        let measured = (*measured)?;
        let fiducial = &plate.fiducials[index];
        let model_px2 = (fiducial.sigma_mm.powi(2) + SIGMA_FILM_MM.powi(2)) * px_per_mm.powi(2);
        let covariance_px2 = measured.covariance_px2 + Matrix2::identity() * model_px2;
        Some((index, Observation { plate_mm: fiducial.position_mm, image_px: measured.at_px, covariance_px2 }))
    };
    seen.iter().enumerate().filter_map(one).collect()
}

/// The marks at full resolution, of which those that agree; the others once more where these predict them.
fn measured(search: &Search, found: &Finding) -> Result<Vec<Option<Measured>>, PictureError> {
    let plate = search.plate;
    let begin = |mark: usize, at_px| {
        let fiducial = &plate.fiducials[mark];
        Measurement::about(search.picture, fiducial, &found.similarity, at_px, found.negative)
    };
    let mut started: Vec<Option<Measurement>> = Vec::new();
    for (mark, candidate) in found.marks.iter().enumerate() {
        started.push(match candidate {
            Some(candidate) => {
                let mut measurement = begin(mark, candidate.at_px)?;
                measurement.climb(BLURS_PX[1]).map(|()| measurement)
            }
            None => None,
        });
    }
    let blur_px = blur(started.iter().flatten());
    let mut measured: Vec<Option<Measured>> =
        started.iter_mut().map(|m| m.as_mut()?.settle(blur_px).filter(|m| m.rho > LEAST_RHO)).collect();
    // which of them agree, and where they predict the others
    let tolerance_px = TOLERANCE_MM / search.expectation.pixel_mm;
    let (places, candidates) = as_candidates(plate, &measured);
    let Some(agreed) = agreement(&places, &candidates, &loose(search, found.laying), tolerance_px) else {
        return Ok(vec![None; measured.len()]);
    };
    let mut rhos: Vec<f64> = Vec::new();
    for (mark, chosen) in measured.iter_mut().zip(&agreed.chosen) {
        if chosen.is_none() {
            *mark = None;
        }
        rhos.extend(mark.map(|m| m.rho));
    }
    rhos.sort_by(f64::total_cmp);
    let least_rho = LEAST_SHARE_OF_RHO * rhos.get(rhos.len() / 2).copied().unwrap_or(1.0);
    for mark in 0..measured.len() {
        if measured[mark].is_none() && agreed.count() >= 2 {
            let predicted = agreed.similarity.apply(places[mark]);
            let mut measurement = begin(mark, predicted)?;
            let reach = (SECOND_REACH_MM / search.expectation.pixel_mm).ceil() as usize;
            let again = measurement.sweep(blur_px, reach.min(7)).and_then(|()| measurement.climb(blur_px));
            let again = again.and_then(|()| measurement.settle(blur_px));
            measured[mark] = again.filter(|m| m.rho > least_rho && (m.at_px - predicted).norm() < tolerance_px);
        }
    }
    Ok(measured)
}

/// The blur under which the mark that is seen best looks most as it should.
fn blur<'a>(marks: impl Iterator<Item = &'a Measurement<'a>>) -> f64 {
    let seen: Vec<(f64, &Measurement)> = marks.filter_map(|m| Some((m.likeness(BLURS_PX[1])?, m))).collect();
    let Some((likeness, best)) = seen.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { return BLURS_PX[1] };
    let mut chosen = (likeness, BLURS_PX[1]);
    for blur_px in BLURS_PX {
        if let Some(likeness) = best.likeness(blur_px).filter(|likeness| *likeness > chosen.0) {
            chosen = (likeness, blur_px);
        }
    }
    chosen.1
}

/// The transformation, how it depends on the marks, and the verdict.
fn adjusted(
    plate: &Plate,
    pixel_mm: f64,
    decision: Decision,
    negative: bool,
    measured: &[Option<Measured>],
    kind: Kind,
) -> InteriorOrientation {
    let mut result = nothing(plate, pixel_mm);
    let mirrored = decision.candidates[0].laying.mirrored;
    result.negative = negative;
    result.decision = Some(decision);
    for (mark, measured) in result.marks.iter_mut().zip(measured) {
        mark.located_px = measured.map(|m| m.at_px);
        mark.covariance_px2 = measured.map(|m| m.covariance_px2);
        mark.correlation = measured.map(|m| m.rho);
    }
    let observed = kept(kind, mirrored, observations(plate, pixel_mm, measured));
    let used: Vec<Observation> = observed.iter().map(|(_, observation)| *observation).collect();
    let Some(transformation) = Transformation::fit(kind, mirrored, &used) else {
        (result.verdict, result.reasons) = judge(&result);
        return result;
    };
    result.largest_sigma_px = largest_sigma_px(&transformation, plate);
    let mut largest = Some([0.0_f64; 2]);
    for (group, (mark, _)) in observed.iter().enumerate() {
        let found = sensitivity(&transformation, mirrored, &used, &[group]);
        result.marks[*mark].used = true;
        result.marks[*mark].sensitivity = found;
        largest = largest.zip(found).map(|([a, b], s)| [a.max(s.empirical), b.max(s.theoretical)]);
    }
    // the transformation may be less precise than the marks alone say
    let sigma_px = result.largest_sigma_px * transformation.sigma0().max(1.0);
    result.largest_change_px = largest.map(|[empirical, _]| empirical * result.largest_sigma_px);
    result.largest_undetected_px = largest.map(|[_, theoretical]| theoretical * result.largest_sigma_px);
    result.largest_sigma_px = sigma_px;
    result.pairs = pair_sensitivities(&transformation, mirrored, &observed);
    for mark in &mut result.marks {
        let predicted = transformation.pixel_from_plate(mark.plate_mm);
        mark.predicted_px = Some(predicted);
        mark.residual_mm = mark.located_px.and_then(|at| {
            let step = 1.0;
            let axis = |unit: Vector2<f64>| transformation.pixel_from_plate(mark.plate_mm + step * unit) - predicted;
            let linear = Matrix2::from_columns(&[axis(Vector2::x()), axis(Vector2::y())]);
            Some(linear.try_inverse()? * (at - predicted))
        });
    }
    result.transformation = Some(transformation);
    (result.verdict, result.reasons) = judge(&result);
    result
}

/// The marks without those that contradict the others, as long as enough are left to tell which these are.
fn kept(kind: Kind, mirrored: bool, observed: Vec<(usize, Observation)>) -> Vec<(usize, Observation)> {
    let mut observed = observed;
    while observed.len() > LEAST_LEFT {
        let used: Vec<Observation> = observed.iter().map(|(_, observation)| *observation).collect();
        let Some(whole) = Transformation::fit(kind, mirrored, &used) else { break };
        let tests = (0..used.len()).filter_map(|group| Some((group, sensitivity(&whole, mirrored, &used, &[group])?)));
        let worst = tests.max_by(|(_, a), (_, b)| a.test.total_cmp(&b.test));
        match worst {
            Some((group, worst)) if worst.contradicts => {
                observed.remove(group);
            }
            _ => break,
        }
    }
    observed
}

/// The worst standard deviation within the image: at its corners and the middles of its sides.
fn largest_sigma_px(transformation: &Transformation, plate: &Plate) -> f64 {
    let [width, height] = plate.format_mm;
    let places =
        [-0.5, 0.0, 0.5].into_iter().flat_map(|x| [-0.5, 0.0, 0.5].map(|y| Vector2::new(x * width, y * height)));
    let sigma = |place| transformation.covariance_px2(place).symmetric_eigenvalues().max().max(0.0).sqrt();
    places.map(sigma).fold(0.0, f64::max)
}

fn pair_sensitivities(
    transformation: &Transformation,
    mirrored: bool,
    observed: &[(usize, Observation)],
) -> Vec<PairSensitivity> {
    let used: Vec<Observation> = observed.iter().map(|(_, observation)| *observation).collect();
    let similarity = Transformation::fit(Kind::Similarity, mirrored, &used);
    let one = |pair: [usize; 2]| {
        let marks = pair.map(|group| observed[group].0);
        let wanted = sensitivity(transformation, mirrored, &used, &pair);
        match (wanted, &similarity) {
            (None, Some(similarity)) => PairSensitivity {
                marks,
                kind: Kind::Similarity,
                sensitivity: sensitivity(similarity, mirrored, &used, &pair),
            },
            (found, _) => PairSensitivity { marks, kind: transformation.kind, sensitivity: found },
        }
    };
    pairs(used.len()).map(one).collect()
}
