//! Where the pixels of a scan of film look.

use nalgebra::{Matrix2, Matrix3, Vector2};

use super::film::Film;
use super::pixel_from_plate::PixelFromPlate;

/// The interior orientation of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scan {
    pub(super) film: Film,
    pub(super) pixel_from_plate: PixelFromPlate,
    /// Covariance of the factors of x, y (millimetres) and 1 in an error of either pixel coordinate.
    pub(super) displacement: Matrix3<f64>,
}

/// Places along each side of the format whose rays must lead back to them.
const CHECKED: u32 = 16;

impl Scan {
    /// Where the distortion cannot be inverted, far outside of the format, the film is taken to be without.
    pub(super) fn pixel_from_ideal(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let away_mm = Vector2::new(ideal.x, -ideal.y) * self.film.principal_distance_mm;
        let corrected = self.film.principal_point_mm + away_mm;
        self.pixel_from_plate.pixel(self.film.measured_mm(corrected).unwrap_or(corrected))
    }

    /// `None` where the distortion cannot be inverted.
    pub(super) fn ideal_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let measured = self.pixel_from_plate.plate_mm(pixel);
        let away_mm = self.film.corrected_mm(measured) - self.film.principal_point_mm;
        let ideal = Vector2::new(away_mm.x, -away_mm.y) / self.film.principal_distance_mm;
        (self.film.is_unfolded(measured) && ideal.iter().all(|v| v.is_finite())).then_some(ideal)
    }

    /// Covariance, in each coordinate, of the errors of the pixels of two ideal points.
    pub(super) fn covariance_px2(&self, a: Vector2<f64>, b: Vector2<f64>) -> f64 {
        let [a, b] = [a, b].map(|ideal| {
            let away_mm = Vector2::new(ideal.x, -ideal.y) * self.film.principal_distance_mm;
            (self.film.principal_point_mm + away_mm).push(1.0)
        });
        a.dot(&(self.displacement * b))
    }

    /// The pixel of a place in the image format: shares of its width from the left, and of its height from the top, as
    /// the plate is seen.
    pub(super) fn frame_px(&self, across: f64, down: f64) -> Vector2<f64> {
        let [width, height] = self.film.format_mm;
        self.pixel_from_plate.pixel(Vector2::new((across - 0.5) * width, (0.5 - down) * height))
    }

    pub(super) fn contains(&self, pixel: Vector2<f64>, margin_px: f64) -> bool {
        let margin_mm = margin_px / self.scale_px_per_mm();
        let place = self.pixel_from_plate.plate_mm(pixel).abs();
        let [width, height] = self.film.format_mm;
        place.x <= width / 2.0 + margin_mm && place.y <= height / 2.0 + margin_mm
    }

    /// At the principal point.
    pub(super) fn scale_px_per_mm(&self) -> f64 {
        self.pixel_from_plate.scale_px_per_mm(self.film.principal_point_mm)
    }

    /// How the film lies in the scanner: a turn, perhaps a reflection, and the scanner's different scales. What the
    /// distortion and a perspective of the scanner add is left out.
    pub(super) fn pixel_by_reduced(&self) -> Matrix2<f64> {
        let y_down = Matrix2::from_diagonal(&Vector2::new(1.0, -1.0));
        self.pixel_from_plate.jacobian(self.film.principal_point_mm) * y_down / self.scale_px_per_mm()
    }

    /// The first of a raster of pixels over the format whose ray does not lead back to it.
    pub(super) fn folded_px(&self) -> Option<Vector2<f64>> {
        let sense = self.pixel_from_plate.jacobian(self.film.principal_point_mm).determinant().signum();
        let folds = |place: &Vector2<f64>| {
            let pixel = self.pixel_from_plate.pixel(*place);
            let returns =
                self.ideal_from_pixel(pixel).is_some_and(|ideal| (self.pixel_from_ideal(ideal) - pixel).norm() < 1e-6);
            !returns || self.pixel_from_plate.jacobian(*place).determinant().signum() != sense
        };
        self.film.places_mm(CHECKED).find(folds).map(|place| self.pixel_from_plate.pixel(place))
    }
}
