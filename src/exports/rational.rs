//! Rational polynomial coefficients (RPC00B) that stand for a photograph: image line and sample as ratios of cubic
//! polynomials of longitude, latitude and ellipsoidal height, for software that knows no cameras.

use nalgebra::{DMatrix, DVector, Vector2, Vector3};

use super::ExportError;
use super::photograph::{Photograph, Sight, unwrapped_deg};

const TERMS: usize = 20;
/// The denominators begin with 1.
const UNKNOWNS: usize = 2 * TERMS - 1;
/// Heights at which pixels are fitted; a cubic wants more than four.
const LEVELS: usize = 7;
/// Flatter ground is fitted as if it reached so far: levels that coincide would leave the share of the height to chance.
const LEAST_RELIEF_M: f64 = 5.0;
/// The columns are nearly dependent; their common part is held at zero with this share of the largest singular value.
const DAMPING: f64 = 1e-11;
const ITERATIONS: usize = 4;

/// The coefficients with their normalization.
#[derive(Debug, Clone, PartialEq)]
pub struct Rational {
    /// What is subtracted from line, sample, latitude, longitude (degrees) and height (metres).
    pub offset: [f64; 5],
    /// What they are divided by then.
    pub scale: [f64; 5],
    /// Numerator and denominator of the line.
    pub line: [[f64; TERMS]; 2],
    /// Numerator and denominator of the sample.
    pub sample: [[f64; TERMS]; 2],
    /// What remains at points between those fitted, root mean square over both coordinates.
    pub residual_rms_px: f64,
    /// What remains at the worst of them.
    pub residual_max_px: f64,
}

impl Rational {
    /// Fits the coefficients to the ground from its lowest to its highest, with a margin.
    ///
    /// # Errors
    /// [`ExportError`] where the ground is not in view.
    pub fn fitted(photograph: &Photograph) -> Result<Self, ExportError> {
        let relief_m = photograph.relief_m.max(LEAST_RELIEF_M);
        let level = |k: usize, of: usize| photograph.ground_height_m + relief_m * (2.0 * k as f64 / of as f64 - 1.0);
        let heights_m: Vec<f64> = (0..LEVELS).map(|k| level(k, LEVELS - 1)).collect();
        let about_deg = Photograph::geodetic(photograph.centre_geocentric_m)?[0];
        let places = places(&photograph.sights(&heights_m)?, about_deg)?;
        let mut rational = Self::normalizing(&places);
        let rows: Vec<[f64; TERMS]> = places.iter().map(|place| terms(rational.normalized(place))).collect();
        let column = |index: usize, of: fn(&Place) -> f64| -> Vec<f64> {
            places.iter().map(|place| (of(place) - rational.offset[index]) / rational.scale[index]).collect()
        };
        let line = ratio(&rows, &column(0, |place| place.line)).ok_or(ExportError::NoFit)?;
        let sample = ratio(&rows, &column(1, |place| place.sample)).ok_or(ExportError::NoFit)?;
        (rational.line, rational.sample) = (line, sample);
        // checked between the heights that were fitted
        let between: Vec<f64> = (0..LEVELS - 1).map(|k| level(2 * k + 1, 2 * (LEVELS - 1))).collect();
        let checks = self::places(&photograph.sights(&between)?, about_deg)?;
        let remaining: Vec<f64> = checks.iter().map(|place| rational.off(place)).collect();
        rational.residual_max_px = remaining.iter().copied().fold(0.0, f64::max);
        let squares: f64 = remaining.iter().map(|px| px * px).sum();
        rational.residual_rms_px = (squares / (2.0 * remaining.len() as f64)).sqrt();
        Ok(rational)
    }

    /// The pixel, from the corner of the top-left one, of a longitude and latitude (degrees) and a height (metres).
    #[must_use]
    pub fn pixel(&self, [longitude_deg, latitude_deg, height_m]: [f64; 3]) -> Vector2<f64> {
        let longitude_deg = unwrapped_deg(longitude_deg, self.offset[3]);
        let place = Place { line: 0.0, sample: 0.0, latitude_deg, longitude_deg, height_m };
        let terms = terms(self.normalized(&place));
        let value = |[numerator, denominator]: &[[f64; TERMS]; 2]| dot(numerator, &terms) / dot(denominator, &terms);
        let (line, sample) = (value(&self.line), value(&self.sample));
        // lines and samples count from the centre of the first pixel
        Vector2::new(sample * self.scale[1] + self.offset[1] + 0.5, line * self.scale[0] + self.offset[0] + 0.5)
    }

    fn off(&self, place: &Place) -> f64 {
        let pixel = self.pixel([place.longitude_deg, place.latitude_deg, place.height_m]);
        (pixel - Vector2::new(place.sample + 0.5, place.line + 0.5)).norm()
    }

    fn normalized(&self, place: &Place) -> Vector3<f64> {
        let normal = |index: usize, value: f64| (value - self.offset[index]) / self.scale[index];
        Vector3::new(normal(3, place.longitude_deg), normal(2, place.latitude_deg), normal(4, place.height_m))
    }

    /// Offsets and scales that bring everything between -1 and 1.
    fn normalizing(places: &[Place]) -> Self {
        let of: [fn(&Place) -> f64; 5] =
            [|p| p.line, |p| p.sample, |p| p.latitude_deg, |p| p.longitude_deg, |p| p.height_m];
        let range = of.map(|of| {
            let values = places.iter().map(of);
            (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
        });
        Self {
            offset: range.map(|(least, most)| (least + most) / 2.0),
            scale: range.map(|(least, most)| ((most - least) / 2.0).max(1e-9)),
            line: [[0.0; TERMS]; 2],
            sample: [[0.0; TERMS]; 2],
            residual_rms_px: 0.0,
            residual_max_px: 0.0,
        }
    }
}

/// A pixel, as RPC counts them, with what it shows.
#[derive(Debug, Clone, Copy)]
struct Place {
    line: f64,
    sample: f64,
    latitude_deg: f64,
    longitude_deg: f64,
    height_m: f64,
}

fn places(sights: &[Sight], about_deg: f64) -> Result<Vec<Place>, ExportError> {
    let place = |Sight { pixel, ground_geocentric_m }: &Sight| {
        let [longitude_deg, latitude_deg, height_m] = Photograph::geodetic(*ground_geocentric_m)?;
        let longitude_deg = unwrapped_deg(longitude_deg, about_deg);
        Ok(Place { line: pixel.y - 0.5, sample: pixel.x - 0.5, latitude_deg, longitude_deg, height_m })
    };
    sights.iter().map(place).collect()
}

/// The cubic terms in the order of RPC00B: L is the longitude, P the latitude, H the height, all normalized.
fn terms(at: Vector3<f64>) -> [f64; TERMS] {
    let (l, p, h) = (at.x, at.y, at.z);
    [
        1.0,
        l,
        p,
        h,
        l * p,
        l * h,
        p * h,
        l * l,
        p * p,
        h * h,
        p * l * h,
        l * l * l,
        l * p * p,
        l * h * h,
        l * l * p,
        p * p * p,
        p * h * h,
        l * l * h,
        p * p * h,
        h * h * h,
    ]
}

fn dot(a: &[f64; TERMS], b: &[f64; TERMS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Numerator and denominator of which the ratio is `values`: N(x) - value D(x) = 0, weighted anew by the denominator so
/// that the error of the ratio counts.
fn ratio(rows: &[[f64; TERMS]], values: &[f64]) -> Option<[[f64; TERMS]; 2]> {
    let (mut numerator, mut denominator) = ([0.0; TERMS], [0.0; TERMS]);
    denominator[0] = 1.0;
    for _ in 0..ITERATIONS {
        let weights: Vec<f64> = rows.iter().map(|row| 1.0 / dot(&denominator, row)).collect();
        let entry =
            |i: usize, j: usize| weights[i] * if j < TERMS { rows[i][j] } else { -values[i] * rows[i][j - TERMS + 1] };
        let matrix = DMatrix::from_fn(rows.len(), UNKNOWNS, entry);
        let right = DVector::from_fn(rows.len(), |i, _| weights[i] * values[i]);
        let solution = damped(matrix, &right)?;
        numerator.copy_from_slice(&solution.as_slice()[..TERMS]);
        denominator[1..].copy_from_slice(&solution.as_slice()[TERMS..]);
    }
    Some([numerator, denominator])
}

/// Least squares with small singular values damped (Tikhonov).
fn damped(matrix: DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let svd = matrix.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let largest = svd.singular_values.max();
    let damping = (DAMPING * largest).powi(2);
    let mut projected = u.transpose() * right;
    for (value, singular) in projected.iter_mut().zip(svd.singular_values.iter()) {
        *value *= singular / (singular * singular + damping);
    }
    Some(v_t.transpose() * projected)
}
