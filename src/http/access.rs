//! Who may call what.
//!
//! [`ROUTES`] is the one table of it, and what is not in the table is refused. A caller is known by a key in the header
//! `Authorization: Bearer …`, or by the cookie of a session (`POST /session`). As long as no key or account was ever made, a service that listens on the loopback interface takes
//! every caller for an admin who sits at this machine: the request must name a loopback host, and must come neither
//! from the page of another site nor through a proxy.

mod guard;
mod identify;

use axum::extract::FromRequestParts;
use axum::http::Method;
use axum::http::request::Parts;

pub(super) use guard::by;
pub use guard::guard;
pub(super) use identify::comes_from_our_pages;

use super::problem::Problem;
use crate::store::keys::Role;

/// Who sits at this machine while no key is made yet.
const LOOPBACK: &str = "loopback";
/// Of whom nothing is known.
const NOBODY: &str = "nobody";

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
    // the pages hold nothing by themselves: all that they show comes from the API
    (Method::GET, "/", PUBLIC),
    (Method::GET, "/upload", PUBLIC),
    (Method::GET, "/orientations/{id}", PUBLIC),
    (Method::GET, "/control", PUBLIC),
    (Method::GET, "/diagnosis", PUBLIC),
    (Method::GET, "/diagnosis/{id}", PUBLIC),
    (Method::GET, "/dashboard", PUBLIC),
    (Method::GET, "/login", PUBLIC),
    (Method::GET, "/help", PUBLIC),
    (Method::GET, "/assets/{version}/{*path}", PUBLIC),
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
    (Method::DELETE, "/api/v1/images/{id}", OPERATOR),
    (Method::GET, "/api/v1/images/{id}/tiles/{level}/{column}/{row}", READER),
    (Method::GET, "/api/v1/images/{id}/thumbnail", READER),
    (Method::GET, "/api/v1/images/{id}/window", READER),
    (Method::OPTIONS, "/api/v1/uploads", PUBLIC),
    (Method::POST, "/api/v1/uploads", OPERATOR),
    (Method::HEAD, "/api/v1/uploads/{id}", OPERATOR),
    (Method::GET, "/api/v1/uploads/{id}", OPERATOR),
    (Method::PATCH, "/api/v1/uploads/{id}", OPERATOR),
    (Method::DELETE, "/api/v1/uploads/{id}", OPERATOR),
    (Method::GET, "/api/v1/blocks", READER),
    (Method::POST, "/api/v1/blocks", OPERATOR),
    (Method::GET, "/api/v1/blocks/{id}", READER),
    (Method::DELETE, "/api/v1/blocks/{id}", OPERATOR),
    (Method::GET, "/api/v1/blocks/{id}/images", READER),
    (Method::PUT, "/api/v1/blocks/{id}/images/{name}", OPERATOR),
    (Method::GET, "/api/v1/blocks/{id}/results", READER),
    (Method::GET, "/api/v1/blocks/{id}/export", READER),
    (Method::GET, "/api/v1/control-points", READER),
    (Method::POST, "/api/v1/control-points", OPERATOR),
    (Method::GET, "/api/v1/control-sets", READER),
    (Method::GET, "/api/v1/control-sets/{name}", READER),
    (Method::DELETE, "/api/v1/control-sets/{name}", OPERATOR),
    (Method::GET, "/api/v1/control-points/extent", READER),
    (Method::GET, "/api/v1/control-points/{name}", READER),
    (Method::DELETE, "/api/v1/control-points/{name}", OPERATOR),
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
    (Method::GET, "/api/v1/orientations/events", READER),
    (Method::GET, "/api/v1/orientations/{id}", READER),
    (Method::DELETE, "/api/v1/orientations/{id}", OPERATOR),
    (Method::GET, "/api/v1/orientations/{id}/events", READER),
    (Method::GET, "/api/v1/orientations/{id}/overlay", READER),
    (Method::GET, "/api/v1/orientations/{id}/export", READER),
    (Method::GET, "/api/v1/orientations/{id}/drawing", READER),
    (Method::GET, "/api/v1/orientations/{id}/map", READER),
    (Method::GET, "/api/v1/orientations/{id}/control-points/{name}/window", READER),
    (Method::POST, "/api/v1/orientations/{id}/trials", OPERATOR),
    (Method::GET, "/api/v1/orientations/{id}/reviews", READER),
    (Method::POST, "/api/v1/orientations/{id}/reviews", OPERATOR),
    (Method::GET, "/api/v1/statistics", READER),
    (Method::POST, "/api/v1/session", PUBLIC),
    (Method::GET, "/api/v1/session", READER),
    (Method::DELETE, "/api/v1/session", READER),
    (Method::GET, "/api/v1/keys", ADMIN),
    (Method::POST, "/api/v1/keys", ADMIN),
    (Method::DELETE, "/api/v1/keys/{id}", ADMIN),
    (Method::GET, "/api/v1/accounts", ADMIN),
    (Method::POST, "/api/v1/accounts", ADMIN),
    (Method::PATCH, "/api/v1/accounts/{id}", ADMIN),
    (Method::GET, "/api/v1/audit", ADMIN),
    (Method::GET, "/api/v1/webhooks", OPERATOR),
    (Method::POST, "/api/v1/webhooks/{id}/resend", OPERATOR),
];

/// What a route asks of its caller; `None` if it is not in the table.
#[must_use]
pub fn access(method: &Method, path: &str) -> Option<Access> {
    let rule = |method: &Method| ROUTES.iter().find(|(m, p, _)| m == method && *p == path);
    // what answers GET answers HEAD too
    let rule = rule(method).or_else(|| if method == Method::HEAD { rule(&Method::GET) } else { None });
    rule.map(|(_, _, access)| *access)
}

/// Who is calling. Handlers of routes that are not public may ask for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Caller {
    /// The id of the key, `account:` and its name, or `loopback`.
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
