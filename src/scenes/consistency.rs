//! Which correspondences of a scene belong together? Three that are right form similar triangles in both pictures
//! (Berveglieri and Tommaselli, section 3); the similarity of such a triangle, which must agree with what is known of
//! azimuth and scale, gathers all others that it explains. How likely it is that chance brings as many together is what
//! the place is rated by (Desolneux, Moisan and Morel: a contrario).

use std::cmp::Reverse;

use nalgebra::{Matrix2, Matrix4, SMatrix, Vector2, Vector4};

use super::{Correspondence, Gate};

/// A place in the image where a scene may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The scene's reference, reduced pixels.
    pub at_px: Vector2<f64>,
    /// Covariance of that.
    pub covariance: Matrix2<f64>,
    /// By how much it is turned against the prediction, from x towards y.
    pub turn_rad: f64,
    /// By how much it is larger than predicted: the logarithm of the ratio.
    pub log_scale: f64,
    /// Key points that agree.
    pub supports: usize,
    /// Logarithm of the odds that they do not agree by chance, with all places looked at counted.
    pub log_odds: f64,
}

/// Correspondences that are looked at, the most telling ones: triangles grow with the third power.
const MOST: usize = 90;
/// Places that are kept.
const MOST_SIGHTINGS: usize = 4;
/// How far a key point may be from where a similarity has it, at its least.
const TOLERANCE_PX: f64 = 2.5;
/// Key points nearer to each other say nothing about turn and scale.
const SHORTEST_SIDE_PX: f64 = 12.0;
/// Places so near to each other are the same.
const SAME_PX: f64 = 8.0;
/// Similarities that are tried.
const MOST_GATHERED: usize = 12;
/// How often a similarity gathers correspondences anew.
const ROUNDS: usize = 3;
/// No place is rated higher: what repeats itself on the ground is not independent.
const MOST_LOG_ODDS: f64 = 30.0;

/// The places where a scene may be, the likeliest first. `reduction` is that of the image's key points.
#[must_use]
pub fn sightings(found: &[Correspondence], gate: &Gate, reduction: u32) -> Vec<Sighting> {
    let tolerance_px = TOLERANCE_PX * f64::from(reduction);
    let pairs = distinct(&found[..found.len().min(MOST)], gate, tolerance_px);
    let of = Consistency { pairs: &pairs, gate, tolerance_px };
    let mut places: Vec<Sighting> = Vec::new();
    let mut explained: Vec<Vec<usize>> = Vec::new();
    for Side { ends, .. } in of.sides_with_triangles() {
        // a side whose ends a similarity has gathered leads to the same one
        if explained.iter().any(|members| ends.iter().all(|end| members.contains(end))) {
            continue;
        }
        if explained.len() == MOST_GATHERED {
            break;
        }
        let Some((members, similarity)) = of.gathered(ends) else { continue };
        let sighting = of.sighting(&members, &similarity);
        explained.push(members);
        match places.iter_mut().find(|place| (place.at_px - sighting.at_px).norm() < SAME_PX) {
            Some(place) if place.log_odds < sighting.log_odds => *place = sighting,
            Some(_) => {}
            None => places.push(sighting),
        }
    }
    places.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
    places.truncate(MOST_SIGHTINGS);
    places
}

/// The side that two correspondences form, which makes similar triangles with some others.
struct Side {
    ends: [usize; 2],
    triangles: usize,
}

/// A correspondence relative to the predicted reference.
#[derive(Debug, Clone, Copy)]
struct Pair {
    from: Vector2<f64>,
    to: Vector2<f64>,
}

/// Correspondences of which no two have an end in common: a key point with two orientations counts once.
fn distinct(found: &[Correspondence], gate: &Gate, tolerance_px: f64) -> Vec<Pair> {
    let mut pairs: Vec<Pair> = Vec::with_capacity(found.len());
    for one in found {
        let pair = Pair { from: one.predicted_px - gate.predicted_px, to: one.at_px - gate.predicted_px };
        let near = |a: Vector2<f64>, b: Vector2<f64>| (a - b).norm() < tolerance_px;
        if !pairs.iter().any(|other| near(other.to, pair.to) || near(other.from, pair.from)) {
            pairs.push(pair);
        }
    }
    pairs
}

/// `to = shift + [[a, -b], [b, a]] from`.
#[derive(Debug, Clone, Copy)]
struct Similarity {
    shift: Vector2<f64>,
    a: f64,
    b: f64,
    /// Of shift, a, b.
    covariance: Matrix4<f64>,
}

impl Similarity {
    fn image(&self, from: Vector2<f64>) -> Vector2<f64> {
        self.shift + Vector2::new(self.a * from.x - self.b * from.y, self.b * from.x + self.a * from.y)
    }
}

struct Consistency<'a> {
    pairs: &'a [Pair],
    gate: &'a Gate,
    tolerance_px: f64,
}

impl Consistency<'_> {
    fn tolerance_px(&self, pair: &Pair) -> f64 {
        self.tolerance_px + self.gate.relief * pair.from.norm()
    }

    /// All sides that are turned and scaled as the gate allows and have a third correspondence with which they form
    /// similar triangles in both pictures; those with the most triangles first.
    fn sides_with_triangles(&self) -> Vec<Side> {
        let count = self.pairs.len();
        let mut sides = Vec::new();
        for i in 0..count {
            for j in i + 1..count {
                let Some(ratio) = self.side(i, j) else { continue };
                let triangles = (0..count).filter(|k| *k != i && *k != j && self.similar(i, ratio, *k)).count();
                if triangles > 0 {
                    sides.push(Side { ends: [i, j], triangles });
                }
            }
        }
        sides.sort_by_key(|side: &Side| Reverse(side.triangles));
        sides
    }

    /// Whether a third correspondence lies where the ratio of a side from the first one has it, which makes the two
    /// triangles similar.
    fn similar(&self, i: usize, ratio: Vector2<f64>, k: usize) -> bool {
        let (from, to) = (self.pairs[k].from - self.pairs[i].from, self.pairs[k].to - self.pairs[i].to);
        let expected = Vector2::new(ratio.x * from.x - ratio.y * from.y, ratio.y * from.x + ratio.x * from.y);
        (expected - to).norm_squared() <= self.tolerance_px(&self.pairs[k]).powi(2)
    }

    /// What turns and scales one side of the scene to that of the image, as a complex number; `None` for what the gate
    /// does not allow.
    fn side(&self, i: usize, j: usize) -> Option<Vector2<f64>> {
        let (from, to) = (self.pairs[j].from - self.pairs[i].from, self.pairs[j].to - self.pairs[i].to);
        let length = from.norm_squared();
        if length < SHORTEST_SIDE_PX.powi(2) {
            return None;
        }
        let ratio = Vector2::new(from.dot(&to), from.perp(&to)) / length;
        let loose = self.loose(i, j);
        let scale = ratio.norm();
        let least = 1.0 - 3.0 * self.gate.sigma_log_scale - loose;
        let largest = (3.0 * self.gate.sigma_log_scale).exp() + loose;
        let turned = self.gate.sigma_turn_rad.is_none_or(|sigma| ratio.y.atan2(ratio.x).abs() <= 3.0 * sigma + loose);
        (scale >= least && scale <= largest && turned).then_some(ratio)
    }

    /// How much the ratio of a side may be off.
    fn loose(&self, i: usize, j: usize) -> f64 {
        let length = (self.pairs[j].from - self.pairs[i].from).norm();
        (self.tolerance_px / length).min(0.5) + self.gate.relief
    }

    /// All correspondences that the similarity of some explains, and the similarity of all these.
    fn gathered(&self, seeds: [usize; 2]) -> Option<(Vec<usize>, Similarity)> {
        let mut members = seeds.to_vec();
        let mut similarity = self.similarity(&members)?;
        for _ in 0..ROUNDS {
            let explains = |k: &usize| {
                let pair = &self.pairs[*k];
                (similarity.image(pair.from) - pair.to).norm() <= self.tolerance_px(pair)
            };
            let gathered: Vec<usize> = (0..self.pairs.len()).filter(explains).collect();
            if gathered.len() < 3 {
                return None;
            }
            if gathered == members {
                break;
            }
            similarity = self.similarity(&gathered)?;
            members = gathered;
        }
        Some((members, similarity))
    }

    /// By least squares, with what is known of turn and scale as observations.
    fn similarity(&self, members: &[usize]) -> Option<Similarity> {
        let mut normal = Matrix4::zeros();
        let mut side = Vector4::zeros();
        for k in members {
            let Pair { from, to } = self.pairs[*k];
            let weight = self.tolerance_px(&self.pairs[*k]).powi(-2) * TOLERANCE_SIGMAS.powi(2);
            let rows = SMatrix::<f64, 2, 4>::new(1.0, 0.0, from.x, -from.y, 0.0, 1.0, from.y, from.x);
            normal += rows.transpose() * rows * weight;
            side += rows.transpose() * to * weight;
        }
        // a is the scale and b the turn, where both are small
        if let Some(sigma_turn_rad) = self.gate.sigma_turn_rad {
            let weights = [self.gate.sigma_log_scale, sigma_turn_rad].map(|sigma| sigma.max(1e-3).powi(-2));
            normal[(2, 2)] += weights[0];
            side[2] += weights[0];
            normal[(3, 3)] += weights[1];
        }
        let covariance = normal.try_inverse()?;
        let solution = covariance * side;
        let [x, y, a, b] = solution.into();
        Some(Similarity { shift: Vector2::new(x, y), a, b, covariance })
    }

    fn sighting(&self, members: &[usize], similarity: &Similarity) -> Sighting {
        Sighting {
            at_px: self.gate.predicted_px + similarity.shift,
            covariance: similarity.covariance.fixed_view::<2, 2>(0, 0).into_owned(),
            turn_rad: similarity.b.atan2(similarity.a),
            log_scale: similarity.a.hypot(similarity.b).ln(),
            supports: members.len(),
            log_odds: self.log_odds(members),
        }
    }

    /// The logarithm of one over the number of sets of so many correspondences that chance would bring together. One
    /// may lie anywhere; a second one where turn and scale allow; each further one where the similarity has it.
    fn log_odds(&self, members: &[usize]) -> f64 {
        let area_px2 = self.gate.area_px2();
        let share = |reach_px: [f64; 2]| (std::f64::consts::PI * reach_px[0] * reach_px[1] / area_px2).min(1.0);
        let mean =
            |of: &dyn Fn(&Pair) -> f64| members.iter().map(|k| of(&self.pairs[*k])).sum::<f64>() / members.len() as f64;
        let (tolerance_px, distance_px) = (mean(&|pair| self.tolerance_px(pair)), mean(&|pair| pair.from.norm()));
        let turn = self.gate.sigma_turn_rad.map_or(std::f64::consts::PI, |sigma| 3.0 * sigma);
        let open = [turn, 3.0 * self.gate.sigma_log_scale].map(|loose| tolerance_px + distance_px * loose);
        let (count, of) = (members.len() as f64, self.pairs.len());
        let by_chance = share(open).ln() + (count - 2.0) * share([tolerance_px; 2]).ln();
        let odds = -by_chance - log_choices(of, members.len()) - (of as f64).ln();
        odds.min(MOST_LOG_ODDS)
    }
}

/// A tolerance is so many standard deviations.
const TOLERANCE_SIGMAS: f64 = 2.5;

/// The logarithm of the number of ways to choose some of many.
fn log_choices(of: usize, some: usize) -> f64 {
    (0..some).map(|k| ((of - k) as f64).ln() - ((k + 1) as f64).ln()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    fn gate(sigma_px: f64) -> Gate {
        Gate {
            predicted_px: Vector2::new(500.0, -200.0),
            covariance: Matrix2::identity() * sigma_px * sigma_px,
            reach_sigmas: 4.0,
            most_px2: 1e7,
            sigma_turn_rad: Some(0.1),
            sigma_log_scale: 0.05,
            relief: 0.02,
        }
    }

    /// Right ones under a similarity, wrong ones anywhere in the gate.
    fn drawn(gate: &Gate, right: usize, wrong: usize, draws: &mut Draws) -> (Vec<Correspondence>, Vector2<f64>) {
        let (turn, scale) = (0.08_f64, 1.04);
        let shift = Vector2::new(60.0, -35.0);
        let map = nalgebra::Rotation2::new(turn).into_inner() * scale;
        let mut found = Vec::new();
        for k in 0..right + wrong {
            let from = Vector2::new(draws.even(-120.0, 120.0), draws.even(-120.0, 120.0));
            let to = if k < right {
                shift + map * from + Vector2::new(draws.normal(), draws.normal()) * 0.7
            } else {
                let reach_px = gate.reach_sigmas * gate.covariance[(0, 0)].sqrt() * draws.even(0.0, 1.0).sqrt();
                let (sin, cos) = draws.even(0.0, std::f64::consts::TAU).sin_cos();
                from + Vector2::new(cos, sin) * reach_px
            };
            let ratio = draws.even(0.4, 0.8);
            let (predicted_px, at_px) = (gate.predicted_px + from, gate.predicted_px + to);
            found.push(Correspondence { predicted_px, at_px, ratio });
        }
        found.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
        (found, gate.predicted_px + shift)
    }

    #[test]
    fn a_few_right_ones_among_many_wrong_ones_are_found() {
        let mut draws = Draws::new(4);
        let gate = gate(100.0);
        for _ in 0..20 {
            let (found, truth) = drawn(&gate, 7, 40, &mut draws);
            let best = sightings(&found, &gate, 1)[0];
            assert!((best.at_px - truth).norm() < 3.0, "{best:?} {truth}");
            assert!(best.supports >= 6 && best.log_odds > 5.0, "{best:?}");
            assert!((best.turn_rad - 0.08).abs() < 0.03 && (best.log_scale - 0.039).abs() < 0.03, "{best:?}");
        }
    }

    /// The claim of the rating: that odds of e^k come up by chance in a share of at most e^-k.
    #[test]
    fn chance_is_rarely_rated_high() {
        let mut draws = Draws::new(5);
        let gate = gate(100.0);
        let trials = 400;
        let above = |odds: f64, draws: &mut Draws| {
            let best = |_| sightings(&drawn(&gate, 0, 40, draws).0, &gate, 1).first().map_or(0.0, |s| s.log_odds);
            (0..trials).map(best).filter(|best| *best > odds).count()
        };
        assert!(above(2.0, &mut draws) <= trials / 7);
        assert_eq!(above(6.0, &mut draws), 0);
    }

    #[test]
    fn the_covariance_is_the_scatter() {
        let mut draws = Draws::new(6);
        let gate = Gate { sigma_turn_rad: Some(1.0), sigma_log_scale: 1.0, ..gate(100.0) };
        let runs = 400;
        let (mut squares, mut claimed) = (0.0, 0.0);
        for _ in 0..runs {
            let (found, truth) = drawn(&gate, 12, 0, &mut draws);
            let best = sightings(&found, &gate, 1)[0];
            squares += (best.at_px - truth).norm_squared() / f64::from(runs);
            claimed += best.covariance.trace() / f64::from(runs);
        }
        // key points were drawn with 0.7 px, and are taken to be off by 1 px and the relief
        assert!(squares < claimed && squares > 0.1 * claimed, "{squares} {claimed}");
    }

    #[test]
    fn what_cannot_be_turned_so_far_is_no_place() {
        let mut draws = Draws::new(7);
        let strict = Gate { sigma_turn_rad: Some(0.005), sigma_log_scale: 0.003, ..gate(100.0) };
        let (found, truth) = drawn(&strict, 9, 0, &mut draws);
        let best = sightings(&found, &strict, 1);
        assert!(best.iter().all(|s| (s.at_px - truth).norm() > 3.0 || s.supports < 9), "{best:?}");
    }
}
