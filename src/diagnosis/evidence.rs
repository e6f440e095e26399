//! Everything that an orientation is judged by, as it was measured; features for classifiers are made of it.

use super::risk::Risk;
use super::verdict::Features;
use crate::geometry::ExteriorOrientation;

/// What is known of an orientation when it is judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// The paper's features, after the orientation with points.
    pub features: Features,
    /// Standard deviation of unit weight of the adjustment with lines.
    pub sigma0: f64,
    /// Redundancy of the adjustment with lines.
    pub redundancy: usize,
    /// lambda_max of the adjustment against four control points in the corners.
    pub configuration: f64,
    /// Control points that took part in the adjustment.
    pub control_points: usize,
    /// Control points that the orientation puts on the frame.
    pub control_points_in_view: usize,
    /// Share of the matched line segments that kept their weight.
    pub inlier_share: f64,
    /// Share of the length of their model edges that has a line segment in the image, of the control points that took
    /// part.
    pub matched_share: f64,
    /// The same of all control points that the orientation puts on the frame.
    pub matched_share_in_view: f64,
    /// The convex hull of the control points that took part, as a share of the frame.
    pub hull_share: f64,
    /// Largest predicted planimetric standard deviation on the 3x3 ground grid; infinite if a ray misses the ground.
    pub sigma_planimetric_m: f64,
    /// Root of the mean predicted planimetric variance of the grid.
    pub sigma_of_nine_m: f64,
    /// The largest D_max that the user can accept.
    pub tolerance_m: f64,
    /// Logarithm of the odds of the chosen orientation.
    pub log_odds: f64,
    /// The same of the best orientation that differs from it.
    pub runner_up_log_odds: f64,
    /// Squared distance from the approximation, in its standard deviations (6 degrees of freedom).
    pub distance_from_approximation: f64,
    /// So far the adjustment with lines has moved the ground of the orientation with points.
    pub moved_by_lines_m: f64,
    /// What the control points do to the ground.
    pub sensitivity: SensitivityEvidence,
    /// Probabilities that the ground is off by more than the tolerance.
    pub risk: Risk,
}

/// The extremes of the sensitivities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensitivityEvidence {
    /// So far the ground moves at most if one control point is left out.
    pub change_by_one_m: f64,
    /// ...if two are.
    pub change_by_two_m: f64,
    /// What an undetected error of one can do.
    pub undetected_by_one_m: f64,
    /// ...of two.
    pub undetected_by_two_m: f64,
    /// The largest test of a single control point.
    pub largest_test: f64,
    /// The mean test of single control points: 2 is expected.
    pub mean_test: f64,
    /// Control points that contradict all others.
    pub contradicting: usize,
}

/// Beyond this, numbers say no more than that they are beyond; files and databases know no infinity.
const LARGEST: f64 = 1e9;

impl Evidence {
    /// All of it as numbers with their names: what is kept in files and in the database. Finite; what is not a number is
    /// taken to be as bad as can be.
    #[must_use]
    pub fn numbers(&self) -> [(&'static str, f64); 30] {
        let large_is_bad = |value: f64| if value.is_nan() { LARGEST } else { value.clamp(-LARGEST, LARGEST) };
        let small_is_bad = |value: f64| if value.is_nan() { -LARGEST } else { value.clamp(-LARGEST, LARGEST) };
        let count = |value: usize| value as f64;
        let s = &self.sensitivity;
        [
            ("points", count(self.features.control_points)),
            ("eliminated", count(self.features.eliminated)),
            ("log_sigma0_of_points", large_is_bad(self.features.log_sigma0)),
            ("log_configuration_of_points", large_is_bad(self.features.log_configuration)),
            ("sigma0", large_is_bad(self.sigma0)),
            ("redundancy", count(self.redundancy)),
            ("configuration", large_is_bad(self.configuration)),
            ("control_points", count(self.control_points)),
            ("control_points_in_view", count(self.control_points_in_view)),
            ("inlier_share", small_is_bad(self.inlier_share)),
            ("matched_share", small_is_bad(self.matched_share)),
            ("matched_share_in_view", small_is_bad(self.matched_share_in_view)),
            ("hull_share", small_is_bad(self.hull_share)),
            ("sigma_planimetric_m", large_is_bad(self.sigma_planimetric_m)),
            ("sigma_of_nine_m", large_is_bad(self.sigma_of_nine_m)),
            ("tolerance_m", small_is_bad(self.tolerance_m)),
            ("log_odds", small_is_bad(self.log_odds)),
            ("runner_up_log_odds", large_is_bad(self.runner_up_log_odds)),
            ("distance_from_approximation", large_is_bad(self.distance_from_approximation)),
            ("moved_by_lines_m", large_is_bad(self.moved_by_lines_m)),
            ("change_by_one_m", large_is_bad(s.change_by_one_m)),
            ("change_by_two_m", large_is_bad(s.change_by_two_m)),
            ("undetected_by_one_m", large_is_bad(s.undetected_by_one_m)),
            ("undetected_by_two_m", large_is_bad(s.undetected_by_two_m)),
            ("largest_test", large_is_bad(s.largest_test)),
            ("mean_test", large_is_bad(s.mean_test)),
            ("contradicting", count(s.contradicting)),
            ("risk_by_chance", large_is_bad(self.risk.by_chance)),
            ("risk_with_displacement", large_is_bad(self.risk.with_displacement)),
            ("risk_with_pair", large_is_bad(self.risk.with_pair)),
        ]
    }

    /// The evidence of named numbers; an error names one that is missing, not finite or beyond all that is written.
    ///
    /// # Errors
    /// The name of the number.
    pub fn from_numbers(of_name: impl Fn(&str) -> Option<f64>) -> Result<Self, &'static str> {
        let number = |name: &'static str| of_name(name).filter(|value| value.abs() <= LARGEST).ok_or(name);
        let count = |name: &'static str| number(name).map(|value| value.max(0.0) as usize);
        Ok(Self {
            features: Features {
                control_points: count("points")?,
                eliminated: count("eliminated")?,
                log_sigma0: number("log_sigma0_of_points")?,
                log_configuration: number("log_configuration_of_points")?,
            },
            sigma0: number("sigma0")?,
            redundancy: count("redundancy")?,
            configuration: number("configuration")?,
            control_points: count("control_points")?,
            control_points_in_view: count("control_points_in_view")?,
            inlier_share: number("inlier_share")?,
            matched_share: number("matched_share")?,
            matched_share_in_view: number("matched_share_in_view")?,
            hull_share: number("hull_share")?,
            sigma_planimetric_m: number("sigma_planimetric_m")?,
            sigma_of_nine_m: number("sigma_of_nine_m")?,
            tolerance_m: number("tolerance_m")?,
            log_odds: number("log_odds")?,
            runner_up_log_odds: number("runner_up_log_odds")?,
            distance_from_approximation: number("distance_from_approximation")?,
            moved_by_lines_m: number("moved_by_lines_m")?,
            sensitivity: SensitivityEvidence {
                change_by_one_m: number("change_by_one_m")?,
                change_by_two_m: number("change_by_two_m")?,
                undetected_by_one_m: number("undetected_by_one_m")?,
                undetected_by_two_m: number("undetected_by_two_m")?,
                largest_test: number("largest_test")?,
                mean_test: number("mean_test")?,
                contradicting: count("contradicting")?,
            },
            risk: Risk {
                by_chance: number("risk_by_chance")?,
                with_displacement: number("risk_with_displacement")?,
                with_pair: number("risk_with_pair")?,
            },
        })
    }
}

/// One orientation with points that the search examined.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// What the paper's classifier sees of it.
    pub features: Features,
    /// Where the points of the trial place the camera. The paper labels a trial by what the adjustment with lines makes
    /// of it; that is done for the best hypotheses only, so that a trial is held against a reference as it is.
    pub orientation: ExteriorOrientation,
}

/// Trials that are kept of an image.
pub const MOST_TRIALS: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::thresholds::tests::sound;

    fn read(numbers: &[(&str, f64)]) -> Result<Evidence, &'static str> {
        Evidence::from_numbers(|name| numbers.iter().find(|(other, _)| *other == name).map(|(_, value)| *value))
    }

    #[test]
    fn numbers_make_the_same_evidence() {
        assert_eq!(read(&sound().numbers()), Ok(sound()));
        for missing in 0..30 {
            let mut numbers = sound().numbers().to_vec();
            let (name, _) = numbers.remove(missing);
            assert_eq!(read(&numbers), Err(name));
        }
    }

    #[test]
    fn numbers_are_finite_and_as_bad_as_can_be_where_there_is_none() {
        let nothing = Evidence { sigma0: f64::NAN, log_odds: f64::NAN, hull_share: f64::NEG_INFINITY, ..sound() };
        let of_name = |name: &str| nothing.numbers().into_iter().find(|(other, _)| *other == name).unwrap().1;
        assert_eq!((of_name("sigma0"), of_name("log_odds"), of_name("hull_share")), (LARGEST, -LARGEST, -LARGEST));
        assert!(nothing.numbers().iter().all(|(_, value)| value.is_finite()));
    }
}
