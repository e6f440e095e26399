//! Formats of single products, in a map grid.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde_json::json;

use super::interior::{Corrections, OpenCv};
use super::local::json_file;
use super::names::{stem, word};
use super::tables::quoted;
use super::{ExportError, File, Format, Photograph, Target, in_grid};

const TEXT: &str = "text/plain; charset=utf-8";
const CSV: &str = "text/csv; charset=utf-8";
const UM_PER_MM: f64 = 1000.0;

/// Each camera once, with a photograph that it took.
fn cameras(photographs: &[Photograph]) -> BTreeMap<&str, &Photograph> {
    photographs.iter().map(|photograph| (photograph.camera_name.as_str(), photograph)).collect()
}

/// Pix4D's tables of external and internal camera parameters: `imageName X Y Z Omega Phi Kappa` in metres and degrees,
/// and a camera in millimetres from the corner of the sensor.
pub(super) fn pix4d(photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    let mut external = String::from("imageName X Y Z Omega Phi Kappa\n");
    for (photograph, grid) in in_grid(photographs, target)? {
        let ([x, y, z], [omega, phi, kappa]) = (grid.centre_m, grid.angles_deg());
        let _ = writeln!(external, "{} {x:.4} {y:.4} {z:.4} {omega:.8} {phi:.8} {kappa:.8}", word(&photograph.name));
    }
    let mut internal = String::new();
    for (index, (name, photograph)) in cameras(photographs).into_iter().enumerate() {
        let OpenCv { focal_px: [fx, fy], principal_point_px: [px, py], distortion: d } =
            OpenCv::of(photograph, Format::Pix4d)?;
        if (fx - fy).abs() > 0.01 {
            let why = format!(
                "its pixels are not square (b1_px = {:.3}), and it has one F only; use orthority or colmap",
                fx - fy
            );
            return Err(ExportError::Camera { format: Format::Pix4d.name(), camera: name.to_owned(), why });
        }
        let mm = photograph.pixel_size_mm;
        let (width, height) = (photograph.camera.width_px, photograph.camera.height_px);
        let _ = writeln!(
            internal,
            "Pix4D camera calibration file {index}\n#Camera: {} ({width} x {height})\n\
             #Focal Length mm assuming a sensor width of {}x{}mm\nF {}\n\
             #Principal Point mm\nPx {}\nPy {}\n#Symmetrical Lens Distortion Coeffs\nK1 {}\nK2 {}\nK3 {}\n\
             #Tangential Lens Distortion Coeffs\nT1 {}\nT2 {}\n",
            word(name),
            f64::from(width) * mm,
            f64::from(height) * mm,
            fy * mm,
            px * mm,
            py * mm,
            d.k1,
            d.k2,
            d.k3,
            // its T1 goes with 2xy in x, as ours does
            d.p1,
            d.p2
        );
    }
    let file = |name: &str, text| File { name: name.to_owned(), media_type: TEXT, text };
    Ok(vec![
        file("calibrated_external_camera_parameters.txt", external),
        file("calibrated_internal_camera_parameters.cam", internal),
    ])
}

/// A project of Inpho: cameras in millimetres, photographs with principal distance, centre and rotation from the camera to
/// the grid. Pixels count from the centre of the top-left one.
pub(super) fn inpho(photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    let mut text = format!(
        "$PROJECT 6.0.0\n$PROJECT_NAME : gable\n$COORDINATE_SYSTEM\n  {}\n$END_COORDINATE_SYSTEM\n$UNITS_OBJECT : m\n\
         $PIXEL_REFERENCE : CenterTopLeft\n",
        target.crs
    );
    for (name, photograph) in cameras(photographs) {
        let camera = &photograph.camera;
        let corrections = Corrections::of(photograph, Format::Inpho)?;
        let ([width_mm, mm], c_mm) = (corrections.pixel_mm, photograph.principal_distance_mm());
        let principal = camera.principal_point_px();
        // distortion, which is subtracted: what speaks for that is told with the reader, cameras::inpho
        let [k0, k1, k2, k3] = corrections.radial.map(|k| 0.0 - k);
        let [p1, p2] = corrections.tangential.map(|p| 0.0 - p);
        let _ = write!(
            text,
            "$CAMERA_DEFINITION\n$TYPE : CCD_FRAME\n$ID : {}\n$BRAND : Custom\n$KAPPA : 0\n$PRINCIPAL_DISTANCE : {c_mm}\n\
             $CCD_COLUMNS_ROWS : {} {}\n$CCD_PIXEL_SIZE_MM : {mm}\n$CCD_INTERIOR_ORIENTATION :\n  {} 0 {}\n  0 {} {}\n\
             $PRINCIPAL_POINT_PPA : 0 0\n$PRINCIPAL_POINT_PPS : 0 0\n$DISTORTION_TYPE : Polynomial\n\
             $RADIAL_COEFFS : {k0:e} {k1:e} {k2:e} {k3:e}\n$DECENTRE_COEFFS : {p1:e} {p2:e}\n$END_CAMERA_DEFINITION\n",
            word(name),
            camera.width_px,
            camera.height_px,
            1.0 / width_mm,
            principal.x - 0.5,
            -1.0 / mm,
            principal.y - 0.5,
        );
    }
    for (photograph, grid) in in_grid(photographs, target)? {
        let ([x, y, z], c_mm) = (grid.centre_m, photograph.principal_distance_mm());
        let r = grid.camera_from_grid.inverse();
        let m = r.matrix();
        let _ = write!(
            text,
            "$PHOTO\n$PHOTO_NUM : {0}\n$PHOTO_FILE : {1}\n$CAMERA_ID : {2}\n$EXT_ORI : 0\n  {c_mm} {x:.4} {y:.4} {z:.4}\n",
            word(stem(&photograph.name)),
            word(&photograph.name),
            word(&photograph.camera_name)
        );
        for row in m.row_iter() {
            let _ = writeln!(text, "  {:.12} {:.12} {:.12}", row[0], row[1], row[2]);
        }
        text.push_str("$END_PHOTO\n");
    }
    text.push_str("$END\n");
    Ok(vec![File { name: "gable.prj".into(), media_type: TEXT, text }])
}

/// orthority's exterior parameters as GeoJSON (angles in radians) and its interior ones as YAML (normalized by the larger
/// side, from the centre of the top-left pixel).
pub(super) fn orthority(photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    let mut yaml = String::new();
    for (name, photograph) in cameras(photographs) {
        let interior = OpenCv::of(photograph, Format::Orthority)?;
        let (OpenCv { focal_px: [fx, fy], distortion: d, .. }, [cx, cy]) =
            (interior, interior.normalized_offset(photograph));
        let (width, height) = (photograph.camera.width_px, photograph.camera.height_px);
        let _ = writeln!(
            yaml,
            "{}:\n  type: brown\n  im_size: [{width}, {height}]\n  focal_len: [{fx:?}, {fy:?}]\n  \
             sensor_size: [{width}.0, {height}.0]\n  cx: {}\n  cy: {}\n  k1: {}\n  k2: {}\n  p1: {}\n  p2: {}\n  k3: {}",
            json!(name),
            yaml_float(cx),
            yaml_float(cy),
            yaml_float(d.k1),
            yaml_float(d.k2),
            yaml_float(d.p1),
            yaml_float(d.p2),
            yaml_float(d.k3)
        );
    }
    let feature = |(photograph, grid): &(&Photograph, super::GridOrientation)| {
        let [longitude, latitude, height] = Photograph::geodetic(photograph.centre_geocentric_m)?;
        Ok(json!({
            "type": "Feature",
            "properties": {
                "filename": photograph.name, "camera": photograph.camera_name, "xyz": grid.centre_m,
                "opk": grid.angles_deg().map(f64::to_radians),
            },
            "geometry": {"type": "Point", "coordinates": [longitude, latitude, height]},
        }))
    };
    let features = in_grid(photographs, target)?.iter().map(feature).collect::<Result<Vec<_>, ExportError>>()?;
    let collection = json!({"type": "FeatureCollection", "world_crs": target.crs.to_string(), "features": features});
    Ok(vec![
        json_file("exterior.geojson", &collection),
        File { name: "interior.yaml".into(), media_type: "application/yaml", text: yaml },
    ])
}

/// A number that every reader of YAML takes for one: version 1.1 wants a point before the exponent.
fn yaml_float(value: f64) -> String {
    let text = format!("{value:?}");
    match text.split_once('e') {
        Some((mantissa, exponent)) => {
            let point = if mantissa.contains('.') { "" } else { ".0" };
            let sign = if exponent.starts_with('-') { "" } else { "+" };
            format!("{mantissa}{point}e{sign}{exponent}")
        }
        None => text,
    }
}

/// Frames and cameras tables of ArcGIS: microns on the sensor; the affine transformation leads from pixels (column, row
/// from the centre of the top-left one) to the sensor, y up.
pub(super) fn esri(photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    let mut frames =
        String::from("ObjectID,Raster,CameraID,PerspectiveX,PerspectiveY,PerspectiveZ,Omega,Phi,Kappa,SRS\n");
    // a number of the register's says nothing of heights
    let crs = target.crs.to_string();
    let srs = crs.strip_prefix("EPSG:").map_or(crs.as_str(), |code| code.split('+').next().unwrap_or(code));
    for (index, (photograph, grid)) in in_grid(photographs, target)?.into_iter().enumerate() {
        let ([x, y, z], [omega, phi, kappa]) = (grid.centre_m, grid.angles_deg());
        let (name, camera) = (quoted(&photograph.name), quoted(&photograph.camera_name));
        let _ =
            writeln!(frames, "{},{name},{camera},{x:.4},{y:.4},{z:.4},{omega:.8},{phi:.8},{kappa:.8},{srs}", index + 1);
    }
    let mut tables = String::from(
        "ObjectID,CameraID,FocalLength,PrincipalX,PrincipalY,NColumns,NRows,PixelSize,A0,A1,A2,B0,B1,B2,AffineDirection,\
         DistortionType,Radial,Tangential\n",
    );
    for (index, (name, photograph)) in cameras(photographs).into_iter().enumerate() {
        let corrections = Corrections::of(photograph, Format::Esri)?;
        let (camera, [width_um, um]) = (&photograph.camera, corrections.pixel_mm.map(|mm| mm * UM_PER_MM));
        let principal = camera.principal_point_px();
        // coefficients in microns: powers of the radius are microns too
        let [k0, k1, k2, k3] = corrections.radial;
        let radial = [k0, k1 / UM_PER_MM.powi(2), k2 / UM_PER_MM.powi(4), k3 / UM_PER_MM.powi(6)];
        let [p1, p2] = corrections.tangential.map(|p| p / UM_PER_MM);
        let [k0, k1, k2, k3] = radial;
        let _ = writeln!(
            tables,
            "{},{},{},0,0,{},{},{um},{},{width_um},0,{},0,{},1,Konrady,{k0:e};{k1:e};{k2:e};{k3:e},{p1:e};{p2:e}",
            index + 1,
            quoted(name),
            photograph.principal_distance_mm() * UM_PER_MM,
            camera.width_px,
            camera.height_px,
            -(principal.x - 0.5) * width_um,
            (principal.y - 0.5) * um,
            -um
        );
    }
    let file = |name: &str, text| File { name: name.to_owned(), media_type: CSV, text };
    Ok(vec![file("frames.csv", frames), file("cameras.csv", tables)])
}
