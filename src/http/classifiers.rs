//! Classifiers: what decides about verdicts, trained, looked at, activated, rolled back.

mod answer;
mod files;
mod upload;

use axum::body::Body;
use axum::extract::{DefaultBodyLimit, FromRequest as _, Request, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use http_body_util::Limited;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;
use uuid::Uuid;

use super::access::Caller;
use super::extract::{Json, Path, Query, media_type, refuse_encoded};
use super::idempotency::NewId;
use super::page::{Page, PageQuery};
use super::problem::Problem;
use super::state::AppState;
use crate::classifiers::Loaded;
use crate::jobs::active::{ActiveError, NamedClassifier, SHIPPED, shipped_classifier, stored_classifier};
use crate::jobs::request::CostsRequest;
use crate::jobs::training::{Source, TrainingPlan, name_fault};
use crate::learning::Kind;
use crate::store::classifiers::StoredClassifier;
use crate::store::keys::Role;
use answer::{ActiveAnswer, ClassifierAnswer, ClassifierDetail};

/// Before a client tries again to have a classifier trained.
const RETRY_AFTER_S: u32 = 60;

/// The routes of the classifiers.
pub fn routes() -> OpenApiRouter<AppState> {
    // an uploaded set has a limit of its own
    let train = OpenApiRouter::new().routes(routes!(list, train)).layer(DefaultBodyLimit::disable());
    OpenApiRouter::new()
        .merge(train)
        .routes(routes!(roll_back))
        .routes(routes!(read))
        .routes(routes!(activate))
        .routes(routes!(files::file))
}

/// What is to be trained from the service's own history.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct TrainRequest {
    /// Unique; 1 to 200 characters, and not `shipped`.
    #[schema(example = "rhineland-2026", min_length = 1, max_length = 200)]
    name: String,
    /// The kinds that are compared, of `paper`, `one_feature`, `evidence_svm`, `evidence_logistic`; the one with the least
    /// expected cost on areas that it was not trained on is kept. Default: all.
    #[serde(default)]
    #[schema(example = json!(["evidence_logistic"]))]
    kinds: Vec<String>,
    /// What decisions cost. Default: the service's.
    costs: Option<CostsRequest>,
    /// Whether it decides as soon as it is ready; this needs an admin. Default: no.
    #[serde(default)]
    activate: bool,
}

/// The same beside an uploaded labelled set.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct TrainQuery {
    /// With a labelled set as the body: the unique name of the classifier.
    name: Option<String>,
    /// With a labelled set as the body: the kinds that are compared, with commas between. Default: all.
    kinds: Option<String>,
    /// With a labelled set as the body: whether it decides as soon as it is ready; this needs an admin. Default: no.
    #[serde(default)]
    activate: bool,
}

/// Which classifier decides now.
#[derive(Debug, Serialize, ToSchema)]
struct Decides {
    /// The classifier that decides from now on.
    active: ActiveAnswer,
}

/// Train a classifier
///
/// From the service's own history: the orientations of images that have a reference (`POST /references`). Or from a
/// labelled set as the body (`application/x-ndjson`, as `gable simulate` and `gable evaluate --save` leave it). The answer
/// comes at once; `GET /classifiers/{id}` tells how far it is.
#[utoipa::path(
    post, path = "/classifiers", operation_id = "train_classifier", tag = "diagnosis",
    params(
        TrainQuery,
        ("Idempotency-Key" = Option<String>, Header, min_length = 1, max_length = 255, description = "Makes the request safe to repeat"),
    ),
    request_body(content((TrainRequest = "application/json"), (String = "application/x-ndjson"))),
    responses(
        (status = 202, description = "Accepted; `Location` says where to look", body = ClassifierDetail),
        (status = 409, description = "There is a classifier of this name", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "A larger set than this service accepts", body = Problem, content_type = "application/problem+json"),
        (status = 422, description = "A field or a line of the set makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Too many are waiting", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn train(
    State(state): State<AppState>,
    NewId(id): NewId,
    caller: Caller,
    Query(query): Query<TrainQuery>,
    request: Request,
) -> Result<Response, Problem> {
    if let Some(there) = state.store.classifier(id).await? {
        // the second try of a request that was accepted already
        return accepted(&state, &there).await;
    }
    let waiting = state.store.trainings().await?;
    if waiting >= state.configuration.training_max_jobs {
        let detail = format!("{waiting} classifiers are waiting to be trained already; come back later.");
        return Err(Problem::unavailable(detail, RETRY_AFTER_S));
    }
    let (name, plan): (String, _) = match media_type(request.headers()).as_deref() {
        Some("application/x-ndjson" | "application/jsonl") => {
            refuse_encoded(request.headers())?;
            let name = query.name.clone().ok_or_else(|| {
                Problem::invalid_field("?name", "name is missing; it names the classifier that is trained from the set")
            })?;
            let kinds =
                query.kinds.as_deref().map(|kinds| kinds.split(',').map(|kind| kind.trim().to_owned()).collect());
            let plan = planned(&state, &name, kinds.unwrap_or_default(), None, Source::Upload, query.activate)?;
            may_activate(&caller, &plan)?;
            upload::receive(&state, id, request.into_body()).await?;
            (name, plan)
        }
        _ => {
            // the route has no limit for the sake of uploaded sets
            let limited = |body| Body::new(Limited::new(body, state.configuration.body_max_bytes));
            let Json(wanted) = Json::<TrainRequest>::from_request(request.map(limited), &state).await?;
            let plan = planned(&state, &wanted.name, wanted.kinds, wanted.costs, Source::History, wanted.activate)?;
            may_activate(&caller, &plan)?;
            (wanted.name, plan)
        }
    };
    let plan = serde_json::to_string(&plan).map_err(|error| Problem::internal(&error))?;
    if !state.store.queue_classifier(id, &name, &plan).await? {
        upload::forget(&state, id).await;
        return Err(Problem::conflict(format!("There is a classifier of the name {name:?} already.")));
    }
    state.jobs.announce_training();
    let stored = state.store.classifier(id).await?.ok_or_else(missing)?;
    accepted(&state, &stored).await
}

async fn accepted(state: &AppState, stored: &StoredClassifier) -> Result<Response, Problem> {
    let detail = ClassifierDetail::of_stored(state, stored).await?;
    let location = format!("/api/v1/classifiers/{}", stored.id);
    Ok((StatusCode::ACCEPTED, [(header::LOCATION, location)], axum::Json(detail)).into_response())
}

/// What decides about verdicts is for an admin to say, at once or later.
fn may_activate(caller: &Caller, plan: &TrainingPlan) -> Result<(), Problem> {
    if plan.activate && caller.role < Role::Admin {
        let detail = format!("The key has the role {}; to activate a classifier needs {}.", caller.role, Role::Admin);
        return Err(Problem::forbidden(detail));
    }
    Ok(())
}

/// Checks what is to be trained.
fn planned(
    state: &AppState,
    name: &str,
    kinds: Vec<String>,
    costs: Option<CostsRequest>,
    source: Source,
    activate: bool,
) -> Result<TrainingPlan, Problem> {
    if let Some(fault) = name_fault(name) {
        return Err(Problem::invalid_field("/name", fault));
    }
    if let Some(kind) = kinds.iter().find(|kind| Kind::from_name(kind).is_none()) {
        let known = Kind::ALL.map(Kind::name).join(", ");
        return Err(Problem::invalid_field("/kinds", format!("{kind:?} is not one of {known}")));
    }
    let kinds = if kinds.is_empty() { Kind::ALL.map(|kind| kind.name().to_owned()).to_vec() } else { kinds };
    let costs = costs.unwrap_or(state.configuration.policy().costs.into());
    if let Some(fault) = costs.faults().first() {
        return Err(Problem::invalid_field(&fault.pointer, &fault.detail));
    }
    Ok(TrainingPlan { kinds, costs, source, activate })
}

/// List the classifiers
///
/// The newest first, and on the first page, before all others and beyond its limit, the one that Gable brings along.
#[utoipa::path(
    get, path = "/classifiers", operation_id = "list_classifiers", tag = "diagnosis", params(PageQuery),
    responses(
        (status = 200, description = "One page", body = Page<ClassifierAnswer>),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn list(
    State(state): State<AppState>,
    Query(query): Query<PageQuery>,
) -> Result<axum::Json<Page<ClassifierAnswer>>, Problem> {
    let wanted = query.wanted()?;
    let active = active_id(&state).await?;
    let fetched = state.store.classifiers(wanted.before, wanted.fetch()).await?;
    let mut page = wanted.page(fetched, |stored| stored.id, |stored| ClassifierAnswer::of_stored(&stored, active));
    if wanted.before.is_none() {
        page.items.insert(0, ClassifierAnswer::of_shipped(&shipped_classifier()?, active.is_none()));
    }
    Ok(axum::Json(page))
}

/// Show a classifier
///
/// Its provenance, its cross-validation with confusion tables over T_d, cost curve and calibration, how all kinds did on
/// areas that were not trained on, and, of the active one, how far recent images have drifted from its training.
#[utoipa::path(
    get, path = "/classifiers/{id}", operation_id = "show_classifier", tag = "diagnosis",
    params(("id" = String, Path, description = "The classifier's id, or `shipped`")),
    responses(
        (status = 200, description = "The classifier", body = ClassifierDetail),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn read(State(state): State<AppState>, Path(id): Path<String>) -> Result<axum::Json<ClassifierDetail>, Problem> {
    Ok(axum::Json(match found(&state, &id).await? {
        None => ClassifierDetail::of_shipped(&state).await?,
        Some(stored) => ClassifierDetail::of_stored(&state, &stored).await?,
    }))
}

/// Activate a classifier
///
/// It decides about all orientations that begin from now on.
#[utoipa::path(
    post, path = "/classifiers/{id}/activate", operation_id = "activate_classifier", tag = "diagnosis",
    params(("id" = String, Path, description = "The classifier's id, or `shipped`")),
    responses(
        (status = 200, description = "It decides from now on", body = Decides),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "It is not ready", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn activate(State(state): State<AppState>, Path(id): Path<String>) -> Result<axum::Json<Decides>, Problem> {
    let stored = found(&state, &id).await?;
    if let Some(stored) = &stored {
        if stored.texts.is_none() {
            return Err(Problem::conflict(format!("It is not ready: {}.", stored.status.name())));
        }
        stored_classifier(stored).map_err(|error| Problem::conflict(error.to_string()))?;
    }
    state.store.activate_classifier(stored.as_ref().map(|stored| stored.id)).await?;
    decides(&state).await
}

/// Roll back
///
/// Takes the last activation back: the classifier before it decides again.
#[utoipa::path(
    post, path = "/classifiers/rollback", operation_id = "roll_classifier_back", tag = "diagnosis",
    responses(
        (status = 200, description = "Which one decides from now on", body = Decides),
        (status = 409, description = "None was ever activated", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
async fn roll_back(State(state): State<AppState>) -> Result<axum::Json<Decides>, Problem> {
    if !state.store.roll_classifier_back().await? {
        let detail = "No classifier was ever activated: the one that Gable brings along decides from the beginning.";
        return Err(Problem::conflict(detail));
    }
    decides(&state).await
}

async fn decides(state: &AppState) -> Result<axum::Json<Decides>, Problem> {
    let NamedClassifier { name, loaded } = state.jobs.active_classifier().await?;
    tracing::info!(name, sha256 = loaded.hash(), "this classifier decides from now on");
    let id = active_id(state).await?;
    Ok(axum::Json(Decides { active: ActiveAnswer::of(id, name, &loaded) }))
}

/// The classifier with this id; `None` for the one that Gable brings along.
async fn found(state: &AppState, id: &str) -> Result<Option<StoredClassifier>, Problem> {
    if id == SHIPPED {
        return Ok(None);
    }
    let id = Uuid::try_parse(id).map_err(|_| missing())?;
    Ok(Some(state.store.classifier(id).await?.ok_or_else(missing)?))
}

/// What can be used of a classifier; `None` if it is not trained.
fn usable(stored: Option<&StoredClassifier>) -> Result<Option<Loaded>, Problem> {
    match stored {
        None => Ok(Some(shipped_classifier()?.loaded)),
        Some(stored) if stored.texts.is_none() => Ok(None),
        Some(stored) => Ok(Some(stored_classifier(stored)?.loaded)),
    }
}

async fn active_id(state: &AppState) -> Result<Option<Uuid>, Problem> {
    let last = state.store.activations(1).await?;
    Ok(last.first().and_then(|activation| activation.classifier_id))
}

fn missing() -> Problem {
    Problem::not_found("There is no classifier with this id.")
}

impl From<ActiveError> for Problem {
    fn from(error: ActiveError) -> Self {
        match error {
            ActiveError::Store(error) => error.into(),
            error @ ActiveError::Unreadable { .. } => Self::conflict(error.to_string()),
        }
    }
}
