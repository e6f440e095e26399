//! The flight: where the camera truly was, and what was known of it beforehand.

use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::draws::{Draws, Purpose};
use super::town::Town;
use crate::geometry::{Camera, ExteriorOrientation};
use crate::pipeline::Approximation;

/// How the town is flown over, and how well the navigation knows it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FlightSettings {
    /// Height of the camera above the ground in the middle of the image. 220 m: a ground sample distance of 8 cm with
    /// the default camera, in which a house is about a hundred pixels long, as in the benchmark.
    pub height_m: f64,
    /// The largest tilt; drawn evenly from 0 in any direction. 6 degrees: a stabilised mount or a calm drone.
    pub greatest_tilt_deg: f64,
    /// How far from the town's middle the image may look, east and north. 30 m: the town fills most images.
    pub aim_spread_m: f64,
    /// Standard deviations of the approximate position, east, north, up. Like the benchmark's `attitude`.
    pub sigma_position_m: [f64; 3],
    /// Standard deviation of the approximate omega and phi. Like the benchmark's `attitude`.
    pub sigma_tilt_deg: f64,
    /// Standard deviation of the approximate kappa. Like the benchmark's `attitude`.
    pub sigma_kappa_deg: f64,
    /// The share of the flights whose navigation errs [`WILD`] times as much as it states. None.
    pub share_wild: f64,
}

/// By so much more the navigation errs where it errs wildly.
pub const WILD: f64 = 3.0;

impl Default for FlightSettings {
    fn default() -> Self {
        Self {
            height_m: 220.0,
            greatest_tilt_deg: 6.0,
            aim_spread_m: 30.0,
            sigma_position_m: [2.0, 2.0, 3.0],
            sigma_tilt_deg: 2.0,
            sigma_kappa_deg: 3.0,
            share_wild: 0.0,
        }
    }
}

/// Omega, phi and kappa: in radians.
type Angles = [f64; 3];

/// The true orientation of a photograph of the town, and an approximation whose errors are normal deviates of the
/// standard deviations that it states.
#[must_use]
pub fn fly(town: &Town, camera: &Camera, seed: u64, settings: &FlightSettings) -> (ExteriorOrientation, Approximation) {
    let draws = &mut Draws::new(seed, Purpose::Flight);
    let tilt_rad = draws.between(0.0, settings.greatest_tilt_deg).to_radians();
    let towards = super::draws::direction(draws.between(0.0, std::f64::consts::TAU));
    let angles = [tilt_rad * towards.x, tilt_rad * towards.y, draws.within(std::f64::consts::PI)];
    let aim = town.centre_m + Vector2::new(draws.within(settings.aim_spread_m), draws.within(settings.aim_spread_m));
    let truth = looking_at(town.terrain.point_m(aim), settings.height_m, angles, camera);
    let approximation = perturbed(truth.projection_centre_m, angles, seed, settings);
    (truth, approximation)
}

/// The orientation with given angles whose middle of the image shows a point from a height above it.
fn looking_at(point_m: Vector3<f64>, height_m: f64, angles: Angles, camera: &Camera) -> ExteriorOrientation {
    let reduced = camera.reduced_from_pixel(camera.frame_px(0.5, 0.5)).unwrap_or_else(Vector2::zeros);
    let here = ExteriorOrientation { projection_centre_m: point_m, camera_from_object: camera_from_object(angles) };
    let ray = here.ray(camera.principal_distance_px, reduced);
    ExteriorOrientation { projection_centre_m: point_m + ray * (height_m / ray.z), ..here }
}

fn perturbed(centre_m: Vector3<f64>, angles: Angles, seed: u64, settings: &FlightSettings) -> Approximation {
    let draws = &mut Draws::new(seed, Purpose::Approximation);
    let sigma_tilt_rad = settings.sigma_tilt_deg.to_radians();
    let sigma_kappa_rad = settings.sigma_kappa_deg.to_radians();
    let wild = Draws::new(seed, Purpose::WildNavigation).chance(settings.share_wild);
    let scale = if wild { WILD } else { 1.0 };
    let error_m = Vector3::from(settings.sigma_position_m).map(|sigma_m| scale * sigma_m * draws.normal());
    let sigmas_rad = [sigma_tilt_rad, sigma_tilt_rad, sigma_kappa_rad];
    let mut approximate = angles;
    for (angle, sigma_rad) in approximate.iter_mut().zip(sigmas_rad) {
        *angle += scale * sigma_rad * draws.normal();
    }
    Approximation {
        orientation: ExteriorOrientation {
            projection_centre_m: centre_m + error_m,
            camera_from_object: camera_from_object(approximate),
        },
        sigma_position_m: settings.sigma_position_m,
        sigma_tilt_rad,
        sigma_kappa_rad: Some(sigma_kappa_rad),
    }
}

/// The same as [`crate::geometry::rotation::camera_from_object`], by the mathematics that is alike on all machines.
fn camera_from_object([omega, phi, kappa]: Angles) -> Rotation3<f64> {
    let [(so, co), (sp, cp), (sk, ck)] = [omega, phi, kappa].map(|angle| (libm::sin(angle), libm::cos(angle)));
    let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, co, -so, 0.0, so, co);
    let about_y = Matrix3::new(cp, 0.0, sp, 0.0, 1.0, 0.0, -sp, 0.0, cp);
    let about_z = Matrix3::new(ck, -sk, 0.0, sk, ck, 0.0, 0.0, 0.0, 1.0);
    Rotation3::from_matrix_unchecked((about_x * about_y * about_z).transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Brown, rotation};
    use crate::simulation::TownSettings;
    use approx::assert_relative_eq;

    fn camera() -> Camera {
        Camera::new([3000, 2250], 2600.0, Vector2::new(1506.0, 1119.0), Brown::default()).unwrap()
    }

    #[test]
    fn rotation_is_the_one_of_geometry() {
        for angles in [[0.1, -0.05, 2.9], [-0.3, 0.2, -1.0]] {
            let [omega, phi, kappa] = angles;
            let expected = rotation::camera_from_object(omega, phi, kappa);
            assert_relative_eq!(camera_from_object(angles), expected, epsilon = 1e-14);
        }
    }

    #[test]
    fn images_look_at_the_town_from_the_height_and_tilt_that_were_asked() {
        let (town, camera) = (Town::build(1, &TownSettings::default()), camera());
        let settings = FlightSettings::default();
        for seed in 0..200 {
            let (truth, _) = fly(&town, &camera, seed, &settings);
            let middle = camera.reduced_from_pixel(Vector2::new(1500.0, 1125.0)).unwrap();
            let seen = town.terrain.meets(truth.projection_centre_m, truth.ray(2600.0, middle)).unwrap();
            let aside = seen.xy() - town.centre_m;
            assert!(aside.amax() <= 30.0 + 1e-6);
            assert_relative_eq!(truth.projection_centre_m.z - seen.z, 220.0, epsilon = 1e-6);
            let [omega, phi, _] = rotation::angles(&truth.camera_from_object);
            assert!(omega.hypot(phi).to_degrees() <= 6.0 + 1e-9);
        }
    }

    #[test]
    fn errors_of_the_approximation_have_the_sigmas_that_it_states() {
        let (town, camera) = (Town::build(1, &TownSettings::default()), camera());
        const RUNS: u32 = 1000;
        let mut sums = [[0.0; 2]; 6];
        for seed in 0..u64::from(RUNS) {
            let (truth, approximation) = fly(&town, &camera, seed, &FlightSettings::default());
            let position = approximation.orientation.projection_centre_m - truth.projection_centre_m;
            let before = rotation::angles(&truth.camera_from_object);
            let after = rotation::angles(&approximation.orientation.camera_from_object);
            let tau = std::f64::consts::TAU;
            let turned = |i: usize| (after[i] - before[i] + tau / 2.0).rem_euclid(tau) - tau / 2.0;
            let [east, north, up] = approximation.sigma_position_m;
            let tilt = approximation.sigma_tilt_rad;
            let normalised = [
                position.x / east,
                position.y / north,
                position.z / up,
                turned(0) / tilt,
                turned(1) / tilt,
                turned(2) / approximation.sigma_kappa_rad.unwrap(),
            ];
            for (sum, value) in sums.iter_mut().zip(normalised) {
                *sum = [sum[0] + value, sum[1] + value * value];
            }
        }
        for [sum, squares] in sums {
            let n = f64::from(RUNS);
            // a mean within 4 and a variance within 4 of their own standard deviations
            assert!((sum / n).abs() < 4.0 / n.sqrt(), "mean {}", sum / n);
            assert!((squares / n - 1.0).abs() < 4.0 * (2.0 / n).sqrt(), "variance {}", squares / n);
        }
    }
}
