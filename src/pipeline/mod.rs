//! Runs the stages and the diagnosis for one image, reports progress, and obeys a cancel.

mod assess;
mod check;
pub mod desk;
mod film;
mod outcome;
mod run;
mod second_look;

use std::sync::Arc;

use nalgebra::{Matrix2, Matrix6, Vector2, Vector3};

use crate::diagnosis::{Diagnosis, Evidence, Policy, Trial};
use crate::features::PictureError;
use crate::geometry::{Camera, ExteriorOrientation, Segment2};
use crate::learning::Classifier;
use crate::orientation::ControlPoint;

pub use self::film::{FilmOutcome, FilmTask, OrientFn, hold_at_yellow, orient_film};
pub use self::run::orient;
pub use crate::diagnosis::precision::GroundPrecision;
pub use crate::estimation::Guarantee;
pub use crate::orientation::predict::Approximation;
pub use crate::orientation::search::SearchReport;
pub use crate::orientation::views::Assumed;

/// The largest planimetric error on the ground that the user can accept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// In ground sample distances of the image.
    Gsd(f64),
    /// In metres.
    Metres(f64),
}

/// One image to orient.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// The calibrated camera; its size is that of the picture.
    pub camera: Camera,
    /// The approximate orientation.
    pub approximation: Approximation,
    /// Buildings that the orientation is checked with, and never found by.
    pub check: Arc<[ControlPoint]>,
    /// What the verdict is about.
    pub tolerance: Tolerance,
    /// Who decides about it.
    pub judge: Judge,
}

/// A classifier with the policy of the user.
#[derive(Debug, Clone, PartialEq)]
pub struct Judge {
    /// The classifier.
    pub classifier: Arc<Classifier>,
    /// Costs and threshold.
    pub policy: Policy,
}

/// The stages, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// The fiducial marks of a scan of film.
    Interior,
    /// Where are the control points expected in the image?
    Predict,
    /// Line segments out of the pixels.
    Extract,
    /// Each control point by probabilistic clustering.
    Locate,
    /// Robust orientation with points.
    Resect,
    /// Robust adjustment with all line segments.
    Adjust,
    /// The verdict.
    Diagnose,
}

impl Stage {
    /// The stage's name in answers and logs.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Interior => "interior",
            Self::Predict => "predict",
            Self::Extract => "extract",
            Self::Locate => "locate",
            Self::Resect => "resect",
            Self::Adjust => "adjust",
            Self::Diagnose => "diagnose",
        }
    }
}

/// Who watches a run and may end it.
pub trait Observer: Sync {
    /// The run has come to `stage`, and to `fraction` (0 to 1) of the whole.
    fn progress(&self, stage: Stage, fraction: f64);
    /// Whether the run is to be given up; asked between small pieces of work.
    fn cancelled(&self) -> bool {
        false
    }
}

/// The adjusted orientation.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Projection centre and rotation in the local tangent plane.
    pub orientation: ExteriorOrientation,
    /// Covariance of `[dX0, theta]` (see `ExteriorOrientation::moved`), times max(1, sigma0)².
    pub covariance: Matrix6<f64>,
    /// Standard deviation of unit weight of the last step that was reached.
    pub sigma0: f64,
    /// Redundancy of that step.
    pub redundancy: usize,
    /// lambda_max against four control points in the corners.
    pub configuration: f64,
}

/// Which of the located control points agree upon one orientation, and how that was searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ConsensusResult {
    /// How far the search has come.
    pub guarantee: Guarantee,
    /// Subsets of the points that it examined.
    pub subsets: usize,
    /// Control points that were located.
    pub control_points: usize,
    /// Those that agree.
    pub inliers: usize,
}

/// Kinds of control points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControlKind {
    /// A building whose roof edges are known.
    Lines,
    /// A control scene: a small picture of the ground.
    Scene,
}

/// What became of one control point that was expected in the image.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlPointResult {
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: ControlKind,
    /// Its reference point under the approximate orientation, in pixels of the file.
    pub predicted_px: Option<Vector2<f64>>,
    /// Where its reference point is with the probability of three standard deviations, if the approximation says
    /// anything of it.
    pub search_region_px: Option<Ellipse>,
    /// Its reference point where the adjustment found it; `None` if it took no part.
    pub located_px: Option<Vector2<f64>>,
    /// Its reference point under the adjusted orientation.
    pub projected_px: Option<Vector2<f64>>,
    /// Whether it took part in the last step.
    pub used: bool,
    /// Its edges that have a line segment in the image.
    pub segments_matched: usize,
    /// Root mean square of the distances of its matched segments' ends from the projected edges.
    pub residual_px: Option<f64>,
    /// How the result depends on it, if it took part and the others predict it.
    pub sensitivity: Option<ControlPointSensitivity>,
}

/// What an image shows of a building that its orientation was not found by.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckPointResult {
    /// Its name.
    pub name: String,
    /// Its reference point under the final orientation, in pixels of the file.
    pub predicted_px: Vector2<f64>,
    /// Where its lines put it; `None` if it was not found.
    pub located_px: Option<Vector2<f64>>,
    /// Its edges that have a line segment in the image.
    pub segments_matched: usize,
    /// So far apart are the two, reduced pixels; `None` if it was not found. Where all its lines are parallel, across them.
    pub residual_px: Option<f64>,
    /// The same at its distance from the camera.
    pub residual_m: Option<f64>,
}

/// An ellipse in a plane, in its units: in the image pixels of the file, on the ground metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipse {
    /// Its middle.
    pub centre: Vector2<f64>,
    /// The longer semi-axis and the shorter one.
    pub semi_axes: [f64; 2],
    /// Direction of the longer one, from x towards y.
    pub angle_rad: f64,
}

impl Ellipse {
    /// The ellipse of so many standard deviations; `None` if the covariance has no axes.
    #[must_use]
    pub fn of_covariance(centre: Vector2<f64>, covariance: &Matrix2<f64>, sigmas: f64) -> Option<Self> {
        if !covariance.iter().all(|value| value.is_finite()) {
            return None;
        }
        let (a, b, c) = (covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]);
        let (middle, half) = ((a + c) / 2.0, ((a - c) / 2.0).hypot(b));
        let semi_axes = [middle + half, middle - half].map(|variance| sigmas * variance.max(0.0).sqrt());
        let angle_rad = 0.5 * (2.0 * b).atan2(a - c);
        Some(Self { centre, semi_axes, angle_rad })
    }
}

/// How the result depends on a control point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlPointSensitivity {
    /// How far it was found from where all others expect it.
    pub discrepancy_px: Vector2<f64>,
    /// The same, squared and in units of its covariance: chi-square with 2 degrees of freedom.
    pub test: f64,
    /// Whether chance hardly explains that.
    pub contradicts: bool,
    /// On the ground.
    pub ground: GroundBounds,
}

/// What leaving control points out does to the ground, and what an undetected error of them can do: planimetric, the
/// worst of the nine points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundBounds {
    /// So far the ground moves without them.
    pub change_m: f64,
    /// Empirical sensitivity: no function of a ground point changes by more than this without them.
    pub empirical_m: f64,
    /// Theoretical sensitivity: an undetected error of them does no more than this.
    pub theoretical_m: f64,
}

/// How the result depends on two control points together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairResult {
    /// Indices into [`Outcome::control_points`].
    pub control_points: [usize; 2],
    /// Chi-square with 4 degrees of freedom.
    pub test: f64,
    /// On the ground.
    pub ground: GroundBounds,
}

/// One edge under the final orientation, for the overlay. Pixels of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeResult {
    /// Index into `Outcome::control_points`.
    pub control_point: usize,
    /// The projected edge.
    pub projected_px: Segment2,
    /// The line segments of the image that were matched to it.
    pub matched_px: Vec<Segment2>,
}

/// What was done to orient an image. Counts, the same on every machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cost {
    /// The search: what it took for possible and looked at.
    pub search: SearchReport,
    /// Hypotheses that were adjusted with lines.
    pub adjusted: usize,
    /// Pixels of the file that were read.
    pub pixels_read: u64,
    /// Whether it was searched a second time, as if the approximation erred more than it says.
    pub widened: bool,
}

impl Cost {
    /// Of this as a second, wider search, with that of the first one.
    fn after(self, first: Option<&Self>) -> Self {
        let Some(first) = first else { return Self { widened: true, ..self } };
        let (a, b) = (&first.search, &self.search);
        let search = SearchReport {
            assumed: b.assumed,
            views: a.views + b.views,
            control_points: b.control_points,
            windows: a.windows + b.windows,
            pairs: a.pairs + b.pairs,
            refined: a.refined + b.refined,
        };
        Self {
            search,
            adjusted: first.adjusted + self.adjusted,
            pixels_read: first.pixels_read + self.pixels_read,
            widened: true,
        }
    }
}

/// All that is known of the image afterwards.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The orientation, if any was found.
    pub estimate: Option<Estimate>,
    /// The control points that were expected in the image.
    pub control_points: Vec<ControlPointResult>,
    /// What the image shows of buildings that took no part, under the final orientation; empty without one.
    pub check_points: Vec<CheckPointResult>,
    /// How the result depends on pairs of those that took part.
    pub pairs: Vec<PairResult>,
    /// Their edges under the final orientation; empty without one.
    pub edges: Vec<EdgeResult>,
    /// The nine points of the ground at 5, 50 and 95 % of width and height; those whose rays miss it are left out.
    pub ground_precision: Vec<GroundPrecision>,
    /// How the control points agree under it; `None` without one.
    pub consensus: Option<ConsensusResult>,
    /// The verdict.
    pub diagnosis: Diagnosis,
    /// What the verdict rests on; `None` without an orientation.
    pub evidence: Option<Evidence>,
    /// Orientations with points that were examined on the way, at most 64.
    pub trials: Vec<Trial>,
    /// Mean height of the control used, in the local frame: that of the plane on which errors are measured.
    pub ground_height_m: Option<f64>,
    /// What the image shows of that plane: the rim of its frame on the ground; empty where a part of it looks past.
    pub footprint_m: Vec<Vector3<f64>>,
    /// What it cost; `None` if there was nothing to search for.
    pub cost: Option<Cost>,
}

/// Why a run ended without an outcome. (An image that cannot be oriented is an outcome: red, with reasons.)
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// The picture is damaged or cannot be read.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The observer asked for it.
    #[error("cancelled")]
    Cancelled,
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation2;

    use super::*;

    #[test]
    fn the_axes_of_an_ellipse_are_those_its_covariance_was_turned_from() {
        for angle_rad in [-1.2, -0.3, 0.0, 0.7, 1.5] {
            let turn = Rotation2::new(angle_rad);
            let covariance = turn * Matrix2::new(9.0, 0.0, 0.0, 4.0) * turn.inverse();
            let ellipse = Ellipse::of_covariance(Vector2::new(5.0, 6.0), &covariance, 3.0).unwrap();
            assert!((ellipse.angle_rad - angle_rad).abs() < 1e-12);
            assert!((ellipse.semi_axes[0] - 9.0).abs() < 1e-12 && (ellipse.semi_axes[1] - 6.0).abs() < 1e-12);
        }
        let unknown = Matrix2::new(f64::NAN, 0.0, 0.0, 1.0);
        assert_eq!(Ellipse::of_covariance(Vector2::zeros(), &unknown, 3.0), None);
    }
}
