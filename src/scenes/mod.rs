//! Control scenes: small georeferenced pictures of the ground, found in the aerial image (Berveglieri and Tommaselli).
//! They are made from terrestrial pictures ([`resect`](mod@resect), [`rectify`](mod@rectify)) or cut out of
//! ortho-photos ([`cut`](mod@cut)).

pub mod cut;
pub mod declination;
pub mod rectify;
mod resample;
pub mod resect;

pub mod consistency;
pub mod keys;
pub mod matching;
pub mod measure;
mod rendering;
pub mod view;

use nalgebra::{Matrix2, Vector2};

pub use consistency::{Sighting, sightings};
pub use keys::{ImageKeys, SceneKey, scene_keys};
pub use matching::{Correspondence, Gate, correspondences};
pub use measure::Measured;
pub use view::View;

/// The picture of a control scene: seen straight from above, in one scale.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row, 0 for black to 255 for white.
    pub grey: Vec<f32>,
    /// Ground sample distance.
    pub gsd_m: f64,
    /// Where the upper edge of the picture points to: clockwise from true north.
    pub azimuth_of_image_up_rad: f64,
    /// Its standard deviation.
    pub sigma_azimuth_rad: f64,
    /// The reference point in the picture: x right, y down, from the corner of the top-left pixel.
    pub reference_px: Vector2<f64>,
}

impl Scene {
    /// How far a pixel's place on the ground lies east and north of the reference point.
    #[must_use]
    pub fn ground_from_pixel_m(&self, pixel: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.azimuth_of_image_up_rad.sin_cos();
        let right_m = self.gsd_m * (pixel.x - self.reference_px.x);
        let up_m = self.gsd_m * (self.reference_px.y - pixel.y);
        Vector2::new(right_m * cos + up_m * sin, up_m * cos - right_m * sin)
    }

    /// The same for a step from pixel to pixel.
    #[must_use]
    pub fn ground_by_pixel_m(&self) -> Matrix2<f64> {
        let (sin, cos) = self.azimuth_of_image_up_rad.sin_cos();
        Matrix2::new(cos, -sin, -sin, -cos) * self.gsd_m
    }

    /// The pixel of a place so far east and north of the reference point.
    #[must_use]
    pub fn pixel_from_ground(&self, ground_m: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.azimuth_of_image_up_rad.sin_cos();
        let right_m = ground_m.x * cos - ground_m.y * sin;
        let up_m = ground_m.x * sin + ground_m.y * cos;
        self.reference_px + Vector2::new(right_m, -up_m) / self.gsd_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn up_in_a_picture_that_points_east_is_east() {
        let scene = Scene {
            width: 100,
            height: 80,
            grey: vec![0.0; 8000],
            gsd_m: 0.1,
            azimuth_of_image_up_rad: std::f64::consts::FRAC_PI_2,
            sigma_azimuth_rad: 0.05,
            reference_px: Vector2::new(50.0, 40.0),
        };
        let above = scene.ground_from_pixel_m(Vector2::new(50.0, 30.0));
        assert!((above - Vector2::new(1.0, 0.0)).norm() < 1e-12);
        let right = scene.ground_from_pixel_m(Vector2::new(60.0, 40.0));
        assert!((right - Vector2::new(0.0, -1.0)).norm() < 1e-12);
        for azimuth_of_image_up_rad in [0.0, 0.7, -2.0] {
            let turned = Scene { azimuth_of_image_up_rad, ..scene.clone() };
            let pixel = Vector2::new(12.5, 70.25);
            assert!((turned.pixel_from_ground(turned.ground_from_pixel_m(pixel)) - pixel).norm() < 1e-9);
            let stepped = turned.ground_by_pixel_m() * (pixel - turned.reference_px);
            assert!((stepped - turned.ground_from_pixel_m(pixel)).norm() < 1e-9);
        }
    }
}
