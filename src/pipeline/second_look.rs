//! A second look at the best solution, from where it would be without some of its control points.
//!
//! A control point that was located wrongly and carries a part of the image alone draws the orientation to itself: its
//! neighbours are then looked for where the wrong orientation has them, and the fit says nothing. From where all others
//! would leave the orientation, they may be found elsewhere. What is likelier in the end is the answer.

use super::assess::{mean_height_m, reliability};
use super::run::{Run, Solution};
use super::{Fault, Stage};
use crate::diagnosis::precision::ground_points;
use crate::diagnosis::sensitivity::change_m;
use crate::orientation::collect::{adjust_with_lines, log_odds};
use crate::orientation::extract::Extraction;
use crate::orientation::predict::Prediction;
use crate::orientation::search::Search;

/// Single control points without which a solution is looked at again, and pairs of them, at most.
const MOST_SINGLE: usize = 4;
const MOST_PAIRS: usize = 4;
/// Those without which the ground moves by less than this share of the tolerance do not matter.
const LEAST_CHANGE: f64 = 0.15;
/// How often this is done, where something better comes out.
const LOOKS: usize = 2;

impl Run<'_> {
    /// What comes out joins the solutions; the likeliest of all is the first.
    pub(super) fn look_again(
        &self,
        search: &Search,
        solutions: &mut Vec<Solution>,
        extraction: &mut Extraction,
    ) -> Result<(), Fault> {
        for _ in 0..LOOKS {
            let Some(best) = solutions.first() else { return Ok(()) };
            let log_odds_before = best.log_odds;
            let mut others = Vec::new();
            for start in self.without_some(search, best, extraction) {
                self.enter(Stage::Adjust, 0.96)?;
                let Some(adjustment) = adjust_with_lines(search, &start, extraction)? else { continue };
                let log_odds = log_odds(search, &adjustment.prediction(), extraction)?;
                others.push(Solution { adjustment, log_odds, ..best.clone() });
            }
            solutions.extend(others);
            solutions.sort_by(|a: &Solution, b| b.log_odds.total_cmp(&a.log_odds));
            if solutions.first().is_none_or(|best| best.log_odds <= log_odds_before) {
                break;
            }
        }
        Ok(())
    }

    /// The predictions of a solution without one or two of its control points, for those that matter most.
    fn without_some(&self, search: &Search, solution: &Solution, extraction: &Extraction) -> Vec<Prediction> {
        let adjustment = &solution.adjustment;
        let height_m = mean_height_m(search.control, adjustment);
        let ground = ground_points(search.camera, &adjustment.orientation, height_m);
        let least_m = LEAST_CHANGE * self.tolerance_m(&adjustment.orientation, height_m);
        let Some(reliability) = reliability(search, extraction, adjustment) else { return Vec::new() };
        let inflation = adjustment.sigma0().max(1.0).powi(2);
        let without = |groups: &[usize]| {
            let sensitivity = reliability.of(groups)?;
            let change_m = change_m(&sensitivity, &ground);
            let orientation = adjustment.orientation.moved(&sensitivity.step);
            let covariance = (adjustment.covariance + sensitivity.added_covariance) * inflation;
            (change_m > least_m).then_some((change_m, Prediction { orientation, covariance }))
        };
        let count = reliability.count();
        let single = (0..count).filter_map(|a| without(&[a])).collect();
        let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b]));
        let pairs = pairs.filter_map(|pair| without(&pair)).collect();
        [strongest(single, MOST_SINGLE), strongest(pairs, MOST_PAIRS)].concat()
    }
}

fn strongest(mut changes: Vec<(f64, Prediction)>, most: usize) -> Vec<Prediction> {
    changes.sort_by(|a, b| b.0.total_cmp(&a.0));
    changes.into_iter().take(most).map(|(_, prediction)| prediction).collect()
}
