//! Text files with a line or a few for each photograph: orientations in a map grid.

use std::fmt::Write as _;

use super::names::word;
use super::{ExportError, File, Photograph, Target, in_grid};

const TEXT: &str = "text/plain; charset=utf-8";
const GON_PER_DEGREE: f64 = 10.0 / 9.0;

/// `filename,x,y,z,omega,phi,kappa,camera` in metres and degrees, with the CRS in a `.prj` beside it.
pub(super) fn opk_csv(photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    let mut text = String::from("filename,x,y,z,omega,phi,kappa,camera\n");
    for (photograph, grid) in in_grid(photographs, target)? {
        let ([x, y, z], [omega, phi, kappa]) = (grid.centre_m, grid.angles_deg());
        let (name, camera) = (quoted(&photograph.name), quoted(&photograph.camera_name));
        let _ = writeln!(text, "{name},{x:.4},{y:.4},{z:.4},{omega:.8},{phi:.8},{kappa:.8},{camera}");
    }
    Ok(vec![
        File { name: "orientations.csv".into(), media_type: "text/csv; charset=utf-8", text },
        File { name: "orientations.prj".into(), media_type: TEXT, text: target.crs.to_string() },
    ])
}

/// A field of a CSV (RFC 4180).
pub(super) fn quoted(field: &str) -> String {
    match field.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", field.replace('"', "\"\"")),
        false => field.to_owned(),
    }
}

/// PATB: the name, the principal distance in millimetres and the projection centre, then the rotation from the camera to
/// the grid by rows.
pub(super) fn patb(photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    let mut text = String::new();
    for (photograph, grid) in in_grid(photographs, target)? {
        let [x, y, z] = grid.centre_m;
        let c_mm = photograph.principal_distance_mm();
        let _ = writeln!(text, "{} {c_mm:.6} {x:.4} {y:.4} {z:.4}", word(&photograph.name));
        let grid_from_camera = grid.camera_from_grid.inverse();
        for row in grid_from_camera.matrix().row_iter() {
            let _ = writeln!(text, "  {:.12} {:.12} {:.12}", row[0], row[1], row[2]);
        }
    }
    Ok(vec![File { name: "orientations.ori".into(), media_type: TEXT, text }])
}

/// BINGO: a record ORIA for each photograph, `phi omega kappa` in gon for its own order of rotations,
/// R = R_y(phi) R_x(omega) R_z(kappa).
pub(super) fn bingo(photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    let mut text = String::new();
    for (photograph, grid) in in_grid(photographs, target)? {
        let ([x, y, z], name) = (grid.centre_m, word(&photograph.name));
        let [phi, omega, kappa] = phi_omega_kappa_rad(&grid).map(|angle| angle.to_degrees() * GON_PER_DEGREE);
        let _ = writeln!(text, "ORIA {name} {x:.4} {y:.4} {z:.4} {phi:.8} {omega:.8} {kappa:.8}");
    }
    Ok(vec![File { name: "orientations.bingo".into(), media_type: TEXT, text }])
}

/// phi, omega, kappa with R_img->obj = R_y(phi) R_x(omega) R_z(kappa) (method 4.1).
fn phi_omega_kappa_rad(grid: &super::GridOrientation) -> [f64; 3] {
    let r = grid.camera_from_grid.matrix().transpose();
    [r[(0, 2)].atan2(r[(2, 2)]), (-r[(1, 2)]).clamp(-1.0, 1.0).asin(), r[(1, 0)].atan2(r[(1, 1)])]
}

/// Exterior orientations as Applanix' POSEO writes them: a head that says what the angles are, then a line for each.
pub(super) fn applanix(photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    let mut text = format!(
        "# Exterior orientations by Gable\n# Grid: {}\n# Datum: WGS84, ellipsoid heights unless the grid says otherwise\n\
         # Boresight: none, the angles are those of the camera\n# Meridian convergence: applied, axes are grid east, grid \
         north, up\n# R(camera to grid) = Rx(omega) Ry(phi) Rz(kappa), degrees; camera x right, y up, z backwards\n\
         # ID\tTIME\tEASTING\tNORTHING\tHEIGHT\tOMEGA\tPHI\tKAPPA\tLAT\tLONG\n",
        target.crs
    );
    for (photograph, grid) in in_grid(photographs, target)? {
        let ([x, y, z], [omega, phi, kappa]) = (grid.centre_m, grid.angles_deg());
        let [longitude, latitude, _] = Photograph::geodetic(photograph.centre_geocentric_m)?;
        let _ = writeln!(
            text,
            "{}\t0.0\t{x:.4}\t{y:.4}\t{z:.4}\t{omega:.8}\t{phi:.8}\t{kappa:.8}\t{latitude:.10}\t{longitude:.10}",
            word(&photograph.name)
        );
    }
    Ok(vec![File { name: "orientations_eo.txt".into(), media_type: TEXT, text }])
}

/// `geo.txt` of OpenDroneMap: the CRS, then `name x y z`. It has no place for omega, phi and kappa: what it calls yaw,
/// pitch and roll are a drone's, and those who wrote omega, phi, kappa there found their block turned over.
pub(super) fn odm(photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    let mut text = format!("{}\n", target.crs);
    for photograph in photographs {
        let [x, y, z] = target.position(photograph.centre_geocentric_m)?;
        let _ = writeln!(text, "{} {x:.4} {y:.4} {z:.4}", word(&photograph.name));
    }
    Ok(vec![File { name: "geo.txt".into(), media_type: TEXT, text }])
}
