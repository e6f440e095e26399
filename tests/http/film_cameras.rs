//! Film cameras, and templates of their marks.

use axum::body::Body;
use axum::http::Request;
use serde_json::{Value, json};

use crate::support::{Answer, Service, camera};

const BOUNDARY: &str = "----gable";

fn film_camera(name: &str) -> Value {
    let mark = |name: &str, x: f64, y: f64| json!({"name": name, "position_mm": [x, y], "template": "leica_rc30"});
    json!({
        "name": name, "principal_distance_mm": 153.21, "principal_point_mm": [0.004, -0.002],
        "distortion": {"model": "smac", "k0": 2e-5, "k1": -3e-9, "p1": 1e-8},
        "fiducials": [mark("1", -106.0, -106.0), mark("2", 106.0, -106.0), mark("3", 106.0, 106.0), mark("4", -106.0, 106.0)],
    })
}

fn table(name: &str) -> Value {
    let mut camera = film_camera(name);
    camera["distortion"] = json!({"model": "table", "radius_mm": [0, 50, 100, 140], "distortion_um": [0, 3, 1, -8]});
    camera
}

fn template(name: &str) -> Value {
    json!({"name": name, "pixel_size_um": 14.0, "centre_px": [20.0, 16.5],
           "dont_care": [{"x": 0, "y": 0, "width": 10, "height": 4}]})
}

/// A cross, 40 x 33 px.
fn cross(shade: u8) -> Vec<u8> {
    let arm = |x: u32, y: u32| x.abs_diff(20) < 2 || y.abs_diff(16) < 2;
    encoded(&image::GrayImage::from_fn(40, 33, |x, y| image::Luma([if arm(x, y) { 200 + shade } else { 20 }])))
}

fn encoded(picture: &image::GrayImage) -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut file, image::ImageFormat::Png).unwrap();
    file.into_inner()
}

fn form(parts: &[(&str, &[u8])]) -> Request<Body> {
    let mut body = Vec::new();
    for (name, content) in parts {
        let head = format!("--{BOUNDARY}\r\ncontent-disposition: form-data; name=\"{name}\"; filename=\"f\"\r\n\r\n");
        body.extend_from_slice(head.as_bytes());
        body.extend_from_slice(content);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(format!("--{BOUNDARY}--\r\n").as_bytes());
    let request = Request::post("/api/v1/mark-templates");
    request.header("content-type", format!("multipart/form-data; boundary={BOUNDARY}")).body(Body::from(body)).unwrap()
}

async fn upload(service: &Service, file: &[u8], template: &Value) -> Answer {
    service.send(form(&[("file", file), ("template", template.to_string().as_bytes())])).await
}

#[tokio::test]
async fn film_cameras_come_back_with_what_was_left_out() {
    let service = Service::new().await;
    let made = service.post("/api/v1/cameras", &film_camera("rc30")).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    let shown = made.json();
    for name in ["name", "principal_distance_mm", "principal_point_mm"] {
        assert_eq!(shown[name], film_camera("rc30")[name]);
    }
    assert_eq!(shown["symmetry_point_mm"], shown["principal_point_mm"]);
    assert_eq!(shown["format_mm"], json!([230.0, 230.0]));
    let distortion = json!({"model": "smac", "k0": 2e-5, "k1": -3e-9, "k2": 0.0, "k3": 0.0, "k4": 0.0,
                            "p1": 1e-8, "p2": 0.0, "p3": 0.0, "p4": 0.0});
    assert_eq!(shown["distortion"], distortion);
    let first = json!({"name": "1", "position_mm": [-106.0, -106.0], "sigma_mm": 0.003, "template": "leica_rc30",
                       "rotation_deg": 0.0});
    assert_eq!(shown["fiducials"][0], first);
    for absent in ["image_size_px", "fiducial_distances", "adjustment", "asymmetric_feature", "data_strip"] {
        assert!(shown.get(absent).is_none(), "{absent}: {shown}");
    }
    let tabulated = service.post("/api/v1/cameras", &table("old")).await;
    assert_eq!(tabulated.status, 201, "{:?}", tabulated.body);
    assert_eq!(tabulated.json()["distortion"]["distortion_um"], json!([0.0, 3.0, 1.0, -8.0]));
    service.post("/api/v1/cameras", &camera("digital")).await;
    let list = service.get("/api/v1/cameras").await.json();
    let names: Vec<_> = list["items"].as_array().unwrap().iter().map(|item| item["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["digital", "old", "rc30"]);
    assert_eq!(list["items"][2], shown);
    assert_eq!(list["items"][0]["image_size_px"], json!([4000, 3000]));
    assert_eq!(service.get("/api/v1/cameras/rc30").await.json(), shown);
    assert_eq!(service.delete("/api/v1/cameras/rc30").await.status, 204);
    service.get("/api/v1/cameras/rc30").await.problem(404);
}

#[tokio::test]
async fn same_name_is_the_same_film_camera_or_a_conflict() {
    let service = Service::new().await;
    let first = service.post("/api/v1/cameras", &film_camera("twice")).await;
    let again = service.post("/api/v1/cameras", &film_camera("twice")).await;
    assert_eq!((first.status.as_u16(), again.status.as_u16()), (201, 200));
    assert_eq!(first.json(), again.json());
    let mut other = film_camera("twice");
    other["fiducials"][3]["sigma_mm"] = json!(0.004);
    for other in [other, camera("twice")] {
        assert_eq!(service.post("/api/v1/cameras", &other).await.problem(409), ["/name"]);
    }
    assert_eq!(service.get("/api/v1/cameras/twice").await.json(), first.json());
}

#[tokio::test]
async fn faults_of_film_cameras_are_pointed_at() {
    let service = Service::new().await;
    let with = |pointer: &str, value: Value| {
        let mut body = film_camera("pointed");
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        match body.pointer_mut(parent).unwrap() {
            Value::Array(items) => items[key.parse::<usize>().unwrap()] = value,
            parent => parent[key] = value,
        }
        body
    };
    let fiducials = |count: usize| {
        let mark = |k: usize| json!({"name": format!("{k}"), "position_mm": [2 * k, 0], "template": "bar"});
        json!((0..count).map(mark).collect::<Vec<_>>())
    };
    let simple = [
        ("/name", json!("")),
        ("/colour", json!("red")),
        ("/principal_distance_mm", json!(-153)),
        ("/principal_distance_mm", json!("153")),
        ("/principal_point_mm/1", json!(501)),
        ("/principal_point_mm/0", json!("x")),
        ("/symmetry_point_mm", json!([200, 0])),
        ("/format_mm/0", json!(0)),
        ("/format_mm/1", json!(2000)),
        ("/distortion/model", json!("brown")),
        ("/distortion/k5", json!(1)),
        ("/distortion/radius_mm", json!([1, 2])),
        ("/fiducials", fiducials(1)),
        ("/fiducials", fiducials(33)),
        ("/fiducials/0/name", json!("")),
        ("/fiducials/0/name", json!("x".repeat(41))),
        ("/fiducials/1/name", json!("1")),
        ("/fiducials/2/position_mm/0", json!(-501)),
        ("/fiducials/2/position_mm", json!([-105.5, -106])),
        ("/fiducials/2/position_mm/1", json!(null)),
        ("/fiducials/2/sigma_mm", json!(0)),
        ("/fiducials/2/sigma_mm", json!(1.5)),
        ("/fiducials/2/template", json!("leica_rc31")),
        ("/fiducials/2/rotation_deg", json!(361)),
        ("/fiducials/2/colour", json!("red")),
        ("/data_strip", json!("front")),
        ("/image_size_px", json!([16000, 16000])),
        ("/principal_distance_px", json!(10000)),
    ];
    for (pointer, value) in simple {
        let given = if pointer == "/format_mm/0" || pointer == "/format_mm/1" {
            let mut sides = json!([230, 230]);
            sides[usize::from(pointer.ends_with('1'))] = value;
            with("/format_mm", sides)
        } else {
            with(pointer, value)
        };
        let pointers = service.post("/api/v1/cameras", &given).await.problem(422);
        assert_eq!(pointers, [pointer], "{given}");
    }
    let nested = [
        ("/distortion", json!({"model": "smac", "k1": -1e-3}), "/distortion"),
        (
            "/distortion",
            json!({"model": "table", "k1": 0, "radius_mm": [1, 2], "distortion_um": [1, 2]}),
            "/distortion/k1",
        ),
        ("/distortion", json!({"model": "table", "radius_mm": [1, 2]}), "/distortion/distortion_um"),
        (
            "/distortion",
            json!({"model": "table", "radius_mm": [1, 2], "distortion_um": [1]}),
            "/distortion/distortion_um",
        ),
        (
            "/distortion",
            json!({"model": "table", "radius_mm": [0, 2], "distortion_um": [0, 1]}),
            "/distortion/radius_mm",
        ),
        (
            "/distortion",
            json!({"model": "table", "radius_mm": [1, -2], "distortion_um": [0, 1]}),
            "/distortion/radius_mm/1",
        ),
        (
            "/asymmetric_feature",
            json!({"position_mm": [0, 999], "template": "arrow"}),
            "/asymmetric_feature/position_mm/1",
        ),
        ("/asymmetric_feature", json!({"position_mm": [0, 99], "template": "bow"}), "/asymmetric_feature/template"),
        (
            "/asymmetric_feature",
            json!({"position_mm": [0, 99], "template": "bar", "sigma_mm": 2}),
            "/asymmetric_feature/sigma_mm",
        ),
        ("/fiducial_distances", json!([{"between": ["1", "3"], "distance_mm": 299.8}]), "/fiducial_distances"),
        (
            "/fiducial_distances",
            json!([{"between": ["1", "3"], "distance_mm": -1}]),
            "/fiducial_distances/0/distance_mm",
        ),
        ("/fiducial_distances", json!([{"between": ["1", "x"], "distance_mm": 9}]), "/fiducial_distances/0/between/1"),
    ];
    for (place, value, pointer) in nested {
        let given = with(place, value);
        assert_eq!(service.post("/api/v1/cameras", &given).await.problem(422), [pointer], "{given}");
    }
    for field in ["principal_distance_mm", "principal_point_mm", "fiducials"] {
        let mut given = film_camera("pointed");
        given.as_object_mut().unwrap().remove(field);
        let answer = service.post("/api/v1/cameras", &given).await;
        answer.problem(422);
        assert!(answer.json()["detail"].as_str().unwrap().contains(field), "{:?}", answer.body);
    }
    assert!(service.state.store.cameras(None, 10).await.unwrap().is_empty());
}

#[tokio::test]
async fn distances_between_marks_are_adjusted() {
    let service = Service::new().await;
    let mut given = film_camera("distances");
    let pairs = [["1", "2"], ["2", "3"], ["3", "4"], ["4", "1"], ["1", "3"], ["2", "4"]];
    let length = |k: usize| if k < 4 { 211.98 } else { 299.8 };
    let distance =
        |(k, pair): (usize, &[&str; 2])| json!({"between": pair, "distance_mm": length(k), "sigma_mm": 0.02});
    given["fiducial_distances"] = json!(pairs.iter().enumerate().map(distance).collect::<Vec<_>>());
    let made = service.post("/api/v1/cameras", &given).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    let shown = made.json();
    assert_eq!(shown["fiducials"][0]["approximate_position_mm"], json!([-106.0, -106.0]));
    let x = shown["fiducials"][0]["position_mm"][0].as_f64().unwrap();
    assert!(x < -105.98 && x > -106.01, "{x}");
    let sigma = shown["fiducials"][0]["sigma_mm"].as_f64().unwrap();
    assert!((sigma - 0.02 * (2.25_f64 / 8.0).sqrt()).abs() < 1e-6, "{sigma}");
    assert_eq!(shown["adjustment"]["redundancy"], 1);
    assert!(shown["fiducial_distances"][4]["residual_mm"].as_f64().unwrap().abs() > 1e-3);
    assert_eq!(service.post("/api/v1/cameras", &given).await.status, 200);
    given["name"] = json!("blunder");
    given["fiducial_distances"][4]["distance_mm"] = json!(301.8);
    let refused = service.post("/api/v1/cameras", &given).await;
    let pointers = refused.problem(422);
    assert!(pointers[0].starts_with("/fiducial_distances/"), "{pointers:?}");
    assert!(refused.json()["detail"].as_str().unwrap().contains("times its standard deviation"));
}

#[tokio::test]
async fn templates_come_back_and_stay_while_a_camera_needs_them() {
    let service = Service::new().await;
    let made = upload(&service, &cross(0), &template("own/mark")).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    let shown = made.json();
    assert_eq!((&shown["width_px"], &shown["height_px"]), (&json!(40), &json!(33)));
    for name in ["name", "pixel_size_um", "centre_px", "dont_care"] {
        assert_eq!(shown[name], template("own/mark")[name]);
    }
    assert_eq!(shown["negative"], false);
    let address = "/api/v1/mark-templates/own%2Fmark";
    assert_eq!(service.get(address).await.json(), shown);
    assert_eq!(service.get(made.headers["location"].to_str().unwrap()).await.json(), shown);
    assert_eq!(service.get("/api/v1/mark-templates").await.json(), json!({"items": [shown], "next_cursor": null}));
    assert!(service.files("incoming").is_empty());
    let picture = service.get(&format!("{address}/picture")).await;
    assert_eq!(picture.headers["content-type"], "image/png");
    let picture = image::load_from_memory(&picture.body).unwrap().into_luma16();
    assert_eq!(
        (picture.dimensions(), picture.get_pixel(20, 5).0, picture.get_pixel(2, 2).0),
        ((40, 33), [200 * 257], [20 * 257])
    );

    let again = upload(&service, &cross(0), &template("own/mark")).await;
    assert_eq!((again.status.as_u16(), again.json()), (200, shown.clone()));
    assert_eq!(upload(&service, &cross(1), &template("own/mark")).await.problem(409), ["/name"]);
    let mut other = template("own/mark");
    other["pixel_size_um"] = json!(15);
    assert_eq!(upload(&service, &cross(0), &other).await.problem(409), ["/name"]);

    let mut camera = film_camera("with own");
    camera["fiducials"][0]["template"] = json!("own/mark");
    camera["fiducials"][1]["template"] = json!("own/mark");
    let made = service.post("/api/v1/cameras", &camera).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    let model = gable::jobs::camera_model::camera_model(&service.state.store, "with own").await.unwrap().unwrap();
    let gable::jobs::request::CameraModel::Film(film) = model else { panic!("{model:?}") };
    let gable::interior::Mark::Cut(cut) = &*film.plate.fiducials[0].mark else { panic!("{film:?}") };
    assert_eq!((cut.width, cut.height, cut.pixel_mm), (40, 33, 0.014));
    assert_eq!((cut.grey[5 * 40 + 20], cut.care[3 * 40 + 9], cut.care[4 * 40 + 9]), (200.0, false, true));
    service.delete(address).await.problem(409);
    assert_eq!(service.delete("/api/v1/cameras/with%20own").await.status, 204);
    assert_eq!(service.delete(address).await.status, 204);
    service.get(address).await.problem(404);
    service.get(&format!("{address}/picture")).await.problem(404);
    service.delete(address).await.problem(404);
    assert_eq!(service.post("/api/v1/cameras", &camera).await.problem(422).len(), 2);
}

#[tokio::test]
async fn negatives_are_inverted() {
    let service = Service::new().await;
    let mut given = template("negative");
    given["negative"] = json!(true);
    let made = upload(&service, &cross(0), &given).await;
    assert_eq!((made.status.as_u16(), &made.json()["negative"]), (201, &json!(true)));
    let picture = service.get("/api/v1/mark-templates/negative/picture").await;
    let picture = image::load_from_memory(&picture.body).unwrap().into_luma16();
    assert_eq!((picture.get_pixel(20, 5).0, picture.get_pixel(2, 2).0), ([55 * 257], [235 * 257]));
}

#[tokio::test]
async fn templates_that_make_no_sense_are_refused() {
    let service = Service::new().await;
    let with = |field: &str, value: Value| {
        let mut given = template("wrong");
        given[field] = value;
        given
    };
    let cases = [
        (with("name", json!("")), "/name"),
        (with("name", json!("leica_rc30")), "/name"),
        (with("colour", json!(1)), "/colour"),
        (with("pixel_size_um", json!(0)), "/pixel_size_um"),
        (with("centre_px", json!([40, 10])), "/centre_px/0"),
        (with("centre_px", json!([10, -1])), "/centre_px/1"),
        (with("dont_care", json!([{"x": 39, "y": 0, "width": 2, "height": 1}])), "/dont_care/0"),
        (with("dont_care", json!([{"x": 0, "y": 0, "width": 1, "height": 0}])), "/dont_care/0"),
        (with("dont_care", json!([{"x": 4_294_967_295_u32, "y": 0, "width": 2, "height": 1}])), "/dont_care/0"),
        (with("dont_care", json!([{"x": 0, "y": 0, "width": 40, "height": 33}])), "/dont_care"),
    ];
    for (given, pointer) in cases {
        assert_eq!(upload(&service, &cross(0), &given).await.problem(422), [pointer], "{given}");
    }
    let grey = encoded(&image::GrayImage::from_pixel(40, 33, image::Luma([90])));
    assert!(upload(&service, &grey, &template("grey")).await.problem(422).is_empty());
    let large = encoded(&image::GrayImage::from_fn(513, 20, |x, _| image::Luma([x as u8])));
    upload(&service, &large, &template("large")).await.problem(413);
    let small = encoded(&image::GrayImage::from_fn(7, 20, |x, _| image::Luma([x as u8])));
    upload(&service, &small, &template("small")).await.problem(422);
    upload(&service, b"no picture", &template("text")).await.problem(415);
    let cut_off = cross(0);
    upload(&service, &cut_off[..cut_off.len() / 2], &template("cut off")).await.problem(422);
    let (file, text) = (cross(0), template("parts").to_string());
    service.send(form(&[("file", &file)])).await.problem(422);
    service.send(form(&[("template", text.as_bytes())])).await.problem(422);
    service.send(form(&[("file", &file), ("file", &file), ("template", text.as_bytes())])).await.problem(422);
    service.send(form(&[("file", &file), ("more", b""), ("template", text.as_bytes())])).await.problem(422);
    service.post("/api/v1/mark-templates", &template("json")).await.problem(415);
    let huge = vec![0; 5 << 20];
    service.send(form(&[("file", &huge), ("template", text.as_bytes())])).await.problem(413);
    assert!(service.state.store.mark_templates(None, 10).await.unwrap().is_empty());
    assert!(service.files("incoming").is_empty());
}
