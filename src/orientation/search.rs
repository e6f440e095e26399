//! Which of the candidates belong together? The errors of prediction are common to all control points of an image,
//! so two of them, rightly located, predict all others.
//!
//! *Views*: the rotations that the approximation allows are cut into steps small enough for the shape of a control
//! point; under each of them every control point is located in a wide window. *Pairs* of candidates with the
//! approximation as an observation give orientations, to which further control points are joined one by one. The best
//! are *refined*: predicted anew, located in narrow windows, oriented (`hypotheses`).

use nalgebra::{Matrix6, Rotation3, Vector2, Vector3};

use super::ControlPoint;
use super::extract::Extraction;
use super::gate::{Located, Scale, largest_sigma};
use super::locate::{Clustering, Peak, shift_map};
use super::predict::{Approximation, Prediction, edges_px, on_frame};
use crate::features::PictureError;
use crate::geometry::{Camera, ExteriorOrientation, Segment2};

/// What the search works with.
pub struct Search<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Control points that may be in view.
    pub control: &'a [ControlPoint],
    /// What is known beforehand.
    pub approximation: &'a Approximation,
}

/// An orientation with the control points that speak for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Hypothesis {
    /// The orientation and its covariance.
    pub prediction: Prediction,
    /// Control points found where it predicts them.
    pub located: Vec<Located>,
    /// Logarithm of the odds of all of them together.
    pub score: f64,
}

/// Steps of the rotation up to this to either side leave the shape of a building as it is, to a cell of shifts.
const HALF_VIEW_RAD: f64 = 5.2 * std::f64::consts::PI / 180.0;
/// The approximation is believed up to so many of its standard deviations.
const REACH_SIGMAS: f64 = 3.0;
/// No tilt farther away than this is searched, however little is known: every view costs time.
const STEEPEST_RAD: f64 = 36.0 * std::f64::consts::PI / 180.0;
/// Half the width of the windows of the wide search, at least and at most; a wider one costs more than another view.
const WINDOW_PX: [f64; 2] = [60.0, 700.0];
/// The window in standard deviations of the prediction under a view.
const WINDOW_SIGMAS: f64 = 2.5;
/// The wide search: cells as large as a view may be wrong, a location good to little more.
pub(super) const WIDE: Scale = Scale { cell_px: 6.0, sigma_px: 8.0 };
const WIDE_DIRECTION_RAD: f64 = 7.0 * std::f64::consts::PI / 180.0;
const PEAKS_OF_A_VIEW: usize = 10;
const PEAKS_OF_A_CONTROL_POINT: usize = 40;
const REFINED: usize = 14;
/// How much of the work is done after the views, and after the pairs.
const SHARE_OF_VIEWS: f64 = 0.7;
const SHARE_BEFORE_REFINING: f64 = 0.85;
/// Hypotheses that predict the same to so many pixels are the same.
const DIFFERENT_PX: f64 = 25.0;

/// A candidate with the view under which it was found.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) peak: Peak,
    pub(super) view: ExteriorOrientation,
}

impl Search<'_> {
    /// The best hypotheses that differ from one another, best first; empty if nothing speaks for any. `go_on` hears
    /// how much is done (0 to 1), and ends the search, with nothing, by answering no.
    ///
    /// # Errors
    /// [`PictureError`] if the picture cannot be read where control points are expected.
    pub fn run(
        &self,
        extraction: &mut Extraction,
        go_on: &dyn Fn(f64) -> bool,
    ) -> Result<Vec<Hypothesis>, PictureError> {
        let views = self.views();
        let mut candidates: Vec<Vec<Candidate>> = vec![Vec::new(); self.control.len()];
        for (k, view) in views.iter().enumerate() {
            if !go_on(SHARE_OF_VIEWS * k as f64 / views.len() as f64) {
                return Ok(Vec::new());
            }
            for (control_point, of_one) in self.control.iter().zip(&mut candidates) {
                self.locate_wide(view, control_point, extraction, of_one)?;
            }
        }
        candidates.iter_mut().for_each(keep_best);
        let hypotheses = self.paired(&candidates, &|| go_on(SHARE_OF_VIEWS));
        let mut refined = Vec::new();
        for hypothesis in self.distinct(hypotheses).iter().take(REFINED) {
            if !go_on(SHARE_BEFORE_REFINING) {
                return Ok(Vec::new());
            }
            refined.extend(self.refined(hypothesis, extraction)?);
        }
        refined.sort_by(|a: &Hypothesis, b| b.score.total_cmp(&a.score));
        Ok(self.distinct(refined))
    }

    /// Orientations that cover what the approximation allows, each with the covariance of what remains open.
    fn views(&self) -> Vec<Prediction> {
        let approximation = self.approximation;
        let tilt = Steps::over((REACH_SIGMAS * approximation.sigma_tilt_rad).min(STEEPEST_RAD));
        let circle = std::f64::consts::PI;
        let kappa = Steps::over(approximation.sigma_kappa_rad.map_or(circle, |s| (REACH_SIGMAS * s).min(circle)));
        let [east, north, up] = approximation.sigma_position_m.map(|s| s.powi(2));
        let open = [east, north, up, tilt.open_variance(), tilt.open_variance(), kappa.open_variance()];
        let covariance = Matrix6::from_diagonal(&open.into());
        let mut views = Vec::new();
        for (x, y) in tilt.values().flat_map(|x| tilt.values().map(move |y| (x, y))) {
            // what lies in the corners of the square is less likely than any tilt that the reach was meant for
            if x.hypot(y) > 1.15 * tilt.reach.max(HALF_VIEW_RAD) {
                continue;
            }
            for turn in kappa.values() {
                let change = Rotation3::from_scaled_axis(Vector3::new(x, y, 0.0))
                    * Rotation3::from_axis_angle(&Vector3::z_axis(), turn);
                let camera_from_object = change * approximation.orientation.camera_from_object;
                let orientation = ExteriorOrientation { camera_from_object, ..approximation.orientation };
                views.push(Prediction { orientation, covariance });
            }
        }
        views
    }

    /// Adds the candidates for a control point under a view.
    fn locate_wide(
        &self,
        view: &Prediction,
        control_point: &ControlPoint,
        extraction: &mut Extraction,
        candidates: &mut Vec<Candidate>,
    ) -> Result<(), PictureError> {
        let expected = view.image_of(self.camera, control_point.reference_m, control_point.sigma_m);
        let Some((predicted, covariance)) = expected else { return Ok(()) };
        let half_width_px = (WINDOW_SIGMAS * largest_sigma(&covariance)).clamp(WINDOW_PX[0], WINDOW_PX[1]);
        if !on_frame(self.camera, predicted, half_width_px) {
            return Ok(());
        }
        let edges: Vec<Segment2> =
            edges_px(self.camera, &view.orientation, control_point).into_iter().flatten().collect();
        let clustering = Clustering {
            half_width_px,
            cell_px: WIDE.cell_px,
            direction_tolerance_rad: WIDE_DIRECTION_RAD,
            fine: false,
        };
        cover(extraction, self.camera, predicted, half_width_px + reach(&edges, predicted))?;
        let map = shift_map(&edges, predicted, extraction.segments(), &clustering);
        let peaks = map.peaks(PEAKS_OF_A_VIEW).into_iter().filter(|peak| on_frame(self.camera, peak.at_px, 0.0));
        candidates.extend(peaks.map(|peak| Candidate { peak, view: view.orientation }));
        Ok(())
    }

    /// Of hypotheses in order of their score, those that predict differently from all better ones.
    pub(super) fn distinct(&self, hypotheses: Vec<Hypothesis>) -> Vec<Hypothesis> {
        let mut kept: Vec<Hypothesis> = Vec::new();
        for hypothesis in hypotheses {
            let same = |other: &Hypothesis| self.difference_px(&hypothesis, other) < DIFFERENT_PX;
            if kept.len() < 3 * REFINED && !kept.iter().any(same) {
                kept.push(hypothesis);
            }
        }
        kept
    }

    /// Largest distance between the images of the control points that speak for the first hypothesis.
    fn difference_px(&self, a: &Hypothesis, b: &Hypothesis) -> f64 {
        let c = self.camera.principal_distance_px;
        let image = |h: &Hypothesis, k: usize| h.prediction.orientation.reduced_px(c, self.control[k].reference_m);
        let distances = a.located.iter().map(|l| {
            let both = image(a, l.control_point).zip(image(b, l.control_point));
            both.map_or(f64::INFINITY, |(p, q)| (p - q).norm())
        });
        distances.fold(0.0, f64::max)
    }
}

/// An interval about zero, cut into equal steps.
#[derive(Clone, Copy)]
struct Steps {
    reach: f64,
    count: i32,
}

impl Steps {
    fn over(reach: f64) -> Self {
        Self { reach, count: ((reach / HALF_VIEW_RAD).ceil() as i32).max(1) }
    }

    /// The middles of the steps.
    fn values(self) -> impl Iterator<Item = f64> {
        let n = f64::from(self.count);
        (0..self.count).map(move |k| self.reach * (2.0 * f64::from(k) + 1.0 - n) / n)
    }

    /// The variance of what is evenly distributed over a step.
    fn open_variance(self) -> f64 {
        (self.reach / f64::from(self.count)).powi(2) / 3.0
    }
}

/// Keeps the best candidates of a control point, and of those that neighbouring views found twice the better.
fn keep_best(candidates: &mut Vec<Candidate>) {
    candidates.sort_by(|a, b| b.peak.log_likelihood.total_cmp(&a.peak.log_likelihood));
    let mut kept: Vec<Candidate> = Vec::with_capacity(PEAKS_OF_A_CONTROL_POINT);
    for candidate in candidates.iter() {
        let twice = |k: &Candidate| (k.peak.at_px - candidate.peak.at_px).norm() < 2.0 * WIDE.cell_px;
        if kept.len() < PEAKS_OF_A_CONTROL_POINT && !kept.iter().any(twice) {
            kept.push(*candidate);
        }
    }
    *candidates = kept;
}

/// How far the edges reach from the reference point, in x or y.
pub(super) fn reach(edges: &[Segment2], predicted: Vector2<f64>) -> f64 {
    edges.iter().flat_map(|e| [e.start, e.end]).map(|end| (end - predicted).amax()).fold(0.0, f64::max)
}

/// Extracts the segments in a square about a reduced point.
pub(super) fn cover(
    extraction: &mut Extraction,
    camera: &Camera,
    centre: Vector2<f64>,
    half_width_px: f64,
) -> Result<(), PictureError> {
    let centre = camera.pixel_from_reduced(centre);
    // the distortion stretches it a little
    let half = Vector2::repeat(1.05 * half_width_px);
    extraction.cover(centre - half, centre + half)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Brown, rotation};

    fn views(sigma_tilt_deg: f64, sigma_kappa_deg: Option<f64>) -> Vec<Prediction> {
        let camera = Camera::new([4000, 3000], 3000.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap();
        let approximation = Approximation {
            orientation: ExteriorOrientation {
                projection_centre_m: Vector3::new(0.0, 0.0, 300.0),
                camera_from_object: rotation::camera_from_object(0.0, 0.0, 0.5),
            },
            sigma_position_m: [2.0; 3],
            sigma_tilt_rad: sigma_tilt_deg.to_radians(),
            sigma_kappa_rad: sigma_kappa_deg.map(f64::to_radians),
        };
        Search { camera: &camera, control: &[], approximation: &approximation }.views()
    }

    /// The smallest rotation between any view and the approximation turned by the angles.
    fn nearest_deg(views: &[Prediction], omega_deg: f64, phi_deg: f64, kappa_deg: f64) -> f64 {
        let [omega, phi, kappa] = [omega_deg, phi_deg, kappa_deg].map(f64::to_radians);
        let wanted = rotation::camera_from_object(omega, phi, 0.5 + kappa);
        let angles = views.iter().map(|v| (v.orientation.camera_from_object * wanted.inverse()).angle());
        angles.fold(f64::INFINITY, f64::min).to_degrees()
    }

    #[test]
    fn views_leave_no_rotation_within_reach_far_from_one() {
        let well_known = views(1.0, Some(1.5));
        assert_eq!(well_known.len(), 1);
        let nadir = views(8.0, Some(3.0));
        for (omega, phi, kappa) in [(0.0, 0.0, 0.0), (16.0, -14.0, 5.0), (-22.0, 3.0, -8.0), (2.0, 23.0, 7.0)] {
            let away = nearest_deg(&nadir, omega, phi, kappa);
            assert!(away < 9.0, "{omega} {phi} {kappa}: {away}");
        }
        let anywhere = views(5.0, None);
        for kappa in [0.0, 93.0, 178.0, -120.0] {
            assert!(nearest_deg(&anywhere, 6.0, -4.0, kappa) < 9.0);
        }
    }

    #[test]
    fn the_number_of_views_is_bounded() {
        assert!(views(1e6, None).len() < 2000);
    }
}
