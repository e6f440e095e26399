//! Where a terrestrial camera stood and how it was turned: resection of its fish-eye picture from the targets of a
//! levelled template that lies in the scene (Berveglieri and Tommaselli, section 3).
//!
//! The frame is the template's own: metres, x along one arm, y along the other (90° counter-clockwise from x, as seen
//! from above), z up.

use nalgebra::{Complex, Matrix2, Matrix2x6, Matrix6, Vector2, Vector3};

use crate::estimation::{NormalEquations, largest_sigma};
use crate::geometry::{ExteriorOrientation, Fisheye, rotation};

/// A target of the template that was measured in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Its place in the template's frame.
    pub template_m: Vector3<f64>,
    /// Its pixel: x right, y down, from the corner of the top-left pixel.
    pub pixel: Vector2<f64>,
}

/// A camera that looked nearly straight down.
#[derive(Debug, Clone, PartialEq)]
pub struct NadirResection {
    /// The orientation in the template's frame.
    pub orientation: ExteriorOrientation,
    /// Covariance of its step `[dX0, theta]`: a priori, times the variance factor where that is above 1.
    pub covariance: Matrix6<f64>,
    /// Square root of the variance factor; 1 if nothing is redundant.
    pub sigma0: f64,
    /// Observations less parameters.
    pub redundancy: usize,
    /// Measured less computed pixels, target by target.
    pub residuals_px: Vec<Vector2<f64>>,
}

/// Why a camera cannot be oriented by its targets.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ResectError {
    /// Two coordinates a target, six parameters.
    #[error("{count} targets are too few: 3 are needed at least, and 4 to notice a blunder")]
    TooFew {
        /// How many there are.
        count: usize,
    },
    /// A coordinate is not a number.
    #[error("a coordinate of target {number} is not a finite number")]
    NotFinite {
        /// Which target, counted from 1.
        number: usize,
    },
    /// The targets lie on one line, about which the camera may turn freely.
    #[error("the targets lie on one line: at least one must lie on the other arm")]
    Collinear,
    /// A pixel where the lens images nothing.
    #[error(
        "target {number} was measured where this camera sees no ground: outside its image circle or above the horizon"
    )]
    Unseen {
        /// Which target, counted from 1.
        number: usize,
    },
    /// The picture's handedness is another one than the template's.
    #[error(
        "the picture shows the template mirrored: seen from above y must lie 90° counter-clockwise from x (are x and y \
         exchanged, or pixels counted from the bottom?)"
    )]
    Mirrored,
    /// No minimum of the squares was reached.
    #[error(
        "the targets do not determine the camera: measured pixels and coordinates contradict each other, or the \
         targets are too close together"
    )]
    Undetermined,
}

/// Smallest spread of the targets across their main direction, as a share of the spread along it.
const LEAST_BREADTH: f64 = 0.02;
const MOST_STEPS: usize = 50;
const MOST_HALVINGS: usize = 10;
/// Steps below this, in units of the parameters' standard deviations, change nothing.
const SMALL_STEP: f64 = 1e-5;

impl NadirResection {
    /// The angle between the camera's axis and the vertical.
    #[must_use]
    pub fn tilt_rad(&self) -> f64 {
        let up = self.orientation.camera_from_object * Vector3::z();
        up.xy().norm().atan2(up.z)
    }

    /// Standard deviation of the angle by which the picture may turn about the vertical against the template.
    #[must_use]
    pub fn sigma_azimuth_rad(&self) -> f64 {
        let vertical = self.orientation.camera_from_object * Vector3::z();
        let theta = self.covariance.fixed_view::<3, 3>(3, 3);
        vertical.dot(&(theta * vertical)).max(0.0).sqrt()
    }

    /// Standard deviation, in the direction in which it is largest, of the mean displacement that the orientation's
    /// errors give the rectified ground at some places of the template's frame; `None` for places that are not below
    /// the camera.
    #[must_use]
    pub fn sigma_ground_m(&self, places_m: &[Vector3<f64>]) -> Option<f64> {
        let mut by_step = Matrix2x6::zeros();
        for place_m in places_m {
            // the pixel stays: by X the ray's image changes as by -X0
            let (_, jacobian) = self.orientation.reduced_px_with_jacobian(1.0, *place_m)?;
            by_step += jacobian.fixed_columns::<2>(0).try_inverse()? * jacobian;
        }
        by_step /= places_m.len() as f64;
        Some(largest_sigma(&(by_step * self.covariance * by_step.transpose())))
    }

    /// Ground sample distance of the raw picture right below the camera, on the plane at a height in the template's
    /// frame.
    #[must_use]
    pub fn gsd_at_nadir_m(&self, camera: &Fisheye, plane_height_m: f64) -> f64 {
        (self.orientation.projection_centre_m.z - plane_height_m) / camera.principal_distance_px()
    }
}

/// The orientation by least squares (Gauss and Newton) from the targets' pixels, each coordinate of which is known
/// with `sigma_px`. The camera is taken to look down, within some tens of degrees; nothing else is to be known.
///
/// # Errors
/// [`ResectError`] if the targets are too few or in a bad place, or do not fit the picture.
pub fn resect(targets: &[Target], camera: &Fisheye, sigma_px: f64) -> Result<NadirResection, ResectError> {
    check(targets)?;
    let mut orientation = start(targets, camera)?;
    let mut equations = equations(targets, camera, &orientation, sigma_px).ok_or(ResectError::Undetermined)?;
    for _ in 0..MOST_STEPS {
        let step = equations.solve().ok_or(ResectError::Undetermined)?;
        if step.dot(&(equations.matrix * step)) < SMALL_STEP * SMALL_STEP {
            return finished(targets, camera, orientation, &equations).ok_or(ResectError::Undetermined);
        }
        // far from the minimum a whole step may lead behind the horizon
        let shorter = (0..MOST_HALVINGS).map(|k| orientation.moved(&(step * 0.5_f64.powi(k as i32))));
        let better = shorter.into_iter().find_map(|moved| {
            let there = self::equations(targets, camera, &moved, sigma_px)?;
            (there.squares <= equations.squares * (1.0 + 1e-9) + 1e-18).then_some((moved, there))
        });
        (orientation, equations) = better.ok_or(ResectError::Undetermined)?;
    }
    Err(ResectError::Undetermined)
}

fn check(targets: &[Target]) -> Result<(), ResectError> {
    let finite = |target: &Target| target.template_m.iter().chain(target.pixel.iter()).all(|v| v.is_finite());
    if let Some(index) = targets.iter().position(|target| !finite(target)) {
        return Err(ResectError::NotFinite { number: index + 1 });
    }
    if targets.len() < 3 {
        return Err(ResectError::TooFew { count: targets.len() });
    }
    let mean = targets.iter().map(|target| target.template_m.xy()).sum::<Vector2<f64>>() / targets.len() as f64;
    let spread: Matrix2<f64> = targets
        .iter()
        .map(|target| target.template_m.xy() - mean)
        .fold(Matrix2::zeros(), |sum, from_mean| sum + from_mean * from_mean.transpose());
    let [least, most]: [f64; 2] = spread.symmetric_eigenvalues().into();
    let (least, most) = (least.min(most).max(0.0).sqrt(), least.max(most).sqrt());
    if least > LEAST_BREADTH * most { Ok(()) } else { Err(ResectError::Collinear) }
}

/// As if the camera looked straight down: a similarity between the tangents of its rays and the template's plane gives
/// the height, the azimuth and the place.
fn start(targets: &[Target], camera: &Fisheye) -> Result<ExteriorOrientation, ResectError> {
    let mut rays = Vec::with_capacity(targets.len());
    for (target, number) in targets.iter().zip(1..) {
        let ray = camera.direction_from_pixel(target.pixel).filter(|ray| ray.z < -0.05);
        let ray = ray.ok_or(ResectError::Unseen { number })?;
        rays.push(Complex::new(ray.x, ray.y) / -ray.z);
    }
    let places: Vec<_> = targets.iter().map(|t| Complex::new(t.template_m.x, t.template_m.y)).collect();
    let mirrored: Vec<_> = rays.iter().map(Complex::conj).collect();
    let (factor, shift, squares) = similarity(&rays, &places);
    let (.., squares_mirrored) = similarity(&mirrored, &places);
    if squares_mirrored < 0.1 * squares {
        return Err(ResectError::Mirrored);
    }
    let mean_height_m = targets.iter().map(|target| target.template_m.z).sum::<f64>() / targets.len() as f64;
    Ok(ExteriorOrientation {
        projection_centre_m: Vector3::new(shift.re, shift.im, mean_height_m + factor.norm()),
        camera_from_object: rotation::camera_from_object(0.0, 0.0, factor.arg()),
    })
}

/// The factor and shift that lead from the first numbers to the second, and the squares that are left.
fn similarity(from: &[Complex<f64>], to: &[Complex<f64>]) -> (Complex<f64>, Complex<f64>, f64) {
    let count = from.len() as f64;
    let (mean_from, mean_to) = (from.iter().sum::<Complex<f64>>() / count, to.iter().sum::<Complex<f64>>() / count);
    let pairs = || from.iter().zip(to).map(|(a, b)| (a - mean_from, b - mean_to));
    let product: Complex<f64> = pairs().map(|(a, b)| a.conj() * b).sum();
    let factor = product / pairs().map(|(a, _)| a.norm_sqr()).sum::<f64>();
    let squares = pairs().map(|(a, b)| (b - factor * a).norm_sqr()).sum();
    (factor, mean_to - factor * mean_from, squares)
}

/// The pixel of a target and its derivatives by the step `[dX0, theta]`.
fn computed(target: &Target, camera: &Fisheye, at: &ExteriorOrientation) -> Option<(Vector2<f64>, Matrix2x6<f64>)> {
    let u = at.camera_coordinates(target.template_m);
    let (pixel, by_u) = camera.pixel_with_jacobian(u)?;
    // du/dX0 = -R, du/dtheta = [u]x
    let mut jacobian = Matrix2x6::zeros();
    jacobian.fixed_columns_mut::<3>(0).copy_from(&(-by_u * at.camera_from_object.matrix()));
    jacobian.fixed_columns_mut::<3>(3).copy_from(&(by_u * u.cross_matrix()));
    Some((pixel, jacobian))
}

fn equations(targets: &[Target], camera: &Fisheye, at: &ExteriorOrientation, sigma_px: f64) -> Option<NormalEquations> {
    let weight = Matrix2::identity() / sigma_px.powi(2);
    let mut equations = NormalEquations::new();
    for target in targets {
        let (pixel, jacobian) = computed(target, camera, at)?;
        equations.add(&jacobian, &(target.pixel - pixel), &weight);
    }
    Some(equations)
}

fn finished(
    targets: &[Target],
    camera: &Fisheye,
    orientation: ExteriorOrientation,
    equations: &NormalEquations,
) -> Option<NadirResection> {
    let residual = |target: &Target| Some(target.pixel - computed(target, camera, &orientation)?.0);
    let residuals_px = targets.iter().map(residual).collect::<Option<Vec<_>>>()?;
    let redundancy = 2 * targets.len() - 6;
    let sigma0 = if redundancy == 0 { 1.0 } else { (equations.squares / redundancy as f64).sqrt() };
    let covariance = equations.inverse()? * sigma0.max(1.0).powi(2);
    Some(NadirResection { orientation, covariance, sigma0, redundancy, residuals_px })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Brown, Projection};
    use approx::assert_relative_eq;
    use nalgebra::Vector6;

    fn camera(projection: Projection) -> Fisheye {
        let distortion = Brown { k1: -0.02, p1: 0.0004, ..Brown::default() };
        Fisheye::new([4256, 2848], projection, 1500.0, Vector2::new(2140.0, 1410.0), distortion).unwrap()
    }

    fn tilted(turn_rad: f64) -> ExteriorOrientation {
        ExteriorOrientation {
            projection_centre_m: Vector3::new(0.7, 0.4, 4.1),
            camera_from_object: rotation::camera_from_object(0.09, -0.06, turn_rad),
        }
    }

    fn targets(camera: &Fisheye, at: &ExteriorOrientation) -> Vec<Target> {
        let places = [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.5, 0.0], [0.0, 0.5], [0.0, 1.0], [0.0, 1.5]];
        let target = |[x, y]: [f64; 2]| {
            let template_m = Vector3::new(x, y, 0.0);
            Target { template_m, pixel: camera.pixel_from_direction(at.camera_coordinates(template_m)).unwrap() }
        };
        places.into_iter().map(target).collect()
    }

    #[test]
    fn without_noise_the_truth_comes_back_however_the_camera_is_turned() {
        for projection in [Projection::Equidistant, Projection::Equisolid, Projection::Perspective] {
            for turn in [0.0, 1.0, 2.5, -2.0, 3.1] {
                let (camera, truth) = (camera(projection), tilted(turn));
                let found = resect(&targets(&camera, &truth), &camera, 0.5).unwrap();
                assert_relative_eq!(found.orientation.step_to(&truth), Vector6::zeros(), epsilon = 1e-6);
                assert_eq!(found.redundancy, 8);
                assert!(found.sigma0 < 1e-6 && found.residuals_px.iter().all(|v| v.norm() < 1e-6));
                // cos(tilt) = cos(omega) cos(phi)
                assert_relative_eq!(found.tilt_rad().cos(), 0.09_f64.cos() * 0.06_f64.cos(), epsilon = 1e-9);
            }
        }
    }

    #[test]
    fn three_targets_are_enough_and_a_raised_one_is_used_as_such() {
        let (camera, truth) = (camera(Projection::Equidistant), tilted(0.4));
        let three: Vec<_> = targets(&camera, &truth).into_iter().step_by(3).take(3).collect();
        let found = resect(&three, &camera, 0.5).unwrap();
        assert_eq!((found.redundancy, found.sigma0), (0, 1.0));
        assert_relative_eq!(found.orientation.step_to(&truth), Vector6::zeros(), epsilon = 1e-4);
        let mut raised = targets(&camera, &truth);
        let template_m = Vector3::new(1.0, 1.0, 0.3);
        let pixel = camera.pixel_from_direction(truth.camera_coordinates(template_m)).unwrap();
        raised.push(Target { template_m, pixel });
        let found = resect(&raised, &camera, 0.5).unwrap();
        assert_relative_eq!(found.orientation.step_to(&truth), Vector6::zeros(), epsilon = 1e-6);
    }

    #[test]
    fn targets_of_no_use_are_refused_with_the_reason() {
        let (camera, truth) = (camera(Projection::Equidistant), tilted(0.4));
        let good = targets(&camera, &truth);
        let refused = |targets: &[Target]| resect(targets, &camera, 0.5).unwrap_err();
        assert_eq!(refused(&good[..2]), ResectError::TooFew { count: 2 });
        assert_eq!(refused(&good[..4]), ResectError::Collinear);
        assert_eq!(refused(&[good[0]; 5]), ResectError::Collinear);
        let mut odd = good.clone();
        odd[2].pixel.x = f64::NAN;
        assert_eq!(refused(&odd), ResectError::NotFinite { number: 3 });
        odd[2].pixel.x = 1e5;
        assert_eq!(refused(&odd), ResectError::Unseen { number: 3 });
        let exchanged: Vec<_> = good
            .iter()
            .map(|t| Target { template_m: Vector3::new(t.template_m.y, t.template_m.x, 0.0), ..*t })
            .collect();
        assert_eq!(refused(&exchanged), ResectError::Mirrored);
    }

    #[test]
    fn a_blunder_shows_in_the_residuals() {
        let (camera, truth) = (camera(Projection::Equidistant), tilted(0.4));
        let mut targets = targets(&camera, &truth);
        targets[4].pixel.x += 20.0;
        let found = resect(&targets, &camera, 0.5).unwrap();
        assert!(found.sigma0 > 10.0, "{}", found.sigma0);
        let worst = (0..7).max_by(|a, b| found.residuals_px[*a].norm().total_cmp(&found.residuals_px[*b].norm()));
        assert_eq!(worst, Some(4));
    }
}
