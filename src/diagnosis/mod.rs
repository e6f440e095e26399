//! Does the answer deserve trust? Precision, configuration, and the verdict.

pub mod external;
pub mod verdict;

pub use external::d_max_m;
pub use verdict::{Diagnosis, Features, Reason, Verdict};
