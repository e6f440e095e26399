//! Answers to requests that carried an `Idempotency-Key`, so that the same request sent again gets the same answer.

use std::time::Duration;

use chrono::{DateTime, TimeDelta, Utc};
use sqlx::FromRow;
use uuid::Uuid;

use super::{Store, StoreError, now};
use crate::database::query;

/// An answer as it was first given.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer {
    /// SHA-256 of the request that it answered.
    pub fingerprint: [u8; 32],
    /// HTTP status.
    pub status: u16,
    /// Header `Content-Type`.
    pub content_type: Option<String>,
    /// Header `Location`.
    pub location: Option<String>,
    /// Its body.
    pub body: Vec<u8>,
}

/// What is known of an idempotency key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Claim {
    /// It is new, or its first request died with the service: go on, and give what is made this id. After a crash it is
    /// the id that the first request used, so that what that one did manage to make is found and not made twice.
    Granted {
        /// UUIDv7.
        resource_id: Uuid,
    },
    /// Another request with this key is being answered.
    UnderWay,
    /// It was answered.
    Answered(Answer),
}

#[derive(FromRow)]
struct Row {
    resource_id: Uuid,
    abandoned: bool,
    created_at: DateTime<Utc>,
    fingerprint: Option<Vec<u8>>,
    status: Option<i64>,
    content_type: Option<String>,
    location: Option<String>,
    body: Option<Vec<u8>>,
}

/// A request that is still being answered after so long died with its service.
const ABANDONED_AFTER: TimeDelta = TimeDelta::hours(1);

impl Store {
    /// Claims an idempotency key of a credential; keys older than `kept` are forgotten.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn claim_idempotency(&self, credential: &str, key: &str, kept: Duration) -> Result<Claim, StoreError> {
        let mut transaction = self.begin_write().await?;
        let oldest: DateTime<Utc> = now() - kept;
        query("DELETE FROM idempotency WHERE created_at < $1").bind(oldest).execute(&mut transaction).await?;
        let row: Option<Row> = query("SELECT * FROM idempotency WHERE credential = $1 AND key = $2")
            .bind(credential)
            .bind(key)
            .fetch_optional(&mut transaction)
            .await?;
        let claim = match row {
            None => {
                let resource_id = Uuid::now_v7();
                query("INSERT INTO idempotency (credential, key, resource_id, created_at) VALUES ($1, $2, $3, $4)")
                    .bind(credential)
                    .bind(key)
                    .bind(resource_id)
                    .bind(now())
                    .execute(&mut transaction)
                    .await?;
                Claim::Granted { resource_id }
            }
            Some(Row { abandoned, resource_id, status: None, created_at, .. })
                if abandoned || created_at < now() - ABANDONED_AFTER =>
            {
                query("UPDATE idempotency SET abandoned = FALSE WHERE credential = $1 AND key = $2")
                    .bind(credential)
                    .bind(key)
                    .execute(&mut transaction)
                    .await?;
                Claim::Granted { resource_id }
            }
            Some(Row { status: Some(status), fingerprint, content_type, location, body, .. }) => {
                let fingerprint = fingerprint.unwrap_or_default().try_into();
                Claim::Answered(Answer {
                    fingerprint: fingerprint
                        .map_err(|_| StoreError::Unknown { what: "fingerprint of", value: key.to_owned() })?,
                    status: u16::try_from(status)
                        .map_err(|_| StoreError::Unknown { what: "status", value: status.to_string() })?,
                    content_type,
                    location,
                    body: body.unwrap_or_default(),
                })
            }
            Some(_) => Claim::UnderWay,
        };
        transaction.commit().await?;
        Ok(claim)
    }

    /// Keeps the answer to a claimed key.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn settle_idempotency(&self, credential: &str, key: &str, answer: &Answer) -> Result<(), StoreError> {
        query(
            "UPDATE idempotency SET fingerprint = $1, status = $2, content_type = $3, location = $4, body = $5
             WHERE credential = $6 AND key = $7",
        )
        .bind(answer.fingerprint.as_slice())
        .bind(answer.status)
        .bind(&answer.content_type)
        .bind(&answer.location)
        .bind(&answer.body)
        .bind(credential)
        .bind(key)
        .execute(&self.database)
        .await?;
        Ok(())
    }

    /// Gives a claimed key back without an answer: the next request with it is tried afresh.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn release_idempotency(&self, credential: &str, key: &str) -> Result<(), StoreError> {
        query("UPDATE idempotency SET abandoned = TRUE WHERE credential = $1 AND key = $2 AND status IS NULL")
            .bind(credential)
            .bind(key)
            .execute(&self.database)
            .await?;
        Ok(())
    }

    /// At the start of the service: whatever was under way died with the last one.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn release_all_idempotency(&self) -> Result<(), StoreError> {
        query("UPDATE idempotency SET abandoned = TRUE WHERE status IS NULL").execute(&self.database).await?;
        Ok(())
    }
}
