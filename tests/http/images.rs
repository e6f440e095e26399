//! Images: what is visible is complete, and what is not leaves nothing.

use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::http::Request;
use base64::Engine as _;
use futures_util::StreamExt as _;
use gable::store::images::hexadecimal;
use sha2::{Digest as _, Sha256};
use tower::ServiceExt as _;

use crate::support::{Service, jpeg, png, upload};

fn chunked(bytes: &[u8]) -> Body {
    let chunks: Vec<_> =
        bytes.chunks(100).map(|chunk| Ok::<_, std::io::Error>(Bytes::copy_from_slice(chunk))).collect();
    Body::from_stream(futures_util::stream::iter(chunks))
}

fn form(parts: &[(&str, &str, &[u8])]) -> Request<Body> {
    let mut body = Vec::new();
    for (name, media_type, content) in parts {
        let head = format!(
            "--mark\r\nContent-Disposition: form-data; name=\"{name}\"; filename=\"../../etc/x\"\r\n\
             Content-Type: {media_type}\r\n\r\n"
        );
        body.extend_from_slice(head.as_bytes());
        body.extend_from_slice(content);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(b"--mark--\r\n");
    upload("multipart/form-data; boundary=mark", body)
}

#[track_caller]
fn assert_nothing_kept(service: &Service) {
    assert_eq!(service.files("images"), Vec::<String>::new());
    assert_eq!(service.files("incoming"), Vec::<String>::new());
}

#[tokio::test]
async fn image_is_stored_under_its_hash_and_described() {
    let service = Service::new().await;
    let file = jpeg(0);
    let made = service.upload("image/jpeg", chunked(&file)).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    let image = made.json();
    let sha256 = hexadecimal(&Sha256::digest(&file));
    assert_eq!(image["sha256"], sha256.as_str());
    assert_eq!(image["size_bytes"], file.len());
    assert_eq!(
        (image["format"].as_str(), &image["width_px"], &image["height_px"]),
        (Some("jpeg"), &64.into(), &48.into())
    );
    assert!(image.get("position").is_none());
    assert_eq!(service.files("images"), [sha256.as_str()]);
    assert_eq!(service.files("incoming"), Vec::<String>::new());
    assert_eq!(std::fs::read(service.state.store.folder().join("images").join(sha256)).unwrap(), file);
    let location = made.headers["location"].to_str().unwrap();
    assert_eq!(service.get(location).await.json(), image);
    assert_eq!(service.get("/api/v1/images").await.json()["items"], serde_json::json!([image]));
}

#[tokio::test]
async fn same_bytes_are_the_same_image() {
    let service = Service::new().await;
    let first = service.upload("image/png", png(0)).await;
    let again = service.upload("image/png", png(0)).await;
    let other = service.upload("image/png", png(1)).await;
    assert_eq!((first.status.as_u16(), again.status.as_u16(), other.status.as_u16()), (201, 200, 201));
    assert_eq!(first.json(), again.json());
    assert_ne!(first.json()["id"], other.json()["id"]);
    assert_eq!(service.files("images").len(), 2);
}

#[tokio::test]
async fn same_bytes_at_the_same_time_are_the_same_image() {
    let service = Service::new().await;
    let uploads = (0..8).map(|_| service.upload("image/jpeg", chunked(&jpeg(0))));
    let answers = futures_util::future::join_all(uploads).await;
    assert_eq!(answers.iter().filter(|answer| answer.status == 201).count(), 1);
    assert!(answers.iter().all(|answer| answer.json() == answers[0].json()));
    assert_eq!(service.files("images").len(), 1);
}

#[tokio::test]
async fn form_with_the_file_is_understood() {
    let service = Service::new().await;
    let made = service.send(form(&[("file", "image/jpeg", &jpeg(0))])).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    assert_eq!(made.json()["sha256"], hexadecimal(&Sha256::digest(jpeg(0))).as_str());
    let untyped = service.send(form(&[("file", "application/octet-stream", &png(0))])).await;
    assert_eq!(untyped.status, 201);
}

#[tokio::test]
async fn an_image_has_the_name_of_its_file() {
    let service = Service::new().await;
    let named = async |query: &str, shade| {
        let mut request = upload("image/jpeg", jpeg(shade));
        *request.uri_mut() = format!("/api/v1/images{query}").parse().unwrap();
        service.send(request).await
    };
    assert!(named("", 0).await.json().get("name").is_none());
    assert_eq!(named("?name=flights%2FIMG%201.JPG", 1).await.json()["name"], "IMG 1.JPG");
    // the first name stays; one that had none gets one
    assert_eq!(named("?name=b.jpg", 1).await.json()["name"], "IMG 1.JPG");
    assert_eq!(named("?name=b.jpg", 0).await.json()["name"], "b.jpg");
    let of_form = service.send(form(&[("file", "image/jpeg", &jpeg(2))])).await.json();
    assert_eq!(of_form["name"], "x", "without the folders");
    for query in ["?name=", "?name=a%2F", "?name=a%00", &format!("?name={}", "x".repeat(256)), "?title=x"] {
        named(query, 3).await.problem(422);
    }
    assert_eq!(service.files("images").len(), 3);
    // what was removed comes back under its name
    let id = of_form["id"].as_str().unwrap();
    assert_eq!(service.delete(&format!("/api/v1/images/{id}")).await.status, 204);
    assert_eq!(named("?name=y.jpg", 2).await.json()["name"], "x");
}

#[tokio::test]
async fn forms_that_make_no_sense_are_refused() {
    let service = Service::new().await;
    let file = jpeg(0);
    service.send(form(&[])).await.problem(422);
    service.send(form(&[("picture", "image/jpeg", &file)])).await.problem(422);
    service.send(form(&[("file", "image/jpeg", &file), ("file", "image/jpeg", &file)])).await.problem(422);
    service.send(form(&[("file", "image/gif", &file)])).await.problem(415);
    service.send(form(&[("file", "image/png", &file)])).await.problem(415);
    service.send(upload("multipart/form-data", file.clone())).await.problem(400);
    service.send(upload("multipart/form-data; boundary=mark", "--mark\r\nContent-Disp")).await.problem(400);
    assert_nothing_kept(&service);
}

#[tokio::test]
async fn files_of_another_type_are_refused() {
    let service = Service::new().await;
    service.upload("image/png", jpeg(0)).await.problem(415);
    service.upload("image/gif", jpeg(0)).await.problem(415);
    service.upload("application/octet-stream", jpeg(0)).await.problem(415);
    service.upload("image/jpeg", "<html>").await.problem(415);
    service.send(Request::post("/api/v1/images").body(Body::from(jpeg(0))).unwrap()).await.problem(415);
    let mut packed = upload("image/jpeg", jpeg(0));
    packed.headers_mut().insert("content-encoding", "gzip".parse().unwrap());
    service.send(packed).await.problem(415);
    assert_nothing_kept(&service);
}

#[tokio::test]
async fn damaged_heads_are_refused() {
    let service = Service::new().await;
    service.upload("image/jpeg", "").await.problem(422);
    service.upload("image/jpeg", jpeg(0)[..30].to_vec()).await.problem(422);
    service.upload("image/png", png(0)[..20].to_vec()).await.problem(422);
    service.upload("image/tiff", b"II*\0\x08\0\0\0".to_vec()).await.problem(422);
    assert_nothing_kept(&service);
}

#[tokio::test]
async fn too_many_bytes_or_pixels_are_refused() {
    let service = Service::with(|configuration| configuration.upload_max_bytes = 1000).await;
    let unread = Body::from_stream(futures_util::stream::poll_fn(
        |_| -> std::task::Poll<Option<Result<Bytes, std::io::Error>>> { panic!("the body must not be read") },
    ));
    let mut announced = upload("image/jpeg", unread);
    announced.headers_mut().insert("content-length", "1001".parse().unwrap());
    service.send(announced).await.problem(413);
    service.upload("image/jpeg", chunked(&[0xff; 1001])).await.problem(413);
    service.send(form(&[("file", "image/jpeg", &[0xff; 1001])])).await.problem(413);
    assert_nothing_kept(&service);
    let small = Service::with(|configuration| configuration.image_max_side_px = 63).await;
    let answer = small.upload("image/jpeg", jpeg(0)).await;
    answer.problem(413);
    assert!(answer.json()["detail"].as_str().unwrap().contains("image_max_side_px"));
    assert_nothing_kept(&small);
}

#[tokio::test]
async fn declared_digest_must_be_that_of_the_file() {
    let service = Service::new().await;
    let digest = |bytes: &[u8]| base64::engine::general_purpose::STANDARD.encode(Sha256::digest(bytes));
    let declaring = |name: &'static str, value: String| {
        let mut request = upload("image/jpeg", jpeg(0));
        request.headers_mut().insert(name, value.parse().unwrap());
        service.send(request)
    };
    for name in ["content-digest", "repr-digest"] {
        let wrong = format!("sha-256=:{}:", digest(b"other"));
        assert_eq!(declaring(name, wrong).await.problem(422).len(), 1);
        for malformed in ["sha-256=abc", "sha-256=:!:", "sha-256=:YWJj:", "sha-256=::"] {
            assert_eq!(declaring(name, malformed.to_owned()).await.problem(400), [name]);
        }
    }
    assert_nothing_kept(&service);
    let right = format!("sha-512=:YWJj:, sha-256=:{}:", digest(&jpeg(0)));
    assert_eq!(declaring("content-digest", right.clone()).await.status, 201);
    assert_eq!(declaring("repr-digest", right).await.status, 200);
}

#[tokio::test]
async fn upload_that_breaks_off_leaves_nothing() {
    let service = Service::new().await;
    let file = jpeg(0);
    let half = || Ok(Bytes::copy_from_slice(&file[..file.len() / 2]));
    let broken = futures_util::stream::iter([half(), Err(std::io::Error::other("gone"))]);
    service.upload("image/jpeg", Body::from_stream(broken)).await.problem(400);
    assert_nothing_kept(&service);
    // the client goes away: its request is dropped while it waits for more
    let stalled = Body::from_stream(futures_util::stream::iter([half()]).chain(futures_util::stream::pending()));
    let mut request = upload("image/jpeg", stalled);
    request.headers_mut().insert("host", "localhost".parse().unwrap());
    let under_way = service.app.clone().oneshot(request);
    assert!(tokio::time::timeout(Duration::from_millis(300), under_way).await.is_err());
    assert_nothing_kept(&service);
    assert_eq!(service.upload("image/jpeg", file).await.status, 201);
}

#[tokio::test]
async fn sweep_removes_what_dead_uploads_left_and_nothing_else() {
    let service = Service::new().await;
    service.upload("image/jpeg", jpeg(0)).await;
    let store = &service.state.store;
    let kept = service.files("images");
    let mut alive = store.begin_upload().unwrap();
    alive.write(b"abc").await.unwrap();
    std::fs::write(store.folder().join("incoming/dead"), b"abc").unwrap();
    let old = std::time::SystemTime::now() - Duration::from_secs(7200);
    let set_old = |name: &str| {
        let file =
            std::fs::File::options().append(true).create(true).open(store.folder().join("images").join(name)).unwrap();
        file.set_modified(old).unwrap();
    };
    set_old(&"ab".repeat(32));
    set_old(&kept[0]);
    std::fs::write(store.folder().join("images").join("cd".repeat(32)), b"just moved there").unwrap();
    assert_eq!(store.sweep_uploads().await.unwrap(), 2);
    assert_eq!(service.files("incoming").len(), 1);
    let mut left = service.files("images");
    left.sort();
    let mut expected = vec![kept[0].clone(), "cd".repeat(32)];
    expected.sort();
    assert_eq!(left, expected);
}

#[tokio::test]
async fn upload_that_would_fill_the_disk_is_refused_before_it_is_read() {
    let service = Service::with(|configuration| configuration.disk_reserve_bytes = u64::MAX / 2).await;
    service.upload("image/jpeg", jpeg(0)).await.problem(507);
    assert_nothing_kept(&service);
    let ready = service.get("/health/ready").await;
    assert_eq!((ready.status.as_u16(), &ready.json()["not_ready"]["disk"]), (503, &"is full".into()));
}
