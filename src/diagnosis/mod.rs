//! Does the answer deserve trust? Precision, configuration, and the verdict.

pub mod configuration;
pub mod external;
pub mod precision;
pub mod thresholds;
pub mod verdict;

pub use configuration::{lambda_max, reference_covariance};
pub use external::d_max_m;
pub use precision::{GroundPrecision, ground_precision};
pub use verdict::{Diagnosis, Features, Reason, Verdict};
