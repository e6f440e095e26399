//! A flat country for the tests, whose grey values are known everywhere; photographs and scenes of it.

use nalgebra::{Vector2, Vector3};

use super::keys::ImageKey;
use super::*;
use crate::estimation::simulated::Draws;
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};
use crate::geometry::{Brown, Camera, ExteriorOrientation, rotation};

/// Sums of waves of many lengths and directions, cut by thresholds: blobs with edges.
pub(crate) struct Country {
    waves: Vec<(Vector2<f64>, f64, f64)>,
}

impl Country {
    pub(crate) fn new(seed: u64) -> Self {
        let mut draws = Draws::new(seed);
        let wave = |k: usize, draws: &mut Draws| {
            let length_m = 0.35 * 1.13_f64.powi((k / 3) as i32);
            let direction = draws.even(0.0, std::f64::consts::TAU);
            let (sin, cos) = direction.sin_cos();
            let number = std::f64::consts::TAU / length_m;
            (Vector2::new(cos, sin) * number, draws.even(0.0, std::f64::consts::TAU), length_m.sqrt())
        };
        Self { waves: (0..90).map(|k| wave(k, &mut draws)).collect() }
    }

    pub(crate) fn grey(&self, at_m: Vector2<f64>) -> f64 {
        let sum: f64 = self.waves.iter().map(|(k, phase, height)| height * (k.dot(&at_m) + phase).sin()).sum();
        128.0 + 90.0 * (sum / 6.0).tanh()
    }

    /// A square scene about a place, its picture turned by an azimuth.
    pub(crate) fn scene(&self, at_m: Vector2<f64>, gsd_m: f64, side_m: f64, azimuth_rad: f64) -> Scene {
        let side = (side_m / gsd_m) as usize;
        let mut scene = Scene {
            width: side,
            height: side,
            grey: Vec::with_capacity(side * side),
            gsd_m,
            azimuth_of_image_up_rad: azimuth_rad,
            sigma_azimuth_rad: 0.05,
            reference_px: Vector2::new(side as f64 / 2.0 + 7.3, side as f64 / 2.0 - 4.6),
        };
        for k in 0..side * side {
            let pixel = Vector2::new((k % side) as f64 + 0.5, (k / side) as f64 + 0.5);
            scene.grey.push(self.grey(at_m + scene.ground_from_pixel_m(pixel)) as f32);
        }
        scene
    }
}

/// A picture in memory.
pub(crate) struct Drawn {
    size_px: [u32; 2],
    grey: Vec<f32>,
}

impl Drawn {
    pub(crate) fn photograph(
        country: &Country,
        camera: &Camera,
        orientation: &ExteriorOrientation,
        sigma_grey: f64,
        seed: u64,
    ) -> Self {
        let mut draws = Draws::new(1000 + seed);
        let [width, height] = [camera.width_px, camera.height_px];
        let mut grey = Vec::with_capacity((width * height) as usize);
        for k in 0..width * height {
            let pixel = Vector2::new(f64::from(k % width) + 0.5, f64::from(k / width) + 0.5);
            let reduced = camera.reduced_from_pixel(pixel).unwrap();
            let ground = orientation.ground_point_m(camera.principal_distance_px, reduced, 0.0).unwrap();
            // another light than that of the scene
            let light = 20.0 + 0.8 * country.grey(ground.xy());
            grey.push((light + sigma_grey * draws.normal()).clamp(0.0, 255.0) as f32);
        }
        Self { size_px: [width, height], grey }
    }
}

impl Picture for Drawn {
    fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
        assert_eq!(reduction, 1);
        let [right, below] = [(rect.x + rect.width).min(self.size_px[0]), (rect.y + rect.height).min(self.size_px[1])];
        let [width, height] = [right.saturating_sub(rect.x) as usize, below.saturating_sub(rect.y) as usize];
        let row = |y: u32| {
            let first = (y * self.size_px[0] + rect.x) as usize;
            &self.grey[first..first + width]
        };
        let grey = (rect.y..below).flat_map(row).copied().collect();
        Ok(GreyWindow { origin_px: [rect.x, rect.y], reduction: 1, width, height, grey })
    }
}

fn camera() -> Camera {
    Camera::new([1100, 900], 1000.0, Vector2::new(550.0, 450.0), Brown::default()).unwrap()
}

fn truth() -> ExteriorOrientation {
    ExteriorOrientation {
        projection_centre_m: Vector3::new(2.0, -1.0, 100.0),
        camera_from_object: rotation::camera_from_object(0.04, -0.05, 2.2),
    }
}

/// Scenes are found where they are, whatever is thought of heading and position; the turn is that of the thought.
#[test]
fn a_scene_is_seen_where_it_is() {
    let (camera, country) = (camera(), Country::new(8));
    let picture = Drawn::photograph(&country, &camera, &truth(), 3.0, 1);
    let mut image = ImageKeys::new(&picture, &camera, 1);
    image.cover(&[[Vector2::zeros(), Vector2::new(1100.0, 900.0)]]).unwrap();
    let reference_m = Vector3::new(9.0, -6.0, 0.0);
    let scene = country.scene(reference_m.xy(), 0.06, 18.0, -0.6);
    let true_px = truth().reduced_px(1000.0, reference_m).unwrap();
    for (turn_rad, known) in [(0.0, true), (0.1, true), (1.5, false), (-2.8, false)] {
        let thought = ExteriorOrientation {
            camera_from_object: rotation::camera_from_object(0.02, -0.03, 2.2 - turn_rad),
            ..truth()
        };
        let view = View { camera: &camera, orientation: &thought, reference_m };
        let gate = Gate {
            predicted_px: view.reduced_from_ground(Vector2::zeros()).unwrap(),
            covariance: nalgebra::Matrix2::identity() * if known { 60.0 * 60.0 } else { 300.0 * 300.0 },
            reach_sigmas: 3.4,
            most_px2: camera.frame_area_px2(),
            sigma_turn_rad: known.then_some(0.08),
            sigma_log_scale: 0.05,
            relief: 0.02,
        };
        let keys = scene_keys(&scene, &view, 1);
        let found = sightings(&correspondences(&keys, &view, &image, &gate), &gate, 1);
        assert!((found[0].at_px - true_px).norm() < 2.0, "{turn_rad}: {found:?} {true_px}");
        // kappa that is too small by so much: the image is turned from x to y, as y points down
        assert!((found[0].turn_rad - turn_rad).abs() < 0.03, "{turn_rad}: {found:?}");
        assert!(found[0].log_odds > 10.0 && found[0].supports >= 5, "{found:?}");
        assert!(found.get(1).is_none_or(|second| second.log_odds < found[0].log_odds - 5.0), "{found:?}");
    }
}

#[test]
fn a_scene_of_another_country_is_not_seen() {
    let (camera, country, other) = (camera(), Country::new(8), Country::new(9));
    let picture = Drawn::photograph(&country, &camera, &truth(), 3.0, 1);
    let mut image = ImageKeys::new(&picture, &camera, 1);
    image.cover(&[[Vector2::zeros(), Vector2::new(1100.0, 900.0)]]).unwrap();
    let orientation = truth();
    for k in 0..12 {
        let reference_m = Vector3::new(f64::from(k % 4) * 12.0 - 18.0, f64::from(k / 4) * 12.0 - 12.0, 0.0);
        let scene = other.scene(reference_m.xy(), 0.06, 18.0, 0.0);
        let view = View { camera: &camera, orientation: &orientation, reference_m };
        let gate = Gate {
            predicted_px: view.reduced_from_ground(Vector2::zeros()).unwrap(),
            covariance: nalgebra::Matrix2::identity() * 80.0 * 80.0,
            reach_sigmas: 3.4,
            most_px2: camera.frame_area_px2(),
            sigma_turn_rad: Some(0.1),
            sigma_log_scale: 0.05,
            relief: 0.02,
        };
        let keys = scene_keys(&scene, &view, 1);
        let found = sightings(&correspondences(&keys, &view, &image, &gate), &gate, 1);
        assert!(found.iter().all(|sighting| sighting.log_odds < 5.0), "{found:?}");
    }
}

/// What the raster leaves out lies outside; key points do not depend on how the picture was cut into tiles.
#[test]
fn the_raster_holds_all_key_points_of_a_rectangle() {
    let (camera, country) = (camera(), Country::new(8));
    let picture = Drawn::photograph(&country, &camera, &truth(), 3.0, 1);
    let mut image = ImageKeys::new(&picture, &camera, 1);
    image.cover(&[[Vector2::zeros(), Vector2::new(300.0, 300.0)]]).unwrap();
    image.cover(&[[Vector2::new(700.0, 10.0), Vector2::new(1100.0, 900.0)]]).unwrap();
    image.cover(&[[Vector2::new(-50.0, -50.0), Vector2::new(2000.0, 2000.0)]]).unwrap();
    let mut at_once = ImageKeys::new(&picture, &camera, 1);
    at_once.cover(&[[Vector2::zeros(), Vector2::new(1100.0, 900.0)]]).unwrap();
    let everything = |keys: &ImageKeys| {
        let all = keys.near([Vector2::repeat(-1e4), Vector2::repeat(1e4)], Vector2::x(), 4.0);
        all.flat_map(|range| keys.of(range).map(|(key, _)| *key).collect::<Vec<_>>()).collect::<Vec<_>>()
    };
    let all = everything(&image);
    assert!(all.len() > 300);
    assert_eq!(all.len(), everything(&at_once).len());
    let mut draws = Draws::new(2);
    for _ in 0..50 {
        let centre = Vector2::new(draws.even(-500.0, 500.0), draws.even(-400.0, 400.0));
        let half = Vector2::new(draws.even(5.0, 200.0), draws.even(5.0, 200.0));
        let (turn, reach) = (draws.even(-4.0, 4.0), draws.even(0.05, 1.5));
        let along = Vector2::new(turn.cos(), turn.sin());
        let near = image.near([centre - half, centre + half], along, reach);
        let near: Vec<ImageKey> =
            near.flat_map(|range| image.of(range).map(|(key, _)| *key).collect::<Vec<_>>()).collect();
        let wanted = all.iter().filter(|key| {
            let away = (key.at_px - centre).abs();
            let inside = away.x <= half.x && away.y <= half.y;
            inside && along.dot(&key.along_px) >= reach.cos() * key.along_px.norm()
        });
        for key in wanted {
            assert!(near.iter().any(|other| other.at_px == key.at_px && other.along_px == key.along_px));
        }
        assert!(near.len() < all.len());
    }
}

#[test]
fn up_in_a_picture_that_points_east_is_east() {
    let scene = Scene {
        width: 100,
        height: 80,
        grey: vec![0.0; 8000],
        gsd_m: 0.1,
        azimuth_of_image_up_rad: std::f64::consts::FRAC_PI_2,
        sigma_azimuth_rad: 0.05,
        reference_px: Vector2::new(50.0, 40.0),
    };
    let above = scene.ground_from_pixel_m(Vector2::new(50.0, 30.0));
    assert!((above - Vector2::new(1.0, 0.0)).norm() < 1e-12);
    let right = scene.ground_from_pixel_m(Vector2::new(60.0, 40.0));
    assert!((right - Vector2::new(0.0, -1.0)).norm() < 1e-12);
    for azimuth_of_image_up_rad in [0.0, 0.7, -2.0] {
        let turned = Scene { azimuth_of_image_up_rad, ..scene.clone() };
        let pixel = Vector2::new(12.5, 70.25);
        assert!((turned.pixel_from_ground(turned.ground_from_pixel_m(pixel)) - pixel).norm() < 1e-9);
        let stepped = turned.ground_by_pixel_m() * (pixel - turned.reference_px);
        assert!((stepped - turned.ground_from_pixel_m(pixel)).norm() < 1e-9);
    }
}
