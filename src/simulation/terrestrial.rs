//! Terrestrial pictures with known truth: the ground as a fish-eye camera on a pole of some metres sees it straight
//! from above, with the pixels of the targets of a levelled template (Berveglieri and Tommaselli, section 3).
//!
//! The picture is the second one, from which the template has been taken away. The ground is a plane; the pole, the
//! tripod and the people are not in the picture, and the lens is equally sharp all over.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::draws::{Draws, Purpose, pixel_deviate};
use crate::geometry::{Brown, CameraError, ExteriorOrientation, Fisheye, Projection, rotation};
use crate::scenes::resect::Target;

/// Targets on a right-angle template with arms of 1.6 m: metres in its frame.
pub const TEMPLATE_M: [[f64; 2]; 9] =
    [[0.0, 0.0], [0.4, 0.0], [0.8, 0.0], [1.2, 0.0], [1.6, 0.0], [0.0, 0.4], [0.0, 0.8], [0.0, 1.2], [0.0, 1.6]];

/// A fish-eye camera above the ground, and a template below it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TerrestrialView {
    /// The camera.
    pub camera: Fisheye,
    /// Height of the projection centre above the ground.
    pub height_m: f64,
    /// Where the point below the camera lies in the template's frame.
    pub below_m: Vector2<f64>,
    /// Rotations about the template's x and y axis that tilt the camera.
    pub omega_phi_rad: [f64; 2],
    /// Rotation of the camera about the vertical against the template, counter-clockwise.
    pub kappa_rad: f64,
    /// Where the template's y arm points to, clockwise from true north.
    pub azimuth_of_y_rad: f64,
    /// Where the template's corner lies on the ground: east and north.
    pub corner_m: Vector2<f64>,
    /// How high the targets are above the ground.
    pub plate_height_m: f64,
    /// Standard deviation of the noise of each pixel, in grey values.
    pub sigma_grey: f64,
}

/// Rays through each pixel, a side.
const RAYS: u32 = 2;
/// What is seen above the horizon.
const SKY_GREY: f64 = 215.0;

impl TerrestrialView {
    /// A camera that sees about 165° in width, at 4 m, tilted by a few degrees. With a `width_px` of 4256 it has 12
    /// megapixels, which are 2.7 mm right below.
    ///
    /// # Errors
    /// [`CameraError`] if there are no pixels.
    pub fn from_a_pole(width_px: u32) -> Result<Self, CameraError> {
        let distortion = Brown { k1: -0.024, k2: 0.0018, p1: 0.0003, p2: -0.0002, ..Brown::default() };
        let scale = f64::from(width_px) / 4256.0;
        let size_px = [width_px, (2848.0 * scale).round() as u32];
        let centre_px = Vector2::new(2117.0, 1431.0) * scale;
        Ok(Self {
            camera: Fisheye::new(size_px, Projection::Equidistant, 1480.0 * scale, centre_px, distortion)?,
            height_m: 4.0,
            below_m: Vector2::new(0.55, 0.4),
            omega_phi_rad: [0.05, -0.035],
            kappa_rad: 0.6,
            azimuth_of_y_rad: 0.04,
            corner_m: Vector2::zeros(),
            plate_height_m: 0.0,
            sigma_grey: 2.0,
        })
    }

    /// The true orientation in the template's frame.
    #[must_use]
    pub fn orientation(&self) -> ExteriorOrientation {
        let [omega_rad, phi_rad] = self.omega_phi_rad;
        ExteriorOrientation {
            projection_centre_m: self.below_m.push(self.height_m - self.plate_height_m),
            camera_from_object: rotation::camera_from_object(omega_rad, phi_rad, self.kappa_rad),
        }
    }

    /// East and north on the ground of a place of the template's frame.
    #[must_use]
    pub fn ground_m(&self, template_m: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.azimuth_of_y_rad.sin_cos();
        self.corner_m + Vector2::new(template_m.x * cos + template_m.y * sin, template_m.y * cos - template_m.x * sin)
    }

    /// The picture of a ground whose grey (0 to 255) is known at each east and north, row by row. Each pixel is the
    /// mean over a few rays.
    #[must_use]
    pub fn photograph(&self, ground: &(dyn Fn(Vector2<f64>) -> f64 + Sync), seed: u64) -> Vec<u8> {
        let [width, height] = self.camera.size_px();
        let orientation = self.orientation();
        let to_template = orientation.camera_from_object.inverse();
        let grey_along = |pixel: Vector2<f64>| -> f64 {
            let Some(ray) = self.camera.direction_from_pixel(pixel) else { return 0.0 };
            let ray = to_template * ray;
            if ray.z > -0.02 {
                return SKY_GREY;
            }
            let reach = self.height_m / -ray.z;
            ground(self.ground_m(self.below_m + reach * ray.xy()))
        };
        let row = |y: u32| {
            (0..width).map(move |x| {
                let offset = |k: u32| (f64::from(k) + 0.5) / f64::from(RAYS);
                let rays = (0..RAYS * RAYS)
                    .map(|k| Vector2::new(f64::from(x) + offset(k % RAYS), f64::from(y) + offset(k / RAYS)));
                let mean = rays.map(grey_along).sum::<f64>() / f64::from(RAYS * RAYS);
                let noise = self.sigma_grey * f64::from(pixel_deviate(x as i32, y as i32, seed as u32));
                (mean + noise).round().clamp(0.0, 255.0) as u8
            })
        };
        (0..height).into_par_iter().flat_map_iter(row).collect()
    }

    /// The template's targets as measured in the picture, each coordinate with a normal error of `sigma_px`. Targets
    /// that are not in the picture are left out.
    #[must_use]
    pub fn targets(&self, places_m: &[[f64; 2]], sigma_px: f64, seed: u64) -> Vec<Target> {
        let mut draws = Draws::new(seed, Purpose::Terrestrial);
        let orientation = self.orientation();
        let measured = |&[x, y]: &[f64; 2]| {
            let template_m = Vector3::new(x, y, 0.0);
            let exact = self.camera.pixel_from_direction(orientation.camera_coordinates(template_m))?;
            let pixel = exact + sigma_px * Vector2::new(draws.normal(), draws.normal());
            self.camera.contains(pixel).then_some(Target { template_m, pixel })
        };
        places_m.iter().filter_map(measured).collect()
    }

    /// The camera as `gable scene rectify` reads it.
    #[must_use]
    pub fn camera_body(&self) -> Value {
        let (centre, Brown { k1, k2, k3, p1, p2, b1_px, b2_px }) =
            (self.camera.principal_point_px(), *self.camera.distortion());
        let projection = match self.camera.projection() {
            Projection::Equidistant => "equidistant",
            Projection::Equisolid => "equisolid",
            Projection::Perspective => "brown",
        };
        json!({
            "name": "pole",
            "image_size_px": self.camera.size_px(),
            "projection": projection,
            "principal_distance_px": self.camera.principal_distance_px(),
            "principal_point_px": [centre.x, centre.y],
            "distortion": {"model": "brown", "k1": k1, "k2": k2, "k3": k3, "p1": p1, "p2": p2, "b1_px": b1_px, "b2_px": b2_px},
        })
    }

    /// Measured targets as `gable scene rectify` reads them.
    #[must_use]
    pub fn targets_body(targets: &[Target]) -> Value {
        let point = |target: &Target| json!({"xy_m": [target.template_m.x, target.template_m.y], "px": [target.pixel.x, target.pixel.y]});
        json!({"points": targets.iter().map(point).collect::<Vec<_>>()})
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::GreyWindow;
    use crate::scenes::Scene;
    use crate::scenes::rectify::{Layout, rectify};
    use crate::scenes::resect::resect;
    use crate::simulation::draws::value_noise;
    use nalgebra::Matrix2;

    /// A paving of slabs of 0.4 m of different grey with joints, and grass beside it.
    fn paving(ground_m: Vector2<f64>) -> f64 {
        let at = |scale: f64, seed| f64::from(value_noise(ground_m.x / scale, ground_m.y / scale, seed));
        let slab = 120.0 + 30.0 * at(0.7, 3) + 35.0 * at(0.25, 4) + 20.0 * at(0.08, 5);
        // no sharp edges: the few samples to a pixel that the truth is taken from would displace them
        let joint = |v: f64| 1.0 - ((v + 0.2).rem_euclid(0.4) - 0.2).abs() / 0.03;
        slab - 60.0 * joint(ground_m.x).max(joint(ground_m.y)).max(0.0)
    }

    fn layout(view: &TerrestrialView) -> Layout {
        Layout {
            gsd_m: 0.02,
            plane_height_m: -view.plate_height_m,
            largest_incidence_rad: 60.0_f64.to_radians(),
            largest_side_m: f64::INFINITY,
            azimuth_of_y_rad: view.azimuth_of_y_rad,
            sigma_bearing_rad: 0.02,
            reference_m: Vector2::new(0.0, 0.0),
        }
    }

    /// The mean of the ground over each pixel of a scene moved by some pixels.
    fn truth(scene: &Scene, corner_m: Vector2<f64>, shift_px: Vector2<f64>) -> Vec<f64> {
        let pixels = (0..scene.height).flat_map(|y| (0..scene.width).map(move |x| (x, y)));
        let mean = |(x, y): (usize, usize)| {
            let samples = (0..9).map(|k| {
                let inside = Vector2::new((k % 3) as f64 + 0.5, (k / 3) as f64 + 0.5) / 3.0;
                let pixel = Vector2::new(x as f64, y as f64) + inside + shift_px;
                paving(corner_m + scene.ground_from_pixel_m(pixel))
            });
            samples.sum::<f64>() / 9.0
        };
        pixels.map(mean).collect()
    }

    fn correlation(a: &[f32], b: &[f64]) -> f64 {
        let n = a.len() as f64;
        let (mean_a, mean_b) = (a.iter().map(|v| f64::from(*v)).sum::<f64>() / n, b.iter().sum::<f64>() / n);
        let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
        for (a, b) in a.iter().zip(b) {
            let (a, b) = (f64::from(*a) - mean_a, b - mean_b);
            (ab, aa, bb) = (ab + a * b, aa + a * a, bb + b * b);
        }
        ab / (aa * bb).sqrt()
    }

    /// By how much a scene is shifted against what it should be, in pixels, by least squares.
    fn shift_px(scene: &Scene, corner_m: Vector2<f64>) -> Vector2<f64> {
        let at = |x: f64, y: f64| truth(scene, corner_m, Vector2::new(x, y));
        let (here, right, left, below, above) =
            (at(0.0, 0.0), at(0.25, 0.0), at(-0.25, 0.0), at(0.0, 0.25), at(0.0, -0.25));
        let (mut normal, mut side) = (Matrix2::zeros(), Vector2::zeros());
        for k in 0..here.len() {
            let gradient = Vector2::new(right[k] - left[k], below[k] - above[k]) / 0.5;
            normal += gradient * gradient.transpose();
            side += gradient * (f64::from(scene.grey[k]) - here[k]);
        }
        normal.try_inverse().unwrap() * side
    }

    #[test]
    fn the_rectified_picture_is_the_ground() {
        for (plate_height_m, sigma_px) in [(0.0, 0.0), (0.15, 0.05)] {
            let corner_m = Vector2::new(12.3, -7.7);
            let view = TerrestrialView { corner_m, plate_height_m, ..TerrestrialView::from_a_pole(2128).unwrap() };
            let grey = view.photograph(&paving, 5).into_iter().map(f32::from).collect();
            let picture = GreyWindow { origin_px: [0, 0], reduction: 1, width: 2128, height: 1424, grey };
            let resection = resect(&view.targets(&TEMPLATE_M, sigma_px, 8), &view.camera, 0.05).unwrap();
            let rectified = rectify(&picture, &view.camera, &resection, &layout(&view)).unwrap();
            let scene = &rectified.scene;
            let area_m2 = (scene.width * scene.height) as f64 * scene.gsd_m.powi(2);
            assert!(area_m2 > 60.0, "{} x {} px", scene.width, scene.height);
            let best = correlation(&scene.grey, &truth(scene, corner_m, Vector2::zeros()));
            let shift_px = shift_px(scene, corner_m);
            assert!(best > 0.98, "correlation {best}");
            assert!(shift_px.norm() < 0.2, "shift {shift_px}");
            // what the resection's errors may do; of exact targets only the resampling's own error is left
            let sigmas = shift_px.norm() * scene.gsd_m / rectified.sigma_shift_m;
            assert!(sigmas < if sigma_px > 0.0 { 3.0 } else { 0.25 }, "{sigmas} sigmas");
        }
    }

    #[test]
    fn the_orientation_comes_back_within_its_covariance() {
        let view = TerrestrialView::from_a_pole(2128).unwrap();
        let truth = view.orientation();
        let runs = 1000;
        let (mut distance, mut factor, mut azimuth) = (0.0, 0.0, 0.0);
        for seed in 0..runs {
            let found = resect(&view.targets(&TEMPLATE_M, 0.4, seed), &view.camera, 0.4).unwrap();
            let step = found.orientation.step_to(&truth);
            // the covariance is already enlarged where sigma0 is above 1
            let covariance = found.covariance / found.sigma0.max(1.0).powi(2);
            distance += step.dot(&(covariance.try_inverse().unwrap() * step));
            factor += found.sigma0.powi(2);
            let theta = truth.camera_from_object.inverse() * step.fixed_rows::<3>(3).into_owned();
            azimuth += (theta.z / found.sigma_azimuth_rad() * found.sigma0.max(1.0)).powi(2);
        }
        let mean = |sum: f64| sum / runs as f64;
        assert!((mean(distance) - 6.0).abs() < 0.4, "squared distance {}", mean(distance));
        assert!((mean(factor) - 1.0).abs() < 0.06, "variance factor {}", mean(factor));
        assert!((mean(azimuth) - 1.0).abs() < 0.12, "azimuth {}", mean(azimuth));
    }
}
