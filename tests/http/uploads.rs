//! Uploads that can be resumed: what is acknowledged is there, and nothing else.

use axum::body::{Body, Bytes};
use axum::http::{Method, Request};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use futures_util::StreamExt as _;
use sha2::{Digest as _, Sha256};
use tower::ServiceExt as _;

use crate::orientations::{Working, quick};
use crate::support::{Answer, Service, jpeg, png};

const PIECE: &str = "application/offset+octet-stream";

async fn ask(service: &Service, method: Method, path: &str, headers: &[(&str, &str)], body: impl Into<Body>) -> Answer {
    let mut request = Request::builder().method(method).uri(path).header("tus-resumable", "1.0.0");
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    service.send(request.body(body.into()).unwrap()).await
}

async fn begin(service: &Service, length: usize, metadata: &str) -> String {
    let headers = [("upload-length", &*length.to_string()), ("upload-metadata", metadata)];
    let made = ask(service, Method::POST, "/api/v1/uploads", &headers, Body::empty()).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    assert_eq!(
        (&made.headers["tus-resumable"], &made.headers["upload-offset"]),
        (&"1.0.0".parse().unwrap(), &"0".parse().unwrap())
    );
    made.headers["location"].to_str().unwrap().to_owned()
}

async fn patch(service: &Service, upload: &str, offset: usize, body: impl Into<Body>) -> Answer {
    let headers = [("upload-offset", &*offset.to_string()), ("content-type", PIECE)];
    ask(service, Method::PATCH, upload, &headers, body).await
}

async fn offset(service: &Service, upload: &str) -> usize {
    let answer = ask(service, Method::HEAD, upload, &[], Body::empty()).await;
    assert_eq!(answer.status, 200);
    assert_eq!(answer.headers["cache-control"], "no-store");
    answer.headers["upload-offset"].to_str().unwrap().parse().unwrap()
}

#[tokio::test]
async fn a_file_comes_in_pieces_and_is_an_image() {
    let service = Service::new().await;
    let file = jpeg(0);
    let upload = begin(&service, file.len(), "filename YS5qcGc=,filetype aW1hZ2UvanBlZw==, odd").await;
    assert_eq!(offset(&service, &upload).await, 0);
    for start in (0..file.len()).step_by(300) {
        let piece = file[start..file.len().min(start + 300)].to_vec();
        let end = start + piece.len();
        let answer = patch(&service, &upload, start, piece).await;
        assert_eq!(answer.status, 204, "{:?}", answer.body);
        assert_eq!(answer.headers["upload-offset"], end.to_string().as_str());
        assert!(answer.headers["upload-expires"].to_str().unwrap().ends_with("GMT"));
        assert_eq!(answer.headers.contains_key("gable-image"), end == file.len());
    }
    let shown = service.get(&upload).await.json();
    assert_eq!((&shown["filename"], shown["received_bytes"].as_u64()), (&"a.jpg".into(), Some(file.len() as u64)));
    let image = service.get(&format!("/api/v1/images/{}", shown["image"].as_str().unwrap())).await.json();
    assert_eq!(image["sha256"], gable::store::images::hexadecimal(&Sha256::digest(&file)).as_str());
    assert_eq!(image["name"], "a.jpg");
    assert_eq!(service.files("incoming"), Vec::<String>::new());
    // the answer to the last piece may be lost: it can be asked for again
    assert_eq!(offset(&service, &upload).await, file.len());
    let again = patch(&service, &upload, file.len(), "").await;
    assert_eq!(
        (again.status.as_u16(), &again.headers["gable-image"]),
        (204, &shown["image"].as_str().unwrap().parse().unwrap())
    );
    assert_eq!(service.upload("image/jpeg", file).await.json()["id"], shown["image"]);
    assert_eq!(ask(&service, Method::DELETE, &upload, &[], Body::empty()).await.status, 204);
    service.get(&upload).await.problem(404);
}

#[tokio::test]
async fn the_first_piece_may_come_with_the_beginning() {
    let service = Service::new().await;
    let file = png(0);
    let length = file.len().to_string();
    let headers = [("upload-length", length.as_str()), ("content-type", PIECE)];
    let half = ask(&service, Method::POST, "/api/v1/uploads", &headers, file[..100].to_vec()).await;
    assert_eq!((half.status.as_u16(), &half.headers["upload-offset"]), (201, &"100".parse().unwrap()));
    let whole = ask(&service, Method::POST, "/api/v1/uploads", &headers, file.clone()).await;
    assert_eq!(whole.headers["upload-offset"], length.as_str());
    assert!(
        whole.headers.contains_key("gable-image") && whole.headers["location"].to_str().unwrap().contains("/uploads/")
    );
    let options = ask(&service, Method::OPTIONS, "/api/v1/uploads", &[], Body::empty()).await;
    assert_eq!((options.status.as_u16(), &options.headers["tus-version"]), (204, &"1.0.0".parse().unwrap()));
    assert!(options.headers["tus-extension"].to_str().unwrap().contains("creation-with-upload"));
}

#[tokio::test]
async fn what_came_before_the_connection_broke_is_kept() {
    let service = Service::new().await;
    let file = jpeg(0);
    let upload = begin(&service, file.len(), "").await;
    let parts = [Ok(Bytes::copy_from_slice(&file[..200])), Err(std::io::Error::other("gone"))];
    patch(&service, &upload, 0, Body::from_stream(futures_util::stream::iter(parts))).await.problem(400);
    assert_eq!(offset(&service, &upload).await, 200);
    // a sweep, as at a start, leaves it
    assert_eq!(service.state.store.sweep_uploads().await.unwrap(), 0);
    assert_eq!(patch(&service, &upload, 200, file[200..].to_vec()).await.status, 204);
    assert_eq!(service.files("images").len(), 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn one_writes_at_a_time() {
    let service = Service::new().await;
    let file = jpeg(0);
    let upload = begin(&service, file.len(), "").await;
    let first = futures_util::stream::iter([Ok::<_, std::io::Error>(Bytes::copy_from_slice(&file[..10]))]);
    let endless = Body::from_stream(first.chain(futures_util::stream::pending()));
    let slow = Request::patch(&upload).header("tus-resumable", "1.0.0").header("upload-offset", "0");
    let slow = slow.header("content-type", PIECE).header("host", "localhost").body(endless).unwrap();
    let app = service.app.clone();
    let under_way = tokio::spawn(app.oneshot(slow));
    tokio::time::sleep(std::time::Duration::from_millis(200)).await;
    let locked = patch(&service, &upload, 0, file.clone()).await;
    locked.problem(423);
    assert_eq!(locked.headers["tus-resumable"], "1.0.0");
    ask(&service, Method::DELETE, &upload, &[], Body::empty()).await.problem(423);
    assert_eq!(offset(&service, &upload).await, 0);
    under_way.abort();
}

#[tokio::test]
async fn each_fault_has_its_status() {
    let service = Service::with(|configuration| configuration.upload_max_bytes = 5000).await;
    let file = png(0);
    let upload = begin(&service, file.len(), "").await;
    let post = async |headers: &[(&str, &str)]| ask(&service, Method::POST, "/api/v1/uploads", headers, "").await;
    post(&[]).await.problem(400);
    post(&[("upload-length", "-1")]).await.problem(400);
    post(&[("upload-length", "1e3")]).await.problem(400);
    post(&[("upload-length", "0")]).await.problem(422);
    post(&[("upload-length", "5001")]).await.problem(413);
    post(&[("upload-length", "99999999999999999999")]).await.problem(400);
    post(&[("upload-length", "10"), ("upload-metadata", "filename ???")]).await.problem(400);
    post(&[("upload-length", "10"), ("upload-metadata", "sha256 YWJj")]).await.problem(422);
    post(&[("upload-length", "10"), ("upload-metadata", "block YWJj")]).await.problem(422);
    post(&[("upload-length", "10"), ("upload-checksum", "md5 YWJj")]).await.problem(400);
    patch(&service, &upload, 1, file.clone()).await.problem(409);
    patch(&service, &upload, 0, [file.clone(), vec![0]].concat()).await.problem(413);
    ask(&service, Method::PATCH, &upload, &[("upload-offset", "0")], "").await.problem(415);
    ask(&service, Method::PATCH, &upload, &[("content-type", PIECE)], "").await.problem(400);
    let nobody = "/api/v1/uploads/01a20225-f91a-7133-9892-18bd6449110e";
    patch(&service, nobody, 0, file.clone()).await.problem(404);
    let old = service.send(Request::patch(&upload).header("tus-resumable", "0.2.2").body(Body::empty()).unwrap()).await;
    old.problem(412);
    assert_eq!(offset(&service, &upload).await, 0);
    assert_eq!(patch(&service, &upload, 0, file).await.status, 204);
}

#[tokio::test]
async fn a_piece_with_another_checksum_is_dropped() {
    let service = Service::new().await;
    let file = png(0);
    let upload = begin(&service, file.len(), "").await;
    let sent = async |start: usize, declared: &[u8], piece: &[u8]| {
        let checksum = format!("sha256 {}", STANDARD.encode(Sha256::digest(declared)));
        let offset = start.to_string();
        let headers = [("upload-offset", &*offset), ("content-type", PIECE), ("upload-checksum", &*checksum)];
        ask(&service, Method::PATCH, &upload, &headers, piece.to_vec()).await
    };
    assert_eq!(sent(0, &file[..90], &file[..90]).await.status, 204);
    sent(90, b"other", &file[90..]).await.problem(460);
    assert_eq!(offset(&service, &upload).await, 90);
    assert_eq!(sent(90, &file[90..], &file[90..]).await.status, 204);
    // that of the whole file: it is dropped, as it would never fit
    let whole = format!("sha256 {}", STANDARD.encode("ab".repeat(32)));
    let upload = begin(&service, file.len(), &whole).await;
    patch(&service, &upload, 0, file).await.problem(460);
    service.get(&upload).await.problem(404);
    let upload = begin(&service, 10, "").await;
    patch(&service, &upload, 0, "no picture").await.problem(415);
    service.get(&upload).await.problem(404);
    assert_eq!(service.files("incoming"), Vec::<String>::new());
}

#[tokio::test]
async fn an_upload_that_nobody_goes_on_with_expires() {
    let service = Service::with(|configuration| configuration.upload_kept_s = 1).await;
    let upload = begin(&service, 100, "").await;
    tokio::time::sleep(std::time::Duration::from_millis(1100)).await;
    patch(&service, &upload, 0, "abc").await.problem(410);
    let hours = chrono::TimeDelta::hours(2);
    let store = &service.state.store;
    let swept = gable::jobs::retention::sweep(store, service.state.retention(), gable::store::now() + hours).await;
    assert_eq!(swept.unwrap().uploads, 1);
    assert_eq!(service.files("incoming"), Vec::<String>::new());
    service.get(&upload).await.problem(404);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_for_a_block_is_oriented() {
    let working = Working::with(quick()).await;
    let list = Request::post("/api/v1/blocks?camera=camera").header("content-type", "text/plain");
    let made = working.service.send(list.body(Body::from("a.png 16.6 52.7 400\n")).unwrap()).await;
    let block = made.json()["id"].as_str().unwrap().to_owned();
    let metadata = |name: &str| format!("filename {},block {}", STANDARD.encode(name), STANDARD.encode(&block));
    let headers = [("upload-length", "10"), ("upload-metadata", &*metadata("b.png"))];
    ask(&working.service, Method::POST, "/api/v1/uploads", &headers, "").await.problem(422);
    let file = png(1);
    let upload = begin(&working.service, file.len(), &metadata("a.png")).await;
    assert_eq!(patch(&working.service, &upload, 0, file).await.status, 204);
    let images = working.service.get(&format!("/api/v1/blocks/{block}/images")).await.json();
    let orientation = images["items"][0]["orientation"].as_str().unwrap().to_owned();
    working.until(&orientation, "succeeded").await;
}
