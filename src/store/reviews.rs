//! What staff decide of orientations. A decision is a label: what is accepted becomes the reference of its image, and what
//! is rejected is known to be wrong.

use chrono::{DateTime, Utc};
use sqlx::FromRow;
use uuid::Uuid;

use super::orientations::Status;
use super::references::{self, ReferenceOrientation};
use super::{Store, StoreError, now};
use crate::database::query;

/// What was decided.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decision {
    /// The orientation, corrected or not, is right.
    Accepted,
    /// It is wrong.
    Rejected,
}

impl Decision {
    /// Its word in the contract.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Rejected => "rejected",
        }
    }
}

/// A decision to keep.
#[derive(Debug, Clone, PartialEq)]
pub struct NewReview {
    /// UUIDv7.
    pub id: Uuid,
    /// Of which orientation.
    pub orientation_id: Uuid,
    /// What was decided.
    pub decision: Decision,
    /// Why; may be empty.
    pub why: String,
    /// Who, as in the audit log.
    pub who: String,
    /// The correction, with what came out.
    pub corrected: Option<Corrected>,
    /// Where the camera was, if that is known now.
    pub reference: Option<ReferenceOrientation>,
}

/// A correction as JSON that this room does not look into.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Corrected {
    /// Control points that were switched off or moved.
    pub correction: String,
    /// What that leads to.
    pub result: String,
    /// What there is to see of that.
    pub drawing: String,
}

/// A decision that was kept.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Review {
    /// UUIDv7.
    pub id: Uuid,
    /// `accepted` or `rejected`.
    pub decision: String,
    /// Why; may be empty.
    pub why: String,
    /// Who, as in the audit log.
    pub who: String,
    /// The correction, as JSON.
    pub correction: Option<String>,
    /// What that led to, as JSON.
    pub result: Option<String>,
    /// When.
    pub created_at: DateTime<Utc>,
}

impl Store {
    /// Keeps a decision; `None` if the orientation is not there, or has not succeeded.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn add_review(&self, review: &NewReview) -> Result<Option<DateTime<Utc>>, StoreError> {
        let mut transaction = self.begin_write().await?;
        let decided = query("UPDATE orientations SET review = $1 WHERE id = $2 AND status = $3")
            .bind(review.decision.name())
            .bind(review.orientation_id)
            .bind(Status::Succeeded.name())
            .execute(&mut transaction)
            .await?;
        if decided == 0 {
            return Ok(None);
        }
        let created_at = now();
        let corrected = review.corrected.as_ref();
        query(
            "INSERT INTO reviews (id, orientation_id, decision, why, who, correction, result, drawing, created_at)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9)",
        )
        .bind(review.id)
        .bind(review.orientation_id)
        .bind(review.decision.name())
        .bind(&review.why)
        .bind(&review.who)
        .bind(corrected.map(|c| c.correction.as_str()))
        .bind(corrected.map(|c| c.result.as_str()))
        .bind(corrected.map(|c| c.drawing.as_str()))
        .bind(created_at)
        .execute(&mut transaction)
        .await?;
        references::replace_reviewed(&mut transaction, review.orientation_id, review.reference.as_ref()).await?;
        transaction.commit().await?;
        Ok(Some(created_at))
    }

    /// The decisions of an orientation, the newest first, at most `limit` with smaller ids than `before`.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn reviews(
        &self,
        orientation_id: Uuid,
        before: Option<Uuid>,
        limit: u32,
    ) -> Result<Vec<Review>, StoreError> {
        let sql = "SELECT id, decision, why, who, correction, result, created_at FROM reviews
                   WHERE orientation_id = $1 AND id < $2 ORDER BY id DESC LIMIT $3";
        let before = before.unwrap_or(Uuid::max());
        Ok(query(sql).bind(orientation_id).bind(before).bind(limit).fetch_all(&self.database).await?)
    }
}
