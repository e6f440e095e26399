//! The manifest: of every photograph the matrix, the angles, their convention, and five check points with their pixels in
//! every convention that the formats have. Whoever reads an export in software unknown to us projects these points and
//! sees whether all is well.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector2};
use serde_json::{Value, json};

use super::interior::Corrections;
use super::local::{json_file, opencv_pose, shared_frame};
use super::{ExportError, File, GridOrientation, Photograph, Rational, Target};
use crate::geometry::{LocalFrame, rotation};

/// Where in the frame the check points are, and at which of the lowest, the mean and the highest ground: they must not
/// lie in a plane.
const CHECK_POINTS: [(f64, f64, usize); 5] =
    [(0.1, 0.1, 0), (0.9, 0.1, 2), (0.5, 0.5, 1), (0.1, 0.9, 2), (0.9, 0.9, 0)];

pub(super) fn write(photographs: &[Photograph], target: &Target) -> Result<File, ExportError> {
    let frame = shared_frame(photographs)?;
    let of_one = |photograph: &Photograph| described(photograph, target, &frame);
    let photographs = photographs.iter().map(of_one).collect::<Result<Vec<_>, ExportError>>()?;
    let manifest = json!({
        "made_by": concat!("gable ", env!("CARGO_PKG_VERSION")),
        "conventions": {
            "rotation_matrix": "object to camera, rows; camera x right, y up, z backwards",
            "angles": "rotation_matrix = (Rx(omega) Ry(phi) Rz(kappa)) transposed, degrees",
            "opencv": "camera = rotation_matrix * object + translation_m, camera x right, y down, z forward",
            "pixel_px": "x right, y down, the corner of the top-left pixel is (0, 0), its centre (0.5, 0.5)",
            "pixel_from_centre_px": "the same with the centre of the top-left pixel at (0, 0)",
            "curvature": "local: rigorous; grid: fitted to the ground, the grid taken for a Cartesian frame",
            "heights": "above the ellipsoid; in grid_crs above what it names, or ellipsoidal height - grid_geoid_undulation_m",
            "sigma": "standard deviations along and about the axes of its own frame, those of the result",
            "photogrammetric_corrections": "x + x (K0 + K1 r2 + K2 r4 + K3 r6) + P1 (r2 + 2 x2) + 2 P2 x y in mm about the \
                principal point, y up, added to measured coordinates (pixel_mm: width and height of a pixel); the cameras table of ArcGIS has them so, the project of Inpho with the \
                other sign, as distortion; neither was tried with their software: compare the check points",
        },
        "grid_crs": target.crs.to_string(),
        "grid_geoid_undulation_m": target.geoid_undulation_m,
        "local_frame": frame.proj_string(),
        "photographs": photographs,
    });
    Ok(json_file("manifest.json", &manifest))
}

fn described(photograph: &Photograph, target: &Target, frame: &LocalFrame) -> Result<Value, ExportError> {
    let grid = GridOrientation::fitted(photograph, target)?;
    let rational = Rational::fitted(photograph)?;
    let local = photograph.in_frame(frame);
    let (opencv, translation) = opencv_pose(photograph, frame);
    let quaternion = UnitQuaternion::from_rotation_matrix(&opencv);
    let heights_m = photograph.heights_m();
    let check_points = CHECK_POINTS
        .iter()
        .map(|(across, down, height)| {
            let pixel = photograph.camera.frame_px(*across, *down);
            check_point(photograph, target, frame, (&grid, &rational), (pixel, heights_m[*height]))
        })
        .collect::<Result<Vec<_>, ExportError>>()?;
    Ok(json!({
        "name": photograph.name,
        "camera": interior(photograph)?,
        "ground_height_m": photograph.ground_height_m,
        "relief_m": photograph.relief_m,
        "verdict": photograph.judgement.verdict,
        "review": photograph.judgement.review,
        "sigma": photograph.sigma,
        "local": {
            "projection_centre_m": local.projection_centre_m.as_slice(),
            "rotation_matrix": rows(&local.camera_from_object),
            "omega_phi_kappa_deg": rotation::angles(&local.camera_from_object).map(f64::to_degrees),
            "opencv": {
                "rotation_matrix": rows(&opencv), "translation_m": translation.as_slice(),
                "quaternion_wxyz": [quaternion.w, quaternion.i, quaternion.j, quaternion.k],
            },
        },
        "grid": {
            "projection_centre_m": grid.centre_m,
            "rotation_matrix": rows(&grid.camera_from_grid),
            "omega_phi_kappa_deg": grid.angles_deg(),
            "residual_rms_px": grid.residual_rms_px,
            "residual_max_px": grid.residual_max_px,
            "residual_max_m": grid.residual_max_m,
        },
        "rpc": {"residual_rms_px": rational.residual_rms_px, "residual_max_px": rational.residual_max_px},
        "check_points": check_points,
    }))
}

fn interior(photograph: &Photograph) -> Result<Value, ExportError> {
    let camera = &photograph.camera;
    let mut described = json!({
        "name": photograph.camera_name,
        "image_size_px": [camera.width_px, camera.height_px],
        "principal_distance_px": camera.principal_distance_px,
        "principal_point_px": camera.principal_point_px().as_slice(),
        "pixel_size_mm": photograph.pixel_size_mm,
        "film": photograph.is_film(),
    });
    if let Some(d) = camera.distortion() {
        let corrections = Corrections::fitted(photograph)?;
        described["distortion"] = json!({
            "model": "brown", "k1": d.k1, "k2": d.k2, "k3": d.k3, "p1": d.p1, "p2": d.p2, "b1_px": d.b1_px, "b2_px": d.b2_px,
        });
        described["photogrammetric_corrections"] = json!({
            "pixel_mm": corrections.pixel_mm, "k0_to_k3": corrections.radial, "p1_p2": corrections.tangential,
            "residual_max_px": corrections.residual_max_px,
        });
    }
    Ok(described)
}

fn check_point(
    photograph: &Photograph,
    target: &Target,
    frame: &LocalFrame,
    (grid, rational): (&GridOrientation, &Rational),
    (pixel, height_m): (Vector2<f64>, f64),
) -> Result<Value, ExportError> {
    let ground_m = photograph.ground_geocentric_m(pixel, height_m)?;
    let geodetic = Photograph::geodetic(ground_m)?;
    let position = target.position(ground_m)?;
    let by_grid = grid.pixel(photograph, position).ok_or(ExportError::NoFit)?;
    let by_rational = rational.pixel(geodetic);
    Ok(json!({
        "longitude_latitude_height": geodetic,
        "grid_m": position,
        "local_m": frame.from_geocentric(ground_m).as_slice(),
        "pixel_px": [pixel.x, pixel.y],
        "pixel_from_centre_px": [pixel.x - 0.5, pixel.y - 0.5],
        "by_grid_px": by_grid.as_slice(),
        "by_rpc_px": by_rational.as_slice(),
    }))
}

fn rows(rotation: &Rotation3<f64>) -> [[f64; 3]; 3] {
    let m: &Matrix3<f64> = rotation.matrix();
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)]))
}
