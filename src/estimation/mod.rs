//! Least squares with covariance and redundancy, robust weights, spatial resection, consensus.

pub mod normal;
pub mod resection;
pub mod robust;

pub use normal::{NormalEquations, Prior};
pub use resection::{PointObservation, Resection, resect};
