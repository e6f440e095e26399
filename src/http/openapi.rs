//! The contract as a document, and as pages to read and try.

use std::sync::Arc;

use axum::Extension;
use axum::http::header;
use axum::response::IntoResponse;
use utoipa::openapi::security::{ApiKey, ApiKeyValue, Http, HttpAuthScheme, SecurityScheme};
use utoipa::{Modify, OpenApi, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use utoipa_swagger_ui::{Config, SwaggerUi};

use super::state::AppState;

/// Where the document is.
const DOCUMENT: &str = "/api/v1/openapi.json";

#[derive(OpenApi)]
#[openapi(
    info(
        title = "Gable",
        description = "Exterior orientation of single aerial images from roof lines of buildings and small pictures of \
                       the ground, with a verdict on its own answer.\n\nErrors are `application/problem+json`. Lists are paged: give `next_cursor` as \
                       `cursor` to get on. A `POST` with an `Idempotency-Key` that is sent again with the same body \
                       gives the first answer again. Ids are UUIDv7, times RFC 3339 in UTC.",
    ),
    modifiers(&Keys),
    security(("key" = []), ("session" = [])),
    tags(
        (name = "cameras", description = "Interior orientations."),
        (name = "images", description = "Aerial images."),
        (name = "control points", description = "Buildings whose roof edges are known."),
        (name = "control scenes", description = "Small georeferenced pictures of the ground."),
        (name = "interior orientations", description = "How films lie in their scans, from fiducial marks."),
        (name = "orientations", description = "Where images were taken, with a verdict on each answer."),
        (name = "diagnosis", description = "What the verdicts are learned from, and which classifier decides."),
        (name = "webhooks", description = "What was told of orientations that have ended."),
        (name = "access", description = "Who may do what, and who has done what."),
        (name = "service", description = "Health, figures, this document."),
    ),
)]
struct Document;

struct Keys;

impl Modify for Keys {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let mut scheme = Http::new(HttpAuthScheme::Bearer);
        scheme.description = Some(String::from("A key made by `gable key new`."));
        let session = "Set by `POST /session`; `gable` where no TLS is in front of the service.";
        let session = SecurityScheme::ApiKey(ApiKey::Cookie(ApiKeyValue::with_description("__Host-gable", session)));
        let components = document.components.get_or_insert_default();
        components.add_security_scheme("key", SecurityScheme::Http(scheme));
        components.add_security_scheme("session", session);
    }
}

/// A router that begins with what is said of the contract as a whole.
pub fn base() -> OpenApiRouter<AppState> {
    OpenApiRouter::with_openapi(Document::openapi())
}

/// The routes of the document.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(document))
}

/// Bytes as they are, those of a picture: to clients that are made from the document a file, not a list of numbers.
#[derive(ToSchema)]
#[schema(value_type = String, format = Binary)]
#[expect(dead_code, reason = "only describes bodies")]
pub(super) struct Binary(Vec<u8>);

/// The text of the document, shared with its handler.
#[derive(Clone)]
pub struct Text(pub Arc<str>);

/// This document
#[utoipa::path(get, path = "/openapi.json", operation_id = "show_contract", tag = "service", security(()),
    responses((status = 200, description = "OpenAPI 3.1", body = serde_json::Value)))]
async fn document(Extension(Text(text)): Extension<Text>) -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], text.to_string())
}

/// The pages: Swagger UI, out of the binary.
pub fn pages() -> axum::Router<AppState> {
    SwaggerUi::new("/docs").config(Config::from(DOCUMENT).try_it_out_enabled(true).persist_authorization(false)).into()
}
