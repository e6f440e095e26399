//! Sets, check points, validity, and imports that go on where they were.

use std::io::Write as _;
use std::ops::ControlFlow;
use std::sync::Arc;

use nalgebra::Vector3;
use serde_json::{Value, json};

use super::points::{FileIdentity, Filter, Import};
use super::reading::Raw;
use super::sets::{DEFAULT_SET, NewSet};
use super::tests::{anything, collection, database, feature, geographic, import_to, nadir, reading};
use super::*;
use crate::buildings::{Building, EdgeKind, RoofEdge};
use crate::database::{Database, query};
use crate::geometry::{Crs, LocalFrame};
use near::{Reach, Wanted};

const LINES: Kinds = Kinds { lines: true, scenes: false };

fn with(mut feature: Value, property: &str, value: Value) -> Value {
    feature["properties"][property] = value;
    feature
}

async fn points_of(database: &Database, set: &str) -> i64 {
    let set = sets::by_name(database, set).await.unwrap().unwrap();
    let rows: i64 = query("SELECT count(*) FROM control_points WHERE set_id = $1")
        .bind(set.id)
        .fetch_value(database)
        .await
        .unwrap();
    assert_eq!(rows, set.points, "counted");
    rows
}

#[tokio::test]
async fn a_building_may_be_in_several_sets() {
    let pool = database().await;
    let (a, b) = (feature("a", 16.6, 52.7, 70.0), feature("b", 16.6, 52.7, 70.0));
    import_to(&pool, "2019", &collection(&[a.clone(), b]), Mode::Upsert).await;
    let report = import_to(&pool, "2024", &collection(&[a]), Mode::Upsert).await;
    assert_eq!((report.imported, report.updated), (1, 0));
    // all there is in its set, and nothing of the others
    import_to(&pool, "2024", &collection(&[feature("c", 16.6, 52.7, 70.0)]), Mode::Replace).await;
    assert_eq!((points_of(&pool, "2019").await, points_of(&pool, "2024").await), (2, 1));
    assert!(points::by_name(&pool, "2024", "a").await.unwrap().is_none());
    assert!(points::by_name(&pool, "2019", "a").await.unwrap().is_some());
    assert!(points::remove(&pool, "2019", "a").await.unwrap());
    assert!(!points::remove(&pool, "2024", "a").await.unwrap());
    assert_eq!(points_of(&pool, "2019").await, 1);
    assert_eq!(points::count(&pool).await.unwrap(), 2);
    let of = async |set: &str| {
        let filter = Filter { sets: Some(vec![set.to_owned()]), ..Filter::default() };
        let region = GeodeticBox::around_place([16.6, 52.7], 50.0);
        let listed = points::listed(&pool, None, &filter, 0, 9).await.unwrap();
        assert_eq!(points::in_box(&pool, region, &filter, 0, 9).await.unwrap(), listed);
        listed.into_iter().map(|kept| kept.point.name).collect::<Vec<_>>()
    };
    assert_eq!((of("2019").await, of("2024").await), (vec!["b".to_owned()], vec!["c".to_owned()]));
    assert!(sets::remove(&pool, "2019").await.unwrap() && !sets::remove(&pool, "2019").await.unwrap());
    assert!(sets::remove(&pool, DEFAULT_SET).await.unwrap());
    let names: Vec<String> = sets::all(&pool).await.unwrap().into_iter().map(|set| set.name).collect();
    assert_eq!(names, ["2024", DEFAULT_SET]);
}

#[tokio::test]
async fn nothing_is_written_into_a_set_that_is_gone() {
    let pool = database().await;
    import_to(&pool, "a", &collection(&[feature("1", 16.6, 52.7, 70.0)]), Mode::Upsert).await;
    let id = sets::by_name(&pool, "a").await.unwrap().unwrap().id;
    sets::remove(&pool, "a").await.unwrap();
    let mut transaction = pool.begin_alone().await.unwrap();
    let widened = sets::widened(&mut transaction, id, GeodeticBox::around_place([16.6, 52.7], 10.0)).await;
    assert!(matches!(widened, Err(ControlError::SetRemoved)));
}

#[tokio::test]
async fn an_import_says_more_of_a_set_and_never_less() {
    let pool = database().await;
    let body = collection(&[feature("a", 16.6, 52.7, 70.0)]);
    for (survey_year, description) in [(Some(2024), Some("walls")), (None, None)] {
        let set = NewSet { name: "x".into(), survey_year, description: description.map(str::to_owned) };
        let (import, body) = (Import { set, ..Import::default() }, body.clone());
        points::import(&pool, &import, reading(), move |reading, each| reading.read(&mut &body[..], each), |_| {})
            .await
            .unwrap();
        let kept = sets::by_name(&pool, "x").await.unwrap().unwrap();
        assert_eq!((kept.survey_year, kept.description.as_deref(), kept.points), (Some(2024), Some("walls"), 1));
    }
}

#[tokio::test]
async fn an_image_gets_the_sets_the_day_and_the_use_that_are_right() {
    let pool = database().await;
    let place = |name: &str| feature(name, 16.6, 52.7, 80.0);
    let old = [place("church"), with(place("barn"), "valid_to", json!("2020-06-30"))];
    let new = [
        with(place("church"), "sigma_m", json!(0.2)),
        with(place("hall"), "valid_from", json!("2020-07-01")),
        with(place("tower"), "use", json!("check")),
    ];
    for (set, survey_year, features) in [("new", 2024, &new[..]), ("old", 2019, &old[..])] {
        let set = NewSet { name: set.into(), survey_year: Some(survey_year), description: None };
        let (import, body) = (Import { set, ..Import::default() }, collection(features));
        points::import(&pool, &import, reading(), move |reading, each| reading.read(&mut &body[..], each), |_| {})
            .await
            .unwrap();
    }
    let (frame, (camera, approximation)) = (LocalFrame::at(16.6, 52.7, 0.0), nadir(580.0));
    let found = async |sets: Option<&[&str]>, date: Option<&str>| {
        let wanted = Wanted {
            sets: sets.map(|sets| sets.iter().map(|set| (*set).to_owned()).collect()),
            date: date.map(|date| date.parse().unwrap()),
            ..anything(LINES)
        };
        let half_view_rad = camera.half_view_rad();
        let near = around(&pool, &frame, half_view_rad, &approximation, Reach::default(), &wanted).await.unwrap();
        let told = |points: Vec<crate::orientation::ControlPoint>| {
            points.iter().map(|point| format!("{} {}", point.name, point.sigma_m)).collect::<Vec<_>>().join(", ")
        };
        [told(near.lines), told(near.check)]
    };
    // of the two churches the one that was surveyed last
    assert_eq!(found(None, None).await, ["barn 0.1, church 0.2, hall 0.1", "tower 0.1"]);
    assert_eq!(found(Some(&["old"]), None).await, ["barn 0.1, church 0.1", ""]);
    assert_eq!(found(None, Some("2020-06-30")).await, ["barn 0.1, church 0.2", "tower 0.1"]);
    assert_eq!(found(None, Some("2020-07-01")).await, ["church 0.2, hall 0.1", "tower 0.1"]);
    assert_eq!(found(Some(&[]), None).await, ["", ""]);
    // held out anywhere, however old the survey, it orients nothing
    import_to(&pool, "held out", &collection(&[with(place("church"), "use", json!("check"))]), Mode::Upsert).await;
    assert_eq!(found(None, None).await, ["barn 0.1, hall 0.1", "church 0.1, tower 0.1"]);
    assert_eq!(found(Some(&["new"]), None).await, ["church 0.2, hall 0.1", "tower 0.1"]);
}

/// Where all lies is told from the sets, without looking at every control point.
#[tokio::test]
async fn the_extent_is_that_of_what_was_imported_and_is_still_there() {
    let pool = database().await;
    let told = async || {
        let (count, bounds) = points::extent(&pool).await.unwrap();
        (count, bounds.map(|bounds| [bounds.min_lon_deg, bounds.max_lon_deg].map(|lon| (lon * 100.0).round() / 100.0)))
    };
    assert_eq!(told().await, (0, None));
    import_to(&pool, "a", &collection(&[feature("1", 16.6, 52.7, 70.0)]), Mode::Upsert).await;
    import_to(&pool, "a", &collection(&[feature("2", 16.8, 52.7, 70.0)]), Mode::Upsert).await;
    import_to(&pool, DEFAULT_SET, &collection(&[feature("3", 17.0, 52.7, 70.0)]), Mode::Upsert).await;
    assert_eq!(told().await, (3, Some([16.6, 17.0])));
    sets::remove(&pool, DEFAULT_SET).await.unwrap();
    assert_eq!(told().await, (2, Some([16.6, 16.8])));
    import_to(&pool, DEFAULT_SET, &collection(&[feature("4", 16.5, 52.7, 70.0)]), Mode::Upsert).await;
    assert_eq!(told().await, (3, Some([16.5, 16.8])));
}

#[tokio::test]
async fn what_is_said_of_edges_comes_back() {
    let pool = database().await;
    let said = with(feature("a", 16.6, 52.7, 70.0), "edge_kinds", json!(["eave", null]));
    let exact = with(said.clone(), "edge_sigma_m", json!([0.4, 0.05]));
    for (feature, sigmas_m) in [(said, [0.1_f64.hypot(0.57), 0.1]), (exact, [0.4, 0.05])] {
        import_to(&pool, DEFAULT_SET, &collection(&[feature]), Mode::Upsert).await;
        let kept = points::by_name(&pool, DEFAULT_SET, "a").await.unwrap().unwrap();
        let crs = geographic();
        let target = Source { crs: &crs, geoid_undulation_m: None };
        let properties = geojson::feature(&kept.point, DEFAULT_SET, &target).unwrap().properties;
        assert_eq!(properties.edge_kinds, Some(vec![Some("eave"), None]));
        for (back, expected) in properties.edge_sigma_m.unwrap().into_iter().zip(sigmas_m) {
            assert!((back - expected).abs() < 5.1e-4, "{back} is not {expected}");
        }
        let in_frame = kept.point.in_frame(&LocalFrame::at(16.6, 52.7, 0.0));
        assert!((in_frame.edge_sigma_m(0) - sigmas_m[0]).abs() < 5.1e-4 && in_frame.sigma_m == 0.1);
    }
    let bad = [
        ("edge_kinds", json!(["eave"]), "1 entries for 2 lines"),
        ("edge_kinds", json!(["eave", "roof"]), "\"roof\""),
        ("edge_sigma_m", json!([0.1, 0.0]), "above 0"),
        ("valid_from", json!("2020-13-01"), "not a feature"),
        ("use", json!("both"), "not a feature"),
    ];
    for (property, value, told) in bad {
        let feature = with(feature("b", 16.6, 52.7, 70.0), property, value);
        let report = import_to(&pool, DEFAULT_SET, &collection(&[feature]), Mode::Upsert).await;
        assert!(report.rejected[0].detail.contains(told), "{}", report.rejected[0].detail);
    }
}

/// A row of houses of one ridge and one eave each, 30 m apart.
fn building(index: usize) -> Building {
    let (x, y) = (400_000.0 + 30.0 * (index % 300) as f64, 5_700_000.0 + 30.0 * (index / 300) as f64);
    let edge = |kind, offset: f64| RoofEdge { kind, start: [x, y + offset, 100.0], end: [x + 10.0, y + offset, 100.0] };
    Building {
        index,
        name: format!("DENW{index:08}"),
        crs: Some(Arc::from("EPSG:25832")),
        roof_rmse_m: None,
        edges: vec![edge(EdgeKind::Ridge, 5.0), edge(EdgeKind::Eave, 0.0)],
    }
}

fn model_reading(crs: Option<&str>) -> Reading {
    let format = FileFormat::Model(crate::buildings::Format::CityGml);
    Reading { format, crs: crs.map(|crs| Crs::parse(crs).unwrap()), ..reading() }
}

#[tokio::test]
async fn an_import_that_was_interrupted_goes_on_where_it_was() {
    const COUNT: usize = 45_000;
    let pool = database().await;
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(b"a model").unwrap();
    let identity = FileIdentity::of(file.path()).unwrap();
    let crs = Arc::new(Crs::parse("EPSG:25832").unwrap());
    let run = async |broken_at: usize, anew: bool, undulation_m: Option<f64>| {
        let import = Import { file: Some(identity), anew, ..Import::default() };
        let crs = crs.clone();
        let mut steps = Vec::new();
        let read = points::import(
            &pool,
            &import,
            Reading { geoid_undulation_m: undulation_m, ..model_reading(None) },
            move |_, each| {
                for index in 0..COUNT {
                    if index == broken_at {
                        return Err(ReadError::NoCrs);
                    }
                    let raw = match index % 1_000 {
                        7 => Raw::Refused(None, "has no roof".into()),
                        _ => Raw::Building(building(index), crs.clone()),
                    };
                    if each(index, raw) == ControlFlow::Break(()) {
                        break;
                    }
                }
                Ok(())
            },
            |step| steps.push((step.items_done, step.rejected.len())),
        );
        let read = read.await.map_err(|error| error.to_string());
        (read, steps)
    };
    let (read, steps) = run(30_000, false, None).await;
    assert!(read.is_err());
    assert_eq!(steps, [(20_000, 20)]);
    assert_eq!(points_of(&pool, DEFAULT_SET).await, 19_980);
    let (read, steps) = run(COUNT, false, None).await;
    let report = read.unwrap();
    assert_eq!((report.imported, report.updated, report.rejected_count), (44_955, 0, 45));
    assert_eq!(report.resumed_at, Some(20_000));
    // of those that were refused before it is known how many they were
    assert_eq!(report.rejected_by_reason[0].count, 25);
    assert_eq!(steps, [(40_000, 20), (45_000, 5)]);
    assert_eq!(points_of(&pool, DEFAULT_SET).await, 44_955);
    // it came to its end: again means anew
    let (read, _) = run(COUNT, false, None).await;
    let again = read.unwrap();
    assert_eq!((again.imported, again.updated, again.resumed_at), (0, 44_955, None));
    run(25_000, false, None).await.0.unwrap_err();
    let anew = run(COUNT, true, None).await.0.unwrap();
    assert_eq!((anew.updated, anew.resumed_at), (44_955, None));
    // understood in another way it is another import: what was written with the wrong heights would stay
    run(25_000, false, None).await.0.unwrap_err();
    let mended = run(25_000, false, Some(46.0)).await.0.unwrap_err();
    let resumed = run(COUNT, false, Some(46.0)).await.0.unwrap();
    assert_eq!((mended.as_str(), resumed.resumed_at), (ReadError::NoCrs.to_string().as_str(), Some(20_000)));
    assert_eq!(resumed.updated, 44_955);
    // and behind what was removed nothing goes on
    run(25_000, false, None).await.0.unwrap_err();
    sets::remove(&pool, DEFAULT_SET).await.unwrap();
    let again = run(COUNT, false, None).await.0.unwrap();
    assert_eq!((again.imported, again.resumed_at), (44_955, None));
}

#[test]
fn the_roof_edges_of_a_model_are_as_good_as_their_kind_allows() {
    let crs = Arc::new(Crs::parse("EPSG:25832").unwrap());
    let point = model_reading(None).control_point(3, Raw::Building(building(3), crs.clone())).unwrap();
    assert_eq!((point.name.as_str(), point.sigma_m), ("DENW00000003", 0.15_f64.hypot(crs.accuracy_m())));
    let [ridge, eave] = &point.edges[..] else { panic!("{:?}", point.edges) };
    assert_eq!((ridge.kind, eave.kind), (Some(EdgeKind::Ridge), Some(EdgeKind::Eave)));
    assert!(ridge.sigma_m == point.sigma_m && eave.sigma_m > 0.55);
    let middle = crs.geocentric_from_position([400_095.0, 5_700_002.5, 100.0], None).unwrap();
    assert!((point.reference_geocentric_m - middle).norm() < 1e-3);
    let bare = Building { edges: Vec::new(), ..building(4) };
    let refused = model_reading(None).control_point(4, Raw::Building(bare, crs.clone())).unwrap_err();
    assert!(refused.index == 4 && refused.detail.contains("no roof edges"));
    let far = Building {
        edges: vec![RoofEdge { kind: EdgeKind::Rim, start: [4e5, 57e5, 0.0], end: [4.1e5, 57e5, 0.0] }],
        ..building(5)
    };
    assert!(model_reading(None).control_point(5, Raw::Building(far, crs)).unwrap_err().detail.contains("one building"));
}

/// Rows of before sets are in the default one, as they were to the last bit.
#[tokio::test]
async fn control_points_of_before_are_in_the_default_set() {
    let pool = sqlx::SqlitePool::connect("sqlite::memory:").await.unwrap();
    let before = include_str!("../../migrations/sqlite/0050_control_points.sql");
    let after = include_str!("../../migrations/sqlite/0065_control_sets.sql");
    sqlx::raw_sql(before).execute(&pool).await.unwrap();
    sqlx::raw_sql("CREATE TABLE images (id BLOB)").execute(&pool).await.unwrap();
    let numbers = [3.7e6, 0.1, 5.05e6 / 3.0, 3.7e6, 0.2, 1.0_f64];
    sqlx::query("INSERT INTO control_points VALUES (7, 'a', 0.1, 3.7e6, 0, 1, $1)")
        .bind(numbers.into_iter().flat_map(f64::to_le_bytes).collect::<Vec<u8>>())
        .execute(&pool)
        .await
        .unwrap();
    sqlx::raw_sql(after).execute(&pool).await.unwrap();
    let kept = points::by_name(&Database::Sqlite(pool), DEFAULT_SET, "a").await.unwrap().unwrap();
    assert_eq!((kept.id, kept.point.purpose, kept.point.validity), (7, Use::Control, Validity::default()));
    assert_eq!(kept.point.edges[0].geocentric_m.start, Vector3::new(3.7e6, 0.1, 5.05e6 / 3.0));
    assert!(kept.point.in_frame(&LocalFrame::at(0.0, 0.0, 0.0)).edge_sigmas_m.is_empty());
}
