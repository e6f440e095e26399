//! Real results of simulated scans.

use std::sync::LazyLock;

use serde_json::Value;

use super::close_up::drawn;
use super::*;
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};
use crate::interior::{Wanted, interior_orientation};
use crate::simulation::film::{Laying, Make, ScanSettings, SimulatedScan};

fn scan(seed: u64) -> SimulatedScan<'static> {
    let mut settings = ScanSettings::good(Make::WildRc20, Laying::all()[1]);
    settings.scanner.pixel_um = [25.0, 25.0];
    SimulatedScan::draw(seed, &settings)
}

fn result_of(scan: &SimulatedScan, wanted: &Wanted) -> InteriorResult {
    let found = interior_orientation(scan, scan.plate(), wanted).unwrap();
    InteriorResult::of(&found, scan.plate(), scan.size_px())
}

/// A scan with its green result.
static GREEN: LazyLock<(SimulatedScan<'static>, InteriorResult)> = LazyLock::new(|| {
    let scan = scan(1);
    let wanted = Wanted { pixel_mm: Some(scan.nominal_pixel_um() / 1e3), ..Wanted::default() };
    let result = result_of(&scan, &wanted);
    (scan, result)
});

/// No film at all.
struct Blank;

impl Picture for Blank {
    fn size_px(&self) -> [u32; 2] {
        [2000, 2000]
    }

    fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
        let (width, height) = (rect.width.div_ceil(reduction) as usize, rect.height.div_ceil(reduction) as usize);
        let grey = vec![100.0; width * height];
        Ok(GreyWindow { origin_px: [rect.x, rect.y], reduction, width, height, grey })
    }
}

static RED: LazyLock<InteriorResult> = LazyLock::new(|| {
    let plate = GREEN.0.plate();
    let found = interior_orientation(&Blank, plate, &Wanted::default()).unwrap();
    InteriorResult::of(&found, plate, Blank.size_px())
});

fn holds_null(value: &Value, path: &str, found: &mut Vec<String>) {
    match value {
        Value::Null => found.push(path.to_owned()),
        Value::Array(items) => items.iter().zip(0..).for_each(|(v, k)| holds_null(v, &format!("{path}/{k}"), found)),
        Value::Object(fields) => fields.iter().for_each(|(k, v)| holds_null(v, &format!("{path}/{k}"), found)),
        _ => {}
    }
}

/// Whether every tag is closed; good enough for what is drawn here.
fn is_well_formed(svg: &str) -> bool {
    let mut open = Vec::new();
    for tag in svg.split('<').skip(1) {
        let Some((tag, _)) = tag.split_once('>') else { return false };
        let name = tag.trim_start_matches('/').split([' ', '\n', '/']).next().unwrap_or_default();
        if tag.starts_with('/') {
            if open.pop() != Some(name) {
                return false;
            }
        } else if !tag.ends_with('/') {
            open.push(name);
        }
    }
    open.is_empty()
}

#[test]
fn a_green_result_has_every_number() {
    let (scan, result) = &*GREEN;
    assert_eq!(result.diagnosis.verdict, "green", "{:?}", result.diagnosis.reasons);
    let json = serde_json::to_value(result).unwrap();
    let mut nulls = Vec::new();
    holds_null(&json, "", &mut nulls);
    assert!(nulls.iter().all(|path| path.ends_with("/sensitivity") && path.starts_with("/pairs")), "{nulls:?}");
    for field in ["polarity", "plate_orientation", "transformation"] {
        assert!(json.get(field).is_some(), "{field}");
    }
    let lies = result.plate_orientation.as_ref().unwrap();
    assert_eq!((lies.quarter_turns, lies.turn_deg, lies.reading.as_str(), lies.open), (1, 90, "right", 1));
    assert_eq!(result.marks.len(), scan.plate().fiducials.len());
    let back: InteriorResult = serde_json::from_value(json).unwrap();
    assert_eq!(&back, result);
}

#[test]
fn both_matrices_lead_to_the_same_places_and_the_truth() {
    let (scan, result) = &*GREEN;
    let fitted = result.transformation.as_ref().unwrap();
    let matrix = |rows: [[f64; 3]; 3]| Matrix3::from_fn(|row, column| rows[row][column]);
    let product = matrix(fitted.pixel_from_plate) * matrix(fitted.plate_from_pixel);
    assert!((product - Matrix3::identity()).amax() < 1e-9, "{product}");
    let at = matrix(fitted.pixel_from_plate) * nalgebra::Vector3::new(80.0, -60.0, 1.0);
    let truth = scan.truth().pixel(Vector2::new(80.0, -60.0));
    assert!((at.xy() - truth).norm() < 1.0, "{at} against {truth}");
    assert!(fitted.pixel_size_um.iter().all(|um| (um - 25.0).abs() < 0.1), "{:?}", fitted.pixel_size_um);
    assert!(fitted.rms_residual_um.is_some_and(|um| um > 0.1 && um < 12.0), "{:?}", fitted.rms_residual_um);
}

#[test]
fn sensitivities_are_told_in_pixels_as_the_precision_is() {
    let (scan, result) = &*GREEN;
    let largest = |value: fn(&MarkSensitivity) -> Option<f64>| {
        result.marks.iter().filter_map(|mark| value(mark.sensitivity.as_ref()?)).fold(0.0, f64::max)
    };
    let (change, undetected) = (largest(|s| s.empirical_px), largest(|s| s.theoretical_px));
    assert!((change - result.precision.largest_change_px.unwrap()).abs() < 1e-9);
    assert!((undetected - result.precision.largest_undetected_px.unwrap()).abs() < 1e-9);
    for mark in &result.marks {
        // turned by a quarter, so that the scan's axes are the plate's; the film has 2 micrometres for itself
        let [[xx, _], [_, yy]] = mark.covariance_um2.unwrap();
        let calibrated_um = 1e3 * scan.plate().fiducials.iter().find(|f| f.name == mark.name).unwrap().sigma_mm;
        let expected = |px: f64| (25.0 * px).powi(2) + calibrated_um.powi(2) + 4.0;
        let [across, down] = mark.sigma_px.unwrap().map(expected);
        assert!((xx / down - 1.0).abs() < 0.02 && (yy / across - 1.0).abs() < 0.02, "{xx} {yy} {across} {down}");
        let [x, y] = mark.residual_um.unwrap();
        assert!((x.hypot(y) / 25.0 / mark.residual_px.unwrap() - 1.0).abs() < 0.01);
    }
}

#[test]
fn a_red_result_leaves_out_what_there_is_not() {
    let json = serde_json::to_value(&*RED).unwrap();
    assert_eq!(json["diagnosis"]["verdict"], "red");
    assert_eq!(json["diagnosis"]["reasons"][0]["code"], "marks_not_found");
    let mut nulls = Vec::new();
    holds_null(&json, "", &mut nulls);
    assert_eq!(nulls, Vec::<String>::new());
    assert!(json.get("transformation").is_none() && json["precision"].get("largest_sigma_px").is_none(), "{json}");
    assert!(json["precision"]["promised_px"].as_f64().unwrap() >= 1.0);
    assert_eq!(json["marks"].as_array().unwrap().len(), GREEN.1.marks.len());
    let back: InteriorResult = serde_json::from_value(json).unwrap();
    assert_eq!(back, *RED);
}

#[test]
fn the_drawing_has_all_marks_whatever_became_of_them() {
    let mut odd = GREEN.1.clone();
    odd.marks[0].name = "<&\">".to_owned();
    odd.marks[1].used = false;
    odd.marks[1].residual_um = Some([4000.0, -9000.0]);
    odd.marks[2] = RED.marks[2].clone();
    for (result, ellipses) in [(&GREEN.1, GREEN.1.marks.len()), (&*RED, 0), (&odd, odd.marks.len() - 1)] {
        let svg = residual_plot(result);
        assert!(is_well_formed(&svg) && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert_eq!(svg.matches("<g id=\"mark-").count(), result.marks.len());
        // one in the legend
        assert_eq!(svg.matches("<ellipse").count(), ellipses + 1);
    }
    let svg = residual_plot(&odd);
    assert!(svg.contains("&lt;&amp;&quot;&gt;") && svg.contains("stroke-dasharray"), "{svg}");
}

#[test]
fn a_close_up_shows_the_mark_where_it_was_found() {
    let (scan, result) = &*GREEN;
    for mark in &result.marks {
        let png = close_up(scan, result, mark).unwrap().unwrap();
        let image = image::load_from_memory(&png).unwrap();
        assert_eq!(image.width(), image.height());
        assert!((300..=600).contains(&image.width()), "{}", image.width());
    }
    // 3.2 mm of 25 micrometres, magnified by four
    let image = drawn(scan, 25.0, &result.marks[0]).unwrap().unwrap();
    assert_eq!(image.dimensions(), (512, 512));
}

#[test]
fn a_close_up_is_not_larger_however_fine_the_scan_is_and_shows_the_rim() {
    let mut mark = RED.marks[0].clone();
    assert_eq!(drawn(&Blank, 25.0, &mark).unwrap(), None);
    for pixel_um in [0.5, 4.0, 7.0, 25.0, 200.0] {
        for at in [[1000.0, 1000.0], [0.0, 0.0], [2000.0, 1999.5], [3.0, 1000.0]] {
            mark.predicted_px = Some(at);
            let image = drawn(&Blank, pixel_um, &mark).unwrap().unwrap();
            assert!((300..=600).contains(&image.width()) && image.width() == image.height());
        }
    }
    mark.predicted_px = Some([-4.0, 1000.0]);
    assert_eq!(drawn(&Blank, 25.0, &mark).unwrap(), None);
    // found far from where it should be: shown where it was found
    mark.located_px = Some([1500.0, 500.0]);
    assert!(drawn(&Blank, 25.0, &mark).unwrap().is_some());
}
