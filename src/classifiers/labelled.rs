//! Images whose orientation was compared with a reference: what classifiers learn from and are judged by. A labelled
//! set is a file of JSON Lines, an image a line.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::diagnosis::d_max_m;
use crate::geometry::{Camera, ExteriorOrientation, rotation};
use crate::pipeline::Outcome;

/// What is kept of an outcome, to be compared with a reference when there is one. In the local frame of the outcome.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The evidence for and against the orientation, as numbers by their names; none without an orientation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evidence: Option<BTreeMap<String, f64>>,
    /// The orientation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimate: Option<Pose>,
    /// Mean height of the control used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground_height_m: Option<f64>,
    /// The orientations with points that the search examined.
    pub trials: Vec<TrialRecord>,
}

/// Projection centre in metres and omega, phi, kappa in radians.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose(pub [f64; 6]);

/// N, E, log sigma0, log lambda_max, and what the trial leads to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrialRecord(pub u32, pub u32, pub f64, pub f64, pub Pose);

impl From<&ExteriorOrientation> for Pose {
    fn from(orientation: &ExteriorOrientation) -> Self {
        let [x, y, z] = orientation.projection_centre_m.into();
        let [omega, phi, kappa] = rotation::angles(&orientation.camera_from_object);
        Self([x, y, z, omega, phi, kappa])
    }
}

impl From<Pose> for ExteriorOrientation {
    fn from(Pose([x, y, z, omega, phi, kappa]): Pose) -> Self {
        let camera_from_object = rotation::camera_from_object(omega, phi, kappa);
        Self { projection_centre_m: Vector3::new(x, y, z), camera_from_object }
    }
}

impl Record {
    /// Of an outcome.
    #[must_use]
    pub fn of(outcome: &Outcome) -> Self {
        let numbers = outcome.evidence.as_ref().map(|evidence| evidence.numbers());
        let trial = |trial: &crate::diagnosis::Trial| {
            let f = &trial.features;
            let (log_sigma0, log_configuration) = (rounded(f.log_sigma0), rounded(f.log_configuration));
            let counts = [f.control_points, f.eliminated].map(|count| count as u32);
            TrialRecord(counts[0], counts[1], log_sigma0, log_configuration, Pose::from(&trial.orientation))
        };
        Self {
            evidence: numbers.map(|n| n.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()),
            estimate: outcome.estimate.as_ref().map(|estimate| Pose::from(&estimate.orientation)),
            ground_height_m: outcome.ground_height_m,
            trials: outcome.trials.iter().map(trial).collect(),
        }
    }

    /// Held against a reference.
    #[must_use]
    pub fn labelled(&self, image: String, area: String, reference: &Reference) -> LabelledImage {
        let Reference { camera, orientation: truth, ground_height_m, tolerance_m } = reference;
        let d_max_m = |pose: Pose| {
            let d_max_m = d_max_m(camera, &pose.into(), truth, *ground_height_m);
            d_max_m.filter(|d_max_m| d_max_m.is_finite())
        };
        let trial = |TrialRecord(points, eliminated, log_sigma0, log_configuration, pose): &TrialRecord| {
            let d_max_m = rounded(d_max_m(*pose).unwrap_or(BEYOND_M));
            TrialRow(*points, *eliminated, *log_sigma0, *log_configuration, d_max_m)
        };
        LabelledImage {
            image,
            area,
            evidence: self.evidence.clone(),
            tolerance_m: *tolerance_m,
            d_max_m: self.estimate.and_then(d_max_m).map(|d_max_m| (d_max_m * 1e6).round() / 1e6),
            trials: self.trials.iter().map(trial).collect(),
        }
    }
}

/// One image of a labelled set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelledImage {
    /// Its name, the same for all orientations of one image.
    pub image: String,
    /// The area or mixture that it is of.
    pub area: String,
    /// The evidence for and against its orientation, as numbers by their names; none if there is no orientation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<BTreeMap<String, f64>>,
    /// The largest D_max that is acceptable, in metres.
    pub tolerance_m: f64,
    /// D_max against the reference, in metres; none if there is no orientation, or one that does not see the ground.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub d_max_m: Option<f64>,
    /// The orientations with points that the search examined.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trials: Vec<TrialRow>,
}

/// An orientation with points: N, E, log sigma0, log lambda_max, and D_max against the reference in metres (1e9 where
/// it does not see the ground).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrialRow(pub u32, pub u32, pub f64, pub f64, pub f64);

/// In metres: a D_max that is infinite.
const BEYOND_M: f64 = 1e9;

/// What the reference says: where the camera truly was, in the local frame of the outcome.
#[derive(Debug, Clone, Copy)]
pub struct Reference<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// Its orientation.
    pub orientation: ExteriorOrientation,
    /// The horizontal plane on which errors are measured.
    pub ground_height_m: f64,
    /// The largest D_max that is acceptable.
    pub tolerance_m: f64,
}

impl LabelledImage {
    /// Whether the orientation is within the tolerance.
    #[must_use]
    pub fn right(&self) -> bool {
        self.d_max_m.is_some_and(|d_max_m| d_max_m <= self.tolerance_m)
    }
}

/// Digits that say nothing make files large.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
