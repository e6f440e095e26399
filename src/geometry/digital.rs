//! Where a digital camera's pixels look.

use nalgebra::{Matrix2, Vector2};

use super::brown::Brown;

/// The interior orientation of a digital camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Digital {
    pub(super) size_px: [u32; 2],
    pub(super) principal_distance_px: f64,
    pub(super) principal_point_px: Vector2<f64>,
    pub(super) distortion: Brown,
}

const INVERSION_STEPS: usize = 20;
const INVERSION_TOLERANCE: f64 = 1e-13;

impl Digital {
    pub(super) fn pixel_from_ideal(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let d = &self.distortion;
        let bent = d.distorted(ideal);
        self.principal_point_px
            + self.principal_distance_px * bent
            + Vector2::new(d.b1_px * bent.x + d.b2_px * bent.y, 0.0)
    }

    /// By Newton's method; `None` where the distortion cannot be inverted.
    pub(super) fn ideal_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let d = &self.distortion;
        let from_centre = pixel - self.principal_point_px;
        let y = from_centre.y / self.principal_distance_px;
        let x = (from_centre.x - d.b2_px * y) / (self.principal_distance_px + d.b1_px);
        let bent = Vector2::new(x, y);
        let mut ideal = bent;
        for _ in 0..INVERSION_STEPS {
            let step = d.jacobian(ideal).try_inverse()? * (bent - d.distorted(ideal));
            ideal += step;
            if !ideal.iter().all(|v| v.is_finite()) {
                return None;
            }
            if step.norm() < INVERSION_TOLERANCE {
                // past a fold Newton may end on the wrong branch, where the mapping turns over
                return (d.jacobian(ideal).determinant() > 0.0).then_some(ideal);
            }
        }
        None
    }

    /// The frame is the picture.
    pub(super) fn frame_px(&self, across: f64, down: f64) -> Vector2<f64> {
        let [width, height] = self.size_px.map(f64::from);
        Vector2::new(across * width, down * height)
    }

    /// Distortion changes scales and directions by a few per mille, which the users of this leave out.
    pub(super) fn pixel_by_reduced(&self) -> Matrix2<f64> {
        Matrix2::identity()
    }

    /// The first of a raster of pixels whose ray does not lead back to it.
    pub(super) fn folded_px(&self) -> Option<Vector2<f64>> {
        const STEPS: u32 = 16;
        let at = |k: u32, size: u32| f64::from(size) * f64::from(k) / f64::from(STEPS);
        let [width, height] = self.size_px;
        let mut pixels =
            (0..=STEPS).flat_map(move |i| (0..=STEPS).map(move |j| Vector2::new(at(i, width), at(j, height))));
        let returns = |pixel: Vector2<f64>| {
            self.ideal_from_pixel(pixel).is_some_and(|ideal| (self.pixel_from_ideal(ideal) - pixel).norm() < 1e-6)
        };
        pixels.find(|pixel| !returns(*pixel))
    }
}
