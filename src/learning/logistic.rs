//! Logistic regression: the probability of being right rises with a weighted sum of the features.
//!
//! A support vector machine places its boundary and leaves what lies beyond its margins alike. Here every sample counts
//! by its probability, so that the sum also ranks what is far from the boundary, where most images are and where one
//! wrong in a thousand must be told.

use nalgebra::{DMatrix, DVector};

use super::svm::SvmError;

/// The weights of the features, and what is added.
#[derive(Debug, Clone, PartialEq)]
pub struct Weights {
    /// Of each feature.
    pub weights: Vec<f64>,
    /// Added to the weighted sum.
    pub bias: f64,
}

/// Sum of squares that is added for each weight, in units of one sample: keeps the weights finite where the classes can
/// be told apart without an error.
const RIDGE: f64 = 1.0;
const MOST_STEPS: usize = 60;
const SMALL_STEP: f64 = 1e-8;

/// Maximum likelihood by Newton's method, for samples of scaled features and whether they are right.
///
/// # Errors
/// [`SvmError`] if there is nothing to learn.
pub fn logistic(samples: &[(Vec<f64>, bool)]) -> Result<Weights, SvmError> {
    let right = samples.iter().filter(|(_, right)| *right).count();
    let Some((first, _)) = samples.first().filter(|_| right > 0 && right < samples.len()) else {
        return Err(SvmError::OneClass { right, wrong: samples.len() - right });
    };
    let untrainable = |detail: &str| SvmError::Untrainable { detail: detail.to_owned() };
    let size = first.len() + 1;
    if samples.iter().any(|(features, _)| features.len() + 1 != size || features.iter().any(|v| !v.is_finite())) {
        return Err(untrainable("a feature is not a number"));
    }
    let mut weights = DVector::zeros(size);
    let mut fit = -f64::INFINITY;
    for _ in 0..MOST_STEPS {
        let (gradient, hessian) = derivatives(samples, &weights);
        let step =
            hessian.cholesky().ok_or_else(|| untrainable("the features depend on one another"))?.solve(&gradient);
        // half of a step that is too long
        let mut share = 1.0;
        let (next, next_fit) = loop {
            let trial = &weights + &step * share;
            let trial_fit = log_likelihood(samples, &trial);
            if trial_fit >= fit || share < 1e-6 {
                break (trial, trial_fit);
            }
            share /= 2.0;
        };
        let moved = (&next - &weights).amax();
        (weights, fit) = (next, next_fit);
        if moved < SMALL_STEP {
            break;
        }
    }
    Ok(Weights { weights: weights.rows(0, size - 1).iter().copied().collect(), bias: weights[size - 1] })
}

fn sum(features: &[f64], weights: &DVector<f64>) -> f64 {
    features.iter().zip(weights.iter()).map(|(feature, weight)| feature * weight).sum::<f64>() + weights[features.len()]
}

fn log_likelihood(samples: &[(Vec<f64>, bool)], weights: &DVector<f64>) -> f64 {
    let of_sample = |(features, right): &(Vec<f64>, bool)| {
        let margin = if *right { sum(features, weights) } else { -sum(features, weights) };
        // log(1 / (1 + exp(-margin))), without overflow
        margin.min(0.0) - (-margin.abs()).exp().ln_1p()
    };
    let penalty = weights.rows(0, weights.len() - 1).norm_squared() * RIDGE / 2.0;
    samples.iter().map(of_sample).sum::<f64>() - penalty
}

/// Gradient of the logarithm of the likelihood, and its negative second derivatives.
fn derivatives(samples: &[(Vec<f64>, bool)], weights: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
    let size = weights.len();
    let mut gradient = -weights * RIDGE;
    gradient[size - 1] = 0.0;
    let mut hessian = DMatrix::identity(size, size) * RIDGE;
    hessian[(size - 1, size - 1)] = f64::MIN_POSITIVE;
    let mut row = vec![1.0; size];
    for (features, right) in samples {
        row[..size - 1].copy_from_slice(features);
        let probability = 1.0 / (1.0 + (-sum(features, weights)).exp());
        let (residual, weight) = (f64::from(u8::from(*right)) - probability, probability * (1.0 - probability));
        for a in 0..size {
            gradient[a] += residual * row[a];
            for b in 0..=a {
                hessian[(a, b)] += weight * row[a] * row[b];
            }
        }
    }
    hessian.fill_upper_triangle_with_lower_triangle();
    (gradient, hessian)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    #[test]
    fn the_weights_that_made_the_samples_come_back() {
        let mut draws = Draws::new(51);
        let truth = |features: &[f64]| 2.0 * features[0] - features[1] + 0.5;
        let samples: Vec<(Vec<f64>, bool)> = (0..20_000)
            .map(|_| {
                let features = vec![draws.normal(), draws.normal(), draws.normal()];
                let right = draws.even(0.0, 1.0) < 1.0 / (1.0 + (-truth(&features)).exp());
                (features, right)
            })
            .collect();
        let found = logistic(&samples).unwrap();
        for (found, wanted) in found.weights.iter().chain([&found.bias]).zip([2.0, -1.0, 0.0, 0.5]) {
            assert!((found - wanted).abs() < 0.08, "{found} instead of {wanted}");
        }
    }

    #[test]
    fn the_gradient_is_that_of_the_likelihood() {
        let samples = vec![(vec![0.3, -1.0], true), (vec![-0.2, 0.4], false), (vec![1.5, 2.0], true)];
        let at = DVector::from_vec(vec![0.7, -0.3, 0.2]);
        let (gradient, hessian) = derivatives(&samples, &at);
        for k in 0..3 {
            let h = DVector::from_fn(3, |row, _| if row == k { 1e-5 } else { 0.0 });
            let numeric = (log_likelihood(&samples, &(&at + &h)) - log_likelihood(&samples, &(&at - &h))) / 2e-5;
            assert!((numeric - gradient[k]).abs() < 1e-8);
            let turned = (derivatives(&samples, &(&at + &h)).0 - derivatives(&samples, &(&at - &h)).0) / -2e-5;
            assert!((turned - hessian.column(k)).amax() < 1e-7);
        }
    }

    #[test]
    fn classes_without_overlap_have_finite_weights_and_one_class_none() {
        let apart: Vec<(Vec<f64>, bool)> = (-5..5).map(|k| (vec![f64::from(k) + 0.5], k >= 0)).collect();
        let found = logistic(&apart).unwrap();
        assert!(found.weights[0] > 1.0 && found.weights[0].is_finite() && found.bias.abs() < 1e-6);
        assert_eq!(logistic(&apart[..3]), Err(SvmError::OneClass { right: 0, wrong: 3 }));
        assert_eq!(logistic(&[]), Err(SvmError::OneClass { right: 0, wrong: 0 }));
        assert!(logistic(&[(vec![f64::NAN], true), (vec![0.0], false)]).is_err());
    }
}
