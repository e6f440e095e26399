//! Webhooks: who is to be told that an orientation has ended, and how far that is.
//!
//! The row of an event is made in the transaction that ends the orientation, and stays until it was delivered or given
//! up; then it stays as a record. Its id is that of the event, the same in every try.

use std::time::Duration;

use chrono::{DateTime, Utc};
use sqlx::{AssertSqlSafe, FromRow};
use uuid::Uuid;

use super::orientations::CLOCK;
use super::{Store, StoreError, now};
use crate::database::{Dialects, Transaction, query};

/// How long one try may take before another process takes the event up: more than all its time limits together.
const LEASE_MS: i64 = 60_000;

/// How far the telling is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Delivery {
    /// It is tried, or will be.
    Waiting,
    /// The receiver has said that it has it.
    Delivered,
    /// It was tried for too long.
    GivenUp,
}

impl Delivery {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Waiting, Self::Delivered, Self::GivenUp];

    /// Its word in the contract.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Delivered => "delivered",
            Self::GivenUp => "given_up",
        }
    }

    /// The one of a word.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|delivery| delivery.name() == name)
    }

    fn condition(self) -> &'static str {
        match self {
            Self::Waiting => " AND delivered_at IS NULL AND given_up_at IS NULL",
            Self::Delivered => " AND delivered_at IS NOT NULL",
            Self::GivenUp => " AND given_up_at IS NOT NULL",
        }
    }
}

/// An event that somebody is to be told.
#[derive(Debug, Clone, PartialEq, Eq, FromRow)]
pub struct Webhook {
    /// Of the event, UUIDv7.
    pub id: Uuid,
    /// What has ended.
    pub orientation_id: Uuid,
    /// Who is told.
    pub url: String,
    /// When it ended.
    pub created_at: DateTime<Utc>,
    /// How often it was tried.
    #[sqlx(try_from = "i64")]
    pub attempts: u32,
    /// When the receiver has said that it has it.
    pub delivered_at: Option<DateTime<Utc>>,
    /// When it was tried for too long.
    pub given_up_at: Option<DateTime<Utc>>,
    /// What went wrong in the last try.
    pub last_error: Option<String>,
}

impl Webhook {
    /// How far the telling is.
    #[must_use]
    pub fn delivery(&self) -> Delivery {
        match (self.delivered_at, self.given_up_at) {
            (Some(_), _) => Delivery::Delivered,
            (None, Some(_)) => Delivery::GivenUp,
            (None, None) => Delivery::Waiting,
        }
    }
}

/// An event whose turn it is, with what is told of it.
#[derive(Debug, Clone, PartialEq, Eq, FromRow)]
pub struct Due {
    /// Of the event.
    pub id: Uuid,
    /// What has ended.
    pub orientation_id: Uuid,
    /// Who is told.
    pub url: String,
    /// When it ended.
    pub created_at: DateTime<Utc>,
    /// How often it was tried, with this time.
    #[sqlx(try_from = "i64")]
    pub attempts: u32,
    /// For how long it is tried, milliseconds.
    pub tried_for_ms: i64,
    /// How the orientation has ended.
    pub status: String,
    /// Its verdict, if it has one.
    pub verdict: Option<String>,
    /// Its block, if it belongs to one.
    pub block: Option<Uuid>,
}

const COLUMNS: &str = "SELECT id, orientation_id, url, created_at, attempts, delivered_at, given_up_at, last_error
     FROM webhooks";

/// Other processes pass over rows that this one takes; SQLite has one writer at a time.
const SKIP_LOCKED: Dialects = Dialects { sqlite: "", postgres: " FOR UPDATE SKIP LOCKED" };

/// Notes that an orientation has ended, for whoever is to be told; nothing if nobody is.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn note_end(transaction: &mut Transaction, orientation: Uuid) -> Result<(), StoreError> {
    let clock = transaction.dialect(CLOCK);
    let sql = format!(
        "INSERT INTO webhooks (id, orientation_id, url, created_at, begun_at_ms, next_at_ms)
         SELECT $1, id, webhook, $2, {clock}, {clock} FROM orientations WHERE id = $3 AND webhook IS NOT NULL
         ON CONFLICT (orientation_id) DO NOTHING"
    );
    query(AssertSqlSafe(sql)).bind(Uuid::now_v7()).bind(now()).bind(orientation).execute(transaction).await?;
    Ok(())
}

impl Store {
    /// Takes at most `most` events whose turn it is, the longest due first. Nobody else takes them for a minute.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn take_due_webhooks(&self, most: u32) -> Result<Vec<Due>, StoreError> {
        let (clock, skip) = (self.database.dialect(CLOCK), self.database.dialect(SKIP_LOCKED));
        // looking is done often, and holds up no writer
        let any = format!(
            "SELECT EXISTS (SELECT 1 FROM webhooks
             WHERE delivered_at IS NULL AND given_up_at IS NULL AND next_at_ms <= {clock})"
        );
        if !query(AssertSqlSafe(any)).fetch_value::<bool>(&self.database).await? {
            return Ok(Vec::new());
        }
        let sql = format!(
            "UPDATE webhooks SET attempts = attempts + 1, next_at_ms = {clock} + {LEASE_MS}
             WHERE delivered_at IS NULL AND given_up_at IS NULL AND id IN
                 (SELECT id FROM webhooks WHERE delivered_at IS NULL AND given_up_at IS NULL AND next_at_ms <= {clock}
                  ORDER BY next_at_ms LIMIT $1{skip})
             RETURNING id, orientation_id, url, created_at, attempts, {clock} - begun_at_ms AS tried_for_ms,
                 (SELECT status FROM orientations WHERE orientations.id = orientation_id) AS status,
                 (SELECT verdict FROM orientations WHERE orientations.id = orientation_id) AS verdict,
                 (SELECT block_id FROM block_images WHERE block_images.orientation_id = webhooks.orientation_id) AS block"
        );
        Ok(query(AssertSqlSafe(sql)).bind(most).fetch_all(&self.database).await?)
    }

    /// Notes that the receiver has an event.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn webhook_delivered(&self, id: Uuid) -> Result<(), StoreError> {
        let update =
            query("UPDATE webhooks SET delivered_at = $1, given_up_at = NULL, last_error = NULL WHERE id = $2");
        update.bind(now()).bind(id).execute(&self.database).await?;
        Ok(())
    }

    /// Notes that a try has failed, and when the next one is due; none: it is given up. A try that was overtaken by a
    /// later one changes nothing.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn webhook_failed(&self, due: &Due, error: &str, pause: Option<Duration>) -> Result<(), StoreError> {
        let pause_ms = pause.map_or(0, |pause| i64::try_from(pause.as_millis()).unwrap_or(i64::MAX / 4));
        let sql = format!(
            "UPDATE webhooks SET last_error = $1, next_at_ms = {} + $2, given_up_at = $3
             WHERE id = $4 AND attempts = $5 AND delivered_at IS NULL AND given_up_at IS NULL",
            self.database.dialect(CLOCK)
        );
        let given_up_at = pause.is_none().then(now);
        let update = query(AssertSqlSafe(sql)).bind(error).bind(pause_ms).bind(given_up_at).bind(due.id);
        update.bind(due.attempts).execute(&self.database).await?;
        Ok(())
    }

    /// At most `limit` events, the newest first.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn webhooks(
        &self,
        delivery: Option<Delivery>,
        before: Option<Uuid>,
        limit: u32,
    ) -> Result<Vec<Webhook>, StoreError> {
        let rows = query(COLUMNS)
            .then(" WHERE TRUE")
            .then(delivery.map_or("", Delivery::condition))
            .and("id < ?", before)
            .then(" ORDER BY id DESC LIMIT ?")
            .bind(limit);
        Ok(rows.fetch_all(&self.database).await?)
    }

    /// Tells an event again from the beginning, also one that was delivered; none if there is none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn resend_webhook(&self, id: Uuid) -> Result<Option<Webhook>, StoreError> {
        let clock = self.database.dialect(CLOCK);
        let sql = format!(
            "UPDATE webhooks SET attempts = 0, begun_at_ms = {clock}, next_at_ms = {clock}, delivered_at = NULL,
             given_up_at = NULL, last_error = NULL WHERE id = $1
             RETURNING id, orientation_id, url, created_at, attempts, delivered_at, given_up_at, last_error"
        );
        Ok(query(AssertSqlSafe(sql)).bind(id).fetch_optional(&self.database).await?)
    }

    /// The secret that goes by this name; if there is none, `fresh` becomes it.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn secret(&self, name: &str, fresh: &str) -> Result<String, StoreError> {
        let insert = query("INSERT INTO secrets (name, value) VALUES ($1, $2) ON CONFLICT (name) DO NOTHING");
        insert.bind(name).bind(fresh).execute(&self.database).await?;
        Ok(query("SELECT value FROM secrets WHERE name = $1").bind(name).fetch_value(&self.database).await?)
    }
}
