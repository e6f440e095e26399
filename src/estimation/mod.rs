//! Least squares with covariance and redundancy, robust weights, spatial resection, consensus.
