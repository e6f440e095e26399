//! The audit log, for reading.

use axum::extract::State;
use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::extract::Query;
use super::page::{Page, Wanted};
use super::problem::Problem;
use super::state::AppState;
use crate::store::audit::Entry;

/// The routes of the audit log.
pub fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new().routes(routes!(list))
}

/// A row of the audit log.
#[derive(Debug, Serialize, ToSchema)]
struct EntryAnswer {
    /// 1, 2, 3, without gaps.
    number: i64,
    /// When it was noted.
    at: DateTime<Utc>,
    /// The id of a key, `account:` and a name, `loopback`, `command line`, or `nobody` with its address.
    who: String,
    /// Method and route, or the command.
    action: String,
    /// What it was done to.
    object: String,
    /// The HTTP status; 0 of a command.
    status: u16,
    /// The request's id, as in the log; empty of a command.
    request_id: String,
    /// SHA-256 of the hash before and of this row, hexadecimal.
    sha256: String,
}

impl From<Entry> for EntryAnswer {
    fn from(entry: Entry) -> Self {
        let Entry { number, at, who, action, object, status, request_id, sha256 } = entry;
        let sha256 = sha256.iter().map(|byte| format!("{byte:02x}")).collect();
        Self { number, at, who, action, object, status, request_id, sha256 }
    }
}

/// Which rows are wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct ListQuery {
    /// Only those noted at this time or later (RFC 3339).
    since: Option<DateTime<Utc>>,
    /// Only of this caller.
    who: Option<String>,
    /// Items on a page, from 1 to 200; 50 if left out.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    cursor: Option<String>,
}

/// Show the audit log
///
/// What was changed, and what was refused, by whom; the newest first. Each row's hash covers the one before.
#[utoipa::path(
    get, path = "/audit", operation_id = "show_audit_log", tag = "access", params(ListQuery),
    responses(
        (status = 200, description = "One page", body = Page<EntryAnswer>),
        (status = 422, description = "A parameter makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<ListQuery>,
) -> Result<axum::Json<Page<EntryAnswer>>, Problem> {
    let wanted = Wanted::new(query.limit, query.cursor.as_deref())?;
    // cursors are written as ids everywhere
    let before = wanted.before.map(|id| i64::try_from(id.as_u128()).unwrap_or(i64::MAX));
    let fetched = state.store.audit(query.since, query.who.as_deref(), before, wanted.fetch()).await?;
    let id = |entry: &Entry| Uuid::from_u128(u128::from(entry.number.unsigned_abs()));
    Ok(axum::Json(wanted.page(fetched, id, EntryAnswer::from)))
}
