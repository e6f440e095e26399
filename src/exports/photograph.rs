//! An oriented photograph, and where its pixels look on the ground, free of any map.

use nalgebra::{Rotation3, Vector2, Vector3};
use serde::Serialize;

use super::ExportError;
use crate::geometry::{Camera, Crs, Ellipsoid, ExteriorOrientation, LocalFrame};

/// A photograph whose exterior orientation is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// The name of its file, by which other software finds it.
    pub name: String,
    /// What its camera is called.
    pub camera_name: String,
    /// The camera, or the scan of a film as one.
    pub camera: Camera,
    /// Side of a pixel on the sensor or on the film: of a digital camera whatever is assumed where a format wants
    /// millimetres, for only the ratio counts.
    pub pixel_size_mm: f64,
    /// The projection centre, geocentric on WGS 84.
    pub centre_geocentric_m: Vector3<f64>,
    /// Rotation of the geocentric axes to the camera frame (x right, y up, z backwards).
    pub camera_from_geocentric: Rotation3<f64>,
    /// How well it is known, where that is told.
    pub sigma: Option<Sigma>,
    /// What the system and staff think of it.
    pub judgement: Judgement,
    /// Mean ellipsoidal height of the ground in view.
    pub ground_height_m: f64,
    /// How far the ground is expected to reach above and below that.
    pub relief_m: f64,
}

/// Standard deviations about the axes of the result, which are not those of the exports.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Sigma {
    /// The CRS or frame of these axes.
    pub frame: String,
    /// Of the projection centre along them.
    pub projection_centre_m: [f64; 3],
    /// Of omega, phi and kappa about them.
    pub omega_phi_kappa_rad: [f64; 3],
}

/// What is thought of an orientation.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Judgement {
    /// The system's verdict: `green`, `yellow` or `red`; `None` where nobody has asked.
    pub verdict: Option<String>,
    /// What staff have decided: `accepted` or `rejected`.
    pub review: Option<String>,
}

impl Judgement {
    /// Why nobody should use the orientation unknowingly, if so.
    #[must_use]
    pub fn warning(&self) -> Option<&'static str> {
        match (self.review.as_deref(), self.verdict.as_deref()) {
            (Some("rejected"), _) => Some("staff have rejected it"),
            (Some("accepted"), _) => None,
            (_, Some("red")) => Some("its verdict is red"),
            _ => None,
        }
    }
}

/// The height of a point on the ray is met to this.
const HEIGHT_TOLERANCE_M: f64 = 1e-5;
const STEPS: usize = 20;
/// Shares of the frame's width and height at which formats are fitted and compared, well into the corners.
pub(super) const SHARES: [f64; 7] = [0.01, 0.15, 0.325, 0.5, 0.675, 0.85, 0.99];

/// The longitude as it is written nearest to another: beyond the antimeridian it goes on.
pub(super) fn unwrapped_deg(longitude_deg: f64, about_deg: f64) -> f64 {
    longitude_deg - 360.0 * ((longitude_deg - about_deg) / 360.0).round()
}

/// A pixel with a point of the ground that it shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sight {
    /// In the file, from the corner of the top-left pixel.
    pub(super) pixel: Vector2<f64>,
    /// What it shows, geocentric.
    pub(super) ground_geocentric_m: Vector3<f64>,
}

impl Photograph {
    /// Local east, north, up about the projection centre, and the orientation therein.
    #[must_use]
    pub fn local(&self) -> (LocalFrame, ExteriorOrientation) {
        let frame = LocalFrame::about(self.centre_geocentric_m);
        (frame, self.in_frame(&frame))
    }

    /// The orientation in a Cartesian frame.
    #[must_use]
    pub fn in_frame(&self, frame: &LocalFrame) -> ExteriorOrientation {
        ExteriorOrientation {
            projection_centre_m: frame.from_geocentric(self.centre_geocentric_m),
            camera_from_object: self.camera_from_geocentric * frame.local_from_geocentric().inverse(),
        }
    }

    /// The pixel of a geocentric point; `None` where it is not in view.
    #[must_use]
    pub fn pixel(&self, geocentric_m: Vector3<f64>) -> Option<Vector2<f64>> {
        let (frame, orientation) = self.local();
        orientation.pixel(&self.camera, frame.from_geocentric(geocentric_m))
    }

    /// Where the ray of a pixel is at an ellipsoidal height, geocentric.
    ///
    /// # Errors
    /// [`ExportError::Horizon`] if it does not get there.
    pub fn ground_geocentric_m(&self, pixel: Vector2<f64>, height_m: f64) -> Result<Vector3<f64>, ExportError> {
        let horizon = || ExportError::Horizon { name: self.name.clone(), pixel: [pixel.x, pixel.y] };
        let (frame, orientation) = self.local();
        let reduced = self.camera.reduced_from_pixel(pixel).ok_or_else(horizon)?;
        // the ellipsoid falls away from the tangent plane: the plane is moved until the height is right
        let mut plane_m = height_m - frame.height_m();
        for _ in 0..STEPS {
            let local_m = orientation.ground_point_m(self.camera.principal_distance_px, reduced, plane_m);
            let geocentric_m = frame.to_geocentric(local_m.ok_or_else(horizon)?);
            let missing_m = height_m - Ellipsoid::WGS84.geodetic(geocentric_m).height_m;
            if missing_m.abs() < HEIGHT_TOLERANCE_M {
                return Ok(geocentric_m);
            }
            plane_m += missing_m;
        }
        Err(horizon())
    }

    /// The lowest, the mean and the highest ground.
    #[must_use]
    pub fn heights_m(&self) -> [f64; 3] {
        [-1.0, 0.0, 1.0].map(|side| self.ground_height_m + side * self.relief_m)
    }

    /// Pixels all over the frame with what they show at each of some heights.
    pub(super) fn sights(&self, heights_m: &[f64]) -> Result<Vec<Sight>, ExportError> {
        let mut sights = Vec::with_capacity(heights_m.len() * SHARES.len() * SHARES.len());
        for height_m in heights_m {
            for (across, down) in SHARES.iter().flat_map(|across| SHARES.map(|down| (*across, down))) {
                let pixel = self.camera.frame_px(across, down);
                sights.push(Sight { pixel, ground_geocentric_m: self.ground_geocentric_m(pixel, *height_m)? });
            }
        }
        Ok(sights)
    }

    /// Longitude, latitude (degrees) and ellipsoidal height of a geocentric point.
    pub(super) fn geodetic(geocentric_m: Vector3<f64>) -> Result<[f64; 3], ExportError> {
        Ok(Crs::parse("EPSG:4979")?.position_from_geocentric(geocentric_m, None)?)
    }

    /// Whether it is a scan of film.
    #[must_use]
    pub fn is_film(&self) -> bool {
        self.camera.distortion().is_none()
    }

    /// The principal distance in millimetres, by the size of a pixel.
    #[must_use]
    pub fn principal_distance_mm(&self) -> f64 {
        self.camera.principal_distance_px * self.pixel_size_mm
    }
}
