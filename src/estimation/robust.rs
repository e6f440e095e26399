//! Weights of robust maximum-likelihood estimation by modified weights (method 1.4).

/// How residuals are turned into weights; `t` is the residual in units of its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weighting {
    /// `1 / sqrt(1 + t²/2)`: convex, finds its way from afar.
    Convex,
    /// `exp(-t²/2)`: redescending, forgets what is far away. Only near the solution.
    Redescending,
    /// All up to `t = 3.3` and nothing beyond: the last fit, with those that survived.
    Rejecting,
}

const REJECTED_T: f64 = 3.3;

impl Weighting {
    /// The factor of the weight for a squared standardised residual.
    #[must_use]
    pub fn factor(self, t_squared: f64) -> f64 {
        match self {
            Self::Convex => 1.0 / (1.0 + t_squared / 2.0).sqrt(),
            Self::Redescending => (-t_squared / 2.0).exp(),
            Self::Rejecting => f64::from(u8::from(t_squared <= REJECTED_T * REJECTED_T)),
        }
    }
}
