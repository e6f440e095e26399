//! Terrestrial control scenes, from raw fish-eye pictures and an aerial photograph to used control points.

use std::path::Path;

use axum::body::Body;
use axum::http::Request;
use gable::diagnosis::d_max_m;
use gable::geometry::{Brown, Camera, ExteriorOrientation, LocalFrame, rotation};
use gable::scenes::declination::declination;
use gable::simulation::{TEMPLATE_M, TerrestrialView};
use image::GrayImage;
use image::codecs::jpeg::JpegEncoder;
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use rayon::prelude::*;
use serde_json::{Value, json};
use tokio_util::sync::CancellationToken;

use crate::command_line::gable;
use crate::support::{Service, json_post};

/// Origin of the frame of all coordinates: longitude, latitude, height. North is that of its axes within a few
/// thousandths of a degree all over the image.
const ORIGIN: [f64; 3] = [9.9, 53.5, 40.0];
const DAY: [u16; 3] = [2026, 5, 1];
const AERIAL_PX: [u32; 2] = [1600, 1200];
const PRINCIPAL_DISTANCE_PX: f64 = 1600.0;
/// How much of the grey is other in the aerial photograph than it was from the pole.
const LEAVES: f64 = 12.0;

fn crs() -> String {
    let [longitude_deg, latitude_deg, height_m] = ORIGIN;
    LocalFrame::at(longitude_deg, latitude_deg, height_m).proj_string()
}

/// Evenly spread over -1 to 1, one for each cell of each seed.
fn drawn(x: i64, y: i64, seed: u64) -> f64 {
    let mut h = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
        ^ seed.wrapping_mul(0x1656_67B1_9E37_79F9);
    h = (h ^ (h >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (h >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// A standard deviation of 1, from draws of its own.
fn deviate(index: i64, seed: u64) -> f64 {
    (0..3).map(|k| drawn(index, k, seed)).sum()
}

/// A flat piece of country. Its grey value, 0 to 255, is known at each east and north.
#[derive(Clone, Copy)]
struct Country {
    seed: u64,
}

impl Country {
    /// Smooth noise in -1 to 1 with features of a given size.
    fn noise(self, at_m: Vector2<f64>, size_m: f64, layer: u64) -> f64 {
        let at = at_m / size_m;
        let cell = at.map(f64::floor);
        let ease = (at - cell).map(|t| t * t * (3.0 - 2.0 * t));
        let (x, y, seed) = (cell.x as i64, cell.y as i64, 64 * self.seed + layer);
        let along = |y: i64| drawn(x, y, seed) * (1.0 - ease.x) + drawn(x + 1, y, seed) * ease.x;
        along(y) * (1.0 - ease.y) + along(y + 1) * ease.y
    }

    /// What lies about, sharp at its edges: in most cells of a grid one turned rectangle (plates, covers, markings),
    /// which does not leave its cell.
    fn patch(self, at_m: Vector2<f64>, cell_m: f64, layer: u64) -> Option<f64> {
        let cell = (at_m / cell_m).map(f64::floor);
        let draw = |k: u64| drawn(cell.x as i64, cell.y as i64, 64 * self.seed + layer + k);
        let middle = (cell + Vector2::repeat(0.5) + 0.15 * Vector2::new(draw(0), draw(1))) * cell_m;
        let (sin, cos) = (std::f64::consts::PI * draw(2)).sin_cos();
        let from = at_m - middle;
        let half_m = Vector2::new(0.16 + 0.09 * draw(3), 0.16 + 0.09 * draw(4)) * cell_m;
        let inside = (from.x * cos + from.y * sin).abs() < half_m.x && (from.y * cos - from.x * sin).abs() < half_m.y;
        (inside && draw(5) > -0.6).then(|| 70.0 * draw(6))
    }

    fn grey(self, at_m: Vector2<f64>) -> f64 {
        let layers = [(0.05, 12.0), (0.1, 14.0), (0.2, 18.0), (0.5, 22.0), (1.0, 22.0), (3.0, 22.0)];
        let smooth: f64 =
            layers.iter().zip(0..).map(|((size_m, weight), layer)| weight * self.noise(at_m, *size_m, layer)).sum();
        let things = self.patch(at_m, 1.6, 10).or_else(|| self.patch(at_m + Vector2::new(0.3, 0.7), 0.7, 20));
        // a path of slabs winds across the country
        let from_path_m = at_m.y + 6.0 * (at_m.x / 9.0).sin();
        let slab = (at_m / 0.5).map(f64::floor);
        let path = (from_path_m.abs() < 1.1).then(|| 25.0 + 25.0 * drawn(slab.x as i64, slab.y as i64, self.seed));
        (125.0 + smooth + things.or(path).unwrap_or(0.0)).clamp(0.0, 255.0)
    }
}

/// An aerial camera above the country, and what is thought of where it is.
struct Flight {
    camera: Camera,
    truth: ExteriorOrientation,
}

impl Flight {
    fn new() -> Self {
        let camera =
            Camera::new(AERIAL_PX, PRINCIPAL_DISTANCE_PX, Vector2::new(806.0, 595.0), Brown::default()).unwrap();
        let [omega, phi, kappa] = [2.4_f64, -3.1, 40.0].map(f64::to_radians);
        let truth = ExteriorOrientation {
            projection_centre_m: Vector3::new(3.0, -4.0, 96.0),
            camera_from_object: rotation::camera_from_object(omega, phi, kappa),
        };
        Self { camera, truth }
    }

    fn camera_body(&self) -> Value {
        let [x, y]: [f64; 2] = self.camera.principal_point_px().into();
        json!({"name": "aerial", "image_size_px": AERIAL_PX, "principal_distance_px": self.camera.principal_distance_px,
               "principal_point_px": [x, y], "distortion": {"model": "brown"}})
    }

    /// Off by 2 m and more than a degree, as it says.
    fn approximation_body(&self) -> Value {
        let [omega, phi, kappa] = rotation::angles(&self.truth.camera_from_object).map(f64::to_degrees);
        let position: [f64; 3] = (self.truth.projection_centre_m + Vector3::new(1.4, -1.7, 1.9)).into();
        json!({"position": {"crs": crs(), "coordinates": position}, "sigma_position_m": [2.0, 2.0, 2.0],
               "omega_deg": omega - 1.3, "phi_deg": phi + 1.1, "kappa_deg": kappa + 1.8,
               "sigma_tilt_deg": 1.5, "sigma_kappa_deg": 2.0})
    }

    fn ground_m(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let reduced_px = self.camera.reduced_from_pixel(pixel)?;
        Some(self.truth.ground_point_m(self.camera.principal_distance_px, reduced_px, 0.0)?.xy())
    }

    fn pixel(&self, ground_m: Vector2<f64>) -> Vector2<f64> {
        self.truth.pixel(&self.camera, ground_m.push(0.0)).unwrap()
    }

    /// The photograph as a JPEG: paler and darker than the ground is from near by, and noisy. It was taken on another day:
    /// leaves have fallen since.
    fn photograph(&self, country: Country) -> Vec<u8> {
        const SAMPLES: u32 = 3;
        let [width, height] = AERIAL_PX;
        let grey = |index: u32| {
            let corner = Vector2::new(f64::from(index % width), f64::from(index / width));
            let offset = |k: u32| (f64::from(k) + 0.5) / f64::from(SAMPLES);
            let samples = (0..SAMPLES * SAMPLES).map(|k| {
                let pixel = corner + Vector2::new(offset(k % SAMPLES), offset(k / SAMPLES));
                let at_m = self.ground_m(pixel).unwrap();
                country.grey(at_m) + LEAVES * country.noise(at_m, 0.2, 40)
            });
            let mean = samples.sum::<f64>() / f64::from(SAMPLES * SAMPLES);
            (20.0 + 0.65 * mean + 2.0 * deviate(i64::from(index), 77)).round().clamp(0.0, 255.0) as u8
        };
        let pixels: Vec<u8> = (0..width * height).into_par_iter().map(grey).collect();
        let mut file = Vec::new();
        let picture = GrayImage::from_raw(width, height, pixels).unwrap();
        JpegEncoder::new_with_quality(&mut file, 90).encode_image(&picture).unwrap();
        file
    }
}

/// A place where a camera was raised on a pole.
struct Place {
    name: &'static str,
    /// Where in the aerial image the template's corner lies, roughly.
    about_px: [f64; 2],
    height_m: f64,
    omega_phi_rad: [f64; 2],
    kappa_rad: f64,
    plate_height_m: f64,
    /// The arm that was laid along the compass needle, or away from it by so much.
    arm: &'static str,
    bearing_deg: f64,
    /// What the compass erred by.
    compass_deg: f64,
    /// Where in the template's frame the point with known coordinates lies.
    reference_at_m: [f64; 2],
}

#[rustfmt::skip]
const PLACES: [Place; 7] = [
    Place { name: "gate", about_px: [260.0, 220.0], height_m: 4.0, omega_phi_rad: [0.05, -0.035], kappa_rad: 0.6,
            plate_height_m: 0.0, arm: "y", bearing_deg: 0.0, compass_deg: 1.4, reference_at_m: [0.0, 0.0] },
    Place { name: "yard", about_px: [810.0, 180.0], height_m: 4.3, omega_phi_rad: [-0.03, 0.06], kappa_rad: 2.7,
            plate_height_m: 0.0, arm: "x", bearing_deg: 0.0, compass_deg: -2.1, reference_at_m: [0.0, 0.0] },
    Place { name: "kerb", about_px: [1370.0, 270.0], height_m: 3.8, omega_phi_rad: [0.02, 0.04], kappa_rad: -1.2,
            plate_height_m: 0.12, arm: "y", bearing_deg: 75.0, compass_deg: 0.6, reference_at_m: [0.0, 0.0] },
    Place { name: "well", about_px: [230.0, 930.0], height_m: 4.1, omega_phi_rad: [-0.06, -0.02], kappa_rad: -2.5,
            plate_height_m: 0.0, arm: "y", bearing_deg: 214.0, compass_deg: -1.0, reference_at_m: [0.8, 0.0] },
    Place { name: "path", about_px: [760.0, 1010.0], height_m: 4.0, omega_phi_rad: [0.0, 0.05], kappa_rad: 1.4,
            plate_height_m: 0.08, arm: "x", bearing_deg: 310.0, compass_deg: 2.2, reference_at_m: [0.0, 0.4] },
    Place { name: "field", about_px: [1340.0, 940.0], height_m: 4.4, omega_phi_rad: [0.04, 0.03], kappa_rad: 0.1,
            plate_height_m: 0.0, arm: "y", bearing_deg: 0.0, compass_deg: -0.3, reference_at_m: [0.0, 0.0] },
    Place { name: ELSEWHERE, about_px: [930.0, 600.0], height_m: 4.0, omega_phi_rad: [0.05, -0.03], kappa_rad: 0.8,
            plate_height_m: 0.0, arm: "y", bearing_deg: 0.0, compass_deg: 1.0, reference_at_m: [0.0, 0.0] },
];

/// The scene that the image does not show.
const ELSEWHERE: &str = "elsewhere";

impl Place {
    fn view(&self, corner_m: Vector2<f64>) -> TerrestrialView {
        let [longitude_deg, latitude_deg, height_m] = ORIGIN;
        let north = declination(longitude_deg, latitude_deg, height_m, DAY).unwrap().declination_rad;
        let arm_deg = if self.arm == "x" { -90.0 } else { 0.0 };
        TerrestrialView {
            height_m: self.height_m,
            omega_phi_rad: self.omega_phi_rad,
            kappa_rad: self.kappa_rad,
            azimuth_of_y_rad: north + (self.bearing_deg + arm_deg + self.compass_deg).to_radians(),
            corner_m,
            plate_height_m: self.plate_height_m,
            ..TerrestrialView::from_a_pole(1600).unwrap()
        }
    }

    /// `gable scene rectify` with what was measured in the field: PNG and JSON of the scene.
    fn rectified(&self, folder: &Path, view: &TerrestrialView, country: Country, seed: u64) -> [Vec<u8>; 2] {
        let named = |ending: &str| format!("{}{ending}", self.name);
        let [width, height] = view.camera.size_px();
        // far away the ground is plain: it is not rectified, and takes half of the time
        let near = |at_m: &Vector2<f64>| (at_m - view.corner_m).norm() < 8.0;
        let ground = |at_m| Some(at_m).filter(near).map_or(125.0, |at_m| country.grey(at_m));
        let picture = view.photograph(&ground, seed);
        GrayImage::from_raw(width, height, picture).unwrap().save(folder.join(named(".png"))).unwrap();
        let targets = TerrestrialView::targets_body(&view.targets(&TEMPLATE_M, 0.3, seed));
        std::fs::write(folder.join(named(".target.json")), targets.to_string()).unwrap();
        std::fs::write(folder.join("fisheye.json"), view.camera_body().to_string()).unwrap();
        // by GNSS, within a few centimetres
        let [east_m, north_m]: [f64; 2] = self.reference_m(view).into();
        let [dx, dy, dz] = [1, 2, 3].map(|axis| 0.02 * deviate(axis, seed));
        let reference = format!("{:.3},{:.3},{dz:.3}", east_m + dx, north_m + dy);
        let [x, y] = self.reference_at_m;
        let (at, bearing) = (format!("{x},{y}"), self.bearing_deg.to_string());
        let (plate, [year, month, day]) = (self.plate_height_m.to_string(), DAY);
        let (date, crs) = (format!("{year}-{month:02}-{day:02}"), crs());
        let (picture, targets) = (named(".png"), named(".target.json"));
        let files = ["scene", "rectify", &picture, "--camera", "fisheye.json", "--target", &targets, "--out", "scenes"];
        let point = ["--name", self.name, "--crs", &crs, "--reference", &reference, "--reference-at-m", &at];
        let compass = ["--magnetic", "--date", &date, "--arm", self.arm, "--bearing-deg", &bearing];
        let rest = ["--sigma-px", "0.3", "--plate-height-m", &plate, "--size-m", "9"];
        let output = gable(folder, &[&files[..], &point, &compass, &rest].concat()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        ["png", "json"].map(|ending| std::fs::read(folder.join(format!("scenes/{}.{ending}", self.name))).unwrap())
    }

    /// Where the point with known coordinates really lies.
    fn reference_m(&self, view: &TerrestrialView) -> Vector2<f64> {
        view.ground_m(self.reference_at_m.into())
    }
}

fn scene_post(file: &[u8], scene: &[u8]) -> Request<Body> {
    let mut body = Vec::new();
    for (name, content) in [("file", file), ("scene", scene)] {
        let head = format!("--xyzzy\r\ncontent-disposition: form-data; name=\"{name}\"; filename=\"{name}\"\r\n\r\n");
        body.extend_from_slice(head.as_bytes());
        body.extend_from_slice(content);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(b"--xyzzy--\r\n");
    let post = Request::post("/api/v1/control-scenes").header("content-type", "multipart/form-data; boundary=xyzzy");
    post.body(Body::from(body)).unwrap()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    serde_json::from_value::<Vec<f64>>(value.clone()).unwrap().try_into().unwrap()
}

/// The orientation of a result whose frame is that of its coordinates.
fn orientation(result: &Value) -> ExteriorOrientation {
    assert_eq!(result["rotation"]["frame"], crs());
    let rows: [[f64; 3]; 3] = serde_json::from_value(result["rotation"]["rotation_matrix"].clone()).unwrap();
    ExteriorOrientation {
        projection_centre_m: numbers::<3>(&result["projection_centre"]["coordinates"]).into(),
        camera_from_object: Rotation3::from_matrix_unchecked(Matrix3::from_fn(|row, column| rows[row][column])),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn terrestrial_pictures_orient_an_aerial_photograph_of_the_same_ground() {
    let (country, unlike) = (Country { seed: 5 }, Country { seed: 6 });
    let flight = Flight::new();
    let service = Service::with(|configuration| configuration.wait_max_s = 60).await;
    service.state.jobs.prepare().await.unwrap();
    let stop = CancellationToken::new();
    let (jobs, stopped) = (service.state.jobs.clone(), stop.clone());
    tokio::spawn(async move { jobs.run(stopped).await });
    let _guard = stop.drop_guard();

    // in the field and at the desk
    let folder = tempfile::tempdir().unwrap();
    let mut truth_px = Vec::new();
    for (place, seed) in PLACES.iter().zip(1..) {
        let corner_m = flight.ground_m(place.about_px.into()).unwrap().map(|v| v.round());
        let view = place.view(corner_m);
        let shown = if place.name == ELSEWHERE { unlike } else { country };
        let [picture, scene] = place.rectified(folder.path(), &view, shown, seed);
        let posted = service.send(scene_post(&picture, &scene)).await;
        assert_eq!(posted.status, 201, "{:?}", posted.body);
        truth_px.push(flight.pixel(place.reference_m(&view)));
    }

    // in the air
    let uploaded = service.upload("image/jpeg", flight.photograph(country)).await;
    assert_eq!(uploaded.status, 201, "{:?}", uploaded.body);
    assert_eq!(service.post("/api/v1/cameras", &flight.camera_body()).await.status, 201);
    let wanted = json!({"image": uploaded.json()["id"], "camera": "aerial", "control": "scenes",
                        "approximation": flight.approximation_body()});
    let mut request = json_post("/api/v1/orientations", &wanted);
    request.headers_mut().insert("prefer", "wait=60".parse().unwrap());
    let answer = service.send(request).await;
    assert_eq!(answer.status, 200, "{:?}", answer.body);
    assert_eq!(answer.json()["status"], "succeeded", "{:?}", answer.body);
    let result = &answer.json()["result"];

    // each was found where it is, and what the image does not show was not
    let told = format!("{:#}\n{:#}", result["control_points"], result["diagnosis"]);
    let points = result["control_points"].as_array().unwrap();
    assert_eq!(points.len(), PLACES.len(), "{told}");
    let mut used = 0;
    for (place, truth_px) in PLACES.iter().zip(&truth_px) {
        let point = points.iter().find(|point| point["name"] == place.name).unwrap_or_else(|| panic!("{told}"));
        assert_eq!(point["kind"], "scene", "{told}");
        if point["used"] != true {
            continue;
        }
        assert_ne!(place.name, ELSEWHERE, "{told}");
        let off_px = (Vector2::from(numbers::<2>(&point["located_px"])) - truth_px).norm();
        let predicted_px = (Vector2::from(numbers::<2>(&point["predicted_px"])) - truth_px).norm();
        assert!(predicted_px > 10.0, "{}: the approximation was as good; {told}", place.name);
        assert!(off_px < 1.0, "{}: {off_px} px; {told}", place.name);
        used += 1;
    }
    assert!(used >= 5, "{used} used: {told}");

    // and so the image is oriented
    let found = orientation(result);
    let from_truth_m = (found.projection_centre_m - flight.truth.projection_centre_m).norm();
    let ground_m = d_max_m(&flight.camera, &found, &flight.truth, 0.0).unwrap();
    assert!(from_truth_m < 0.5, "{from_truth_m} m; {told}");
    // ten ground sample distances of 6 cm are what is tolerated by default
    assert!(ground_m < 0.6, "{ground_m} m; {told}");
    assert_ne!(result["diagnosis"]["verdict"], "red", "{told}");
}
