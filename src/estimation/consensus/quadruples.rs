//! Version A: all quadruples, eight at a time.

use super::eight::{EightOrientations, PointLanes, PriorLanes, Triangle, solve};
use super::lanes::{Lanes, WIDTH};
use super::sample::Sample;
use super::{Consensus, Guarantee, LEAST_POINTS, MOST_POINTS, Survey};
use crate::estimation::resection::equations;
use crate::estimation::{NormalEquations, PointObservation, Resection};
use crate::geometry::ExteriorOrientation;

/// Quadruples are given up if their robust sum after the first step exceeds the best by this factor: what one
/// linearisation gets wrong does not decide there.
const HOPELESS: f64 = 1.5;
/// A robust sum is computed anew if it is below the best times the first of these where the eight have come to rest,
/// times the second where they have not: then residuals may still change by a few tenths of their size.
const ROUNDING: f64 = 1.001;
const UNFINISHED: f64 = 1.1;

/// Version A: the orientation by four points whose robust sum `min(e², t²)` over all points is the smallest, among
/// the quadruples that are `acceptable`; then that by all points with a residual below `tolerance_px`, t. (The pull of
/// a prior goes unpunished: the sum is over the points.) Where there are more than forty points, the quadruples are
/// drawn from the first forty, and where there are more quadruples than `most`, every second or third is tried, and so
/// on: the result is `sampled` then.
///
/// `None` if fewer than four points agree, none of the quadruples is acceptable, or the search is `cancelled`.
#[must_use]
pub fn quadruples(
    survey: &Survey,
    acceptable: &dyn Fn(&Resection) -> bool,
    tolerance_px: f64,
    most: usize,
    cancelled: &dyn Fn() -> bool,
) -> Option<Consensus> {
    let from = survey.points.len().min(MOST_POINTS);
    let stride = fours(from).count().div_ceil(most.max(1)).max(1);
    let mut search = Search {
        survey,
        prior: survey.prior.map(PriorLanes::new),
        acceptable,
        tolerance_px,
        start: Start::new(survey, &survey.start),
        best: None,
        sample: Sample::default(),
    };
    let (mut eight, mut filled, mut subsets) = ([[0; LEAST_POINTS]; WIDTH], 0, 0);
    for chosen in fours(from).step_by(stride) {
        search.sample.hear(&chosen, None);
        eight[filled] = chosen;
        filled += 1;
        subsets += 1;
        if filled == WIDTH {
            if cancelled() {
                return None;
            }
            search.try_eight(&eight, filled);
            filled = 0;
        }
    }
    if filled > 0 {
        search.try_eight(&eight, filled);
    }
    let (_, orientation) = search.best?;
    let below_tolerance =
        |index: &usize| survey.squared_px(&survey.points[*index], &orientation) < tolerance_px.powi(2);
    let inliers: Vec<usize> = (0..survey.points.len()).filter(below_tolerance).collect();
    if inliers.len() < LEAST_POINTS {
        return None;
    }
    let resection = survey.resect(&inliers, &orientation)?;
    let guarantee = if stride == 1 && from == survey.points.len() { Guarantee::Complete } else { Guarantee::Sampled };
    Some(Consensus { resection, inliers, guarantee, subsets, examined: search.sample.into_sets() })
}

/// All subsets of four of the indices below `count`, in lexical order.
fn fours(count: usize) -> impl Iterator<Item = [usize; LEAST_POINTS]> {
    let pairs = move |from: usize| (from..count).flat_map(move |i| (i + 1..count).map(move |j| [i, j]));
    pairs(0).flat_map(move |[i, j]| pairs(j + 1).map(move |[k, l]| [i, j, k, l]))
}

struct Search<'a> {
    survey: &'a Survey<'a>,
    prior: Option<PriorLanes>,
    acceptable: &'a dyn Fn(&Resection) -> bool,
    tolerance_px: f64,
    start: Start,
    /// The smallest robust sum with its orientation.
    best: Option<(f64, ExteriorOrientation)>,
    sample: Sample,
}

impl Search<'_> {
    /// Eight quadruples side by side; what seems better than the best so far is computed once more on its own.
    fn try_eight(&mut self, eight: &[[usize; LEAST_POINTS]; WIDTH], filled: usize) {
        let bound = self.bound();
        let step = self.start.step(eight);
        let Some(sums) = self.start.robust_sums(&step, self.tolerance_px, HOPELESS * bound) else { return };
        let wanted = sums.0.map(|sum| sum < HOPELESS * bound);
        let points = std::array::from_fn(|place| {
            PointLanes::new(std::array::from_fn(|lane| &self.survey.points[eight[lane][place]]))
        });
        let mut orientations = self.start.eight;
        orientations.take(&step);
        let at_rest = orientations.resect::<LEAST_POINTS>(&points, self.prior.as_ref(), &wanted);
        let Some(sums) = self.robust_sums(&orientations, UNFINISHED * bound) else { return };
        for lane in 0..filled {
            let margin = if at_rest[lane] { ROUNDING } else { UNFINISHED };
            if sums.0[lane] < margin * self.bound() {
                self.try_one(&eight[lane], &orientations.one(lane));
            }
        }
    }

    fn try_one(&mut self, chosen: &[usize], near: &ExteriorOrientation) {
        let Some(trial) = self.survey.resect(chosen, near).filter(|trial| (self.acceptable)(trial)) else { return };
        let most = self.tolerance_px.powi(2);
        let sum: f64 =
            self.survey.points.iter().map(|point| self.survey.squared_px(point, &trial.orientation).min(most)).sum();
        if sum < self.bound() {
            self.best = Some((sum, trial.orientation));
            self.start = Start::new(self.survey, &trial.orientation);
        }
    }

    fn bound(&self) -> f64 {
        self.best.as_ref().map_or(f64::INFINITY, |(sum, _)| *sum)
    }

    /// The sums of `min(e², t²)`; `None` as soon as none of them is below `bound`.
    fn robust_sums(&self, at: &EightOrientations, bound: f64) -> Option<Lanes> {
        sum_up(self.survey.points.iter().map(at.squared_residuals_px()), self.tolerance_px.powi(2), bound)
    }
}

/// The sums of what is at most `most` each; `None` as soon as none of them is below `bound`.
#[inline(always)]
fn sum_up(squared_px: impl Iterator<Item = Lanes>, most: f64, bound: f64) -> Option<Lanes> {
    let mut sums = Lanes::ZERO;
    for squared in squared_px {
        sums = sums.with(squared, |sum, squared| sum + if squared < most { squared } else { most });
        if sums.0.iter().fold(true, |hopeless, sum| hopeless & (*sum >= bound)) {
            return None;
        }
    }
    Some(sums)
}

/// Where all quadruples start from, and all points linearised there: the best orientation so far.
struct Start {
    eight: EightOrientations,
    points: Vec<Linearised>,
    prior: [f64; ELEMENTS],
}

/// Elements of the upper triangle of six normal equations with their right-hand side.
const ELEMENTS: usize = 27;

struct Linearised {
    /// Six derivatives and the misclosure of both coordinates, in pixels.
    rows_px: [[f64; 7]; 2],
    /// Weighted normal equations.
    normal: [f64; ELEMENTS],
}

impl Start {
    fn new(survey: &Survey, at: &ExteriorOrientation) -> Self {
        let c = survey.principal_distance_px;
        let linearised = |point: &PointObservation| {
            let normal = equations(std::slice::from_ref(point), None, at, c);
            let rows_px = at.reduced_px_with_jacobian(c, point.object_m).map(|(image, jacobian)| {
                let misclosure = point.image_px - image;
                [0, 1].map(|r| std::array::from_fn(|k| if k < 6 { jacobian[(r, k)] } else { misclosure[r] }))
            });
            // what has no image makes what is not a number of all it takes part in
            Linearised {
                rows_px: rows_px.unwrap_or([[f64::NAN; 7]; 2]),
                normal: normal.map_or([f64::NAN; ELEMENTS], |normal| elements(&normal)),
            }
        };
        Self {
            eight: EightOrientations::all(at, c),
            points: survey.points.iter().map(linearised).collect(),
            prior: equations(&[], survey.prior, at, c).map_or([f64::NAN; ELEMENTS], |prior| elements(&prior)),
        }
    }

    /// The first step of each of the eight.
    fn step(&self, eight: &[[usize; LEAST_POINTS]; WIDTH]) -> [Lanes; 6] {
        let mut triangle: Triangle = [[Lanes::ZERO; 7]; 6];
        for (lane, four) in eight.iter().enumerate() {
            let [a, b, c, d] = four.map(|index| &self.points[index].normal);
            let mut sum = self.prior;
            for k in 0..ELEMENTS {
                sum[k] += a[k] + b[k] + c[k] + d[k];
            }
            let mut elements = sum.iter();
            for row in 0..6 {
                for (to, from) in triangle[row][row..].iter_mut().zip(&mut elements) {
                    to.0[lane] = *from;
                }
            }
        }
        solve(&mut triangle)
    }

    /// The sums of `min(e², t²)` after a step, as linearised; `None` as soon as none of them is below `bound`.
    fn robust_sums(&self, step: &[Lanes; 6], tolerance_px: f64, bound: f64) -> Option<Lanes> {
        let squared_px = |point: &Linearised| {
            let [x, y] = point.rows_px.each_ref().map(|row| {
                let mut residual = Lanes::all(row[6]);
                for k in 0..6 {
                    residual = residual - Lanes::all(row[k]) * step[k];
                }
                residual
            });
            x * x + y * y
        };
        sum_up(self.points.iter().map(squared_px), tolerance_px.powi(2), bound)
    }
}

fn elements(normal: &NormalEquations) -> [f64; ELEMENTS] {
    let mut elements = [0.0; ELEMENTS];
    let triangle = (0..6).flat_map(|row| (row..7).map(move |column| (row, column)));
    for (element, (row, column)) in elements.iter_mut().zip(triangle) {
        *element = if column < 6 { normal.matrix[(row, column)] } else { normal.right_side[row] };
    }
    elements
}
