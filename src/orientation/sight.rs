//! Control scenes in the search: where SIFT sees them under a prediction, as candidates beside those of the buildings.

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::ControlPoint;
use super::extract::Extraction;
use super::gate::{GATE, Located, Scale};
use super::locate::Peak;
use super::predict::{Prediction, on_frame};
use super::search::{Candidate, Search, WIDE, square};
use super::views::{HALF_VIEW_RAD, REACH_SIGMAS};
use crate::estimation::largest_sigma;
use crate::features::PictureError;
use crate::geometry::{Camera, ExteriorOrientation, rotation};
use crate::scenes::keys::reduction_for;
use crate::scenes::measure::{self, measure};
use crate::scenes::{Gate, Measured, Scene, SceneKey, Sighting, View, correspondences, scene_keys, sightings};

/// In narrow windows a scene is looked for up to so many standard deviations: the gate of the candidates.
const NARROW_SIGMAS: f64 = 3.4;
/// Standard deviation of the logarithm of a stated ground sample distance, and of the ground not being a plane.
const SIGMA_LOG_GSD: f64 = 0.03;
/// How far key points may be from a similarity, for each pixel of distance from the reference: relief.
const RELIEF: f64 = 0.02;
/// A heading known no better is not known.
const NO_HEADING_RAD: f64 = 0.5;
/// A place that chance would bring about once in seven images is no candidate.
const LEAST_LOG_ODDS: f64 = 2.0;
/// Standard deviation of a scene's reference that either SIFT or least-squares matching has found, but not both: across a
/// path in the grass all is clear, along it little. (On `../shared/bench` such places were up to 4 px off.)
const SIGMA_FOUND_ONCE_PX: f64 = 2.0;
/// Variance that every measured scene has beside its own: seasons and shadows move what the eye takes for the same.
const SCENE_PX2: f64 = 0.1;

/// The scale at which a place may be sure.
const SURE: Scale = Scale { cell_px: 1.0, sigma_px: 1.0 };
/// Where SIFT sees nothing, the pictures must resemble each other so much: an edge looks like any other edge.
const LEAST_CORRELATION_UNSEEN: f64 = 0.75;

/// What the scenes of a search look like in the image.
pub(super) struct SceneLooks {
    keys: Vec<Vec<SceneKey>>,
    reduction: u32,
}

impl SceneLooks {
    /// Where no scene is looked for.
    pub(super) fn none() -> Self {
        Self { keys: Vec::new(), reduction: 1 }
    }

    /// The key points of all scenes among the control points.
    pub(super) fn of(camera: &Camera, control: &[ControlPoint], orientation: &ExteriorOrientation) -> Self {
        let view = |point: &ControlPoint| View { camera, orientation, reference_m: point.reference_m };
        let maps = control.iter().filter_map(|point| view(point).file_by_scene(point.scene.as_deref()?));
        let reduction = reduction_for(maps);
        let of_one = |point: &ControlPoint| {
            let scene = point.scene.as_deref();
            scene.map_or(Vec::new(), |scene| scene_keys(scene, &view(point), reduction))
        };
        Self { keys: control.par_iter().map(of_one).collect(), reduction }
    }
}

impl Search<'_> {
    /// By how much the image is reduced for the scenes.
    #[must_use]
    pub fn reduction(&self) -> u32 {
        self.looks.reduction
    }

    /// Whether there are scenes among the control points.
    #[must_use]
    pub fn has_scenes(&self) -> bool {
        self.control.iter().any(|point| point.scene.is_some())
    }

    /// Adds the places where the scenes may be under all that the approximation allows.
    pub(super) fn sight_all(
        &self,
        extraction: &mut Extraction,
        candidates: &mut [Vec<Candidate>],
    ) -> Result<(), PictureError> {
        let approximation = self.approximation;
        let prior = approximation.prior(&approximation.orientation);
        let Some(covariance) = prior.and_then(|prior| prior.information.try_inverse()) else { return Ok(()) };
        let prediction = Prediction { orientation: approximation.orientation, covariance };
        let gates: Vec<(usize, Gate)> = self.gates(&prediction, REACH_SIGMAS, WIDE);
        self.cover_gates(gates.iter(), extraction)?;
        let extraction = &*extraction;
        let seen = |(k, gate): &(usize, Gate)| (*k, self.sightings(*k, gate, &prediction.orientation, extraction));
        let seen: Vec<(usize, Vec<Sighting>)> = gates.par_iter().map(seen).collect();
        for ((k, sightings), (_, gate)) in seen.iter().zip(&gates) {
            let candidate = |sighting: &Sighting| Candidate {
                peak: peak(sighting, gate, WIDE),
                view: self.turned(&prediction.orientation, sighting),
            };
            candidates[*k].extend(sightings.iter().map(candidate));
        }
        Ok(())
    }

    /// Reads what the scenes need under predictions.
    pub(super) fn cover_scenes<'p>(
        &self,
        predictions: impl Iterator<Item = &'p Prediction>,
        scale: Scale,
        extraction: &mut Extraction,
    ) -> Result<(), PictureError> {
        let gates: Vec<_> = predictions.flat_map(|prediction| self.gates(prediction, NARROW_SIGMAS, scale)).collect();
        self.cover_gates(gates.iter(), extraction)
    }

    /// The candidates of the scenes under a prediction, each in the list of its control point.
    pub(super) fn sight(
        &self,
        prediction: &Prediction,
        scale: Scale,
        extraction: &Extraction,
        candidates: &mut [Vec<Peak>],
    ) {
        for (k, gate) in self.gates(prediction, NARROW_SIGMAS, scale) {
            let sightings = self.sightings(k, &gate, &prediction.orientation, extraction);
            candidates[k].extend(sightings.iter().map(|sighting| peak(sighting, &gate, scale)));
        }
    }

    /// The reference of a scene, which SIFT has seen, by least-squares matching; where that fails, as it was seen.
    pub(super) fn measured(
        &self,
        control_point: usize,
        at_px: Vector2<f64>,
        orientation: &ExteriorOrientation,
        extraction: &mut Extraction,
    ) -> Result<Option<Measured>, PictureError> {
        if self.control[control_point].scene.is_none() {
            return Ok(None);
        }
        if let Some(seen) = self.seen_scenes().find(|seen| seen.control_point == control_point) {
            return Ok(Some(seen.measured));
        }
        let seen = Measured { at_px, covariance: Matrix2::identity() * SIGMA_FOUND_ONCE_PX.powi(2), correlation: 0.0 };
        Ok(Some(self.measured_near(control_point, at_px, orientation, extraction)?.unwrap_or(seen)))
    }

    /// The reference of a scene near a place, by least-squares matching.
    fn measured_near(
        &self,
        control_point: usize,
        start_px: Vector2<f64>,
        orientation: &ExteriorOrientation,
        extraction: &mut Extraction,
    ) -> Result<Option<Measured>, PictureError> {
        let Some(scene) = self.control[control_point].scene.as_deref() else { return Ok(None) };
        let view = self.view(control_point, orientation);
        let measured = extraction.measured(control_point, start_px, |picture, reduction| {
            measure(picture, scene, &view, start_px, reduction)
        })?;
        Ok(measured.map(|m| Measured { covariance: m.covariance + Matrix2::identity() * SCENE_PX2, ..m }))
    }

    /// The references of the scenes that SIFT does not see, where a prediction is so sure of their places that
    /// least-squares matching can begin there.
    pub(super) fn measured_where_predicted(
        &self,
        prediction: &Prediction,
        seen: &[Located],
        extraction: &mut Extraction,
    ) -> Result<Vec<(usize, Measured)>, PictureError> {
        let unseen = self.seen_scenes().filter(|known| known.located.is_none());
        let mut found: Vec<(usize, Measured)> = unseen.map(|known| (known.control_point, known.measured)).collect();
        for (k, gate) in self.gates(prediction, NARROW_SIGMAS, SURE) {
            let sure_px = measure::SEARCH_CELLS as f64 * f64::from(extraction.keys().reduction()) / NARROW_SIGMAS;
            let sure = largest_sigma(&gate.covariance) <= sure_px;
            if !sure || seen.iter().any(|located| located.control_point == k) {
                continue;
            }
            let start_px = gate.predicted_px;
            let Some(measured) = self.measured_near(k, start_px, &prediction.orientation, extraction)? else {
                continue;
            };
            let away = measured.at_px - gate.predicted_px;
            let expected = gate.covariance.try_inverse().is_some_and(|weight| away.dot(&(weight * away)) <= GATE);
            if expected && measured.correlation >= LEAST_CORRELATION_UNSEEN {
                let covariance = measured.covariance + Matrix2::identity() * SIGMA_FOUND_ONCE_PX.powi(2);
                found.push((k, Measured { covariance, ..measured }));
            }
        }
        Ok(found)
    }

    fn view<'v>(&'v self, control_point: usize, orientation: &'v ExteriorOrientation) -> View<'v> {
        View { camera: self.camera, orientation, reference_m: self.control[control_point].reference_m }
    }

    /// Where the scenes are expected that may be on the frame; nothing if they are not to be looked for.
    fn gates(&self, prediction: &Prediction, reach_sigmas: f64, scale: Scale) -> Vec<(usize, Gate)> {
        if self.by_hand.scenes.is_some() {
            return Vec::new();
        }
        let gate = |k: usize| {
            let scene = self.control[k].scene.as_deref()?;
            self.scene_gate(k, scene, prediction, reach_sigmas, scale).map(|gate| (k, gate))
        };
        (0..self.control.len()).filter(|k| self.is_on(*k)).filter_map(gate).collect()
    }

    fn scene_gate(
        &self,
        control_point: usize,
        scene: &Scene,
        prediction: &Prediction,
        reach_sigmas: f64,
        scale: Scale,
    ) -> Option<Gate> {
        let reference = &self.control[control_point];
        let expected = prediction.image_of(self.camera, reference.reference_m, reference.sigma_m);
        let (predicted_px, covariance) = expected?;
        let covariance = covariance + Matrix2::identity() * scale.sigma_px.powi(2);
        if !on_frame(self.camera, predicted_px, reach_sigmas * largest_sigma(&covariance)) {
            return None;
        }
        let depth_m = -prediction.orientation.camera_coordinates(reference.reference_m).z;
        let sigma_turn = prediction.covariance[(5, 5)].sqrt().hypot(scene.sigma_azimuth_rad);
        let sigma_tilt = prediction.covariance[(3, 3)].max(prediction.covariance[(4, 4)]).sqrt();
        // twice the tilt's standard deviation foreshortens by so much
        let foreshortening = (2.0 * sigma_tilt).min(1.0).powi(2) / 2.0;
        let sigma_log_scale = (prediction.covariance[(2, 2)].sqrt() / depth_m).hypot(SIGMA_LOG_GSD);
        Some(Gate {
            predicted_px,
            covariance,
            reach_sigmas,
            most_px2: self.camera.frame_area_px2(),
            sigma_turn_rad: (sigma_turn < NO_HEADING_RAD).then_some(sigma_turn),
            sigma_log_scale: sigma_log_scale + foreshortening / 2.0,
            relief: RELIEF + foreshortening,
        })
    }

    fn cover_gates<'g>(
        &self,
        gates: impl Iterator<Item = &'g (usize, Gate)>,
        extraction: &mut Extraction,
    ) -> Result<(), PictureError> {
        let rectangle = |(k, gate): &(usize, Gate)| {
            let reach_px = gate.reach_sigmas * largest_sigma(&gate.covariance) + self.half_extent_px(*k);
            square(self.camera, gate.predicted_px, reach_px)
        };
        extraction.cover_keys(&gates.map(rectangle).collect::<Vec<_>>())
    }

    /// How far a scene reaches around its reference.
    fn half_extent_px(&self, control_point: usize) -> f64 {
        let Some(scene) = self.control[control_point].scene.as_deref() else { return 0.0 };
        let view = self.view(control_point, &self.approximation.orientation);
        let by_ground = view.reduced_by_ground().map_or(0.0, |m| m.norm());
        scene.gsd_m * scene.width.max(scene.height) as f64 / 2.0 * by_ground
    }

    fn sightings(
        &self,
        control_point: usize,
        gate: &Gate,
        orientation: &ExteriorOrientation,
        extraction: &Extraction,
    ) -> Vec<Sighting> {
        let (keys, image) = (&self.looks.keys[control_point], extraction.keys());
        let found = correspondences(keys, &self.view(control_point, orientation), image, gate);
        let mut places = sightings(&found, gate, image.reduction());
        places.retain(|s| s.log_odds > LEAST_LOG_ODDS && on_frame(self.camera, s.at_px, 0.0));
        places
    }

    /// The approximate orientation, turned and lifted as a scene is seen.
    fn turned(&self, orientation: &ExteriorOrientation, sighting: &Sighting) -> ExteriorOrientation {
        let [omega, phi, kappa] = rotation::angles(&orientation.camera_from_object);
        let mut turned = *orientation;
        // y of the image points down: what turns from x to y there turns the camera from y to x
        let turn = if sighting.turn_rad.abs() > HALF_VIEW_RAD { sighting.turn_rad } else { 0.0 };
        turned.camera_from_object = rotation::camera_from_object(omega, phi, kappa + turn);
        let height_m = self.typical_height_m();
        turned.projection_centre_m.z =
            height_m + (orientation.projection_centre_m.z - height_m) * (-sighting.log_scale).exp();
        turned
    }
}

/// A sighting as a candidate: against the scene being at any other place of the gate.
fn peak(sighting: &Sighting, gate: &Gate, scale: Scale) -> Peak {
    let cells = gate.area_px2() / (2.0 * scale.cell_px).powi(2);
    Peak { at_px: sighting.at_px, log_likelihood: sighting.log_odds + cells.max(1.0).ln() }
}
