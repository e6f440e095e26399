//! Does the answer deserve trust? Precision, configuration, and the verdict.

pub mod verdict;

pub use verdict::{Diagnosis, Features, Reason, Verdict};
