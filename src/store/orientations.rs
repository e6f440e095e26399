//! Orientations: what was asked for, how far it is, and what came out. The row is the truth; every change of its status
//! is one conditional `UPDATE`, so that whoever comes too late changes nothing.

use std::time::Duration;

use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};
use sqlx::{AssertSqlSafe, FromRow};
use utoipa::ToSchema;
use uuid::Uuid;

use super::sightings::{self, Sighting};
use super::{Store, StoreError, count_of, now, webhooks};
use crate::database::{Dialects, Executor, Query, Transaction, query};

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

/// Which of the waiting go first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum Priority {
    /// When nothing else waits.
    Low,
    /// Like most.
    #[default]
    Normal,
    /// Before all others.
    High,
}

impl From<Priority> for i64 {
    fn from(priority: Priority) -> Self {
        match priority {
            Priority::Low => 0,
            Priority::Normal => 1,
            Priority::High => 2,
        }
    }
}

impl TryFrom<i64> for Priority {
    type Error = StoreError;

    fn try_from(number: i64) -> Result<Self, StoreError> {
        match number {
            0 => Ok(Self::Low),
            1 => Ok(Self::Normal),
            2 => Ok(Self::High),
            _ => Err(StoreError::Unknown { what: "priority", value: number.to_string() }),
        }
    }
}

/// The place of an orientation among the waiting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// The first thing that counts.
    pub priority: Priority,
    /// The second: the smallest goes first.
    pub number: i64,
}

/// Whose attempt it is: only the holder of its lease may write a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Claim {
    /// The orientation.
    pub id: Uuid,
    /// New with every attempt.
    pub lease: Uuid,
}

/// How long nobody else takes up an attempt of which nothing is heard.
pub const LEASE: Duration = Duration::from_secs(30);

/// Milliseconds since 1970. The clocks of machines may differ; that of the database is one.
pub(super) const CLOCK: Dialects = Dialects {
    sqlite: "CAST(unixepoch('subsec') * 1000 AS INTEGER)",
    postgres: "CAST(extract(epoch FROM clock_timestamp()) * 1000 AS BIGINT)",
};

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
        })
    }
}

/// Adds an orientation as queued: its turn; `None` if it is there already, from a first try of the same request.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn insert(transaction: &mut Transaction, new: &NewOrientation) -> Result<Option<Turn>, StoreError> {
    // a lane begins where the work is, and goes on where it ends: start-time fair queueing
    let number =
        "(SELECT max(COALESCE((SELECT min(turn) FROM orientations WHERE status = 'queued' AND priority = $7), 0),
                  COALESCE((SELECT max(turn) + 1 FROM orientations WHERE status = 'queued' AND lane = $6), 0)))";
    let number = match transaction {
        Transaction::Sqlite(_) => number.to_owned(),
        Transaction::Postgres(_) => number.replacen("max(", "greatest(", 1),
    };
    let insert = format!(
        "INSERT INTO orientations (id, image_id, camera_id, prepared, status, created_at, lane, priority, webhook, turn)
         VALUES ($1, $2, $3, $4, 'queued', $5, $6, $7, $8, {number}) ON CONFLICT (id) DO NOTHING RETURNING turn"
    );
    let number = query(AssertSqlSafe(insert))
        .bind(new.id)
        .bind(new.image_id)
        .bind(new.camera_id)
        .bind(&new.prepared)
        .bind(now())
        .bind(&new.lane)
        .bind(i64::from(new.priority))
        .bind(&new.webhook)
        .fetch_optional_value(transaction)
        .await?;
    Ok(number.map(|number| Turn { priority: new.priority, number }))
}

/// How many orientations wait for their turn.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn queued<'e>(on: impl Into<Executor<'e>>) -> Result<u32, StoreError> {
    let count = query("SELECT count(*) FROM orientations WHERE status = 'queued'");
    count_of(count.fetch_value(on).await?)
}

/// What lets attempts be taken up again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Abandoned {
    /// No process works but this one, which has just begun.
    All,
    /// Their leases have run out.
    Late,
    /// This process has ended.
    By(Uuid),
}

/// Makes attempts that nobody ends any more wait again, and says which, with their turns. `fate` is how their process
/// ended.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn recover(
    transaction: &mut Transaction,
    abandoned: Abandoned,
    fate: &str,
) -> Result<Vec<(Uuid, Turn)>, StoreError> {
    let which = match abandoned {
        Abandoned::All => "",
        Abandoned::Late => "AND lease_until_ms < ",
        Abandoned::By(_) => "AND worker = $2",
    };
    let clock = if abandoned == Abandoned::Late { transaction.dialect(CLOCK) } else { "" };
    let sql = format!(
        "UPDATE orientations SET status = 'queued', lease = NULL, worker = NULL, lease_until_ms = NULL, fate = $1
         WHERE status = 'running' {which}{clock} RETURNING id, priority, turn"
    );
    let mut update = query(AssertSqlSafe(sql)).bind(fate);
    if let Abandoned::By(worker) = abandoned {
        update = update.bind(worker);
    }
    turns(update.fetch_all(transaction).await?)
}

/// All that wait, with their turns.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn waiting(transaction: &mut Transaction) -> Result<Vec<(Uuid, Turn)>, StoreError> {
    let waiting = query("SELECT id, priority, turn FROM orientations WHERE status = 'queued' ORDER BY turn, id");
    turns(waiting.fetch_all(transaction).await?)
}

fn turns(rows: Vec<(Uuid, i64, i64)>) -> Result<Vec<(Uuid, Turn)>, StoreError> {
    let turn = |(id, priority, number): (Uuid, i64, i64)| Ok((id, Turn { priority: priority.try_into()?, number }));
    rows.into_iter().map(turn).collect()
}

impl Store {
    /// The orientation with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn orientation(&self, id: Uuid) -> Result<Option<Orientation>, StoreError> {
        let row: Option<Row> =
            query("SELECT * FROM orientations WHERE id = $1").bind(id).fetch_optional(&self.database).await?;
        row.map(Orientation::try_from).transpose()
    }

    /// At most `limit` orientations, the newest first. Results and drawings are left out.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn orientations(&self, filter: &Filter, limit: u32) -> Result<Vec<Orientation>, StoreError> {
        let rows: Vec<Row> = listed(filter, limit).fetch_all(&self.database).await?;
        rows.into_iter().map(Orientation::try_from).collect()
    }

    /// Begins an attempt at a queued orientation in a process; `None` if it does not wait any more.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn begin_attempt(&self, claim: Claim, worker: Uuid) -> Result<Option<Orientation>, StoreError> {
        let sql = format!(
            "UPDATE orientations SET status = 'running', attempts = attempts + 1, lease = $1, worker = $2,
             lease_until_ms = {} + $3, started_at = $4, stage = NULL, progress = 0
             WHERE id = $5 AND status = 'queued' RETURNING *",
            self.database.dialect(CLOCK)
        );
        let row: Option<Row> = query(AssertSqlSafe(sql))
            .bind(claim.lease)
            .bind(worker)
            .bind(lease_ms())
            .bind(now())
            .bind(claim.id)
            .fetch_optional(&self.database)
            .await?;
        row.map(Orientation::try_from).transpose()
    }

    /// Notes how far an attempt is, and that it goes on; `false` if it is nobody's any more.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn note_progress(&self, claim: Claim, stage: &str, progress: f64) -> Result<bool, StoreError> {
        let sql = format!(
            "UPDATE orientations SET stage = $1, progress = $2, lease_until_ms = {} + $3
             WHERE id = $4 AND status = 'running' AND lease = $5",
            self.database.dialect(CLOCK)
        );
        let noted = query(AssertSqlSafe(sql)).bind(stage).bind(progress).bind(lease_ms()).bind(claim.id);
        Ok(noted.bind(claim.lease).execute(&self.database).await? == 1)
    }

    /// Whether an attempt is still its holder's.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn holds(&self, claim: Claim) -> Result<bool, StoreError> {
        let held =
            query("SELECT EXISTS (SELECT 1 FROM orientations WHERE id = $1 AND status = 'running' AND lease = $2)");
        Ok(held.bind(claim.id).bind(claim.lease).fetch_value(&self.database).await?)
    }

    /// How many orientations wait for their turn.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn queued(&self) -> Result<u32, StoreError> {
        queued(&self.database).await
    }

    /// Whether the lease of any attempt has run out.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn any_late(&self) -> Result<bool, StoreError> {
        let late = format!(
            "SELECT EXISTS (SELECT 1 FROM orientations WHERE status = 'running' AND lease_until_ms < {})",
            self.database.dialect(CLOCK)
        );
        Ok(query(AssertSqlSafe(late)).fetch_value(&self.database).await?)
    }

    /// How long the one that has waited longest has waited; none if none waits.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn oldest_wait(&self) -> Result<Option<Duration>, StoreError> {
        let oldest = query("SELECT min(created_at) FROM orientations WHERE status = 'queued'");
        let oldest: Option<DateTime<Utc>> = oldest.fetch_value(&self.database).await?;
        Ok(oldest.map(|oldest| (now() - oldest).to_std().unwrap_or_default()))
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
             finished_at = $5, lease = NULL WHERE id = $6 AND status = 'running' AND lease = $7",
        )
        .bind(&finished.verdict)
        .bind(&finished.result)
        .bind(&finished.drawing)
        .bind(&finished.record)
        .bind(finished_at)
        .bind(claim.id)
        .bind(claim.lease)
        .execute(&mut transaction)
        .await?;
        let written = done == 1;
        if written {
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

fn listed(filter: &Filter, limit: u32) -> Query {
    query(
        "SELECT id, image_id, camera_id, prepared, status, stage, progress, attempts, error_code, error, verdict,
         CAST(NULL AS TEXT) AS result, CAST(NULL AS TEXT) AS drawing, created_at, started_at, finished_at,
         fate, priority, turn FROM orientations WHERE TRUE",
    )
    .and("status = ?", filter.status.map(Status::name))
    .and("verdict = ?", filter.verdict.as_deref())
    .and("image_id = ?", filter.image_id)
    .and("created_at >= ?", filter.since)
    .and("id < ?", filter.before)
    .then(" ORDER BY id DESC LIMIT ?")
    .bind(limit)
}

/// Puts an orientation back into the queue. `counted`: the attempt counts against the limit (it failed, rather than
/// having been interrupted); `false` if the lease is not valid any more.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn release(transaction: &mut Transaction, claim: Claim, counted: bool) -> Result<bool, StoreError> {
    let done = query(
        "UPDATE orientations SET status = 'queued', lease = NULL, worker = NULL, attempts = attempts - $1
         WHERE id = $2 AND status = 'running' AND lease = $3",
    )
    .bind(i64::from(!counted))
    .bind(claim.id)
    .bind(claim.lease)
    .execute(transaction)
    .await?;
    Ok(done == 1)
}

fn lease_ms() -> i64 {
    i64::try_from(LEASE.as_millis()).unwrap_or(i64::MAX)
}

#[cfg(test)]
pub(crate) mod million;
#[cfg(test)]
mod tests;
