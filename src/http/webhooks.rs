//! Webhooks: what was told of orientations that have ended, and what was not.

use axum::extract::State;
use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::extract::{Path, Query};
use super::page::{Page, Wanted};
use super::problem::Problem;
use super::state::AppState;
use crate::store::webhooks::{Delivery, Webhook};

/// The routes of the webhooks.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list)).routes(routes!(resend))
}

/// An event that somebody is to be told.
#[derive(Debug, Serialize, ToSchema)]
struct WebhookAnswer {
    /// Of the event, UUIDv7; the receiver gets it as `webhook-id`, the same in every try.
    id: Uuid,
    /// What has ended.
    orientation: Uuid,
    /// Who is told.
    url: String,
    /// `waiting`, `delivered` or `given_up`.
    status: &'static str,
    /// How often it was tried.
    attempts: u32,
    /// What went wrong in the last try.
    last_error: Option<String>,
    /// When the orientation has ended.
    created_at: DateTime<Utc>,
    /// When the receiver has said that it has it.
    delivered_at: Option<DateTime<Utc>>,
    /// When it was tried for too long.
    given_up_at: Option<DateTime<Utc>>,
}

impl From<Webhook> for WebhookAnswer {
    fn from(webhook: Webhook) -> Self {
        Self {
            status: webhook.delivery().name(),
            id: webhook.id,
            orientation: webhook.orientation_id,
            url: webhook.url,
            attempts: webhook.attempts,
            last_error: webhook.last_error,
            created_at: webhook.created_at,
            delivered_at: webhook.delivered_at,
            given_up_at: webhook.given_up_at,
        }
    }
}

/// Which webhooks are wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ListQuery {
    /// `waiting`, `delivered` or `given_up`.
    status: Option<String>,
    /// Items on a page, from 1 to 200; 50 if left out.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    cursor: Option<String>,
}

/// List the webhooks
///
/// The newest first. What is `given_up` was tried for a day; it can be sent again.
#[utoipa::path(
    get, path = "/webhooks", operation_id = "list_webhooks", tag = "webhooks", params(ListQuery),
    responses(
        (status = 200, description = "One page", body = Page<WebhookAnswer>),
        (status = 422, description = "A parameter makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<ListQuery>,
) -> Result<axum::Json<Page<WebhookAnswer>>, Problem> {
    let wanted = Wanted::new(query.limit, query.cursor.as_deref())?;
    let delivery = match &query.status {
        None => None,
        Some(name) => Some(Delivery::from_name(name).ok_or_else(|| {
            let names = Delivery::ALL.map(Delivery::name).join(", ");
            Problem::invalid_field("?status", format!("status is {name:?}; it must be one of {names}"))
        })?),
    };
    let fetched = state.store.webhooks(delivery, wanted.before, wanted.fetch()).await?;
    Ok(axum::Json(wanted.page(fetched, |webhook| webhook.id, WebhookAnswer::from)))
}

/// Send a webhook again
///
/// From the beginning, for a day, under the same id; also one that was delivered.
#[utoipa::path(
    post, path = "/webhooks/{id}/resend", operation_id = "resend_webhook", tag = "webhooks",
    params(("id" = Uuid, Path, description = "The id of the event")),
    responses(
        (status = 200, description = "It is sent soon", body = WebhookAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn resend(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<axum::Json<WebhookAnswer>, Problem> {
    let webhook = state.store.resend_webhook(id).await?;
    let webhook = webhook.ok_or_else(|| Problem::not_found("There is no webhook with this id."))?;
    Ok(axum::Json(webhook.into()))
}
