//! Exports of orientations and blocks.

use std::io::Read as _;

use serde_json::json;

use crate::orientations::{Working, id, quick};
use crate::support::{Answer, png};

const WHERE: &str = "crs=EPSG:25833&ground_height_m=50";

async fn oriented(working: &Working) -> String {
    let answer = working.ask(&working.request(), &[("prefer", "wait=20")]).await;
    assert_eq!(answer.status, 200);
    id(&answer)
}

/// The files of an archive, by name.
fn files(answer: &Answer) -> std::collections::BTreeMap<String, String> {
    assert_eq!(answer.status, 200, "{:?}", answer.body);
    assert_eq!(answer.headers["content-type"], "application/zip");
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(&answer.body)).unwrap();
    (0..archive.len())
        .map(|k| {
            let mut file = archive.by_index(k).unwrap();
            let mut text = String::new();
            file.read_to_string(&mut text).unwrap();
            (file.name().unwrap().into_owned(), text)
        })
        .collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_format_of_one_file_is_that_file_and_one_of_several_an_archive_with_the_manifest() {
    let working = Working::with(quick()).await;
    let id = oriented(&working).await;
    let export = |query: &str| format!("/api/v1/orientations/{id}/export?{query}");
    let answer = working.service.get(&export(&format!("format=odm&{WHERE}"))).await;
    assert_eq!(answer.status, 200, "{:?}", answer.body);
    let text = String::from_utf8(answer.body.to_vec()).unwrap();
    let [crs, line] = text.lines().collect::<Vec<_>>()[..] else { panic!("{text}") };
    assert_eq!(crs, "EPSG:25833");
    // PROJ: 16.6, 52.7 in EPSG:25833
    let numbers: Vec<f64> = line.split(' ').skip(1).map(|number| number.parse().unwrap()).collect();
    assert!((numbers[2] - 400.0).abs() < 1e-3, "{line}");
    assert!((5.8e6..5.9e6).contains(&numbers[1]), "{line}");
    assert_eq!(answer.headers["content-disposition"], "attachment; filename=\"geo.txt\"");
    // a position is no fit, an orientation in a grid is
    assert!(!answer.headers.contains_key("gable-residual-max-px"));
    let patb = working.service.get(&export(&format!("format=patb&{WHERE}"))).await;
    let residual_px: f64 = patb.headers["gable-residual-max-px"].to_str().unwrap().parse().unwrap();
    assert!((0.0..1.0).contains(&residual_px), "{residual_px}");
    let several = working.service.get(&export(&format!("format=orthority&{WHERE}"))).await;
    assert_eq!(files(&several).into_keys().collect::<Vec<_>>(), ["exterior.geojson", "interior.yaml", "manifest.json"]);
    let archived = working.service.get(&export(&format!("format=odm&archive=true&{WHERE}"))).await;
    let manifest = files(&archived).remove("manifest.json").unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(manifest["grid_crs"], "EPSG:25833");
    assert_eq!(manifest["photographs"][0]["check_points"].as_array().unwrap().len(), 5);
    assert_eq!(manifest["photographs"][0]["verdict"], "yellow");
    assert!(manifest["photographs"][0]["sigma"]["frame"].is_string());
}

#[tokio::test(flavor = "multi_thread")]
async fn what_cannot_be_exported_is_told_with_what_would_be_right() {
    let working = Working::with(quick()).await;
    let id = oriented(&working).await;
    for (query, pointer, word) in [
        ("format=dwg&crs=EPSG:25833", "?format", "orthority"),
        ("format=odm&crs=EPSG:4326&ground_height_m=50", "?crs", "map grid"),
        ("format=odm&crs=EPSG:1&ground_height_m=50", "?crs", "known"),
        ("format=odm&crs=EPSG:25833&ground_height_m=99999", "?ground_height_m", "10000"),
        ("format=orthority&crs=EPSG:25833&ground_height_m=900", "?ground_height_m", ""),
    ] {
        let answer = working.service.get(&format!("/api/v1/orientations/{id}/export?{query}")).await;
        assert_eq!(answer.status, 422, "{query}: {:?}", answer.body);
        let problem = answer.json();
        assert_eq!(problem["errors"][0]["pointer"], json!(pointer), "{problem}");
        assert!(problem["errors"][0]["detail"].as_str().unwrap().contains(word), "{problem}");
    }
    let frame = "%2Bproj%3Dtopocentric%20%2Blon_0%3D16.6%20%2Blat_0%3D52.7%20%2Bh_0%3D0";
    let query = format!("format=patb&crs={frame}&geoid_undulation_m=46&ground_height_m=50");
    let answer = working.service.get(&format!("/api/v1/orientations/{id}/export?{query}")).await;
    assert_eq!(answer.status, 422, "{:?}", answer.body);
    assert_eq!(answer.json()["errors"][0]["pointer"], "?geoid_undulation_m");
    let missing = "/api/v1/orientations/01890000-0000-7000-8000-000000000000/export?format=odm";
    assert_eq!(working.service.get(missing).await.status, 404);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_staff_have_rejected_is_exported_only_if_all_is_wanted() {
    let working = Working::with(quick()).await;
    let id = oriented(&working).await;
    let reviews = format!("/api/v1/orientations/{id}/reviews");
    let rejected = json!({"decision": "rejected", "why": "wrong village"});
    assert_eq!(working.service.post(&reviews, &rejected).await.status, 201);
    let export = format!("/api/v1/orientations/{id}/export?format=manifest&{WHERE}");
    let refused = working.service.get(&export).await;
    assert_eq!(refused.status, 409, "{:?}", refused.body);
    let detail = refused.json()["detail"].as_str().unwrap().to_owned();
    assert!(detail.contains("staff have rejected it") && detail.contains("all=true"), "{detail}");
    let manifest = working.service.get(&format!("{export}&all=true")).await.json();
    assert_eq!(manifest["photographs"][0]["review"], "rejected");
}

#[tokio::test(flavor = "multi_thread")]
async fn of_a_block_what_is_accepted_is_exported_and_the_rest_is_named() {
    let working = Working::with(quick()).await;
    let list = "name;lon;lat;height;kappa\na.png;16.6;52.7;400;10\nb.png;16.61;52.7;400;\n";
    let query = "/api/v1/blocks?camera=camera&name=flight&sigma_position_m=3,3,5&sigma_tilt_deg=3";
    let post = axum::http::Request::post(query).header("content-type", "text/csv");
    let block = id(&working.service.send(post.body(list.into()).unwrap()).await);
    let put =
        axum::http::Request::put(format!("/api/v1/blocks/{block}/images/a.png")).header("content-type", "image/png");
    assert_eq!(working.service.send(put.body(png(1).into()).unwrap()).await.status, 201);
    let orientation = loop {
        let listed = working.service.get(&format!("/api/v1/orientations?block={block}&status=succeeded")).await.json();
        if let Some(found) = listed["items"][0]["id"].as_str() {
            break found.to_owned();
        }
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    };
    let export = |more: &str| format!("/api/v1/blocks/{block}/export?format=odm&{WHERE}{more}");
    // it is yellow, and nobody has accepted it
    let nothing = working.service.get(&export("")).await;
    assert_eq!(nothing.status, 409, "{:?}", nothing.body);
    assert!(nothing.json()["detail"].as_str().unwrap().contains("all=true"));
    let all = files(&working.service.get(&export("&all=true")).await);
    assert!(all["geo.txt"].contains("a.png "), "{all:?}");
    assert_eq!(all["left_out.csv"], "name,why\nb.png,there is no orientation\n");
    let reviews = format!("/api/v1/orientations/{orientation}/reviews");
    assert_eq!(working.service.post(&reviews, &json!({"decision": "accepted"})).await.status, 201);
    assert!(files(&working.service.get(&export("")).await)["geo.txt"].contains("a.png "));
    working.service.post(&reviews, &json!({"decision": "rejected", "why": "wrong village"})).await;
    assert_eq!(working.service.get(&export("&all=true")).await.status, 409);
}
