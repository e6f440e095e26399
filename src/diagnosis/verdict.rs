//! The traffic light.

/// Green: verified. Yellow: doubtful. Red: not solved, or wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Not solved, or wrong.
    Red,
    /// Perhaps right: look at it before use.
    Yellow,
    /// Verified: may be used without a look.
    Green,
}

/// Why the verdict is what it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reason {
    /// A stable word for programs.
    pub code: &'static str,
    /// A sentence for staff: what it is and what to do about it.
    pub detail: String,
}

/// The paper's features, after the orientation with points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Features {
    /// N: control points that were located.
    pub control_points: usize,
    /// E: of those, the ones eliminated for the final adjustment.
    pub eliminated: usize,
    /// Logarithm of the standard deviation of unit weight.
    pub log_sigma0: f64,
    /// Logarithm of lambda_max.
    pub log_configuration: f64,
}

/// The verdict with all that led to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// The traffic light.
    pub verdict: Verdict,
    /// The larger the better; green beyond `threshold`.
    pub score: f64,
    /// What the score is held against.
    pub threshold: f64,
    /// Probability that D_max is within the tolerance.
    pub probability_correct: f64,
    /// The paper's features; `None` if there was no orientation with points.
    pub features: Option<Features>,
    /// Sorted by weight: the reason that decided first.
    pub reasons: Vec<Reason>,
    /// Control points that agree: what is probably right.
    pub probably_right: Vec<String>,
    /// Control points that took part and contradict the others: what is probably wrong.
    pub probably_wrong: Vec<String>,
}
