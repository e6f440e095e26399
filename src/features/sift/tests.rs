use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix2, Vector2};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::*;

/// A round spot.
#[derive(Clone, Copy)]
struct Spot {
    at: Vector2<f64>,
    sigma: f64,
    height: f64,
}

/// The grey value of spots on grey ground.
fn grey_at(spots: &[Spot], at: Vector2<f64>) -> f64 {
    let of = |spot: &Spot| {
        let squared = (at - spot.at).norm_squared() / (spot.sigma * spot.sigma);
        if squared < 80.0 { spot.height * (-0.5 * squared).exp() } else { 0.0 }
    };
    128.0 + spots.iter().map(of).sum::<f64>()
}

fn drawn(width: usize, height: usize, grey: impl Fn(Vector2<f64>) -> f64) -> Vec<f32> {
    let cell = |k: usize| Vector2::new((k % width) as f64 + 0.5, (k / width) as f64 + 0.5);
    (0..width * height).map(|k| grey(cell(k)) as f32).collect()
}

/// Spots of all sizes over a square, bright and dark; by integers alone, so that any language can draw them.
fn texture(side: f64, count: usize) -> Vec<Spot> {
    let mut state = 1_u64;
    let mut next = || {
        state = (state * 1_103_515_245 + 12_345) % (1 << 31);
        state as f64 / f64::from(1_u32 << 31)
    };
    let mut spot = || {
        let at = Vector2::new(side * next(), side * next());
        let size = next();
        Spot { at, sigma: 1.2 + 5.0 * size * size, height: 120.0 * (next() - 0.5) }
    };
    (0..count).map(|_| spot()).collect()
}

fn angle_between(a: f64, b: f64) -> f64 {
    ((a - b + PI).rem_euclid(TAU) - PI).abs()
}

fn distance(a: &KeyPoint, b: &KeyPoint) -> f64 {
    f64::from(squared_distance(&a.descriptor, &b.descriptor)).sqrt()
}

/// Scale at which the difference of Gaussians of a spot is extreme: levels a factor k apart are most different where
/// the product of their variances is the square of the spot's, of which the part that every picture is taken to have
/// is none of its own.
fn scale_of(spot: &Spot) -> f64 {
    (spot.sigma.powi(2) - 0.25).sqrt() / (1.0_f64 / 6.0).exp2()
}

#[test]
fn spots_are_found_where_they_are_and_how_large() {
    let spot = |x: f64, y: f64, sigma: f64, height: f64| Spot { at: Vector2::new(x, y), sigma, height };
    let spots = [
        spot(40.3, 41.8, 2.0, 90.0),
        spot(120.5, 45.1, 3.3, -90.0),
        spot(45.77, 120.0, 5.0, 90.0),
        spot(130.2, 130.6, 8.0, -90.0),
    ];
    let grey = drawn(200, 190, |at| grey_at(&spots, at));
    for upsampled in [false, true] {
        let found = key_points(&grey, 200, 190, &Settings { upsampled, ..Settings::default() });
        // without doubling, the finest difference is of twice the picture's blur
        for spot in spots.iter().filter(|spot| upsampled || spot.sigma > 3.0) {
            let near: Vec<_> = found.iter().filter(|p| (p.at_px - spot.at).norm() < 3.0).collect();
            assert!(!near.is_empty(), "{:?}", spot.at);
            for point in near {
                assert!((point.at_px - spot.at).amax() < 0.05, "{:?} for {:?}", point.at_px, spot.at);
                let ratio = point.scale_px / scale_of(spot);
                assert!((0.95..1.05).contains(&ratio), "{ratio} at {:?}", spot.at);
            }
        }
    }
}

#[test]
fn a_straight_edge_has_no_key_points() {
    for angle in [0.0_f64, 0.3, 0.8] {
        let normal = Vector2::new(angle.cos(), angle.sin());
        let edge = |at: Vector2<f64>| 128.0 + 100.0 * ((at - Vector2::new(60.0, 55.0)).dot(&normal) / 1.5).tanh();
        let grey = drawn(120, 110, edge);
        assert_eq!(key_points(&grey, 120, 110, &Settings::default()), []);
    }
}

#[test]
fn a_picture_too_small_has_none() {
    for (width, height) in [(0, 0), (0, 5), (1, 1), (5, 300), (6, 6), (7, 40), (12, 11)] {
        let grey: Vec<f32> = (0..width * height).map(|k| (k * 7919 % 256) as f32).collect();
        for upsampled in [false, true] {
            let _ = key_points(&grey, width, height, &Settings { upsampled, ..Settings::default() });
        }
    }
    assert_eq!(key_points(&[0.0; 5], 100, 100, &Settings::default()), []);
}

#[test]
fn rotating_the_picture_by_a_quarter_rotates_the_key_points() {
    // such a side that every octave begins and ends with a cell of the one before
    const SIDE: usize = 129;
    let grey = drawn(SIDE, SIDE, |at| grey_at(&texture(SIDE as f64, 170), at));
    let rotated: Vec<f32> = (0..SIDE * SIDE).map(|k| grey[(SIDE - 1 - k % SIDE) * SIDE + k / SIDE]).collect();
    let (before, after) =
        (key_points(&grey, SIDE, SIDE, &Settings::default()), key_points(&rotated, SIDE, SIDE, &Settings::default()));
    assert!(before.len() > 50, "{}", before.len());
    assert_eq!(before.len(), after.len());
    for point in &before {
        let at = Vector2::new(SIDE as f64 - point.at_px.y, point.at_px.x);
        let same = after.iter().filter(|p| (p.at_px - at).norm() < 1e-3).find(|p| {
            (p.scale_px / point.scale_px - 1.0).abs() < 1e-3
                && angle_between(p.orientation_rad, point.orientation_rad + FRAC_PI_2) < 1e-3
        });
        let same = same.unwrap_or_else(|| panic!("{point:?}"));
        assert!(distance(point, same) < 5.0, "{}", distance(point, same));
        let quarter = Matrix2::new(0.0, -1.0, 1.0, 0.0);
        let covariance = quarter * point.covariance * quarter.transpose();
        assert!((covariance - same.covariance).norm() < 1e-2 * covariance.norm());
    }
}

#[test]
fn a_rotated_scaled_and_brightened_texture_matches() {
    const SIDE: usize = 220;
    let spots = texture(SIDE as f64, 500);
    let middle = Vector2::repeat(SIDE as f64 / 2.0);
    let settings = Settings::default();
    let from = key_points(&drawn(SIDE, SIDE, |at| grey_at(&spots, at)), SIDE, SIDE, &settings);
    for (degrees, scale, gain, offset) in
        [(10.0_f64, 1.0, 1.0, 0.0), (45.0, 1.0, 0.7, 30.0), (135.0, 1.3, 1.0, -20.0), (0.0, 0.75, 1.2, 0.0)]
    {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let turned = scale * Matrix2::new(cos, -sin, sin, cos);
        let back = turned.try_inverse().unwrap();
        let grey = drawn(SIDE, SIDE, |at| gain * grey_at(&spots, middle + back * (at - middle)) + offset);
        let to = key_points(&grey, SIDE, SIDE, &settings);
        let matches = ratio_matches(&from, &to, 0.8);
        let is_right = |m: &&Match| {
            let truth = middle + turned * (from[m.from].at_px - middle);
            (to[m.to].at_px - truth).norm() < 2.0
        };
        let right = matches.iter().filter(is_right).count();
        assert!(right >= 60, "{right} right of {} from {degrees}, {scale}", matches.len());
        assert!(right * 100 >= 80 * matches.len(), "{right} right of {} from {degrees}, {scale}", matches.len());
    }
}

#[test]
fn only_the_strongest() {
    let grey = drawn(150, 150, |at| grey_at(&texture(150.0, 250), at));
    let all = key_points(&grey, 150, 150, &Settings::default());
    let some = key_points(&grey, 150, 150, &Settings { most: Some(30), ..Settings::default() });
    assert_eq!(some.len(), 30);
    let mut responses: Vec<f64> = all.iter().map(|point| point.response).collect();
    responses.sort_by(|a, b| b.total_cmp(a));
    let kept: Vec<f64> = some.iter().map(|point| point.response).collect();
    assert_eq!(kept, responses[..30]);
}

#[test]
fn descriptors_are_normalised_and_clipped() {
    let grey = drawn(150, 150, |at| grey_at(&texture(150.0, 250), at));
    let brighter: Vec<f32> = grey.iter().map(|grey| 0.5 * grey + 60.0).collect();
    let settings = Settings { contrast: 0.01, ..Settings::default() };
    let (points, bright) = (key_points(&grey, 150, 150, &settings), key_points(&brighter, 150, 150, &settings));
    for point in &points {
        let squared: u32 = point.descriptor.0.iter().map(|&n| u32::from(n).pow(2)).sum();
        assert!((f64::from(squared).sqrt() - 512.0).abs() < 10.0, "{squared}");
        // what is clipped at 0.2 is longer once it is normalised again, but not by so much
        assert!(point.descriptor.0.iter().all(|&n| n < 220), "{:?}", point.descriptor);
    }
    for point in bright.iter().filter(|point| point.response > 0.02) {
        let same = points.iter().map(|p| distance(p, point) + (p.at_px - point.at_px).norm());
        assert!(same.fold(f64::INFINITY, f64::min) < 10.0);
    }
}

#[test]
fn the_ratio_is_that_of_nearest_and_second_nearest() {
    let point = |descriptor: [u8; 128]| KeyPoint {
        at_px: Vector2::zeros(),
        scale_px: 1.0,
        orientation_rad: 0.0,
        response: 1.0,
        covariance: Matrix2::identity(),
        descriptor: Descriptor(descriptor),
    };
    let with = |first: u8, last: u8| {
        let mut numbers = [7; 128];
        (numbers[0], numbers[127]) = (first, last);
        point(numbers)
    };
    let to = [with(100, 0), with(0, 255), with(100, 50), with(255, 255)];
    // 30 from the first, 40·√1 … of the third; the fifth of a block of four
    let from = [with(100, 20), with(100, 25), with(0, 255), with(255, 250), with(103, 4)];
    assert_eq!(squared_distance(&to[0].descriptor, &to[3].descriptor), 155 * 155 + 255 * 255);
    let all = ratio_matches(&from, &to, 1.0);
    let pairs: Vec<_> = all.iter().map(|m| (m.from, m.to)).collect();
    assert_eq!(pairs, [(0, 0), (1, 0), (2, 1), (3, 3), (4, 0)]);
    assert_eq!((all[0].distance, all[0].ratio), (20.0, 20.0 / 30.0));
    assert_eq!((all[1].ratio, all[2].ratio), (1.0, 0.0));
    assert_eq!(all[4].distance, 5.0);
    let some: Vec<_> = ratio_matches(&from, &to, 0.5).iter().map(|m| m.from).collect();
    assert_eq!(some, [2, 3, 4]);
    assert_eq!(ratio_matches(&from, &to[..1], 1.0), []);
    assert_eq!(ratio_matches(&[], &to, 1.0), []);
}

/// Scatter of key points in noise.
#[test]
fn the_covariance_is_the_scatter_in_noise() {
    const SIDE: usize = 110;
    const RUNS: usize = 300;
    const NOISE: f64 = 4.0;
    let spot = |x: f64, y: f64, sigma: f64, height: f64| Spot { at: Vector2::new(x, y), sigma, height };
    let spots = [
        spot(25.3, 26.1, 1.6, 100.0),
        spot(80.6, 25.0, 3.0, -70.0),
        spot(30.5, 78.4, 5.0, 70.0),
        spot(82.0, 80.0, 7.0, -50.0),
    ];
    let clean = drawn(SIDE, SIDE, |at| grey_at(&spots, at));
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut offsets, mut told) = (vec![Vec::new(); spots.len()], vec![Matrix2::zeros(); spots.len()]);
    for _ in 0..RUNS {
        let noisy: Vec<f32> = clean.iter().map(|grey| grey + (NOISE * normal(&mut rng)) as f32).collect();
        let found = key_points(&noisy, SIDE, SIDE, &Settings::default());
        for (k, spot) in spots.iter().enumerate() {
            let is_it =
                |p: &&KeyPoint| (p.at_px - spot.at).norm() < 2.0 && (p.scale_px / scale_of(spot)).ln().abs() < 0.3;
            if let Some(point) = found.iter().find(is_it) {
                offsets[k].push(point.at_px - spot.at);
                told[k] += point.covariance;
            }
        }
    }
    for ((offsets, told), spot) in offsets.iter().zip(&told).zip(&spots) {
        let count = offsets.len() as f64;
        assert!(count > 0.9 * RUNS as f64, "{count} of {}", spot.sigma);
        let scatter = (offsets.iter().map(|o| o * o.transpose()).sum::<Matrix2<f64>>() / count).trace();
        let told = told.trace() / count;
        assert!((scatter / told).ln().abs() < 1.3_f64.ln(), "{scatter} but told {told} at {}", spot.sigma);
    }
}

/// What a spot's position is worth depends on its height over the noise: a larger one has more pixels, but a flatter
/// slope. Only the picture's own blur makes the smallest ones worse.
#[test]
fn the_covariance_depends_on_the_contrast_and_not_on_the_scale() {
    let variance = |sigma: f64, height: f64| {
        let spot = Spot { at: Vector2::new(60.2, 60.4), sigma, height };
        let found = key_points(&drawn(120, 120, |at| grey_at(&[spot], at)), 120, 120, &Settings::default());
        let near = found.iter().find(|p| (p.at_px - spot.at).norm() < 0.2).unwrap();
        0.5 * near.covariance.trace()
    };
    let (small, middling, large) = (variance(2.0, 80.0), variance(4.0, 80.0), variance(8.0, 80.0));
    let faint = variance(4.0, 40.0);
    assert!((faint / middling - 4.0).abs() < 0.1);
    assert!((middling / small).ln().abs() < 0.3 && (large / middling).ln().abs() < 0.3);
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

#[test]
fn the_noise_of_the_grey_values_is_estimated() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let slope = |k: usize| 40.0 + (k % 200) as f64 * 0.8;
    let grey: Vec<f32> = (0..200 * 150).map(|k| (slope(k) + 5.0 * normal(&mut rng)) as f32).collect();
    let estimated = noise::noise(&grey, 200, 150);
    assert!((estimated / 5.0 - 1.0).abs() < 0.05, "{estimated}");
}

/// Of `opencv.csv`: x, y, size, angle and the descriptor of OpenCV's 60 strongest, made by
/// ```python
/// import cv2, numpy as np
/// state = 1
/// def u():
///     global state
///     state = (state * 1103515245 + 12345) % 2**31
///     return state / 2**31
/// x, y = np.meshgrid(np.arange(200) + 0.5, np.arange(200) + 0.5)
/// grey = np.full((200, 200), 128.0)
/// for _ in range(420):
///     a, b, c, d = 200 * u(), 200 * u(), u(), u()
///     q = ((x - a) ** 2 + (y - b) ** 2) / (1.2 + 5 * c * c) ** 2
///     grey += 120 * (d - 0.5) * np.where(q < 80, np.exp(-0.5 * q), 0)
/// grey = np.floor(np.clip(grey, 0, 255) + 0.5).astype(np.uint8)
/// points, descriptors = cv2.SIFT_create(enable_precise_upscale=True).detectAndCompute(grey, None)
/// best = sorted(range(len(points)), key=lambda k: -points[k].response)[:60]
/// for p, d in ((points[k], descriptors[k]) for k in best):
///     print("%.4f,%.4f,%.4f,%.3f" % (*p.pt, p.size, p.angle), *d.astype(int), sep=",")
/// ```
///
/// OpenCV takes orientations and descriptors about the cell nearest to the point; about the point itself, as here, more
/// of them match. So ours are made here as it makes them.
#[test]
fn opencv_finds_the_same() {
    let grey = drawn(200, 200, |at| (grey_at(&texture(200.0, 420), at).clamp(0.0, 255.0) + 0.5).floor());
    let ours = key_points(&grey, 200, 200, &Settings::default());
    let about_cells = about_cells(&grey, 200, 200);
    let (mut all, mut there, mut alike) = (0, 0, 0);
    for line in include_str!("opencv.csv").lines() {
        let numbers: Vec<f64> = line.split(',').map(|n| n.parse().unwrap()).collect();
        let at = Vector2::new(numbers[0] + 0.5, numbers[1] + 0.5);
        let descriptor = Descriptor(std::array::from_fn(|k| numbers[4 + k] as u8));
        let is_there =
            |p: &&KeyPoint| (p.at_px - at).norm() < 0.15 && (2.0 * p.scale_px / numbers[2] - 1.0).abs() < 0.05;
        let is_alike = |p: &KeyPoint| {
            angle_between(p.orientation_rad, numbers[3].to_radians()) < 3_f64.to_radians()
                && squared_distance(&p.descriptor, &descriptor) < 80 * 80
        };
        all += 1;
        there += usize::from(ours.iter().any(|p| is_there(&p)));
        alike += usize::from(about_cells.iter().filter(is_there).any(is_alike));
    }
    assert_eq!(all, 60);
    assert!(there * 100 >= 95 * all && alike * 100 >= 95 * all, "{there}, {alike} of {all}");
}

/// Key points with surroundings taken about the nearest cell.
fn about_cells(grey: &[f32], width: usize, height: usize) -> Vec<KeyPoint> {
    let limits = Limits { contrast: 0.04 / 3.0 * 255.0, edge_ratio: 10.0 };
    let mut octave = Octave::first(grey, width, height, true);
    let mut found = Vec::new();
    while octave.width.min(octave.height) > 2 * RIM {
        for extremum in extrema(&octave, &limits) {
            let (x, y, scale) = (extremum.at.x, extremum.at.y, sigma_at(extremum.at.z));
            let level = Level::of(&octave, extremum.cell[0]);
            for orientation_rad in orientation::orientations(level, x.round(), y.round(), scale) {
                found.push(KeyPoint {
                    at_px: Vector2::new(x, y) * octave.cell_px + Vector2::repeat(0.5),
                    scale_px: scale * octave.cell_px,
                    orientation_rad,
                    response: extremum.contrast / 255.0,
                    covariance: Matrix2::zeros(),
                    descriptor: descriptor::descriptor(level, x.round(), y.round(), scale, orientation_rad),
                });
            }
        }
        octave.halve();
    }
    found
}
