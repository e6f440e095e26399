//! Against closed forms here; against the software that reads the files in `tests/exports`.

use approx::assert_abs_diff_eq;
use nalgebra::{Vector2, Vector3};

use super::*;
use crate::cameras;
use crate::geometry::{Brown, Camera, LocalFrame, rotation};

/// An aerial photograph over Bonn: 2 km above the ground, tilted, with a lens that distorts.
fn photograph() -> Photograph {
    let distortion = Brown { k1: -0.0468, k2: 0.0207, k3: 0.001, p1: 0.00102, p2: 0.00199, b1_px: 1.5, b2_px: 0.0 };
    let camera = Camera::new([9000, 6000], 8000.0, Vector2::new(4480.0, 3025.0), distortion).unwrap();
    let frame = LocalFrame::at(7.1, 50.73, 2150.0);
    let camera_from_local = rotation::camera_from_object(0.05, -0.03, 0.7);
    Photograph {
        name: "bonn 1.tif".into(),
        camera_name: "big, one".into(),
        camera,
        pixel_size_mm: 0.006,
        centre_geocentric_m: frame.to_geocentric(Vector3::zeros()),
        camera_from_geocentric: camera_from_local * frame.local_from_geocentric(),
        sigma_m_rad: None,
        ground_height_m: 110.0,
        relief_m: 60.0,
    }
}

fn utm() -> Target {
    Target::new(Crs::parse("EPSG:25832").unwrap(), None).unwrap()
}

#[test]
fn a_ray_meets_the_ellipsoidal_height_and_its_pixel_returns() {
    let photograph = photograph();
    for pixel in [Vector2::new(0.0, 0.0), Vector2::new(9000.0, 6000.0), Vector2::new(4480.0, 3025.0)] {
        let ground_m = photograph.ground_geocentric_m(pixel, 110.0).unwrap();
        assert_abs_diff_eq!(Photograph::geodetic(ground_m).unwrap()[2], 110.0, epsilon = 1e-4);
        assert_abs_diff_eq!(photograph.pixel(ground_m).unwrap(), pixel, epsilon = 1e-5);
    }
}

#[test]
fn in_a_topocentric_frame_the_fit_is_the_orientation_itself() {
    let photograph = photograph();
    let frame = LocalFrame::at(7.12, 50.72, 0.0);
    let target = Target::new(Crs::parse(&frame.proj_string()).unwrap(), None).unwrap();
    let fitted = GridOrientation::fitted(&photograph, &target).unwrap();
    let exact = photograph.in_frame(&frame);
    assert_abs_diff_eq!(Vector3::from(fitted.centre_m), exact.projection_centre_m, epsilon = 1e-5);
    assert_abs_diff_eq!(fitted.camera_from_grid.angle_to(&exact.camera_from_object), 0.0, epsilon = 1e-8);
    assert!(fitted.residual_max_px < 1e-4, "{}", fitted.residual_max_px);
}

#[test]
fn in_a_map_grid_scale_convergence_and_curvature_are_taken_up() {
    let photograph = photograph();
    let target = utm();
    let fitted = GridOrientation::fitted(&photograph, &target).unwrap();
    // the scale k = 0.99982 at Bonn (method 4.6) shrinks the ground, so that the camera seems lower by H (1 - k)
    let true_m = target.position(photograph.centre_geocentric_m).unwrap();
    let lower_m = true_m[2] - fitted.centre_m[2];
    assert!((0.2..0.6).contains(&lower_m), "{lower_m}");
    // kappa is about grid north: turned by the convergence of the meridians, (lon - 9°) sin(lat)
    let kappa = fitted.angles_deg()[2];
    let convergence = (7.1_f64 - 9.0) * 50.73_f64.to_radians().sin();
    assert_abs_diff_eq!(kappa, 0.7_f64.to_degrees() + convergence, epsilon = 0.01);
    // curvature over 1.5 km is 2 to 18 cm of height, of which a plane takes most
    assert!(fitted.residual_max_px < 0.5, "{}", fitted.residual_max_px);
    assert!(fitted.residual_max_px > 1e-3, "a map grid is not Cartesian");
}

#[test]
fn a_degree_is_no_unit_to_adjust_in() {
    assert!(matches!(Target::new(Crs::parse("EPSG:4979").unwrap(), None), Err(ExportError::Geographic { .. })));
}

#[test]
fn rational_polynomials_follow_the_camera_between_the_points_they_were_fitted_to() {
    // what they cannot follow are the high powers of a lens' distortion; the perspective itself they can
    for (distorted, most_px) in [(true, 0.2), (false, 0.003)] {
        let mut photograph = photograph();
        if !distorted {
            let principal = Vector2::new(4480.0, 3025.0);
            photograph.camera = Camera::new([9000, 6000], 8000.0, principal, Brown::default()).unwrap();
        }
        let rational = Rational::fitted(&photograph).unwrap();
        assert!(rational.residual_max_px < most_px, "{}", rational.residual_max_px);
        for (x, y, height_m) in [(700.0, 450.0, 93.0), (8300.0, 5200.0, 141.0), (4000.0, 100.0, 60.0)] {
            let ground_m = photograph.ground_geocentric_m(Vector2::new(x, y), height_m).unwrap();
            let pixel = rational.pixel(Photograph::geodetic(ground_m).unwrap());
            assert_abs_diff_eq!(pixel, Vector2::new(x, y), epsilon = most_px);
        }
    }
}

#[test]
fn a_camera_above_the_horizon_is_refused() {
    let mut photograph = photograph();
    photograph.camera_from_geocentric =
        rotation::camera_from_object(1.5, 0.0, 0.0) * photograph.local().0.local_from_geocentric();
    for format in [Format::Rpc, Format::OpkCsv, Format::Manifest, Format::Footprints] {
        let refused = write(format, std::slice::from_ref(&photograph), &utm());
        assert!(matches!(refused, Err(ExportError::Horizon { .. })), "{}", format.name());
    }
}

#[test]
fn sheared_pixels_are_refused_where_there_is_no_place_for_them() {
    let mut photograph = photograph();
    let sheared = Brown { b2_px: 2.0, ..*photograph.camera.distortion().unwrap() };
    photograph.camera = Camera::new([9000, 6000], 8000.0, Vector2::new(4480.0, 3025.0), sheared).unwrap();
    for format in [Format::Orthority, Format::Colmap, Format::Opensfm] {
        let refused = write(format, std::slice::from_ref(&photograph), &utm()).unwrap_err().to_string();
        assert!(refused.contains("b2_px"), "{refused}");
    }
    write(Format::Micmac, std::slice::from_ref(&photograph), &utm()).unwrap();
}

#[test]
fn every_format_writes_files_and_has_a_word_of_its_own() {
    let mut photograph = photograph();
    photograph.camera =
        Camera::new([9000, 6000], 8000.0, Vector2::new(4480.0, 3025.0), Brown { k1: -0.01, ..Brown::default() })
            .unwrap();
    for format in Format::ALL {
        assert_eq!(Format::from_name(format.name()), Some(format));
        let files = write(format, &[photograph.clone(), photograph.clone()], &utm()).unwrap();
        assert!(!files.is_empty() && files.iter().all(|file| !file.text.contains("NaN")), "{}", format.name());
    }
}

#[test]
fn angles_of_bingo_are_of_its_own_order() {
    // R_y(phi) R_x(omega) R_z(kappa) of what was written is the matrix that was fitted
    let (photograph, target) = (photograph(), utm());
    let text = &write(Format::Bingo, std::slice::from_ref(&photograph), &target).unwrap()[0].text;
    let numbers: Vec<f64> = text.split_whitespace().skip(2).map(|field| field.parse().unwrap()).collect();
    let rad = |gon: f64| (gon * 0.9).to_radians();
    use nalgebra::Rotation3;
    let grid_from_camera = Rotation3::from_axis_angle(&Vector3::y_axis(), rad(numbers[3]))
        * Rotation3::from_axis_angle(&Vector3::x_axis(), rad(numbers[4]))
        * Rotation3::from_axis_angle(&Vector3::z_axis(), rad(numbers[5]));
    let fitted = GridOrientation::fitted(&photograph, &target).unwrap();
    assert_abs_diff_eq!(grid_from_camera.angle_to(&fitted.camera_from_grid.inverse()), 0.0, epsilon = 1e-8);
}

#[test]
fn what_is_written_for_inpho_is_read_back_as_the_same_camera() {
    let mut photograph = photograph();
    let usual = Brown { k1: -0.0468, k2: 0.0207, k3: 0.001, p1: 0.0003, p2: -0.0002, ..Brown::default() };
    for distortion in [
        usual,
        Brown { b1_px: 1.5, ..usual },
        Brown { k1: 0.02, ..Brown::default() },
        Brown { b1_px: -3.0, ..Brown::default() },
        Brown::default(),
    ] {
        photograph.camera = Camera::new([9000, 6000], 8000.0, Vector2::new(4480.0, 3025.0), distortion).unwrap();
        let mut other = photograph.clone();
        other.camera_name = "other".into();
        let files = write(Format::Inpho, &[photograph.clone(), other], &utm()).unwrap();
        let given = cameras::Given { text: &files[0].text, camera: Some("big,_one"), ..cameras::Given::default() };
        assert_eq!(cameras::Format::detect(given.text), Some(cameras::Format::Inpho));
        let read = cameras::Format::Inpho.read(&given).unwrap().conversion.camera;
        for (across, down) in (0..=8).flat_map(|across| (0..=6).map(move |down| (across, down))) {
            let pixel = photograph.camera.frame_px(f64::from(across) / 8.0, f64::from(down) / 6.0);
            let ideal = photograph.camera.ideal_from_pixel(pixel).unwrap();
            let off_px = (read.pixel_from_ideal(ideal) - pixel).norm();
            assert!(off_px < 0.05, "{distortion:?} at {pixel}: {off_px}");
        }
    }
}
