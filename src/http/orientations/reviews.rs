//! What staff decide of orientations.

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;
use utoipa::ToSchema;
use uuid::Uuid;

use super::drawing::{drawn_image, succeeded};
use super::trials::{CorrectionRequest, tried};
use super::{found, missing};
use crate::classifiers::Record;
use crate::http::access::Caller;
use crate::http::extract::{Json, Path, Query};
use crate::http::page::{Page, PageQuery};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::training::accepted;
use crate::report::OrientationResult;
use crate::store::reviews::{Corrected, Decision, NewReview, Review};

const LONGEST_WHY: usize = 2000;

/// A decision.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct ReviewRequest {
    /// `accepted`: the orientation, with the correction if there is one, is right. `rejected`: it is wrong.
    decision: DecisionRequest,
    /// Why; may be left out for what is accepted as it is.
    #[serde(default)]
    #[schema(max_length = 2000)]
    why: String,
    /// What was corrected by hand.
    correction: Option<CorrectionRequest>,
}

#[derive(Debug, Clone, Copy, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
enum DecisionRequest {
    Accepted,
    Rejected,
}

impl From<DecisionRequest> for Decision {
    fn from(decision: DecisionRequest) -> Self {
        match decision {
            DecisionRequest::Accepted => Self::Accepted,
            DecisionRequest::Rejected => Self::Rejected,
        }
    }
}

/// A decision that was kept.
#[derive(Debug, Serialize, ToSchema)]
pub(super) struct ReviewAnswer {
    /// UUIDv7.
    id: Uuid,
    /// `accepted` or `rejected`.
    #[schema(example = "accepted")]
    decision: String,
    /// Why; may be empty.
    why: String,
    /// Who has decided, as in the audit log.
    who: String,
    /// What was corrected by hand.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<CorrectionRequest>)]
    correction: Option<Box<RawValue>>,
    /// What the correction leads to.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<OrientationResult>)]
    result: Option<Box<RawValue>>,
    /// When.
    created_at: DateTime<Utc>,
}

impl ReviewAnswer {
    fn new(review: Review) -> Result<Self, Problem> {
        let json = |text: Option<String>| {
            text.map(RawValue::from_string).transpose().map_err(|error| Problem::internal(&error))
        };
        Ok(Self {
            id: review.id,
            decision: review.decision,
            why: review.why,
            who: review.who,
            correction: json(review.correction)?,
            result: json(review.result)?,
            created_at: review.created_at,
        })
    }
}

/// Decide about an orientation
///
/// The decision is kept with who and why, and is a label from which classifiers learn: an orientation that is accepted, with
/// its correction if there is one, becomes the reference of its image unless it has one from outside; of one that is
/// rejected it is known that it is wrong. A later decision takes the place of an earlier one. The result of the orientation
/// itself stays as it was found.
#[utoipa::path(
    post, path = "/orientations/{id}/reviews", operation_id = "review_orientation", tag = "orientations",
    params(("id" = Uuid, Path, description = "The orientation's id")), request_body = ReviewRequest,
    responses(
        (status = 201, description = "Decided", body = ReviewAnswer),
        (status = 404, description = "There is no such orientation, or it has no result", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "It has not ended yet, has found nothing that could be accepted, or cannot be corrected", body = Problem, content_type = "application/problem+json"),
        (status = 410, description = "Its image was removed, and so cannot be corrected", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A field makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn create(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    caller: Caller,
    Json(request): Json<ReviewRequest>,
) -> Result<Response, Problem> {
    let decision = Decision::from(request.decision);
    let why = checked_why(&request, decision)?;
    let orientation = succeeded(&state, id).await?;
    let (record, corrected) = match request.correction.filter(|c| *c != CorrectionRequest::default()) {
        None => {
            let record = state.store.record(id).await?;
            (
                record
                    .as_deref()
                    .map(serde_json::from_str::<Record>)
                    .transpose()
                    .map_err(|error| unreadable(&error))?,
                None,
            )
        }
        Some(correction) => {
            let image = drawn_image(&state, &orientation).await?;
            let tried = tried(&state, &orientation, &image, (&correction, "/correction")).await?;
            let json = |value: Result<String, serde_json::Error>| value.map_err(|error| unreadable(&error));
            let corrected = Corrected {
                correction: json(serde_json::to_string(&correction))?,
                result: json(serde_json::to_string(&tried.oriented.result))?,
                drawing: json(serde_json::to_string(&tried.oriented.drawing))?,
            };
            (Some(tried.oriented.record), Some(corrected))
        }
    };
    let reference = match (decision, &record) {
        (Decision::Accepted, Some(record)) => {
            accepted(orientation.image_id, &orientation.prepared, record).map_err(|error| Problem::internal(&error))?
        }
        _ => None,
    };
    if decision == Decision::Accepted && reference.is_none() {
        return Err(Problem::conflict("No orientation was found: there is nothing that could be accepted."));
    }
    let review = NewReview {
        id: Uuid::now_v7(),
        orientation_id: id,
        decision,
        why,
        who: caller.credential,
        corrected,
        reference,
    };
    let created_at = state.store.add_review(&review).await?.ok_or_else(missing)?;
    state.ended.forget_all();
    let NewReview { id: review_id, why, who, corrected, .. } = review;
    let (correction, result) = corrected.map(|c| (c.correction, c.result)).unzip();
    let kept = Review { id: review_id, decision: decision.name().to_owned(), why, who, correction, result, created_at };
    let location = format!("/api/v1/orientations/{id}/reviews");
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], axum::Json(ReviewAnswer::new(kept)?)).into_response())
}

fn unreadable(error: &serde_json::Error) -> Problem {
    Problem::internal(error)
}

/// The reason, without blanks around it.
fn checked_why(request: &ReviewRequest, decision: Decision) -> Result<String, Problem> {
    let why = request.why.trim();
    if why.is_empty() && (decision == Decision::Rejected || request.correction.is_some()) {
        let detail = "say why: whoever looks at what was rejected or corrected later will want to know";
        return Err(Problem::invalid_field("/why", detail));
    }
    let odd = |c: char| c.is_control() && c != '\n' && c != '\t';
    if why.chars().count() > LONGEST_WHY || why.chars().any(odd) {
        let detail = format!("it has at most {LONGEST_WHY} characters, and no control characters but line breaks");
        return Err(Problem::invalid_field("/why", detail));
    }
    Ok(why.to_owned())
}

/// List the decisions about an orientation
///
/// The newest first; that is the one that counts.
#[utoipa::path(
    get, path = "/orientations/{id}/reviews", operation_id = "list_reviews", tag = "orientations",
    params(("id" = Uuid, Path, description = "The orientation's id"), PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<ReviewAnswer>),
        (status = 404, description = "There is no such orientation", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A parameter makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn list(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<ReviewAnswer>>, Problem> {
    let wanted = query.wanted()?;
    found(&state, id).await?;
    let reviews = state.store.reviews(id, wanted.before, wanted.fetch()).await?;
    let Page { items, next_cursor } = wanted.page(reviews, |review| review.id, ReviewAnswer::new);
    let items = items.into_iter().collect::<Result<_, _>>()?;
    Ok(axum::Json(Page { items, next_cursor }))
}
