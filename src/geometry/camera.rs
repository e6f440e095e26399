//! The camera's interior orientation: where do the pixels of a file look?
//!
//! Three kinds of image coordinates are met, all with x to the right and y down:
//! *pixels* as stored in the file, the corner of the top-left pixel being (0, 0);
//! *ideal* coordinates x = X/Z, y = Y/Z, free of distortion;
//! *reduced* coordinates, the ideal ones times the principal distance: pixels about the principal point in which the
//! camera is a perfect pinhole and straight edges are straight. Estimation works in reduced coordinates.
//!
//! The pixels of a digital camera are its own. A scan of film shows the plate as it lay in the scanner, turned or
//! mirrored perhaps: there reduced x is along plate x and reduced y against plate y, whatever rows and columns do, and
//! the *frame* is the image on the plate, not the file.

use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2};

use super::brown::Brown;
use super::digital::Digital;
use super::film::Film;
use super::pixel_from_plate::PixelFromPlate;
use super::scan::Scan;
use super::segment::Segment2;

/// A frame camera, or a scan of film as one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// Columns of the image.
    pub width_px: u32,
    /// Rows of the image.
    pub height_px: u32,
    /// Principal distance; of a scan in pixels of mean size at the principal point.
    pub principal_distance_px: f64,
    interior: Interior,
    frame_radius_px: f64,
}

/// Where the pixels look.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a camera is small enough to be copied, and there is one for an image")]
enum Interior {
    Digital(Digital),
    Scan(Scan),
}

/// Why a camera cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// The frame has no pixels.
    #[error("the image size is {width_px} x {height_px} px; both must be at least 1")]
    EmptyFrame {
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
    },
    /// Not a positive, finite principal distance.
    #[error("the principal distance is {value} px; it must be positive and finite")]
    PrincipalDistance {
        /// What was given.
        value: f64,
    },
    /// A parameter is not a number.
    #[error("{name} is not a finite number")]
    NotFinite {
        /// The parameter's name in the contract.
        name: &'static str,
    },
    /// Two places of the scene would fall on the same pixel.
    #[error("the distortion folds the image at ({x_px:.0}, {y_px:.0}) px: it cannot be inverted there")]
    DistortionFolds {
        /// Column of the offending pixel.
        x_px: f64,
        /// Row of the offending pixel.
        y_px: f64,
    },
}

impl Camera {
    /// A digital camera whose parameters are finite and whose distortion can be inverted all over the frame.
    ///
    /// # Errors
    /// [`CameraError`] names the parameter that is at fault.
    pub fn new(
        size_px: [u32; 2],
        principal_distance_px: f64,
        principal_point_px: Vector2<f64>,
        distortion: Brown,
    ) -> Result<Self, CameraError> {
        check_size(size_px)?;
        if !(principal_distance_px.is_finite() && principal_distance_px > 0.0) {
            return Err(CameraError::PrincipalDistance { value: principal_distance_px });
        }
        let Brown { k1, k2, k3, p1, p2, b1_px, b2_px } = distortion;
        let named = [
            ("principal_point_px", principal_point_px.x),
            ("principal_point_px", principal_point_px.y),
            ("k1", k1),
            ("k2", k2),
            ("k3", k3),
            ("p1", p1),
            ("p2", p2),
            ("b1_px", b1_px),
            ("b2_px", b2_px),
        ];
        if let Some((name, _)) = named.into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(CameraError::NotFinite { name });
        }
        let digital = Digital { size_px, principal_distance_px, principal_point_px, distortion };
        Self::checked(size_px, principal_distance_px, Interior::Digital(digital))
    }

    /// The scan of a film as a camera: the plate's x is ideal x, its y against ideal y. The frame is the image on the
    /// film.
    ///
    /// # Errors
    /// [`CameraError`] if the file is empty, or places of the image have no pixels of their own.
    pub fn of_scan(size_px: [u32; 2], film: &Film, pixel_from_plate: &PixelFromPlate) -> Result<Self, CameraError> {
        check_size(size_px)?;
        let scan = Scan { film: *film, pixel_from_plate: *pixel_from_plate, displacement: Matrix3::zeros() };
        let principal_distance_px = film.principal_distance_mm * scan.scale_px_per_mm();
        Self::checked(size_px, principal_distance_px, Interior::Scan(scan))
    }

    /// The same scan whose interior orientation is known no better than this: the covariance of the elements a11, a12, a13,
    /// a21, a22, a23 of an affine transformation from the plate's millimetres to pixels. Nothing changes for a digital
    /// camera.
    #[must_use]
    pub fn with_interior_covariance(mut self, covariance: &Matrix6<f64>) -> Self {
        if let Interior::Scan(scan) = &mut self.interior {
            scan.displacement = (covariance.fixed_view::<3, 3>(0, 0) + covariance.fixed_view::<3, 3>(3, 3)) / 2.0;
        }
        self
    }

    /// Covariance, in each coordinate, of the errors that the interior orientation makes at two ideal points, px²; 0 for a
    /// digital camera. (What x and y have in common is left out: for marks that are equally well known all around there
    /// is nothing.)
    #[must_use]
    pub fn interior_covariance_px2(&self, a: Vector2<f64>, b: Vector2<f64>) -> f64 {
        match &self.interior {
            Interior::Digital(_) => 0.0,
            Interior::Scan(scan) => scan.covariance_px2(a, b),
        }
    }

    fn checked(size_px: [u32; 2], principal_distance_px: f64, interior: Interior) -> Result<Self, CameraError> {
        let [width_px, height_px] = size_px;
        let mut camera = Self { width_px, height_px, principal_distance_px, interior, frame_radius_px: 0.0 };
        if let Some(pixel) = camera.folded_px() {
            return Err(CameraError::DistortionFolds { x_px: pixel.x, y_px: pixel.y });
        }
        camera.frame_radius_px = camera.farthest_corner_px();
        Ok(camera)
    }

    /// The pixel that looks along the camera's axis.
    #[must_use]
    pub fn principal_point_px(&self) -> Vector2<f64> {
        match &self.interior {
            Interior::Digital(digital) => digital.principal_point_px,
            Interior::Scan(scan) => scan.pixel_from_ideal(Vector2::zeros()),
        }
    }

    /// The distortion of a digital camera; `None` for a scan, whose lens is a [`Film`]'s.
    #[must_use]
    pub fn distortion(&self) -> Option<&Brown> {
        match &self.interior {
            Interior::Digital(digital) => Some(&digital.distortion),
            Interior::Scan(_) => None,
        }
    }

    /// The pixel of an ideal point.
    #[must_use]
    pub fn pixel_from_ideal(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        match &self.interior {
            Interior::Digital(digital) => digital.pixel_from_ideal(ideal),
            Interior::Scan(scan) => scan.pixel_from_ideal(ideal),
        }
    }

    /// The ideal point of a pixel; `None` where the distortion cannot be inverted.
    #[must_use]
    pub fn ideal_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        match &self.interior {
            Interior::Digital(digital) => digital.ideal_from_pixel(pixel),
            Interior::Scan(scan) => scan.ideal_from_pixel(pixel),
        }
    }

    /// The pixel of a reduced point.
    #[must_use]
    pub fn pixel_from_reduced(&self, reduced_px: Vector2<f64>) -> Vector2<f64> {
        self.pixel_from_ideal(reduced_px / self.principal_distance_px)
    }

    /// The reduced point of a pixel; `None` where the distortion cannot be inverted.
    #[must_use]
    pub fn reduced_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        Some(self.ideal_from_pixel(pixel)? * self.principal_distance_px)
    }

    /// Whether a pixel position lies in the file, and in the frame, both widened by a margin.
    #[must_use]
    pub fn contains(&self, pixel: Vector2<f64>, margin_px: f64) -> bool {
        let inside = |v: f64, size: u32| v >= -margin_px && v <= f64::from(size) + margin_px;
        let in_file = inside(pixel.x, self.width_px) && inside(pixel.y, self.height_px);
        match &self.interior {
            Interior::Digital(_) => in_file,
            Interior::Scan(scan) => in_file && scan.contains(pixel, margin_px),
        }
    }

    /// The pixel of a place in the frame, given as shares of its width from the left and of its height from the top:
    /// of a scan, as the plate is seen, whatever way it lies in the file.
    #[must_use]
    pub fn frame_px(&self, across: f64, down: f64) -> Vector2<f64> {
        match &self.interior {
            Interior::Digital(digital) => digital.frame_px(across, down),
            Interior::Scan(scan) => scan.frame_px(across, down),
        }
    }

    /// The area of the frame, square pixels.
    #[must_use]
    pub fn frame_area_px2(&self) -> f64 {
        let [a, b, c, d] = CORNERS.map(|(across, down)| self.frame_px(across, down));
        // the diagonals of a quadrilateral span twice its area
        (c - a).perp(&(d - b)).abs() / 2.0
    }

    /// Distance from the principal point, in reduced pixels, of the corner of the frame that is farthest from it. Beyond
    /// about this radius the polynomial of the distortion says nothing.
    #[must_use]
    pub fn frame_radius_px(&self) -> f64 {
        self.frame_radius_px
    }

    /// The angle between the axis and the ray of the farthest corner of the frame.
    #[must_use]
    pub fn half_view_rad(&self) -> f64 {
        (self.frame_radius_px / self.principal_distance_px).atan()
    }

    /// The rectangle of pixels, least and largest x and y, that holds a square of reduced points about a centre. The
    /// distortion is left out.
    #[must_use]
    pub fn pixels_around(&self, centre_px: Vector2<f64>, half_width_px: f64) -> [Vector2<f64>; 2] {
        let centre = self.pixel_from_reduced(centre_px);
        let half = self.pixel_by_reduced().abs() * Vector2::repeat(half_width_px);
        [centre - half, centre + half]
    }

    /// How reduced points near the principal point turn, reflect and stretch on their way to pixels: nothing of this for
    /// a digital camera. The distortion is left out.
    #[must_use]
    pub fn pixel_by_reduced(&self) -> Matrix2<f64> {
        match &self.interior {
            Interior::Digital(digital) => digital.pixel_by_reduced(),
            Interior::Scan(scan) => scan.pixel_by_reduced(),
        }
    }

    /// How many reduced pixels across a line of the file a pixel across it is. The distortion is left out.
    #[must_use]
    pub fn reduced_per_pixel_across(&self, line_px: &Segment2) -> f64 {
        match (&self.interior, self.pixel_by_reduced().try_inverse()) {
            // areas are stretched by the determinant, lengths along the line by what its direction becomes
            (Interior::Scan(_), Some(inverse)) => {
                let along = (inverse * line_px.direction()).norm();
                if along > 0.0 { inverse.determinant().abs() / along } else { 1.0 }
            }
            _ => 1.0,
        }
    }

    fn farthest_corner_px(&self) -> f64 {
        CORNERS
            .into_iter()
            .filter_map(|(across, down)| self.reduced_from_pixel(self.frame_px(across, down)))
            .map(|reduced| reduced.norm())
            .fold(0.0, f64::max)
    }

    /// A pixel of the frame whose ray does not lead back to it.
    fn folded_px(&self) -> Option<Vector2<f64>> {
        match &self.interior {
            Interior::Digital(digital) => digital.folded_px(),
            Interior::Scan(scan) => scan.folded_px(),
        }
    }
}

/// The corners of the frame in shares of its sides, one after the other.
const CORNERS: [(f64, f64); 4] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];

fn check_size([width_px, height_px]: [u32; 2]) -> Result<(), CameraError> {
    if width_px == 0 || height_px == 0 { Err(CameraError::EmptyFrame { width_px, height_px }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Smac;
    use approx::assert_relative_eq;

    fn distorted_camera() -> Camera {
        let distortion =
            Brown { k1: -0.0468, k2: 0.0207, k3: 0.001, p1: 0.00102, p2: 0.00199, b1_px: 1.5, b2_px: -0.7 };
        Camera::new([4608, 3456], 3757.1, Vector2::new(2304.0, 1728.0), distortion).unwrap()
    }

    #[test]
    fn distortion_is_the_contract_s_formula() {
        let camera = distorted_camera();
        let (x, y): (f64, f64) = (0.31, -0.22);
        let r2 = x * x + y * y;
        let radial = 1.0 - 0.0468 * r2 + 0.0207 * r2.powi(2) + 0.001 * r2.powi(3);
        let xd = x * radial + 2.0 * 0.00102 * x * y + 0.00199 * (r2 + 2.0 * x * x);
        let yd = y * radial + 0.00102 * (r2 + 2.0 * y * y) + 2.0 * 0.00199 * x * y;
        let pixel = camera.pixel_from_ideal(Vector2::new(x, y));
        assert_relative_eq!(pixel.x, 2304.0 + 3757.1 * xd + 1.5 * xd - 0.7 * yd, epsilon = 1e-9);
        assert_relative_eq!(pixel.y, 1728.0 + 3757.1 * yd, epsilon = 1e-9);
    }

    #[test]
    fn inverse_returns_to_the_pixel() {
        let camera = distorted_camera();
        for (x, y) in [(0.0, 0.0), (4608.0, 3456.0), (17.3, 3000.1), (2304.0, 1728.0)] {
            let pixel = Vector2::new(x, y);
            let ideal = camera.ideal_from_pixel(pixel).unwrap();
            assert_relative_eq!(camera.pixel_from_ideal(ideal), pixel, epsilon = 1e-8);
        }
    }

    #[test]
    fn cameras_that_make_no_sense_are_refused() {
        let centre = Vector2::new(50.0, 40.0);
        let refused = |size, c, d| Camera::new(size, c, centre, d).unwrap_err();
        let none = Brown::default();
        assert!(matches!(refused([0, 80], 100.0, none), CameraError::EmptyFrame { .. }));
        assert!(matches!(refused([100, 80], -1.0, none), CameraError::PrincipalDistance { .. }));
        let not_a_number = Brown { k2: f64::NAN, ..none };
        assert_eq!(refused([100, 80], 100.0, not_a_number), CameraError::NotFinite { name: "k2" });
        let fold = Brown { k1: -2.0, ..none };
        assert!(matches!(refused([100, 80], 60.0, fold), CameraError::DistortionFolds { .. }));
    }

    const FORMAT_MM: [f64; 2] = [230.0, 200.0];

    fn film() -> Film {
        let distortion = Smac { k: [-1e-4, 3e-8, -2e-12, 0.0, 0.0], p: [2e-7, -3e-7, 0.0, 0.0] };
        let (principal, symmetry) = (Vector2::new(0.4, -0.2), Vector2::new(0.012, 0.007));
        Film::new(153.0, principal, symmetry, distortion, FORMAT_MM).unwrap()
    }

    /// A plate in a scanner, with its centre at (3000, 2600).
    fn laid(linear: Matrix2<f64>) -> Camera {
        let pixel_from_plate = PixelFromPlate::affine(&linear, Vector2::new(3000.0, 2600.0)).unwrap();
        Camera::of_scan([6000, 5200], &film(), &pixel_from_plate).unwrap()
    }

    fn upright() -> Camera {
        laid(Matrix2::new(20.0, 0.0, 0.0, -20.0))
    }

    /// A quarter turn, a turn by 30 degrees with a reflection, and a scanner with oblong pixels.
    fn in_other_ways() -> [Camera; 3] {
        let (sine, cosine) = 30.0_f64.to_radians().sin_cos();
        let mirrored = Matrix2::new(cosine, -sine, sine, cosine) * 20.0;
        [Matrix2::new(0.0, 20.0, 20.0, 0.0), mirrored, Matrix2::new(-25.0, 0.0, 0.0, 16.0)].map(laid)
    }

    #[test]
    fn a_scan_looks_where_collinearity_about_the_principal_point_says() {
        let place = Vector2::new(61.0, -73.0);
        let corrected = film().corrected_mm(place) - film().principal_point_mm;
        for camera in in_other_ways().into_iter().chain([upright()]) {
            let Interior::Scan(scan) = camera.interior else { panic!("a digital camera") };
            let ideal = camera.ideal_from_pixel(scan.pixel_from_plate.pixel(place)).unwrap();
            // the plate's y is left of the flight, the ideal one to its right
            assert_relative_eq!(ideal, Vector2::new(corrected.x, -corrected.y) / 153.0, epsilon = 1e-12);
            assert_relative_eq!(camera.principal_distance_px, 153.0 * 20.0, max_relative = 1e-9);
            assert_relative_eq!(camera.frame_radius_px(), upright().frame_radius_px(), max_relative = 1e-9);
            assert_relative_eq!(camera.frame_area_px2(), 4600.0 * 4000.0, max_relative = 1e-9);
            assert_eq!(camera.distortion(), None);
        }
    }

    #[test]
    fn an_upright_scan_without_distortion_is_a_digital_camera() {
        let film = Film::new(150.0, Vector2::new(0.5, -0.25), Vector2::zeros(), Smac::default(), FORMAT_MM).unwrap();
        let pixel_from_plate =
            PixelFromPlate::affine(&Matrix2::new(20.0, 0.0, 0.0, -20.0), Vector2::new(2300.0, 2000.0)).unwrap();
        let scan = Camera::of_scan([4600, 4000], &film, &pixel_from_plate).unwrap();
        let digital = Camera::new([4600, 4000], 3000.0, Vector2::new(2310.0, 2005.0), Brown::default()).unwrap();
        assert_relative_eq!(scan.principal_point_px(), digital.principal_point_px(), epsilon = 1e-9);
        assert_relative_eq!(scan.frame_radius_px(), digital.frame_radius_px(), epsilon = 1e-9);
        for (across, down) in [(0.0, 0.0), (1.0, 0.3), (0.2, 0.9)] {
            let pixel = digital.frame_px(across, down);
            assert_relative_eq!(scan.frame_px(across, down), pixel, epsilon = 1e-9);
            let (a, b) = (scan.reduced_from_pixel(pixel).unwrap(), digital.reduced_from_pixel(pixel).unwrap());
            assert_relative_eq!(a, b, epsilon = 1e-9);
            assert_relative_eq!(scan.pixel_from_reduced(a), pixel, epsilon = 1e-9);
        }
    }

    #[test]
    fn the_frame_of_a_scan_is_the_image_on_the_plate_as_far_as_it_was_scanned() {
        for camera in in_other_ways().into_iter().chain([upright()]) {
            assert!(camera.contains(camera.frame_px(0.5, 0.5), 0.0));
            assert!(camera.contains(camera.frame_px(1.0, 0.5), 1.0));
            assert!(!camera.contains(camera.frame_px(1.0, 0.5), -1.0));
            // 3 mm beyond the image, the rim of the film is in the file
            assert!(!camera.contains(camera.frame_px(0.5, -0.015), 30.0));
            assert!(camera.contains(camera.frame_px(0.5, -0.015), 80.0));
        }
        // the scanner has cut off the left of the plate
        let cut = PixelFromPlate::affine(&Matrix2::new(20.0, 0.0, 0.0, -20.0), Vector2::new(1000.0, 2600.0)).unwrap();
        let cut = Camera::of_scan([5000, 5200], &film(), &cut).unwrap();
        assert!(!cut.contains(cut.frame_px(0.1, 0.5), 0.0) && cut.contains(cut.frame_px(0.9, 0.5), 0.0));
    }

    #[test]
    fn rectangles_of_the_file_hold_the_squares_of_reduced_points() {
        let (centre, half) = (Vector2::new(400.0, -700.0), 150.0);
        for camera in in_other_ways() {
            let [least, largest] = camera.pixels_around(centre, half);
            for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                let corner = camera.pixel_from_reduced(centre + half * Vector2::new(x, y));
                let margin = (corner - least).inf(&(largest - corner)).min();
                assert!(margin > -1.0, "{corner} is not between {least} and {largest}");
            }
        }
    }

    #[test]
    fn distances_across_a_line_are_stretched_as_the_scanner_does_it() {
        for camera in in_other_ways() {
            for angle in [0.0_f64, 0.7, 2.0] {
                let (start, along) = (camera.frame_px(0.5, 0.5), Vector2::new(angle.cos(), angle.sin()));
                let line = Segment2 { start, end: start + 50.0 * along };
                let ends = [line.start, line.end, start + line.normal()].map(|p| camera.reduced_from_pixel(p).unwrap());
                let reduced = Segment2 { start: ends[0], end: ends[1] };
                let expected = reduced.normal().dot(&(ends[2] - ends[0])).abs();
                assert_relative_eq!(camera.reduced_per_pixel_across(&line), expected, max_relative = 1e-3);
            }
        }
    }

    #[test]
    fn far_outside_a_scan_points_stay_outside() {
        let camera = upright();
        for reach in [1.5, 3.0, 10.0, 100.0] {
            let pixel = camera.pixel_from_reduced(Vector2::new(reach * camera.frame_radius_px(), 10.0));
            assert!(pixel.iter().all(|v| v.is_finite()) && !camera.contains(pixel, 50.0), "{pixel}");
        }
    }

    #[test]
    fn scans_that_make_no_sense_are_refused() {
        let lies = PixelFromPlate::affine(&Matrix2::new(20.0, 0.0, 0.0, -20.0), Vector2::zeros()).unwrap();
        assert!(matches!(Camera::of_scan([0, 10], &film(), &lies), Err(CameraError::EmptyFrame { .. })));
        // the line at infinity crosses the plate
        let infinite = nalgebra::Matrix3::new(20.0, 0.0, 0.0, 0.0, -20.0, 0.0, 0.02, 0.0, 1.0);
        let infinite = PixelFromPlate::new(&infinite).unwrap();
        let crossed = Camera::of_scan([10, 10], &film(), &infinite);
        assert!(matches!(crossed, Err(CameraError::DistortionFolds { .. })));
    }
}
