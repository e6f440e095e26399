//! From scores to probabilities, and whether these are honest.
//!
//! Scores of images that took no part in the training, with their labels, are pooled until the share of right ones rises
//! with the score (isotonic regression; pool adjacent violators). Between the pools the log odds are interpolated: a pool
//! may hold half of the images, and what lies at its upper end is better than what lies at its lower.

/// A rising function from scores to probabilities.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    steps: Vec<Step>,
}

/// A pool of images with neighbouring scores.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Their mean score.
    pub score: f64,
    /// The probability of being right there.
    pub probability: f64,
    /// Images in it.
    pub images: usize,
}

impl Calibration {
    /// Of scores with labels; `None` if there is no finite score. No probability is 0 or 1: half an image of each kind
    /// is added to every step (Jeffreys' prior).
    #[must_use]
    pub fn of(scored: &[(f64, bool)]) -> Option<Self> {
        let mut sorted: Vec<(f64, bool)> = scored.iter().copied().filter(|(score, _)| score.is_finite()).collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut pools: Vec<Pool> = Vec::new();
        for of_score in sorted.chunk_by(|a, b| a.0 == b.0) {
            let right = of_score.iter().filter(|(_, right)| *right).count();
            let images = of_score.len();
            let mut pool = Pool { sum: of_score[0].0 * images as f64, right, images };
            while let Some(last) = pools.pop_if(|last| last.share() >= pool.share()) {
                pool.sum += last.sum;
                pool.right += last.right;
                pool.images += last.images;
            }
            pools.push(pool);
        }
        let mut steps: Vec<Step> = Vec::with_capacity(pools.len());
        for pool in pools {
            let probability = (pool.right as f64 + 0.5) / (pool.images as f64 + 1.0);
            // the added halves may have turned the order of small steps
            let least = steps.last().map_or(0.0, |step| step.probability);
            let score = pool.sum / pool.images as f64;
            steps.push(Step { score, probability: probability.max(least), images: pool.images });
        }
        (!steps.is_empty()).then_some(Self { steps })
    }

    /// Of steps that were kept; `None` unless they ascend, with probabilities between 0 and 1.
    #[must_use]
    pub fn of_steps(steps: Vec<Step>) -> Option<Self> {
        let sound = |step: &Step| step.score.is_finite() && step.probability > 0.0 && step.probability < 1.0;
        let ascend =
            steps.windows(2).all(|two| two[0].score < two[1].score && two[0].probability <= two[1].probability);
        (!steps.is_empty() && steps.iter().all(sound) && ascend).then_some(Self { steps })
    }

    /// The steps, ascending.
    #[must_use]
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// The probability of being right at a score; below all steps and for what is not a number that of the lowest step.
    #[must_use]
    pub fn probability(&self, score: f64) -> f64 {
        let above = self.steps.partition_point(|step| step.score <= score);
        match (above.checked_sub(1).map(|below| self.steps[below]), self.steps.get(above)) {
            (Some(below), Some(above)) => {
                let share = (score - below.score) / (above.score - below.score);
                let log_odds = (1.0 - share) * below.log_odds() + share * above.log_odds();
                // no more than rounding beyond its neighbours
                (1.0 / (1.0 + (-log_odds).exp())).clamp(below.probability, above.probability)
            }
            (Some(last), None) => last.probability,
            (None, _) => self.steps[0].probability,
        }
    }

    /// The lowest score whose probability is at least this: negative infinity if that of every score is, `None` if there
    /// is none.
    #[must_use]
    pub fn least_score(&self, probability: f64) -> Option<f64> {
        let above = self.steps.iter().position(|step| step.probability >= probability)?;
        let Some(below) = above.checked_sub(1) else { return Some(f64::NEG_INFINITY) };
        let (below, above) = (self.steps[below], self.steps[above]);
        let wanted = (probability / (1.0 - probability)).ln();
        let share = (wanted - below.log_odds()) / (above.log_odds() - below.log_odds());
        Some(below.score + share.clamp(0.0, 1.0) * (above.score - below.score))
    }
}

impl Step {
    fn log_odds(&self) -> f64 {
        (self.probability / (1.0 - self.probability)).ln()
    }
}

struct Pool {
    /// Of the scores.
    sum: f64,
    right: usize,
    images: usize,
}

impl Pool {
    fn share(&self) -> f64 {
        self.right as f64 / self.images as f64
    }
}

/// Images of similar probability, and how many of them are right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// Their mean probability.
    pub predicted: f64,
    /// The share that is right.
    pub observed: f64,
    /// Images in it.
    pub images: usize,
    /// What the share is in 99.9 % of all cases if the probabilities are honest.
    pub interval: [f64; 2],
}

impl Bin {
    /// Whether the share is within its interval.
    #[must_use]
    pub fn is_honest(&self) -> bool {
        (self.interval[0]..=self.interval[1]).contains(&self.observed)
    }
}

/// Bins of equal count, in the order of the probability. Pairs of a probability and of whether it was right.
#[must_use]
pub fn bins(predicted: &[(f64, bool)], count: usize) -> Vec<Bin> {
    let mut sorted: Vec<(f64, bool)> = predicted.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let edge = |k: usize| k * sorted.len() / count.max(1);
    let filled = (0..count).map(|k| &sorted[edge(k)..edge(k + 1)]).filter(|of_bin| !of_bin.is_empty());
    filled.map(bin).collect()
}

/// The mean distance of predicted and observed shares, weighted by the number of images.
#[must_use]
pub fn calibration_error(bins: &[Bin]) -> f64 {
    let images: usize = bins.iter().map(|bin| bin.images).sum();
    let sum: f64 = bins.iter().map(|bin| bin.images as f64 * (bin.predicted - bin.observed).abs()).sum();
    sum / images.max(1) as f64
}

fn bin(of_bin: &[(f64, bool)]) -> Bin {
    let images = of_bin.len();
    let predicted = of_bin.iter().map(|(probability, _)| probability).sum::<f64>() / images as f64;
    let observed = of_bin.iter().filter(|(_, right)| *right).count() as f64 / images as f64;
    let probabilities: Vec<f64> = of_bin.iter().map(|(probability, _)| *probability).collect();
    Bin { predicted, observed, images, interval: interval(&probabilities).map(|count| count / images as f64) }
}

/// Probability on each side outside an interval of 99.9 %.
const TAIL: f64 = 0.0005;

/// Bounds of the number of right ones that is exceeded to either side with a probability of at most [`TAIL`]: the
/// distribution of a sum of independent trials, each with its own probability, by convolution.
fn interval(probabilities: &[f64]) -> [f64; 2] {
    let mut distribution = vec![1.0];
    for p in probabilities {
        distribution.push(0.0);
        for k in (0..distribution.len()).rev() {
            let from_below = if k > 0 { distribution[k - 1] * p } else { 0.0 };
            distribution[k] = distribution[k] * (1.0 - p) + from_below;
        }
    }
    let (mut below, mut low) = (0.0, 0);
    while low < probabilities.len() && below + distribution[low] <= TAIL {
        below += distribution[low];
        low += 1;
    }
    let (mut above, mut high) = (0.0, probabilities.len());
    while high > low && above + distribution[high] <= TAIL {
        above += distribution[high];
        high -= 1;
    }
    [low as f64, high as f64]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;
    use crate::learning::costs::{Confusion, Costs, cheapest, cost_curve};

    /// Scores whose probability of being right is a steep function of them.
    fn scored(seed: u64, count: usize) -> Vec<(f64, bool)> {
        let mut draws = Draws::new(seed);
        let mut one = || {
            let score = 3.0 + 2.0 * draws.normal();
            (score, draws.even(0.0, 1.0) < 1.0 / (1.0 + (-1.5 * score).exp()))
        };
        (0..count).map(|_| one()).collect()
    }

    #[test]
    fn probabilities_rise_and_are_near_those_that_made_the_labels() {
        let calibration = Calibration::of(&scored(81, 20_000)).unwrap();
        for score in [-1.0, 0.0, 1.0, 2.0, 5.0] {
            let truth = 1.0 / (1.0 + (-1.5_f64 * score).exp());
            let found = calibration.probability(score);
            assert!((found - truth).abs() < 0.05, "{score}: {found} instead of {truth}");
        }
        assert!(calibration.steps().windows(2).all(|two| two[0].probability <= two[1].probability));
        assert!(calibration.steps().iter().all(|step| step.probability > 0.0 && step.probability < 1.0));
        assert_eq!(calibration.probability(f64::NEG_INFINITY), calibration.steps()[0].probability);
        assert_eq!(calibration.probability(f64::NAN), calibration.steps()[0].probability);
    }

    #[test]
    fn pools_are_those_of_isotonic_regression() {
        let scored = [(1.0, false), (2.0, true), (3.0, false), (4.0, true), (5.0, true), (5.0, false)];
        let calibration = Calibration::of(&scored).unwrap();
        // 0; then 1, 0 pooled to a half; then 1 and the two at 5 pooled to two thirds
        let steps: Vec<(f64, usize)> = calibration.steps().iter().map(|step| (step.score, step.images)).collect();
        assert_eq!(steps, [(1.0, 1), (2.5, 2), (14.0 / 3.0, 3)]);
        assert!((calibration.probability(14.0 / 3.0) - 2.5 / 4.0).abs() < 1e-12);
        // half-way between a half and five eighths, in log odds
        let between = calibration.probability((2.5 + 14.0 / 3.0) / 2.0);
        assert!((between / (1.0 - between) - (5.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(Calibration::of(&[(f64::NEG_INFINITY, true)]), None);
    }

    #[test]
    fn the_lowest_score_of_a_probability_has_it() {
        let calibration = Calibration::of(&scored(85, 3000)).unwrap();
        for probability in [0.2, 0.5, 6.0 / 7.0, 0.95, 0.99] {
            let score = calibration.least_score(probability).unwrap();
            assert!((calibration.probability(score) - probability).abs() < 1e-9);
            assert!(calibration.probability(score - 0.01) < probability);
        }
        assert_eq!(calibration.least_score(0.0), Some(f64::NEG_INFINITY));
    }

    #[test]
    fn the_threshold_of_a_probability_is_as_cheap_as_any() {
        let (costs, scored) = (Costs::default(), scored(82, 5000));
        let calibration = Calibration::of(&scored).unwrap();
        let threshold = calibration.least_score(costs.least_probability().unwrap()).unwrap();
        let cost =
            Confusion::of(scored.iter().map(|(score, right)| (*score >= threshold, *right))).expected_cost(&costs);
        let least = cheapest(&cost_curve(&scored), &costs).unwrap().confusion.expected_cost(&costs);
        assert!(cost <= least + 0.03, "{cost} instead of {least}");
        assert_eq!(calibration.least_score(0.999_999), None);
    }

    #[test]
    fn honest_probabilities_fill_honest_bins_and_others_do_not() {
        let calibration = Calibration::of(&scored(83, 20_000)).unwrap();
        let judged = |shift: f64| {
            let of_one = |(score, right): (f64, bool)| (calibration.probability(score + shift), right);
            bins(&scored(84, 10_000).into_iter().map(of_one).collect::<Vec<_>>(), 10)
        };
        let honest = judged(0.0);
        assert_eq!(honest.len(), 10);
        assert!(honest.iter().all(|bin| bin.images == 1000 && bin.is_honest()), "{honest:?}");
        assert!(calibration_error(&honest) < 0.02);
        let boasting = judged(1.0);
        assert!(boasting.iter().filter(|bin| !bin.is_honest()).count() > 3);
        assert!(calibration_error(&boasting) > 2.0 * calibration_error(&honest));
    }

    #[test]
    fn intervals_are_those_of_the_binomial_distribution() {
        // binomial with n = 10 and p = 0.5: P(0) = 1/1024 > 0.0005
        assert_eq!(interval(&[0.5; 10]), [0.0, 10.0]);
        // n = 20, p = 0.5: P(X <= 2) = 0.0002, P(X <= 3) = 0.0013
        assert_eq!(interval(&[0.5; 20]), [3.0, 17.0]);
        // n = 1000, p = 0.999: P(X <= 994) = 0.0006 as of Poisson, so 994 is inside
        let [low, high] = interval(&[0.999; 1000]);
        assert!((994.0..=995.0).contains(&low) && high == 1000.0);
        assert_eq!(bins(&[], 10), []);
    }

    #[test]
    fn steps_that_were_kept_must_make_sense() {
        let step = |score: f64, probability: f64| Step { score, probability, images: 5 };
        assert!(Calibration::of_steps(vec![step(0.0, 0.2), step(1.0, 0.9)]).is_some());
        for damaged in [
            vec![],
            vec![step(0.0, 0.9), step(1.0, 0.2)],
            vec![step(1.0, 0.2), step(0.0, 0.9)],
            vec![step(0.0, 1.0)],
            vec![step(f64::NAN, 0.5)],
        ] {
            assert_eq!(Calibration::of_steps(damaged), None);
        }
    }
}
