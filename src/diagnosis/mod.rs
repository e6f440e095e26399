//! Does the answer deserve trust? Precision, configuration, sensitivity, and the verdict.

pub mod configuration;
pub mod evidence;
pub mod external;
pub mod features;
pub mod hull;
pub mod judge;
pub mod precision;
pub mod risk;
pub mod sensitivity;
pub mod thresholds;
pub mod verdict;

pub use configuration::{lambda_max, reference_covariance};
pub use evidence::{Evidence, MOST_TRIALS, SensitivityEvidence, Trial};
pub use external::d_max_m;
pub use hull::hull_share;
pub use judge::{Case, Policy, Witness, WitnessWeight, judge, not_oriented};
pub use precision::{GroundPrecision, ground_precision};
pub use risk::{Risk, risk};
pub use sensitivity::{GroundSensitivity, Sensitivities};
pub use verdict::{Diagnosis, Features, Reason, Verdict};
