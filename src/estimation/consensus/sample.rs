//! A bounded selection of the sets that a search has examined, for learning from them afterwards: the best by residual,
//! and a draw of all, the same in every run.

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};

/// Sets of each kind.
const KEPT: usize = 32;

/// The selection while the search goes on.
#[derive(Debug, Default)]
pub(super) struct Sample {
    best: BinaryHeap<Kept>,
    drawn: BinaryHeap<Kept>,
    examined: u64,
}

/// A set with the number by which it is kept: the smaller the better.
#[derive(Debug)]
struct Kept {
    rank: f64,
    points: Vec<usize>,
}

impl Sample {
    /// Hears of an examined set of points; `variance_factor` of its fit, where it was computed.
    pub(super) fn hear(&mut self, points: &[usize], variance_factor: Option<f64>) {
        self.examined += 1;
        keep(&mut self.drawn, even(self.examined), points);
        if let Some(factor) = variance_factor {
            keep(&mut self.best, factor, points);
        }
    }

    /// Hears what another search over the same points has selected.
    pub(super) fn hear_all(&mut self, others: &[Vec<usize>]) {
        others.iter().for_each(|points| self.hear(points, None));
    }

    /// The selected sets, each once and with its points in ascending order.
    pub(super) fn into_sets(self) -> Vec<Vec<usize>> {
        let sets = self.best.into_iter().chain(self.drawn).map(|kept| {
            let mut points = kept.points;
            points.sort_unstable();
            points
        });
        sets.collect::<BTreeSet<_>>().into_iter().collect()
    }
}

fn keep(heap: &mut BinaryHeap<Kept>, rank: f64, points: &[usize]) {
    let rank = if rank.is_nan() { f64::INFINITY } else { rank };
    let full = heap.len() >= KEPT;
    if full && heap.peek().is_some_and(|worst| rank >= worst.rank) {
        return;
    }
    if full {
        heap.pop();
    }
    heap.push(Kept { rank, points: points.to_vec() });
}

/// Evenly distributed numbers between 0 and 1, one for each count (SplitMix64): those with the smallest are a draw.
fn even(count: u64) -> f64 {
    let mut bits = count.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

impl Ord for Kept {
    fn cmp(&self, other: &Self) -> Ordering {
        self.rank.total_cmp(&other.rank)
    }
}

impl PartialOrd for Kept {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Kept {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Kept {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_are_kept_and_an_even_draw_of_all() {
        let mut sample = Sample::default();
        for k in 0..10_000_usize {
            sample.hear(&[k], Some(((k + 5000) % 10_000) as f64));
        }
        let sets: Vec<usize> = sample.into_sets().into_iter().flatten().collect();
        // the residuals are the smallest from 5000 on
        assert!((5000..5032).all(|k| sets.contains(&k)));
        let drawn: Vec<usize> = sets.into_iter().filter(|k| !(5000..5032).contains(k)).collect();
        assert!(drawn.len() > 28 && drawn.len() <= KEPT);
        // an even draw has its mean at 5000, with a standard deviation of 510
        let mean = drawn.iter().sum::<usize>() as f64 / drawn.len() as f64;
        assert!((mean - 5000.0).abs() < 3.0 * 510.0, "{mean}");
    }

    #[test]
    fn few_sets_are_all_kept_once() {
        let mut sample = Sample::default();
        sample.hear(&[3, 1], Some(1.0));
        sample.hear(&[1, 3], None);
        sample.hear_all(&[vec![2, 4]]);
        assert_eq!(sample.into_sets(), [vec![1, 3], vec![2, 4]]);
    }

    #[test]
    fn what_is_not_a_number_is_worse_than_all_others() {
        let mut sample = Sample::default();
        (0..100).for_each(|k| sample.hear(&[k], Some(if k < 50 { f64::NAN } else { k as f64 })));
        let sets: Vec<usize> = sample.into_sets().into_iter().flatten().collect();
        assert!((50..82).all(|k| sets.contains(&k)));
    }
}
