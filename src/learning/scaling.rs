//! Brings features to comparable ranges, in the format of LIBSVM's `svm-scale`.

use std::fmt::Write as _;

/// For each feature the values that become -1 and 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Scaling {
    ranges: Vec<[f64; 2]>,
}

/// The values that become -1 and 1 are quantiles, so that one image beyond all others does not press these together.
const TAIL: f64 = 0.01;

/// A text that is no scaling.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("this is not a scaling from -1 to 1 in the format of svm-scale: {detail}")]
pub struct ScalingError {
    detail: String,
}

impl Scaling {
    /// Of samples with as many features each; `None` of no sample.
    #[must_use]
    pub fn of(samples: &[&[f64]]) -> Option<Self> {
        let features = samples.first()?.len();
        let range = |feature: usize| {
            let mut values: Vec<f64> = samples.iter().map(|sample| sample[feature]).collect();
            values.sort_by(f64::total_cmp);
            let at = |share: f64| values[(share * (values.len() - 1) as f64).round() as usize];
            let [low, high] = [at(TAIL), at(1.0 - TAIL)];
            // a feature that is always the same says nothing, and must not divide by nothing
            if high > low { [low, high] } else { [low - 1.0, low + 1.0] }
        };
        Some(Self { ranges: (0..features).map(range).collect() })
    }

    /// The scaled features.
    #[must_use]
    pub fn scaled(&self, features: &[f64]) -> Vec<f64> {
        let of_one = |(value, [low, high]): (&f64, &[f64; 2])| 2.0 * (value - low) / (high - low) - 1.0;
        features.iter().zip(&self.ranges).map(of_one).collect()
    }

    /// The number of features.
    #[must_use]
    pub fn features(&self) -> usize {
        self.ranges.len()
    }

    /// As `svm-scale -s` writes it.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = "x\n-1 1\n".to_owned();
        for (index, [low, high]) in self.ranges.iter().enumerate() {
            let _ = writeln!(text, "{} {low:e} {high:e}", index + 1);
        }
        text
    }

    /// Reads what `svm-scale -s` writes.
    ///
    /// # Errors
    /// [`ScalingError`].
    pub fn from_text(text: &str) -> Result<Self, ScalingError> {
        let fault = |detail: String| ScalingError { detail };
        let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
        if lines.next() != Some("x") || lines.next().map(numbers) != Some(Some(vec![-1.0, 1.0])) {
            return Err(fault("it must begin with the lines x and -1 1".to_owned()));
        }
        let mut ranges = Vec::new();
        for line in lines {
            let range = match numbers(line).as_deref() {
                Some([index, low, high]) if *index == (ranges.len() + 1) as f64 && low < high => [*low, *high],
                _ => return Err(fault(format!("{line:?} is not the next feature with its minimum and maximum"))),
            };
            ranges.push(range);
        }
        if ranges.is_empty() { Err(fault("it has no feature".to_owned())) } else { Ok(Self { ranges }) }
    }
}

/// The finite numbers of a line.
fn numbers(line: &str) -> Option<Vec<f64>> {
    let number = |word: &str| word.parse::<f64>().ok().filter(|number| number.is_finite());
    line.split_whitespace().map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearly_all_values_lie_from_minus_one_to_one() {
        let samples: Vec<Vec<f64>> = (0..=200).map(|k| vec![f64::from(k), 7.0]).collect();
        let scaling = Scaling::of(&samples.iter().map(Vec::as_slice).collect::<Vec<_>>()).unwrap();
        assert_eq!(scaling.scaled(&[2.0, 7.0]), [-1.0, 0.0]);
        assert_eq!(scaling.scaled(&[198.0, 8.0]), [1.0, 1.0]);
        assert!(scaling.scaled(&[200.0, 7.0])[0] > 1.0);
        assert_eq!(Scaling::of(&[]), None);
    }

    #[test]
    fn the_text_is_read_back_and_damage_is_told() {
        let scaling = Scaling { ranges: vec![[-0.1, 1.0 / 3.0], [1e-9, 5e20]] };
        assert_eq!(Scaling::from_text(&scaling.to_text()), Ok(scaling));
        // as svm-scale writes it
        let written = "x\n-1.000000000000000 1.000000000000000\n1 0.000000000000000 2.5\n2 -3 4\n";
        assert_eq!(Scaling::from_text(written), Ok(Scaling { ranges: vec![[0.0, 2.5], [-3.0, 4.0]] }));
        for damaged in [
            "",
            "x\n-1 1\n",
            "x\n0 1\n1 0 1\n",
            "x\n-1 1\n2 0 1\n",
            "x\n-1 1\n1 1 0\n",
            "x\n-1 1\n1 nan 1\n",
            "y\n-1 1\n",
        ] {
            assert!(Scaling::from_text(damaged).is_err(), "{damaged:?}");
        }
    }
}
