//! What the scans promise.

use nalgebra::Vector2;

use super::*;
use crate::features::{GreyWindow, Picture, PixelRect};
use crate::interior::Side;

fn at_15_um(mut settings: ScanSettings) -> ScanSettings {
    settings.scanner.pixel_um = [15.0, 15.0];
    settings
}

/// The window of a half size about a place.
fn around(scan: &SimulatedScan, place_px: Vector2<f64>, half_px: u32, reduction: u32) -> GreyWindow {
    let [x, y] = [place_px.x as u32 - half_px, place_px.y as u32 - half_px];
    scan.window(PixelRect { x, y, width: 2 * half_px, height: 2 * half_px }, reduction).unwrap()
}

fn mean_and_sigma(values: &[f32]) -> (f32, f32) {
    let n = values.len() as f32;
    let mean = values.iter().sum::<f32>() / n;
    (mean, (values.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / n).sqrt())
}

/// The centre of gravity of what differs from the ground within a distance.
fn centroid(scan: &SimulatedScan, place_px: Vector2<f64>, reach_mm: f64) -> Vector2<f64> {
    let reach_px = reach_mm * 1000.0 / scan.truth().pixel_um;
    let window = around(scan, place_px, reach_px as u32 + 4, 1);
    let ground = f64::from(window.grey[0]);
    let (mut sum, mut moment) = (0.0, Vector2::zeros());
    for (k, &grey) in window.grey.iter().enumerate() {
        let [i, j] = [k % window.width, k / window.width].map(|at| at as f64 + 0.5);
        let here = Vector2::new(f64::from(window.origin_px[0]) + i, f64::from(window.origin_px[1]) + j);
        if (here - place_px).norm() < reach_px {
            let weight = f64::from(grey) - ground;
            sum += weight;
            moment += here * weight;
        }
    }
    moment / sum
}

#[test]
fn dots_are_where_the_truth_says_in_all_layings_and_both_polarities() {
    for (k, laying) in (0..).zip(Laying::all()) {
        let mut settings = at_15_um(ScanSettings::clean(Make::WildRc20, laying));
        settings.negative = k % 2 == 1;
        let scan = SimulatedScan::draw(k, &settings);
        let linear = scan.truth().pixel_from_plate;
        let determinant = linear[(0, 0)] * linear[(1, 1)] - linear[(0, 1)] * linear[(1, 0)];
        assert_eq!(determinant > 0.0, laying.mirrored);
        let x_as_seen = Vector2::new(linear[(0, 0)], -linear[(1, 0)]).normalize();
        let turned = f64::from(laying.turns) * std::f64::consts::FRAC_PI_2;
        assert!(x_as_seen.dot(&Vector2::new(turned.cos(), turned.sin())) > 0.99);
        for (mark, fiducial) in scan.truth().marks.iter().zip(&scan.plate().fiducials) {
            let found = centroid(&scan, mark.position_px, 0.25);
            assert!((found - mark.position_px).norm() < 0.03, "{} found at {found}", mark.name);
            let linear_px = scan.truth().pixel(fiducial.position_mm);
            // the irregular strain of 1.5 micrometres, the calibration's 2
            assert!((linear_px - mark.position_px).norm() < 0.8, "{linear_px} against {}", mark.position_px);
        }
    }
}

/// The mean over the far end of a mark's wing and over the content before its tip.
#[test]
fn marks_that_turn_with_their_side_point_inwards() {
    for (k, laying) in (20..).zip(Laying::all()) {
        let scan = SimulatedScan::draw(k, &at_15_um(ScanSettings::clean(Make::FairchildK17, laying)));
        for fiducial in &scan.plate().fiducials {
            let inwards = -fiducial.position_mm.normalize();
            let at = |off_mm: f64| scan.truth().pixel(fiducial.position_mm + inwards * off_mm);
            let (inside, tip) = (around(&scan, at(1.0), 20, 1), around(&scan, at(-0.2), 1, 1));
            assert!(mean_and_sigma(&inside.grey).0 > mean_and_sigma(&tip.grey).0 + 10.0);
        }
    }
}

#[test]
fn windows_agree_with_each_other() {
    let scan = SimulatedScan::draw(3, &at_15_um(ScanSettings::poor(Make::WildRc10, Laying::default())));
    let mark_px = scan.truth().marks[1].position_px;
    let whole = around(&scan, mark_px, 160, 1);
    let [x, y] = whole.origin_px;
    let part = scan.window(PixelRect { x: x + 37, y: y + 61, width: 101, height: 5 }, 1).unwrap();
    for (row, line) in part.grey.chunks(101).enumerate() {
        let start = (row + 61) * whole.width + 37;
        assert_eq!(line, &whole.grey[start..start + 101]);
    }
    let halved = around(&scan, mark_px, 160, 2);
    assert_eq!(halved.grey, whole.halved().grey);

    for reduction in [4, 8, 16] {
        let (width, step) = (whole.width, reduction as usize);
        let exact: Vec<f32> = (0..(width / step).pow(2))
            .map(|k| {
                let (i, j) = (k % (width / step) * step, k / (width / step) * step);
                let cell = (j..j + step).flat_map(|row| &whole.grey[row * width + i..row * width + i + step]);
                cell.sum::<f32>() / (step * step) as f32
            })
            .collect();
        let quick = around(&scan, mark_px, 160, reduction);
        let difference: Vec<f32> = exact.iter().zip(&quick.grey).map(|(exact, quick)| quick - exact).collect();
        let (mean, sigma) = mean_and_sigma(&difference);
        // two independent grains, and what is left out of the texture
        let grain = 10.0 * 2.0 * 1.5 / reduction as f32;
        assert!(mean.abs() < 0.5 && sigma < grain + 2.5, "{reduction}: {mean}, {sigma}");
    }
}

#[test]
fn a_seed_gives_the_same_bytes() {
    let settings = ScanSettings::draw(5);
    assert_eq!(settings, ScanSettings::draw(5));
    let [first, second] = [0, 1].map(|_| SimulatedScan::draw(5, &settings));
    let place_px = first.truth().marks[0].position_px;
    assert_eq!(first.truth(), second.truth());
    let window = around(&first, place_px, 100, 1);
    assert_eq!(window, around(&second, place_px, 100, 1));
    let other = SimulatedScan::draw(6, &settings);
    assert!(around(&other, other.truth().marks[0].position_px, 100, 1).grey != window.grey);
}

#[test]
fn a_negative_is_the_positive_inverted() {
    let mut settings = at_15_um(ScanSettings::clean(Make::ZeissRmk, Laying::default()));
    // else the contrast is limited by black in the one and by white in the other
    settings.scanner.mark_contrast_grey = [100.0, 100.0];
    let positive = SimulatedScan::draw(8, &settings);
    settings.negative = true;
    let negative = SimulatedScan::draw(8, &settings);
    let place_px = positive.truth().marks[2].position_px;
    let [positive, negative] = [positive, negative].map(|scan| around(&scan, place_px, 150, 1).grey);
    let sums: Vec<f32> = positive.iter().zip(&negative).map(|(positive, negative)| positive + negative).collect();
    assert!(mean_and_sigma(&positive).1 > 10.0 && mean_and_sigma(&sums).1 < 0.8);
}

/// The spread of grey values on the data strip's place beside every side.
fn spread_beside(scan: &SimulatedScan, side: Side) -> f32 {
    let out = settings::outwards(side);
    let along = Vector2::new(-out.y, out.x);
    let corners = [-90.0, 90.0].map(|at| scan.truth().pixel(out * 123.0 + along * at));
    let sampled = (0..900).map(|k| corners[0] + (corners[1] - corners[0]) * (f64::from(k) / 900.0));
    let greys: Vec<f32> = sampled.flat_map(|place_px| around(scan, place_px, 60, 8).grey).collect();
    mean_and_sigma(&greys).1
}

#[test]
fn data_are_written_beside_the_side_that_is_given() {
    for (k, laying) in (40..).zip(Laying::all()) {
        let mut settings = at_15_um(ScanSettings::clean(Make::ZeissRmkTop, laying));
        settings.data_strip = Some(Side::Top);
        let scan = SimulatedScan::draw(k, &settings);
        let (top, bottom) = (spread_beside(&scan, Side::Top), spread_beside(&scan, Side::Bottom));
        assert!(top > 10.0 && bottom < 5.0, "{laying:?}: {top} and {bottom}");
    }
}

#[test]
fn dirt_and_grain_are_there_when_asked_for() {
    let clean = at_15_um(ScanSettings::clean(Make::WildRc20, Laying::default()));
    let poor = ScanSettings { dirt: ScanSettings::poor(clean.camera, clean.laying).dirt, ..clean.clone() };
    let border = |settings: &ScanSettings| {
        let scan = SimulatedScan::draw(9, settings);
        let inside_px = scan.truth().pixel(Vector2::new(60.0, 116.0));
        mean_and_sigma(&around(&scan, inside_px, 60, 1).grey)
    };
    let mut grainy = clean.clone();
    grainy.scanner.grain_grey = [6.0, 6.0];
    grainy.scanner.black_grey = [60.0, 60.0];
    assert!(border(&clean).1 < 1.0);
    assert!((border(&grainy).1 - 6.0).abs() < 0.5);

    let differing = |settings: &ScanSettings| {
        let [with, without] = [settings, &clean].map(|settings| {
            let scan = SimulatedScan::draw(9, settings);
            let [width, height] = scan.size_px();
            scan.window(PixelRect { x: 0, y: 0, width, height }, 16).unwrap().grey
        });
        with.iter().zip(&without).filter(|(with, without)| (**with - **without).abs() > 5.0).count()
    };
    assert!(differing(&poor) > 1000 && differing(&clean) == 0);
}

#[test]
fn a_mark_is_tampered_with_and_no_other() {
    let settings = at_15_um(ScanSettings::clean(Make::LeicaRc30, Laying { turns: 1, mirrored: true }));
    let whole = SimulatedScan::draw(10, &settings);
    let tampered = |corruption: Corruption| {
        let scan = SimulatedScan::draw(10, &ScanSettings { corrupt: Some((5, corruption)), ..settings.clone() });
        assert_eq!(scan.truth().marks[5].state, MarkState::Corrupted(corruption));
        for (index, mark) in whole.truth().marks.iter().enumerate() {
            let same = around(&whole, mark.position_px, 150, 1).grey == around(&scan, mark.position_px, 150, 1).grey;
            assert_eq!(same, index != 5, "{corruption:?} at {index}");
        }
        scan
    };
    for corruption in [Corruption::Covered, Corruption::Scratched, Corruption::Missing] {
        let scan = tampered(corruption);
        let mark = &scan.truth().marks[5];
        assert_eq!(mark.position_px, mark.drawn_px);
    }
    let shifted = tampered(Corruption::shifted(0.3, 1));
    let mark = &shifted.truth().marks[5];
    let shift_px = mark.drawn_px - mark.position_px;
    assert!((shift_px.norm() - 20.0).abs() < 0.2);
    assert!((centroid(&shifted, mark.drawn_px, 0.25) - mark.drawn_px).norm() < 0.03);
}

#[test]
fn content_of_ones_own_is_seen_through_the_frame() {
    let rendered = |rect: PixelRect, reduction: u32| {
        let [width, height] = [rect.width, rect.height].map(|side| side.div_ceil(reduction) as usize);
        let grey =
            (0..width * height).map(|k| if (k % width + rect.x as usize).is_multiple_of(2) { 200.0 } else { 100.0 });
        GreyWindow { origin_px: [rect.x, rect.y], reduction, width, height, grey: grey.collect() }
    };
    let settings = at_15_um(ScanSettings::clean(Make::WildRc5, Laying::default()));
    let scan = SimulatedScan::draw(11, &settings).with_content(Content::Rendered(Box::new(rendered)));
    let inside = around(&scan, scan.truth().pixel(Vector2::zeros()), 20, 1).grey;
    let (first, second) = (inside[0], inside[1]);
    assert!((first - second).abs() > 50.0 && inside.chunks(2).all(|two| two == [first, second]));
    let outside = around(&scan, scan.truth().pixel(Vector2::new(0.0, 116.0)), 20, 1).grey;
    assert!(mean_and_sigma(&outside).1 < 1.0);
}

#[test]
fn the_mixture_has_everything() {
    let all: Vec<ScanSettings> = (0..2000).map(ScanSettings::draw).collect();
    let share = |holds: &dyn Fn(&ScanSettings) -> bool| all.iter().filter(|one| holds(one)).count() as f64 / 2000.0;
    for laying in Laying::all() {
        assert!((share(&|one| one.laying == laying) - 0.125).abs() < 0.03);
    }
    for camera in Make::ALL {
        assert!((share(&|one| one.camera == camera) - 0.125).abs() < 0.03);
    }
    assert!((share(&|one| one.negative) - 0.5).abs() < 0.05);
    assert!((share(&|one| one.asymmetric) - 0.5).abs() < 0.05);
    assert!((share(&|one| one.data_strip.is_some()) - 1.0 / 6.0).abs() < 0.04);
    assert!((share(&|one| one.dirt.cut_off > 0.0) - 0.3).abs() < 0.05);
}
