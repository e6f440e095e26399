//! Formats in a Cartesian frame: local east, north, up. Nothing is fitted, nothing is lost.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde_json::{Map, Value, json};

use super::interior::OpenCv;
use super::names::word;
use super::{ExportError, File, Format, Photograph};
use crate::geometry::LocalFrame;

const TEXT: &str = "text/plain; charset=utf-8";

/// The frame that several photographs share: on the ellipsoid below the mean of their projection centres.
pub(super) fn shared_frame(photographs: &[Photograph]) -> Result<LocalFrame, ExportError> {
    let sum: Vector3<f64> = photographs.iter().map(|photograph| photograph.centre_geocentric_m).sum();
    let [longitude, latitude, _] = Photograph::geodetic(sum / photographs.len().max(1) as f64)?;
    Ok(LocalFrame::at(longitude, latitude, 0.0))
}

/// Rotation of the frame to OpenCV's camera (x right, y down, z forward), and the frame's origin therein.
pub(super) fn opencv_pose(photograph: &Photograph, frame: &LocalFrame) -> (Rotation3<f64>, Vector3<f64>) {
    let orientation = photograph.in_frame(frame);
    let flip = Rotation3::from_matrix_unchecked(Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)));
    let rotation = flip * orientation.camera_from_object;
    (rotation, -(rotation * orientation.projection_centre_m))
}

/// OpenSfM's `reconstruction.json`: one reconstruction without points.
pub(super) fn opensfm(photographs: &[Photograph]) -> Result<Vec<File>, ExportError> {
    let frame = shared_frame(photographs)?;
    let (mut cameras, mut shots) = (Map::new(), Map::new());
    for photograph in photographs {
        let interior = OpenCv::of(photograph, Format::Opensfm)?;
        let camera = &photograph.camera;
        let side = f64::from(camera.width_px.max(camera.height_px));
        let [c_x, c_y] = interior.normalized_offset(photograph);
        let [focal_x, focal_y] = interior.focal_px.map(|focal| focal / side);
        let d = interior.distortion;
        let described = json!({
            "projection_type": "brown", "width": camera.width_px, "height": camera.height_px,
            "focal_x": focal_x, "focal_y": focal_y, "c_x": c_x, "c_y": c_y,
            "k1": d.k1, "k2": d.k2, "k3": d.k3, "p1": d.p1, "p2": d.p2,
        });
        cameras.insert(photograph.camera_name.clone(), described);
        let (rotation, translation) = opencv_pose(photograph, &frame);
        let turned = UnitQuaternion::from_rotation_matrix(&rotation).scaled_axis();
        let centre_m = frame.from_geocentric(photograph.centre_geocentric_m);
        let shot = json!({
            "rotation": turned.as_slice(), "translation": translation.as_slice(), "camera": photograph.camera_name,
            "orientation": 1, "capture_time": 0.0, "gps_dop": 1.0, "gps_position": centre_m.as_slice(),
        });
        shots.insert(photograph.name.clone(), shot);
    }
    let reconstruction = json!([{
        "cameras": cameras, "shots": shots, "points": {},
        "reference_lla": {
            "latitude": frame.latitude_deg(), "longitude": frame.longitude_deg(), "altitude": frame.height_m(),
        },
    }]);
    Ok(vec![json_file("reconstruction.json", &reconstruction)])
}

pub(super) fn json_file(name: &str, value: &Value) -> File {
    File { name: name.to_owned(), media_type: "application/json", text: format!("{value:#}\n") }
}

/// COLMAP's three files; its pixels count from the corner of the top-left one, as ours.
pub(super) fn colmap(photographs: &[Photograph]) -> Result<Vec<File>, ExportError> {
    let frame = shared_frame(photographs)?;
    let head = format!("# Frame: {frame}, the east, north, up of which are COLMAP's world\n");
    let mut cameras = format!("{head}# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    let mut images = format!("{head}# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME, then an empty line\n");
    let mut ids: BTreeMap<&str, usize> = BTreeMap::new();
    for (index, photograph) in photographs.iter().enumerate() {
        let next = ids.len() + 1;
        let id = *ids.entry(&photograph.camera_name).or_insert(next);
        if id == next {
            let OpenCv { focal_px: [fx, fy], principal_point_px: [cx, cy], distortion: d } =
                OpenCv::of(photograph, Format::Colmap)?;
            let (width, height) = (photograph.camera.width_px, photograph.camera.height_px);
            let (k1, k2, k3, p1, p2) = (d.k1, d.k2, d.k3, d.p1, d.p2);
            let _ = writeln!(
                cameras,
                "{id} FULL_OPENCV {width} {height} {fx} {fy} {cx} {cy} {k1} {k2} {p1} {p2} {k3} 0 0 0"
            );
        }
        let (rotation, t) = opencv_pose(photograph, &frame);
        let q = UnitQuaternion::from_rotation_matrix(&rotation);
        let number = index + 1;
        let _ = writeln!(
            images,
            "{number} {} {} {} {} {} {} {} {id} {}\n",
            q.w,
            q.i,
            q.j,
            q.k,
            t.x,
            t.y,
            t.z,
            word(&photograph.name)
        );
    }
    let points = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n".to_owned();
    let file = |name: &str, text| File { name: name.to_owned(), media_type: TEXT, text };
    Ok(vec![file("cameras.txt", cameras), file("images.txt", images), file("points3D.txt", points)])
}

pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
