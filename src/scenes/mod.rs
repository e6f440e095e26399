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
#[cfg(test)]
pub(crate) mod tests;
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
