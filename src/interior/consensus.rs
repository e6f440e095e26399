//! Which candidates of which marks agree: all pairs are tried, each predicts all other marks (Schickler and Poth, section
//! 4.5: a complete search, since the marks are few).

use nalgebra::{Complex, Matrix2, Vector2};

/// Where a mark may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    pub(super) at_px: Vector2<f64>,
    /// Correlation coefficient, positive in the film's own polarity.
    pub(super) rho: f64,
}

/// From the plate to the scan by shift, turn and scale, on top of a laying.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Similarity {
    /// Directions of the plate's axes for the laying.
    axes: Matrix2<f64>,
    /// Scale and turn.
    factor: Complex<f64>,
    shift_px: Vector2<f64>,
}

/// A mark in the plate (millimetres) and in the scan (pixels).
type Pair = (Vector2<f64>, Vector2<f64>);

/// What is known of the similarity beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub(super) axes: Matrix2<f64>,
    pub(super) px_per_mm: f64,
    /// Largest relative error of that.
    pub(super) scale: f64,
    /// Largest turn beyond the laying's.
    pub(super) rotation_rad: f64,
}

/// The best similarity and what agrees with it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Agreement {
    pub(super) similarity: Similarity,
    /// The candidate of each mark that agrees.
    pub(super) chosen: Vec<Option<usize>>,
    /// Sum of their coefficients.
    pub(super) score: f64,
    squares_px2: f64,
}

/// So much of the score do residuals cost that are as large as they may be.
const PRICE_OF_RESIDUALS: f64 = 0.1;

impl Similarity {
    pub(super) fn new(axes: Matrix2<f64>, px_per_mm: f64, rotation_rad: f64, shift_px: Vector2<f64>) -> Self {
        Self { axes, factor: Complex::from_polar(px_per_mm, rotation_rad), shift_px }
    }

    /// The pixel of a point of the plate.
    pub(super) fn apply(&self, plate_mm: Vector2<f64>) -> Vector2<f64> {
        self.linear() * plate_mm + self.shift_px
    }

    /// Pixels from millimetres, without the shift.
    pub(super) fn linear(&self) -> Matrix2<f64> {
        Matrix2::new(self.factor.re, -self.factor.im, self.factor.im, self.factor.re) * self.axes
    }

    /// Through two or more marks, by least squares.
    fn through(axes: Matrix2<f64>, pairs: &[Pair]) -> Option<Self> {
        let count = pairs.len() as f64;
        let plate = pairs.iter().map(|(plate, _)| plate).sum::<Vector2<f64>>() / count;
        let image = pairs.iter().map(|(_, image)| image).sum::<Vector2<f64>>() / count;
        let complex = |v: Vector2<f64>| Complex::new(v.x, v.y);
        let (mut product, mut squares) = (Complex::new(0.0, 0.0), 0.0);
        for (p, q) in pairs {
            let from = complex(axes * (p - plate));
            product += complex(q - image) * from.conj();
            squares += from.norm_sqr();
        }
        if squares <= 0.0 {
            return None;
        }
        let mut found = Self { axes, factor: product / squares, shift_px: Vector2::zeros() };
        found.shift_px = image - found.apply(plate);
        Some(found)
    }

    fn is_within(&self, bounds: &Bounds) -> bool {
        let (scale, rotation) = (self.factor.norm(), self.factor.arg());
        (scale / bounds.px_per_mm - 1.0).abs() <= bounds.scale && rotation.abs() <= bounds.rotation_rad
    }
}

/// The similarity with which the most, and the most alike, agree within a tolerance; `None` if no two do.
pub(super) fn agreement(
    plate_mm: &[Vector2<f64>],
    candidates: &[Vec<Candidate>],
    bounds: &Bounds,
    tolerance_px: f64,
) -> Option<Agreement> {
    let mut best: Option<Agreement> = None;
    let consider = |similarity: Similarity| agreeing(plate_mm, candidates, similarity, tolerance_px);
    for a in 0..plate_mm.len() {
        for b in a + 1..plate_mm.len() {
            for (p, q) in candidates[a].iter().flat_map(|p| candidates[b].iter().map(move |q| (p, q))) {
                let pairs = [(plate_mm[a], p.at_px), (plate_mm[b], q.at_px)];
                let Some(similarity) = Similarity::through(bounds.axes, &pairs) else { continue };
                if !similarity.is_within(bounds) {
                    continue;
                }
                let found = consider(similarity);
                if best.as_ref().is_none_or(|best| found.worth(tolerance_px) > best.worth(tolerance_px)) {
                    best = Some(found);
                }
            }
        }
    }
    let best = best?;
    // once more through all that agree
    let refined = Similarity::through(bounds.axes, &best.pairs(plate_mm, candidates))
        .filter(|similarity| similarity.is_within(bounds))
        .map(consider);
    Some(match refined {
        Some(refined) if refined.worth(tolerance_px) >= best.worth(tolerance_px) => refined,
        _ => best,
    })
}

fn agreeing(
    plate_mm: &[Vector2<f64>],
    candidates: &[Vec<Candidate>],
    similarity: Similarity,
    tolerance_px: f64,
) -> Agreement {
    let mut agreement =
        Agreement { similarity, chosen: Vec::with_capacity(plate_mm.len()), score: 0.0, squares_px2: 0.0 };
    for (plate, candidates) in plate_mm.iter().zip(candidates) {
        let predicted = similarity.apply(*plate);
        let near = candidates.iter().enumerate().filter(|(_, c)| (c.at_px - predicted).norm() <= tolerance_px);
        let best = near.max_by(|(_, a), (_, b)| a.rho.total_cmp(&b.rho));
        if let Some((_, candidate)) = best {
            agreement.score += candidate.rho;
            agreement.squares_px2 += (candidate.at_px - predicted).norm_squared();
        }
        agreement.chosen.push(best.map(|(index, _)| index));
    }
    agreement
}

impl Agreement {
    /// Marks that agree.
    pub(super) fn count(&self) -> usize {
        self.chosen.iter().flatten().count()
    }

    fn worth(&self, tolerance_px: f64) -> f64 {
        let share = self.squares_px2 / (self.count().max(1) as f64 * tolerance_px.powi(2));
        self.score - PRICE_OF_RESIDUALS * share
    }

    fn pairs(&self, plate_mm: &[Vector2<f64>], candidates: &[Vec<Candidate>]) -> Vec<Pair> {
        let chosen = self.chosen.iter().enumerate();
        chosen.filter_map(|(mark, index)| Some((plate_mm[mark], candidates[mark][(*index)?].at_px))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;
    use crate::interior::laying::Laying;

    #[test]
    fn the_right_candidates_are_found_among_better_looking_ones() {
        let mut draws = Draws::new(2);
        let plate: Vec<Vector2<f64>> =
            [[-106.0, -106.0], [106.0, 106.0], [-106.0, 106.0], [106.0, -106.0]].map(Vector2::from).to_vec();
        for laying in Laying::all() {
            let truth = Similarity::new(laying.axes(), 40.2, 0.03, Vector2::new(5000.0, 5100.0));
            let mut candidates: Vec<Vec<Candidate>> = plate
                .iter()
                .map(|p| {
                    let mut wrong = || Candidate {
                        at_px: truth.apply(*p) + Vector2::new(draws.even(-300.0, 300.0), draws.even(-300.0, 300.0)),
                        rho: draws.even(0.6, 0.9),
                    };
                    let mut candidates: Vec<_> = (0..5).map(|_| wrong()).collect();
                    let at_px = truth.apply(*p) + Vector2::new(0.5 * draws.normal(), 0.3);
                    candidates.push(Candidate { at_px, rho: 0.7 });
                    candidates
                })
                .collect();
            // one is not there at all
            candidates[2].pop();
            let bounds = Bounds { axes: laying.axes(), px_per_mm: 40.0, scale: 0.01, rotation_rad: 0.1 };
            let found = agreement(&plate, &candidates, &bounds, 5.0).unwrap();
            assert_eq!(found.chosen, [Some(5), Some(5), None, Some(5)]);
            assert!((found.similarity.apply(plate[2]) - truth.apply(plate[2])).norm() < 4.0);
            let narrow = Bounds { rotation_rad: 0.01, ..bounds };
            assert!(agreement(&plate, &candidates, &narrow, 5.0).is_none_or(|found| found.count() < 3));
        }
    }
}
