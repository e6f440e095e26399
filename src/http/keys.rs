//! Keys: made, shown, revoked.

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::extract::{Json, Path, Query};
use super::page::{Page, PageQuery};
use super::problem::Problem;
use super::state::AppState;
use crate::store::keys::{Key, Role, random_secret};
use crate::store::now;

/// Most characters of a name.
const NAME_MAX: usize = 200;

/// The routes of the keys.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list, create)).routes(routes!(revoke))
}

/// A key to make.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct KeyRequest {
    /// Whose it is, or what for; at most 200 characters.
    #[serde(default)]
    #[schema(max_length = 200)]
    name: String,
    /// What it allows.
    role: Role,
    /// When it ends by itself; never if left out.
    expires_at: Option<DateTime<Utc>>,
}

/// A key, without its secret.
#[derive(Debug, Serialize, ToSchema)]
struct KeyAnswer {
    /// UUIDv7.
    id: Uuid,
    /// Whose it is, or what for.
    name: String,
    /// What it allows.
    role: Role,
    /// When it was made.
    created_at: DateTime<Utc>,
    /// When it ends by itself.
    expires_at: Option<DateTime<Utc>>,
    /// Since when it is not accepted any more.
    revoked_at: Option<DateTime<Utc>>,
    /// When it was last used, to the minute.
    last_used_at: Option<DateTime<Utc>>,
}

impl From<Key> for KeyAnswer {
    fn from(key: Key) -> Self {
        let Key { id, name, role, created_at, expires_at, revoked_at, last_used_at } = key;
        Self { id, name, role, created_at, expires_at, revoked_at, last_used_at }
    }
}

/// A key that was made, with its secret.
#[derive(Debug, Serialize, ToSchema)]
struct NewKeyAnswer {
    /// What to send as `Authorization: Bearer …`. It is shown only now.
    secret: String,
    /// The key.
    #[serde(flatten)]
    key: KeyAnswer,
}

/// Make a key
///
/// Its secret is shown in this answer and never again.
#[utoipa::path(
    post, path = "/keys", operation_id = "make_key", tag = "access", request_body = KeyRequest,
    responses(
        (status = 201, description = "Made", body = NewKeyAnswer),
        (status = 422, description = "A field makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(State(state): State<AppState>, Json(request): Json<KeyRequest>) -> Result<Response, Problem> {
    if request.name.chars().count() > NAME_MAX {
        return Err(Problem::invalid_field("/name", format!("name has more than {NAME_MAX} characters")));
    }
    if request.expires_at.is_some_and(|at| at <= now()) {
        return Err(Problem::invalid_field("/expires_at", "expires_at must be in the future"));
    }
    let secret = random_secret().map_err(|error| Problem::internal(&error))?;
    let key = state.store.add_key(&secret, &request.name, request.role, request.expires_at).await?;
    let location = format!("/api/v1/keys/{}", key.id);
    let answer = NewKeyAnswer { secret, key: key.into() };
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], axum::Json(answer)).into_response())
}

/// List the keys
///
/// The newest first, without their secrets, which are not stored.
#[utoipa::path(
    get, path = "/keys", operation_id = "list_keys", tag = "access", params(PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<KeyAnswer>),
        (status = "default", description = "Any problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<KeyAnswer>>, Problem> {
    let wanted = query.wanted()?;
    let fetched = state.store.keys(wanted.before, wanted.fetch()).await?;
    Ok(axum::Json(wanted.page(fetched, |key| key.id, KeyAnswer::from)))
}

/// Revoke a key
///
/// It lets nobody in any more, from now on.
#[utoipa::path(
    delete, path = "/keys/{id}", operation_id = "revoke_key", tag = "access",
    params(("id" = Uuid, Path, description = "The key's id")),
    responses(
        (status = 204, description = "Revoked"),
        (status = 404, description = "There is none that is valid", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn revoke(State(state): State<AppState>, Path(id): Path<Uuid>) -> Result<StatusCode, Problem> {
    match state.store.revoke_key(id).await? {
        true => Ok(StatusCode::NO_CONTENT),
        false => Err(Problem::not_found("There is no valid key with this id.")),
    }
}
