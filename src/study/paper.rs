//! The paper's own method (Förstner and Läbe 2.2 and 2.3) with our own parts, for comparison on the same images: each
//! control point at its single best place, the orientation with points by version A, the adjustment with lines, and
//! thresholds on the paper's features. Nothing is predicted anew before the points are chosen, no second place of a
//! control point is kept, no other orientation is held against the one that was found.

use nalgebra::Vector2;

use crate::diagnosis::{lambda_max, reference_covariance};
use crate::estimation::{PointObservation, Prior, Resection, Survey, quadruples};
use crate::features::{Picture, PictureError};
use crate::geometry::{Camera, ExteriorOrientation, Segment2};
use crate::orientation::ControlPoint;
use crate::orientation::collect::adjust_with_lines;
use crate::orientation::extract::Extraction;
use crate::orientation::locate::{Clustering, shift_map};
use crate::orientation::predict::{Approximation, Prediction, edges_px, on_frame};
use crate::orientation::search::{Search, reach};
use crate::orientation::select::maybe_in_view;

/// Where a control point was located.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Its name.
    pub name: String,
    /// Its reference point, in reduced pixels.
    pub at_px: Vector2<f64>,
}

/// What the method finds.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The orientation with lines, if any.
    pub orientation: Option<ExteriorOrientation>,
    /// The control points that were located, rightly or not.
    pub located: Vec<Place>,
    /// N: those that the orientation with points was sought among.
    pub points: usize,
    /// E: of those, the eliminated.
    pub eliminated: usize,
    /// Standard deviation of unit weight of the orientation with points.
    pub sigma0: f64,
    /// lambda_max of the orientation with points.
    pub configuration: f64,
}

/// The window reaches so many standard deviations of the prediction to either side.
const WINDOW_SIGMAS: f64 = 2.5;
/// Half the width of a window at least and at most: the paper's windows have 250 pixels, those of images whose tilt is
/// not known more.
const HALF_WIDTH_PX: [f64; 2] = [125.0, 500.0];
/// A cell is as wide as the segments and the shape of a building under a tilt of some degrees are uncertain.
const CELL_PX: f64 = 3.0;
const DIRECTION_TOLERANCE_RAD: f64 = 7.0 * std::f64::consts::PI / 180.0;
/// Standard deviation of a located point: half a cell.
const SIGMA_PX: f64 = 1.5;
/// Version A tries all quadruples of so many points: 4845 of 20.
const MOST_POINTS: usize = 20;
/// t_e of the paper.
const TOLERANCE_PX: f64 = 10.0;
/// T_P: two or three times what was assumed.
const LARGEST_SIGMA0: f64 = 3.0;
/// T_C.
const LARGEST_CONFIGURATION: f64 = 10.0;
/// Four points always agree with themselves.
const LEAST_POINTS: usize = 5;

impl Found {
    fn nothing(located: Vec<Place>) -> Self {
        Self {
            orientation: None,
            located,
            points: 0,
            eliminated: 0,
            sigma0: f64::INFINITY,
            configuration: f64::INFINITY,
        }
    }

    /// Whether the self-diagnosis by thresholds accepts it.
    #[must_use]
    pub fn accepted(&self) -> bool {
        self.orientation.is_some()
            && self.sigma0 <= LARGEST_SIGMA0
            && self.configuration <= LARGEST_CONFIGURATION
            && self.points - self.eliminated >= LEAST_POINTS
    }
}

/// Orients one image by the control points around it.
///
/// # Errors
/// [`PictureError`] if the picture cannot be read.
pub fn orient(
    picture: &dyn Picture,
    control: &[ControlPoint],
    camera: &Camera,
    approximation: &Approximation,
) -> Result<Found, PictureError> {
    let control = maybe_in_view(control, camera, approximation);
    // the segments of the full resolution, however long the edges are
    let mut extraction = Extraction::new(picture, camera, 0.0);
    let start = &approximation.orientation;
    let Some(prior) = approximation.prior(start) else { return Ok(Found::nothing(Vec::new())) };
    let Some(covariance) = prior.information.try_inverse() else { return Ok(Found::nothing(Vec::new())) };
    let prediction = Prediction { orientation: *start, covariance };
    let mut places = Vec::new();
    for control_point in &control {
        places.extend(located(control_point, camera, &prediction, &mut extraction)?);
    }
    places.sort_by(|a, b| b.log_likelihood.total_cmp(&a.log_likelihood));
    let names = places.iter().map(|p| Place { name: p.name.clone(), at_px: p.point.image_px }).collect();
    places.truncate(MOST_POINTS);
    let points: Vec<PointObservation> = places.iter().map(|place| place.point).collect();
    let Some((fit, inliers)) = oriented_by(&points, camera, &prior) else { return Ok(Found::nothing(names)) };
    let configuration =
        reference(&points, camera, &fit.orientation, &prior).and_then(|r| lambda_max(&fit.covariance, &r));
    let inflation = fit.sigma0().max(1.0).powi(2);
    let by_points = Prediction { orientation: fit.orientation, covariance: fit.covariance * inflation };
    let search = Search::new(camera, &control, approximation);
    let adjustment = adjust_with_lines(&search, &by_points, &mut extraction)?;
    Ok(Found {
        orientation: adjustment.map(|a| a.orientation),
        located: names,
        points: points.len(),
        eliminated: points.len() - inliers,
        sigma0: fit.sigma0(),
        configuration: configuration.unwrap_or(f64::INFINITY),
    })
}

struct Located {
    name: String,
    point: PointObservation,
    log_likelihood: f64,
}

/// The best peak for a control point that is predicted on the frame.
fn located(
    control_point: &ControlPoint,
    camera: &Camera,
    prediction: &Prediction,
    extraction: &mut Extraction,
) -> Result<Option<Located>, PictureError> {
    let expected = prediction.image_of(camera, control_point.reference_m, control_point.sigma_m);
    let Some((predicted, covariance)) = expected.filter(|(p, _)| on_frame(camera, *p, 0.0)) else { return Ok(None) };
    let sigma_px = covariance.symmetric_eigenvalues().max().sqrt();
    let half_width_px = (WINDOW_SIGMAS * sigma_px).clamp(HALF_WIDTH_PX[0], HALF_WIDTH_PX[1]);
    let edges: Vec<Segment2> = edges_px(camera, &prediction.orientation, control_point).into_iter().flatten().collect();
    let reach_px = reach(&edges, predicted);
    let [least, largest] = camera.pixels_around(predicted, half_width_px + reach_px);
    extraction.cover(least, largest)?;
    let clustering =
        Clustering { half_width_px, cell_px: CELL_PX, direction_tolerance_rad: DIRECTION_TOLERANCE_RAD, fine: true };
    let peaks = shift_map(&edges, predicted, extraction.segments(), &clustering).peaks(1);
    Ok(peaks.first().map(|peak| Located {
        name: control_point.name.clone(),
        point: PointObservation { object_m: control_point.reference_m, image_px: peak.at_px, sigma_px: SIGMA_PX },
        log_likelihood: peak.log_likelihood,
    }))
}

/// Version A: the orientation with points and the number of inliers. The approximation is an observation: without
/// it, the quadruples over nearly level ground leave position and tilt to one another.
fn oriented_by(points: &[PointObservation], camera: &Camera, prior: &Prior) -> Option<(Resection, usize)> {
    let start = &prior.orientation;
    let reference = reference(points, camera, start, prior)?;
    let acceptable =
        |fit: &Resection| lambda_max(&fit.covariance, &reference).is_some_and(|l| l <= LARGEST_CONFIGURATION);
    let c = camera.principal_distance_px;
    let survey = Survey { points, prior: Some(prior), start: *start, principal_distance_px: c };
    let consensus = quadruples(&survey, &acceptable, TOLERANCE_PX, usize::MAX, &|| false)?;
    Some((consensus.resection, consensus.inliers.len()))
}

/// Four points in the corners of the image.
fn reference(
    points: &[PointObservation],
    camera: &Camera,
    at: &ExteriorOrientation,
    prior: &Prior,
) -> Option<nalgebra::Matrix6<f64>> {
    let height_m = points.iter().map(|p| p.object_m.z).sum::<f64>() / points.len() as f64;
    reference_covariance(camera, at, height_m, SIGMA_PX, Some(prior))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::d_max_m;
    use crate::simulation::{Scene, SceneSettings};

    fn found(scene: &Scene, control: &[ControlPoint]) -> Found {
        orient(&scene.picture(), control, &scene.camera, &scene.approximation).unwrap()
    }

    #[test]
    fn a_clear_village_is_oriented_by_its_best_places() {
        let mut settings = SceneSettings::default();
        settings.control.share = 0.7;
        settings.flight.sigma_tilt_deg = 0.7;
        settings.flight.sigma_kappa_deg = 1.0;
        let scene = Scene::draw(7, &settings).unwrap();
        let found = found(&scene, &scene.control_points());
        let orientation = found.orientation.unwrap();
        let error_m = d_max_m(&scene.camera, &orientation, &scene.true_orientation, scene.ground_height_m()).unwrap();
        assert!(error_m < 10.0 * scene.ground_sample_distance_m(), "{error_m} m");
        assert_eq!(found.points, MOST_POINTS);
        assert!(found.points - found.eliminated >= LEAST_POINTS);
    }

    #[test]
    fn without_control_there_is_nothing() {
        let scene = Scene::draw(7, &SceneSettings::default()).unwrap();
        let found = found(&scene, &[]);
        assert_eq!((found.orientation, found.points, found.located.len()), (None, 0, 0));
        assert!(!Found::nothing(Vec::new()).accepted());
    }

    #[test]
    fn thresholds_accept_only_what_keeps_all_of_them() {
        let scene = Scene::draw(7, &SceneSettings::default()).unwrap();
        let good = Found {
            orientation: Some(scene.true_orientation),
            located: Vec::new(),
            points: 9,
            eliminated: 4,
            sigma0: 2.9,
            configuration: 9.9,
        };
        assert!(good.accepted());
        assert!(!Found { sigma0: 3.1, ..good.clone() }.accepted());
        assert!(!Found { configuration: 10.1, ..good.clone() }.accepted());
        assert!(!Found { eliminated: 5, ..good.clone() }.accepted());
        assert!(!Found { orientation: None, ..good }.accepted());
    }
}
