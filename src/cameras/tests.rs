//! Against the programs that the files are of: `tests/expected.py` makes files and pixels.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use proptest::prelude::*;
use rstest::rstest;

use super::*;

const FILES: [(&str, Format, &str); 13] = [
    ("opencv.yaml", Format::OpenCv, include_str!("tests/opencv.yaml")),
    ("opencv.json", Format::OpenCv, include_str!("tests/opencv.json")),
    ("opencv.xml", Format::OpenCv, include_str!("tests/opencv.xml")),
    ("opencv_prism.yaml", Format::OpenCv, include_str!("tests/opencv_prism.yaml")),
    ("opencv_tilt.yaml", Format::OpenCv, include_str!("tests/opencv_tilt.yaml")),
    ("cameras.txt", Format::Colmap, include_str!("tests/cameras.txt")),
    ("cameras.json", Format::OpenSfm, include_str!("tests/cameras.json")),
    ("metashape.xml", Format::Metashape, include_str!("tests/metashape.xml")),
    ("metashape_k4.xml", Format::Metashape, include_str!("tests/metashape_k4.xml")),
    ("pix4d.cam", Format::Pix4d, include_str!("tests/pix4d.cam")),
    ("australis.txt", Format::Australis, include_str!("tests/australis.txt")),
    ("inpho.prj", Format::Inpho, include_str!("tests/inpho.prj")),
    ("", Format::OpenCv, ""),
];

fn text(file: &str) -> (Format, &'static str) {
    let (_, format, text) = FILES.iter().find(|(name, ..)| *name == file).unwrap();
    (*format, text)
}

fn given<'a>(file: &str, camera: &'a str) -> (Format, Given<'a>) {
    let (format, text) = text(file);
    let image_size_px = (file == "pix4d.cam").then_some([4608, 3456]);
    (format, Given { text, camera: Some(camera).filter(|name| !name.is_empty()), image_size_px, pixel_size_mm: None })
}

/// Rays and pixels of each file and camera.
fn expected() -> BTreeMap<(&'static str, &'static str), Vec<[f64; 4]>> {
    let mut expected: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for row in include_str!("tests/expected.csv").lines().skip(1) {
        let words: Vec<&str> = row.split(',').collect();
        let &[file, camera, ref numbers @ ..] = words.as_slice() else { panic!("{row}") };
        let numbers: Vec<f64> = numbers.iter().map(|number| number.parse().unwrap()).collect();
        expected.entry((file, camera)).or_default().push(numbers.try_into().unwrap());
    }
    expected
}

#[test]
fn rays_fall_where_the_program_of_the_file_has_them() {
    let expected = expected();
    assert_eq!(expected.len(), 19);
    for ((file, camera), rays) in expected {
        let (format, given) = given(file, camera);
        let Converted { conversion, .. } = format.read(&given).unwrap();
        let tolerance_px = if conversion.exact { 1e-6 } else { conversion.max_px + 1e-3 };
        for [x, y, u, v] in rays {
            let off = conversion.camera.pixel_from_ideal(Vector2::new(x, y)) - Vector2::new(u, v);
            assert!(off.norm() < tolerance_px, "{file} {camera} at ({x}, {y}): {off} of {}", conversion.max_px);
        }
        // what the contract's polynomial has no term for: K4, P3 and P4 in the corners of a wide lens; a prism; a
        // tilted sensor
        let bound_px = match file {
            "metashape_k4.xml" => 0.3,
            "opencv_prism.yaml" | "opencv_tilt.yaml" => 1.5,
            _ => conversion::WARN_PX,
        };
        assert!(conversion.max_px < bound_px, "{file} {camera}: {}", conversion.max_px);
        assert!(!conversion.exact || conversion.max_px < 1e-6, "{file} {camera}: {}", conversion.max_px);
        assert_eq!(conversion.residuals.len(), 117);
        assert!(conversion.rms_px <= conversion.max_px);
    }
}

#[test]
fn models_that_are_the_contracts_own_are_taken_over_as_they_are() {
    let (format, given) = given("opencv.yaml", "");
    let Conversion { camera, exact, .. } = format.read(&given).unwrap().conversion;
    assert!(exact);
    assert_eq!([camera.width_px, camera.height_px], [4000, 3000]);
    assert_eq!(camera.principal_distance_px, 2889.0);
    assert_eq!(camera.principal_point_px(), Vector2::new(2010.75, 1491.25));
    let brown = camera.distortion().unwrap();
    assert_eq!([brown.k1, brown.k2, brown.k3, brown.p1, brown.p2], [-0.0468, 0.0207, 0.0011, 0.00102, -0.00199]);
    assert_eq!([brown.b1_px, brown.b2_px], [1.5, 0.0]);
}

#[test]
fn the_formats_are_told_apart() {
    for (file, format, text) in FILES.into_iter().filter(|(file, ..)| !file.is_empty()) {
        assert_eq!(Format::detect(text), Some(format), "{file}");
        assert_eq!(format.to_string().parse::<Format>(), Ok(format));
    }
    for other in ["", "{}", "<a/>", "hello\nworld", "a b c d e"] {
        assert_eq!(Format::detect(other), None);
    }
    assert_eq!("zeiss".parse::<Format>(), Err(CameraFileError::UnknownFormat));
}

#[rstest]
#[case("cameras.txt", None, None, "name one of them")]
#[case("cameras.txt", Some("9"), None, "no camera \"9\"")]
#[case("cameras.txt", Some("7"), None, "OPENCV_FISHEYE")]
#[case("cameras.txt", Some("5"), Some([3000, 4000]), "image_size_px contradicts")]
#[case("cameras.json", None, None, "v2 b 4000 3000 perspective 0.9")]
#[case("cameras.json", Some("v2 c fisheye"), None, "fisheye")]
#[case("cameras.json", Some("v2 b 4000 3000 perspective 0.9"), Some([4000, 4000]), "ratio of sides")]
#[case("pix4d.cam", None, None, "give image_size_px")]
#[case("pix4d.cam", None, Some([4000, 4000]), "image_size_px contradicts")]
#[case("inpho.prj", None, None, "\"upright\", \"turned\", \"RMK\"")]
#[case("inpho.prj", Some("RMK"), None, "FilmFrame cannot be converted: it is a film camera")]
#[case("inpho.prj", Some("turned"), Some([11608, 8708]), "image_size_px contradicts")]
fn what_cannot_be_read_says_why(
    #[case] file: &str,
    #[case] camera: Option<&str>,
    #[case] image_size_px: Option<[u32; 2]>,
    #[case] named: &str,
) {
    let (format, text) = text(file);
    let refused = format.read(&Given { text, camera, image_size_px, pixel_size_mm: None }).unwrap_err().to_string();
    assert!(refused.contains(named), "{refused}");
}

#[rstest]
#[case(Format::OpenCv, "camera_matrix: [1, 0, 5, 0, 1, 5, 0, 0, 1]", "image_size_px")]
#[case(Format::OpenCv, "camera_matrix: [1, 0, 5, 0, 1]", "camera_matrix: it has 5 numbers")]
#[case(
    Format::OpenCv,
    "image_width: 100\nimage_height: 1.5\ncamera_matrix: [9, 0, 5, 0, 9, 5, 0, 0, 1]",
    "image_height"
)]
#[case(
    Format::OpenCv,
    "image_size: [9, 9]\ncamera_matrix: [9, 0, 5, 0, 9, 5, 0, 0, 1]\nD: [1, 2, 3]",
    "distortion_coefficients"
)]
#[case(
    Format::OpenCv,
    "image_size: [9, 9]\ncamera_matrix: [9, 0, 5, 0, 9, 5, 0, 0, 1]\ndistortion_model: equidistant\nD: [0, 0, 0, 0]",
    "fish-eye"
)]
#[case(Format::OpenCv, "image_size: [9, 9]\ncamera_matrix: [-9, 0, 5, 0, -9, 5, 0, 0, 1]", "positive")]
#[case(Format::Colmap, "1 PINHOLE 40 30 20", "line 1")]
#[case(Format::Colmap, "# none", "no camera")]
#[case(Format::Colmap, "1 OPENCV 40 30 20 20 20 15 x 0 0 0", "\"x\"")]
#[case(Format::Metashape, "<calibration><fx>9</fx><width>9</width><height>9</height></calibration>", "1.3")]
#[case(Format::Metashape, "<calibration><projection>fisheye</projection><f>9</f></calibration>", "fisheye")]
#[case(Format::Pix4d, "F 9", "line 1")]
#[case(Format::Inpho, "$PHOTO\n$CAMERA_ID : a\n$END", "no camera")]
#[case(
    Format::Inpho,
    "$CAMERA\n$FOCAL_LENGTH : 50\n$CCD_COLUMNS : 9\n$CCD_ROWS : 9\n$END",
    "$CCD_INTERIOR_ORIENTATION: it is missing"
)]
#[case(
    Format::Inpho,
    "$CAMERA\n$CCD_COLUMNS : 9\n$CCD_ROWS : 9\n$CCD_INTERIOR_ORIENTATION :\n9 0 4\n0 9 4\n$END",
    "mirrors"
)]
#[case(
    Format::Inpho,
    "$CAMERA\n$CCD_COLUMNS : 9\n$CCD_ROWS : 9\n$CCD_INTERIOR_ORIENTATION :\n9 0 4\n0 -9\n$END",
    "5 numbers"
)]
#[case(
    Format::Inpho,
    "$CAMERA\n$CCD_COLUMNS : 9\n$CCD_ROWS : 9\n$CCD_INTERIOR_ORIENTATION :\n9 0 4\n0 -9 4\n$END",
    "$FOCAL_LENGTH"
)]
#[case(Format::Inpho, "$CAMERA\n$PIXEL_REFERENCE : TopLeft\n$END", "CenterTopLeft")]
#[case(Format::Inpho, "$CAMERA\n$KIND : CCDLine\n$END", "CCDFrame")]
#[case(
    Format::Inpho,
    "$CAMERA_DEFINITION\n  $ID : a\n  $CALIBRATION_SET :\n  $END\n  $CALIBRATION_SET :\n  $END\n$END",
    "$ACTIVE_CALIBRATION"
)]
#[case(
    Format::Inpho,
    "$CAMERA\n$CCD_COLUMNS : 900\n$CCD_ROWS : 900\n$CCD_INTERIOR_ORIENTATION :\n9 0 4\n0 -9 4\n$FOCAL_LENGTH : 50\n$DISTORTION_TYPE : Grid\n$END",
    "Polynomial"
)]
#[case(Format::Australis, "C 50\nXP 0\nYP 0\nK1 0\nH 100 0.01\n", "image_size_px")]
fn a_fault_is_named(#[case] format: Format, #[case] text: &str, #[case] named: &str) {
    let refused = format.read(&Given { text, ..Given::default() }).unwrap_err().to_string();
    assert!(refused.contains(named), "{refused}");
}

#[test]
fn a_calibration_that_folds_or_is_no_polynomial_is_refused() {
    let matrix = "image_size: [4000, 3000]\ncamera_matrix: [2000, 0, 2000, 0, 2000, 1500, 0, 0, 1]\n";
    for coefficients in ["[-0.9, 0, 0, 0]", "[0.1, 0.1, 0, 0, 0, 8, 0, 0]", "[0, 0, 0, 0, 0, 0, 0, 0, 0.4, 0, 0, 0]"] {
        let text = format!("{matrix}D: {coefficients}");
        let refused = Format::OpenCv.read(&Given { text: &text, ..Given::default() });
        assert!(matches!(refused, Err(CameraFileError::Conversion(_))), "{coefficients}: {refused:?}");
    }
}

#[test]
fn a_project_of_metashape_has_cameras_by_label_and_the_adjusted_calibration_counts() {
    let text = "<document><chunk><sensors>\
        <sensor id=\"0\" label=\"FC6310\" type=\"frame\"><resolution width=\"5472\" height=\"3648\"/>\
        <calibration type=\"frame\" class=\"initial\"><f>3000</f></calibration>\
        <calibration type=\"frame\" class=\"adjusted\"><resolution width=\"5472\" height=\"3648\"/><f>3648.5</f><p1>0.001</p1>\
        </calibration></sensor>\
        <sensor id=\"1\" label=\"other\"><calibration class=\"adjusted\"><f>9</f></calibration></sensor>\
        </sensors></chunk></document>";
    let given = Given { text, camera: Some("FC6310"), ..Given::default() };
    let Converted { name, conversion, .. } = Format::Metashape.read(&given).unwrap();
    assert_eq!(name.as_deref(), Some("FC6310"));
    assert_eq!(conversion.camera.principal_distance_px, 3648.5);
    assert_eq!(conversion.camera.principal_point_px(), Vector2::new(2736.0, 1824.0));
    // Metashape's P1 goes with r² + 2x² in x
    assert_eq!(conversion.camera.distortion().unwrap().p2, 0.001);
}

#[test]
fn the_calibration_of_opensfm_serves_larger_images_of_the_same_shape() {
    let name = "v2 a 5472 3648 brown 0.6666";
    let (format, text) = text("cameras.json");
    let given = Given { text, camera: Some(name), image_size_px: Some([5472, 3648]), pixel_size_mm: None };
    let large = format.read(&given).unwrap().conversion.camera;
    let small = format.read(&Given { image_size_px: None, ..given }).unwrap().conversion.camera;
    let ideal = Vector2::new(0.3, -0.2);
    assert!((large.pixel_from_ideal(ideal) - 4.0 * small.pixel_from_ideal(ideal)).norm() < 1e-9);
}

#[test]
fn the_sign_of_inpho_is_told_with_what_it_means() {
    let (format, given) = given("inpho.prj", "turned");
    let Converted { name, warnings, .. } = format.read(&given).unwrap();
    assert_eq!(name.as_deref(), Some("turned"));
    let [turned, sign] = warnings.as_slice() else { panic!("{warnings:?}") };
    assert!(turned.contains("90.00°"), "{turned}");
    // 1.4e-5 r² - 4e-9 r⁴ at r = 33.3 mm is 0.35 mm, and decentring 0.01 mm
    assert!(sign.contains("nearer to the middle") && sign.contains("barrel") && sign.contains("sign"), "{sign}");
    let other = given.text.replace("0 -1.4e-5 4.0e-9", "0 1.4e-5 -4.0e-9").replace("-3.4e-6 -4.3e-6", "3.4e-6 4.3e-6");
    let sign = format.read(&Given { text: &other, ..given }).unwrap().warnings.pop().unwrap();
    assert!(sign.contains("farther from the middle") && sign.contains("pincushion"), "{sign}");
}

#[test]
fn a_project_of_inpho_without_distortion_is_taken_over_as_it_is() {
    let text = "$CAMERA\n  $TYPE : old\n  $CCD_INTERIOR_ORIENTATION :\n    100 0 1999.5\n    0 -100 1499.5\n  $CCD_COLUMNS : 4000\n\
                \x20 $CCD_ROWS : 3000\n  $FOCAL_LENGTH : 50.5\n  $PRINCIPAL_POINT_PPA : 0.01 0.02\n$END\n";
    let Converted { name, conversion, warnings } = Format::Inpho.read(&Given { text, ..Given::default() }).unwrap();
    assert!(conversion.exact);
    assert_eq!(name.as_deref(), Some("old"));
    assert_eq!(conversion.camera.principal_distance_px, 5050.0);
    assert!((conversion.camera.principal_point_px() - Vector2::new(2001.0, 1498.0)).norm() < 1e-9);
    assert!(warnings.len() == 1 && warnings[0].contains("CenterTopLeft"), "{warnings:?}");
}

#[test]
fn changing_the_sign_would_be_wrong_by_pixels() {
    // why the conversion is a fit: the photogrammetric coefficients of the report with the other sign
    let (format, given) = given("australis.txt", "");
    let fitted = format.read(&given).unwrap().conversion.camera;
    let c_mm: f64 = 51.6829;
    let brown = crate::geometry::Brown {
        k1: -1.456_939_317_67e-5 * c_mm.powi(2),
        k2: 4.059_036_2e-9 * c_mm.powi(4),
        k3: -4.11e-13 * c_mm.powi(6),
        ..*fitted.distortion().unwrap()
    };
    let size_px = [fitted.width_px, fitted.height_px];
    let flipped =
        crate::geometry::Camera::new(size_px, fitted.principal_distance_px, fitted.principal_point_px(), brown)
            .unwrap();
    let corner = Vector2::new(0.5, 0.38);
    let off_px = (fitted.pixel_from_ideal(corner) - flipped.pixel_from_ideal(corner)).norm();
    assert!(off_px > 1.0, "{off_px}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn no_text_makes_it_panic(which in 0..FILES.len(), at in 0..4000_usize, put in ".{0,8}", cut in 0..4000_usize) {
        let (_, format, text) = FILES[which];
        let place = text.char_indices().map(|(place, _)| place).nth(at).unwrap_or(text.len());
        let damaged = format!("{}{put}{}", &text[..place], &text[place..].chars().skip(cut % 50).collect::<String>());
        let given = Given { text: &damaged, camera: Some("1"), image_size_px: Some([400, 300]), pixel_size_mm: Some(0.005) };
        for format in [Some(format), Format::detect(&damaged)].into_iter().flatten() {
            let _ = format.read(&given);
            let _ = format.read(&Given { text: &damaged, ..Given::default() });
        }
    }
}
