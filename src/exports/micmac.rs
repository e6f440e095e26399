//! MicMac's `Ori-` folder, and its model of a camera.

use std::collections::BTreeMap;

use nalgebra::{SMatrix, SVector, Vector3};

use super::interior::OpenCv;
use super::local::{escaped, opencv_pose, shared_frame};
use super::names::file_name;
use super::photograph::SHARES;
use super::{ExportError, File, Format, Photograph};

const XML: &str = "application/xml";
/// What may be lost of the camera.
const MOST_RESIDUAL_PX: f64 = 0.05;

/// MicMac's folder `Ori-Gable`: an orientation for each photograph, a calibration for each camera. Its camera has x
/// right, y down, z forward; the distortion leads from ideal to measured pixels (`eConvApero_DistM2C`).
pub(super) fn write(photographs: &[Photograph]) -> Result<Vec<File>, ExportError> {
    let frame = shared_frame(photographs)?;
    let mut files: BTreeMap<String, String> = BTreeMap::new();
    for photograph in photographs {
        let calibration = format!("Ori-Gable/AutoCal-{}.xml", file_name(&photograph.camera_name));
        files.insert(calibration.clone(), calibration_file(photograph)?);
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

fn calibration_file(photograph: &Photograph) -> Result<String, ExportError> {
    let Fraser { radial: [k1, k2, k3], tangential: [p1, p2], affine: [b1, b2] } = Fraser::fitted(photograph)?;
    let camera = &photograph.camera;
    let (c, principal) = (camera.principal_distance_px, camera.principal_point_px());
    let (x, y) = (principal.x, principal.y);
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

/// Fraser's model, from ideal to measured pixels about the principal point, y down:
/// `x_measured = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2x²) + 2 p2 xy + b1 x + b2 y`, and y alike without `b1` and `b2`.
/// These act on ideal coordinates; the contract's act on bent ones, so that where there are any, all coefficients are fitted.
struct Fraser {
    radial: [f64; 3],
    tangential: [f64; 2],
    affine: [f64; 2],
}

const UNKNOWNS: usize = 7;
type Row = SVector<f64, UNKNOWNS>;

impl Fraser {
    /// Fits the model to the camera over its frame.
    ///
    /// # Errors
    /// [`ExportError::Camera`] for a scan of film, and where more than [`MOST_RESIDUAL_PX`] would be lost.
    fn fitted(photograph: &Photograph) -> Result<Self, ExportError> {
        let camera = &photograph.camera;
        if photograph.is_film() {
            return Err(OpenCv::no_film(photograph, Format::Micmac));
        }
        let (mut normal, mut right) = (SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros(), Row::zeros());
        let mut observed = Vec::new();
        // powers of the radius are taken in units of the frame, or the normal equations could not be solved
        let unit_px = camera.frame_radius_px();
        for (across, down) in SHARES.iter().flat_map(|across| SHARES.map(|down| (*across, down))) {
            let pixel = camera.frame_px(across, down);
            let ideal_px = camera.reduced_from_pixel(pixel).ok_or(ExportError::NoFit)?;
            let missing = pixel - camera.principal_point_px() - ideal_px;
            let (x, y) = (ideal_px.x / unit_px, ideal_px.y / unit_px);
            let r2 = x * x + y * y;
            let rows = [
                Row::from([x * r2, x * r2.powi(2), x * r2.powi(3), r2 + 2.0 * x * x, 2.0 * x * y, x, y]),
                Row::from([y * r2, y * r2.powi(2), y * r2.powi(3), 2.0 * x * y, r2 + 2.0 * y * y, 0.0, 0.0]),
            ];
            for (row, value) in rows.into_iter().zip([missing.x, missing.y]) {
                normal += row * row.transpose();
                right += row * value;
                observed.push((row, value));
            }
        }
        let solution = normal.cholesky().ok_or(ExportError::NoFit)?.solve(&right);
        let residual_max_px =
            observed.iter().map(|(row, value)| (row.dot(&solution) - value).abs()).fold(0.0, f64::max);
        if residual_max_px > MOST_RESIDUAL_PX {
            let why = format!(
                "its lens distorts so much that pixels which are not square (b1_px, b2_px) cannot be told beside it: \
                 {residual_max_px:.2} px would be lost; rpc describes it, and orthority or colmap where b2_px is 0"
            );
            return Err(ExportError::Camera {
                format: Format::Micmac.name(),
                camera: photograph.camera_name.clone(),
                why,
            });
        }
        let by_unit = |index: usize, power: i32| solution[index] / unit_px.powi(power);
        Ok(Self {
            radial: [by_unit(0, 3), by_unit(1, 5), by_unit(2, 7)],
            tangential: [by_unit(3, 2), by_unit(4, 2)],
            affine: [by_unit(5, 1), by_unit(6, 1)],
        })
    }
}
