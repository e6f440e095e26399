//! Logging in and out with the name and password of an account. The browser keeps an opaque cookie that scripts cannot
//! read; with TLS in front its name begins with `__Host-`, so that no other host can set it.

use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::access::{Caller, by, comes_from_our_pages};
use super::extract::Json;
use super::problem::Problem;
use super::rate::{self, ClientAddress};
use super::state::AppState;
use crate::store::accounts::check_name;
use crate::store::keys::{Role, random_secret};
use crate::store::passwords::{self, PasswordError};

/// The routes of the session.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(log_in, who_am_i, log_out))
}

/// Who wants to log in.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct LoginRequest {
    /// Of the account.
    name: String,
    /// Of the account.
    #[schema(format = Password)]
    password: String,
}

/// Who is calling.
#[derive(Debug, Serialize, ToSchema)]
struct SessionAnswer {
    /// The id of a key, `account:` and its name, or `loopback`, as in the audit log.
    who: String,
    /// What the caller may do.
    role: Role,
}

/// The cookie of a session, if the request has one.
pub(super) fn cookie(state: &AppState, headers: &HeaderMap) -> Option<String> {
    let lines = headers.get_all(header::COOKIE).iter().filter_map(|line| line.to_str().ok());
    let pairs = lines.flat_map(|line| line.split(';')).filter_map(|pair| pair.trim().split_once('='));
    let name = cookie_name(state);
    pairs.filter(|(given, _)| *given == name).map(|(_, value)| value.to_owned()).next()
}

fn cookie_name(state: &AppState) -> &'static str {
    if state.configuration.cookies_are_secure() { "__Host-gable" } else { "gable" }
}

fn set_cookie(state: &AppState, value: &str, lasts_s: u64) -> Result<[(header::HeaderName, HeaderValue); 1], Problem> {
    let secure = if state.configuration.cookies_are_secure() { "; Secure" } else { "" };
    let name = cookie_name(state);
    let cookie = format!("{name}={value}; Path=/; Max-Age={lasts_s}; HttpOnly; SameSite=Lax{secure}");
    let cookie = HeaderValue::try_from(cookie).map_err(|error| Problem::internal(&error))?;
    Ok([(header::SET_COOKIE, cookie)])
}

/// Log in
///
/// The answer sets a cookie that lets the browser in until it was not used for `session_idle_s`, and for `session_max_s` at
/// the most. A request with it that changes something must come from a page of this service, by `Origin` or
/// `Sec-Fetch-Site`. After 20 failures, of one account or from one address, there is one more try every 3 s.
#[utoipa::path(
    post, path = "/session", operation_id = "log_in", tag = "access", request_body = LoginRequest, security(()),
    responses(
        (status = 200, description = "Logged in", body = SessionAnswer),
        (status = 401, description = "There is no such account, or the password is wrong", body = Problem, content_type = "application/problem+json"),
        (status = 403, description = "It comes from another site", body = Problem, content_type = "application/problem+json"),
        (status = 429, description = "Too many have failed", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn log_in(
    State(state): State<AppState>,
    address: Option<axum::Extension<ClientAddress>>,
    headers: HeaderMap,
    Json(request): Json<LoginRequest>,
) -> Result<Response, Problem> {
    let says_where = headers.contains_key(header::ORIGIN) || headers.contains_key("sec-fetch-site");
    if says_where && !comes_from_our_pages(&state, &headers) {
        return Err(Problem::forbidden("Only a page of this service may log in."));
    }
    let from = address.map(|axum::Extension(address)| format!("address:{}", address.caller()));
    // no name of an account, and it may be long: all such share one bucket
    let name = if check_name(&request.name).is_ok() { request.name.as_str() } else { "?" };
    let callers: Vec<String> = from.into_iter().chain([format!("account:{name}")]).collect();
    for caller in &callers {
        state.failed_logins.take(caller).map_err(|wait| rate::refused("Too many logins have failed.", wait))?;
    }
    let found = state.store.account(name).await?;
    let (account, kept) = found.filter(|(account, _)| account.disabled_at.is_none()).unzip();
    let right = passwords::is_right(kept, request.password).await?;
    let Some(account) = account.filter(|_| right) else {
        // a name that nobody has may be a password that was typed in the wrong field
        let problem = Problem::unauthorized("There is no such account, or the password is wrong.");
        return Ok(by(String::from("nobody"), problem));
    };
    for caller in &callers {
        state.failed_logins.give_back(caller);
    }
    let secret = random_secret().map_err(|error| Problem::internal(&error))?;
    let former = cookie(&state, &headers);
    state.store.begin_session(&secret, account.id, former.as_deref(), state.configuration.sessions_last()).await?;
    let who = format!("account:{}", account.name);
    let answer = SessionAnswer { who: who.clone(), role: account.role };
    let cookie = set_cookie(&state, &secret, state.configuration.session_max_s)?;
    Ok(by(who, (cookie, axum::Json(answer))))
}

/// Who am I?
///
/// By a key or by the cookie of a session.
#[utoipa::path(
    get, path = "/session", operation_id = "who_am_i", tag = "access",
    responses(
        (status = 200, description = "The caller", body = SessionAnswer),
        (status = "default", description = "Any problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn who_am_i(caller: Caller) -> axum::Json<SessionAnswer> {
    axum::Json(SessionAnswer { who: caller.credential, role: caller.role })
}

/// Log out
///
/// The cookie lets nobody in any more. A key stays as it is.
#[utoipa::path(
    delete, path = "/session", operation_id = "log_out", tag = "access",
    responses(
        (status = 204, description = "Logged out"),
        (status = "default", description = "Any problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn log_out(State(state): State<AppState>, headers: HeaderMap) -> Result<Response, Problem> {
    if let Some(cookie) = cookie(&state, &headers) {
        state.store.end_session(&cookie).await?;
    }
    Ok((StatusCode::NO_CONTENT, set_cookie(&state, "", 0)?).into_response())
}

impl From<PasswordError> for Problem {
    fn from(error: PasswordError) -> Self {
        match error {
            PasswordError::Length => Self::invalid_field("/password", error.to_string()),
            PasswordError::Hash { .. } => Self::internal(&error),
        }
    }
}
