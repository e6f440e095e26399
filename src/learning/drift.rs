//! Have the images changed since the training?
//!
//! For each feature the population stability index between the training and recent images: over the bins between
//! the tenths of the training, the sum of (recent - former share) log(recent / former share). Below 0.1 nothing has changed,
//! above 0.25 a classifier should be trained anew (the usual reading in credit scoring, where the index comes from).

/// Bins.
const BINS: usize = 10;
/// An index above this says that a classifier should be trained anew.
pub const DRIFTED: f64 = 0.25;

/// How a feature was distributed in the training.
#[derive(Debug, Clone, PartialEq)]
pub struct Distribution {
    /// Where bins end, ascending: the tenths of the training, equal ones once.
    pub edges: Vec<f64>,
    /// The share of the training in each bin, one more than edges.
    pub shares: Vec<f64>,
}

impl Distribution {
    /// Of the values in a training; `None` of too few.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        if sorted.len() < BINS {
            return None;
        }
        let mut edges: Vec<f64> = (1..BINS).map(|k| sorted[k * sorted.len() / BINS]).collect();
        edges.dedup();
        let shares = shares(&edges, &sorted);
        Some(Self { edges, shares })
    }

    /// The population stability index of recent values; `None` if there are fewer than ten a bin.
    #[must_use]
    pub fn index(&self, recent: &[f64]) -> Option<f64> {
        if recent.len() < 10 * BINS || self.shares.len() != self.edges.len() + 1 {
            return None;
        }
        // half an image more in each bin of both, so that an empty one is no infinity
        let half = 0.5 / recent.len() as f64;
        let pairs = self.shares.iter().zip(shares(&self.edges, recent));
        Some(pairs.map(|(was, is)| (is - was) * ((is + half) / (was + half)).ln()).sum())
    }
}

fn shares(edges: &[f64], values: &[f64]) -> Vec<f64> {
    let mut counts = vec![0.0; edges.len() + 1];
    for value in values {
        counts[edges.partition_point(|edge| edge < value)] += 1.0;
    }
    counts.iter().map(|count| count / values.len().max(1) as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    fn normal(seed: u64, count: usize, shift: f64) -> Vec<f64> {
        let mut draws = Draws::new(seed);
        (0..count).map(|_| draws.normal() + shift).collect()
    }

    #[test]
    fn the_same_distribution_has_not_drifted_and_a_shifted_one_has() {
        let before = Distribution::of(&normal(91, 5000, 0.0)).unwrap();
        assert!(before.index(&normal(92, 1000, 0.0)).unwrap() < 0.05);
        let shifted = before.index(&normal(93, 5000, 1.0)).unwrap();
        // of two normal distributions the index is about the square of the shift
        assert!(shifted > 0.8 && shifted < 1.1, "{shifted}");
        assert!(shifted > DRIFTED);
    }

    #[test]
    fn values_that_are_nearly_always_the_same_are_one_bin() {
        let mut values = vec![0.0; 900];
        values.extend(normal(94, 100, 5.0));
        let before = Distribution::of(&values).unwrap();
        assert!(before.index(&values).unwrap().abs() < 0.05);
    }

    #[test]
    fn few_values_say_nothing() {
        let before = Distribution::of(&normal(95, 100, 0.0)).unwrap();
        assert_eq!(before.index(&normal(96, 99, 0.0)), None);
        assert_eq!(Distribution::of(&[1.0; 9]), None);
        assert_eq!(Distribution { edges: vec![], shares: vec![] }.index(&[0.0; 100]), None);
    }
}
