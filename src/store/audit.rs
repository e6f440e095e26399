//! The audit log: who has changed what, and what was refused. Rows are added and never changed; each one's hash covers
//! its content and the hash of the row before, so that a row that was changed, or taken out of the middle, is found.
//!
//! The last rows can be cut off unseen: who wants to know of that keeps the hash that `gable audit verify` prints.

use chrono::{DateTime, SecondsFormat, Utc};
use sha2::{Digest as _, Sha256};
use sqlx::FromRow;

use super::{Store, StoreError, now};
use crate::database::query;

/// Rows read at a time while the chain is checked.
const AT_A_TIME: u32 = 1000;

/// What is to be noted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewEntry {
    /// The id of a key, `account:` and a name, `loopback`, `command line` or `nobody`.
    pub who: String,
    /// Method and route, or the command.
    pub action: String,
    /// What it was done to.
    pub object: String,
    /// The HTTP status; 0 of a command.
    pub status: u16,
    /// The request's id, as in the log; empty of a command.
    pub request_id: String,
}

/// A row of the log.
#[derive(Debug, Clone, PartialEq, Eq, FromRow)]
pub struct Entry {
    /// 1, 2, 3, without gaps.
    pub number: i64,
    /// When it was noted.
    pub at: DateTime<Utc>,
    /// Who did it.
    pub who: String,
    /// Method and route, or the command.
    pub action: String,
    /// What it was done to.
    pub object: String,
    /// The HTTP status; 0 of a command.
    #[sqlx(try_from = "i64")]
    pub status: u16,
    /// The request's id.
    pub request_id: String,
    /// Of the hash before and of this row.
    pub sha256: Vec<u8>,
}

/// What the check of the chain has found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verified {
    /// Every row is as it was noted.
    Whole {
        /// How many there are.
        rows: i64,
        /// Of the last one.
        sha256: Vec<u8>,
    },
    /// The first row that is not what was noted, or that is missing.
    Broken {
        /// Its number.
        number: i64,
    },
}

impl Entry {
    /// The hash that it must have after a row with the hash `before`: of that, and of its content as a JSON array.
    fn hash(&self, before: &[u8]) -> Vec<u8> {
        let at = self.at.to_rfc3339_opts(SecondsFormat::Micros, true);
        let content =
            serde_json::json!([self.number, at, self.who, self.action, self.object, self.status, self.request_id]);
        Sha256::new().chain_update(before).chain_update(content.to_string()).finalize().to_vec()
    }
}

/// The hash before the first row.
fn nothing() -> Vec<u8> {
    vec![0; 32]
}

impl Store {
    /// Adds a row. One at a time is added, also by several processes.
    ///
    /// # Errors
    /// [`StoreError::Database`]; then nothing is noted.
    pub async fn note(&self, new: NewEntry) -> Result<(), StoreError> {
        let mut transaction = self.begin_write().await?;
        let last: Option<(i64, Vec<u8>)> = query("SELECT number, sha256 FROM audit ORDER BY number DESC LIMIT 1")
            .fetch_optional(&mut transaction)
            .await?;
        let (number, before) = last.unwrap_or_else(|| (0, nothing()));
        let NewEntry { who, action, object, status, request_id } = new;
        let sha256 = Vec::new();
        let mut entry = Entry { number: number + 1, at: now(), who, action, object, status, request_id, sha256 };
        entry.sha256 = entry.hash(&before);
        query(
            "INSERT INTO audit (number, at, who, action, object, status, request_id, sha256)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8)",
        )
        .bind(entry.number)
        .bind(entry.at)
        .bind(entry.who)
        .bind(entry.action)
        .bind(entry.object)
        .bind(entry.status)
        .bind(entry.request_id)
        .bind(entry.sha256)
        .execute(&mut transaction)
        .await?;
        Ok(transaction.commit().await?)
    }

    /// At most `limit` rows, the newest first.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn audit(
        &self,
        since: Option<DateTime<Utc>>,
        who: Option<&str>,
        before: Option<i64>,
        limit: u32,
    ) -> Result<Vec<Entry>, StoreError> {
        let rows = query("SELECT * FROM audit WHERE TRUE")
            .and("at >= ?", since)
            .and("who = ?", who)
            .and("number < ?", before)
            .then(" ORDER BY number DESC LIMIT ?")
            .bind(limit);
        Ok(rows.fetch_all(&self.database).await?)
    }

    /// Checks the hashes of all rows.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn verify_audit(&self) -> Result<Verified, StoreError> {
        let (mut rows, mut sha256) = (0, nothing());
        loop {
            let next = query("SELECT * FROM audit WHERE number > $1 ORDER BY number LIMIT $2");
            let next: Vec<Entry> = next.bind(rows).bind(AT_A_TIME).fetch_all(&self.database).await?;
            if next.is_empty() {
                return Ok(Verified::Whole { rows, sha256 });
            }
            for entry in next {
                rows += 1;
                if entry.number != rows || entry.sha256 != entry.hash(&sha256) {
                    return Ok(Verified::Broken { number: rows });
                }
                sha256 = entry.sha256;
            }
        }
    }
}
