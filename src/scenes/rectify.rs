//! A control scene from a terrestrial picture that was taken nearly straight down: rectified to a horizontal plane,
//! north up, and reduced to the scale of aerial images.

use nalgebra::{Vector2, Vector3};

use super::Scene;
use super::resample::{grown, resampled};
use super::resect::NadirResection;
use crate::features::GreyWindow;
use crate::geometry::Fisheye;

/// How the rectified picture lies on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layout {
    /// Ground sample distance of the scene.
    pub gsd_m: f64,
    /// Height of the ground in the template's frame: minus the height of a plate that the targets are on.
    pub plane_height_m: f64,
    /// Rays that meet the ground at a larger angle from the vertical are not used: there every kerb and blade of grass
    /// is displaced, and pixels are large.
    pub largest_incidence_rad: f64,
    /// The scene is at most so wide and high; infinite for all that is seen.
    pub largest_side_m: f64,
    /// The direction of the template's y axis, clockwise from true north.
    pub azimuth_of_y_rad: f64,
    /// Its standard deviation.
    pub sigma_bearing_rad: f64,
    /// The point with known coordinates, in the template's frame.
    pub reference_m: Vector2<f64>,
}

/// A rectified picture, and how well it lies on the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Rectified {
    /// The picture; north is up.
    pub scene: Scene,
    /// Standard deviation of the shift of the scene as a whole against its reference, which the errors of the resection
    /// make.
    pub sigma_shift_m: f64,
    /// The same of the corner of the scene where it is largest: far away from the template errors of the tilt grow.
    pub sigma_corner_m: f64,
}

/// Why a picture cannot be rectified.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RectifyError {
    /// The camera is another one's.
    #[error("the picture has {width} x {height} px, but the camera {} x {} px", .camera[0], .camera[1])]
    PictureSize {
        /// Columns of the picture.
        width: usize,
        /// Rows of the picture.
        height: usize,
        /// Columns and rows of the camera.
        camera: [u32; 2],
    },
    /// A number that makes no sense.
    #[error("{name} is {value}; {expected}")]
    Setting {
        /// Its name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// The picture does not show the ground right below the camera.
    #[error("the picture does not show the ground below the camera, {tilt_deg:.0}° from its axis")]
    NoGround {
        /// The camera's tilt.
        tilt_deg: f64,
    },
    /// The reference would have no pixel.
    #[error(
        "the reference point at ({x_m:.2}, {y_m:.2}) m of the template's frame is outside of the rectified ground, \
         which reaches from {west_m:.2} to {east_m:.2} m east and from {south_m:.2} to {north_m:.2} m north of it"
    )]
    ReferenceOutside {
        /// Its place in the template's frame.
        x_m: f64,
        /// Its place in the template's frame.
        y_m: f64,
        /// Western rim of the scene.
        west_m: f64,
        /// Eastern rim.
        east_m: f64,
        /// Southern rim.
        south_m: f64,
        /// Northern rim.
        north_m: f64,
    },
}

/// No scene has more pixels a side.
const MOST_CELLS: i32 = 8000;

impl Layout {
    /// The place in the template's frame that lies so far east and north of the reference.
    fn template_m(&self, east_m: f64, north_m: f64) -> Vector3<f64> {
        let (sin, cos) = self.azimuth_of_y_rad.sin_cos();
        let x = self.reference_m.x + east_m * cos - north_m * sin;
        let y = self.reference_m.y + east_m * sin + north_m * cos;
        Vector3::new(x, y, self.plane_height_m)
    }

    /// How far east and north of the reference a place of the template's frame lies.
    fn east_north_m(&self, template_m: Vector2<f64>) -> Vector2<f64> {
        let (sin, cos) = self.azimuth_of_y_rad.sin_cos();
        let from_reference = template_m - self.reference_m;
        Vector2::new(from_reference.x * cos + from_reference.y * sin, from_reference.y * cos - from_reference.x * sin)
    }

    fn check(&self, camera_height_m: f64) -> Result<(), RectifyError> {
        let setting = |name, value, expected| Err(RectifyError::Setting { name, value, expected });
        let Self { gsd_m, plane_height_m, largest_incidence_rad, largest_side_m, .. } = *self;
        if !(gsd_m.is_finite() && gsd_m > 0.0) {
            return setting("the ground sample distance", gsd_m, "it must be positive");
        }
        let is_below = plane_height_m < camera_height_m;
        if !is_below {
            return setting("the height of the ground", plane_height_m, "it must be below the camera");
        }
        if !(largest_incidence_rad > 0.0 && largest_incidence_rad < 1.5) {
            let degrees = largest_incidence_rad.to_degrees();
            return setting("the largest angle of incidence", degrees, "it must be between 0 and 85°");
        }
        let holds_a_pixel = largest_side_m >= gsd_m;
        if !holds_a_pixel {
            return setting("the largest side", largest_side_m, "it must be at least a pixel");
        }
        let rest = [
            ("the azimuth of the template", self.azimuth_of_y_rad),
            ("the standard deviation of the bearing", self.sigma_bearing_rad),
            ("the reference point", self.reference_m.x),
            ("the reference point", self.reference_m.y),
        ];
        match rest.into_iter().find(|(_, value)| !value.is_finite()) {
            Some((name, value)) => setting(name, value, "it must be finite"),
            None => Ok(()),
        }
    }
}

/// The ground as the picture shows it: the largest rectangle about the point below the camera in which no ray is too
/// oblique and nothing is outside of the picture. Cells are means over the pixels that fall into them.
///
/// # Errors
/// [`RectifyError`] if the picture is not this camera's, a setting makes no sense, or the reference is not shown.
pub fn rectify(
    picture: &GreyWindow,
    camera: &Fisheye,
    resection: &NadirResection,
    layout: &Layout,
) -> Result<Rectified, RectifyError> {
    let [width, height] = camera.size_px().map(|side| side as usize);
    if (picture.width, picture.height) != (width, height) {
        let (width, height) = (picture.width, picture.height);
        return Err(RectifyError::PictureSize { width, height, camera: camera.size_px() });
    }
    let centre_m = resection.orientation.projection_centre_m;
    layout.check(centre_m.z)?;
    let gsd_m = layout.gsd_m;
    let ground_m = |x: i32, y: i32| layout.template_m(gsd_m * f64::from(x), -gsd_m * f64::from(y));
    let pixel = |x: i32, y: i32| camera.pixel_from_direction(resection.orientation.camera_coordinates(ground_m(x, y)));
    let covered = |x: i32, y: i32| {
        let ray = ground_m(x, y) - centre_m;
        ray.xy().norm().atan2(-ray.z) <= layout.largest_incidence_rad
            && pixel(x, y).is_some_and(|pixel| camera.contains(pixel))
    };
    let below = layout.east_north_m(centre_m.xy()) / gsd_m;
    let seed = [below.x.floor() as i32, (-below.y).floor() as i32];
    let most_cells = (layout.largest_side_m / gsd_m).min(f64::from(MOST_CELLS)) as i32;
    let no_ground = || RectifyError::NoGround { tilt_deg: resection.tilt_rad().to_degrees() };
    let cells = grown(seed, most_cells, covered).ok_or_else(no_ground)?;
    let (columns, rows) = (cells.columns.clone(), cells.rows.clone());
    if !(columns.start..=columns.end).contains(&0) || !(rows.start..=rows.end).contains(&0) {
        return Err(RectifyError::ReferenceOutside {
            x_m: layout.reference_m.x,
            y_m: layout.reference_m.y,
            west_m: gsd_m * f64::from(columns.start),
            east_m: gsd_m * f64::from(columns.end),
            south_m: -gsd_m * f64::from(rows.end),
            north_m: -gsd_m * f64::from(rows.start),
        });
    }
    let corners = [columns.start, columns.end].map(|x| [rows.start, rows.end].map(|y| ground_m(x, y))).concat();
    let sigma_m = |places: &[Vector3<f64>]| resection.sigma_ground_m(places).ok_or_else(no_ground);
    let sigma_corner_m = corners.iter().try_fold(0.0, |most, corner| sigma_m(&[*corner]).map(|s| s.max(most)))?;
    let sigma_shift_m = sigma_m(&spread_over(&corners))?;
    let scene = Scene {
        width: columns.len(),
        height: rows.len(),
        grey: resampled(picture, &cells, pixel),
        gsd_m,
        azimuth_of_image_up_rad: 0.0,
        sigma_azimuth_rad: layout.sigma_bearing_rad.hypot(resection.sigma_azimuth_rad()),
        reference_px: Vector2::new(f64::from(-columns.start), f64::from(-rows.start)),
    };
    Ok(Rectified { scene, sigma_shift_m, sigma_corner_m })
}

/// Places all over a parallelogram, given a corner and its two neighbours.
fn spread_over(corners: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    const PLACES: u32 = 5;
    let share = |k: u32| (f64::from(k) + 0.5) / f64::from(PLACES);
    let &[a, b, c, _] = corners else { return Vec::new() };
    (0..PLACES * PLACES).map(|k| a + (b - a) * share(k % PLACES) + (c - a) * share(k / PLACES)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Brown, ExteriorOrientation, Projection, rotation};
    use nalgebra::Matrix6;

    fn camera() -> Fisheye {
        Fisheye::new([900, 700], Projection::Equidistant, 400.0, Vector2::new(450.0, 350.0), Brown::default()).unwrap()
    }

    fn resection(tilt_rad: f64) -> NadirResection {
        NadirResection {
            orientation: ExteriorOrientation {
                projection_centre_m: Vector3::new(0.3, 0.2, 4.0),
                camera_from_object: rotation::camera_from_object(tilt_rad, 0.0, 0.8),
            },
            covariance: Matrix6::identity() * 1e-6,
            sigma0: 1.0,
            redundancy: 4,
            residuals_px: Vec::new(),
        }
    }

    fn layout() -> Layout {
        Layout {
            gsd_m: 0.05,
            plane_height_m: 0.0,
            largest_incidence_rad: 1.0,
            largest_side_m: f64::INFINITY,
            azimuth_of_y_rad: 0.5,
            sigma_bearing_rad: 0.03,
            reference_m: Vector2::new(0.1, -0.2),
        }
    }

    fn grey() -> GreyWindow {
        GreyWindow { origin_px: [0, 0], reduction: 1, width: 900, height: 700, grey: vec![90.0; 630_000] }
    }

    #[test]
    fn east_and_north_are_turned_by_the_azimuth_of_the_template() {
        let layout = Layout { azimuth_of_y_rad: std::f64::consts::FRAC_PI_2, ..layout() };
        // y points east, and so x south
        let along_y = layout.east_north_m(Vector2::new(0.1, 0.8));
        assert!((along_y - Vector2::new(1.0, 0.0)).norm() < 1e-12);
        let along_x = layout.east_north_m(Vector2::new(1.1, -0.2));
        assert!((along_x - Vector2::new(0.0, -1.0)).norm() < 1e-12);
        assert!((layout.template_m(1.0, 0.0) - Vector3::new(0.1, 0.8, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn the_scene_is_what_is_seen_at_less_than_the_largest_incidence() {
        let rectified = rectify(&grey(), &camera(), &resection(0.0), &layout()).unwrap();
        let scene = &rectified.scene;
        // 4 m tan(1 rad) = 6.23 m; the frame cuts the circle, and so the rectangle is no square of 8.8 m
        let (across_m, up_m) = (scene.width as f64 * 0.05, scene.height as f64 * 0.05);
        assert!(across_m.hypot(up_m) <= 2.0 * 6.24 && across_m * up_m > 55.0, "{across_m} x {up_m} m");
        assert!(scene.grey.iter().all(|grey| (grey - 90.0).abs() < 1e-3));
        assert!((scene.sigma_azimuth_rad - 0.03_f64.hypot(1e-3)).abs() < 1e-9);
        // a millimetre in the place and 4 m times 1 mrad in the tilt
        assert!((rectified.sigma_shift_m / 4.2e-3 - 1.0).abs() < 0.5, "{}", rectified.sigma_shift_m);
        assert!(rectified.sigma_corner_m > 2.0 * rectified.sigma_shift_m);
        // the point below the camera is where it was
        let below = layout().east_north_m(Vector2::new(0.3, 0.2));
        let middle = Vector2::new(scene.width as f64, scene.height as f64) / 2.0;
        assert!((scene.pixel_from_ground(below) - middle).norm() < 12.0);
        let small = Layout { largest_side_m: 2.0, ..layout() };
        let small = rectify(&grey(), &camera(), &resection(0.0), &small).unwrap().scene;
        assert_eq!((small.width, small.height), (40, 40));
    }

    #[test]
    fn what_cannot_be_rectified_is_refused_with_the_reason() {
        let refused = |layout: &Layout| rectify(&grey(), &camera(), &resection(0.0), layout).unwrap_err();
        let far = refused(&Layout { reference_m: Vector2::new(30.0, 0.0), ..layout() });
        assert!(far.to_string().contains("(30.00, 0.00)"), "{far}");
        for bad in [
            Layout { gsd_m: 0.0, ..layout() },
            Layout { plane_height_m: 4.0, ..layout() },
            Layout { largest_incidence_rad: 1.6, ..layout() },
            Layout { largest_side_m: f64::NAN, ..layout() },
            Layout { azimuth_of_y_rad: f64::NAN, ..layout() },
        ] {
            assert!(matches!(refused(&bad), RectifyError::Setting { .. }), "{bad:?}");
        }
        let other = GreyWindow { width: 700, height: 900, ..grey() };
        let error = rectify(&other, &camera(), &resection(0.0), &layout()).unwrap_err();
        assert_eq!(error.to_string(), "the picture has 700 x 900 px, but the camera 900 x 700 px");
        let aslant = rectify(&grey(), &camera(), &resection(1.4), &layout());
        assert!(matches!(aslant, Err(RectifyError::NoGround { .. })));
    }
}
