//! `kill -9` while orientations wait and run: each comes to its end after the restart, once.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::command_line::{Serving, gable};

const PATIENCE: Duration = Duration::from_secs(120);

/// Status and body of an answer.
fn ask(address: &str, method: &str, path: &str, kind: &str, body: &[u8]) -> (u16, Value) {
    let mut stream = TcpStream::connect(address).unwrap();
    let length = body.len();
    let head = format!(
        "{method} /api/v1{path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\n\
         Connection: close\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).unwrap();
    stream.write_all(body).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    let answer = String::from_utf8(answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    (head[9..12].parse().unwrap(), serde_json::from_str(body).unwrap_or_default())
}

fn post(address: &str, path: &str, body: &Value) -> (u16, Value) {
    ask(address, "POST", path, "application/json", body.to_string().as_bytes())
}

fn statuses(address: &str, status: &str) -> usize {
    let (_, page) = ask(address, "GET", &format!("/orientations?limit=200&status={status}"), "application/json", b"");
    page["items"].as_array().unwrap().len()
}

/// A picture full of edges that belong to nothing, so that an orientation takes its time.
fn puzzle() -> Vec<u8> {
    let picture = image::GrayImage::from_fn(1600, 1200, |x, y| {
        let field = (x / 37).wrapping_mul(2_654_435_761) ^ (y / 53).wrapping_mul(40_503);
        image::Luma([(field >> 7) as u8])
    });
    let mut file = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut file, image::ImageFormat::Png).unwrap();
    file.into_inner()
}

/// Square roofs of 10 m on a raster of 40 m below the camera.
fn roofs() -> Value {
    let roof = |column: i32, row: i32| {
        let (x, y) = (40.0 * f64::from(column), 40.0 * f64::from(row));
        let corners = [[x, y, 8.0], [x + 10.0, y, 8.0], [x + 10.0, y + 10.0, 8.0], [x, y + 10.0, 8.0]];
        let lines: Vec<_> = (0..4).map(|i| json!([corners[i], corners[(i + 1) % 4]])).collect();
        json!({"type": "Feature", "properties": {"name": format!("roof {column} {row}"), "sigma_m": 0.1},
            "geometry": {"type": "MultiLineString", "coordinates": lines}})
    };
    let features: Vec<_> = (-2..=2).flat_map(|column| (-2..=2).map(move |row| roof(column, row))).collect();
    json!({"type": "FeatureCollection", "features": features})
}

const FRAME: &str = "+proj=topocentric +ellps=WGS84 +lon_0=16.6 +lat_0=52.7 +h_0=100";

fn prepare(address: &str) -> Value {
    let camera = json!({"name": "camera", "image_size_px": [1600, 1200], "principal_distance_px": 1500.0,
        "principal_point_px": [800.0, 600.0]});
    assert_eq!(post(address, "/cameras", &camera).0, 201);
    let crs = FRAME.replace('+', "%2B").replace(' ', "%20");
    let imported = post(address, &format!("/control-points?crs={crs}"), &roofs());
    assert_eq!((imported.0, &imported.1["imported"]), (200, &json!(25)));
    let (status, image) = ask(address, "POST", "/images", "image/png", &puzzle());
    assert_eq!(status, 201);
    json!({"image": image["id"], "camera": "camera", "approximation": {
        "position": {"crs": FRAME, "coordinates": [0, 0, 200]}, "kappa_deg": 0, "sigma_kappa_deg": 3}})
}

fn start(folder: &Path) -> Serving {
    Serving::start(gable(folder, &["serve"]).env("GABLE_WORKERS", "1"))
}

#[test]
fn killed_service_ends_what_it_has_accepted_after_the_restart() {
    const ORIENTATIONS: usize = 12;
    let folder = tempfile::tempdir().unwrap();
    let mut serving = start(folder.path());
    let request = prepare(&serving.address);
    let mut ids = Vec::new();
    for _ in 0..ORIENTATIONS {
        let (status, orientation) = post(&serving.address, "/orientations", &request);
        assert_eq!(status, 202, "{orientation}");
        ids.push(orientation["id"].as_str().unwrap().to_owned());
    }
    let began = Instant::now();
    while statuses(&serving.address, "running") == 0 {
        assert!(began.elapsed() < PATIENCE);
    }
    serving.child.kill().unwrap();
    serving.child.wait().unwrap();

    let serving = start(folder.path());
    let began = Instant::now();
    while statuses(&serving.address, "queued") + statuses(&serving.address, "running") > 0 {
        assert!(began.elapsed() < PATIENCE);
        std::thread::sleep(Duration::from_millis(20));
    }
    let mut begun_twice = 0;
    for id in &ids {
        let (status, orientation) =
            ask(&serving.address, "GET", &format!("/orientations/{id}"), "application/json", b"");
        assert_eq!((status, &orientation["status"]), (200, &json!("succeeded")), "{orientation}");
        assert!(orientation["result"]["diagnosis"]["verdict"].is_string());
        assert!(orientation["finished_at"].is_string());
        begun_twice += usize::from(orientation["attempts"] == 2);
    }
    // the one that the kill has met, and no other
    assert!(begun_twice <= 1, "{begun_twice}");
    assert_eq!(statuses(&serving.address, "succeeded"), ORIENTATIONS);
}
