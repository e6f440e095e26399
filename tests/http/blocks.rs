//! Blocks: a list is accepted whole or not at all, and followed to its end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use crate::orientations::{Working, held, quick};
use crate::support::{Answer, png};

const QUERY: &str = "camera=camera&name=flight%207&sigma_position_m=3,3,5&sigma_tilt_deg=3&tolerance_gsd=5";

async fn post(working: &Working, query: &str, kind: &str, list: impl Into<Body>) -> Answer {
    let request = Request::post(format!("/api/v1/blocks?{query}")).header("content-type", kind);
    working.service.send(request.body(list.into()).unwrap()).await
}

async fn put(working: &Working, block: &str, name: &str, file: Vec<u8>) -> Answer {
    let request = Request::put(format!("/api/v1/blocks/{block}/images/{name}")).header("content-type", "image/png");
    working.service.send(request.body(Body::from(file)).unwrap()).await
}

fn id(answer: &Answer) -> String {
    assert_eq!(answer.status, 201, "{:?}", answer.body);
    answer.json()["id"].as_str().unwrap().to_owned()
}

async fn until_done(working: &Working, block: &str) -> Value {
    let began = Instant::now();
    loop {
        let answer = working.service.get(&format!("/api/v1/blocks/{block}")).await.json();
        if answer.get("finished_at").is_some() {
            return answer;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "{answer}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_list_is_posted_its_images_come_and_its_results_go() {
    let working = Working::with(quick()).await;
    let list = "name;lon;lat;height;kappa;run\n=evil.png;16.6;52.7;400;10;1\nb/c.png;16.61;52.7;400;;1\n";
    let made = post(&working, QUERY, "text/csv", list).await;
    let block = id(&made);
    let answer = made.json();
    assert_eq!(made.headers["location"], format!("/api/v1/blocks/{block}"));
    assert_eq!(
        (&answer["name"], &answer["crs"], &answer["images"]),
        (&json!("flight 7"), &json!("EPSG:4979"), &json!(2))
    );
    assert_eq!(answer["settings"], json!({"camera": "camera", "tolerance_gsd": 5.0}));
    assert_eq!(answer["ignored_columns"], json!(["run"]));
    let nothing =
        json!({"listed": 2, "uploaded": 0, "queued": 0, "running": 0, "succeeded": 0, "failed": 0, "cancelled": 0});
    assert_eq!(answer["progress"], nothing);
    let first = put(&working, &block, "%3Devil.png", png(1)).await;
    assert_eq!(first.status, 201, "{:?}", first.body);
    assert_eq!(put(&working, &block, "b%2Fc.png", png(2)).await.status, 201);
    let done = until_done(&working, &block).await;
    assert_eq!((&done["progress"]["succeeded"], &done["verdicts"]["yellow"]), (&json!(2), &json!(2)));
    let listed = working.service.get(&format!("/api/v1/orientations?block={block}")).await.json();
    let names: Vec<_> = listed["items"].as_array().unwrap().iter().map(|item| &item["image_name"]).collect();
    assert_eq!(names, ["c.png", "=evil.png"]);
    assert_eq!(listed["items"][0]["block"], json!(block));
    // the same file again is no new orientation; another one has no place any more
    let again = put(&working, &block, "%3Devil.png", png(1)).await;
    assert_eq!((again.status.as_u16(), &again.json()["orientation"]), (200, &first.json()["orientation"]));
    put(&working, &block, "%3Devil.png", png(3)).await.problem(409);
    put(&working, &block, "unknown.png", png(3)).await.problem(404);
    let images = working.service.get(&format!("/api/v1/blocks/{block}/images?limit=1")).await.json();
    assert_eq!((&images["items"][0]["name"], &images["items"][0]["verdict"]), (&json!("=evil.png"), &json!("yellow")));
    assert_eq!((&images["items"][0]["score"], &images["next_cursor"]), (&json!(1.0), &json!("1")));
    let rest = working.service.get(&format!("/api/v1/blocks/{block}/images?limit=5&cursor=1")).await.json();
    assert_eq!((rest["items"].as_array().unwrap().len(), &rest["next_cursor"]), (1, &Value::Null));
    let orientation = working
        .service
        .get(&format!("/api/v1/orientations/{}", rest["items"][0]["orientation"].as_str().unwrap()))
        .await;
    let used = &orientation.json()["result"]["approximation"];
    assert_eq!((&used["sigma_position_m"], &used["sigma_tilt_deg"]), (&json!([3.0, 3.0, 5.0]), &json!(3.0)));
    let csv = working.service.get(&format!("/api/v1/blocks/{block}/results")).await;
    assert_eq!(csv.headers["content-type"], "text/csv; charset=utf-8");
    let text = String::from_utf8(csv.body.to_vec()).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 3, "{text}");
    assert!(lines[0].starts_with("name,image,orientation,status,verdict,score") && lines[0].ends_with(",reasons"));
    assert!(lines[1].starts_with("'=evil.png,") && lines[1].ends_with(",few_control_points"), "{}", lines[1]);
    let cells: Vec<&str> = lines[1].split(',').collect();
    assert_eq!((cells[7], cells[13].parse::<f64>().unwrap().round()), ("EPSG:4979", 10.0));
    assert!((cells[14].parse::<f64>().unwrap() - 0.01).abs() < 1e-9, "{}", lines[1]);
    let features = working.service.get(&format!("/api/v1/blocks/{block}/results?format=geojson")).await.json();
    assert_eq!(features["features"].as_array().unwrap().len(), 2);
    assert_eq!(features["features"][1]["properties"]["name"], "b/c.png");
    assert_eq!(working.service.get("/api/v1/blocks").await.json()["items"][0]["id"], block.as_str());
    assert_eq!(working.service.delete(&format!("/api/v1/blocks/{block}")).await.status, 204);
    working.service.get(&format!("/api/v1/blocks/{block}")).await.problem(404);
    let kept = orientation.json()["id"].as_str().unwrap().to_owned();
    assert_eq!(working.service.get(&format!("/api/v1/orientations/{kept}")).await.json()["status"], "succeeded");
}

#[tokio::test(flavor = "multi_thread")]
async fn images_that_are_there_are_oriented_at_once_a_thousand_of_them() {
    let working = Working::with(quick()).await;
    let header = "name,lon,lat,height,image_id,kappa\n";
    let line = |k: usize| format!("{k}.png,16.6,52.7,{},{},10\n", 400 + k % 7, working.image);
    let list: String = std::iter::once(header.to_owned()).chain((0..1000).map(line)).collect();
    let began = Instant::now();
    let made = post(&working, "camera=camera", "text/csv", list).await;
    let took = began.elapsed();
    let block = id(&made);
    eprintln!("1000 orientations accepted in {took:?}");
    assert_eq!(made.json()["progress"]["uploaded"], 1000);
    let results = working.service.get(&format!("/api/v1/blocks/{block}/results")).await;
    assert_eq!(String::from_utf8(results.body.to_vec()).unwrap().lines().count(), 1001);
    assert_eq!(working.service.delete(&format!("/api/v1/blocks/{block}")).await.status, 204);
    let waiting = working.service.get("/api/v1/orientations?status=queued").await.json();
    assert_eq!(waiting["items"], json!([]));
    // by the digest of the file, in a text of another form
    let sha256 = working.service.get(&format!("/api/v1/images/{}", working.image)).await.json()["sha256"].clone();
    let point = json!({"type": "Feature", "geometry": {"type": "Point", "coordinates": [16.6, 52.7, 400]},
        "properties": {"name": "a", "sha256": sha256}});
    let collection = json!({"type": "FeatureCollection", "features": [point]}).to_string();
    let made = post(&working, "camera=camera", "application/geo+json", collection).await;
    let block = id(&made);
    assert_eq!(until_done(&working, &block).await["progress"]["succeeded"], 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_accepted_where_one_line_is_bad() {
    let working = Working::with(quick()).await;
    let good = "name,lon,lat,height\na,16.6,52.7,400\n";
    let refused = async |query: &str, kind: &str, list: &str| {
        let answer = post(&working, query, kind, list.to_owned()).await;
        (answer.problem(answer.status.as_u16()), answer.status.as_u16())
    };
    let many = format!("{good}b,16.6,152.7,400\nc,16.6,52.7,nan\nd,16.6\na,16.6,52.7,400\n");
    let (mut places, status) = refused("camera=camera", "text/csv", &many).await;
    places.sort();
    assert_eq!((places, status), (["line 3", "line 4", "line 5", "line 6"].map(str::to_owned).to_vec(), 422));
    let line = |k: usize| format!("{k},1,2\n");
    let endless: String = std::iter::once(good.to_owned()).chain((0..300).map(line)).collect();
    assert_eq!(refused("camera=camera", "text/csv", &endless).await.0.len(), 100);
    let cases = [
        ("camera=nobody", good, "?camera"),
        ("camera=camera&crs=EPSG:1", good, "?crs"),
        ("camera=camera&tolerance_gsd=NaN", good, "?tolerance_gsd"),
        ("camera=camera&tolerance_gsd=1&tolerance_m=1", good, "?tolerance_m"),
        ("camera=camera&output_crs=nowhere", good, "?output_crs"),
        ("camera=camera&sigma_position_m=1,2", good, "?sigma_position_m"),
        ("camera=camera&name=%0A", good, "?name"),
        ("camera=camera&sigma_position_m=inf", good, "?sigma_position_m"),
        ("camera=camera", "name,lon,lat,height,omega\na,16.6,52.7,400,85\n", "line 2"),
        ("camera=camera", "name,lon,lat,height,image_id\na,16.6,52.7,400,x\n", "line 2"),
        (
            "camera=camera",
            "name,lon,lat,height,image_id\na,16.6,52.7,400,01a20225-f91a-7133-9892-18bd6449110e\n",
            "line 2",
        ),
    ];
    for (query, list, pointer) in cases {
        assert_eq!(refused(query, "text/csv", list).await, (vec![pointer.to_owned()], 422), "{query} {list}");
    }
    assert_eq!(refused("camera=camera", "application/pdf", good).await.1, 415);
    assert_eq!(refused("camera=camera&colour=red", "text/csv", good).await.1, 422);
    assert_eq!(working.service.get("/api/v1/blocks").await.json()["items"], json!([]));
    let eo = post(&working, "camera=camera&angles=gon", "text/plain", "# x\na 16.6 52.7 400 0 0 100 12.5\n").await;
    assert_eq!(eo.json()["images"], 1, "{:?}", eo.body);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_that_does_not_fit_is_not_attached_and_a_cancelled_one_may_come_again() {
    let gate = Arc::new(AtomicBool::new(false));
    let working = Working::with(held(&gate)).await;
    let other = "a".repeat(64);
    let list = format!("name,lon,lat,height,sha256\na,16.6,52.7,400,\nb,16.6,52.7,400,{other}\n");
    let block = id(&post(&working, "camera=camera", "text/csv", list).await);
    put(&working, &block, "b", png(1)).await.problem(422);
    put(&working, &block, "a", b"no picture".to_vec()).await.problem(415);
    let first = put(&working, &block, "a", png(1)).await.json()["orientation"].as_str().unwrap().to_owned();
    assert_eq!(working.service.delete(&format!("/api/v1/orientations/{first}")).await.status, 200);
    let second = put(&working, &block, "a", png(1)).await;
    assert_eq!(second.status, 201);
    assert_ne!(second.json()["orientation"], first.as_str());
    let second = second.json()["orientation"].as_str().unwrap().to_owned();
    working.until(&second, "running").await;
    assert_eq!(working.service.delete(&format!("/api/v1/blocks/{block}")).await.status, 204);
    working.until(&second, "cancelled").await;
    gate.store(true, Ordering::SeqCst);
}

#[tokio::test]
async fn no_room_in_the_queue_is_room_for_none() {
    let service = crate::support::Service::with(|configuration| configuration.queue_max_jobs = 2).await;
    assert_eq!(
        service
            .post(
                "/api/v1/cameras",
                &json!({"name": "camera", "image_size_px": [64, 48],
        "principal_distance_px": 60.0, "principal_point_px": [32.0, 24.0]})
            )
            .await
            .status,
        201
    );
    let image = service.upload("image/png", png(7)).await.json()["id"].as_str().unwrap().to_owned();
    let list = |count: usize| -> String {
        let line = |k: usize| format!("{k},16.6,52.7,400,{image}\n");
        std::iter::once("name,lon,lat,height,image_id\n".to_owned()).chain((0..count).map(line)).collect()
    };
    let post = async |count: usize| {
        let request = Request::post("/api/v1/blocks?camera=camera").header("content-type", "text/csv");
        service.send(request.body(Body::from(list(count))).unwrap()).await
    };
    post(3).await.problem(422);
    assert_eq!(post(1).await.status, 201);
    let full = post(2).await;
    full.problem(503);
    assert!(full.headers.contains_key("retry-after"));
    assert_eq!(service.get("/api/v1/blocks").await.json()["items"].as_array().unwrap().len(), 1);
    assert_eq!(service.get("/api/v1/orientations").await.json()["items"].as_array().unwrap().len(), 1);
}
