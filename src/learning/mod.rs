//! Learning from images whose orientation is known: support vector machines and logistic regression, the costs of
//! decisions, probabilities from scores. It knows features as numbers; what they mean, `diagnosis` knows.

pub mod calibration;
pub mod classifier;
pub mod costs;
pub mod domain;
pub mod drift;
pub mod logistic;
pub mod scaling;
pub mod svm;
pub mod training;

pub use calibration::{Bin, Calibration, Step, bins, calibration_error};
pub use classifier::{Classifier, Kind, Sees};
pub use costs::{Confusion, CostPoint, Costs, cheapest, cost_curve};
pub use domain::{Domain, Outside};
pub use scaling::Scaling;
pub use svm::Machine;
