//! Orientations: what was asked for, how far it is, and what came out. The row is the truth; every change of its status
//! is one conditional `UPDATE`, so that whoever comes too late changes nothing.

mod diagnosis;
mod listed;
mod waiting;

use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};
use sqlx::FromRow;
use uuid::Uuid;

use super::sightings::{self, Sighting};
use super::{Store, StoreError, now, webhooks};
use crate::database::query;

pub use diagnosis::{DiagnosisInShort, ReasonInShort};
pub use listed::{Filter, Review};
pub(super) use waiting::CLOCK;
pub use waiting::{Abandoned, Claim, LEASE, Priority, Turn, insert, queued, recover, release, waiting};

/// How far an orientation is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// It waits for its turn.
    Queued,
    /// It is being worked on.
    Running,
    /// It has a result, which may well be a red verdict.
    Succeeded,
    /// The file is broken, or the service is at fault.
    Failed,
    /// Somebody cancelled it.
    Cancelled,
}

impl Status {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Queued, Self::Running, Self::Succeeded, Self::Failed, Self::Cancelled];

    /// Its word in the contract.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// Whether nothing more will come of it.
    #[must_use]
    pub fn is_final(self) -> bool {
        !matches!(self, Self::Queued | Self::Running)
    }

    /// The status of a word.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|status| status.name() == name)
    }
}

/// Why there is no result.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// A stable word for programs.
    pub code: String,
    /// A sentence for staff.
    pub detail: String,
}

/// An orientation. Results and drawings are JSON that this room does not look into.
#[derive(Debug, Clone, PartialEq)]
pub struct Orientation {
    /// UUIDv7.
    pub id: Uuid,
    /// The image.
    pub image_id: Uuid,
    /// The camera.
    pub camera_id: Uuid,
    /// The request with everything filled in.
    pub prepared: String,
    /// How far it is.
    pub status: Status,
    /// The stage that was last heard of.
    pub stage: Option<String>,
    /// 0 to 1.
    pub progress: f64,
    /// How often it was begun.
    pub attempts: u32,
    /// Why it failed.
    pub error: Option<Failure>,
    /// Of its result.
    pub verdict: Option<String>,
    /// What came out.
    pub result: Option<String>,
    /// What the overlay shows.
    pub drawing: Option<String>,
    /// When it was asked for.
    pub created_at: DateTime<Utc>,
    /// When it was last begun.
    pub started_at: Option<DateTime<Utc>>,
    /// When it came to its end.
    pub finished_at: Option<DateTime<Utc>>,
    /// How the process of the last attempt ended, if it did not end the attempt.
    pub fate: Option<String>,
    /// Its place among the waiting.
    pub turn: Turn,
    /// Of its result, what lists show.
    pub diagnosis: Option<DiagnosisInShort>,
    /// What staff have decided: `accepted` or `rejected`.
    pub review: Option<String>,
    /// What its image is called; only where it is read to be shown.
    pub image_name: Option<String>,
    /// What its camera is called; only where it is read to be shown.
    pub camera_name: Option<String>,
    /// The block that it belongs to; only where it is read to be shown.
    pub block_id: Option<Uuid>,
}

/// What is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct NewOrientation {
    /// UUIDv7.
    pub id: Uuid,
    /// The image.
    pub image_id: Uuid,
    /// The camera.
    pub camera_id: Uuid,
    /// The request with everything filled in.
    pub prepared: String,
    /// Those of one lane wait for each other; lanes do not: a block, or a caller.
    pub lane: String,
    /// Which go first.
    pub priority: Priority,
    /// Who is told when it has ended.
    pub webhook: Option<String>,
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct Finished {
    /// `green`, `yellow` or `red`.
    pub verdict: String,
    /// What lists show of the result.
    pub diagnosis: DiagnosisInShort,
    /// The result as the contract has it.
    pub result: String,
    /// What the overlay shows.
    pub drawing: String,
    /// What the verdict rested on, for learning.
    pub record: String,
    /// What an accepted image says of its control points; none of one that was not accepted.
    pub sightings: Vec<(String, Sighting)>,
}

#[derive(FromRow)]
struct Row {
    id: Uuid,
    image_id: Uuid,
    camera_id: Uuid,
    prepared: String,
    status: String,
    stage: Option<String>,
    progress: f64,
    #[sqlx(try_from = "i64")]
    attempts: u32,
    error_code: Option<String>,
    error: Option<String>,
    verdict: Option<String>,
    result: Option<String>,
    drawing: Option<String>,
    created_at: DateTime<Utc>,
    started_at: Option<DateTime<Utc>>,
    finished_at: Option<DateTime<Utc>>,
    fate: Option<String>,
    priority: i64,
    turn: i64,
    diagnosis: Option<String>,
    review: Option<String>,
    #[sqlx(default)]
    image_name: Option<String>,
    #[sqlx(default)]
    camera_name: Option<String>,
    #[sqlx(default)]
    block_id: Option<Uuid>,
}

impl TryFrom<Row> for Orientation {
    type Error = StoreError;

    fn try_from(row: Row) -> Result<Self, StoreError> {
        let status = Status::from_name(&row.status).ok_or(StoreError::Unknown { what: "status", value: row.status })?;
        let error = row.error_code.zip(row.error).map(|(code, detail)| Failure { code, detail });
        Ok(Self {
            id: row.id,
            image_id: row.image_id,
            camera_id: row.camera_id,
            prepared: row.prepared,
            status,
            stage: row.stage,
            progress: row.progress,
            attempts: row.attempts,
            error,
            verdict: row.verdict,
            result: row.result,
            drawing: row.drawing,
            created_at: row.created_at,
            started_at: row.started_at,
            finished_at: row.finished_at,
            fate: row.fate,
            turn: Turn { priority: row.priority.try_into()?, number: row.turn },
            diagnosis: row.diagnosis.map(DiagnosisInShort::stored).transpose()?,
            review: row.review,
            image_name: row.image_name,
            camera_name: row.camera_name,
            block_id: row.block_id,
        })
    }
}

impl Store {
    /// The orientation with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn orientation(&self, id: Uuid) -> Result<Option<Orientation>, StoreError> {
        let shown = query("SELECT o.*").then(listed::NAMES).then(" FROM orientations AS o WHERE o.id = ?").bind(id);
        let row: Option<Row> = shown.fetch_optional(&self.database).await?;
        row.map(Orientation::try_from).transpose()
    }

    /// Writes the result of an attempt; `false` if the lease is not valid any more, and then nothing is written.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn finish(&self, claim: Claim, finished: &Finished) -> Result<bool, StoreError> {
        let mut transaction = self.database.begin().await?;
        let finished_at = now();
        let done = query(
            "UPDATE orientations SET status = 'succeeded', verdict = $1, result = $2, drawing = $3, record = $4, progress = 1,
             finished_at = $5, diagnosis = $6, lease = NULL WHERE id = $7 AND status = 'running' AND lease = $8",
        )
        .bind(&finished.verdict)
        .bind(&finished.result)
        .bind(&finished.drawing)
        .bind(&finished.record)
        .bind(finished_at)
        .bind(finished.diagnosis.to_text()?)
        .bind(claim.id)
        .bind(claim.lease)
        .execute(&mut transaction)
        .await?;
        let written = done == 1;
        if written {
            diagnosis::note_reasons(&mut transaction, claim.id, &finished.diagnosis).await?;
            sightings::note(&mut transaction, claim.id, finished_at, &finished.sightings).await?;
            webhooks::note_end(&mut transaction, claim.id).await?;
        }
        transaction.commit().await?;
        Ok(written)
    }

    /// Gives an orientation up; `false` if the lease is not valid any more.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn fail(&self, claim: Claim, failure: &Failure) -> Result<bool, StoreError> {
        let mut transaction = self.database.begin().await?;
        let done = query(
            "UPDATE orientations SET status = 'failed', error_code = $1, error = $2, finished_at = $3, lease = NULL
             WHERE id = $4 AND status = 'running' AND lease = $5",
        )
        .bind(&failure.code)
        .bind(&failure.detail)
        .bind(now())
        .bind(claim.id)
        .bind(claim.lease)
        .execute(&mut transaction)
        .await?;
        let written = done == 1;
        if written {
            webhooks::note_end(&mut transaction, claim.id).await?;
        }
        transaction.commit().await?;
        Ok(written)
    }

    /// Cancels an orientation that has not ended; `false` if it has, or if there is none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn cancel(&self, id: Uuid) -> Result<bool, StoreError> {
        let mut transaction = self.database.begin().await?;
        let done = query(
            "UPDATE orientations SET status = 'cancelled', finished_at = $1, lease = NULL
             WHERE id = $2 AND status IN ('queued', 'running')",
        )
        .bind(now())
        .bind(id)
        .execute(&mut transaction)
        .await?;
        let written = done == 1;
        if written {
            webhooks::note_end(&mut transaction, id).await?;
        }
        transaction.commit().await?;
        Ok(written)
    }
}

#[cfg(test)]
mod list_tests;
#[cfg(test)]
pub(crate) mod million;
#[cfg(test)]
mod tests;
