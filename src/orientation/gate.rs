//! Is a candidate where a prediction expects its control point, and how telling is that?

use nalgebra::{Matrix2, Vector2};

use super::locate::Peak;

/// A control point at one of its candidates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// Index of the control point.
    pub control_point: usize,
    /// Where it is, reduced.
    pub at_px: Vector2<f64>,
    /// Standard deviation of the location.
    pub sigma_px: f64,
    /// Logarithm of the odds that it is there, given the prediction.
    pub log_odds: f64,
}

/// Squared distance from prediction, in standard deviations, up to which a candidate counts: 99.7 % of a plane.
pub(super) const GATE: f64 = 11.6;

/// How finely shifts are told apart.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Side of a cell of shifts.
    pub cell_px: f64,
    /// Standard deviation of a location.
    pub sigma_px: f64,
}

/// A round of locating in narrow windows.
#[derive(Debug, Clone, Copy)]
pub struct Round {
    /// The scale of the shifts.
    pub scale: Scale,
    /// Largest angle between a model edge and a segment that may be its image.
    pub direction_tolerance_rad: f64,
}

/// A control point at a place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seed {
    pub(super) control_point: usize,
    pub(super) peak: Peak,
}

/// Where a control point is expected, and how many cells that leaves open.
pub(super) struct Gate {
    predicted: Vector2<f64>,
    weight: Matrix2<f64>,
    pub(super) log_open_cells: f64,
}

impl Gate {
    pub(super) fn new(predicted: Vector2<f64>, covariance: Matrix2<f64>, scale: Scale) -> Option<Self> {
        let covariance = covariance + Matrix2::identity() * scale.sigma_px.powi(2);
        let weight = covariance.try_inverse()?;
        let open_cells = 2.0 * std::f64::consts::PI * covariance.determinant().sqrt() / (2.0 * scale.cell_px).powi(2);
        Some(Self { predicted, weight, log_open_cells: open_cells.max(1.0).ln() })
    }

    /// A peak's likelihood ratio is against a shift anywhere; a prediction that leaves many cells open has as many
    /// chances to meet a peak by accident.
    pub(super) fn log_odds(&self, peak: &Peak) -> f64 {
        peak.log_likelihood - self.distance_squared(peak) / 2.0 - self.log_open_cells
    }

    /// The candidate with the largest log odds within the gate.
    pub(super) fn best(&self, peaks: &[Peak]) -> Option<(Peak, f64)> {
        let inside = peaks.iter().filter(|peak| self.distance_squared(peak) < GATE);
        inside.map(|peak| (*peak, self.log_odds(peak))).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn distance_squared(&self, peak: &Peak) -> f64 {
        let away = peak.at_px - self.predicted;
        away.dot(&(self.weight * away))
    }
}
