//! Who waits, in which order, and whose attempts are under way.

use std::time::Duration;

use chrono::{DateTime, Utc};
use serde::{Deserialize, Serialize};
use sqlx::AssertSqlSafe;
use utoipa::ToSchema;
use uuid::Uuid;

use super::{NewOrientation, Orientation, Row};
use crate::database::{Dialects, Executor, Transaction, query};
use crate::store::{Store, StoreError, count_of, now};

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
pub(in crate::store) const CLOCK: Dialects = Dialects {
    sqlite: "CAST(unixepoch('subsec') * 1000 AS INTEGER)",
    postgres: "CAST(extract(epoch FROM clock_timestamp()) * 1000 AS BIGINT)",
};

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
