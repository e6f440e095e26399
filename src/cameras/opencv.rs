//! OpenCV: the camera matrix and the vector of distortion coefficients as `cv2.FileStorage` writes them.
//!
//! Its pixels are counted from the centre of the first one, so that half a pixel is added. The coefficients are k1, k2, p1,
//! p2, k3, then k4 to k6 of the denominator, s1 to s4 of the thin prism and the tilt of the sensor; the first five are the
//! contract's own.

use nalgebra::{Matrix3, Vector2};

use super::conversion::{Axis, Lens, convert};
use super::text::{Flat, number, pixels};
use super::{CameraFileError, Converted, Given, field};
use crate::geometry::Brown;

const MATRIX: [&str; 6] = ["cameramatrix", "k", "mtx", "intrinsicmatrix", "intrinsics", "cameramatrix1"];
const DISTORTION: [&str; 7] =
    ["distortioncoefficients", "distcoeffs", "distcoefs", "d", "dist", "distortion", "distcoeffs1"];

/// Whether a text is a calibration of this kind.
pub(super) fn is_one(text: &str) -> bool {
    let small = text.to_lowercase();
    small.contains("camera_matrix") || small.contains("cameramatrix") || small.contains("<opencv_storage>")
}

pub(super) fn read(given: &Given<'_>) -> Result<Converted, CameraFileError> {
    let flat = Flat::read(given.text)?;
    refuse_fisheye(&flat)?;
    let matrix = flat.matrix(&MATRIX)?.ok_or_else(|| field("camera_matrix", "it is missing; it has nine numbers"))?;
    let &[fx, skew, cx, zero, fy, cy, zero_x, zero_y, one] = matrix.as_slice() else {
        return Err(field("camera_matrix", format!("it has {} numbers, not nine", matrix.len())));
    };
    if [zero, zero_x, zero_y, one] != [0.0, 0.0, 0.0, 1.0] {
        return Err(field("camera_matrix", "it is not of the form fx s cx, 0 fy cy, 0 0 1"));
    }
    let told = match (flat.first(&["imagewidth", "width"]), flat.first(&["imageheight", "height"])) {
        (Some(width), Some(height)) => Some([
            pixels("image_width", number("image_width", width)?)?,
            pixels("image_height", number("image_height", height)?)?,
        ]),
        _ => match flat.matrix(&["imagesize", "imgshape", "resolution"])?.as_deref() {
            Some(&[width, height]) => Some([pixels("image_size", width)?, pixels("image_size", height)?]),
            _ => None,
        },
    };
    let size_px = given.size_px(told)?;
    let axis = Axis {
        principal_distance_px: fy,
        principal_point_px: Vector2::new(cx + 0.5, cy + 0.5),
        b1_px: fx - fy,
        b2_px: skew,
    };
    let coefficients = flat.matrix(&DISTORTION)?.unwrap_or_default();
    let conversion = convert(size_px, &axis, &lens(&coefficients)?)?;
    let name = flat.first(&["cameraname", "name"]).map(str::to_owned);
    Ok(Converted { name, conversion, warnings: Vec::new() })
}

fn refuse_fisheye(flat: &Flat) -> Result<(), CameraFileError> {
    let model = flat.first(&["distortionmodel", "cameramodel", "model"]).unwrap_or_default().to_lowercase();
    let fisheye = flat.first(&["fisheyemodel"]).is_some_and(|flag| !matches!(flag, "0" | "false" | "False"));
    if fisheye || ["fisheye", "equidistant", "kannala"].iter().any(|name| model.contains(name)) {
        let detail = "a fish-eye lens does not follow Brown's polynomial of the ideal radius".to_owned();
        return Err(CameraFileError::Model { model: "fisheye".into(), detail });
    }
    Ok(())
}

/// The lens of a vector of coefficients, as `cv2.projectPoints` reads it.
pub(super) fn lens(coefficients: &[f64]) -> Result<Lens, CameraFileError> {
    if ![0, 4, 5, 8, 12, 14].contains(&coefficients.len()) {
        let detail = format!("there are {}; OpenCV has 4, 5, 8, 12 or 14", coefficients.len());
        return Err(field("distortion_coefficients", detail));
    }
    let mut all = [0.0; 14];
    all[..coefficients.len()].copy_from_slice(coefficients);
    let [k1, k2, p1, p2, k3, ref rest @ ..] = all;
    if rest.iter().all(|value| *value == 0.0) {
        return Ok(Lens::Brown(Brown { k1, k2, k3, p1, p2, b1_px: 0.0, b2_px: 0.0 }));
    }
    Ok(Lens::Bent(Box::new(move |ideal| bent(&all, ideal))))
}

fn bent(
    &[k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tilt_x, tilt_y]: &[f64; 14],
    ideal: Vector2<f64>,
) -> Vector2<f64> {
    let (x, y, r2) = (ideal.x, ideal.y, ideal.norm_squared());
    let radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)));
    let bent = Vector2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4),
    );
    if tilt_x == 0.0 && tilt_y == 0.0 { bent } else { tilted([tilt_x, tilt_y], bent) }
}

/// On a sensor that is tilted against the lens (Scheimpflug).
fn tilted([tilt_x, tilt_y]: [f64; 2], bent: Vector2<f64>) -> Vector2<f64> {
    let ((sin_x, cos_x), (sin_y, cos_y)) = (tilt_x.sin_cos(), tilt_y.sin_cos());
    let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, cos_x, sin_x, 0.0, -sin_x, cos_x);
    let about_y = Matrix3::new(cos_y, 0.0, -sin_y, 0.0, 1.0, 0.0, sin_y, 0.0, cos_y);
    let r = about_y * about_x;
    let onto = Matrix3::new(r.m33, 0.0, -r.m13, 0.0, r.m33, -r.m23, 0.0, 0.0, 1.0);
    let on_sensor = onto * r * bent.push(1.0);
    on_sensor.xy() / on_sensor.z
}
