//! Lenses that see far to the side, as those of terrestrial pictures taken straight down from a pole: fish-eyes, and
//! the perspective lens beside them.
//!
//! A direction at the angle theta from the axis falls at the normalised distance rho(theta) from the principal point,
//! which is theta for an *equidistant* lens, 2 sin(theta / 2) for an *equisolid* one and tan(theta) for a *perspective*
//! one (the contract's `brown`). Distortion and affine terms are [`Brown`]'s, applied to these projected coordinates in
//! place of the ideal ones: the coefficients of a calibration with another convention (on angles, or on measured
//! coordinates) must be converted first.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};

use super::brown::Brown;
use super::camera::CameraError;
use super::digital::Digital;

/// How a lens lays angles from its axis out in the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Projection {
    /// r = c theta: most fish-eyes, nearly.
    Equidistant,
    /// r = 2 c sin(theta / 2): equal solid angles on equal areas.
    Equisolid,
    /// r = c tan(theta): a pinhole.
    Perspective,
}

impl Projection {
    /// rho of theta, and its derivative; `None` where nothing is imaged.
    fn radius(self, theta_rad: f64) -> Option<(f64, f64)> {
        match self {
            Self::Equidistant => Some((theta_rad, 1.0)),
            Self::Equisolid => {
                let (sin, cos) = (theta_rad / 2.0).sin_cos();
                Some((2.0 * sin, cos))
            }
            Self::Perspective => {
                let (sin, cos) = theta_rad.sin_cos();
                (cos > PERSPECTIVE_COS).then(|| (sin / cos, 1.0 / (cos * cos)))
            }
        }
    }

    /// theta of rho; `None` beyond all directions.
    fn angle_rad(self, radius: f64) -> Option<f64> {
        match self {
            Self::Equidistant => (radius < std::f64::consts::PI).then_some(radius),
            Self::Equisolid => (radius < 2.0).then(|| 2.0 * (radius / 2.0).asin()),
            Self::Perspective => Some(radius.atan()),
        }
    }

    /// rho of the direction backwards, or as far as a pinhole is made to see.
    fn farthest(self) -> f64 {
        match self {
            Self::Equidistant => std::f64::consts::PI,
            Self::Equisolid => 2.0,
            Self::Perspective => (1.0 / PERSPECTIVE_COS.powi(2) - 1.0).sqrt(),
        }
    }
}

/// A pinhole sees nothing usable within three degrees of the plane of the projection centre.
const PERSPECTIVE_COS: f64 = 0.05;

/// A camera by the directions in which its pixels look: unit vectors in the camera frame (x right, y up, z backwards).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fisheye {
    interior: Digital,
    projection: Projection,
    /// Projected coordinates farther out than this the distortion folds back, or nothing is imaged.
    farthest: f64,
}

/// Directions closer to the axis than this, as a share of their length, are taken as along it.
const ON_AXIS: f64 = 1e-12;

impl Fisheye {
    /// A camera whose parameters are finite.
    ///
    /// # Errors
    /// [`CameraError`] names the parameter that is at fault.
    pub fn new(
        size_px: [u32; 2],
        projection: Projection,
        principal_distance_px: f64,
        principal_point_px: Vector2<f64>,
        distortion: Brown,
    ) -> Result<Self, CameraError> {
        let [width_px, height_px] = size_px;
        if width_px == 0 || height_px == 0 {
            return Err(CameraError::EmptyFrame { width_px, height_px });
        }
        if !(principal_distance_px.is_finite() && principal_distance_px > 0.0) {
            return Err(CameraError::PrincipalDistance { value: principal_distance_px });
        }
        let Brown { k1, k2, k3, p1, p2, b1_px, b2_px } = distortion;
        let [x, y]: [f64; 2] = principal_point_px.into();
        let named = [("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2), ("b1_px", b1_px), ("b2_px", b2_px)];
        let named = named.into_iter().chain([("principal_point_px", x), ("principal_point_px", y)]);
        if let Some((name, _)) = named.into_iter().find(|(_, value)| !value.is_finite()) {
            return Err(CameraError::NotFinite { name });
        }
        let interior = Digital { size_px, principal_distance_px, principal_point_px, distortion };
        let farthest = unfolded(&distortion, projection.farthest());
        Ok(Self { interior, projection, farthest })
    }

    /// Columns and rows of the picture.
    #[must_use]
    pub fn size_px(&self) -> [u32; 2] {
        self.interior.size_px
    }

    /// Principal distance: pixels per radian at the axis, whatever the projection.
    #[must_use]
    pub fn principal_distance_px(&self) -> f64 {
        self.interior.principal_distance_px
    }

    /// The pixel that looks along the axis.
    #[must_use]
    pub fn principal_point_px(&self) -> Vector2<f64> {
        self.interior.principal_point_px
    }

    /// Its distortion.
    #[must_use]
    pub fn distortion(&self) -> &Brown {
        &self.interior.distortion
    }

    /// How angles are laid out.
    #[must_use]
    pub fn projection(&self) -> Projection {
        self.projection
    }

    /// Whether a pixel position lies in the picture.
    #[must_use]
    pub fn contains(&self, pixel: Vector2<f64>) -> bool {
        let [width, height] = self.interior.size_px.map(f64::from);
        (0.0..=width).contains(&pixel.x) && (0.0..=height).contains(&pixel.y)
    }

    /// The pixel of a direction (of any length), also outside the picture; `None` where the lens images nothing.
    #[must_use]
    pub fn pixel_from_direction(&self, direction: Vector3<f64>) -> Option<Vector2<f64>> {
        let (across, theta) = (direction.xy().norm(), angle_from_axis_rad(direction));
        let (radius, _) = self.projection.radius(theta)?;
        // written so that not-a-number is nowhere either
        let is_imaged = radius < self.farthest;
        if !is_imaged {
            return None;
        }
        // on the axis itself there is no direction across
        let scale = if across > 0.0 { radius / across } else { 0.0 };
        Some(self.interior.pixel_from_ideal(Vector2::new(direction.x, -direction.y) * scale))
    }

    /// The pixel of a direction, and its derivatives by the direction's three coordinates.
    #[must_use]
    pub fn pixel_with_jacobian(&self, direction: Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let pixel = self.pixel_from_direction(direction)?;
        let (across, theta, length) = (direction.xy().norm(), angle_from_axis_rad(direction), direction.norm());
        let (radius, radius_by_theta) = self.projection.radius(theta)?;
        // projected = scale (x, -y), scale = rho / across; near the axis rho is theta and theta is across / -z
        let (scale, scale_by_across, scale_by_z) = if across > ON_AXIS * length {
            let theta_by_across = -direction.z / length.powi(2);
            let theta_by_z = across / length.powi(2);
            (
                radius / across,
                (radius_by_theta * theta_by_across - radius / across) / across,
                radius_by_theta * theta_by_z / across,
            )
        } else {
            (1.0 / length, 0.0, 1.0 / length.powi(2))
        };
        let outward = if across > ON_AXIS * length { direction.xy() / across } else { Vector2::zeros() };
        let (x, y) = (direction.x, -direction.y);
        let (by_x, by_y) = (scale_by_across * outward.x, scale_by_across * outward.y);
        let projected_by_direction =
            Matrix2x3::new(scale + x * by_x, x * by_y, x * scale_by_z, y * by_x, -scale + y * by_y, y * scale_by_z);
        let distortion = &self.interior.distortion;
        let bent_by_projected = distortion.jacobian(Vector2::new(x, y) * scale);
        let c = self.interior.principal_distance_px;
        let pixel_by_bent = Matrix2::new(c + distortion.b1_px, distortion.b2_px, 0.0, c);
        Some((pixel, pixel_by_bent * bent_by_projected * projected_by_direction))
    }

    /// The unit vector in which a pixel looks; `None` outside the image circle, or where the distortion cannot be
    /// inverted.
    #[must_use]
    pub fn direction_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector3<f64>> {
        let projected = self.interior.ideal_from_pixel(pixel)?;
        let radius = projected.norm();
        // written so that not-a-number is nowhere either
        let is_imaged = radius < self.farthest;
        if !is_imaged {
            return None;
        }
        let (sin, cos) = self.projection.angle_rad(radius)?.sin_cos();
        let across = if radius > 0.0 { projected * (sin / radius) } else { Vector2::zeros() };
        Some(Vector3::new(across.x, -across.y, -cos))
    }
}

/// The angle between a direction and the axis along which the camera looks.
fn angle_from_axis_rad(direction: Vector3<f64>) -> f64 {
    direction.xy().norm().atan2(-direction.z)
}

/// How far out, at most to `farthest`, the distortion turns nothing over in any direction.
fn unfolded(distortion: &Brown, farthest: f64) -> f64 {
    const STEPS: u32 = 2000;
    const DIRECTIONS: u32 = 24;
    let turns_over = |radius: f64| {
        (0..DIRECTIONS).any(|k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(DIRECTIONS)).sin_cos();
            distortion.jacobian(Vector2::new(cos, sin) * radius).determinant() <= 0.0
        })
    };
    let radius = |step: u32| farthest * f64::from(step) / f64::from(STEPS);
    (1..=STEPS).find(|step| turns_over(radius(*step))).map_or(farthest, |step| radius(step - 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, SQRT_2};

    const ALL: [Projection; 3] = [Projection::Equidistant, Projection::Equisolid, Projection::Perspective];

    fn distortion() -> Brown {
        Brown { k1: -0.031, k2: 0.0042, k3: -0.0003, p1: 0.0006, p2: -0.0004, b1_px: 0.8, b2_px: -0.3 }
    }

    fn camera(projection: Projection, distortion: Brown) -> Fisheye {
        Fisheye::new([4256, 2848], projection, 1350.0, Vector2::new(2140.0, 1410.0), distortion).unwrap()
    }

    /// To the right and by an angle from the axis.
    fn right(theta_rad: f64) -> Vector3<f64> {
        Vector3::new(theta_rad.sin(), 0.0, -theta_rad.cos())
    }

    #[test]
    fn distances_from_the_principal_point_are_those_of_the_textbook() {
        let radius = |projection, theta| {
            let camera = camera(projection, Brown::default());
            (camera.pixel_from_direction(right(theta)).unwrap() - camera.principal_point_px()).x
        };
        assert_relative_eq!(radius(Projection::Equidistant, FRAC_PI_2), 1350.0 * FRAC_PI_2, epsilon = 1e-9);
        assert_relative_eq!(radius(Projection::Equisolid, FRAC_PI_2), 1350.0 * SQRT_2, epsilon = 1e-9);
        assert_relative_eq!(radius(Projection::Perspective, FRAC_PI_3), 1350.0 * 3.0_f64.sqrt(), epsilon = 1e-9);
        for projection in ALL {
            let camera = camera(projection, Brown::default());
            assert_relative_eq!(radius(projection, 1e-4), 0.135, max_relative = 1e-7);
            let axis = camera.pixel_from_direction(Vector3::new(0.0, 0.0, -3.0)).unwrap();
            assert_relative_eq!(axis, camera.principal_point_px());
            // y is up in the camera frame and down in the picture
            let above = camera.pixel_from_direction(Vector3::new(0.0, 0.1, -1.0)).unwrap();
            assert!(above.y < camera.principal_point_px().y);
        }
    }

    #[test]
    fn a_perspective_camera_is_the_camera_of_the_aerial_image() {
        let (size, c, centre) = ([4256, 2848], 1350.0, Vector2::new(2140.0, 1410.0));
        let other = crate::geometry::Camera::new(size, c, centre, Brown { k2: 0.0, k3: 0.0, ..distortion() }).unwrap();
        let fisheye = camera(Projection::Perspective, Brown { k2: 0.0, k3: 0.0, ..distortion() });
        let direction = Vector3::new(0.3, 0.2, -0.9);
        let ideal = Vector2::new(direction.x, -direction.y) / -direction.z;
        assert_relative_eq!(
            fisheye.pixel_from_direction(direction).unwrap(),
            other.pixel_from_ideal(ideal),
            epsilon = 1e-9
        );
    }

    #[test]
    fn nothing_is_imaged_beyond_what_the_lens_sees() {
        let perspective = camera(Projection::Perspective, Brown::default());
        assert_eq!(perspective.pixel_from_direction(right(FRAC_PI_2)), None);
        assert_eq!(perspective.pixel_from_direction(right(2.0)), None);
        let equidistant = camera(Projection::Equidistant, Brown::default());
        assert!(equidistant.pixel_from_direction(right(2.0)).is_some());
        assert_eq!(equidistant.direction_from_pixel(Vector2::new(2140.0, 1410.0 + 1350.0 * 3.2)), None);
        let equisolid = camera(Projection::Equisolid, Brown::default());
        assert_eq!(equisolid.direction_from_pixel(Vector2::new(2140.0, 1410.0 + 1350.0 * 2.1)), None);
        // r (1 - 0.2 r²) turns back at r = sqrt(1 / 0.6) = 1.29
        let folding = camera(Projection::Equidistant, Brown { k1: -0.2, ..Brown::default() });
        assert!(folding.pixel_from_direction(right(1.28)).is_some());
        assert_eq!(folding.pixel_from_direction(right(1.30)), None);
        assert_eq!(folding.pixel_from_direction(Vector3::repeat(f64::NAN)), None);
    }

    #[test]
    fn jacobian_agrees_with_finite_differences() {
        let directions = [[0.3, -0.5, -1.2], [2.0, 1.0, -0.4], [1e-4, 2e-4, -1.0], [0.0, 0.0, -2.5], [-1.0, 0.1, -4.0]];
        for projection in ALL {
            let camera = camera(projection, Brown { k2: 0.0, k3: 0.0, ..distortion() });
            for direction in directions.map(Vector3::from) {
                let Some((_, jacobian)) = camera.pixel_with_jacobian(direction) else {
                    assert_eq!(projection, Projection::Perspective);
                    continue;
                };
                for axis in 0..3 {
                    let h = Vector3::ith(axis, 1e-6);
                    let at = |d| camera.pixel_from_direction(d).unwrap();
                    let numeric = (at(direction + h) - at(direction - h)) / 2e-6;
                    assert_relative_eq!(
                        jacobian.column(axis).into_owned(),
                        numeric,
                        epsilon = 1e-3,
                        max_relative = 1e-6
                    );
                }
            }
        }
    }

    #[test]
    fn cameras_that_make_no_sense_are_refused() {
        let refused =
            |size, c, x, d| Fisheye::new(size, Projection::Equisolid, c, Vector2::new(x, 1.0), d).unwrap_err();
        let none = Brown::default();
        assert!(matches!(refused([0, 9], 1.0, 1.0, none), CameraError::EmptyFrame { .. }));
        assert!(matches!(refused([9, 9], 0.0, 1.0, none), CameraError::PrincipalDistance { .. }));
        assert_eq!(refused([9, 9], 1.0, f64::NAN, none), CameraError::NotFinite { name: "principal_point_px" });
        let infinite = Brown { k3: f64::INFINITY, ..none };
        assert_eq!(refused([9, 9], 1.0, 1.0, infinite), CameraError::NotFinite { name: "k3" });
    }

    proptest! {
        #[test]
        fn a_direction_comes_back_from_its_pixel(theta in 0.0..1.35, turn in 0.0..6.3, which in 0..3usize) {
            // the polynomial of a pinhole is not made for tan(77°)
            let theta = if ALL[which] == Projection::Perspective { theta / 1.6 } else { theta };
            let camera = camera(ALL[which], distortion());
            let direction =
                Vector3::new(f64::sin(theta) * f64::cos(turn), f64::sin(theta) * f64::sin(turn), -f64::cos(theta));
            let pixel = camera.pixel_from_direction(direction * 4.0).unwrap();
            prop_assert!((camera.direction_from_pixel(pixel).unwrap() - direction).norm() < 1e-10);
        }
    }
}
