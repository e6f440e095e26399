//! The queue and the workers.

pub mod request;
