//! What happens to an orientation, as it happens.

use std::convert::Infallible;

use axum::extract::State;
use axum::response::sse::{Event, KeepAlive, Sse};
use futures_util::{Stream, stream};
use serde_json::json;
use tokio::sync::broadcast::Receiver;
use tokio::sync::broadcast::error::RecvError;
use uuid::Uuid;

use super::found;
use crate::http::extract::Path;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::Change;
use crate::store::orientations::{Orientation, Status};

/// Follow an orientation
///
/// Server-sent events: `progress` with `{status, stage, progress}` whenever something happens, the first one at once, and
/// at last `end` with `{status, verdict}`; then the stream ends. Also when the service ends: then without `end`.
#[utoipa::path(
    get, path = "/orientations/{id}/events", operation_id = "follow_orientation", tag = "orientations",
    params(("id" = Uuid, Path, description = "The orientation's id")),
    responses(
        // any: some tools take a schema here for that of the stream, others for that of one event
        (status = 200, description = "The events", body = serde_json::Value, content_type = "text/event-stream"),
        (status = 404, description = "There is none", body = Problem, content_type = "application/problem+json"),
        (status = "default", description = "Any other problem", body = Problem, content_type = "application/problem+json"),
    ),
)]
pub(super) async fn events(
    State(state): State<AppState>,
    Path(id): Path<Uuid>,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, Problem> {
    // first listen, then look: nothing can happen unnoticed in between
    let changes = state.jobs.subscribe();
    let first = found(&state, id).await?;
    let listener = Listener { state, id, changes, phase: Phase::First(Box::new(first)) };
    let events = stream::unfold(listener, |mut listener| async {
        let event = listener.next().await?;
        Some((Ok(event), listener))
    });
    Ok(Sse::new(events).keep_alive(KeepAlive::default()))
}

struct Listener {
    state: AppState,
    id: Uuid,
    changes: Receiver<Change>,
    phase: Phase,
}

enum Phase {
    First(Box<Orientation>),
    Following,
    Over,
}

impl Listener {
    async fn next(&mut self) -> Option<Event> {
        match std::mem::replace(&mut self.phase, Phase::Following) {
            Phase::Over => None,
            Phase::First(orientation) => Some(self.standing(&orientation)),
            Phase::Following => self.change().await,
        }
    }

    /// The next change of this orientation; `None` when the service ends.
    async fn change(&mut self) -> Option<Event> {
        loop {
            let received = tokio::select! {
                received = self.changes.recv() => received,
                () = self.state.jobs.stopping().cancelled() => return None,
            };
            match received {
                Ok(change) if change.id != self.id => {}
                Ok(change) if !change.status.is_final() => {
                    return Some(progress(change.status, change.stage.as_deref(), change.progress));
                }
                // ended, or some changes were missed: the row knows
                Ok(_) | Err(RecvError::Lagged(_)) => {
                    let orientation = self.state.store.orientation(self.id).await.ok()??;
                    return Some(self.standing(&orientation));
                }
                Err(RecvError::Closed) => return None,
            }
        }
    }

    fn standing(&mut self, orientation: &Orientation) -> Event {
        if orientation.status.is_final() {
            self.phase = Phase::Over;
            let data = json!({"status": orientation.status.name(), "verdict": orientation.verdict});
            return Event::default().event("end").data(data.to_string());
        }
        progress(orientation.status, orientation.stage.as_deref(), orientation.progress)
    }
}

fn progress(status: Status, stage: Option<&str>, progress: f64) -> Event {
    let data = json!({"status": status.name(), "stage": stage, "progress": progress});
    Event::default().event("progress").data(data.to_string())
}
