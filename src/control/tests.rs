use nalgebra::{Vector2, Vector3};
use rstest::rstest;
use serde_json::{Value, json};

use super::*;
use crate::database::{Database, query};
use crate::geometry::{Brown, Camera, Crs, ExteriorOrientation, LocalFrame, rotation};
use crate::pipeline::Approximation;
use near::Reach;
use points::{Filter, Import};
use sets::{DEFAULT_SET, NewSet};

pub(super) fn geographic() -> Crs {
    Crs::parse("EPSG:4979").unwrap()
}

pub(super) async fn database() -> Database {
    match crate::store::scratch::database_url().await {
        Some(url) => Database::postgres(&url).await.unwrap(),
        None => Database::in_memory().await.unwrap(),
    }
}

pub(super) fn feature(name: &str, lon: f64, lat: f64, height: f64) -> Value {
    json!({"type": "Feature", "properties": {"name": name, "sigma_m": 0.1},
        "geometry": {"type": "MultiLineString", "coordinates": [
            [[lon, lat, height], [lon + 1e-4, lat, height]],
            [[lon + 1e-4, lat, height], [lon + 1e-4, lat + 1e-4, height + 3.0]]]}})
}

pub(super) fn collection(features: &[Value]) -> Vec<u8> {
    json!({"type": "FeatureCollection", "features": features}).to_string().into_bytes()
}

/// GeoJSON with positions in EPSG:4979.
pub(super) fn reading() -> Reading {
    Reading {
        format: FileFormat::GeoJson,
        crs: Some(geographic()),
        geoid_undulation_m: None,
        defaults: geojson::Defaults::default(),
        heights_assumed: std::sync::Arc::default(),
    }
}

async fn import(database: &Database, body: &[u8], mode: Mode) -> ImportReport {
    import_to(database, DEFAULT_SET, body, mode).await
}

pub(super) async fn import_to(database: &Database, set: &str, body: &[u8], mode: Mode) -> ImportReport {
    let import = Import { set: NewSet { name: set.into(), ..NewSet::default() }, mode, ..Import::default() };
    let body = body.to_vec();
    points::import(database, &import, reading(), move |reading, each| reading.read(&mut &body[..], each), |_| {})
        .await
        .unwrap()
}

fn counts(report: &ImportReport) -> (usize, usize, usize) {
    assert_eq!(report.rejected.len(), report.rejected_count);
    (report.imported, report.updated, report.rejected.len())
}

async fn by_name(database: &Database, name: &str) -> Option<StoredControlPoint> {
    points::by_name(database, DEFAULT_SET, name).await.unwrap().map(|kept| kept.point)
}

/// All there is in a box, whatever set it is of.
async fn in_box(database: &Database, region: GeodeticBox, after: i64, limit: usize) -> Vec<points::Kept> {
    points::in_box(database, region, &Filter::default(), after, limit).await.unwrap()
}

async fn listed(database: &Database, after: i64, limit: usize) -> Vec<points::Kept> {
    points::listed(database, None, &Filter::default(), after, limit).await.unwrap()
}

#[tokio::test]
async fn modes_do_what_they_say() {
    let pool = database().await;
    let two = collection(&[feature("a", 16.6, 52.7, 70.0), feature("b", 16.7, 52.7, 70.0)]);
    assert_eq!(counts(&import(&pool, &two, Mode::Insert).await), (2, 0, 0));
    let moved = collection(&[feature("b", 16.8, 52.7, 71.0), feature("c", 16.9, 52.7, 70.0)]);
    let again = import(&pool, &moved, Mode::Insert).await;
    assert_eq!(counts(&again), (1, 0, 1));
    assert_eq!((again.rejected[0].index, again.rejected[0].name.as_deref()), (0, Some("b")));
    assert_eq!(counts(&import(&pool, &moved, Mode::Upsert).await), (0, 2, 0));
    assert_eq!(points::count(&pool).await.unwrap(), 3);
    // the box moved with it
    let there = GeodeticBox::around_place([16.8, 52.7], 100.0);
    assert_eq!(in_box(&pool, there, 0, 10).await.len(), 1);
    let before = GeodeticBox::around_place([16.7, 52.7], 100.0);
    assert_eq!(in_box(&pool, before, 0, 10).await.len(), 0);
    let only = collection(&[feature("c", 16.9, 52.7, 70.0), feature("d", 16.9, 52.8, 70.0)]);
    assert_eq!(counts(&import(&pool, &only, Mode::Replace).await), (1, 1, 0));
    assert_eq!(points::count(&pool).await.unwrap(), 2);
    assert!(by_name(&pool, "a").await.is_none());
    assert_eq!(listed(&pool, 0, 10).await.len(), 2);
}

#[tokio::test]
async fn replacing_by_nothing_but_bad_features_removes_nothing() {
    let pool = database().await;
    import(&pool, &collection(&[feature("a", 16.6, 52.7, 70.0)]), Mode::Upsert).await;
    let report = import(&pool, &collection(&[json!({"type": "Feature"})]), Mode::Replace).await;
    assert_eq!(counts(&report), (0, 0, 1));
    assert_eq!(points::count(&pool).await.unwrap(), 1);
}

/// A feature with another value at a pointer.
fn spoilt(pointer: &str, value: Value) -> Value {
    let mut feature = feature("spoilt", 16.6, 52.7, 70.0);
    *feature.pointer_mut(pointer).unwrap() = value;
    feature
}

#[rstest]
#[case(spoilt("/geometry", Value::Null), "geometry is missing")]
#[case(spoilt("/geometry/type", json!("LineString")), "it must be a MultiLineString")]
#[case(spoilt("/geometry/coordinates", json!([])), "0 lines")]
#[case(spoilt("/geometry/coordinates", json!([[[16.6, 52.7], [16.7, 52.7]]])), "2 numbers")]
#[case(spoilt("/geometry/coordinates/1/0", json!([16.6, 52.7, 70.0, 1.0])), "line 1: a position has 4 numbers")]
#[case(spoilt("/geometry/coordinates/0", json!([[16.6, 52.7, 70], [16.7, 52.7, 70], [16.7, 52.8, 70]])), "3 positions")]
#[case(spoilt("/geometry/coordinates/0/0/1", json!(95.0)), "latitude")]
#[case(spoilt("/geometry/coordinates/0/0/2", json!("high")), "lists of positions")]
#[case(spoilt("/geometry/coordinates/0/0/2", Value::Null), "lists of positions")]
#[case(spoilt("/geometry/coordinates/0/1", json!([16.6, 52.7, 70.0])), "needs a length")]
#[case(spoilt("/geometry/coordinates/0/1", json!([16.9, 52.7, 70.0])), "one building")]
#[case(spoilt("/geometry/coordinates", json!(vec![[[16.6, 52.7, 70.0], [16.6001, 52.7, 70.0]]; 2_001])), "2001 lines")]
#[case(spoilt("/properties", Value::Null), "properties are missing")]
#[case(spoilt("/properties/name", Value::Null), "name is missing")]
#[case(spoilt("/properties/name", json!(" ")), "name is empty")]
#[case(spoilt("/properties/name", json!("a".repeat(201))), "at most 200")]
#[case(spoilt("/properties/sigma_m", Value::Null), "sigma_m is missing")]
#[case(spoilt("/properties/sigma_m", json!(0)), "above 0")]
#[case(spoilt("/properties/sigma_m", json!(-0.1)), "above 0")]
#[case(json!("feature"), "not a feature")]
#[tokio::test]
async fn a_bad_feature_never_loses_the_good_ones(#[case] bad: Value, #[case] said: &str) {
    let pool = database().await;
    let body = collection(&[feature("first", 16.6, 52.7, 70.0), bad, feature("last", 16.6, 52.8, 70.0)]);
    let report = import(&pool, &body, Mode::Upsert).await;
    assert_eq!(counts(&report), (2, 0, 1));
    assert_eq!(report.rejected[0].index, 1);
    assert!(report.rejected[0].detail.contains(said), "{}", report.rejected[0].detail);
}

#[tokio::test]
async fn a_name_twice_in_a_file_is_kept_once() {
    let pool = database().await;
    let body = collection(&[feature("a", 16.6, 52.7, 70.0), feature("a", 16.7, 52.7, 70.0)]);
    let report = import(&pool, &body, Mode::Upsert).await;
    assert_eq!(counts(&report), (1, 0, 1));
    assert!(report.rejected[0].detail.contains("earlier"));
}

#[rstest]
#[case(b"{", true)]
#[case(b"[]", false)]
#[case(b"{\"type\": \"Feature\", \"features\": []}", false)]
#[case(b"{\"type\": \"FeatureCollection\"}", false)]
#[case(b"{\"type\": \"FeatureCollection\", \"features\": [1e999]}", true)]
fn what_is_no_collection_is_refused(#[case] body: &[u8], #[case] syntax: bool) {
    let crs = geographic();
    let error = geojson::parse(body, &Source { crs: &crs, geoid_undulation_m: None }).unwrap_err();
    assert_eq!(matches!(error, CollectionError::Syntax(_)), syntax, "{error}");
}

#[tokio::test]
async fn positions_come_back_in_the_crs_asked_for_and_heights_as_they_were_given() {
    let pool = database().await;
    let crs = geographic();
    let with_undulation = Source { crs: &crs, geoid_undulation_m: Some(38.0) };
    let body = collection(&[feature("a", 16.6, 52.7, 70.0)]);
    let reading = Reading { geoid_undulation_m: Some(38.0), ..reading() };
    let import = Import::default();
    points::import(&pool, &import, reading, move |reading, each| reading.read(&mut &body[..], each), |_| {})
        .await
        .unwrap();
    let stored = by_name(&pool, "a").await.unwrap();
    let back = geojson::feature(&stored, DEFAULT_SET, &with_undulation).unwrap();
    let ellipsoidal = geojson::feature(&stored, DEFAULT_SET, &Source { crs: &crs, geoid_undulation_m: None }).unwrap();
    let ([start, _], [above, _]) = (back.geometry.coordinates[0], ellipsoidal.geometry.coordinates[0]);
    assert!((start[0] - 16.6).abs() < 1e-11 && (start[1] - 52.7).abs() < 1e-11 && (start[2] - 70.0).abs() < 1e-6);
    assert!((above[2] - 108.0).abs() < 1e-6);
    assert_eq!(stored.sigma_m, 0.1);
}

#[tokio::test]
async fn the_accuracy_of_the_crs_is_added_to_that_of_the_coordinates() {
    // Gauss-Krueger zone 3 on DHDN: seven parameters that are good to a metre or so
    let crs = Crs::parse("EPSG:31467").unwrap();
    assert!(crs.accuracy_m() > 0.5);
    let mut point = feature("a", 0.0, 0.0, 70.0);
    point["geometry"]["coordinates"] = json!([[[3_565_000.0, 5_934_000.0, 50.0], [3_565_010.0, 5_934_000.0, 50.0]]]);
    let body = collection(&[point]);
    let parsed = geojson::parse(&body, &Source { crs: &crs, geoid_undulation_m: None }).unwrap();
    let (_, stored) = &parsed.control_points[0];
    assert_eq!(stored.sigma_m, 0.1_f64.hypot(crs.accuracy_m()));
}

pub(super) fn nadir(camera_height_m: f64) -> (Camera, Approximation) {
    let camera = Camera::new([4000, 3000], 3000.0, Vector2::new(2000.0, 1500.0), Brown::default()).unwrap();
    let approximation = Approximation {
        orientation: ExteriorOrientation {
            projection_centre_m: Vector3::new(0.0, 0.0, camera_height_m),
            camera_from_object: rotation::camera_from_object(0.0, 0.0, 0.0),
        },
        sigma_position_m: [1.0; 3],
        sigma_tilt_rad: 0.01,
        sigma_kappa_rad: None,
    };
    (camera, approximation)
}

/// Control points on a raster of 100 m, 4 km wide: those in the view are found, those far outside are not, and so
/// across the antimeridian.
#[rstest]
#[case(16.6)]
#[case(180.0)]
#[case(-179.99)]
#[tokio::test]
async fn what_may_be_in_view_is_found(#[case] lon: f64) {
    let pool = database().await;
    let frame = LocalFrame::at(lon, 10.0, 0.0);
    let crs = geographic();
    let raster = (-20..=20).flat_map(|x| (-20..=20).map(move |y| (x, y)));
    let features = raster.map(|(x, y)| {
        let place = frame.to_geocentric(Vector3::new(100.0 * f64::from(x), 100.0 * f64::from(y), 80.0));
        let [lon, lat, height] = crs.position_from_geocentric(place, None).unwrap();
        let mut feature = feature(&format!("{x},{y}"), lon.min(179.9998), lat, height);
        feature["properties"]["reference"] = json!([lon, lat, height]);
        feature
    });
    let report = import(&pool, &collection(&features.collect::<Vec<_>>()), Mode::Upsert).await;
    assert_eq!(counts(&report), (41 * 41, 0, 0), "{:?}", report.rejected.first());
    let (camera, approximation) = nadir(580.0);
    let found = around(&pool, &frame, camera.half_view_rad(), &approximation, Reach::default(), &anything(BOTH))
        .await
        .unwrap()
        .lines;
    let distance = |point: &crate::orientation::ControlPoint| point.reference_m.xy().norm();
    // 500 m above ground the corner of the view is 417 m away
    assert_eq!(found.iter().filter(|p| distance(p) < 417.0).count(), 57);
    assert!(found.iter().all(|p| distance(p) < 700.0), "{:?}", found.iter().map(distance).fold(0.0, f64::max));
    let few = Reach { most: 9, ..Reach::default() };
    let found =
        around(&pool, &frame, camera.half_view_rad(), &approximation, few, &anything(BOTH)).await.unwrap().lines;
    assert!(found.len() == 9 && found.iter().all(|p| distance(p) < 150.0));
    // an oblique image does not show what is below the camera
    let mut oblique = approximation;
    oblique.orientation.camera_from_object = rotation::camera_from_object(0.7, 0.0, 0.0);
    let middle_m = oblique.orientation.ground_point_m(1.0, Vector2::zeros(), 80.0).unwrap();
    let found = around(&pool, &frame, camera.half_view_rad(), &oblique, few, &anything(BOTH)).await.unwrap().lines;
    let off_middle_m = |point: &crate::orientation::ControlPoint| (point.reference_m - middle_m).xy().norm();
    assert!(middle_m.xy().norm() > 400.0);
    assert!(found.len() == 9 && found.iter().all(|p| off_middle_m(p) < 200.0));
}

#[tokio::test]
async fn an_empty_database_has_nothing_in_view() {
    let (camera, approximation) = nadir(500.0);
    let frame = LocalFrame::at(16.6, 52.7, 0.0);
    let pool = database().await;
    let near =
        around(&pool, &frame, camera.half_view_rad(), &approximation, Reach::default(), &anything(BOTH)).await.unwrap();
    assert_eq!(near, Near::default());
}

#[tokio::test]
async fn the_next_page_begins_after_the_last_one() {
    let pool = database().await;
    let features =
        (0..5).map(|i| feature(&format!("p{i}"), 16.6 + 1e-3 * f64::from(i), 52.7, 70.0)).collect::<Vec<_>>();
    import(&pool, &collection(&features), Mode::Upsert).await;
    let names = |first: &[points::Kept], second: &[points::Kept]| {
        first.iter().chain(second).map(|kept| kept.point.name.clone()).collect::<Vec<_>>()
    };
    let first = listed(&pool, 0, 3).await;
    let second = listed(&pool, first[2].id, 3).await;
    assert_eq!(names(&first, &second), ["p0", "p1", "p2", "p3", "p4"]);
    let region = GeodeticBox::around_place([16.602, 52.7], 1_000.0);
    let first = in_box(&pool, region, 0, 3).await;
    let second = in_box(&pool, region, first[2].id, 3).await;
    assert_eq!(names(&first, &second), ["p0", "p1", "p2", "p3", "p4"]);
}

/// In a database of a whole country a view must not cost more than in that of a village.
#[tokio::test]
async fn a_view_is_found_among_many() {
    let pool = database().await;
    let raster = (0..120).flat_map(|x| (0..100).map(move |y| (x, y)));
    let features: Vec<_> = raster
        .map(|(x, y)| feature(&format!("{x},{y}"), 10.0 + 0.01 * f64::from(x), 50.0 + 0.01 * f64::from(y), 80.0))
        .collect();
    import(&pool, &collection(&features), Mode::Upsert).await;
    let frame = LocalFrame::at(11.0, 50.7, 0.0);
    let (camera, approximation) = nadir(580.0);
    let began = std::time::Instant::now();
    for _ in 0..20 {
        let found = around(&pool, &frame, camera.half_view_rad(), &approximation, Reach::default(), &anything(BOTH))
            .await
            .unwrap()
            .lines;
        assert_eq!(found.iter().map(|point| point.name.as_str()).collect::<Vec<_>>(), ["100,70"]);
    }
    let milliseconds = began.elapsed().as_secs_f64() * 50.0;
    assert!(milliseconds < 50.0, "{milliseconds} ms each");
}

fn content(name: &str, geocentric_m: Vector3<f64>) -> SceneContent {
    SceneContent {
        name: name.into(),
        size_px: [200, 100],
        gsd_m: 0.5,
        azimuth_of_image_up_deg: 90.0,
        sigma_azimuth_deg: 5.0,
        reference_px: [20.0, 10.0],
        reference_geocentric_m: geocentric_m,
        sigma_m: 0.1,
        media_type: "image/png".into(),
        size_bytes: 3,
        sha256: [7; 32],
    }
}

async fn add(database: &Database, content: &SceneContent) -> scenes::Written {
    let now = chrono::DateTime::from_timestamp(1_800_000_000, 0).unwrap();
    scenes::write(database, uuid::Uuid::now_v7(), content, b"abc", now).await.unwrap()
}

#[tokio::test]
async fn a_scene_comes_back_to_the_last_bit_and_is_replaced_by_its_name() {
    let pool = database().await;
    let first = content("square", LocalFrame::at(16.6, 52.7, 70.123_456_789).to_geocentric(Vector3::zeros()));
    let written = add(&pool, &first).await;
    assert!(written.new && written.scene.content == first);
    let id = written.scene.public_id;
    for known_as in ["square", &id.to_string()] {
        assert_eq!(scenes::by_id_or_name(&pool, known_as).await.unwrap().unwrap(), written.scene);
    }
    let (same, file) = scenes::with_picture(&pool, id).await.unwrap().unwrap();
    assert_eq!((same, file.as_slice()), (written.scene, b"abc".as_slice()));
    let moved = content("square", LocalFrame::at(16.7, 52.7, 70.0).to_geocentric(Vector3::zeros()));
    let replaced = add(&pool, &moved).await;
    assert!(!replaced.new && replaced.scene.public_id == id && replaced.scene.content == moved);
    let at =
        async |lon: f64| scenes::in_box(&pool, GeodeticBox::around_place([lon, 52.7], 10.0), 0, 9).await.unwrap().len();
    assert_eq!([at(16.6).await, at(16.7).await], [0, 1]);
    add(&pool, &content("other", first.reference_geocentric_m)).await;
    assert_eq!(scenes::remove_all_but(&pool, &["other"]).await.unwrap(), 1);
    assert!(!scenes::remove(&pool, "square").await.unwrap());
    assert!(scenes::with_picture(&pool, id).await.unwrap().is_none());
    assert!(scenes::remove(&pool, "other").await.unwrap());
    assert!(scenes::all(&pool, 0, 9).await.unwrap().is_empty());
}

/// The second try of a request whose first one was cut off after it had written.
#[tokio::test]
async fn what_is_written_again_under_its_id_is_new_still() {
    let pool = database().await;
    let content = content("square", LocalFrame::at(16.6, 52.7, 70.0).to_geocentric(Vector3::zeros()));
    let (id, now) = (uuid::Uuid::now_v7(), chrono::DateTime::from_timestamp(1_800_000_000, 0).unwrap());
    for _ in 0..2 {
        assert!(scenes::write(&pool, id, &content, b"abc", now).await.unwrap().new);
    }
}

#[test]
fn the_corners_of_a_scene_lie_where_its_azimuth_says() {
    let there = LocalFrame::at(16.6, 52.7, 70.0);
    let corners = content("square", there.to_geocentric(Vector3::zeros())).corners_geocentric_m();
    // up is east: the left of the picture is north
    let expected = [[5.0, 10.0], [5.0, -90.0], [-45.0, -90.0], [-45.0, 10.0]];
    for (corner, [east_m, north_m]) in corners.into_iter().zip(expected) {
        let local_m = there.from_geocentric(corner);
        assert!((local_m - Vector3::new(east_m, north_m, 0.0)).norm() < 1e-6, "{local_m}");
    }
}

#[test]
fn the_azimuth_of_a_scene_follows_the_meridians() {
    let frame = LocalFrame::at(16.6, 52.7, 0.0);
    let content = content("square", LocalFrame::at(16.7, 52.7, 70.0).to_geocentric(Vector3::zeros()));
    let point = content.in_frame(&frame, vec![0.0; 20_000]);
    let scene = point.scene.unwrap();
    assert!(point.edges_m.is_empty() && [scene.width, scene.height] == [200, 100]);
    // to the east, north turns to the left: by the difference of longitude times the sine of the latitude
    let expected = std::f64::consts::FRAC_PI_2 - 0.1_f64.to_radians() * 52.7_f64.to_radians().sin();
    assert!((scene.azimuth_of_image_up_rad - expected).abs() < 1e-5, "{}", scene.azimuth_of_image_up_rad);
}

/// Of these kinds whatever there is.
pub(super) fn anything(kinds: Kinds) -> Wanted {
    Wanted { kinds, sets: None, date: None }
}

const BOTH: Kinds = Kinds { lines: true, scenes: true };

#[tokio::test]
async fn scenes_that_may_be_in_view_are_found_with_their_own_ground() {
    let pool = database().await;
    let frame = LocalFrame::at(16.6, 52.7, 0.0);
    for (name, east_m) in [("below", 0.0), ("beside", 400.0), ("far", 3_000.0)] {
        add(&pool, &content(name, frame.to_geocentric(Vector3::new(east_m, 0.0, 80.0)))).await;
    }
    import(&pool, &collection(&[feature("house", 16.6, 52.7, 80.0)]), Mode::Upsert).await;
    let (camera, approximation) = nadir(580.0);
    let found = async |kinds| {
        let near = around(&pool, &frame, camera.half_view_rad(), &approximation, Reach::default(), &anything(kinds))
            .await
            .unwrap();
        let scenes = near.scenes.into_iter().map(|scene| scene.content.name);
        near.lines.into_iter().map(|point| point.name).chain(scenes).collect::<Vec<_>>()
    };
    assert_eq!(found(BOTH).await, ["house", "below", "beside"]);
    assert_eq!(found(Kinds { lines: false, ..BOTH }).await, ["below", "beside"]);
    assert_eq!(found(Kinds { scenes: false, ..BOTH }).await, ["house"]);
    // without a building the ground is that of the scenes
    let remove = match &pool {
        Database::Sqlite(_) => "DELETE FROM control_point_boxes",
        Database::Postgres(_) => "DELETE FROM control_points",
    };
    query(remove).execute(&pool).await.unwrap();
    assert_eq!(found(BOTH).await, ["below", "beside"]);
}

#[tokio::test]
async fn of_many_scenes_in_view_some_are_taken_that_are_spread_over_it() {
    let pool = database().await;
    let frame = LocalFrame::at(16.6, 52.7, 0.0);
    for (x, y) in (-7..=7).flat_map(|x| (-7..=7).map(move |y| (x, y))) {
        let place = Vector3::new(60.0 * f64::from(x), 60.0 * f64::from(y), 80.0);
        add(&pool, &content(&format!("{x},{y}"), frame.to_geocentric(place))).await;
    }
    let (camera, approximation) = nadir(580.0);
    let found = async |reach| {
        let near = around(&pool, &frame, camera.half_view_rad(), &approximation, reach, &anything(BOTH)).await.unwrap();
        near.scenes
    };
    let far_m = |scenes: &[StoredScene]| {
        let off_m = scenes.iter().map(|s| frame.from_geocentric(s.content.reference_geocentric_m).xy().norm());
        off_m.fold(0.0, f64::max)
    };
    let some = found(Reach { most_scenes: 12, ..Reach::default() }).await;
    // the corners of the view are 417 m away
    assert_eq!(some.len(), 12);
    assert!((350.0..417.0).contains(&far_m(&some)), "{}", far_m(&some));
    // a few more than are surely in view: the nearest
    let most = found(Reach { most_scenes: 170, ..Reach::default() }).await;
    assert!(most.len() == 170 && far_m(&most) < 470.0, "{} {}", most.len(), far_m(&most));
    // each has 20 000 pixels and 3 bytes
    assert_eq!(found(Reach { most_scene_pixels: 100_000, ..Reach::default() }).await.len(), 5);
    assert_eq!(found(Reach { most_scene_bytes: 20, ..Reach::default() }).await.len(), 6);
}

/// A million buildings of one edge each: what may be in view is found by the index, and soon.
///
/// `cargo test --release --lib -- --ignored a_million`
#[tokio::test]
#[ignore = "takes a minute"]
async fn a_million_control_points_are_searched_by_their_index() {
    let pool = database().await;
    let fill = match &pool {
        Database::Sqlite(_) => [
            "WITH RECURSIVE numbers (n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM numbers WHERE n < 999999)
             INSERT INTO control_points (set_id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges)
             SELECT 1, 'b' || n, 0.1, 0, 0, 0, zeroblob(48) FROM numbers",
            "INSERT INTO control_point_boxes
             SELECT id, 8 + id % 1000 * 0.001, 8.0001 + id % 1000 * 0.001, 50 + id / 1000 * 0.001, 50.0001 + id / 1000 * 0.001
             FROM control_points",
        ],
        Database::Postgres(_) => [
            "INSERT INTO control_points (set_id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges, extent)
             SELECT 1, 'b' || n, 0.1, 0, 0, 0, decode(repeat('00', 48), 'hex'),
                    box(point(8 + n % 1000 * 0.001, 50 + n / 1000 * 0.001), point(8.0001 + n % 1000 * 0.001, 50.0001 + n / 1000 * 0.001))
             FROM generate_series(0, 999999) AS n",
            "ANALYZE control_points",
        ],
    };
    for sql in fill {
        query(sql).execute(&pool).await.unwrap();
    }
    let mut times = Vec::new();
    for place in 0..200 {
        // some 1.5 km by 1 km
        let (lon, lat) = (8.0 + f64::from(place) * 0.0045, 50.05 + f64::from(place) * 0.0044);
        let region = GeodeticBox::around_place([lon + 0.05, lat], 600.0);
        let began = std::time::Instant::now();
        let found = in_box(&pool, region, 0, usize::MAX).await;
        times.push(began.elapsed().as_secs_f64());
        assert!(found.len() > 100, "{}", found.len());
    }
    times.sort_by(f64::total_cmp);
    eprintln!(
        "a window among a million control points: p50 {:.1} ms, p95 {:.1} ms",
        1e3 * times[100],
        1e3 * times[190]
    );
    assert!(times[190] < 0.02, "{times:?}");
    let region = GeodeticBox::around_place([8.5, 50.5], 600.0);
    let told = crate::store::orientations::million::plan(&pool, points::searched(&pool, region)).await;
    eprintln!("{told}");
    let index = told.contains("VIRTUAL TABLE INDEX") || told.contains("control_points_by_extent");
    assert!(index && !told.contains("Seq Scan"), "{told}");
}
