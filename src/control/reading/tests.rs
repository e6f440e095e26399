//! What the file says of its CRS, what was given, and how good its buildings are then.

use std::sync::Arc;

use rstest::rstest;
use serde_json::json;

use super::*;
use crate::buildings::samples::{Sample, Town, write};
use crate::buildings::{EdgeKind, Format};
use crate::control::tests::{collection, feature, reading};
use crate::geometry::geoid::{GridFileFault, NamedGrid};
use crate::geometry::{GeoidGrid, Geoids};

/// Has every grid, none of which says anything.
#[derive(Debug)]
struct Blank;

impl Geoids for Blank {
    fn grids(&self, names: &'static [&'static str]) -> Result<Arc<[NamedGrid]>, GridFileFault> {
        let blank = |name: &&'static str| NamedGrid { name, grid: Arc::new(GeoidGrid::new(Vec::new())) };
        Ok(names.iter().map(blank).collect())
    }
}

fn of_model(format: Format, given: Option<&str>, geoid_undulation_m: Option<f64>) -> Reading {
    let crs = given.map(|given| Crs::parse(given).unwrap().with_geoids(Arc::new(Blank)));
    Reading { format: FileFormat::Model(format), crs, geoid_undulation_m, ..reading() }
}

#[rstest]
// the file may name both systems with one code, or with two
#[case("EPSG:7415", "EPSG:28992", Some(43.0), "EPSG:28992")]
#[case("EPSG:6697", "EPSG:6668", Some(36.0), "EPSG:6668")]
#[case("EPSG:7415", "EPSG:28992+5709", None, "EPSG:28992+5709")]
#[case("EPSG:5555", "EPSG:25832+5783", None, "EPSG:25832+5783")]
#[case("EPSG:25832+5783", "EPSG:5555", None, "EPSG:5555")]
#[case("EPSG:25832+7837", "EPSG:25832", Some(46.0), "EPSG:25832")]
#[case("EPSG:25832", "EPSG:25832+7837", None, "EPSG:25832+7837")]
#[case("EPSG:25832", "EPSG:25832", None, "EPSG:25832")]
#[case("EPSG:4326", "EPSG:4979", None, "EPSG:4979")]
// what is given stands for a name that is not known
#[case("my local grid", "EPSG:25832", None, "EPSG:25832")]
#[case("EPSG:2154", "EPSG:25832", None, "EPSG:25832")]
#[case("EPSG:25832+7699", "EPSG:25832", Some(46.0), "EPSG:25832")]
#[case("EPSG:25832+7699", "EPSG:25832+7837", None, "EPSG:25832+7837")]
fn what_is_given_and_what_the_file_names_go_together(
    #[case] named: &str,
    #[case] given: &str,
    #[case] geoid_undulation_m: Option<f64>,
    #[case] expected: &str,
) {
    let reading = of_model(Format::CityGml, Some(given), geoid_undulation_m);
    assert_eq!(agreed(&reading, Some(named)).unwrap().to_string(), expected);
}

#[rstest]
#[case(Some("EPSG:25833"), Some("EPSG:25832"), None, "the file names the CRS EPSG:25833, but EPSG:25832 was given")]
#[case(Some("EPSG:25832+5783"), Some("EPSG:25832+7837"), None, "but EPSG:25832+7837 was given")]
#[case(Some("EPSG:7415"), Some("EPSG:25832"), Some(43.0), "but EPSG:25832 was given")]
#[case(Some("my local grid"), None, None, "\"my local grid\"")]
#[case(Some("EPSG:25832+7699"), Some("EPSG:25832"), None, "EPSG:7699")]
#[case(None, None, None, "give crs")]
// without its grid nothing of the file could be used
#[case(Some("EPSG:7415"), None, None, "geoid grid")]
#[case(Some("EPSG:25832+7837"), Some("EPSG:25832"), None, "geoid grid")]
#[case(Some("EPSG:7415"), None, Some(43.0), "leave the geoid undulation out")]
#[case(None, Some("EPSG:25832+7837"), Some(46.0), "leave the geoid undulation out")]
fn what_does_not_go_together_is_told(
    #[case] named: Option<&str>,
    #[case] given: Option<&str>,
    #[case] geoid_undulation_m: Option<f64>,
    #[case] told: &str,
) {
    let error = agreed(&of_model(Format::CityGml, given, geoid_undulation_m), named).unwrap_err().to_string();
    assert!(error.contains(told), "{error}");
}

/// A town in CityGML, in EPSG:25832+7837.
fn town(buildings: u64) -> String {
    let mut text = Vec::new();
    write(Sample::NrwCityGml2, Town { seed: 3, buildings }, &mut text, &mut |_| {}).unwrap();
    String::from_utf8(text).unwrap()
}

/// What is read: how many buildings, and why others are refused.
fn read(reading: &Reading, text: &str) -> (Result<(), ReadError>, usize, Vec<String>) {
    let (mut good, mut refused) = (0, Vec::new());
    let read = reading.read(&mut text.as_bytes(), &mut |_, raw| {
        match raw {
            Raw::Refused(_, detail) => refused.push(detail),
            _ => good += 1,
        }
        ControlFlow::Continue(())
    });
    (read, good, refused)
}

#[test]
fn a_building_in_another_crs_is_refused_by_itself() {
    let in_another = |text: &str, first: usize, count: usize| {
        let mut houses: Vec<String> = text.split("<bldg:Building ").map(str::to_owned).collect();
        for house in &mut houses[1 + first..][..count] {
            *house = house.replace("<gml:MultiSurface", "<gml:MultiSurface srsName=\"EPSG:25833\"");
        }
        houses.join("<bldg:Building ")
    };
    let reading = of_model(Format::CityGml, Some("EPSG:25832"), Some(46.0));
    let text = town(5);
    for first in [0, 2, 4] {
        let (read, good, refused) = read(&reading, &in_another(&text, first, 1));
        assert!(read.is_ok() && good == 4 && refused.len() == 1, "{read:?} {refused:?}");
        assert!(refused[0].contains("EPSG:25833"), "{}", refused[0]);
    }
    // where none is in the right one, the file as a whole is wrong
    let (read, ..) = read(&reading, &in_another(&text, 0, 5));
    assert!(matches!(read, Err(ReadError::Contradiction { .. })), "{read:?}");
}

#[test]
fn without_a_grid_an_import_ends_at_once() {
    let (read, good, refused) = read(&of_model(Format::CityGml, None, None), &town(500));
    assert!(matches!(read, Err(ReadError::Heights(CrsError::GeoidGridMissing { .. }))), "{read:?}");
    assert_eq!((good, refused.len()), (0, MOST_UNPLACED - 1));
    let features = [feature("a", 16.6, 52.7, 70.0)];
    let geojson = Reading { crs: Some(Crs::parse("EPSG:4258+7837").unwrap()), ..reading() };
    assert!(geojson.read(&mut &collection(&features)[..], &mut |_, _| panic!("read")).is_err());
}

#[test]
fn what_is_in_degrees_must_say_so_itself() {
    let square = json!([[[[0, 1, 2, 3]]]]);
    let text = json!({"type": "CityJSON", "version": "2.0",
        "transform": {"scale": [1e-4, 1e-4, 1], "translate": [7, 50, 60]},
        "vertices": [[0, 0, 9], [1, 0, 9], [1, 1, 9], [0, 1, 9], [9, 9, 9]],
        "CityObjects": {"a": {"type": "Building", "geometry": [{"type": "MultiSurface", "lod": "2",
            "boundaries": square[0], "semantics": {"surfaces": [{"type": "RoofSurface"}], "values": [0]}}]}}});
    let with = |system: &str| {
        let mut text = text.clone();
        text["metadata"] = json!({"referenceSystem": system});
        text["transform"]["scale"] = if system == "EPSG:4326" { json!([1e-4, 1e-4, 1]) } else { json!([9, 9, 1]) };
        text.to_string()
    };
    let given = of_model(Format::CityJson, Some("EPSG:4979"), None);
    assert_eq!(read(&given, &with("EPSG:4326")).1, 1);
    let (read, ..) = read(&given, &with(""));
    assert!(read.unwrap_err().to_string().contains("name the CRS in the file"));
}

#[test]
fn buildings_are_measured_in_degrees_in_every_crs_that_is_in_degrees() {
    let mut geographic = 0;
    for code in 1..40_000 {
        let name = format!("EPSG:{code}");
        if let Ok(crs) = Crs::parse(&name) {
            assert_eq!(buildings::is_geographic(&name), crs.is_geographic(), "{name}");
            geographic += usize::from(crs.is_geographic());
        }
    }
    assert!(geographic > 9, "{geographic}");
}

fn building(roof_rmse_m: Option<f64>) -> Building {
    let edge = RoofEdge { kind: EdgeKind::Ridge, start: [4e5, 57e5, 100.0], end: [400_010.0, 57e5, 100.0] };
    Building { index: 0, name: "a".into(), crs: Some(Arc::from("EPSG:25832")), roof_rmse_m, edges: vec![edge] }
}

#[test]
fn a_roof_is_as_good_as_was_said_and_as_it_fits_its_points() {
    let crs = Arc::new(Crs::parse("EPSG:25832").unwrap());
    for (sigma_m, roof_rmse_m, expected) in [
        (None, None, 0.15),
        (Some(0.05), None, 0.05),
        (None, Some(0.2), 0.25),
        (Some(0.4), Some(0.3), 0.5),
        (None, Some(0.0), 0.15),
    ] {
        let defaults = Defaults { sigma_m, ..Defaults::default() };
        let reading = Reading { defaults, ..of_model(Format::CityJson, None, None) };
        let point = reading.control_point(0, Raw::Building(building(roof_rmse_m), crs.clone())).unwrap();
        assert!((point.sigma_m - expected).abs() < 1e-12 && point.edges[0].sigma_m == point.sigma_m, "{point:?}");
    }
    let reading = of_model(Format::CityJson, None, None);
    let refused = reading.control_point(0, Raw::Building(building(Some(1e3)), crs)).unwrap_err();
    assert!(refused.detail.contains("at most 100 m"), "{}", refused.detail);
}

#[test]
fn a_sigma_that_was_given_stands_for_one_that_lines_do_not_have() {
    let mut line = feature("a", 16.6, 52.7, 70.0);
    line["properties"]["sigma_m"] = json!(null);
    let of = |sigma_m| {
        let reading = Reading { defaults: Defaults { sigma_m, ..Defaults::default() }, ..reading() };
        reading.control_point(0, Raw::Feature(line.clone()))
    };
    assert_eq!(of(Some(0.3)).unwrap().sigma_m, 0.3);
    assert!(of(None).unwrap_err().detail.contains("sigma_m is missing"));
    for (sigma_m, good) in [(0.1, true), (100.0, true), (0.0, false), (-1.0, false), (101.0, false), (f64::NAN, false)]
    {
        assert_eq!(Defaults { sigma_m: Some(sigma_m), ..Defaults::default() }.check().is_ok(), good, "{sigma_m}");
    }
}

#[test]
fn everything_that_is_read_weighs_what_it_holds() {
    let mut large = feature("a", 16.6, 52.7, 70.0);
    let small = Raw::Feature(large.clone()).weight();
    large["geometry"]["coordinates"] = json!(vec![[[16.6, 52.7, 70.0], [16.7, 52.7, 70.0]]; 5_000]);
    // six numbers, two positions and a line each
    let numbers = Raw::Feature(large.clone()).weight();
    assert!(small < 50 && (45_000..45_050).contains(&numbers), "{small} {numbers}");
    large["properties"]["note"] = json!("x".repeat(48_000));
    assert!(Raw::Feature(large).weight() >= numbers + 1_000);
    let crs = Arc::new(Crs::parse("EPSG:25832").unwrap());
    let long = Building { name: "x".repeat(48_000), ..building(None) };
    assert_eq!(Raw::Building(building(None), crs.clone()).weight(), 1);
    assert_eq!(Raw::Building(long, crs).weight(), 1_001);
    assert_eq!(Raw::Refused(Some("x".repeat(480)), "y".repeat(480)).weight(), 20);
}

#[test]
fn what_strangers_write_is_cut_in_rejections() {
    let mut line = feature(&"ä".repeat(100_000), 16.6, 52.7, 70.0);
    line["geometry"] = json!("x".repeat(100_000));
    let rejection = reading().control_point(0, Raw::Feature(line)).unwrap_err();
    assert!(rejection.detail.chars().count() == 300 && rejection.name.unwrap().chars().count() == 200);
}
