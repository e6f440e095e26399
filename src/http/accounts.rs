//! Accounts of people who log in with a password.

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
use crate::store::accounts::{Account, Change, check_name};
use crate::store::keys::Role;
use crate::store::passwords;

/// The routes of the accounts.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list, create)).routes(routes!(change))
}

/// An account to make.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct AccountRequest {
    /// Unique; 1 to 100 letters, digits, `.`, `_`, `-` and `@`.
    #[schema(example = "anna", min_length = 1, max_length = 100)]
    name: String,
    /// What it allows.
    role: Role,
    /// 12 to 256 characters.
    #[schema(format = Password, min_length = 12, max_length = 256)]
    password: String,
}

/// What of an account is to change; what is left out stays.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct AccountChange {
    /// What it allows.
    role: Option<Role>,
    /// Whether nobody can log in with it. Who is logged in is logged out.
    disabled: Option<bool>,
    /// 12 to 256 characters. Who is logged in is logged out.
    #[schema(format = Password, min_length = 12, max_length = 256)]
    password: Option<String>,
}

/// An account.
#[derive(Debug, Serialize, ToSchema)]
struct AccountAnswer {
    /// UUIDv7.
    id: Uuid,
    /// For logging in.
    name: String,
    /// What it allows.
    role: Role,
    /// When it was made.
    created_at: DateTime<Utc>,
    /// Since when nobody can log in with it.
    disabled_at: Option<DateTime<Utc>>,
}

impl From<Account> for AccountAnswer {
    fn from(account: Account) -> Self {
        let Account { id, name, role, created_at, disabled_at } = account;
        Self { id, name, role, created_at, disabled_at }
    }
}

/// Make an account
#[utoipa::path(
    post, path = "/accounts", operation_id = "make_account", tag = "access", request_body = AccountRequest,
    responses(
        (status = 201, description = "Made", body = AccountAnswer),
        (status = 409, description = "The name is taken", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A field makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn create(State(state): State<AppState>, Json(request): Json<AccountRequest>) -> Result<Response, Problem> {
    check_name(&request.name).map_err(|detail| Problem::invalid_field("/name", detail))?;
    let password = passwords::hash(request.password).await?;
    let account = state.store.add_account(&request.name, request.role, &password).await?;
    let account = account.ok_or_else(|| Problem::conflict("There is an account with this name."))?;
    let location = format!("/api/v1/accounts/{}", account.id);
    let answer = axum::Json(AccountAnswer::from(account));
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], answer).into_response())
}

/// List the accounts
///
/// The newest first.
#[utoipa::path(
    get, path = "/accounts", operation_id = "list_accounts", tag = "access", params(PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<AccountAnswer>),
        (status = "default", description = "Any problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<AccountAnswer>>, Problem> {
    let wanted = query.wanted()?;
    let fetched = state.store.accounts(wanted.before, wanted.fetch()).await?;
    Ok(axum::Json(wanted.page(fetched, |account| account.id, AccountAnswer::from)))
}

/// Change an account
///
/// Its role, whether it is disabled, its password; at once, also for who is logged in.
#[utoipa::path(
    patch, path = "/accounts/{id}", operation_id = "change_account", tag = "access", request_body = AccountChange,
    params(("id" = Uuid, Path, description = "The account's id")),
    responses(
        (status = 200, description = "Changed", body = AccountAnswer),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A field makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn change(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Json(request): Json<AccountChange>,
) -> Result<axum::Json<AccountAnswer>, Problem> {
    let password = match request.password {
        Some(password) => Some(passwords::hash(password).await?),
        None => None,
    };
    let change = Change { role: request.role, disabled: request.disabled, password };
    let account = state.store.change_account(id, &change).await?;
    let account = account.ok_or_else(|| Problem::not_found("There is no account with this id."))?;
    Ok(axum::Json(account.into()))
}
