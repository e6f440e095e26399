//! How a classifier does on labelled images: confusion tables over T_d, the cost curve, the calibration.

use serde::{Deserialize, Serialize};

use crate::learning::{Bin, Confusion, CostPoint, Costs, bins, calibration_error, cheapest, cost_curve};

/// What is known of a classifier's decisions on images that it was not trained on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Evaluation {
    /// Images.
    pub images: usize,
    /// Those of them whose orientation is right.
    pub right: usize,
    /// Confusion tables over the threshold T_d, ascending: at most a few hundred.
    pub curve: Vec<CurvePoint>,
    /// Bins of equal count of the probability, and what share of them is right.
    pub bins: Vec<CalibrationBin>,
    /// The mean distance of predicted and observed shares.
    pub calibration_error: f64,
}

/// The confusion at a threshold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvePoint {
    /// T_d; left out where all are accepted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub threshold: Option<f64>,
    /// Accepted and right.
    pub cc: usize,
    /// Accepted though wrong.
    pub cw: usize,
    /// Rejected though right.
    pub wc: usize,
    /// Rejected and wrong.
    pub ww: usize,
}

/// Images of similar probability.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationBin {
    /// Their mean probability.
    pub predicted: f64,
    /// The share that is right.
    pub observed: f64,
    /// Images in it.
    pub images: usize,
    /// In 99.9 % of all cases the share is in this interval, if the probabilities are honest.
    pub interval: [f64; 2],
}

/// A judged image: its score, the probability that belongs to it, and whether it is right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scored {
    /// Negative infinity for what is never accepted.
    pub score: f64,
    /// Of being right.
    pub probability: f64,
    /// Whether it is.
    pub right: bool,
}

/// Points of a curve that are kept.
const MOST_POINTS: usize = 300;
/// Bins of the calibration.
const BINS: usize = 10;

impl Evaluation {
    /// Of judged images.
    #[must_use]
    pub fn of(scored: &[Scored]) -> Self {
        let pairs: Vec<(f64, bool)> = scored.iter().map(|s| (s.score, s.right)).collect();
        let predicted: Vec<(f64, bool)> = scored.iter().map(|s| (s.probability, s.right)).collect();
        let bins = bins(&predicted, BINS);
        Self {
            images: scored.len(),
            right: scored.iter().filter(|s| s.right).count(),
            curve: thinned(&cost_curve(&pairs)),
            calibration_error: calibration_error(&bins),
            bins: bins.iter().map(CalibrationBin::from).collect(),
        }
    }

    /// The confusion at a threshold, of the points that were kept the nearest one that does not accept more.
    #[must_use]
    pub fn confusion(&self, threshold: f64) -> Confusion {
        let at = |point: &CurvePoint| point.threshold.unwrap_or(f64::NEG_INFINITY);
        let first = self.curve.iter().find(|point| at(point) >= threshold).or(self.curve.last());
        first.map_or(Confusion::default(), CurvePoint::confusion)
    }

    /// The point with the least expected cost.
    #[must_use]
    pub fn cheapest(&self, costs: &Costs) -> Option<CurvePoint> {
        let points: Vec<CostPoint> = self.curve.iter().map(CostPoint::from).collect();
        cheapest(&points, costs).as_ref().map(CurvePoint::from)
    }
}

impl CurvePoint {
    /// Its counts.
    #[must_use]
    pub fn confusion(&self) -> Confusion {
        Confusion { cc: self.cc, cw: self.cw, wc: self.wc, ww: self.ww }
    }
}

impl From<&CostPoint> for CurvePoint {
    fn from(point: &CostPoint) -> Self {
        let Confusion { cc, cw, wc, ww } = point.confusion;
        Self { threshold: Some(point.threshold).filter(|threshold| threshold.is_finite()), cc, cw, wc, ww }
    }
}

impl From<&CurvePoint> for CostPoint {
    fn from(point: &CurvePoint) -> Self {
        Self { threshold: point.threshold.unwrap_or(f64::NEG_INFINITY), confusion: point.confusion() }
    }
}

impl From<&Bin> for CalibrationBin {
    fn from(bin: &Bin) -> Self {
        Self { predicted: bin.predicted, observed: bin.observed, images: bin.images, interval: bin.interval }
    }
}

impl CalibrationBin {
    /// Whether the observed share is within its interval.
    #[must_use]
    pub fn is_honest(&self) -> bool {
        (self.interval[0]..=self.interval[1]).contains(&self.observed)
    }
}

/// Of a curve the points where a wrong image is rejected, which are all that can be cheapest, and of these evenly so
/// many as are kept; the first and the last stay.
fn thinned(curve: &[CostPoint]) -> Vec<CurvePoint> {
    let differs = |k: usize| k == 0 || k + 1 == curve.len() || curve[k].confusion.cw != curve[k - 1].confusion.cw;
    let telling: Vec<&CostPoint> = (0..curve.len()).filter(|k| differs(*k)).map(|k| &curve[k]).collect();
    let stride = telling.len().div_ceil(MOST_POINTS).max(1);
    // the end of the curve, where few wrong ones are left, is the interesting one
    let last = telling.len().saturating_sub(1);
    let kept = telling.iter().enumerate().filter(|(k, _)| *k == 0 || (last - k).is_multiple_of(stride));
    kept.map(|(_, point)| CurvePoint::from(*point)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scored(count: usize) -> Vec<Scored> {
        // the probability rises with the score, and one image in 50 of the best is wrong
        let one = |k: usize| {
            let score = k as f64 / count as f64;
            Scored {
                score,
                probability: 0.2 + 0.78 * score,
                right: !k.is_multiple_of(50) && k * 37 % count < k + count / 5,
            }
        };
        (0..count).map(one).collect()
    }

    #[test]
    fn confusions_are_those_of_the_images() {
        let images = scored(500);
        let evaluation = Evaluation::of(&images);
        assert_eq!((evaluation.images, evaluation.right), (500, images.iter().filter(|s| s.right).count()));
        for point in evaluation.curve.iter().filter(|point| point.threshold.is_some()) {
            let threshold = point.threshold.unwrap();
            let by_hand = Confusion::of(images.iter().map(|s| (s.score > threshold, s.right)));
            assert_eq!(point.confusion(), by_hand);
            assert_eq!(evaluation.confusion(threshold), by_hand);
        }
        assert_eq!(evaluation.bins.len(), 10);
        // no threshold is cheaper than the cheapest, also among those that were not kept
        let costs = Costs::default();
        let least = evaluation.cheapest(&costs).unwrap().confusion().expected_cost(&costs);
        for threshold in images.iter().map(|s| s.score) {
            let confusion = Confusion::of(images.iter().map(|s| (s.score > threshold, s.right)));
            assert!(confusion.expected_cost(&costs) >= least - 1e-9);
        }
    }

    #[test]
    fn long_curves_are_thinned_and_what_is_never_accepted_stays_rejected() {
        let mut images = scored(20_000);
        images.push(Scored { score: f64::NEG_INFINITY, probability: 0.0, right: false });
        let evaluation = Evaluation::of(&images);
        assert!(evaluation.curve.len() <= MOST_POINTS + 2, "{}", evaluation.curve.len());
        assert_eq!(evaluation.confusion(f64::INFINITY).total(), 20_001);
        assert_eq!(evaluation.confusion(f64::INFINITY).cc, 0);
        let text = serde_json::to_string(&evaluation).unwrap();
        assert_eq!(serde_json::from_str::<Evaluation>(&text).unwrap().curve, evaluation.curve);
    }
}
