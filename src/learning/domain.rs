//! Do the features lie among those that the classifier has seen?
//!
//! All features are such that more is better. What is better than all that was seen counts as the best that was; what is
//! worse in one of them, or unlike all in its combination, is outside, and nothing is known of it.

use nalgebra::{DMatrix, DVector};

/// Where the samples of a training were.
#[derive(Debug, Clone, PartialEq)]
pub struct Domain {
    /// The least value of each feature.
    pub least: Vec<f64>,
    /// The largest value of each feature.
    pub most: Vec<f64>,
    /// The mean of each feature.
    pub mean: Vec<f64>,
    /// The lower triangle of the covariance matrix, row by row.
    pub covariance: Vec<f64>,
    /// The largest squared Mahalanobis distance from the mean that counts as inside.
    pub farthest: f64,
}

/// How features lie outside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outside {
    /// This feature is worse than any that was seen.
    Worse {
        /// Its number, from 0.
        feature: usize,
    },
    /// Their combination is unlike all that was seen.
    Unlike {
        /// The squared Mahalanobis distance.
        distance: f64,
    },
    /// A feature is not a number.
    Unknown,
}

/// The share of the samples that may be worse in a feature, or farther, than what counts as inside.
const TAIL: f64 = 0.001;
/// Of the mean variance, added to each so that features that depend on one another do no harm.
const RIDGE: f64 = 1e-6;

impl Domain {
    /// Of samples; `None` if there are too few to say.
    #[must_use]
    pub fn of(samples: &[&[f64]]) -> Option<Self> {
        let features = samples.first()?.len();
        if samples.len() < 2 * features.max(2) {
            return None;
        }
        let quantile = |mut values: Vec<f64>, share: f64| {
            values.sort_by(f64::total_cmp);
            values[(share * (values.len() - 1) as f64).round() as usize]
        };
        let of_feature = |feature: usize| samples.iter().map(|sample| sample[feature]).collect::<Vec<_>>();
        let least = (0..features).map(|feature| quantile(of_feature(feature), TAIL)).collect();
        let most: Vec<f64> = (0..features).map(|feature| quantile(of_feature(feature), 1.0 - TAIL)).collect();
        let count = samples.len() as f64;
        let mean: Vec<f64> = (0..features).map(|feature| of_feature(feature).iter().sum::<f64>() / count).collect();
        let mut covariance = Vec::with_capacity(features * (features + 1) / 2);
        for a in 0..features {
            for b in 0..=a {
                let product = |sample: &&[f64]| (sample[a] - mean[a]) * (sample[b] - mean[b]);
                covariance.push(samples.iter().map(product).sum::<f64>() / count);
            }
        }
        let mut domain = Self { least, most, mean, covariance, farthest: f64::INFINITY };
        let distances: Option<Vec<f64>> =
            samples.iter().map(|sample| domain.distance(&domain.clamped(sample))).collect();
        domain.farthest = quantile(distances?, 1.0 - TAIL);
        Some(domain)
    }

    /// The features, none better than the best that were seen.
    #[must_use]
    pub fn clamped(&self, features: &[f64]) -> Vec<f64> {
        features.iter().zip(&self.most).map(|(value, most)| value.min(*most)).collect()
    }

    /// How features lie outside, if they do.
    #[must_use]
    pub fn outside(&self, features: &[f64]) -> Option<Outside> {
        if features.len() != self.least.len() || features.iter().any(|value| value.is_nan()) {
            return Some(Outside::Unknown);
        }
        if let Some(feature) = (0..features.len()).find(|&feature| features[feature] < self.least[feature]) {
            return Some(Outside::Worse { feature });
        }
        match self.distance(&self.clamped(features)) {
            Some(distance) if distance <= self.farthest => None,
            Some(distance) => Some(Outside::Unlike { distance }),
            None => Some(Outside::Unknown),
        }
    }

    /// The squared Mahalanobis distance from the mean.
    fn distance(&self, features: &[f64]) -> Option<f64> {
        let size = self.mean.len();
        let mut triangle = self.covariance.iter();
        let mut covariance = DMatrix::zeros(size, size);
        for a in 0..size {
            for b in 0..=a {
                covariance[(a, b)] = *triangle.next()?;
                covariance[(b, a)] = covariance[(a, b)];
            }
        }
        let scale = covariance.diagonal().map(|variance| 1.0 / variance.max(f64::MIN_POSITIVE).sqrt());
        let correlation = DMatrix::from_fn(size, size, |a, b| {
            covariance[(a, b)] * scale[a] * scale[b] + if a == b { RIDGE } else { 0.0 }
        });
        let away = DVector::from_fn(size, |k, _| (features[k] - self.mean[k]) * scale[k]);
        Some(away.dot(&correlation.cholesky()?.solve(&away)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    /// Two features that go together.
    fn domain() -> Domain {
        let mut draws = Draws::new(61);
        let samples: Vec<Vec<f64>> = (0..5000)
            .map(|_| {
                let (a, b) = (draws.normal(), draws.normal());
                vec![a, 0.9 * a + 0.2 * b]
            })
            .collect();
        Domain::of(&samples.iter().map(Vec::as_slice).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn nearly_all_that_was_seen_is_inside() {
        let (domain, mut draws) = (domain(), Draws::new(62));
        let inside = (0..5000)
            .filter(|_| {
                let (a, b) = (draws.normal(), draws.normal());
                domain.outside(&[a, 0.9 * a + 0.2 * b]).is_none()
            })
            .count();
        assert!(inside > 4960, "{inside}");
    }

    #[test]
    fn what_is_worse_unlike_or_unknown_is_outside_and_what_is_better_is_not() {
        let domain = domain();
        assert_eq!(domain.outside(&[-5.0, -4.5]), Some(Outside::Worse { feature: 0 }));
        assert!(matches!(domain.outside(&[1.5, -1.5]), Some(Outside::Unlike { .. })));
        assert_eq!(domain.outside(&[f64::NAN, 0.0]), Some(Outside::Unknown));
        assert_eq!(domain.outside(&[0.0]), Some(Outside::Unknown));
        assert_eq!(domain.outside(&[0.1, 0.0]), None);
        // both far better than ever
        assert_eq!(domain.outside(&[50.0, 45.0]), None);
        assert_eq!(domain.clamped(&[50.0, 0.0]), [domain.most[0], 0.0]);
    }

    #[test]
    fn a_few_samples_bound_nothing() {
        assert_eq!(Domain::of(&[]), None);
        assert_eq!(Domain::of(&[&[1.0, 2.0], &[2.0, 1.0], &[0.0, 0.0]]), None);
    }
}
