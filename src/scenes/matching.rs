//! Which key points of the image look like those of a scene? The nearest descriptor, if it is much nearer than the
//! second one (Lowe 2004, section 7.1), of those that lie, point and measure as the approximate orientation has them.

use nalgebra::{Matrix2, Vector2};

use super::{ImageKeys, SceneKey, View};
use crate::features::sift::squared_distance;

/// Where a scene is expected, and how it may be turned and scaled there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// The image of its reference, reduced pixels.
    pub predicted_px: Vector2<f64>,
    /// Covariance of that.
    pub covariance: Matrix2<f64>,
    /// How many standard deviations are looked at.
    pub reach_sigmas: f64,
    /// The area of the frame: no more than this is looked at.
    pub most_px2: f64,
    /// Standard deviation of its turn against the predicted one; `None`: any.
    pub sigma_turn_rad: Option<f64>,
    /// Standard deviation of the logarithm of its scale against the predicted one.
    pub sigma_log_scale: f64,
    /// How far a key point may be from where a similarity has it, for each pixel of distance from the reference: the
    /// ground is no plane, and the image a perspective one.
    pub relief: f64,
}

impl Gate {
    /// The area in which the reference is looked for, square pixels.
    #[must_use]
    pub fn area_px2(&self) -> f64 {
        let ellipse = std::f64::consts::PI * self.reach_sigmas.powi(2) * self.covariance.determinant().max(0.0).sqrt();
        ellipse.min(self.most_px2)
    }

    /// The same at a distance from the reference: a turn and another scale add to what is not known.
    fn at(&self, distance_px: f64) -> Matrix2<f64> {
        let turn = self.sigma_turn_rad.unwrap_or(ANY_TURN).min(ANY_TURN);
        self.covariance + Matrix2::identity() * (distance_px * turn.hypot(self.sigma_log_scale)).powi(2)
    }

    /// The largest turn of a key point.
    fn largest_turn_rad(&self) -> f64 {
        let largest = self.sigma_turn_rad.map_or(std::f64::consts::PI, |sigma| 3.0 * sigma + ORIENTATION_RAD);
        largest.min(std::f64::consts::PI)
    }

    /// The square of the largest ratio of scales, either way.
    fn largest_squared_ratio(&self) -> f64 {
        (2.0 * (3.0 * self.sigma_log_scale + LOG_SCALE)).exp()
    }
}

/// A turn of which nothing is known may put a key point as far to any side as it is from the reference.
const ANY_TURN: f64 = 1.0;
/// How far the orientations of the same key point in two pictures differ at most.
const ORIENTATION_RAD: f64 = 0.3;
/// The same for the logarithms of its scales.
const LOG_SCALE: f64 = 0.35;

/// A key point of a scene with the one of the image that it looks like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correspondence {
    /// Where the scene's key point is expected, reduced pixels.
    pub predicted_px: Vector2<f64>,
    /// Where the image has it.
    pub at_px: Vector2<f64>,
    /// Distance of the descriptors, as a share of that of the second nearest.
    pub ratio: f64,
}

/// The largest ratio that counts.
const LARGEST_RATIO: f64 = 0.85;
/// Where there is no second one, or none that is nearer, such a distance stands for it: that of things that have nothing
/// in common is 300 to 500.
const UNLIKE: u32 = 330 * 330;
/// A second key point so near to the first one is the same thing once more.
const SAME_PX: f64 = 4.0;

/// The correspondences of a scene, the most telling first.
#[must_use]
pub fn correspondences(keys: &[SceneKey], view: &View, image: &ImageKeys, gate: &Gate) -> Vec<Correspondence> {
    let mut found: Vec<Correspondence> = keys.iter().filter_map(|key| nearest(key, view, image, gate)).collect();
    found.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    found
}

fn nearest(key: &SceneKey, view: &View, image: &ImageKeys, gate: &Gate) -> Option<Correspondence> {
    let predicted_px = view.reduced_from_ground(key.ground_m)?;
    let along_px = view.reduced_from_ground(key.ground_m + key.along_m)? - predicted_px;
    let covariance = gate.at((predicted_px - gate.predicted_px).norm());
    let weight = covariance.try_inverse()?;
    let reach = covariance.diagonal().map(|variance| gate.reach_sigmas * variance.sqrt());
    let squared_reach = gate.reach_sigmas.powi(2);
    let (largest_turn_rad, largest_ratio) = (gate.largest_turn_rad(), gate.largest_squared_ratio());
    let least_cosine = largest_turn_rad.cos();
    let along_squared = along_px.norm_squared();
    let same_px = SAME_PX * f64::from(image.reduction());
    let (mut best, mut second) = ((UNLIKE, Vector2::zeros()), UNLIKE);
    let rectangle = [predicted_px - reach, predicted_px + reach];
    let near = image.near(rectangle, along_px, largest_turn_rad);
    for (other, descriptor) in near.flat_map(|range| image.of(range)) {
        let away = other.at_px - predicted_px;
        if away.dot(&(weight * away)) > squared_reach {
            continue;
        }
        let squared = other.along_px.norm_squared();
        let ratio = squared / along_squared;
        if ratio > largest_ratio || ratio * largest_ratio < 1.0 {
            continue;
        }
        if along_px.dot(&other.along_px) < least_cosine * (squared * along_squared).sqrt() {
            continue;
        }
        let distance = squared_distance(&key.descriptor, descriptor);
        if distance < best.0 {
            if (other.at_px - best.1).norm() > same_px {
                second = best.0;
            }
            best = (distance, other.at_px);
        } else if distance < second && (other.at_px - best.1).norm() > same_px {
            second = distance;
        }
    }
    let ratio = (f64::from(best.0) / f64::from(second)).sqrt();
    (ratio <= LARGEST_RATIO).then_some(Correspondence { predicted_px, at_px: best.1, ratio })
}
