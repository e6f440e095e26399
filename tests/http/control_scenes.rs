//! Control scenes, through the router.

use gable::database::query;
use std::sync::{Arc, Mutex};

use axum::body::Body;
use axum::http::{Method, Request};
use gable::jobs::Orient;
use gable::pipeline::Fault;
use gable::store::keys::Role;
use serde_json::{Value, json};
use tokio_util::sync::CancellationToken;

use crate::scratch::over_sqlite;
use crate::support::{Answer, Service, camera, jpeg, json_post, png};

const BOUNDARY: &str = "xyzzy";

fn scene(name: &str) -> Value {
    scene_at(name, 5e5)
}

fn scene_at(name: &str, east_m: f64) -> Value {
    json!({"name": name, "gsd_m": 0.1, "azimuth_of_image_up_deg": 0.0, "sigma_azimuth_deg": 3.0,
           "reference_px": [32.0, 24.0], "sigma_m": 0.05,
           "reference": {"crs": "EPSG:25833", "coordinates": [east_m, 5.8e6, 70.0],
                         "vertical": {"geoid_undulation_m": 38.0}}})
}

/// The scene with another value at a pointer.
fn spoilt(pointer: &str, value: Value) -> Value {
    let mut scene = scene("spoilt");
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match scene.pointer_mut(pointer) {
        Some(place) => *place = value,
        None => scene.pointer_mut(parent).unwrap()[key] = value,
    }
    scene
}

fn without(key: &str) -> Value {
    let mut scene = scene("spoilt");
    scene.as_object_mut().unwrap().remove(key).unwrap();
    scene
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
    let request = Request::post("/api/v1/control-scenes");
    request.header("content-type", format!("multipart/form-data; boundary={BOUNDARY}")).body(Body::from(body)).unwrap()
}

async fn upload(service: &Service, file: &[u8], scene: &Value) -> Answer {
    service.send(form(&[("file", file), ("scene", scene.to_string().as_bytes())])).await
}

async fn names(service: &Service, query: &str) -> Vec<String> {
    let page = service.get(&format!("/api/v1/control-scenes?{query}")).await.json();
    let items = page["items"].as_array().unwrap_or_else(|| panic!("{page}")).clone();
    items.iter().map(|item| item["name"].as_str().unwrap().to_owned()).collect()
}

fn picture(width: u32, height: u32) -> Vec<u8> {
    let picture = image::GrayImage::from_fn(width, height, |x, y| image::Luma([(x as u8) ^ (y as u8)]));
    encoded(&picture, image::ImageFormat::Png)
}

fn encoded(picture: &image::GrayImage, format: image::ImageFormat) -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut file, format).unwrap();
    file.into_inner()
}

#[tokio::test]
async fn a_scene_comes_back_as_it_was_given() {
    let service = Service::new().await;
    let file = jpeg(0);
    let made = upload(&service, &file, &scene("church square")).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    let shown = made.json();
    let id = shown["id"].as_str().unwrap();
    assert_eq!(made.headers["location"], format!("/api/v1/control-scenes/{id}"));
    for (key, value) in scene("church square").as_object().unwrap() {
        assert_eq!(&shown[key], value, "{key}");
    }
    assert_eq!((&shown["width_px"], &shown["height_px"]), (&json!(64), &json!(48)));
    assert_eq!((&shown["media_type"], &shown["size_bytes"]), (&json!("image/jpeg"), &json!(file.len())));
    assert_eq!(shown["picture"], format!("/api/v1/control-scenes/{id}/picture"));
    assert!(shown.get("warnings").is_none(), "{shown}");
    let read = service.get("/api/v1/control-scenes/church%20square").await.json();
    assert_eq!(service.get(&format!("/api/v1/control-scenes/{id}")).await.json(), read);
    assert_eq!(read["reference"]["crs"], "EPSG:4979");
    let geographic = read["reference"]["coordinates"].as_array().unwrap();
    assert!((geographic[0].as_f64().unwrap() - 15.0).abs() < 1e-9, "the central meridian of zone 33: {read}");
    // the ellipsoids of ETRS89 and WGS 84 are a tenth of a millimetre apart
    assert!((geographic[2].as_f64().unwrap() - 108.0).abs() < 2e-4, "{read}");
    let address = format!("/api/v1/control-scenes/{id}?crs=EPSG:25833&geoid_undulation_m=38");
    let grid = service.get(&address).await.json();
    for (found, given) in grid["reference"]["coordinates"].as_array().unwrap().iter().zip([5e5, 5.8e6, 70.0]) {
        assert!((found.as_f64().unwrap() - given).abs() < 1e-5, "{grid}");
    }
    assert_eq!(grid["reference"]["vertical"], json!({"geoid_undulation_m": 38.0}));
    service.get("/api/v1/control-scenes/nobody").await.problem(404);
    assert_eq!(service.get(&format!("/api/v1/control-scenes/{id}?crs=EPSG:1")).await.problem(422), ["?crs"]);
}

#[tokio::test]
async fn parts_come_in_any_order_and_what_is_left_out_has_a_default() {
    let service = Service::new().await;
    let mut least = scene("least");
    least.as_object_mut().unwrap().remove("sigma_azimuth_deg");
    least["reference"].as_object_mut().unwrap().remove("vertical");
    let made = service.send(form(&[("scene", least.to_string().as_bytes()), ("file", &png(1))])).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    assert_eq!(made.json()["sigma_azimuth_deg"], 5.0);
    assert_eq!(made.json()["warnings"][0]["code"], "vertical_assumed_ellipsoidal");
    // the rim of the picture belongs to it
    let mut rim = scene("rim");
    rim["reference_px"] = json!([0, 48]);
    assert_eq!(upload(&service, &png(1), &rim).await.status, 201);
}

#[tokio::test]
async fn pictures_come_back_to_the_last_bit() {
    let service = Service::new().await;
    let drawing: Vec<u8> = (0..64 * 48).map(|k| (k % 251) as u8).collect();
    let mut file = std::io::Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut file).unwrap();
    encoder.write_image::<tiff::encoder::colortype::Gray8>(64, 48, &drawing).unwrap();
    let tiff_file = file.into_inner();
    for (name, file, media_type) in
        [("a", jpeg(1), "image/jpeg"), ("b", png(2), "image/png"), ("c", tiff_file, "image/tiff")]
    {
        assert_eq!(upload(&service, &file, &scene(name)).await.status, 201);
        let address = format!("/api/v1/control-scenes/{name}/picture");
        let shown = service.get(&address).await;
        assert_eq!(shown.status, 200);
        assert!(shown.body == file, "{name} has changed");
        assert_eq!(shown.headers["content-type"], media_type);
        assert_eq!(shown.headers["x-content-type-options"], "nosniff");
        let tag = shown.headers["etag"].to_str().unwrap();
        let sha256 = service.get(&format!("/api/v1/control-scenes/{name}")).await.json()["sha256"].clone();
        assert_eq!(tag, format!("\"{}\"", sha256.as_str().unwrap()));
        let again = Request::get(&address).header("if-none-match", format!("\"other\", W/{tag}"));
        let again = service.send(again.body(Body::empty()).unwrap()).await;
        assert_eq!((again.status.as_u16(), again.body.len()), (304, 0));
        let other = Request::get(&address).header("if-none-match", "\"other\"");
        assert_eq!(service.send(other.body(Body::empty()).unwrap()).await.status, 200);
    }
    service.get("/api/v1/control-scenes/d/picture").await.problem(404);
    assert_eq!(service.files("incoming"), Vec::<String>::new());
}

#[tokio::test]
async fn the_same_name_replaces_and_keeps_the_id() {
    let service = Service::new().await;
    let first = upload(&service, &png(1), &scene("square")).await.json();
    let mut moved = scene_at("square", 5.1e5);
    moved["gsd_m"] = json!(0.2);
    let second = upload(&service, &jpeg(2), &moved).await;
    assert_eq!(second.status, 200);
    assert_eq!(second.headers["location"], format!("/api/v1/control-scenes/{}", first["id"].as_str().unwrap()));
    let second = second.json();
    for same in ["id", "created_at", "picture"] {
        assert_eq!(second[same], first[same], "{same}");
    }
    assert_ne!(second["updated_at"], first["updated_at"]);
    assert_eq!((&second["gsd_m"], &second["media_type"]), (&json!(0.2), &json!("image/jpeg")));
    assert!(service.get("/api/v1/control-scenes/square/picture").await.body == jpeg(2));
    // its box has moved with it
    assert_eq!(names(&service, "crs=EPSG:25833&bbox=499990,5799990,500010,5800010").await, Vec::<String>::new());
    assert_eq!(names(&service, "crs=EPSG:25833&bbox=509990,5799990,510010,5800010").await, ["square"]);
    assert_eq!(names(&service, "").await, ["square"]);
}

#[tokio::test]
async fn the_same_request_with_the_same_key_is_answered_as_the_first() {
    let service = Service::new().await;
    let ask = |scene: &Value| {
        let mut request = form(&[("file", &png(1)), ("scene", scene.to_string().as_bytes())]);
        request.headers_mut().insert("idempotency-key", "one".parse().unwrap());
        request
    };
    let first = service.send(ask(&scene("square"))).await;
    let second = service.send(ask(&scene("square"))).await;
    assert_eq!((first.status.as_u16(), second.status.as_u16()), (201, 201));
    assert_eq!(first.json(), second.json());
    service.send(ask(&scene("other"))).await.problem(422);
}

#[tokio::test]
async fn lists_are_paged_and_rectangles_are_exact_in_their_crs() {
    let service = Service::new().await;
    for i in 0..5 {
        let made = upload(&service, &png(i), &scene_at(&format!("s{i}"), 5e5 + 100.0 * f64::from(i))).await;
        assert_eq!(made.status, 201);
    }
    let page = service.get("/api/v1/control-scenes?crs=EPSG:25833&limit=3").await.json();
    let rest = page["next_cursor"].as_str().unwrap();
    let rest = service.get(&format!("/api/v1/control-scenes?crs=EPSG:25833&limit=3&cursor={rest}")).await.json();
    assert_eq!(rest["next_cursor"], Value::Null);
    let items: Vec<_> = [&page, &rest].iter().flat_map(|page| page["items"].as_array().unwrap()).collect();
    assert_eq!(items.len(), 5);
    for (i, item) in items.iter().enumerate() {
        assert_eq!(item["name"], format!("s{i}"));
        let east_m = item["reference"]["coordinates"][0].as_f64().unwrap();
        assert!((east_m - 5e5 - 100.0 * i as f64).abs() < 1e-5, "{item}");
        let picture = service.get(item["picture"].as_str().unwrap()).await;
        assert!(picture.body == png(i as u8));
    }
    // each is 6.4 m wide, 3.2 m to either side of its reference
    assert_eq!(names(&service, "crs=EPSG:25833&bbox=500103.0,5799999,500199.9,5800001").await, ["s1", "s2"]);
    assert_eq!(names(&service, "crs=EPSG:25833&bbox=500103.4,5799999,500196.6,5800001").await, Vec::<String>::new());
    let two = service.get("/api/v1/control-scenes?crs=EPSG:25833&bbox=499990,5799990,500110,5800010&limit=1").await;
    let cursor = two.json()["next_cursor"].as_str().unwrap().to_owned();
    let query = format!("crs=EPSG:25833&bbox=499990,5799990,500110,5800010&limit=1&cursor={cursor}");
    assert_eq!(names(&service, &query).await, ["s1"]);
    for (query, pointer) in [
        ("bbox=1,2,3", "?bbox"),
        ("bbox=3,2,1,4", "?bbox"),
        ("crs=EPSG:1", "?crs"),
        ("geoid_undulation_m=1000", "?geoid_undulation_m"),
        ("limit=0", "?limit"),
        ("cursor=x", "?cursor"),
    ] {
        assert_eq!(service.get(&format!("/api/v1/control-scenes?{query}")).await.problem(422), [pointer], "{query}");
    }
    service.get("/api/v1/control-scenes?box=1").await.problem(422);
}

#[tokio::test]
async fn what_is_deleted_is_gone_with_its_picture() {
    let service = Service::new().await;
    let id = upload(&service, &png(1), &scene("a")).await.json()["id"].as_str().unwrap().to_owned();
    upload(&service, &png(1), &scene("b")).await;
    assert_eq!(service.delete("/api/v1/control-scenes/b").await.status, 204);
    assert_eq!(service.delete(&format!("/api/v1/control-scenes/{id}")).await.status, 204);
    service.delete(&format!("/api/v1/control-scenes/{id}")).await.problem(404);
    service.get(&format!("/api/v1/control-scenes/{id}/picture")).await.problem(404);
    assert_eq!(names(&service, "").await, Vec::<String>::new());
    let boxes = over_sqlite().then_some("control_scene_boxes");
    for table in ["control_scenes", "control_scene_pictures"].into_iter().chain(boxes) {
        let count: i64 = query(sqlx::AssertSqlSafe(format!("SELECT count(*) FROM {table}")))
            .fetch_value(service.state.store.database())
            .await
            .unwrap();
        assert_eq!(count, 0, "{table}");
    }
}

#[tokio::test]
async fn fields_at_fault_are_pointed_at() {
    let service = Service::new().await;
    let cases = [
        (spoilt("/colour", json!("red")), "/colour"),
        (spoilt("/name", json!("")), "/name"),
        (spoilt("/name", json!(" a")), "/name"),
        (spoilt("/name", json!("a".repeat(201))), "/name"),
        (spoilt("/name", json!("01a20225-f91a-7133-9892-18bd6449110e")), "/name"),
        (spoilt("/gsd_m", json!(0)), "/gsd_m"),
        (spoilt("/gsd_m", json!(-0.1)), "/gsd_m"),
        (spoilt("/gsd_m", json!(10)), "/gsd_m"),
        (spoilt("/gsd_m", json!("fine")), "/gsd_m"),
        (spoilt("/azimuth_of_image_up_deg", json!(361)), "/azimuth_of_image_up_deg"),
        (spoilt("/sigma_azimuth_deg", json!(0)), "/sigma_azimuth_deg"),
        (spoilt("/sigma_azimuth_deg", json!(180.5)), "/sigma_azimuth_deg"),
        (spoilt("/sigma_m", json!(0)), "/sigma_m"),
        (spoilt("/sigma_m", json!(101)), "/sigma_m"),
        (spoilt("/reference_px", json!([-0.5, 24])), "/reference_px/0"),
        (spoilt("/reference_px", json!([32, 48.5])), "/reference_px/1"),
        (spoilt("/reference/crs", json!("EPSG:1")), "/reference/crs"),
        (spoilt("/reference/colour", json!(1)), "/reference/colour"),
        (
            spoilt("/reference", json!({"crs": "EPSG:4979", "coordinates": [15.0, 91.0, 70.0]})),
            "/reference/coordinates/1",
        ),
        (spoilt("/reference/vertical/geoid_undulation_m", json!(900)), "/reference/vertical/geoid_undulation_m"),
        (json!([]), ""),
    ];
    for (scene, pointer) in cases {
        assert_eq!(upload(&service, &png(1), &scene).await.problem(422), [pointer], "{scene}");
    }
    for key in ["name", "gsd_m", "azimuth_of_image_up_deg", "reference_px", "reference", "sigma_m"] {
        let answer = upload(&service, &png(1), &without(key)).await;
        answer.problem(422);
        assert!(String::from_utf8_lossy(&answer.body).contains(key), "{key}: {:?}", answer.body);
    }
    let mut several = spoilt("/gsd_m", json!(0));
    several["reference_px"] = json!([-1, -1]);
    several["reference"]["crs"] = json!("nonsense");
    let pointers = upload(&service, &png(1), &several).await.problem(422);
    assert_eq!(pointers, ["/gsd_m", "/reference/crs", "/reference_px/0", "/reference_px/1"]);
    assert_eq!(names(&service, "").await, Vec::<String>::new());
}

#[tokio::test]
async fn forms_that_are_none_are_refused() {
    let service = Service::new().await;
    let described = scene("form").to_string();
    let (file, described) = (png(1), described.as_bytes());
    let says = async |request: Request<Body>, status: u16, said: &str| {
        let answer = service.send(request).await;
        answer.problem(status);
        assert!(answer.json()["detail"].as_str().unwrap().contains(said), "{said}: {:?}", answer.body);
    };
    says(form(&[("file", &file)]), 422, "no part `scene`").await;
    says(form(&[("scene", described)]), 422, "no part `file`").await;
    says(form(&[]), 422, "no part").await;
    says(form(&[("file", &file), ("scene", described), ("file", &file)]), 422, "more than one part \"file\"").await;
    says(form(&[("scene", described), ("scene", described), ("file", &file)]), 422, "more than one").await;
    says(form(&[("file", &file), ("scene", described), ("notes", b"x")]), 422, "part \"notes\"").await;
    says(form(&[("file", &file), ("scene", b"{")]), 400, "not valid JSON").await;
    says(form(&[("file", &file), ("scene", &[0xff, 0xfe])]), 400, "not valid JSON").await;
    says(json_post("/api/v1/control-scenes", &scene("json")), 415, "multipart/form-data").await;
    let mut cut = Vec::from(&b"--xyzzy\r\ncontent-disposition: form-data; name=\"file\"\r\n\r\n"[..]);
    cut.extend_from_slice(&file);
    let head = Request::post("/api/v1/control-scenes").header("content-type", "multipart/form-data; boundary=xyzzy");
    service.send(head.body(Body::from(cut)).unwrap()).await.problem(400);
    assert_eq!(names(&service, "").await, Vec::<String>::new());
}

#[tokio::test]
async fn pictures_that_are_none_are_refused() {
    let service = Service::new().await;
    let scene = scene("picture");
    upload(&service, b"not a picture", &scene).await.problem(415);
    upload(&service, b"", &scene).await.problem(415);
    let file = jpeg(1);
    upload(&service, &file[..file.len() / 2], &scene).await.problem(422);
    let small = upload(&service, &picture(31, 400), &scene).await;
    small.problem(422);
    assert!(small.json()["detail"].as_str().unwrap().contains("at least 32 px"), "{:?}", small.body);
    let grey = encoded(&image::GrayImage::from_pixel(64, 48, image::Luma([90])), image::ImageFormat::Png);
    upload(&service, &grey, &scene).await.problem(422);
    assert_eq!(names(&service, "").await, Vec::<String>::new());
    assert_eq!(service.files("incoming"), Vec::<String>::new());
}

#[tokio::test]
async fn what_is_too_large_is_refused() {
    let service = Service::with(|configuration| {
        configuration.scene_max_bytes = 20_000;
        configuration.scene_max_pixels = 5_000;
    })
    .await;
    assert_eq!(upload(&service, &picture(64, 48), &scene("fits")).await.status, 201);
    let wide = upload(&service, &picture(101, 50), &scene("wide")).await;
    wide.problem(413);
    assert!(wide.json()["detail"].as_str().unwrap().contains("scene_max_pixels"), "{:?}", wide.body);
    let long = upload(&service, &vec![0; 20_001], &scene("long")).await;
    long.problem(413);
    assert!(long.json()["detail"].as_str().unwrap().contains("scene_max_bytes"), "{:?}", long.body);
    let padded = format!("{}{}", scene("padded"), " ".repeat(70_000));
    service.send(form(&[("scene", padded.as_bytes()), ("file", &png(1))])).await.problem(413);
}

#[tokio::test]
async fn roles_are_those_of_control_points() {
    let service = Service::with(|configuration| configuration.listen = "0.0.0.0:8080".parse().unwrap()).await;
    let (reader, operator) = (service.key(Role::Reader).await.0, service.key(Role::Operator).await.0);
    let ask = async |key: &str| {
        let mut request = form(&[("file", &png(1)), ("scene", scene("a").to_string().as_bytes())]);
        request.headers_mut().insert("authorization", format!("Bearer {key}").parse().unwrap());
        service.send(request).await
    };
    ask("gable_unknown").await.problem(401);
    ask(&reader).await.problem(403);
    assert_eq!(ask(&operator).await.status, 201);
    let send = async |method: Method, path: &str, key: &str| {
        service.send(crate::support::request(&method, &format!("/api/v1/control-scenes{path}"), Some(key))).await
    };
    for path in ["", "/a", "/a/picture"] {
        assert_eq!(send(Method::GET, path, &reader).await.status, 200, "{path}");
    }
    send(Method::DELETE, "/a", &reader).await.problem(403);
    assert_eq!(send(Method::DELETE, "/a", &operator).await.status, 204);
}

/// What the pipeline was given: names, and the sizes of the pictures.
type Given = Arc<Mutex<Vec<(String, Option<[usize; 2]>)>>>;

fn noting(given: &Given) -> Orient {
    let given = given.clone();
    Arc::new(move |_, control, _, _| {
        let noted = control.iter().map(|point| {
            let scene = point.scene.as_ref();
            assert_eq!(point.edges_m.is_empty(), scene.is_some());
            if let Some(scene) = scene {
                assert_eq!(scene.grey.len(), scene.width * scene.height);
                assert!(scene.azimuth_of_image_up_rad.abs() < 1e-6 && scene.gsd_m == 0.1);
                // the image is taken right above it
                assert!(point.reference_m.xy().norm() < 1e-3, "{}", point.reference_m);
            }
            (point.name.clone(), scene.map(|scene| [scene.width, scene.height]))
        });
        *given.lock().unwrap() = noted.collect();
        Err(Fault::Picture(gable::features::PictureError { detail: "seen enough".into() }))
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn orientations_get_the_control_that_they_ask_for() {
    let given = Given::default();
    let service = Service::with_pipeline(|configuration| configuration.workers = 1, noting(&given)).await;
    let stop = CancellationToken::new();
    let (jobs, stopped) = (service.state.jobs.clone(), stop.clone());
    jobs.prepare().await.unwrap();
    tokio::spawn(async move { jobs.run(stopped).await });
    let _guard = stop.drop_guard();
    let mut small = camera("small");
    small["image_size_px"] = json!([64, 48]);
    small["principal_point_px"] = json!([32, 24]);
    small["principal_distance_px"] = json!(60);
    small["distortion"] = json!({"model": "brown"});
    assert_eq!(service.post("/api/v1/cameras", &small).await.status, 201);
    let image = service.upload("image/png", png(7)).await.json()["id"].clone();
    assert_eq!(upload(&service, &png(1), &scene("square")).await.status, 201);
    assert_eq!(upload(&service, &png(2), &scene("damaged")).await.status, 201);
    assert_eq!(upload(&service, &png(3), &scene_at("far away", 5.3e5)).await.status, 201);
    // what was whole when it came may not be any more: the others are used without it
    let spoil = "UPDATE control_scene_pictures SET file = substr(file, 1, 200) WHERE scene_id =
                 (SELECT id FROM control_scenes WHERE name = 'damaged')";
    assert_eq!(query(spoil).execute(service.state.store.database()).await.unwrap(), 1);
    let building = json!({"type": "FeatureCollection", "features": [{"type": "Feature",
        "properties": {"name": "church", "sigma_m": 0.1},
        "geometry": {"type": "MultiLineString", "coordinates": [[[5e5, 5.8e6, 108.0], [500_010.0, 5.8e6, 108.0]]]}}]});
    let import = Request::post("/api/v1/control-points?crs=EPSG:25833").header("content-type", "application/geo+json");
    assert_eq!(service.send(import.body(Body::from(building.to_string())).unwrap()).await.status, 200);
    let (church, square) = (("church".to_owned(), None), ("square".to_owned(), Some([64, 48])));
    for (control, expected) in [
        (json!("lines"), vec![church.clone()]),
        (json!("scenes"), vec![square.clone()]),
        (json!("both"), vec![church.clone(), square.clone()]),
        (Value::Null, vec![church, square]),
    ] {
        let position = json!({"crs": "EPSG:25833", "coordinates": [5e5, 5.8e6, 400.0]});
        let wanted = json!({"image": image, "camera": "small", "control": control,
            "approximation": {"position": position, "kappa_deg": 0}});
        let mut post = json_post("/api/v1/orientations", &wanted);
        post.headers_mut().insert("prefer", "wait=20".parse().unwrap());
        let answer = service.send(post).await;
        assert_eq!((answer.status.as_u16(), &answer.json()["status"]), (200, &json!("failed")), "{:?}", answer.body);
        assert_eq!(*given.lock().unwrap(), expected, "{control}");
        given.lock().unwrap().clear();
    }
    let nonsense = json!({"image": image, "camera": "small", "control": "points"});
    assert_eq!(service.post("/api/v1/orientations", &nonsense).await.problem(422), ["/control"]);
}
