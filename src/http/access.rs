//! Who may call what.
//!
//! [`ROUTES`] is the one table of it, and what is not in the table is refused. A caller is known by a key in the header
//! `Authorization: Bearer …`. As long as no key was ever made, a service that listens on the loopback interface takes
//! every caller for an admin who sits at this machine: the request must name a loopback host, and must come neither
//! from the page of another site nor through a proxy.

use std::net::IpAddr;

use axum::extract::{FromRequestParts, MatchedPath, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method, header};
use axum::middleware::Next;
use axum::response::Response;

use super::problem::Problem;
use super::state::AppState;
use crate::store::keys::Role;

/// What a route asks of its caller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Nothing.
    Public,
    /// At least this role.
    AtLeast(Role),
}

const PUBLIC: Access = Access::Public;
const READER: Access = Access::AtLeast(Role::Reader);
const OPERATOR: Access = Access::AtLeast(Role::Operator);
const ADMIN: Access = Access::AtLeast(Role::Admin);

/// Every route of the service with what it asks of its caller.
pub const ROUTES: &[(Method, &str, Access)] = &[
    (Method::GET, "/health/live", PUBLIC),
    (Method::GET, "/health/ready", PUBLIC),
    (Method::GET, "/metrics", READER),
    (Method::GET, "/docs", PUBLIC),
    (Method::GET, "/docs/", PUBLIC),
    (Method::GET, "/docs/{*rest}", PUBLIC),
    (Method::GET, "/api/v1/openapi.json", PUBLIC),
    (Method::GET, "/api/v1/cameras", READER),
    (Method::POST, "/api/v1/cameras", OPERATOR),
    (Method::GET, "/api/v1/cameras/{id}", READER),
    (Method::DELETE, "/api/v1/cameras/{id}", OPERATOR),
    (Method::GET, "/api/v1/mark-templates", READER),
    (Method::POST, "/api/v1/mark-templates", OPERATOR),
    (Method::GET, "/api/v1/mark-templates/{id}", READER),
    (Method::DELETE, "/api/v1/mark-templates/{id}", OPERATOR),
    (Method::GET, "/api/v1/mark-templates/{id}/picture", READER),
    (Method::GET, "/api/v1/images", READER),
    (Method::POST, "/api/v1/images", OPERATOR),
    (Method::GET, "/api/v1/images/{id}", READER),
    (Method::GET, "/api/v1/control-points", READER),
    (Method::POST, "/api/v1/control-points", OPERATOR),
    (Method::GET, "/api/v1/control-points/{name}", READER),
    (Method::GET, "/api/v1/control-points/{name}/health", READER),
    (Method::GET, "/api/v1/control-scenes", READER),
    (Method::POST, "/api/v1/control-scenes", OPERATOR),
    (Method::GET, "/api/v1/control-scenes/{id}", READER),
    (Method::DELETE, "/api/v1/control-scenes/{id}", OPERATOR),
    (Method::GET, "/api/v1/control-scenes/{id}/picture", READER),
    (Method::GET, "/api/v1/references", READER),
    (Method::POST, "/api/v1/references", OPERATOR),
    (Method::DELETE, "/api/v1/references/{image}", OPERATOR),
    (Method::GET, "/api/v1/classifiers", READER),
    (Method::POST, "/api/v1/classifiers", OPERATOR),
    (Method::POST, "/api/v1/classifiers/rollback", ADMIN),
    (Method::GET, "/api/v1/classifiers/{id}", READER),
    (Method::POST, "/api/v1/classifiers/{id}/activate", ADMIN),
    (Method::GET, "/api/v1/classifiers/{id}/{file}", READER),
    (Method::GET, "/api/v1/interior-orientations", READER),
    (Method::POST, "/api/v1/interior-orientations", OPERATOR),
    (Method::GET, "/api/v1/interior-orientations/{id}", READER),
    (Method::DELETE, "/api/v1/interior-orientations/{id}", OPERATOR),
    (Method::GET, "/api/v1/interior-orientations/{id}/residuals.svg", READER),
    (Method::GET, "/api/v1/interior-orientations/{id}/marks/{name}", READER),
    (Method::GET, "/api/v1/orientations", READER),
    (Method::POST, "/api/v1/orientations", OPERATOR),
    (Method::GET, "/api/v1/orientations/{id}", READER),
    (Method::DELETE, "/api/v1/orientations/{id}", OPERATOR),
    (Method::GET, "/api/v1/orientations/{id}/events", READER),
    (Method::GET, "/api/v1/orientations/{id}/overlay", READER),
    (Method::GET, "/api/v1/webhooks", OPERATOR),
    (Method::POST, "/api/v1/webhooks/{id}/resend", OPERATOR),
];

/// What a route asks of its caller; `None` if it is not in the table.
#[must_use]
pub fn access(method: &Method, path: &str) -> Option<Access> {
    let method = if method == Method::HEAD { &Method::GET } else { method };
    ROUTES.iter().find(|(m, p, _)| m == method && *p == path).map(|(_, _, access)| *access)
}

/// Who is calling. Handlers of routes that are not public may ask for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Caller {
    /// The id of the key, or `loopback`.
    pub credential: String,
    /// What it allows.
    pub role: Role,
}

impl<S: Send + Sync> FromRequestParts<S> for Caller {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Problem> {
        parts.extensions.get().cloned().ok_or_else(|| Problem::unauthorized("This needs a key."))
    }
}

/// Lets a request through to its route, or refuses it.
///
/// # Errors
/// 401 without a valid key, 403 where the role is too low or the route is not in the table.
pub async fn guard(
    State(state): State<AppState>,
    path: MatchedPath,
    mut request: Request,
    next: Next,
) -> Result<Response, Problem> {
    match access(request.method(), path.as_str()) {
        Some(Access::Public) => {}
        Some(Access::AtLeast(role)) => {
            let caller = identify(&state, request.headers()).await?;
            if caller.role < role {
                let detail = format!("The key has the role {}; this needs {role}.", caller.role);
                return Err(Problem::forbidden(detail));
            }
            request.extensions_mut().insert(caller);
        }
        None => {
            tracing::error!(method = %request.method(), path = path.as_str(), "route without access rule");
            return Err(Problem::forbidden("Nobody may call this."));
        }
    }
    Ok(next.run(request).await)
}

async fn identify(state: &AppState, headers: &HeaderMap) -> Result<Caller, Problem> {
    if let Some(authorization) = headers.get(header::AUTHORIZATION) {
        let secret = authorization.to_str().ok().and_then(|text| text.split_once(' '));
        let secret =
            secret.filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer")).map(|(_, secret)| secret.trim());
        let Some(secret) = secret else {
            return Err(Problem::unauthorized("Authorization must be: Bearer <key>"));
        };
        let key = state.store.key(secret).await?;
        let key = key.ok_or_else(|| Problem::unauthorized("This key is not valid, or was revoked."))?;
        return Ok(Caller { credential: key.id.to_string(), role: key.role });
    }
    if !state.listens_on_loopback() || state.any_key().await? {
        return Err(Problem::unauthorized("This needs a key, in the header Authorization: Bearer <key>."));
    }
    if !comes_from_this_machine(headers) {
        let detail = "As long as no key is made, only requests to a loopback host are answered, none from the pages of \
                      other sites or through a proxy. Make a key with `gable key new`.";
        return Err(Problem::forbidden(detail));
    }
    Ok(Caller { credential: String::from("loopback"), role: Role::Admin })
}

/// A page of another site can make a browser call us (`Origin` tells), or give its own name our address (`Host` tells);
/// a proxy can make the whole world look local.
fn comes_from_this_machine(headers: &HeaderMap) -> bool {
    let Some(host) = headers.get(header::HOST).and_then(|host| host.to_str().ok()) else {
        return false;
    };
    let origin_is_ours = match headers.get(header::ORIGIN).map(|origin| origin.to_str()) {
        None => true,
        Some(Ok(origin)) => origin.strip_prefix("http://").is_some_and(|origin| origin.eq_ignore_ascii_case(host)),
        Some(Err(_)) => false,
    };
    let forwarded = ["forwarded", "x-forwarded-for", "x-real-ip", "via"].iter().any(|name| headers.contains_key(*name));
    is_loopback(host) && origin_is_ours && !forwarded
}

fn is_loopback(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}
