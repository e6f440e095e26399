//! Orientations: what was asked for, how far it is, and what came out. The row is the truth; every change of its status
//! is one conditional `UPDATE`, so that whoever comes too late changes nothing.

use chrono::{DateTime, Utc};
use sqlx::{FromRow, QueryBuilder, Sqlite, Transaction};
use uuid::Uuid;

use super::sightings::{self, Sighting};
use super::{Store, StoreError, now};

/// How far an orientation is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
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
}

/// What came out.
#[derive(Debug, Clone, PartialEq)]
pub struct Finished {
    /// `green`, `yellow` or `red`.
    pub verdict: String,
    /// The result as the contract has it.
    pub result: String,
    /// What the overlay shows.
    pub drawing: String,
    /// What the verdict rested on, for learning.
    pub record: String,
    /// What an accepted image says of its control points; none of one that was not accepted.
    pub sightings: Vec<(String, Sighting)>,
}

/// What a list of orientations is restricted to.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Filter {
    /// Only of this status.
    pub status: Option<Status>,
    /// Only with this verdict.
    pub verdict: Option<String>,
    /// Only of this image.
    pub image_id: Option<Uuid>,
    /// Only those asked for at this time or later.
    pub since: Option<DateTime<Utc>>,
    /// Only those with a smaller id.
    pub before: Option<Uuid>,
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
    attempts: u32,
    error_code: Option<String>,
    error: Option<String>,
    verdict: Option<String>,
    result: Option<String>,
    drawing: Option<String>,
    created_at: DateTime<Utc>,
    started_at: Option<DateTime<Utc>>,
    finished_at: Option<DateTime<Utc>>,
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
        })
    }
}

/// Adds an orientation as queued; `false` if it is there already, from a first try of the same request.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn insert(transaction: &mut Transaction<'_, Sqlite>, new: &NewOrientation) -> Result<bool, StoreError> {
    let done = sqlx::query(
        "INSERT INTO orientations (id, image_id, camera_id, prepared, status, created_at)
         VALUES (?, ?, ?, ?, 'queued', ?) ON CONFLICT (id) DO NOTHING",
    )
    .bind(new.id)
    .bind(new.image_id)
    .bind(new.camera_id)
    .bind(&new.prepared)
    .bind(now())
    .execute(&mut **transaction)
    .await?;
    Ok(done.rows_affected() == 1)
}

/// How many orientations wait for their turn.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn queued(transaction: &mut Transaction<'_, Sqlite>) -> Result<u32, StoreError> {
    let count = sqlx::query_scalar("SELECT count(*) FROM orientations WHERE status = 'queued'");
    Ok(count.fetch_one(&mut **transaction).await?)
}

/// Takes up again what was running when the service ended, and says what waits, the oldest first.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn recover(transaction: &mut Transaction<'_, Sqlite>) -> Result<Vec<Uuid>, StoreError> {
    sqlx::query("UPDATE orientations SET status = 'queued', lease = NULL WHERE status = 'running'")
        .execute(&mut **transaction)
        .await?;
    let waiting = sqlx::query_scalar("SELECT id FROM orientations WHERE status = 'queued' ORDER BY id");
    Ok(waiting.fetch_all(&mut **transaction).await?)
}

impl Store {
    /// The orientation with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn orientation(&self, id: Uuid) -> Result<Option<Orientation>, StoreError> {
        let row: Option<Row> =
            sqlx::query_as("SELECT * FROM orientations WHERE id = ?").bind(id).fetch_optional(&self.pool).await?;
        row.map(Orientation::try_from).transpose()
    }

    /// At most `limit` orientations, the newest first. Results and drawings are left out.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn orientations(&self, filter: &Filter, limit: u32) -> Result<Vec<Orientation>, StoreError> {
        let mut query = QueryBuilder::<Sqlite>::new(
            "SELECT id, image_id, camera_id, prepared, status, stage, progress, attempts, error_code, error, verdict,
             NULL AS result, NULL AS drawing, created_at, started_at, finished_at FROM orientations WHERE TRUE",
        );
        if let Some(status) = filter.status {
            query.push(" AND status = ").push_bind(status.name());
        }
        if let Some(verdict) = &filter.verdict {
            query.push(" AND verdict = ").push_bind(verdict);
        }
        if let Some(image_id) = filter.image_id {
            query.push(" AND image_id = ").push_bind(image_id);
        }
        if let Some(since) = filter.since {
            query.push(" AND created_at >= ").push_bind(since);
        }
        if let Some(before) = filter.before {
            query.push(" AND id < ").push_bind(before);
        }
        query.push(" ORDER BY id DESC LIMIT ").push_bind(limit);
        let rows: Vec<Row> = query.build_query_as().fetch_all(&self.pool).await?;
        rows.into_iter().map(Orientation::try_from).collect()
    }

    /// Begins an attempt at a queued orientation under a lease; `None` if it does not wait any more.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn begin_attempt(&self, id: Uuid, lease: Uuid) -> Result<Option<Orientation>, StoreError> {
        let row: Option<Row> = sqlx::query_as(
            "UPDATE orientations SET status = 'running', attempts = attempts + 1, lease = ?, started_at = ?,
             stage = NULL, progress = 0 WHERE id = ? AND status = 'queued' RETURNING *",
        )
        .bind(lease)
        .bind(now())
        .bind(id)
        .fetch_optional(&self.pool)
        .await?;
        row.map(Orientation::try_from).transpose()
    }

    /// Notes how far an attempt is.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn note_progress(&self, lease: Uuid, id: Uuid, stage: &str, progress: f64) -> Result<(), StoreError> {
        let query = "UPDATE orientations SET stage = ?, progress = ? WHERE id = ? AND status = 'running' AND lease = ?";
        sqlx::query(query).bind(stage).bind(progress).bind(id).bind(lease).execute(&self.pool).await?;
        Ok(())
    }

    /// Writes the result of an attempt; `false` if the lease is not valid any more, and then nothing is written.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn finish(&self, lease: Uuid, id: Uuid, finished: &Finished) -> Result<bool, StoreError> {
        let mut transaction = self.begin_write().await?;
        let finished_at = now();
        let done = sqlx::query(
            "UPDATE orientations SET status = 'succeeded', verdict = ?, result = ?, drawing = ?, record = ?, progress = 1,
             finished_at = ?, lease = NULL WHERE id = ? AND status = 'running' AND lease = ?",
        )
        .bind(&finished.verdict)
        .bind(&finished.result)
        .bind(&finished.drawing)
        .bind(&finished.record)
        .bind(finished_at)
        .bind(id)
        .bind(lease)
        .execute(&mut *transaction)
        .await?;
        let written = done.rows_affected() == 1;
        if written {
            sightings::note(&mut transaction, id, finished_at, &finished.sightings).await?;
        }
        transaction.commit().await?;
        Ok(written)
    }

    /// Gives an orientation up; `false` if the lease is not valid any more.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn fail(&self, lease: Uuid, id: Uuid, failure: &Failure) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "UPDATE orientations SET status = 'failed', error_code = ?, error = ?, finished_at = ?, lease = NULL
             WHERE id = ? AND status = 'running' AND lease = ?",
        )
        .bind(&failure.code)
        .bind(&failure.detail)
        .bind(now())
        .bind(id)
        .bind(lease)
        .execute(&self.pool)
        .await?;
        Ok(done.rows_affected() == 1)
    }

    /// Cancels an orientation that has not ended; `false` if it has, or if there is none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn cancel(&self, id: Uuid) -> Result<bool, StoreError> {
        let done = sqlx::query(
            "UPDATE orientations SET status = 'cancelled', finished_at = ?, lease = NULL
             WHERE id = ? AND status IN ('queued', 'running')",
        )
        .bind(now())
        .bind(id)
        .execute(&self.pool)
        .await?;
        Ok(done.rows_affected() == 1)
    }
}

/// Puts an orientation back into the queue. `counted`: the attempt counts against the limit (it failed, rather than
/// having been interrupted); `false` if the lease is not valid any more.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn release(
    transaction: &mut Transaction<'_, Sqlite>,
    lease: Uuid,
    id: Uuid,
    counted: bool,
) -> Result<bool, StoreError> {
    let done = sqlx::query(
        "UPDATE orientations SET status = 'queued', lease = NULL, attempts = attempts - ?
         WHERE id = ? AND status = 'running' AND lease = ?",
    )
    .bind(u32::from(!counted))
    .bind(id)
    .bind(lease)
    .execute(&mut **transaction)
    .await?;
    Ok(done.rows_affected() == 1)
}
