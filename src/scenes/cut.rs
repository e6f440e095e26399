//! A control scene out of an ortho-photo: a piece about a point with known height.
//!
//! An ortho-photo lies in a map grid, whose north is not true north and whose metre is not quite one; the scene's
//! azimuth and scale are those of the ground.

use nalgebra::{Matrix2, Matrix2x3, Vector2};

use super::Scene;
use super::resample::{grown, resampled};
use crate::features::{Picture, PictureError, PixelRect};
use crate::geometry::{Crs, CrsError, LocalFrame};

/// An ortho-photo in its system.
#[derive(Debug, Clone, Copy)]
pub struct Ortho<'a, P: Picture + ?Sized> {
    /// The picture.
    pub picture: &'a P,
    /// The affine map of pixels (x right, y down, 1; from the corner of the top-left pixel) to grid east and north, or
    /// longitude and latitude.
    pub ground_from_pixel: Matrix2x3<f64>,
    /// The system.
    pub crs: &'a Crs,
}

/// Why no scene can be cut.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CutError {
    /// The reference has no place on Earth.
    #[error(transparent)]
    Crs(#[from] CrsError),
    /// The world file maps all pixels to a line.
    #[error("the georeference is degenerate: it gives a pixel no area")]
    Degenerate,
    /// The point is not in the ortho-photo.
    #[error("the point has the pixel ({x:.1}, {y:.1}), outside of the ortho-photo of {width} x {height} px")]
    Outside {
        /// Column.
        x: f64,
        /// Row.
        y: f64,
        /// Columns of the ortho-photo.
        width: u32,
        /// Rows of the ortho-photo.
        height: u32,
    },
    /// Nothing could be found with so few pixels.
    #[error(
        "a scene of {width} x {height} px is too small: make it larger, or take an ortho-photo of finer resolution"
    )]
    TooSmall {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// A side that makes no sense, or is larger than any scene.
    #[error("the side of {size_m} m would be {pixels:.0} px: at most {MOST_PIXELS} are cut")]
    TooLarge {
        /// What was asked for.
        size_m: f64,
        /// In pixels of the ortho-photo.
        pixels: f64,
    },
    /// The file is damaged.
    #[error("{0}")]
    Picture(#[from] PictureError),
}

const MOST_PIXELS: u32 = 4000;
const FEWEST_PIXELS: usize = 16;
/// Pixels that are less square than this (as a share of their size), askew or mirrored are laid out anew.
const SQUARE: f64 = 1e-3;

/// A square of about `size_m` a side about the reference `[east or longitude, north or latitude, ellipsoidal height]`,
/// less where the ortho-photo ends. Where its pixels are square on the ground it is cut out as it is, turned with the
/// ortho-photo if that is turned; else it is resampled with north up.
///
/// # Errors
/// [`CutError`] if the reference is not in the ortho-photo, or little would be left.
pub fn cut<P: Picture + ?Sized>(
    ortho: &Ortho<'_, P>,
    reference: [f64; 3],
    size_m: f64,
    sigma_azimuth_rad: f64,
) -> Result<Scene, CutError> {
    let linear: Matrix2<f64> = ortho.ground_from_pixel.fixed_columns::<2>(0).into_owned();
    let inverse = linear.try_inverse().filter(|m| m.iter().all(|v| v.is_finite())).ok_or(CutError::Degenerate)?;
    let [east, north, _] = reference;
    let reference_px = inverse * (Vector2::new(east, north) - ortho.ground_from_pixel.column(2));
    let [width, height] = ortho.picture.size_px();
    let inside = |v: f64, size: u32| (0.0..=f64::from(size)).contains(&v);
    let geocentric_m = ortho.crs.geocentric_from_position(reference, None)?;
    if !(inside(reference_px.x, width) && inside(reference_px.y, height)) {
        return Err(CutError::Outside { x: reference_px.x, y: reference_px.y, width, height });
    }
    let frame = LocalFrame::about(geocentric_m);
    let local_m = |pixel: Vector2<f64>| -> Result<Vector2<f64>, CutError> {
        let ground = linear * pixel + ortho.ground_from_pixel.column(2);
        let there = ortho.crs.geocentric_from_position([ground.x, ground.y, reference[2]], None)?;
        Ok(frame.from_geocentric(there).xy())
    };
    // over some pixels: next to one a coordinate's last digits would show in the azimuth
    let step = |axis: usize| Vector2::ith(axis, STEP_PX);
    let along = |axis: usize| -> Result<Vector2<f64>, CutError> {
        Ok((local_m(reference_px + step(axis))? - local_m(reference_px - step(axis))?) / (2.0 * STEP_PX))
    };
    let local_by_pixel = Matrix2::from_columns(&[along(0)?, along(1)?]);
    let lie = Lie::of(&local_by_pixel);
    let half_px = size_m / lie.gsd_m / 2.0;
    if !(half_px > 0.0 && half_px <= f64::from(MOST_PIXELS) / 2.0) {
        return Err(CutError::TooLarge { size_m, pixels: 2.0 * half_px });
    }
    let scene = if lie.off_square < SQUARE {
        cropped(ortho.picture, reference_px, half_px, &lie)?
    } else {
        let pixel_by_local = local_by_pixel.try_inverse().ok_or(CutError::Degenerate)?;
        laid_out(ortho.picture, reference_px, half_px, lie.gsd_m, &pixel_by_local)?
    };
    if scene.width.min(scene.height) < FEWEST_PIXELS {
        return Err(CutError::TooSmall { width: scene.width, height: scene.height });
    }
    Ok(Scene { sigma_azimuth_rad, ..scene })
}

const STEP_PX: f64 = 20.0;

/// How pixels lie on the ground.
struct Lie {
    gsd_m: f64,
    azimuth_of_up_rad: f64,
    off_square: f64,
}

impl Lie {
    /// The similarity next to how places (east, north) change with pixels, and what is left.
    fn of(local_by_pixel: &Matrix2<f64>) -> Self {
        // [[a, -b], [-b, -a]]: to the right (a, -b), down (-b, -a)
        let m = local_by_pixel;
        let (a, b) = ((m[(0, 0)] - m[(1, 1)]) / 2.0, -(m[(0, 1)] + m[(1, 0)]) / 2.0);
        let rest = ((m[(0, 0)] + m[(1, 1)]) / 2.0).hypot((m[(1, 0)] - m[(0, 1)]) / 2.0);
        let off_square = rest / a.hypot(b);
        // of pixels that are not square the mean
        let gsd_m = m.determinant().abs().sqrt();
        Self { gsd_m, azimuth_of_up_rad: b.atan2(a), off_square: if off_square.is_finite() { off_square } else { 1.0 } }
    }
}

fn window_about<P: Picture + ?Sized>(
    picture: &P,
    centre_px: Vector2<f64>,
    half_px: Vector2<f64>,
) -> Result<crate::features::GreyWindow, PictureError> {
    let side = |centre: f64, half: f64, size: u32| {
        let from = (centre - half).floor().max(0.0);
        let to = (centre + half).ceil().min(f64::from(size));
        (from as u32, (to - from).max(0.0) as u32)
    };
    let [width, height] = picture.size_px();
    let ((x, width), (y, height)) = (side(centre_px.x, half_px.x, width), side(centre_px.y, half_px.y, height));
    picture.window(PixelRect { x, y, width, height }, 1)
}

fn cropped<P: Picture + ?Sized>(
    picture: &P,
    reference_px: Vector2<f64>,
    half_px: f64,
    lie: &Lie,
) -> Result<Scene, CutError> {
    let window = window_about(picture, reference_px, Vector2::repeat(half_px))?;
    Ok(Scene {
        width: window.width,
        height: window.height,
        gsd_m: lie.gsd_m,
        azimuth_of_image_up_rad: lie.azimuth_of_up_rad,
        sigma_azimuth_rad: 0.0,
        reference_px: reference_px - Vector2::from(window.origin_px.map(f64::from)),
        grey: window.grey,
    })
}

fn laid_out<P: Picture + ?Sized>(
    picture: &P,
    reference_px: Vector2<f64>,
    half_cells: f64,
    gsd_m: f64,
    pixel_by_local: &Matrix2<f64>,
) -> Result<Scene, CutError> {
    let pixel = |x: i32, y: i32| reference_px + pixel_by_local * Vector2::new(f64::from(x), f64::from(-y)) * gsd_m;
    let half_px = pixel_by_local.abs() * Vector2::repeat(half_cells * gsd_m) + Vector2::repeat(2.0);
    let [width, height] = picture.size_px().map(f64::from);
    let covered = |x: i32, y: i32| {
        let pixel = pixel(x, y);
        (0.0..=width).contains(&pixel.x) && (0.0..=height).contains(&pixel.y)
    };
    let side = (2.0 * half_cells).round() as i32;
    // the reference may lie at the rim: any of the four cells about it will do
    let seeds = [[0, 0], [-1, 0], [0, -1], [-1, -1]];
    let cells = seeds.into_iter().find_map(|seed| grown(seed, side, covered));
    let cells = cells.ok_or(CutError::TooSmall { width: 0, height: 0 })?;
    let window = window_about(picture, reference_px, half_px)?;
    let grey = resampled(&window, &cells, |x, y| Some(pixel(x, y)));
    Ok(Scene {
        width: cells.columns.len(),
        height: cells.rows.len(),
        grey,
        gsd_m,
        azimuth_of_image_up_rad: 0.0,
        sigma_azimuth_rad: 0.0,
        reference_px: Vector2::new(f64::from(-cells.columns.start), f64::from(-cells.rows.start)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::GreyWindow;

    /// Its grey is a sum of column and row.
    struct Ramp([u32; 2]);

    impl Picture for Ramp {
        fn size_px(&self) -> [u32; 2] {
            self.0
        }

        fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
            let rows = rect.y..rect.y + rect.height;
            let grey = rows.flat_map(|y| (rect.x..rect.x + rect.width).map(move |x| (x + 2 * y) as f32)).collect();
            let (width, height) = (rect.width as usize, rect.height as usize);
            Ok(GreyWindow { origin_px: [rect.x, rect.y], reduction, width, height, grey })
        }
    }

    const REFERENCE: [f64; 3] = [565_012.3, 5_934_410.7, 45.0];

    /// A world file turned clockwise by an angle, whose pixel (100, 80) is the reference.
    fn turned(gsd: f64, angle_rad: f64) -> Matrix2x3<f64> {
        let (sin, cos) = angle_rad.sin_cos();
        let linear = Matrix2::new(cos, -sin, -sin, -cos) * gsd;
        let shift = Vector2::new(REFERENCE[0], REFERENCE[1]) - linear * Vector2::new(100.0, 80.0);
        Matrix2x3::from_columns(&[linear.column(0).into_owned(), linear.column(1).into_owned(), shift])
    }

    fn cut_from(ground_from_pixel: Matrix2x3<f64>, crs: &str, at: [f64; 3], size_m: f64) -> Result<Scene, CutError> {
        let crs = Crs::parse(crs).unwrap();
        cut(&Ortho { picture: &Ramp([300, 200]), ground_from_pixel, crs: &crs }, at, size_m, 0.01)
    }

    #[test]
    fn azimuth_and_scale_are_those_of_the_ground_not_of_the_grid() {
        let scene = cut_from(turned(0.1, 0.0), "EPSG:25832", REFERENCE, 10.0).unwrap();
        assert!(scene.width.abs_diff(100) < 2 && scene.height.abs_diff(100) < 2);
        assert!((scene.reference_px - Vector2::new(50.0, 50.0)).norm() < 1.1);
        // pyproj 3.7.2 (PROJ 9.5.1), Proj(25832).get_factors there: meridian_convergence and meridional_scale; east of
        // the central meridian grid north lies east of true north
        let (convergence_deg, scale) = (0.789_464_958, 0.999_651_868);
        let azimuth_deg = scene.azimuth_of_image_up_rad.to_degrees();
        assert!((azimuth_deg - convergence_deg).abs() < 1e-4, "{azimuth_deg}");
        // a grid metre is more than one of the ellipsoid, and still more at a height of 45 m
        assert!((scene.gsd_m - 0.1 / scale * (1.0 + 45.0 / 6.38e6)).abs() < 1e-8, "{}", scene.gsd_m);
        assert_eq!(scene.sigma_azimuth_rad, 0.01);
    }

    #[test]
    fn a_turned_ortho_photo_gives_a_turned_scene_whose_places_are_right() {
        for angle_deg in [30.0, -120.0, 180.0] {
            let world = turned(0.1, f64::to_radians(angle_deg));
            let scene = cut_from(world, "EPSG:25832", REFERENCE, 10.0).unwrap();
            let turn = (scene.azimuth_of_image_up_rad.to_degrees() - angle_deg - 0.79).rem_euclid(360.0);
            assert!(turn.min(360.0 - turn) < 0.02, "{turn}");
            let window_origin = Vector2::new(100.0, 80.0) - scene.reference_px;
            let pixel = Vector2::new(130.0, 95.0);
            let grid = world * pixel.push(1.0);
            let crs = Crs::parse("EPSG:25832").unwrap();
            let here = crs.geocentric_from_position(REFERENCE, None).unwrap();
            let there = crs.geocentric_from_position([grid.x, grid.y, 45.0], None).unwrap();
            let expected = LocalFrame::about(here).from_geocentric(there).xy();
            assert!((scene.ground_from_pixel_m(pixel - window_origin) - expected).norm() < 1e-4);
        }
    }

    #[test]
    fn pixels_that_are_not_square_on_the_ground_are_laid_out_north_up() {
        // 1e-6 degrees: 0.066 m by 0.111 m at 53.5 degrees north
        let world = Matrix2x3::new(1e-6, 0.0, 10.0 - 100e-6, 0.0, -1e-6, 53.5 + 80e-6);
        let scene = cut_from(world, "EPSG:4979", [10.0, 53.5, 45.0], 8.0).unwrap();
        assert_eq!(scene.azimuth_of_image_up_rad, 0.0);
        assert!((scene.gsd_m - (0.0664_f64 * 0.1113).sqrt()).abs() < 1e-3, "{}", scene.gsd_m);
        // three metres east are 45 columns, and the grey is that of the ramp there
        let pixel = scene.pixel_from_ground(Vector2::new(3.0, 0.0));
        let at = pixel.y.floor() as usize * scene.width + pixel.x.floor() as usize;
        let middle = scene.ground_from_pixel_m(pixel.map(|v| v.floor() + 0.5));
        let expected = (100.0 + middle.x / 0.0664 - 0.5) + 2.0 * (80.0 - middle.y / 0.1113 - 0.5);
        assert!((f64::from(scene.grey[at]) - expected).abs() < 0.5, "{} {expected}", scene.grey[at]);
    }

    #[test]
    fn what_cannot_be_cut_is_refused_with_the_reason() {
        let refused = |world, at, size| cut_from(world, "EPSG:25832", at, size).unwrap_err();
        let [e, n, h] = REFERENCE;
        assert!(matches!(refused(turned(0.1, 0.0), [e + 50.0, n, h], 10.0), CutError::Outside { .. }));
        assert!(matches!(refused(turned(0.1, 0.0), REFERENCE, 0.5), CutError::TooSmall { .. }));
        assert!(matches!(refused(turned(0.1, 0.0), REFERENCE, f64::NAN), CutError::TooLarge { .. }));
        assert!(matches!(refused(turned(0.1, 0.0), REFERENCE, 1e4), CutError::TooLarge { .. }));
        assert!(matches!(refused(turned(0.0, 0.0), REFERENCE, 10.0), CutError::Degenerate));
        assert!(matches!(refused(turned(0.1, 0.0), [e, f64::NAN, h], 10.0), CutError::Crs(_)));
    }
}
