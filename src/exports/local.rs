//! Formats in a Cartesian frame: local east, north, up. Nothing is fitted, nothing is lost.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde_json::{Map, Value, json};

use super::interior::OpenCv;
use super::tables::word;
use super::{ExportError, File, Format, Photograph, stem};
use crate::geometry::LocalFrame;

const TEXT: &str = "text/plain; charset=utf-8";
const XML: &str = "application/xml";

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

/// MicMac's folder `Ori-Gable`: an orientation for each photograph, a calibration for each camera. Its camera has x
/// right, y down, z forward; the distortion leads from ideal to measured pixels (`eConvApero_DistM2C`).
pub(super) fn micmac(photographs: &[Photograph]) -> Result<Vec<File>, ExportError> {
    let frame = shared_frame(photographs)?;
    let mut files: BTreeMap<String, String> = BTreeMap::new();
    for photograph in photographs {
        let calibration = format!("Ori-Gable/AutoCal-{}.xml", file_name(&photograph.camera_name));
        files.insert(calibration.clone(), micmac_calibration(photograph)?);
        let (rotation, _) = opencv_pose(photograph, &frame);
        let [x, y, z]: [f64; 3] = frame.from_geocentric(photograph.centre_geocentric_m).into();
        let world_from_camera = rotation.inverse();
        let row = |i: usize| {
            let m = world_from_camera.matrix();
            format!("<L{0}>{1} {2} {3}</L{0}>", i + 1, m[(i, 0)], m[(i, 1)], m[(i, 2)])
        };
        let ground_m = frame.from_geocentric(
            photograph.ground_geocentric_m(photograph.camera.principal_point_px(), photograph.ground_height_m)?,
        );
        let (altitude, depth) = (ground_m.z, (ground_m - Vector3::new(x, y, z)).norm());
        let text = format!(
            "<?xml version=\"1.0\" ?>\n<ExportAPERO>\n  <OrientationConique>\n    <OrIntImaM2C>\n      <I00>0 0</I00>\n      \
             <V10>1 0</V10>\n      <V01>0 1</V01>\n    </OrIntImaM2C>\n    <TypeProj>eProjStenope</TypeProj>\n    \
             <ZoneUtileInPixel>true</ZoneUtileInPixel>\n    <FileInterne>{}</FileInterne>\n    \
             <RelativeNameFI>false</RelativeNameFI>\n    <Externe>\n      <AltiSol>{altitude}</AltiSol>\n      \
             <Profondeur>{depth}</Profondeur>\n      <Time>0</Time>\n      <KnownConv>eConvApero_DistM2C</KnownConv>\n      \
             <Centre>{x} {y} {z}</Centre>\n      <ParamRotation>\n        <CodageMatr>\n          {}\n          {}\n          \
             {}\n        </CodageMatr>\n      </ParamRotation>\n    </Externe>\n    <ConvOri>\n      \
             <KnownConv>eConvApero_DistM2C</KnownConv>\n    </ConvOri>\n  </OrientationConique>\n</ExportAPERO>\n",
            escaped(&calibration),
            row(0),
            row(1),
            row(2)
        );
        files.insert(format!("Ori-Gable/Orientation-{}.xml", file_name(&photograph.name)), text);
    }
    Ok(files.into_iter().map(|(name, text)| File { name, media_type: XML, text }).collect())
}

/// The model of Fraser with coefficients in pixels: `b1` and `b2` act on ideal coordinates there, on bent ones here,
/// which makes no difference that counts.
fn micmac_calibration(photograph: &Photograph) -> Result<String, ExportError> {
    let camera = &photograph.camera;
    let Some(d) = camera.distortion() else {
        // for the reason that it gives
        return OpenCv::of(photograph, Format::Micmac).map(|_| String::new());
    };
    let c = camera.principal_distance_px;
    let principal = camera.principal_point_px();
    let (x, y) = (principal.x, principal.y);
    let [k1, k2, k3] = [d.k1 / c.powi(2), d.k2 / c.powi(4), d.k3 / c.powi(6)];
    let (p1, p2, b1, b2) = (d.p2 / c, d.p1 / c, d.b1_px / c, d.b2_px / c);
    Ok(format!(
        "<?xml version=\"1.0\" ?>\n<ExportAPERO>\n  <CalibrationInternConique>\n    \
         <KnownConv>eConvApero_DistM2C</KnownConv>\n    <PP>{x} {y}</PP>\n    <F>{c}</F>\n    <SzIm>{} {}</SzIm>\n    \
         <CalibDistortion>\n      <ModPhgrStd>\n        <RadialePart>\n          <CDist>{x} {y}</CDist>\n          \
         <CoeffDist>{k1:e}</CoeffDist>\n          <CoeffDist>{k2:e}</CoeffDist>\n          <CoeffDist>{k3:e}</CoeffDist>\n        \
         </RadialePart>\n        <P1>{p1:e}</P1>\n        <P2>{p2:e}</P2>\n        <b1>{b1:e}</b1>\n        <b2>{b2:e}</b2>\n      \
         </ModPhgrStd>\n    </CalibDistortion>\n  </CalibrationInternConique>\n</ExportAPERO>\n",
        camera.width_px, camera.height_px
    ))
}

/// A name without folders and what a file must not be called.
pub(super) fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || ".-_".contains(c) { c } else { '_' }).collect()
}

pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The name under which files beside an image go.
pub(super) fn beside(name: &str, ending: &str) -> String {
    format!("{}{ending}", file_name(stem(name)))
}
