//! A service in a temporary folder, and short ways to ask it.

use std::sync::Arc;

use axum::Router;
use axum::body::{Body, Bytes, to_bytes};
use axum::http::{HeaderMap, Method, Request, StatusCode};
use gable::configuration::Configuration;
use gable::http::{AppState, router};
use gable::jobs::Orient;
use gable::store::keys::{Key, Role, random_secret};
use serde_json::{Value, json};
use tempfile::TempDir;
use tower::ServiceExt as _;

use crate::{Store, scratch};

pub(crate) struct Service {
    pub(crate) app: Router,
    pub(crate) state: AppState,
    _folder: TempDir,
}

pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
}

impl Answer {
    #[track_caller]
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|_| panic!("not JSON: {:?}", self.body))
    }

    /// The pointers of a problem, after checking that it is one and fits its status.
    #[track_caller]
    pub(crate) fn problem(&self, status: u16) -> Vec<String> {
        assert_eq!(self.status.as_u16(), status, "{:?}", self.body);
        assert_eq!(self.headers["content-type"], "application/problem+json");
        let problem = self.json();
        assert_eq!(problem["status"], status);
        for text in ["type", "title", "detail", "instance"] {
            assert!(problem[text].as_str().is_some_and(|text| !text.is_empty()), "no {text}: {problem}");
        }
        assert_eq!(problem["instance"], self.headers["x-request-id"].to_str().unwrap());
        let errors = problem["errors"].as_array().cloned().unwrap_or_default();
        errors.iter().map(|error| error["pointer"].as_str().unwrap().to_owned()).collect()
    }
}

impl Service {
    pub(crate) async fn new() -> Self {
        Self::with(|_| ()).await
    }

    pub(crate) async fn with(change: impl FnOnce(&mut Configuration)) -> Self {
        Self::with_pipeline(change, Arc::new(gable::pipeline::orient)).await
    }

    /// A service that orients images by another pipeline, once its jobs are begun.
    pub(crate) async fn with_pipeline(change: impl FnOnce(&mut Configuration), orient: Orient) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut configuration = Configuration::default();
        folder.path().clone_into(&mut configuration.data);
        change(&mut configuration);
        configuration.database_url = scratch::database_url().await;
        let store = Store::connect(&configuration.place()).await.unwrap();
        let state = AppState::with_pipeline(store, configuration, orient);
        Self { app: router(state.clone()).unwrap(), state, _folder: folder }
    }

    /// The store, opened once more.
    pub(crate) async fn reopened(&self) -> Store {
        Store::connect(&self.state.configuration.place()).await.unwrap()
    }

    pub(crate) async fn key(&self, role: Role) -> (String, Key) {
        let secret = random_secret().unwrap();
        let key = self.state.store.add_key(&secret, "test", role, None).await.unwrap();
        (secret, key)
    }

    /// Sends a request as it is, as a program on this machine would.
    pub(crate) async fn send(&self, mut request: Request<Body>) -> Answer {
        request.headers_mut().entry("host").or_insert("127.0.0.1:8080".parse().unwrap());
        let response = self.app.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        Answer { status: parts.status, headers: parts.headers, body: to_bytes(body, usize::MAX).await.unwrap() }
    }

    pub(crate) async fn get(&self, path: &str) -> Answer {
        self.send(Request::get(path).body(Body::empty()).unwrap()).await
    }

    pub(crate) async fn post(&self, path: &str, body: &Value) -> Answer {
        self.send(json_post(path, body)).await
    }

    pub(crate) async fn delete(&self, path: &str) -> Answer {
        self.send(Request::delete(path).body(Body::empty()).unwrap()).await
    }

    pub(crate) async fn upload(&self, media_type: &str, body: impl Into<Body>) -> Answer {
        self.send(upload(media_type, body)).await
    }

    /// The files in a part of the data folder.
    pub(crate) fn files(&self, part: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.state.store.folder().join(part)).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }
}

pub(crate) fn json_post(path: &str, body: &Value) -> Request<Body> {
    let request = Request::post(path).header("content-type", "application/json");
    request.body(Body::from(body.to_string())).unwrap()
}

pub(crate) fn upload(media_type: &str, body: impl Into<Body>) -> Request<Body> {
    Request::post("/api/v1/images").header("content-type", media_type).body(body.into()).unwrap()
}

pub(crate) fn request(method: &Method, path: &str, key: Option<&str>) -> Request<Body> {
    let mut request = Request::builder().method(method).uri(path);
    if let Some(key) = key {
        request = request.header("authorization", format!("Bearer {key}"));
    }
    request.body(Body::empty()).unwrap()
}

pub(crate) fn camera(name: &str) -> Value {
    json!({
        "name": name,
        "image_size_px": [4000, 3000],
        "principal_distance_px": 2890.0,
        "principal_point_px": [2000.0, 1500.0],
        "distortion": {"model": "brown", "k1": -0.01, "k2": 0.001},
    })
}

/// A small photograph; another `shade` makes another file.
pub(crate) fn jpeg(shade: u8) -> Vec<u8> {
    encoded(shade, image::ImageFormat::Jpeg)
}

pub(crate) fn png(shade: u8) -> Vec<u8> {
    encoded(shade, image::ImageFormat::Png)
}

fn encoded(shade: u8, format: image::ImageFormat) -> Vec<u8> {
    let picture = image::GrayImage::from_fn(64, 48, |x, y| image::Luma([(x as u8 ^ y as u8).wrapping_add(shade)]));
    let mut file = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut file, format).unwrap();
    file.into_inner()
}
