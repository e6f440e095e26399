//! Support vector machines (C-SVC): LIBSVM's, whose training and file format are those of the crate `libsvm-rs`.

use libsvm_rs::io::{load_model_from_reader, save_model_to_writer};
use libsvm_rs::predict::predict_values;
use libsvm_rs::train::svm_train;
use libsvm_rs::types::check_parameter;
use libsvm_rs::{KernelType, SvmModel, SvmNode, SvmParameter, SvmProblem, SvmType, set_quiet};

/// How alike two feature vectors are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kernel {
    /// Their scalar product: the decision is a weighted sum of the features.
    Linear,
    /// `exp(-gamma |a - b|^2)`.
    Rbf {
        /// The larger, the nearer a vector must be to count.
        gamma: f64,
    },
}

/// What a machine is trained with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The kernel.
    pub kernel: Kernel,
    /// C: the price of a training sample on the wrong side of its margin.
    pub price: f64,
    /// By how much that price is larger for a wrong sample that is taken to be right.
    pub weight_of_wrong: f64,
}

/// Why there is no machine.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SvmError {
    /// The samples are all right or all wrong.
    #[error("{right} samples are right and {wrong} are wrong: both are needed to learn the difference")]
    OneClass {
        /// Right ones.
        right: usize,
        /// Wrong ones.
        wrong: usize,
    },
    /// There are too few images of one class.
    #[error("{right} images with an orientation are right and {wrong} are wrong: at least {least} of each are needed")]
    FewOfOne {
        /// Right ones.
        right: usize,
        /// Wrong ones.
        wrong: usize,
        /// Enough.
        least: usize,
    },
    /// A sample or setting is not usable.
    #[error("it cannot be trained: {detail}")]
    Untrainable {
        /// What LIBSVM says.
        detail: String,
    },
    /// Somebody has ended the training.
    #[error("the training was ended")]
    Stopped,
    /// The text is not a model for this purpose.
    #[error("this is not a model of a C-SVC with two classes, 1 and -1, in LIBSVM's format: {detail}")]
    Unreadable {
        /// What is wrong with it.
        detail: String,
    },
}

/// A trained machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    model: SvmModel,
    /// 1 if the decision value is positive for what is right, -1 if LIBSVM has the classes the other way round.
    sign: f64,
}

/// LIBSVM's labels.
const RIGHT: i32 = 1;
const WRONG: i32 = -1;
/// Megabytes of kernel values that are kept while training.
const CACHE_MB: f64 = 200.0;

impl Machine {
    /// Trains on samples: scaled features, and whether they are right.
    ///
    /// # Errors
    /// [`SvmError`] if there is nothing to learn.
    pub fn train(samples: &[(Vec<f64>, bool)], settings: &Settings) -> Result<Self, SvmError> {
        let right = samples.iter().filter(|(_, right)| *right).count();
        if right == 0 || right == samples.len() {
            return Err(SvmError::OneClass { right, wrong: samples.len() - right });
        }
        let untrainable = |detail: String| SvmError::Untrainable { detail };
        if samples.iter().any(|(features, _)| features.iter().any(|value| !value.is_finite())) {
            return Err(untrainable("a feature is not a number".to_owned()));
        }
        let problem = SvmProblem {
            labels: samples.iter().map(|(_, right)| f64::from(if *right { RIGHT } else { WRONG })).collect(),
            instances: samples.iter().map(|(features, _)| nodes(features)).collect(),
        };
        let (kernel_type, gamma) = match settings.kernel {
            Kernel::Linear => (KernelType::Linear, 0.0),
            Kernel::Rbf { gamma } => (KernelType::Rbf, gamma),
        };
        let weight = if settings.weight_of_wrong == 1.0 { vec![] } else { vec![(WRONG, settings.weight_of_wrong)] };
        let parameter = SvmParameter {
            svm_type: SvmType::CSvc,
            kernel_type,
            gamma,
            c: settings.price,
            weight,
            cache_size: CACHE_MB,
            ..SvmParameter::default()
        };
        check_parameter(&problem, &parameter).map_err(|error| untrainable(error.to_string()))?;
        set_quiet(true);
        Self::of(svm_train(&problem, &parameter))
    }

    fn of(model: SvmModel) -> Result<Self, SvmError> {
        let unreadable = |detail: &str| Err(SvmError::Unreadable { detail: detail.to_owned() });
        if model.param.svm_type != SvmType::CSvc || model.nr_class != 2 {
            return unreadable("svm_type must be c_svc and nr_class 2");
        }
        if !matches!(model.param.kernel_type, KernelType::Linear | KernelType::Rbf) {
            return unreadable("kernel_type must be linear or rbf");
        }
        let numbers = model.sv_coef.iter().flatten().chain(&model.rho).chain(std::iter::once(&model.param.gamma));
        let values = model.sv.iter().flatten().map(|node| &node.value);
        if !numbers.chain(values).all(|value| value.is_finite()) {
            return unreadable("a number is not finite");
        }
        let sign = match model.label[..] {
            [RIGHT, WRONG] => 1.0,
            [WRONG, RIGHT] => -1.0,
            _ => return unreadable("the labels must be 1 and -1"),
        };
        Ok(Self { model, sign })
    }

    /// A weighted sum of the features as a machine: with a linear kernel, one support vector is enough.
    ///
    /// # Errors
    /// [`SvmError::Unreadable`] if a weight is not finite.
    pub fn linear(weights: &[f64], bias: f64) -> Result<Self, SvmError> {
        let parameter = SvmParameter { kernel_type: KernelType::Linear, ..SvmParameter::default() };
        Self::of(SvmModel {
            param: parameter,
            nr_class: 2,
            sv: vec![nodes(weights)],
            sv_coef: vec![vec![1.0]],
            rho: vec![-bias],
            prob_a: vec![],
            prob_b: vec![],
            prob_density_marks: vec![],
            sv_indices: vec![1],
            label: vec![RIGHT, WRONG],
            n_sv: vec![1, 0],
        })
    }

    /// Whether it is a weighted sum.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        matches!(self.model.param.kernel_type, KernelType::Linear)
    }

    /// The decision function d(x) of scaled features: positive for what seems right.
    #[must_use]
    pub fn decision(&self, features: &[f64]) -> f64 {
        let mut values = [0.0];
        predict_values(&self.model, &nodes(features), &mut values);
        self.sign * values[0]
    }

    /// The number of support vectors.
    #[must_use]
    pub fn support_vectors(&self) -> usize {
        self.model.sv.len()
    }

    /// The largest number of a feature that the machine knows, from 1.
    #[must_use]
    pub fn features(&self) -> usize {
        let largest = self.model.sv.iter().flatten().map(|node| node.index).max();
        usize::try_from(largest.unwrap_or(0)).unwrap_or(0)
    }

    /// In LIBSVM's format, as `svm-train` writes it.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = Vec::new();
        // writing to memory does not fail
        let _ = save_model_to_writer(&mut text, &self.model);
        String::from_utf8_lossy(&text).into_owned()
    }

    /// Reads LIBSVM's format.
    ///
    /// # Errors
    /// [`SvmError::Unreadable`].
    pub fn from_text(text: &str) -> Result<Self, SvmError> {
        let model = load_model_from_reader(text.as_bytes());
        Self::of(model.map_err(|error| SvmError::Unreadable { detail: error.to_string() })?)
    }
}

/// Sparse, as LIBSVM has it: indices from 1, zeros left out.
fn nodes(features: &[f64]) -> Vec<SvmNode> {
    let of_index = features.iter().enumerate().filter(|(_, value)| **value != 0.0);
    of_index.map(|(index, value)| SvmNode { index: index as i32 + 1, value: *value }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimation::simulated::Draws;

    const RBF: Settings = Settings { kernel: Kernel::Rbf { gamma: 0.7 }, price: 3.0, weight_of_wrong: 1.0 };

    /// Right inside a ring, with some noise.
    fn samples(count: usize) -> Vec<(Vec<f64>, bool)> {
        let mut draws = Draws::new(71);
        (0..count)
            .map(|_| {
                let features = vec![draws.even(-1.0, 1.0), draws.even(-1.0, 1.0), draws.even(-1.0, 1.0)];
                let radius = features[0].hypot(features[1]) + 0.1 * draws.normal();
                (features, radius < 0.6)
            })
            .collect()
    }

    #[test]
    fn a_ring_is_learned() {
        for weight_of_wrong in [1.0, 5.0] {
            let machine = Machine::train(&samples(600), &Settings { weight_of_wrong, ..RBF }).unwrap();
            let wrong_side = |(features, right): &&(Vec<f64>, bool)| (machine.decision(features) > 0.0) != *right;
            assert!(samples(600).iter().filter(wrong_side).count() < 90);
            assert!(machine.decision(&[0.0, 0.0, 0.0]) > 0.5 && machine.decision(&[0.9, 0.9, 0.0]) < -0.5);
            assert_eq!(machine.features(), 3);
        }
    }

    #[test]
    fn the_order_of_the_samples_does_not_turn_the_sign() {
        let mut turned = samples(300);
        turned.sort_by_key(|(_, right)| *right);
        assert!(Machine::train(&turned, &RBF).unwrap().decision(&[0.0, 0.0, 0.0]) > 0.0);
        turned.reverse();
        assert!(Machine::train(&turned, &RBF).unwrap().decision(&[0.0, 0.0, 0.0]) > 0.0);
    }

    #[test]
    fn the_text_decides_like_the_machine() {
        let trained = Machine::train(&samples(300), &RBF).unwrap();
        for machine in [trained, Machine::linear(&[0.5, 0.0, -1.25], 0.1).unwrap()] {
            let read = Machine::from_text(&machine.to_text()).unwrap();
            for (features, _) in samples(50) {
                // the file has eight digits of a support vector
                assert!((read.decision(&features) - machine.decision(&features)).abs() < 1e-5);
            }
            assert_eq!(read.to_text(), machine.to_text());
        }
    }

    /// The lines of the support vectors: their coefficients, and them.
    fn support_vectors(text: &str) -> Vec<(f64, String)> {
        let (_, vectors) = text.split_once("\nSV\n").unwrap();
        let parted = |line: &str| {
            let (coefficient, vector) = line.split_once(' ').unwrap();
            (coefficient.parse().unwrap(), vector.trim_end().to_owned())
        };
        vectors.lines().map(parted).collect()
    }

    #[test]
    fn svm_train_finds_the_same_support_vectors_and_predictions() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let samples = samples(1500);
        let line = |(features, right): &(Vec<f64>, bool)| {
            let label = if *right { RIGHT } else { WRONG };
            let values: String = (1..).zip(features).map(|(k, value)| format!(" {k}:{value}")).collect();
            format!("{label}{values}\n")
        };
        std::fs::write(path("samples"), samples.iter().map(line).collect::<String>()).unwrap();
        for (weight_of_wrong, name) in [(1.0, "plain"), (5.0, "weighted")] {
            let settings = Settings { weight_of_wrong, ..RBF };
            let mut svm_train = std::process::Command::new("svm-train");
            svm_train.args(["-q", "-s", "0", "-t", "2", "-g", "0.7", "-c", "3", "-m", "200"]);
            svm_train.args(["-w-1", &weight_of_wrong.to_string()]).args([path("samples"), path(name)]);
            match svm_train.status() {
                Ok(status) => assert!(status.success()),
                Err(error) => {
                    eprintln!("skipped: svm-train of Debian's libsvm-tools cannot be called: {error}");
                    return;
                }
            }
            let theirs_text = std::fs::read_to_string(path(name)).unwrap();
            let theirs = Machine::from_text(&theirs_text).unwrap();
            let ours = Machine::train(&samples, &settings).unwrap();
            let (of_theirs, of_ours) = (support_vectors(&theirs_text), support_vectors(&ours.to_text()));
            assert!(of_ours.len() > 100);
            let vectors = |of: &[(f64, String)]| of.iter().map(|(_, vector)| vector.clone()).collect::<Vec<_>>();
            assert_eq!(vectors(&of_ours), vectors(&of_theirs));
            let largest = of_ours.iter().zip(&of_theirs).map(|(a, b)| (a.0 - b.0).abs()).fold(0.0, f64::max);
            // both end when the gradient is known to a thousandth (svm-train -e), and C is 3, or 15
            assert!(largest < 0.01 * RBF.price * weight_of_wrong, "coefficients differ by up to {largest}");
            for (features, _) in &samples {
                let (a, b) = (ours.decision(features), theirs.decision(features));
                assert!((a - b).abs() < 2e-3, "{a} instead of {b}");
                assert!((a > 0.0) == (b > 0.0) || b.abs() < 1e-3);
            }
        }
    }

    #[test]
    fn a_weighted_sum_is_a_machine() {
        let machine = Machine::linear(&[0.5, 0.0, -1.25], 0.1).unwrap();
        assert!((machine.decision(&[2.0, 9.0, 1.0]) - (1.0 - 1.25 + 0.1)).abs() < 1e-12);
        assert!(Machine::linear(&[f64::NAN], 0.0).is_err());
    }

    #[test]
    fn what_cannot_be_learned_or_read_is_told() {
        let one_class: Vec<_> = samples(20).into_iter().map(|(features, _)| (features, true)).collect();
        assert_eq!(Machine::train(&one_class, &RBF), Err(SvmError::OneClass { right: 20, wrong: 0 }));
        assert!(Machine::train(&[(vec![f64::NAN], true), (vec![0.0], false)], &RBF).is_err());
        assert!(Machine::train(&samples(20), &Settings { price: -1.0, ..RBF }).is_err());
        let model = Machine::train(&samples(50), &RBF).unwrap().to_text();
        for damaged in [
            "".to_owned(),
            "hello".to_owned(),
            model.replace("c_svc", "one_class"),
            model.replace("label 1 -1", "label 1 2").replace("label -1 1", "label 2 1"),
            model.replace("rbf", "sigmoid"),
            model[..model.len() / 2].to_owned(),
            model.replace("rho ", "rho nan "),
        ] {
            assert!(matches!(Machine::from_text(&damaged), Err(SvmError::Unreadable { .. })), "{damaged}");
        }
    }
}
