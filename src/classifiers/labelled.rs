//! Images whose orientation was compared with a reference: what classifiers learn from and are judged by. A labelled
//! set is a file of JSON Lines, an image a line.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

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
    #[serde(deserialize_with = "length")]
    pub tolerance_m: f64,
    /// D_max against the reference, in metres; none if there is no orientation, or one that does not see the ground.
    #[serde(default, deserialize_with = "length_if_any", skip_serializing_if = "Option::is_none")]
    pub d_max_m: Option<f64>,
    /// The orientations with points that the search examined.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trials: Vec<TrialRow>,
}

impl LabelledImage {
    /// The same image, labelled by an orientation that is itself known to be wrong: so are all that agree with it. Of
    /// those that do not, nothing is known; they are left out.
    #[must_use]
    pub fn known_to_be_wrong(mut self) -> Self {
        let tolerance_m = self.tolerance_m;
        self.d_max_m = Some(BEYOND_M);
        self.trials.retain(|TrialRow(.., d_max_m)| *d_max_m <= tolerance_m);
        self.trials.iter_mut().for_each(|TrialRow(.., d_max_m)| *d_max_m = BEYOND_M);
        self
    }
}

/// An orientation with points: N, E, log sigma0, log lambda_max, and D_max against the reference in metres (1e9 where
/// it does not see the ground).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrialRow(
    pub u32,
    pub u32,
    #[serde(deserialize_with = "logarithm")] pub f64,
    #[serde(deserialize_with = "logarithm")] pub f64,
    #[serde(deserialize_with = "length")] pub f64,
);

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

/// A negative D_max would pass for a right orientation.
fn length<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let metres = f64::deserialize(deserializer)?;
    if metres < 0.0 { Err(D::Error::custom(format!("{metres} m is negative"))) } else { Ok(metres) }
}

/// No ratio that means anything has a larger one.
const LARGEST_LOGARITHM: f64 = 1e3;

fn logarithm<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    let sensible = value.abs() <= LARGEST_LOGARITHM;
    if sensible { Ok(value) } else { Err(D::Error::custom(format!("{value:e} is no logarithm of a ratio"))) }
}

fn length_if_any<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    #[derive(Deserialize)]
    struct Length(#[serde(deserialize_with = "length")] f64);
    Ok(Option::<Length>::deserialize(deserializer)?.map(|Length(metres)| metres))
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::classifiers::evidence_of;
    use crate::estimation::simulated::Draws;
    use crate::geometry::Brown;

    /// Images of which the evidence tells mostly, but not always, whether they are right; every tenth has none.
    pub(crate) fn simulated(area: &str, seed: u64, count: usize) -> Vec<LabelledImage> {
        let mut draws = Draws::new(seed);
        (0..count).map(|k| image(area, k, &mut draws)).collect()
    }

    fn image(area: &str, k: usize, draws: &mut Draws) -> LabelledImage {
        let (image, tolerance_m) = (format!("{area}-{k}"), 0.5);
        if k % 10 == 9 {
            let (area, evidence, d_max_m, trials) = (area.to_owned(), None, None, vec![]);
            return LabelledImage { image, area, evidence, tolerance_m, d_max_m, trials };
        }
        let quality = draws.normal();
        // one for an average image; better ones have more of it if `slope` is positive
        let mut about = |slope: f64| rounded((slope * quality + 0.3 * draws.normal()).exp());
        let numbers = [
            ("points", 12.0),
            ("eliminated", (2.0 * about(-0.3)).round()),
            ("log_sigma0_of_points", about(-0.8).ln()),
            ("log_configuration_of_points", 1.0 + about(-0.3).ln()),
            ("sigma0", about(-0.3)),
            ("redundancy", 200.0),
            ("configuration", 3.0 * about(-0.3)),
            ("control_points", (8.0 * about(0.3)).round()),
            ("control_points_in_view", 16.0),
            ("inlier_share", 1.0 / (1.0 + 0.2 * about(-0.4))),
            ("matched_share", 1.0 / (1.0 + about(-0.4))),
            ("matched_share_in_view", 1.0 / (1.0 + about(-0.4))),
            ("hull_share", 1.0 / (1.0 + about(-0.4))),
            ("sigma_planimetric_m", 0.1 * about(-0.5)),
            ("sigma_of_nine_m", 0.1 * about(-0.5)),
            ("tolerance_m", tolerance_m),
            ("log_odds", 60.0 * about(0.5)),
            ("runner_up_log_odds", 20.0 * about(-0.3)),
            ("distance_from_approximation", 6.0 * about(-0.3)),
            ("moved_by_lines_m", 0.1 * about(-0.3)),
            ("change_by_one_m", 0.1 * about(-0.5)),
            ("change_by_two_m", 0.2 * about(-0.5)),
            ("undetected_by_one_m", 0.1 * about(-0.5)),
            ("undetected_by_two_m", 0.2 * about(-0.5)),
            ("largest_test", 6.0 * about(-0.4)),
            ("mean_test", 2.0 * about(-0.4)),
            ("contradicting", 0.0),
            ("risk_by_chance", (0.01 * about(-1.0)).min(0.9)),
            ("risk_with_displacement", (0.02 * about(-1.0)).min(0.9)),
            ("risk_with_pair", (0.02 * about(-1.0)).min(0.9)),
        ];
        let d_max_m = rounded(0.4 * about(-1.0));
        let trial = |k: u32| {
            let [log_sigma0, more_m] = [numbers[2].1, d_max_m].map(|value| rounded(value + 0.3 * f64::from(k)));
            TrialRow(12 - k, 1 + k, log_sigma0, rounded(numbers[3].1), more_m)
        };
        LabelledImage {
            image,
            area: area.to_owned(),
            evidence: Some(numbers.map(|(name, value)| (name.to_owned(), rounded(value))).into()),
            tolerance_m,
            d_max_m: Some(d_max_m),
            trials: (0..3).map(trial).collect(),
        }
    }

    fn read(line: &str) -> Result<LabelledImage, String> {
        serde_json::from_str(line).map_err(|error| error.to_string())
    }

    #[test]
    fn simulated_images_are_of_both_kinds_with_usable_evidence() {
        let images = simulated("north", 1, 200);
        let right = images.iter().filter(|image| image.right()).count();
        assert!((60..140).contains(&right), "{right}");
        assert!(images.iter().filter_map(|image| image.evidence.as_ref()).all(|numbers| evidence_of(numbers).is_ok()));
    }

    #[test]
    fn lines_are_read_back_and_written_the_same() {
        for image in simulated("north", 2, 100) {
            let line = serde_json::to_string(&image).unwrap();
            assert!(!line.contains('\n'));
            assert_eq!(read(&line), Ok(image));
        }
        // without an orientation there is little to say
        let bare = r#"{"image":"a","area":"b","tolerance_m":0.5}"#;
        assert_eq!(serde_json::to_string(&read(bare).unwrap()).unwrap(), bare);
        assert!(!read(bare).unwrap().right());
    }

    #[test]
    fn numbers_that_are_none_are_refused() {
        let line = |tolerance: &str, d_max: &str, trial: &str| {
            read(&format!(
                r#"{{"image":"a","area":"b","tolerance_m":{tolerance},"d_max_m":{d_max},"trials":[[9,1,{trial}]]}}"#
            ))
        };
        assert!(line("0.5", "0.1", "0.1,1.2,0.3").unwrap().right());
        for (tolerance, d_max, trial) in [
            ("-0.5", "0.1", "0.1,1.2,0.3"),
            ("0.5", "-0.1", "0.1,1.2,0.3"),
            ("0.5", "0.1", "0.1,1.2,-0.3"),
            ("null", "0.1", "0.1,1.2,0.3"),
            ("0.5", "NaN", "0.1,1.2,0.3"),
            ("0.5", "1e999", "0.1,1.2,0.3"),
            ("0.5", "0.1", "null,1.2,0.3"),
            ("0.5", "0.1", "0.1,1e200,0.3"),
            ("0.5", "0.1", "0.1,1.2"),
            ("0.5", "\"0.1\"", "0.1,1.2,0.3"),
        ] {
            assert!(line(tolerance, d_max, trial).is_err(), "{tolerance} {d_max} {trial}");
        }
        assert!(read(r#"{"image":"a","area":"b","tolerance_m":0.5,"evidence":{"points":null}}"#).is_err());
        let misspelt = read(r#"{"image":"a","area":"b","tolerance_m":0.5,"dmax_m":0.1}"#).unwrap_err();
        assert!(misspelt.contains("dmax_m"), "{misspelt}");
    }

    #[test]
    fn a_record_is_held_against_the_reference() {
        let camera = Camera::new([4000, 3000], 2000.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap();
        let pose = |x: f64, y: f64| Pose([x, y, 400.0, 0.0, 0.0, 0.7]);
        let record = Record {
            evidence: Some([("sigma0".to_owned(), 1.25)].into()),
            estimate: Some(pose(3.0, 4.0)),
            ground_height_m: Some(100.0),
            // the second looks at the sky
            trials: vec![
                TrialRecord(9, 1, 0.5, 1.5, pose(0.0, 0.5)),
                TrialRecord(8, 2, 0.6, 1.6, Pose([0.0, 0.0, 400.0, 3.0, 0.0, 0.0])),
            ],
        };
        let reference = |tolerance_m: f64| Reference {
            camera: &camera,
            orientation: pose(0.0, 0.0).into(),
            ground_height_m: 100.0,
            tolerance_m,
        };
        let labelled = record.labelled("image".into(), "area".into(), &reference(5.0));
        assert_eq!((labelled.d_max_m, labelled.right(), &labelled.evidence), (Some(5.0), true, &record.evidence));
        assert_eq!(labelled.trials, [TrialRow(9, 1, 0.5, 1.5, 0.5), TrialRow(8, 2, 0.6, 1.6, 1e9)]);
        assert!(!record.labelled("image".into(), "area".into(), &reference(4.99)).right());
        // it is kept as JSON
        let text = serde_json::to_string(&record).unwrap();
        assert_eq!(serde_json::from_str::<Record>(&text).unwrap(), record);
        let lost = Record { estimate: None, ..record };
        assert_eq!(lost.labelled("image".into(), "area".into(), &reference(5.0)).d_max_m, None);
    }

    #[test]
    fn a_pose_is_the_orientation_that_it_was_made_of() {
        let orientation = ExteriorOrientation::from(Pose([1.0, -2.0, 300.0, 0.1, -0.2, 2.9]));
        let Pose(numbers) = Pose::from(&orientation);
        for (a, b) in numbers.iter().zip([1.0, -2.0, 300.0, 0.1, -0.2, 2.9]) {
            assert!((a - b).abs() < 1e-12, "{a} instead of {b}");
        }
    }
}
