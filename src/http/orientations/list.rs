//! Lists of orientations.

use axum::extract::State;
use chrono::{DateTime, Utc};
use serde::Deserialize;
use utoipa::IntoParams;
use uuid::Uuid;

use super::answer::OrientationAnswer;
use crate::http::extract::{Query, comparable, searched};
use crate::http::page::{Page, Wanted};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::orientations::{Filter, Review, Status};

/// The most characters of a reason's code.
const CODE_MAX: usize = 64;

/// Which orientations are wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListQuery {
    /// `queued`, `running`, `succeeded`, `failed` or `cancelled`.
    status: Option<String>,
    /// `green`, `yellow` or `red`.
    verdict: Option<String>,
    /// What staff have decided: `accepted` or `rejected`; `open` for those that have succeeded and wait for it.
    review: Option<String>,
    /// Only with a reason of this code, as in `few_control_points`.
    #[param(min_length = 1, max_length = 64)]
    reason: Option<String>,
    /// Only those whose image has this in its name, in small or capital letters; or whose id, or that of their image,
    /// begins with it (at least 8 digits).
    #[param(max_length = 200)]
    q: Option<String>,
    /// Only of this image.
    image: Option<Uuid>,
    /// Only by the camera of this id or name.
    #[param(max_length = 200)]
    camera: Option<String>,
    /// Only of this block.
    block: Option<Uuid>,
    /// Only those asked for at this time or later (RFC 3339).
    since: Option<DateTime<Utc>>,
    /// Only those asked for before this time (RFC 3339).
    until: Option<DateTime<Utc>>,
    /// Items on a page, from 1 to 200; 50 if left out.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    #[param(min_length = 1)]
    cursor: Option<String>,
}

/// One of some words.
fn one_of<T: Copy>(
    parameter: &str,
    given: Option<&str>,
    words: &[(&'static str, T)],
) -> Result<Option<(&'static str, T)>, Problem> {
    let Some(given) = given else { return Ok(None) };
    let found = words.iter().find(|(word, _)| *word == given);
    found.copied().map(Some).ok_or_else(|| {
        let all = words.iter().map(|(word, _)| *word).collect::<Vec<_>>().join(", ");
        Problem::invalid_field(format!("?{parameter}"), format!("{parameter} is {given:?}; it must be one of {all}"))
    })
}

impl ListQuery {
    async fn filter(&self, state: &AppState, before: Option<Uuid>) -> Result<Filter, Problem> {
        let statuses = Status::ALL.map(|status| (status.name(), status));
        let verdicts = ["green", "yellow", "red"].map(|verdict| (verdict, ()));
        let reviews = [("open", Review::Open), ("accepted", Review::Accepted), ("rejected", Review::Rejected)];
        let is_code = |code: &str| code.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_');
        if self.reason.as_deref().is_some_and(|code| !is_code(code) || !(1..=CODE_MAX).contains(&code.len())) {
            return Err(Problem::invalid_field("?reason", "reason must be a code, as in few_control_points"));
        }
        let camera_id = match searched("camera", self.camera.as_deref())? {
            None => None,
            // nothing was taken by a camera that is not there
            Some(camera) => Some(state.store.camera(camera).await?.map_or(Uuid::nil(), |camera| camera.id)),
        };
        Ok(Filter {
            status: one_of("status", self.status.as_deref(), &statuses)?.map(|(_, status)| status),
            verdict: one_of("verdict", self.verdict.as_deref(), &verdicts)?.map(|(verdict, ())| verdict.to_owned()),
            review: one_of("review", self.review.as_deref(), &reviews)?.map(|(_, review)| review),
            reason: self.reason.clone(),
            image_id: self.image,
            camera_id,
            block_id: self.block,
            text: searched("q", self.q.as_deref())?.map(str::to_owned),
            since: self.since.map(comparable),
            until: self.until.map(comparable),
            before,
        })
    }
}

/// List the orientations
///
/// The newest first, without their results.
#[utoipa::path(
    get, path = "/orientations", operation_id = "list_orientations", tag = "orientations", params(ListQuery),
    responses(
        (status = 200, description = "One page", body = Page<OrientationAnswer>),
        (status = 422, description = "A parameter makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn list(
    State(state): State<AppState>,
    Query(query): Query<ListQuery>,
) -> Result<axum::Json<Page<OrientationAnswer>>, Problem> {
    let wanted = Wanted::new(query.limit, query.cursor.as_deref())?;
    let filter = query.filter(&state, wanted.before).await?;
    let fetched = state.store.orientations(&filter, wanted.fetch()).await?;
    let Page { items, next_cursor } = wanted.page(fetched, |orientation| orientation.id, OrientationAnswer::new);
    let items = items.into_iter().collect::<Result<_, _>>()?;
    Ok(axum::Json(Page { items, next_cursor }))
}
