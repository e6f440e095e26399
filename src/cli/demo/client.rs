//! A client of the service in the same process. It asks the router that the service answers its sockets with.

use crate::service::Service;
use crate::simulation::Scene;
use anyhow::{Context as _, bail};
use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::Request;
use axum::http::request::Builder;
use http_body_util::BodyExt as _;
use serde::Deserialize;
use serde_json::{Value, json};
use tower::ServiceExt as _;
use uuid::Uuid;

use super::comparison::{Found, TOLERANCE_GSD};

pub(super) struct Client {
    app: Router,
}

/// An orientation, as far as it is of interest here.
#[derive(Deserialize)]
pub(super) struct Answer {
    pub(super) id: Uuid,
    status: String,
    error: Option<Value>,
    pub(super) result: Option<Found>,
}

const PATIENCE_S: u32 = 300;

impl Client {
    pub(super) fn of(service: &Service) -> anyhow::Result<Self> {
        Ok(Self { app: crate::http::router(service.state().clone())? })
    }

    /// The camera's name.
    pub(super) async fn add_camera(&self, scene: &Scene) -> anyhow::Result<String> {
        let camera = self.send(post_json("/cameras"), scene.camera_body().to_string()).await?;
        text(&camera, "name")
    }

    /// How many there were.
    pub(super) async fn import_control_points(&self, scene: &Scene) -> anyhow::Result<u64> {
        let crs = scene.crs().replace('+', "%2B").replace(' ', "%20");
        let request =
            Request::post(path(&format!("/control-points?crs={crs}"))).header("content-type", "application/geo+json");
        let report = self.send(request, scene.control_points_body().to_string()).await?;
        report["imported"].as_u64().context("the service does not say how many control points it has imported")
    }

    /// The image's id.
    pub(super) async fn upload(&self, png: Vec<u8>) -> anyhow::Result<String> {
        let image = self.send(Request::post(path("/images")).header("content-type", "image/png"), png).await?;
        text(&image, "id")
    }

    /// Waits for the end.
    pub(super) async fn orient(&self, scene: &Scene, camera: &str, image: &str) -> anyhow::Result<Answer> {
        let body = json!({
            "image": image,
            "camera": camera,
            "approximation": scene.approximation_body(),
            "tolerance_gsd": TOLERANCE_GSD,
            "output_crs": scene.crs(),
        });
        let request = post_json("/orientations").header("prefer", format!("wait={PATIENCE_S}"));
        let answer: Answer = serde_json::from_value(self.send(request, body.to_string()).await?)?;
        if answer.status != "succeeded" {
            let why = answer.error.map_or_else(String::new, |error| format!(": {error}"));
            bail!("the orientation has not succeeded but is {}{why}", answer.status);
        }
        Ok(answer)
    }

    /// A JPEG.
    pub(super) async fn overlay(&self, id: Uuid) -> anyhow::Result<Bytes> {
        self.ask(Request::get(path(&format!("/orientations/{id}/overlay"))), Body::empty()).await
    }

    async fn send(&self, request: Builder, body: impl Into<Body>) -> anyhow::Result<Value> {
        Ok(serde_json::from_slice(&self.ask(request, body.into()).await?)?)
    }

    async fn ask(&self, request: Builder, body: Body) -> anyhow::Result<Bytes> {
        let request = request.header("host", "localhost").body(body)?;
        let asked = format!("{} {}", request.method(), request.uri().path());
        let response = self.app.clone().oneshot(request).await?;
        let status = response.status();
        let body = response.into_body().collect().await?.to_bytes();
        if !status.is_success() {
            bail!("{asked} is answered {status}: {}", String::from_utf8_lossy(&body));
        }
        Ok(body)
    }
}

fn path(resource: &str) -> String {
    format!("/api/v1{resource}")
}

fn post_json(resource: &str) -> Builder {
    Request::post(path(resource)).header("content-type", "application/json")
}

fn text(answer: &Value, name: &str) -> anyhow::Result<String> {
    Ok(answer[name].as_str().with_context(|| format!("the service's answer has no {name}: {answer}"))?.to_owned())
}
