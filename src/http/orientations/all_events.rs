//! What happens to all orientations, as it happens.

use std::convert::Infallible;

use axum::extract::State;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::{Stream, stream};
use serde::Serialize;
use tokio::sync::broadcast::Receiver;
use tokio::sync::broadcast::error::RecvError;
use uuid::Uuid;

use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::Change;

/// Follow all orientations
///
/// Server-sent events: `change` with `{id, status, stage, progress}`, and `verdict` once it has one, whenever something
/// happens to an orientation, also that it is accepted; `missed` when some were left out because they were not taken
/// fast enough: then a list that is shown is to be loaded anew. The stream ends when the service ends.
#[utoipa::path(
    get, path = "/orientations/events", operation_id = "follow_orientations", tag = "orientations",
    responses(
        // any: some tools take a schema here for that of the stream, others for that of one event
        (status = 200, description = "The events", body = serde_json::Value, content_type = "text/event-stream"),
        (status = "default", description = "Any problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn events(State(state): State<AppState>) -> Sse<impl Stream<Item = Result<Event, Infallible>>> {
    let changes = state.jobs.subscribe();
    let events = stream::unfold((state, changes), |(state, mut changes)| async {
        let event = next(&state, &mut changes).await?;
        Some((Ok(event), (state, changes)))
    });
    Sse::new(events).keep_alive(KeepAlive::default())
}

/// The next event; `None` when the service ends.
async fn next(state: &AppState, changes: &mut Receiver<Change>) -> Option<Event> {
    let received = tokio::select! {
        // what has happened before the end is told
        biased;
        received = changes.recv() => received,
        () = state.jobs.stopping().cancelled() => return None,
    };
    match received {
        Ok(change) => Some(event(&change)),
        Err(RecvError::Lagged(_)) => Some(Event::default().event("missed").data("{}")),
        Err(RecvError::Closed) => None,
    }
}

/// A change as the client sees it.
#[derive(Serialize)]
struct ChangeEvent<'c> {
    id: Uuid,
    status: &'static str,
    stage: Option<&'c str>,
    progress: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    verdict: Option<&'c str>,
}

fn event(change: &Change) -> Event {
    let Change { id, status, stage, progress, verdict } = change;
    let (stage, verdict) = (stage.as_deref(), verdict.as_deref());
    let told = ChangeEvent { id: *id, status: status.name(), stage, progress: *progress, verdict };
    // what cannot be written is missed
    let data = serde_json::to_string(&told);
    data.map_or_else(
        |_| Event::default().event("missed").data("{}"),
        |data| Event::default().event("change").data(data),
    )
}
