//! What decisions cost (Förstner and Läbe 4.1; method 1.7).
//!
//! The captions of the paper's tables 2 and 3 have rows and columns confused: the printed costs come out only if the
//! row is the decision and the column the reality. In the names here the decision comes first: `cw` is accepted though
//! wrong.

/// Counts of decisions against reality.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Confusion {
    /// Accepted and right.
    pub cc: usize,
    /// Accepted though wrong: a false positive.
    pub cw: usize,
    /// Rejected though right: a false negative.
    pub wc: usize,
    /// Rejected and wrong.
    pub ww: usize,
}

/// What each case costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Costs {
    /// Accepted and right.
    pub cc: f64,
    /// Accepted though wrong.
    pub cw: f64,
    /// Rejected though right.
    pub wc: f64,
    /// Rejected and wrong.
    pub ww: f64,
}

/// Those of the paper.
impl Default for Costs {
    fn default() -> Self {
        Self { cc: 0.0, cw: 40.0, wc: 5.0, ww: 10.0 }
    }
}

impl Costs {
    /// The probability of being right from which on it costs less to accept than to reject. Above 1 where accepting never
    /// pays. `None` if rejecting does not pay even where it is certainly wrong, or a cost is not finite.
    #[must_use]
    pub fn least_probability(&self) -> Option<f64> {
        let (of_wrong, of_right) = (self.cw - self.ww, self.wc - self.cc);
        let decides = of_wrong > 0.0 && of_wrong.is_finite() && of_right.is_finite();
        decides.then(|| if of_right > 0.0 { of_wrong / (of_wrong + of_right) } else { f64::INFINITY })
    }

    /// The same if the odds of being wrong may be so many times larger than they are said to be.
    #[must_use]
    pub fn least_probability_with(&self, caution: f64) -> Option<f64> {
        let least = self.least_probability()?;
        // of the odds least / (1 - least)
        Some(if least < 1.0 { caution * least / (1.0 - least + caution * least) } else { least })
    }

    /// The expected cost of rejecting all of a set of which this share is right.
    #[must_use]
    pub fn of_rejecting(&self, right_share: f64) -> f64 {
        self.wc * right_share + self.ww * (1.0 - right_share)
    }
}

impl Confusion {
    /// Counts pairs of decision (accepted) and reality (right).
    #[must_use]
    pub fn of(decisions: impl IntoIterator<Item = (bool, bool)>) -> Self {
        let mut counts = Self::default();
        for (accepted, right) in decisions {
            match (accepted, right) {
                (true, true) => counts.cc += 1,
                (true, false) => counts.cw += 1,
                (false, true) => counts.wc += 1,
                (false, false) => counts.ww += 1,
            }
        }
        counts
    }

    /// All that were decided.
    #[must_use]
    pub fn total(&self) -> usize {
        self.cc + self.cw + self.wc + self.ww
    }

    /// The expected cost of an image, E(C); 0 for none.
    #[must_use]
    pub fn expected_cost(&self, costs: &Costs) -> f64 {
        let of = |count: usize, cost: f64| count as f64 * cost;
        let total = of(self.cc, costs.cc) + of(self.cw, costs.cw) + of(self.wc, costs.wc) + of(self.ww, costs.ww);
        total / self.total().max(1) as f64
    }
}

/// The confusion if all with a score above a threshold are accepted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostPoint {
    /// T_d.
    pub threshold: f64,
    /// What comes out.
    pub confusion: Confusion,
}

/// One point for every threshold that makes a difference, ascending: the first accepts all, the last none. `scored`
/// are pairs of a score and of whether the orientation is right; what has none, or negative infinity, is never accepted.
#[must_use]
pub fn cost_curve(scored: &[(f64, bool)]) -> Vec<CostPoint> {
    let acceptable = |score: f64| score > f64::NEG_INFINITY;
    let mut confusion = Confusion::of(scored.iter().map(|(score, right)| (acceptable(*score), *right)));
    let mut sorted: Vec<(f64, bool)> = scored.iter().copied().filter(|(score, _)| acceptable(*score)).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut curve = vec![CostPoint { threshold: f64::NEG_INFINITY, confusion }];
    for (k, (score, right)) in sorted.iter().enumerate() {
        if *right {
            (confusion.cc, confusion.wc) = (confusion.cc - 1, confusion.wc + 1);
        } else {
            (confusion.cw, confusion.ww) = (confusion.cw - 1, confusion.ww + 1);
        }
        // equal scores share their fate
        if sorted.get(k + 1).is_none_or(|next| next.0 > *score) {
            curve.push(CostPoint { threshold: *score, confusion });
        }
    }
    curve
}

/// The point of a curve with the least expected cost; of several the one with the highest threshold. `None` of an empty
/// curve.
#[must_use]
pub fn cheapest(curve: &[CostPoint], costs: &Costs) -> Option<CostPoint> {
    let cost = |point: &CostPoint| point.confusion.expected_cost(costs);
    curve.iter().copied().min_by(|a, b| cost(a).total_cmp(&cost(b)).then(b.threshold.total_cmp(&a.threshold)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// (cc, cw, wc, ww) with the printed E(C), for T_d = 0, 1, 2, 3 and both exchanges of training and test data.
    const TABLE_2: [([usize; 4], f64); 8] = [
        ([173, 21, 0, 2], 4.39),
        ([172, 17, 1, 6], 3.80),
        ([166, 5, 7, 18], 2.11),
        ([140, 5, 33, 18], 2.78),
        ([233, 7, 0, 0], 1.17),
        ([229, 6, 4, 1], 1.13),
        ([217, 5, 16, 2], 1.25),
        ([172, 0, 61, 7], 1.56),
    ];
    const TABLE_3: [([usize; 4], f64); 8] = [
        ([72, 35, 1, 16], 12.62),
        ([64, 21, 9, 30], 9.55),
        ([45, 10, 28, 41], 7.66),
        ([25, 4, 48, 47], 7.01),
        ([66, 18, 1, 14], 8.74),
        ([55, 9, 12, 23], 6.56),
        ([21, 4, 46, 28], 6.76),
        ([1, 0, 66, 32], 6.56),
    ];

    fn confusion([cc, cw, wc, ww]: [usize; 4]) -> Confusion {
        Confusion { cc, cw, wc, ww }
    }

    #[test]
    fn the_papers_tables_have_the_printed_costs() {
        for (counts, printed) in TABLE_2.into_iter().chain(TABLE_3) {
            let cost = confusion(counts).expected_cost(&Costs::default());
            // some of the printed ones are cut, some rounded
            assert!((cost - printed).abs() < 0.01, "{counts:?}: {cost} instead of {printed}");
        }
        // table 1, in percent, with the cost that the text gives
        assert!((confusion([69, 2, 11, 18]).expected_cost(&Costs::default()) - 3.15).abs() < 1e-9);
        // the average of both exchanges at T_d = 2, over 196 + 240 images
        let both = |k: usize| {
            let images = |counts: [usize; 4]| confusion(counts).total() as f64;
            let total = |counts| confusion(counts).expected_cost(&Costs::default()) * images(counts);
            let (a, b) = (TABLE_2[k].0, TABLE_2[k + 4].0);
            (total(a) + total(b)) / (images(a) + images(b))
        };
        assert!((both(2) - 1.64).abs() < 0.01);
    }

    #[test]
    fn the_captions_confusion_of_rows_and_columns_would_give_other_costs() {
        let transposed = |[cc, cw, wc, ww]: [usize; 4]| confusion([cc, wc, cw, ww]).expected_cost(&Costs::default());
        let close =
            TABLE_2.into_iter().chain(TABLE_3).filter(|(counts, printed)| (transposed(*counts) - printed).abs() < 0.01);
        assert_eq!(close.count(), 0);
    }

    #[test]
    fn accepting_pays_from_six_in_seven_on() {
        assert!((Costs::default().least_probability().unwrap() - 6.0 / 7.0).abs() < 1e-12);
        // at that probability both cost the same
        let costs = Costs::default();
        let accepting = costs.cc * 6.0 / 7.0 + costs.cw / 7.0;
        assert!((accepting - costs.of_rejecting(6.0 / 7.0)).abs() < 1e-12);
        // six to one, and with caution 24 to one
        assert!((costs.least_probability_with(4.0).unwrap() - 24.0 / 25.0).abs() < 1e-12);
        assert_eq!(costs.least_probability_with(1.0), costs.least_probability());
        assert_eq!(Costs { wc: 0.0, ..costs }.least_probability_with(4.0), Some(f64::INFINITY));
        assert_eq!(Costs { wc: 0.0, ..costs }.least_probability(), Some(f64::INFINITY));
        assert_eq!(Costs { cw: 10.0, ..costs }.least_probability(), None);
        assert_eq!(Costs { cw: f64::NAN, ..costs }.least_probability(), None);
    }

    #[test]
    fn a_curve_has_every_decision_that_a_threshold_can_make() {
        let scored =
            [(0.5, true), (-1.0, false), (0.5, false), (2.0, true), (f64::NAN, true), (f64::NEG_INFINITY, false)];
        let curve = cost_curve(&scored);
        let found: Vec<(f64, [usize; 4])> = curve
            .iter()
            .map(|p| (p.threshold, [p.confusion.cc, p.confusion.cw, p.confusion.wc, p.confusion.ww]))
            .collect();
        assert_eq!(found[0], (f64::NEG_INFINITY, [2, 2, 1, 1]));
        assert_eq!(found[1..], [(-1.0, [2, 1, 1, 2]), (0.5, [1, 0, 2, 3]), (2.0, [0, 0, 3, 3])]);
        for point in &curve {
            let by_hand = Confusion::of(scored.iter().map(|(score, right)| (*score > point.threshold, *right)));
            assert_eq!(point.confusion, by_hand);
        }
        // one false positive at 40 against a false negative more at 5
        assert_eq!(cheapest(&curve, &Costs::default()).unwrap().threshold, 0.5);
        assert_eq!(cheapest(&[], &Costs::default()), None);
    }
}
