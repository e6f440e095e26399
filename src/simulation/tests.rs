//! The photograph against independent truths: the collinearity equations, rays that are followed one by one, and the
//! sun's own direction.

use nalgebra::{Vector2, Vector3};

use super::photograph::Scenery;
use super::surface::{Face, Puff};
use super::visibility::Surface;
use super::*;
use crate::features::{Picture, PixelRect};
use crate::geometry::{Camera, ExteriorOrientation, rotation};

fn scene(seed: u64) -> Scene {
    Scene::draw(seed, &SceneSettings::default()).unwrap()
}

/// Nothing but geometry and light: no texture, no noise, no vignetting.
fn pure() -> PhotographSettings {
    PhotographSettings { texture: 0.0, noise_grey: 0.0, vignetting: 0.0, ..PhotographSettings::default() }
}

/// Looks at the town's middle at a slant, so that walls are seen and hide what lies behind them.
fn oblique(scene: &Scene) -> ExteriorOrientation {
    let tilt_rad = 35_f64.to_radians();
    let centre = scene.town.terrain.point_m(scene.town.centre_m);
    ExteriorOrientation {
        projection_centre_m: centre + Vector3::new(0.0, -150.0 * tilt_rad.tan(), 150.0),
        camera_from_object: rotation::camera_from_object(tilt_rad, 0.0, 0.0),
    }
}

/// Tiles in which there is something to see: leaves, roofs and what lies beside them.
fn busy_tiles(scene: &Scene, orientation: &ExteriorOrientation) -> Vec<[i32; 2]> {
    let puffs = scene.town.puffs.iter().step_by(997).map(|puff| puff.centre_m);
    let houses = scene.town.buildings.iter().step_by(11).map(|house| house.roof_wireframe().0[0]);
    let pixels = puffs.chain(houses).filter_map(|point| orientation.pixel(&scene.camera, point));
    let in_frame = pixels.filter(|pixel| scene.camera.contains(*pixel, -32.0));
    in_frame.map(|pixel| [pixel.x, pixel.y].map(|at| (at as i32).div_euclid(32) * 32)).take(14).collect()
}

fn grey_at(picture: &Photograph, pixel: Vector2<f64>) -> f64 {
    let corner = pixel.add_scalar(-0.5);
    let (column, row) = (corner.x.floor(), corner.y.floor());
    let (right, down) = (corner.x - column, corner.y - row);
    let at = |dx: u32, dy: u32| {
        let index = (row as u32 + dy) * picture.width_px + column as u32 + dx;
        f64::from(picture.grey[index as usize])
    };
    let across = |dy| at(0, dy) * (1.0 - right) + at(1, dy) * right;
    across(0) * (1.0 - down) + across(1) * down
}

/// How far a step of grey values lies from the middle of a profile, along it; `None` if it is not one clean step.
fn step_offset_px(profile: &[f64], spacing_px: f64) -> Option<f64> {
    let level = |part: &[f64]| {
        let (low, high) = part.iter().fold((f64::MAX, f64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
        (high - low < 2.5).then(|| part.iter().sum::<f64>() / part.len() as f64)
    };
    let n = profile.len();
    let (first, last) = (level(&profile[..n / 5])?, level(&profile[n - n / 5..])?);
    let rises = profile.windows(2).all(|pair| (pair[1] - pair[0]) * (last - first).signum() > -1.1);
    if (last - first).abs() < 25.0 || !rises {
        return None;
    }
    // the area under the normalised profile is the length of its upper part
    let upper_px: f64 = profile.iter().map(|v| (v - first) / (last - first)).sum::<f64>() * spacing_px;
    let all_px = n as f64 * spacing_px;
    Some(all_px / 2.0 - upper_px)
}

/// The mean distance of the grey-value edge from a projected roof edge, from profiles all along it.
fn edge_offset_px(
    picture: &Photograph,
    camera: &Camera,
    o: &ExteriorOrientation,
    ends: [Vector3<f64>; 2],
) -> Option<f64> {
    const REACH_PX: f64 = 5.5;
    const SPACING_PX: f64 = 0.25;
    const PROFILES: u32 = 60;
    let pixel = |share: f64| o.pixel(camera, ends[0].lerp(&ends[1], share)).filter(|p| camera.contains(*p, -10.0));
    let mut offsets = Vec::new();
    for i in 0..PROFILES {
        let share = 0.1 + 0.8 * f64::from(i) / f64::from(PROFILES);
        let (here, ahead) = (pixel(share)?, pixel(share + 0.01)?);
        let along = (ahead - here).normalize();
        let normal = Vector2::new(-along.y, along.x);
        let count = (2.0 * REACH_PX / SPACING_PX) as u32;
        let place = |k: u32| here + normal * ((f64::from(k) + 0.5) * SPACING_PX - REACH_PX);
        let profile: Vec<f64> = (0..count).map(|k| grey_at(picture, place(k))).collect();
        offsets.extend(step_offset_px(&profile, SPACING_PX));
    }
    (offsets.len() >= 20).then(|| offsets.iter().sum::<f64>() / offsets.len() as f64)
}

#[test]
fn projected_roof_edges_lie_on_grey_value_edges() {
    let scene = scene(3);
    let (camera, orientation) = (&scene.camera, &scene.true_orientation);
    let picture = photograph(&scene.town, camera, orientation, &pure(), 0);
    let edges = scene.town.main_buildings().flat_map(Building::roof_edges_m);
    let mut offsets: Vec<f64> =
        edges.filter_map(|edge| edge_offset_px(&picture, camera, orientation, [edge.start, edge.end])).collect();
    offsets.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
    let n = offsets.len();
    assert!(n >= 40, "only {n} edges are clean steps");
    let mean = offsets.iter().sum::<f64>() / n as f64;
    let (median, nine_tenths) = (offsets[n / 2].abs(), offsets[n * 9 / 10].abs());
    assert!(mean.abs() < 0.02 && median < 0.03 && nine_tenths < 0.1, "{mean}, {median}, {nine_tenths}");
}

/// Distance along a ray (of unit length) to a face.
fn distance_to_face(face: &Face, origin: Vector3<f64>, ray: Vector3<f64>) -> Option<f64> {
    let normal = face.normal();
    let distance = normal.dot(&(face.corners_m[0] - origin)) / normal.dot(&ray);
    let point = origin + ray * distance;
    let n = face.corners_m.len();
    let inside = (0..n).all(|i| {
        let (from, to) = (face.corners_m[i], face.corners_m[(i + 1) % n]);
        (to - from).cross(&(point - from)).dot(&normal) >= 0.0
    });
    (distance > 0.0 && inside).then_some(distance)
}

/// Distance along a ray (of unit length) to the far or near side of a ball.
fn distance_to_puff(puff: &Puff, origin: Vector3<f64>, ray: Vector3<f64>, side: f64) -> Option<f64> {
    let to_centre = puff.centre_m - origin;
    let along = to_centre.dot(&ray);
    let half_chord_squared = puff.radius_m.powi(2) - (to_centre - ray * along).norm_squared();
    (half_chord_squared > 0.0).then(|| along + side * half_chord_squared.sqrt()).filter(|distance| *distance > 0.0)
}

/// The distance to the ground, by bisection.
fn distance_to_ground(town: &Town, origin: Vector3<f64>, ray: Vector3<f64>) -> f64 {
    let above = |distance: f64| {
        let point = origin + ray * distance;
        point.z > town.terrain.height_m(point.xy())
    };
    let (mut near, mut far) = (0.0, 5000.0);
    for _ in 0..60 {
        let middle = (near + far) / 2.0;
        if above(middle) { near = middle } else { far = middle }
    }
    near
}

#[test]
fn every_ray_ends_at_the_first_surface_on_its_way_and_in_its_own_pixel() {
    let scene = scene(2);
    let (town, orientation) = (&scene.town, oblique(&scene));
    let scenery = Scenery::new(town, &scene.camera, &orientation, &pure());
    let eye = orientation.projection_centre_m;
    let mut met = [0; 3];
    for corner_px in busy_tiles(&scene, &orientation) {
        let (sight, _) = scenery.look(corner_px).unwrap();
        for ray_number in (0..sight.point_m.len()).step_by(17) {
            let point = sight.point_m[ray_number];
            let ray = (point - eye).normalize();
            let faces = town.faces.iter().filter_map(|face| distance_to_face(face, eye, ray));
            let puffs = town.puffs.iter().filter_map(|puff| distance_to_puff(puff, eye, ray, -1.0));
            let first = faces.chain(puffs).fold(distance_to_ground(town, eye, ray), f64::min);
            assert!((first - (point - eye).norm()).abs() < 2e-3, "{first} is not {}", (point - eye).norm());
            met[match sight.surface[ray_number] {
                Surface::Face(_) => 0,
                Surface::Puff(_) => 1,
                Surface::Meadow | Surface::Patch(_) => 2,
            }] += 1;

            let pixel = orientation.pixel(&scene.camera, point).unwrap();
            let number = ray_number / 4;
            let expected = Vector2::new(corner_px[0] + number as i32 % 32, corner_px[1] + number as i32 / 32);
            let in_pixel = pixel - expected.cast::<f64>();
            assert!(in_pixel.min() > -2e-3 && in_pixel.max() < 1.0 + 2e-3, "{pixel} is not in pixel {expected}");
        }
    }
    assert!(met.into_iter().all(|count| count > 40), "faces, puffs, ground: {met:?}");
}

#[test]
fn patches_lie_where_they_are_on_the_map() {
    let scene = scene(2);
    let scenery = Scenery::new(&scene.town, &scene.camera, &scene.true_orientation, &pure());
    let inside = |patch: &Patch, place: Vector2<f64>| {
        let n = patch.corners_m.len();
        let sides = (0..n).map(|i| (patch.corners_m[i], patch.corners_m[(i + 1) % n]));
        let turns: Vec<f64> = sides.map(|(from, to)| (to - from).perp(&(place - from))).collect();
        turns.iter().all(|turn| *turn >= 0.0) || turns.iter().all(|turn| *turn <= 0.0)
    };
    let mut checked = 0;
    for corner_px in busy_tiles(&scene, &scene.true_orientation) {
        let (sight, _) = scenery.look(corner_px).unwrap();
        for (surface, point) in sight.surface.iter().zip(&sight.point_m).step_by(13) {
            let topmost = scene.town.patches.iter().rposition(|patch| inside(patch, point.xy()));
            match surface {
                Surface::Patch(index) => assert_eq!(topmost, Some(*index as usize)),
                Surface::Meadow => assert_eq!(topmost, None),
                Surface::Face(_) | Surface::Puff(_) => continue,
            }
            checked += 1;
        }
    }
    assert!(checked > 800, "{checked}");
}

#[test]
fn shadows_are_where_something_stands_between_a_point_and_the_sun() {
    let scene = scene(5);
    let (town, orientation) = (&scene.town, oblique(&scene));
    let scenery = Scenery::new(town, &scene.camera, &orientation, &pure());
    let (mut lit, mut shaded, mut wrong) = (0, 0, 0);
    for corner_px in busy_tiles(&scene, &orientation) {
        let (sight, in_sun) = scenery.look(corner_px).unwrap();
        for (point, in_sun) in sight.point_m.iter().zip(in_sun).step_by(17) {
            let clear = point + town.to_sun * 0.06;
            let casting = town.faces.iter().filter(|face| face.casts_shadow);
            let behind_face = casting.filter_map(|face| distance_to_face(face, clear, town.to_sun)).next();
            let behind_puff = town.puffs.iter().find_map(|puff| distance_to_puff(puff, clear, town.to_sun, 1.0));
            let expected = behind_face.or(behind_puff).is_none();
            lit += u32::from(expected);
            shaded += u32::from(!expected);
            wrong += u32::from(expected != in_sun);
        }
    }
    assert!(lit > 200 && shaded > 100, "{lit} lit, {shaded} shaded");
    assert!(wrong <= (lit + shaded) / 1000, "{wrong} of {} are wrong", lit + shaded);
}

#[test]
fn shadows_fall_away_from_the_sun() {
    let house = Building {
        purpose: Use::Main,
        centre_m: Vector2::zeros(),
        ridge_direction: Vector2::x(),
        length_m: 12.0,
        width_m: 10.0,
        ground_m: 0.0,
        wall_height_m: 6.0,
        roof: Roof::Flat,
        overhang_m: 0.0,
        roof_material: Material::plain(0.5),
        wall_material: Material::plain(0.5),
    };
    // the sun in the south, 45 degrees high: the shadow reaches 6 m to the north of the northern wall
    let town = Town::of_buildings(vec![house], 0.0, Vector3::new(0.0, -1.0, 1.0));
    let scene = scene(1);
    let down = ExteriorOrientation {
        projection_centre_m: Vector3::new(0.0, 0.0, 150.0),
        camera_from_object: rotation::camera_from_object(0.0, 0.0, 0.0),
    };
    let picture = photograph(&town, &scene.camera, &down, &pure(), 0);
    let grey = |north_m: f64| grey_at(&picture, down.pixel(&scene.camera, Vector3::new(1.0, north_m, 0.0)).unwrap());
    let open = grey(-20.0);
    for lit in [-5.5, -7.0, 11.5, 20.0] {
        assert!((grey(lit) - open).abs() < 2.0, "{lit} m north should lie in the sun");
    }
    for shaded in [5.5, 8.0, 10.5] {
        assert!(grey(shaded) < 0.6 * open, "{shaded} m north should lie in the shadow");
    }
}

#[test]
fn a_window_is_a_cut_out_of_the_whole_and_threads_do_not_matter() {
    let mut settings = SceneSettings::default();
    settings.camera.image_size_px = [700, 500];
    settings.camera.principal_point_px = [345.0, 252.0];
    settings.flight.height_m = 120.0;
    let scene = Scene::draw(9, &settings).unwrap();
    let whole = scene.render();
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(|| scene.render());
    assert!(whole == alone);
    let rect = PixelRect { x: 333, y: 77, width: 211, height: 130 };
    let part =
        photograph_window(&scene.town, &scene.camera, &scene.true_orientation, &settings.photograph, scene.seed, rect);
    let cut = whole.window(rect, 1).unwrap();
    assert!(part.grey.iter().zip(&cut.grey).all(|(a, b)| f32::from(*a) == *b));
    assert!(scene.render().grey != Scene::draw(10, &settings).unwrap().render().grey);
}

/// FNV-1a.
fn hash(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

/// The numbers below are the same on every machine. They change with every change of the simulator, and only then.
#[test]
fn a_seed_gives_the_same_bytes_everywhere() {
    let scene = scene(1);
    let rect = PixelRect { x: 1200, y: 900, width: 640, height: 480 };
    let settings = &scene.settings.photograph;
    let part = photograph_window(&scene.town, &scene.camera, &scene.true_orientation, settings, scene.seed, rect);
    let truth = scene.true_orientation;
    let orientation = truth.projection_centre_m.iter().chain(truth.camera_from_object.matrix().iter());
    let control = scene.control.iter().flat_map(|point| point.control_point.reference_m.iter());
    let numbers = hash(orientation.chain(control).flat_map(|v| v.to_le_bytes()));
    assert_eq!((hash(part.grey), numbers), (3_348_871_698_381_415_739, 2_903_818_000_647_257_687));
}

#[test]
fn reduced_windows_hold_means() {
    let picture = Photograph { width_px: 5, height_px: 3, grey: (0..15).map(|v| v * 10).collect() };
    let window = picture.window(PixelRect { x: 1, y: 0, width: 9, height: 9 }, 2).unwrap();
    assert_eq!((window.width, window.height, window.origin_px), (2, 2, [1, 0]));
    assert_eq!(window.grey, [(10 + 20 + 60 + 70) as f32 / 4.0, 60.0, 115.0, 135.0]);
}
