//! Least squares with covariance and redundancy, robust weights, spatial resection, consensus, reliability, places from
//! distances.

pub mod consensus;
pub mod normal;
pub mod reliability;
pub mod resection;
pub mod robust;
#[cfg(test)]
pub(crate) mod simulated;
pub mod trilateration;

pub use consensus::{Consensus, Guarantee, Survey, largest_consistent, quadruples};
pub use normal::{NormalEquations, Prior, largest_sigma};
pub use reliability::{Reliability, Sensitivity};
pub use resection::{PointObservation, Resection, resect};
pub use trilateration::{Distance, Trilateration, TrilaterationError, trilaterate};
