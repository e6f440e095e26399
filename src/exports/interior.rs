//! The interior orientation as other software writes it.

use nalgebra::{Matrix6, Vector2, Vector6};

use super::photograph::SHARES;
use super::{ExportError, Format, Photograph};
use crate::geometry::Brown;

/// A shear that moves no pixel by more than this is none.
const NO_SHEAR_PX: f64 = 0.01;
/// What polynomials may lose of a lens, where other formats have the lens itself.
const MOST_RESIDUAL_PX: f64 = 1.0;

/// A camera of OpenCV and its relatives: distortion bends ideal coordinates, with y down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OpenCv {
    /// Principal distance in x and in y.
    pub(super) focal_px: [f64; 2],
    /// From the corner of the top-left pixel.
    pub(super) principal_point_px: [f64; 2],
    /// Without the affine terms.
    pub(super) distortion: Brown,
}

impl OpenCv {
    /// # Errors
    /// [`ExportError::Camera`] for a scan of film and for sheared pixels.
    pub(super) fn of(photograph: &Photograph, format: Format) -> Result<Self, ExportError> {
        let camera = &photograph.camera;
        let refuse =
            |why: String| ExportError::Camera { format: format.name(), camera: photograph.camera_name.clone(), why };
        let Some(distortion) = camera.distortion() else { return Err(Self::no_film(photograph, format)) };
        let shear_px = distortion.b2_px.abs() * camera.frame_radius_px() / camera.principal_distance_px;
        if shear_px > NO_SHEAR_PX {
            return Err(refuse(format!(
                "its pixels are sheared by up to {shear_px:.2} px (b2_px), for which the format has no place; rpc, and \
                 micmac where the lens distorts little, describe it"
            )));
        }
        Ok(Self {
            focal_px: [camera.principal_distance_px + distortion.b1_px, camera.principal_distance_px],
            principal_point_px: camera.principal_point_px().into(),
            distortion: Brown { b1_px: 0.0, b2_px: 0.0, ..*distortion },
        })
    }

    /// Why a scan of film is not exported.
    pub(super) fn no_film(photograph: &Photograph, format: Format) -> ExportError {
        let why = "the image is a scan of film, which lies in the scanner as it likes; rpc, opk_csv, patb, bingo and \
                   applanix describe it";
        ExportError::Camera { format: format.name(), camera: photograph.camera_name.clone(), why: why.to_owned() }
    }

    /// The principal point from the middle of the image in units of the larger side, as OpenSfM has it.
    pub(super) fn normalized_offset(&self, photograph: &Photograph) -> [f64; 2] {
        let (width, height) = (f64::from(photograph.camera.width_px), f64::from(photograph.camera.height_px));
        let [x, y] = self.principal_point_px;
        [(x - width / 2.0) / width.max(height), (y - height / 2.0) / width.max(height)]
    }
}

/// Distortion as photogrammetry writes it: corrections to measured plate coordinates in millimetres about the principal
/// point, y up (method 4.3): x_corrected = x + x (K0 + K1 r² + K2 r⁴ + K3 r⁶) + P1 (r² + 2x²) + 2 P2 xy, and y alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Corrections {
    /// Width and height of a pixel: where they differ, that is the affine transformation's, which no polynomial of a lens
    /// could replace.
    pub(super) pixel_mm: [f64; 2],
    /// K0 to K3.
    pub(super) radial: [f64; 4],
    /// P1 and P2.
    pub(super) tangential: [f64; 2],
    /// What remains of the conversion at the worst point.
    pub(super) residual_max_px: f64,
}

impl Corrections {
    /// The corrections for a format.
    ///
    /// # Errors
    /// [`ExportError::Camera`] where the format has no place for the camera, or the corrections lose more of it than
    /// [`MOST_RESIDUAL_PX`].
    pub(super) fn of(photograph: &Photograph, format: Format) -> Result<Self, ExportError> {
        OpenCv::of(photograph, format)?;
        let fitted = Self::fitted(photograph)?;
        if fitted.residual_max_px > MOST_RESIDUAL_PX {
            let why = format!(
                "its lens bends more than the format's polynomials can: {:.1} px would be lost; orthority, colmap and \
                 opensfm describe it",
                fitted.residual_max_px
            );
            return Err(ExportError::Camera { format: format.name(), camera: photograph.camera_name.clone(), why });
        }
        Ok(fitted)
    }

    /// Fits the corrections to the camera over its frame. Its sign and direction being others than those of the
    /// contract's distortion, this is never done by formula.
    ///
    /// # Errors
    /// [`ExportError::NoFit`] if the frame has no extent.
    pub(super) fn fitted(photograph: &Photograph) -> Result<Self, ExportError> {
        let camera = &photograph.camera;
        let principal_px = camera.principal_point_px();
        let (mm, c_px) = (photograph.pixel_size_mm, camera.principal_distance_px);
        let b1_px = camera.distortion().map_or(0.0, |distortion| distortion.b1_px);
        let pixel_mm = [mm * c_px / (c_px + b1_px), mm];
        let (mut normal, mut right, mut observed) = (Matrix6::zeros(), Vector6::zeros(), Vec::new());
        // powers of the radius are taken in units of the frame, or the normal equations could not be solved
        let unit_mm = camera.frame_radius_px() * mm;
        for (across, down) in SHARES.iter().flat_map(|across| SHARES.map(|down| (*across, down))) {
            let pixel = camera.frame_px(across, down);
            let reduced = camera.reduced_from_pixel(pixel).ok_or(ExportError::NoFit)?;
            let measured = plate_mm(pixel - principal_px, pixel_mm);
            let missing = plate_mm(reduced, [mm; 2]) - measured;
            let (x, y) = (measured.x / unit_mm, measured.y / unit_mm);
            let r2 = x * x + y * y;
            let rows = [
                Vector6::new(x, x * r2, x * r2.powi(2), x * r2.powi(3), r2 + 2.0 * x * x, 2.0 * x * y),
                Vector6::new(y, y * r2, y * r2.powi(2), y * r2.powi(3), 2.0 * x * y, r2 + 2.0 * y * y),
            ];
            for (row, value) in rows.into_iter().zip([missing.x, missing.y]) {
                normal += row * row.transpose();
                right += row * value;
                observed.push((row, value));
            }
        }
        let solution = normal.cholesky().ok_or(ExportError::NoFit)?.solve(&right);
        let worst_mm = observed.iter().map(|(row, value)| (row.dot(&solution) - value).abs()).fold(0.0, f64::max);
        let by_unit = |index: usize, power: i32| solution[index] / unit_mm.powi(power);
        Ok(Self {
            pixel_mm,
            radial: [by_unit(0, 1), by_unit(1, 3), by_unit(2, 5), by_unit(3, 7)],
            tangential: [by_unit(4, 2), by_unit(5, 2)],
            residual_max_px: worst_mm / mm,
        })
    }
}

/// From pixels with y down to millimetres with y up.
fn plate_mm(px: Vector2<f64>, [width_mm, height_mm]: [f64; 2]) -> Vector2<f64> {
    Vector2::new(px.x * width_mm, -px.y * height_mm)
}
