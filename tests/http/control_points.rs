//! Control points, through the router.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use crate::support::{Answer, Service};

fn feature(name: &str, x: f64, y: f64) -> Value {
    json!({"type": "Feature", "properties": {"name": name, "sigma_m": 0.1},
        "geometry": {"type": "MultiLineString", "coordinates": [[[x, y, 70.0], [x + 10.0, y, 75.0]]]}})
}

async fn import(service: &Service, query: &str, features: &[Value]) -> Answer {
    let body = json!({"type": "FeatureCollection", "features": features}).to_string();
    send(service, query, "application/geo+json", body).await
}

async fn send(service: &Service, query: &str, kind: &str, body: impl Into<Body>) -> Answer {
    let path = format!("/api/v1/control-points?{query}");
    service.send(Request::post(path).header("content-type", kind).body(body.into()).unwrap()).await
}

#[tokio::test]
async fn import_tells_what_became_of_each_feature() {
    let service = Service::new().await;
    let features = [feature("a", 5e5, 5.8e6), json!({"type": "Feature"}), feature("b", 5.01e5, 5.8e6)];
    let answer = import(&service, "crs=EPSG:25833", &features).await;
    assert_eq!(answer.status, 200);
    let report = answer.json();
    assert_eq!((&report["imported"], &report["updated"]), (&json!(2), &json!(0)));
    assert_eq!(report["rejected"][0]["index"], 1);
    assert!(report["rejected"][0]["detail"].as_str().unwrap().contains("properties"), "{report}");
    assert_eq!(report["warnings"][0]["code"], "vertical_assumed_ellipsoidal");
    let told = import(&service, "crs=EPSG:25833&geoid_undulation_m=40", &features[..1]).await.json();
    assert!(told.get("warnings").is_none(), "{told}");
    let again = import(&service, "crs=EPSG:25833&mode=upsert", &features[..1]).await.json();
    assert_eq!((&again["imported"], &again["updated"]), (&json!(0), &json!(1)));
    let refused = import(&service, "crs=EPSG:25833&mode=insert", &features[..1]).await.json();
    assert_eq!(refused["rejected"][0]["name"], "a");
}

#[tokio::test]
async fn list_gives_back_what_was_imported_in_the_crs_asked_for() {
    let service = Service::new().await;
    let features: Vec<_> = (0..5).map(|i| feature(&format!("p{i}"), 5e5 + 1e3 * f64::from(i), 5.8e6)).collect();
    import(&service, "crs=EPSG:25833", &features).await;
    let page = service.get("/api/v1/control-points?crs=EPSG:25833&limit=3").await.json();
    let rest = page["next_cursor"].as_str().unwrap();
    let rest = service.get(&format!("/api/v1/control-points?crs=EPSG:25833&limit=3&cursor={rest}")).await.json();
    assert_eq!(rest["next_cursor"], Value::Null);
    let items: Vec<_> = [&page, &rest].iter().flat_map(|page| page["items"].as_array().unwrap()).collect();
    assert_eq!(items.len(), 5);
    let x = |item: &Value| item["geometry"]["coordinates"][0][0][0].as_f64().unwrap();
    for (i, item) in items.iter().enumerate() {
        assert_eq!(item["properties"]["name"], format!("p{i}"));
        assert!((x(item) - 5e5 - 1e3 * i as f64).abs() < 1e-6, "{item}");
    }
    let geographic = service.get("/api/v1/control-points/p0").await.json();
    assert!((x(&geographic) - 15.0).abs() < 1e-9, "the central meridian of zone 33: {geographic}");
    assert_eq!(service.get("/api/v1/control-points/p9").await.problem(404), Vec::<String>::new());
}

#[tokio::test]
async fn rectangle_is_exact_in_its_own_crs() {
    let service = Service::new().await;
    let features: Vec<_> = (0..5).map(|i| feature(&format!("p{i}"), 5e5 + 100.0 * f64::from(i), 5.8e6)).collect();
    import(&service, "crs=EPSG:25833", &features).await;
    let names = async |bbox: &str| {
        let page = service.get(&format!("/api/v1/control-points?crs=EPSG:25833&bbox={bbox}")).await.json();
        let items = page["items"].as_array().unwrap().clone();
        items.iter().map(|item| item["properties"]["name"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    // each is 10 m wide: what only touches counts, what is 10 cm outside does not
    assert_eq!(names("500099.9,5799990,500200.1,5800010").await, ["p1", "p2"]);
    assert_eq!(names("500110.1,5799990,500199.9,5800010").await, Vec::<String>::new());
    assert_eq!(names("500109.9,5799990,500199.9,5800010").await, ["p1"]);
    let page = service.get("/api/v1/control-points?bbox=14.99,52,15.0001,53").await.json();
    assert_eq!(page["items"].as_array().unwrap().len(), 1, "{page}");
}

#[tokio::test]
async fn bad_requests_are_problems_and_change_nothing() {
    let service = Service::new().await;
    let good = json!({"type": "FeatureCollection", "features": [feature("a", 5e5, 5.8e6)]}).to_string();
    for (query, pointer) in [
        ("crs=EPSG:1", "?crs"),
        ("crs=EPSG:25833%2B7837", "?crs"),
        ("crs=EPSG:25833&mode=merge", "?mode"),
        ("crs=EPSG:25833&geoid_undulation_m=1000", "?geoid_undulation_m"),
        ("crs=EPSG:25833&geoid_undulation_m=NaN", "?geoid_undulation_m"),
        ("crs=EPSG:25833&sigma_m=0", "?sigma_m"),
        (&*format!("crs=EPSG:25833&description={}", "x".repeat(1_001)), "?set"),
    ] {
        let pointers = send(&service, query, "application/geo+json", good.clone()).await.problem(422);
        assert_eq!(pointers, [pointer], "{query}");
    }
    send(&service, "", "application/geo+json", good.clone()).await.problem(422);
    send(&service, "crs=EPSG:25833", "text/plain", good.clone()).await.problem(415);
    send(&service, "crs=EPSG:25833", "application/geo+json", "{").await.problem(400);
    send(&service, "crs=EPSG:25833", "application/geo+json", "[]").await.problem(422);
    send(&service, "crs=EPSG:25833", "application/geo+json", "{\"type\": \"Feature\"}").await.problem(422);
    for query in ["bbox=1,2,3", "bbox=1,2,3,nan", "bbox=3,2,1,4", "bbox=1,2,3,4,5", "crs=EPSG:25833&bbox=1,2,3,1e12"] {
        assert_eq!(service.get(&format!("/api/v1/control-points?{query}")).await.problem(422), ["?bbox"], "{query}");
    }
    assert_eq!(service.get("/api/v1/control-points?limit=0").await.problem(422), ["?limit"]);
    assert_eq!(service.get("/api/v1/control-points?cursor=x").await.problem(422), ["?cursor"]);
    let page = service.get("/api/v1/control-points").await.json();
    assert_eq!(page, json!({"items": [], "next_cursor": null}));
}

#[tokio::test]
async fn body_that_is_too_large_is_refused() {
    let service = Service::with(|configuration| configuration.import_max_bytes = 1_000).await;
    let features: Vec<_> = (0..20).map(|i| feature(&format!("p{i}"), 5e5, 5.8e6)).collect();
    import(&service, "crs=EPSG:25833", &features).await.problem(413);
    assert_eq!(import(&service, "crs=EPSG:25833", &features[..2]).await.status, 200);
}

/// The issue asks for ten thousand in well under a few seconds; here with room for a loaded machine.
#[tokio::test]
async fn ten_thousand_are_imported_in_seconds() {
    let service = Service::new().await;
    let features: Vec<_> = (0..10_000)
        .map(|i| feature(&format!("p{i}"), 5e5 + 20.0 * f64::from(i % 100), 5.8e6 + 20.0 * f64::from(i / 100)))
        .collect();
    let began = std::time::Instant::now();
    let report = import(&service, "crs=EPSG:25833", &features).await.json();
    assert_eq!(report["imported"], 10_000);
    let seconds = began.elapsed().as_secs_f64();
    assert!(seconds < 10.0, "{seconds} s");
}

#[tokio::test]
async fn a_list_is_searched_by_name() {
    let service = Service::new().await;
    let names = ["Church_1", "church-2", "Barn 100%", "Mill", "CHURCH_3"];
    let at = |i: usize, name: &str| feature(name, 5e5 + 1e3 * i as f64, 5.8e6);
    let features: Vec<_> = names.iter().enumerate().map(|(i, name)| at(i, name)).collect();
    import(&service, "crs=EPSG:25833", &features).await;
    let list = async |query: &str| {
        let page = service.get(&format!("/api/v1/control-points?crs=EPSG:25833&{query}")).await.json();
        let name = |item: &Value| item["properties"]["name"].as_str().unwrap().to_owned();
        (page["items"].as_array().unwrap().iter().map(name).collect::<Vec<_>>(), page["next_cursor"].clone())
    };
    assert_eq!(list("q=church").await.0, ["Church_1", "church-2", "CHURCH_3"]);
    assert_eq!(list("q=church_").await.0, ["Church_1", "CHURCH_3"]);
    assert_eq!(list("q=0%25").await.0, ["Barn 100%"]);
    assert_eq!(list("q=").await.0.len(), 5);
    assert_eq!(list("q=tower").await, (Vec::<String>::new(), Value::Null));
    assert_eq!(list("q=church&bbox=500500,5700000,510000,5900000").await.0, ["church-2", "CHURCH_3"]);
    let (first, next) = list("q=church&limit=2").await;
    let (rest, end) = list(&format!("q=church&limit=2&cursor={}", next.as_str().unwrap())).await;
    assert_eq!(([first, rest].concat().len(), end), (3, Value::Null));
    for query in ["q=%00", &format!("q={}", "x".repeat(201))] {
        assert_eq!(service.get(&format!("/api/v1/control-points?{query}")).await.problem(422), ["?q"]);
    }
    assert_eq!(service.get("/api/v1/control-points?health=maybe").await.problem(422), ["?health"]);
}

#[tokio::test]
async fn a_list_tells_the_health_of_each_if_asked_for() {
    let service = Service::new().await;
    import(&service, "crs=EPSG:25833", &[feature("a", 5e5, 5.8e6), feature("b", 5.01e5, 5.8e6)]).await;
    let plain = service.get("/api/v1/control-points").await.json();
    assert!(plain["items"][0]["properties"].get("health").is_none(), "{plain}");
    let listed = service.get("/api/v1/control-points?health=true").await.json();
    for item in listed["items"].as_array().unwrap() {
        let health = json!({"seen_in": 0, "found": 0, "missed": 0, "contradicts": 0, "outdated": false});
        assert_eq!(item["properties"]["health"], health);
        assert_eq!(item["properties"]["sigma_m"].as_f64().map(|sigma_m| sigma_m >= 0.1), Some(true));
    }
}

#[tokio::test]
async fn the_extent_is_that_of_all() {
    let service = Service::new().await;
    let extent = async |query: &str| service.get(&format!("/api/v1/control-points/extent{query}")).await;
    assert_eq!(extent("").await.json(), json!({"count": 0}));
    import(&service, "crs=EPSG:25833", &[feature("a", 5e5, 5.8e6), feature("b", 5.2e5, 5.81e6)]).await;
    let told = extent("").await.json();
    assert_eq!(told["count"], 2);
    let bbox = |told: &Value| told["bbox"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>();
    // the first lies on the central meridian
    let geographic = bbox(&told);
    assert!((geographic[0] - 15.0).abs() < 1e-5 && geographic[2] > 15.29 && geographic[2] < 15.30, "{told}");
    let projected = bbox(&extent("?crs=EPSG:25833").await.json());
    let around = [5e5, 5.8e6, 5.2001e5, 5.81e6];
    for (k, (found, least)) in projected.iter().zip(around).enumerate() {
        // rather too large than too small; parallels are curved
        let beyond = if k < 2 { least - found } else { found - least };
        assert!((-0.01..120.0).contains(&beyond), "{projected:?}");
    }
    extent("?crs=EPSG:1").await.problem(422);
    extent("?crs=EPSG:25833&limit=5").await.problem(422);
    assert_eq!(service.get("/api/v1/control-points/a").await.status, 200);
}

#[tokio::test]
async fn sets_are_made_by_imports_and_removed_with_their_control_points() {
    let service = Service::new().await;
    let features = [feature("a", 5e5, 5.8e6), feature("b", 5.01e5, 5.8e6)];
    let report =
        import(&service, "crs=EPSG:25833&set=nrw-2024&year=2024&use=check&valid_from=2024-02-01", &features).await;
    assert_eq!(report.json()["imported"], 2);
    import(&service, "crs=EPSG:25833", &features[..1]).await;
    let sets = service.get("/api/v1/control-sets").await.json();
    let told = |i: usize| (sets["items"][i]["name"].clone(), sets["items"][i]["control_points"].clone());
    assert_eq!((told(0), told(1)), ((json!("default"), json!(1)), (json!("nrw-2024"), json!(2))));
    assert_eq!(service.get("/api/v1/control-sets/nrw-2024").await.json()["survey_year"], 2024);
    let of_set = service.get("/api/v1/control-points?sets=nrw-2024").await.json();
    assert_eq!(of_set["items"].as_array().unwrap().len(), 2);
    let properties = &of_set["items"][0]["properties"];
    assert_eq!((&properties["set"], &properties["use"]), (&json!("nrw-2024"), &json!("check")));
    assert_eq!((&properties["valid_from"], properties.get("valid_to")), (&json!("2024-02-01"), None));
    assert_eq!(
        service.get("/api/v1/control-points?date=2024-01-31").await.json()["items"].as_array().unwrap().len(),
        1
    );
    assert_eq!(service.get("/api/v1/control-points/b?set=nrw-2024").await.status, 200);
    service.get("/api/v1/control-points/b").await.problem(404);
    assert_eq!(service.get("/api/v1/control-points/b/health?set=nrw-2024").await.json()["seen_in"], 0);
    assert_eq!(service.delete("/api/v1/control-points/b?set=nrw-2024").await.status, 204);
    assert_eq!(service.delete("/api/v1/control-sets/nrw-2024").await.status, 204);
    service.delete("/api/v1/control-sets/nrw-2024").await.problem(404);
    assert_eq!(service.get("/api/v1/control-sets").await.json()["items"].as_array().unwrap().len(), 1);
    let pointers = import(&service, "crs=EPSG:25833&set=%20", &features).await.problem(422);
    assert_eq!(pointers, ["?set"]);
}

#[tokio::test]
async fn a_body_is_what_its_type_says() {
    let service = Service::new().await;
    for (kind, body, status) in [
        ("application/city+json", "x", 400),
        ("application/city+json", "[]", 422),
        ("application/city+json-seq", "x", 400),
        ("application/city+json-seq", "{\"type\": \"Feature\"}", 422),
        ("application/gml+xml", "x", 400),
        ("application/gml+xml", "<kml/>", 422),
        ("application/geopackage+sqlite3", "x", 422),
    ] {
        send(&service, "", kind, body).await.problem(status);
    }
    let bounded = Service::with(|configuration| configuration.model_max_bytes = 10).await;
    send(&bounded, "", "application/city+json", "x".repeat(11)).await.problem(413);
}

#[tokio::test]
async fn a_geopackage_says_itself_in_which_crs_it_is() {
    let service = Service::new().await;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("roofs.gpkg");
    let pool = sqlx::SqlitePool::connect(&format!("sqlite:{}?mode=rwc", file.display())).await.unwrap();
    sqlx::raw_sql(
        "CREATE TABLE gpkg_spatial_ref_sys (srs_id INTEGER, organization TEXT, organization_coordsys_id INTEGER);
         INSERT INTO gpkg_spatial_ref_sys VALUES (1, 'EPSG', 25833);
         CREATE TABLE gpkg_contents (table_name TEXT, data_type TEXT);
         INSERT INTO gpkg_contents VALUES ('edges', 'features');
         CREATE TABLE gpkg_geometry_columns (table_name TEXT, column_name TEXT, geometry_type_name TEXT, srs_id INTEGER);
         INSERT INTO gpkg_geometry_columns VALUES ('edges', 'geom', 'LINESTRING', 1);
         CREATE TABLE edges (fid INTEGER PRIMARY KEY, geom BLOB, name TEXT, sigma_m REAL);
         INSERT INTO edges VALUES (2, x'4750', 'torn', 0.1)",
    )
    .execute(&pool)
    .await
    .unwrap();
    let mut geometry = [&b"GP\0\x01\x01\0\0\0\x01"[..], &1002_u32.to_le_bytes(), &2_u32.to_le_bytes()].concat();
    geometry.extend([5e5, 5.8e6, 70.0, 5.0001e5, 5.8e6, 75.0_f64].into_iter().flat_map(f64::to_le_bytes));
    sqlx::query("INSERT INTO edges VALUES (1, $1, 'a', 0.1)").bind(geometry).execute(&pool).await.unwrap();
    pool.close().await;
    let body = std::fs::read(&file).unwrap();
    let report = send(&service, "", "application/geopackage+sqlite3", body.clone()).await.json();
    assert_eq!((&report["imported"], &report["rejected_count"]), (&json!(1), &json!(1)), "{report}");
    assert_eq!(report["rejected"][0]["name"], "torn");
    assert_eq!(report["warnings"][0]["code"], "vertical_assumed_ellipsoidal");
    let of_geojson = import(&service, "crs=EPSG:25833&set=other", &[feature("a", 5e5, 5.8e6)]).await;
    assert_eq!(of_geojson.status, 200);
    let edges =
        async |set: &str| service.get(&format!("/api/v1/control-points/a?set={set}")).await.json()["geometry"].clone();
    assert_eq!(edges("default").await, edges("other").await);
    let pointers = send(&service, "crs=EPSG:25832", "application/geopackage+sqlite3", body).await.problem(422);
    assert_eq!(pointers, ["?crs"]);
}
