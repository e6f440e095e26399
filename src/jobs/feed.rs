//! What happens to orientations, told from where it happens to whoever listens, in this process or another.
//!
//! A worker process tells its parent by lines on its standard output. Services that share a PostgreSQL tell each other by
//! its notifications, which also call workers to new work.

use std::borrow::Cow;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use sqlx::postgres::PgListener;
use tokio::sync::{broadcast, mpsc};
use uuid::Uuid;

use super::Inner;
use crate::database::{Database, query};
use crate::store::orientations::Status;

/// Something has happened to an orientation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Which one.
    pub id: Uuid,
    /// How far it is.
    pub status: Status,
    /// The stage it has come to, if it is running.
    pub stage: Option<Cow<'static, str>>,
    /// 0 to 1.
    pub progress: f64,
    /// Of the result, once it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<String>,
}

impl Change {
    /// That an orientation has come to this status, and nothing more.
    pub(super) fn to(id: Uuid, status: Status) -> Self {
        let progress = if status.is_final() { 1.0 } else { 0.0 };
        Self { id, status, stage: None, progress, verdict: None }
    }
}

/// What a worker process tells its parent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Told {
    /// Something has happened.
    Change(Change),
    /// An orientation has ended.
    Ended { status: Status, verdict: Option<String> },
    /// A stage took so long.
    Stage { stage: Cow<'static, str>, seconds: f64 },
    /// An attempt took so long, and came to this.
    Attempt { outcome: Cow<'static, str>, seconds: f64 },
}

impl Told {
    /// Records it in the metrics of this process.
    fn record(&self) {
        match self {
            Self::Change(_) => {}
            Self::Ended { status, verdict } => {
                let verdict = verdict.clone().unwrap_or_else(|| "none".to_owned());
                let labels = [("status", status.name().to_owned()), ("verdict", verdict)];
                metrics::counter!("gable_orientations_total", &labels).increment(1);
            }
            Self::Stage { stage, seconds } => {
                let stage = stage.clone().into_owned();
                metrics::histogram!("gable_stage_duration_seconds", "stage" => stage).record(*seconds);
            }
            Self::Attempt { outcome, seconds } => {
                metrics::histogram!("gable_orientation_duration_seconds").record(*seconds);
                metrics::counter!("gable_attempts_total", "outcome" => outcome.clone().into_owned()).increment(1);
            }
        }
    }
}

/// Changes that a slow listener may be behind by before it misses some.
const CHANGES_KEPT: usize = 1024;

/// Tells whoever listens. Cheap to clone.
#[derive(Debug, Clone)]
pub(super) struct Teller {
    changes: broadcast::Sender<Change>,
    parent: Option<mpsc::UnboundedSender<Told>>,
}

impl Teller {
    pub(super) fn new(parent: Option<mpsc::UnboundedSender<Told>>) -> Self {
        Self { changes: broadcast::channel(CHANGES_KEPT).0, parent }
    }

    pub(super) fn tell(&self, told: Told) {
        told.record();
        if let Some(parent) = &self.parent {
            let _ = parent.send(told.clone());
        }
        if let Told::Change(change) = told {
            // nobody may be listening
            let _ = self.changes.send(change);
        }
    }

    pub(super) fn subscribe(&self) -> broadcast::Receiver<Change> {
        self.changes.subscribe()
    }
}

const CHANGES: &str = "gable_changes";
const WORK: &str = "gable_work";
/// After the connection was lost, before the next try.
const PAUSE: Duration = Duration::from_secs(1);

impl Inner {
    /// Tells the other services of a shared database.
    pub(super) async fn tell_others(&self, change: &Change) {
        if self.store.database().is_shared()
            && let Ok(text) = serde_json::to_string(change)
        {
            self.notify(CHANGES, &text).await;
        }
    }

    /// Calls workers to new work: those of this process, and those of others.
    pub(super) async fn call_workers(&self) {
        self.queue.announce();
        let _ = self.work_added.send(());
        if self.store.database().is_shared() {
            self.notify(WORK, "").await;
        }
    }

    async fn notify(&self, channel: &str, text: &str) {
        let notify = query("SELECT TRUE FROM pg_notify($1, $2)").bind(channel).bind(text);
        // what is told is only faster than looking, which everybody does now and then
        if let Err(error) = notify.fetch_value::<bool>(self.store.database()).await {
            tracing::debug!(%error, "other services could not be told");
        }
    }

    /// Listens to the other services of a shared database, for ever.
    pub(super) async fn listen(&self) {
        let Database::Postgres(pool) = self.store.database() else {
            return std::future::pending().await;
        };
        loop {
            let listened = async {
                let mut listener = PgListener::connect_with(pool).await?;
                listener.listen_all([CHANGES, WORK]).await?;
                // what was missed before
                self.queue.announce();
                loop {
                    let heard = listener.recv().await?;
                    match serde_json::from_str(heard.payload()) {
                        Ok(change) if heard.channel() == CHANGES => self.teller.tell(Told::Change(change)),
                        _ => self.queue.announce(),
                    }
                }
            };
            let ended: Result<(), sqlx::Error> = listened.await;
            if let Err(error) = ended {
                tracing::warn!(%error, "the database's notifications are not heard; listening again");
            }
            tokio::time::sleep(PAUSE).await;
        }
    }
}
