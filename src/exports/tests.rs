//! Against closed forms here; against the software that reads the files in `tests/exports`.

use approx::assert_abs_diff_eq;
use nalgebra::{Matrix3, Vector2, Vector3};

use super::*;
use crate::cameras;
use crate::geometry::{Brown, Camera, Film, LocalFrame, PixelFromPlate, Smac, rotation};

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
        sigma: None,
        judgement: Judgement::default(),
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
        let second = Photograph { name: "bonn 2.tif".into(), ..photograph.clone() };
        let files = write(format, &[photograph.clone(), second], &utm()).unwrap();
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
        let other = Photograph { name: "2.tif".into(), camera_name: "other".into(), ..photograph.clone() };
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

/// The photograph with other pixels and another lens.
fn with_lens(distortion: Brown) -> Photograph {
    let camera = Camera::new([4000, 3000], 3000.0, Vector2::new(2010.0, 1490.0), distortion).unwrap();
    Photograph { camera, ..photograph() }
}

/// Ideal coordinates of pixels all over the frame.
fn ideal_of_pixels(camera: &Camera) -> Vec<(Vector2<f64>, Vector2<f64>)> {
    let places = (0..=8).flat_map(|across| (0..=6).map(move |down| (f64::from(across) / 8.0, f64::from(down) / 6.0)));
    let pixels = places.map(|(across, down)| camera.frame_px(across, down));
    pixels.map(|pixel| (pixel, camera.ideal_from_pixel(pixel).unwrap())).collect()
}

#[test]
fn rational_polynomials_of_level_ground_hold_above_and_below_it() {
    for relief_m in [0.0, 0.01] {
        let photograph = Photograph { relief_m, ..photograph() };
        let rational = Rational::fitted(&photograph).unwrap();
        for height_m in [110.0, 110.01, 113.0, 106.0, 130.0] {
            let pixel = Vector2::new(700.0, 5450.0);
            let ground_m = photograph.ground_geocentric_m(pixel, height_m).unwrap();
            let off_px = (rational.pixel(Photograph::geodetic(ground_m).unwrap()) - pixel).norm();
            assert!(off_px < 0.2, "{relief_m} m, at {height_m} m: {off_px}");
        }
    }
}

#[test]
fn a_grid_that_is_no_cartesian_frame_is_refused_and_one_that_nearly_is_says_what_is_lost() {
    let photographs = [photograph()];
    let mercator = Target::new(Crs::parse("EPSG:3857").unwrap(), None).unwrap();
    for format in [Format::Patb, Format::OpkCsv, Format::Pix4d, Format::Esri] {
        let refused = write(format, &photographs, &mercator).unwrap_err();
        let ExportError::PoorFit { residual_px, .. } = refused else { panic!("{refused}") };
        assert!(residual_px > MOST_RESIDUAL_PX);
        assert!(refused.to_string().contains("UTM"), "{refused}");
    }
    // they need no grid
    for format in [Format::Rpc, Format::Footprints, Format::Manifest] {
        write(format, &photographs, &mercator).unwrap();
    }
    let fitted = GridOrientation::fitted(&photographs[0], &utm()).unwrap();
    let stated = |format| residual_max_px(format, &photographs, &utm()).unwrap();
    assert_eq!(stated(Format::Patb), Some(fitted.residual_max_px));
    assert!(stated(Format::Inpho).unwrap() > fitted.residual_max_px, "the lens' polynomials lose something too");
    assert!(stated(Format::Rpc).unwrap() < 0.2);
    assert_eq!(stated(Format::Micmac), None);
}

#[test]
fn the_cameras_table_of_arcgis_leads_back_to_the_camera() {
    let usual = Brown { k1: -0.03, p1: 0.0001, p2: -0.00005, ..Brown::default() };
    for distortion in [usual, Brown { b1_px: 3.0, ..usual }, Brown { b1_px: -3.0, ..Brown::default() }] {
        let photograph = with_lens(distortion);
        let files = write(Format::Esri, std::slice::from_ref(&photograph), &utm()).unwrap();
        // the camera's name has a comma and is quoted
        let row = files[1].text.lines().nth(1).unwrap().strip_prefix("1,\"big, one\",").unwrap();
        let fields: Vec<&str> = row.split(',').collect();
        let number = |index: usize| fields[index].parse::<f64>().unwrap();
        let numbers = |index: usize| fields[index].split(';').map(|k| k.parse().unwrap()).collect::<Vec<f64>>();
        let (k, p) = (numbers(14), numbers(15));
        for (pixel, ideal) in ideal_of_pixels(&photograph.camera) {
            let (column, row) = (pixel.x - 0.5, pixel.y - 0.5);
            let x = number(6) + number(7) * column + number(8) * row;
            let y = number(9) + number(10) * column + number(11) * row;
            let r2 = x * x + y * y;
            let radial = k[0] + k[1] * r2 + k[2] * r2.powi(2) + k[3] * r2.powi(3);
            let at = Vector2::new(
                x + x * radial + p[0] * (r2 + 2.0 * x * x) + 2.0 * p[1] * x * y,
                -(y + y * radial + p[1] * (r2 + 2.0 * y * y) + 2.0 * p[0] * x * y),
            ) / number(0);
            let off_px = (photograph.camera.pixel_from_ideal(at) - pixel).norm();
            assert!(off_px < 0.05, "{distortion:?} at {pixel}: {off_px}, {ideal}");
        }
    }
}

#[test]
fn tables_for_arcgis_keep_the_names_of_the_files() {
    let photograph = Photograph { name: "bonn, 1 \"a\".tif".into(), ..photograph() };
    let frames = &write(Format::Esri, &[photograph], &utm()).unwrap()[0].text;
    assert!(frames.contains("\n1,\"bonn, 1 \"\"a\"\".tif\",\"big, one\","), "{frames}");
}

#[test]
fn the_manifest_states_the_corrections_that_are_written() {
    let photograph = with_lens(Brown { k1: -0.05, b1_px: 3.0, ..Brown::default() });
    let manifest = &write(Format::Manifest, std::slice::from_ref(&photograph), &utm()).unwrap()[0].text;
    let manifest: serde_json::Value = serde_json::from_str(manifest).unwrap();
    let stated = &manifest["photographs"][0]["camera"]["photogrammetric_corrections"];
    let written = interior::Corrections::of(&photograph, Format::Inpho).unwrap();
    assert_eq!(stated["residual_max_px"], written.residual_max_px);
    assert_eq!(stated["k0_to_k3"][1], written.radial[1]);
    // three of 3003 pixels
    assert_abs_diff_eq!(stated["pixel_mm"][0].as_f64().unwrap(), 0.006 * 3000.0 / 3003.0, epsilon = 1e-12);
    assert!(written.residual_max_px < 0.05, "{}", written.residual_max_px);
}

#[test]
fn a_lens_that_bends_more_than_polynomials_do_is_refused() {
    let [strong, too_strong] = [
        with_lens(Brown { k1: -0.267, k2: 0.11, k3: -0.02, ..Brown::default() }),
        with_lens(Brown { k1: -0.4, k2: 0.2, k3: -0.02, ..Brown::default() }),
    ];
    for format in [Format::Inpho, Format::Esri] {
        write(format, std::slice::from_ref(&strong), &utm()).unwrap();
        let refused = write(format, std::slice::from_ref(&too_strong), &utm()).unwrap_err().to_string();
        assert!(refused.contains("orthority") && refused.contains("1.8 px"), "{refused}");
    }
}

/// The pixel by Fraser's model as MicMac's file has it.
fn micmac_px(text: &str, ideal: Vector2<f64>) -> Vector2<f64> {
    let all = |tag: &str| -> Vec<f64> {
        let head = format!("<{tag}>");
        let inside = text.split(&head).skip(1).map(|rest| rest.split('<').next().unwrap());
        inside.flat_map(|numbers| numbers.split(' ').map(|number| number.parse().unwrap())).collect()
    };
    let (k, centre, focal) = (all("CoeffDist"), all("CDist"), all("F")[0]);
    let (p1, p2, b1, b2) = (all("P1")[0], all("P2")[0], all("b1")[0], all("b2")[0]);
    let (x, y) = (ideal.x * focal, ideal.y * focal);
    let r2 = x * x + y * y;
    let radial = k[0] * r2 + k[1] * r2.powi(2) + k[2] * r2.powi(3);
    Vector2::new(
        centre[0] + x + x * radial + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y + b1 * x + b2 * y,
        centre[1] + y + y * radial + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y,
    )
}

#[test]
fn the_calibration_of_micmac_is_the_camera_or_is_refused() {
    let usual = Brown { k1: -0.05, k2: 0.01, k3: -0.001, p1: 0.0003, p2: -0.0002, ..Brown::default() };
    let strong = Brown { k1: -0.267, k2: 0.11, ..Brown::default() };
    for distortion in
        [usual, strong, Brown { b1_px: 1.5, b2_px: -0.5, ..usual }, Brown { b1_px: 5.0, ..Brown::default() }]
    {
        let photograph = with_lens(distortion);
        let files = write(Format::Micmac, std::slice::from_ref(&photograph), &utm()).unwrap();
        for (pixel, ideal) in ideal_of_pixels(&photograph.camera) {
            let off_px = (micmac_px(&files[0].text, ideal) - pixel).norm();
            assert!(off_px < 0.05, "{distortion:?} at {pixel}: {off_px}");
        }
    }
    let refused = write(Format::Micmac, &[with_lens(Brown { b1_px: 5.0, ..strong })], &utm()).unwrap_err().to_string();
    assert!(refused.contains("b1_px") && refused.contains("rpc"), "{refused}");
}

#[test]
fn names_that_would_become_one_are_refused() {
    let named = |name: &str, camera: &str| Photograph { name: name.into(), camera_name: camera.into(), ..photograph() };
    let square = Brown { k1: -0.05, ..Brown::default() };
    let other_lens = |name: &str, camera: &str| Photograph { camera: with_lens(square).camera, ..named(name, camera) };
    for (format, first, second, told) in [
        (Format::Rpc, named("a.jpg", "c"), named("a.tif", "c"), ["a.jpg", "a.tif"]),
        (Format::Inpho, named("a.jpg", "c"), named("a.tif", "c"), ["a.jpg", "a.tif"]),
        (Format::Micmac, named("a b.jpg", "c"), named("a_b.jpg", "c"), ["a b.jpg", "a_b.jpg"]),
        (Format::Micmac, named("a.jpg", "cam 1"), named("b.jpg", "cam_1"), ["cam 1", "cam_1"]),
        (Format::Orthority, named("a.jpg", "c"), other_lens("b.jpg", "c"), ["c", "c"]),
        (Format::OpkCsv, named("a.jpg", "c"), named("a.jpg", "c"), ["a.jpg", "a.jpg"]),
    ] {
        let refused = write(format, &[first, second], &utm()).unwrap_err().to_string();
        let start = format!("{:?} and {:?} would both be called", told[0], told[1]);
        assert!(refused.starts_with(&start), "{refused}");
    }
    let two = [named("a.jpg", "c"), named("a.tif", "c")];
    for format in [Format::OpkCsv, Format::Micmac, Format::Colmap] {
        write(format, &two, &utm()).unwrap();
    }
}

#[test]
fn scans_of_film_are_refused_for_what_they_are_not_for_the_name_of_their_camera() {
    let film = Film {
        principal_distance_mm: 153.0,
        principal_point_mm: Vector2::zeros(),
        symmetry_point_mm: Vector2::zeros(),
        distortion: Smac::default(),
        format_mm: [226.0, 226.0],
    };
    let scan = |name: &str, px_per_mm: f64| {
        let laying = Matrix3::new(px_per_mm, 0.0, 2500.0, 0.0, -px_per_mm, 2500.0, 0.0, 0.0, 1.0);
        let camera = Camera::of_scan([5000, 5000], &film, &PixelFromPlate::new(&laying).unwrap()).unwrap();
        Photograph { name: name.into(), camera_name: "RC30".into(), camera, ..photograph() }
    };
    let scans = [scan("1.tif", 20.0), scan("2.tif", 20.001)];
    for format in [Format::Micmac, Format::Inpho, Format::Orthority, Format::Esri] {
        let refused = write(format, &scans, &utm());
        assert!(matches!(refused, Err(ExportError::Camera { .. })), "{}: {refused:?}", format.name());
    }
    write(Format::Patb, &scans, &utm()).unwrap();
}

#[test]
fn two_cameras_for_pix4d_are_read_back_as_two() {
    let lens = |k1: f64| Brown { k1, k2: 0.01, p1: 0.0003, p2: -0.0002, ..Brown::default() };
    let mut other = Photograph { name: "b.jpg".into(), camera_name: "small".into(), ..with_lens(lens(-0.03)) };
    other.pixel_size_mm = 0.004;
    let photographs = [with_lens(lens(-0.05)), other];
    let text = &write(Format::Pix4d, &photographs, &utm()).unwrap()[1].text;
    for (camera, photograph) in ["0", "1"].into_iter().zip(&photographs) {
        let given = cameras::Given {
            text,
            camera: Some(camera),
            image_size_px: Some([4000, 3000]),
            ..cameras::Given::default()
        };
        let read = cameras::Format::Pix4d.read(&given).unwrap().conversion.camera;
        for (pixel, ideal) in ideal_of_pixels(&photograph.camera) {
            assert_abs_diff_eq!(read.pixel_from_ideal(ideal), pixel, epsilon = 0.01);
        }
    }
    // as it was once written, with one head for both
    let merged = text.replacen("Pix4D camera calibration file 1\n", "", 1);
    let given = cameras::Given { text: &merged, image_size_px: Some([4000, 3000]), ..cameras::Given::default() };
    let refused = cameras::Format::Pix4d.read(&given).unwrap_err().to_string();
    assert!(refused.contains("F is given twice"), "{refused}");
}

#[test]
fn an_undulation_that_would_change_nothing_is_refused() {
    let frame = Crs::parse("+proj=topocentric +ellps=WGS84 +lon_0=7.1 +lat_0=50.7 +h_0=0").unwrap();
    assert!(matches!(
        Target::new(frame.clone(), Some(46.0)),
        Err(ExportError::Crs(CrsError::UndulationWithoutHeight { .. }))
    ));
    assert!(Target::new(frame, None).is_ok());
    assert!(Target::new(Crs::parse("EPSG:25832").unwrap(), Some(46.0)).is_ok());
}

#[test]
fn the_manifest_says_what_is_thought_of_a_photograph_and_whose_axes_its_sigmas_have() {
    let sigma = Sigma {
        frame: "EPSG:25832".into(),
        projection_centre_m: [0.1, 0.2, 0.3],
        omega_phi_kappa_rad: [1e-4, 2e-4, 3e-5],
    };
    let judgement = Judgement { verdict: Some("red".into()), review: Some("accepted".into()) };
    assert_eq!(judgement.warning(), None);
    let photograph = Photograph { sigma: Some(sigma), judgement, ..photograph() };
    let manifest = &write(Format::Manifest, &[photograph], &utm()).unwrap()[0].text;
    let manifest: serde_json::Value = serde_json::from_str(manifest).unwrap();
    let told = &manifest["photographs"][0];
    assert_eq!((&told["verdict"], &told["review"]), (&"red".into(), &"accepted".into()));
    assert_eq!(told["sigma"]["frame"], "EPSG:25832");
    assert_eq!(told["sigma"]["omega_phi_kappa_rad"][2], 3e-5);
}

/// The photograph over another place.
fn at(longitude_deg: f64, latitude_deg: f64) -> Photograph {
    let frame = LocalFrame::at(longitude_deg, latitude_deg, 2150.0);
    let camera_from_local = rotation::camera_from_object(0.05, -0.03, 0.7);
    Photograph {
        centre_geocentric_m: frame.to_geocentric(Vector3::zeros()),
        camera_from_geocentric: camera_from_local * frame.local_from_geocentric(),
        ..photograph()
    }
}

#[test]
fn footprints_are_cut_at_the_antimeridian() {
    let geometry = |photograph: Photograph| -> serde_json::Value {
        let text = &write(Format::Footprints, &[photograph], &utm()).unwrap()[0].text;
        serde_json::from_str::<serde_json::Value>(text).unwrap()["features"][0]["geometry"].clone()
    };
    let ring = |value: &serde_json::Value| serde_json::from_value::<Vec<[f64; 3]>>(value[0].clone()).unwrap();
    let area = |ring: &[[f64; 3]]| {
        let sides = ring.windows(2).map(|side| side[0][0] * side[1][1] - side[1][0] * side[0][1]);
        sides.sum::<f64>() / 2.0
    };
    let whole = geometry(at(7.0, -17.0));
    assert_eq!(whole["type"], "Polygon");
    let whole = area(&ring(&whole["coordinates"]));
    for longitude_deg in [180.0, 179.999, -179.997] {
        let cut = geometry(at(longitude_deg, -17.0));
        assert_eq!(cut["type"], "MultiPolygon", "{longitude_deg}");
        let rings: Vec<_> = cut["coordinates"].as_array().unwrap().iter().map(ring).collect();
        assert_eq!(rings.len(), 2);
        for ring in &rings {
            assert_eq!(ring.first(), ring.last());
            assert!(area(ring) > 0.0, "counter-clockwise");
            let (least, most) =
                ring.iter().fold((f64::INFINITY, -f64::INFINITY), |(a, b), p| (a.min(p[0]), b.max(p[0])));
            assert!(most - least < 0.05 && least >= -180.0 && most <= 180.0, "{least} to {most}");
        }
        assert_abs_diff_eq!(rings.iter().map(|ring| area(ring)).sum::<f64>(), whole, epsilon = 1e-3 * whole);
    }
}

#[test]
fn rational_polynomials_cross_the_antimeridian() {
    let photograph = at(179.999, -17.0);
    let rational = Rational::fitted(&photograph).unwrap();
    for pixel in [Vector2::new(100.0, 100.0), Vector2::new(8900.0, 100.0), Vector2::new(4000.0, 5900.0)] {
        let ground_m = photograph.ground_geocentric_m(pixel, 110.0).unwrap();
        let off_px = (rational.pixel(Photograph::geodetic(ground_m).unwrap()) - pixel).norm();
        assert!(off_px < 0.2, "{pixel}: {off_px}");
    }
}
