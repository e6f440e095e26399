//! What came out for one image, with the truth beside it.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::Mixture;
use super::paper;
use crate::diagnosis::thresholds::{Thresholds, accepts};
use crate::diagnosis::{Verdict, d_max_m};
use crate::geometry::ExteriorOrientation;
use crate::pipeline::{Estimate, GroundPrecision, Outcome};
use crate::simulation::Scene;

/// A reference point that lies within this of its true place was located correctly: the paper's t_e.
const LOCATED_PX: f64 = 10.0;

/// How far an image came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fate {
    /// No control point is in view.
    NoControlInView,
    /// No orientation was found.
    NothingLocated,
    /// The orientation is wrong, and so are most of the places of the control points that it rests on.
    WrongHypothesis,
    /// The orientation is wrong although most of them are right.
    AdjustedWrong,
    /// The orientation is within the tolerance.
    Right,
}

/// The traffic light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Light {
    /// To be used without a look.
    Green,
    /// Doubtful.
    Yellow,
    /// Not solved, or wrong.
    Red,
}

/// One image. Values that there are only with an orientation are `None` without one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What it was drawn from.
    pub seed: u64,
    /// What its settings were drawn from.
    pub mixture: Mixture,
    /// Ground sample distance in the middle of the image.
    pub gsd_m: f64,
    /// Blur of the photograph.
    pub blur_px: f64,
    /// What haze left of its contrasts.
    pub clearness: f64,
    /// Control points whose reference point truly lies in the frame.
    pub control_points_in_view: usize,
    /// Those of them that are not out of date.
    pub sound_in_view: usize,
    /// How far the image came.
    pub fate: Fate,
    /// The largest D_max that was acceptable, in ground sample distances.
    pub tolerance_gsd: f64,
    /// Whether a diagnosis by thresholds accepts it.
    pub thresholds_accept: bool,
    /// The verdict.
    pub verdict: Light,
    /// Its score.
    pub score: f64,
    /// Probability that D_max is within the tolerance.
    pub probability_correct: f64,
    /// The paper's N.
    pub points: Option<usize>,
    /// The paper's E.
    pub eliminated: Option<usize>,
    /// Logarithm of sigma0 of the orientation with points.
    pub log_sigma0: Option<f64>,
    /// Logarithm of lambda_max of the orientation with points.
    pub log_configuration: Option<f64>,
    /// sigma0 of the adjustment with lines.
    pub sigma0: Option<f64>,
    /// lambda_max of the adjustment with lines.
    pub configuration: Option<f64>,
    /// Control points that the outcome gives a place.
    pub located: usize,
    /// Those of them whose place is right.
    pub located_right: usize,
    /// Control points that took part in the adjustment.
    pub used: usize,
    /// Those of them whose place is right.
    pub used_right: usize,
    /// D_max against the truth, in metres.
    pub d_max_m: Option<f64>,
    /// D_max in ground sample distances.
    pub d_max_gsd: Option<f64>,
    /// The largest predicted planimetric standard deviation of the nine points of the ground.
    pub sigma_planimetric_m: Option<f64>,
    /// The true planimetric error at that point.
    pub error_there_m: Option<f64>,
    /// Root of the mean predicted planimetric variance of the nine points.
    pub sigma_of_nine_m: Option<f64>,
    /// Root mean square of their true planimetric errors.
    pub error_of_nine_m: Option<f64>,
    /// Squared Mahalanobis distance of the six parameters from the truth.
    pub mahalanobis_squared: Option<f64>,
    /// The paper's method: control points located.
    pub paper_located: usize,
    /// Those of them whose place is right.
    pub paper_located_right: usize,
    /// The paper's N.
    pub paper_points: usize,
    /// The paper's E.
    pub paper_eliminated: usize,
    /// sigma0 of its orientation with points.
    pub paper_sigma0: Option<f64>,
    /// lambda_max of its orientation with points.
    pub paper_configuration: Option<f64>,
    /// Its D_max, in ground sample distances.
    pub paper_d_max_gsd: Option<f64>,
    /// Whether its thresholds accept.
    pub paper_accepted: bool,
    /// Processor time for drawing the scene and rendering what was read of it. Whoever runs the study fills in the
    /// times.
    pub render_seconds: f64,
    /// Processor time of the pipeline without rendering.
    pub pipeline_seconds: f64,
    /// Processor time of the paper's method without rendering.
    pub paper_seconds: f64,
}

impl Row {
    /// The row of an image, still without times.
    #[must_use]
    pub fn new(mixture: Mixture, scene: &Scene, outcome: &Outcome, by_paper: &paper::Found) -> Self {
        let orientation = outcome.estimate.as_ref().map(|e| &e.orientation);
        let gsd_m = scene.ground_sample_distance_m();
        let error_m = |o: &ExteriorOrientation| {
            d_max_m(&scene.camera, o, &scene.true_orientation, scene.ground_height_m()).filter(|d| d.is_finite())
        };
        let d_max_m = orientation.and_then(error_m);
        let d_max_gsd = d_max_m.map(|d| d / gsd_m);
        let places = Places::of(scene, outcome);
        let in_view: Vec<_> = scene.in_view().collect();
        let ground = Ground::of(scene, &outcome.ground_precision);
        let features = outcome.diagnosis.features;
        let tolerance_gsd = mixture.tolerance_gsd(scene.seed);
        let paper_right = by_paper.located.iter().filter(|p| located_rightly(scene, &p.name, p.at_px)).count();
        Self {
            seed: scene.seed,
            mixture,
            gsd_m,
            blur_px: scene.settings.photograph.blur_sigma_px,
            clearness: scene.settings.photograph.clearness,
            control_points_in_view: in_view.len(),
            sound_in_view: in_view.iter().filter(|point| point.fault.is_none()).count(),
            fate: fate(in_view.len(), orientation.is_some(), tolerance_gsd, d_max_gsd, &places),
            tolerance_gsd,
            thresholds_accept: outcome.evidence.as_ref().is_some_and(|e| accepts(e, &Thresholds::default())),
            verdict: match outcome.diagnosis.verdict {
                Verdict::Green => Light::Green,
                Verdict::Yellow => Light::Yellow,
                Verdict::Red => Light::Red,
            },
            score: outcome.diagnosis.score,
            probability_correct: outcome.diagnosis.probability_correct,
            points: features.map(|f| f.control_points),
            eliminated: features.map(|f| f.eliminated),
            log_sigma0: features.map(|f| f.log_sigma0),
            log_configuration: features.map(|f| f.log_configuration),
            sigma0: outcome.estimate.as_ref().map(|e| e.sigma0),
            configuration: outcome.estimate.as_ref().map(|e| e.configuration),
            located: places.located,
            located_right: places.located_right,
            used: places.used,
            used_right: places.used_right,
            d_max_m,
            d_max_gsd,
            sigma_planimetric_m: ground.map(|g| g.largest_sigma_m),
            error_there_m: ground.map(|g| g.error_there_m),
            sigma_of_nine_m: ground.map(|g| g.sigma_of_all_m),
            error_of_nine_m: ground.map(|g| g.error_of_all_m),
            mahalanobis_squared: outcome.estimate.as_ref().and_then(|e| mahalanobis_squared(e, scene)),
            paper_located: by_paper.located.len(),
            paper_located_right: paper_right,
            paper_points: by_paper.points,
            paper_eliminated: by_paper.eliminated,
            paper_sigma0: Some(by_paper.sigma0).filter(|s| s.is_finite()),
            paper_configuration: Some(by_paper.configuration).filter(|c| c.is_finite()),
            paper_d_max_gsd: by_paper.orientation.as_ref().and_then(error_m).map(|d| d / gsd_m),
            paper_accepted: by_paper.accepted(),
            render_seconds: 0.0,
            pipeline_seconds: 0.0,
            paper_seconds: 0.0,
        }
    }

    /// Whether the orientation is within the tolerance.
    #[must_use]
    pub fn right(&self) -> bool {
        self.d_max_gsd.is_some_and(|d| d <= self.tolerance_gsd)
    }

    /// Whether that of the paper's method is.
    #[must_use]
    pub fn paper_right(&self) -> bool {
        self.paper_d_max_gsd.is_some_and(|d| d <= self.tolerance_gsd)
    }

    /// Whether its counts can be those of one image: a file of rows may have been edited, and tables add and subtract.
    #[must_use]
    pub fn is_consistent(&self) -> bool {
        const MOST: usize = 1_000_000;
        let parts = [
            (self.sound_in_view, self.control_points_in_view),
            (self.located_right, self.located),
            (self.used_right, self.used),
            (self.paper_located_right, self.paper_located),
        ];
        parts.iter().all(|(part, whole)| part <= whole && *whole <= MOST)
    }
}

fn fate(in_view: usize, oriented: bool, tolerance_gsd: f64, d_max_gsd: Option<f64>, places: &Places) -> Fate {
    match d_max_gsd {
        Some(d) if d <= tolerance_gsd => Fate::Right,
        _ if in_view == 0 => Fate::NoControlInView,
        _ if !oriented => Fate::NothingLocated,
        _ if 2 * places.used_right > places.used => Fate::AdjustedWrong,
        _ => Fate::WrongHypothesis,
    }
}

/// Counts of the control points of an outcome.
struct Places {
    located: usize,
    located_right: usize,
    used: usize,
    used_right: usize,
}

impl Places {
    fn of(scene: &Scene, outcome: &Outcome) -> Self {
        let mut places = Self { located: 0, located_right: 0, used: 0, used_right: 0 };
        for point in &outcome.control_points {
            let reduced = point.located_px.and_then(|pixel| scene.camera.reduced_from_pixel(pixel));
            let Some(at_px) = reduced else { continue };
            let right = usize::from(located_rightly(scene, &point.name, at_px));
            places.located += 1;
            places.located_right += right;
            if point.used {
                places.used += 1;
                places.used_right += right;
            }
        }
        places
    }
}

/// Whether a control point's reference point truly lies at a place of the image (reduced pixels).
fn located_rightly(scene: &Scene, name: &str, at_px: Vector2<f64>) -> bool {
    let control_point = scene.control.iter().map(|c| &c.control_point).find(|c| c.name == name);
    let c = scene.camera.principal_distance_px;
    let truly = control_point.and_then(|point| scene.true_orientation.reduced_px(c, point.reference_m));
    truly.is_some_and(|truly| (truly - at_px).norm() < LOCATED_PX)
}

/// Predicted and true planimetric errors on the ground.
#[derive(Clone, Copy)]
struct Ground {
    largest_sigma_m: f64,
    error_there_m: f64,
    sigma_of_all_m: f64,
    error_of_all_m: f64,
}

impl Ground {
    fn of(scene: &Scene, predicted: &[GroundPrecision]) -> Option<Self> {
        let c = scene.camera.principal_distance_px;
        let with_error = |point: &GroundPrecision| {
            let reduced = scene.camera.reduced_from_pixel(point.image_px)?;
            let truly = scene.true_orientation.ground_point_m(c, reduced, point.ground_m.z)?;
            Some((point.sigma_planimetric_m, (point.ground_m - truly).xy().norm()))
        };
        let points: Vec<(f64, f64)> = predicted.iter().map(with_error).collect::<Option<_>>()?;
        let (largest_sigma_m, error_there_m) = points.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let mean_square = |value: fn(&(f64, f64)) -> f64| {
            (points.iter().map(|p| value(p).powi(2)).sum::<f64>() / points.len() as f64).sqrt()
        };
        let (sigma_of_all_m, error_of_all_m) = (mean_square(|p| p.0), mean_square(|p| p.1));
        Some(Self { largest_sigma_m, error_there_m, sigma_of_all_m, error_of_all_m })
    }
}

fn mahalanobis_squared(estimate: &Estimate, scene: &Scene) -> Option<f64> {
    let step = estimate.orientation.step_to(&scene.true_orientation);
    let solved = estimate.covariance.cholesky()?.solve(&step);
    Some(step.dot(&solved))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::simulation::SceneSettings;
    use nalgebra::{Matrix6, Vector6};

    /// A row of an image that was oriented rightly by both methods and accepted.
    pub(in crate::study) fn right_row(seed: u64) -> Row {
        Row {
            seed,
            mixture: Mixture::Good,
            gsd_m: 0.2,
            blur_px: 1.0,
            clearness: 1.0,
            control_points_in_view: 10,
            sound_in_view: 9,
            fate: Fate::Right,
            tolerance_gsd: 10.0,
            thresholds_accept: true,
            verdict: Light::Green,
            score: 1.0,
            probability_correct: 0.9,
            points: Some(9),
            eliminated: Some(1),
            log_sigma0: Some(0.1),
            log_configuration: Some(1.0),
            sigma0: Some(1.0),
            configuration: Some(2.0),
            located: 9,
            located_right: 8,
            used: 8,
            used_right: 8,
            d_max_m: Some(0.4),
            d_max_gsd: Some(2.0),
            sigma_planimetric_m: Some(0.3),
            error_there_m: Some(0.4),
            sigma_of_nine_m: Some(0.2),
            error_of_nine_m: Some(0.3),
            mahalanobis_squared: Some(6.5),
            paper_located: 10,
            paper_located_right: 7,
            paper_points: 10,
            paper_eliminated: 3,
            paper_sigma0: Some(1.2),
            paper_configuration: Some(4.0),
            paper_d_max_gsd: Some(3.0),
            paper_accepted: true,
            render_seconds: 0.5,
            pipeline_seconds: 0.3,
            paper_seconds: 0.1,
        }
    }

    fn scene() -> Scene {
        Scene::draw(2, &SceneSettings::default()).unwrap()
    }

    #[test]
    fn mahalanobis_distance_of_a_step_of_known_sigmas() {
        let scene = scene();
        let sigmas = Vector6::new(0.1, 0.1, 0.2, 1e-3, 1e-3, 2e-3);
        let step = sigmas.component_mul(&Vector6::new(1.0, -2.0, 0.5, 1.0, 0.0, -1.0));
        let estimate = Estimate {
            orientation: scene.true_orientation.moved(&step),
            covariance: Matrix6::from_diagonal(&sigmas.map(|s| s * s)),
            sigma0: 1.0,
            redundancy: 10,
            configuration: 1.0,
        };
        let squared = mahalanobis_squared(&estimate, &scene).unwrap();
        assert!((squared - 7.25).abs() < 1e-3, "{squared}");
    }

    #[test]
    fn errors_on_the_ground_are_those_of_the_rays() {
        let scene = scene();
        // a shift of the camera shifts all of the ground alike
        let shifted = scene.true_orientation.moved(&Vector6::new(0.3, 0.4, 0.0, 0.0, 0.0, 0.0));
        let covariance = Matrix6::identity() * 1e-4;
        let points = crate::diagnosis::precision::ground_points(&scene.camera, &shifted, 60.0);
        let predicted = crate::diagnosis::ground_precision(&points, &covariance);
        let ground = Ground::of(&scene, &predicted).unwrap();
        assert!((ground.error_there_m - 0.5).abs() < 1e-9 && (ground.error_of_all_m - 0.5).abs() < 1e-9);
        let largest = predicted.iter().map(|p| p.sigma_planimetric_m).fold(0.0, f64::max);
        assert_eq!(ground.largest_sigma_m, largest);
        assert!(ground.sigma_of_all_m < largest);
    }

    #[test]
    fn places_are_right_within_the_papers_tolerance() {
        let scene = scene();
        let point = &scene.in_view().next().unwrap().control_point;
        let truly = scene.true_orientation.reduced_px(scene.camera.principal_distance_px, point.reference_m).unwrap();
        assert!(located_rightly(&scene, &point.name, truly + Vector2::new(6.0, -7.0)));
        assert!(!located_rightly(&scene, &point.name, truly + Vector2::new(8.0, -7.0)));
        assert!(!located_rightly(&scene, "no such house", truly));
    }

    /// Found by `fuzz/run`: more sound control points than there are in view.
    #[test]
    fn counts_that_contradict_each_other_are_those_of_no_image() {
        let row = right_row(1);
        assert!(row.is_consistent());
        let in_view = row.control_points_in_view;
        assert!(!Row { sound_in_view: in_view + 1, ..row.clone() }.is_consistent());
        assert!(!Row { used: usize::MAX, ..row.clone() }.is_consistent());
        assert!(!Row { paper_located_right: row.paper_located + 1, ..row }.is_consistent());
    }

    #[test]
    fn an_image_is_lost_where_it_went_wrong() {
        let places = |used, used_right| Places { located: used, located_right: used_right, used, used_right };
        assert_eq!(fate(8, true, 10.0, Some(9.9), &places(6, 1)), Fate::Right);
        assert_eq!(fate(8, true, 10.0, Some(10.1), &places(6, 4)), Fate::AdjustedWrong);
        assert_eq!(fate(8, true, 10.0, None, &places(6, 3)), Fate::WrongHypothesis);
        assert_eq!(fate(8, false, 10.0, None, &places(0, 0)), Fate::NothingLocated);
        assert_eq!(fate(0, true, 10.0, Some(50.0), &places(5, 0)), Fate::NoControlInView);
    }
}
