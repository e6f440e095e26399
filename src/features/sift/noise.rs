//! From the noise of the grey values to the covariance of a key point's position.
//!
//! A key point is where the gradient g of D, taken by central differences over column, row and level, vanishes; noise
//! that changes g by δ moves it by −H⁻¹ δ, with H the second derivatives. Hence Cov = H⁻¹ Cov(g) H⁻¹, of which the
//! part of column and row is given. Cov(g) follows from that of the blurred noise: noise of standard deviation σ in
//! each pixel, blurred by Gaussians of the variances v and w and looked at d cells apart, has the covariance
//! σ² a² N(d; v + w), where a² is the area of a pixel in cells and N the density of a Gaussian in the plane.

use nalgebra::{Matrix2, Matrix3, Vector3};

use super::scale_space::{SIGMA_OF_PICTURE, sigma_at};

/// Standard deviation of rounding to whole grey values: no picture is taken to be better.
const LEAST_NOISE: f64 = 0.288_675_134_594_812_9;
/// Values of which the median is taken, about.
const MOST_SAMPLES: usize = 1 << 16;

/// Standard deviation of the noise of the grey values: the median of |L|, where L is the difference of two Laplacians
/// (1 −2 1; −2 4 −2; 1 −2 1), which is blind to slopes and straight edges along rows and columns (Immerkær 1996).
/// Texture finer than two pixels counts as noise.
pub(super) fn noise(grey: &[f32], width: usize, height: usize) -> f64 {
    // of noise of one, L has the deviation 6, and the median of |N(0, 1)| is 0.6745
    const OF_ONE: f64 = 6.0 * 0.674_489_750_196_081_7;
    if width < 3 || height < 3 {
        return LEAST_NOISE;
    }
    let step = (width * height / MOST_SAMPLES).max(1);
    let mut sizes: Vec<f32> = (1..height - 1)
        .step_by(step)
        .flat_map(|y| {
            let row = |y: usize| grey[y * width..(y + 1) * width].windows(3);
            let second = |w: &[f32]| w[0] - 2.0 * w[1] + w[2];
            row(y - 1)
                .zip(row(y))
                .zip(row(y + 1))
                .map(move |((above, here), below)| (second(above) - 2.0 * second(here) + second(below)).abs())
        })
        .collect();
    let middle = sizes.len() / 2;
    let (_, median, _) = sizes.select_nth_unstable_by(middle, f32::total_cmp);
    (f64::from(*median) / OF_ONE).max(LEAST_NOISE)
}

/// Noise as the levels of an octave have it.
pub(super) struct Blurred {
    /// Variance of the grey values times the area of a pixel in cells.
    density: f64,
    /// Pixel's side in cells, squared, times what the picture itself and interpolation add to the blur.
    before: f64,
}

impl Blurred {
    /// `cell_px`: pixels along a side of a cell.
    pub(super) fn new(noise: f64, cell_px: f64, upsampled: bool) -> Self {
        let area = 1.0 / (cell_px * cell_px);
        // interpolating at half pixels blurs by an eighth of a square pixel; the picture's own blur does not act on
        // the noise
        let interpolation = if upsampled { 0.125 } else { 0.0 };
        Self { density: noise * noise * area, before: area * (interpolation - SIGMA_OF_PICTURE * SIGMA_OF_PICTURE) }
    }

    /// Covariance of two levels of Gaussians `distance` cells apart.
    fn of_levels(&self, a: usize, b: usize, distance: f64) -> f64 {
        let variance = |level: usize| sigma_at(level as f64).powi(2) + self.before;
        let sum = variance(a) + variance(b);
        self.density / (std::f64::consts::TAU * sum) * (-0.5 * distance * distance / sum).exp()
    }

    /// Covariance of two differences of Gaussians.
    fn of_differences(&self, a: usize, b: usize, distance: f64) -> f64 {
        self.of_levels(a + 1, b + 1, distance) + self.of_levels(a, b, distance)
            - self.of_levels(a + 1, b, distance)
            - self.of_levels(a, b + 1, distance)
    }

    /// Variances of the central differences by column, row and level; by symmetry they are not correlated.
    pub(super) fn of_gradient(&self, level: usize) -> Vector3<f64> {
        let along = 0.5 * (self.of_differences(level, level, 0.0) - self.of_differences(level, level, 2.0));
        let (above, below) = (level + 1, level - 1);
        let across = 0.25 * (self.of_differences(above, above, 0.0) + self.of_differences(below, below, 0.0))
            - 0.5 * self.of_differences(above, below, 0.0);
        Vector3::new(along, along, across)
    }
}

/// Covariance of column and row of an extremum, cells².
pub(super) fn covariance(hessian: &Matrix3<f64>, of_gradient: &Vector3<f64>) -> Option<Matrix2<f64>> {
    let inverse = hessian.try_inverse()?;
    let all = inverse * Matrix3::from_diagonal(of_gradient) * inverse;
    Some(all.fixed_view::<2, 2>(0, 0).into_owned())
}
