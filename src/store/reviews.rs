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

#[cfg(test)]
mod tests {
    use super::super::references::given_now;
    use super::super::references::tests::Bench;
    use super::*;

    fn review(orientation_id: Uuid, decision: Decision, reference: Option<ReferenceOrientation>) -> NewReview {
        NewReview {
            id: Uuid::now_v7(),
            orientation_id,
            decision,
            why: "roof was rebuilt".to_owned(),
            who: "account:anna".to_owned(),
            corrected: None,
            reference,
        }
    }

    fn reference(image_id: Uuid, x_m: f64) -> ReferenceOrientation {
        given_now(image_id, "reviewed".to_owned(), [x_m, 2.0, 3.0], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    }

    async fn references(bench: &Bench) -> Vec<f64> {
        let references = bench.store.references(None, 10).await.unwrap();
        references.iter().map(|reference| reference.centre_geocentric_m[0]).collect()
    }

    #[tokio::test]
    async fn decisions_are_kept_one_by_one_and_the_latest_counts() {
        let bench = Bench::new().await;
        let image = bench.image().await;
        let id = bench.finished(image, "{}", &[]).await;
        let corrected = Corrected { correction: "{}".into(), result: "{\"a\":1}".into(), drawing: "{}".into() };
        let first = NewReview { corrected: Some(corrected), ..review(id, Decision::Accepted, None) };
        let second = review(id, Decision::Rejected, None);
        for review in [&first, &second] {
            assert!(bench.store.add_review(review).await.unwrap().is_some());
        }
        let kept = bench.store.reviews(id, None, 10).await.unwrap();
        let told: Vec<_> = kept.iter().map(|r| (r.id, r.decision.as_str(), r.result.as_deref())).collect();
        assert_eq!(told, [(second.id, "rejected", None), (first.id, "accepted", Some("{\"a\":1}"))]);
        assert_eq!((kept[0].why.as_str(), kept[0].who.as_str()), ("roof was rebuilt", "account:anna"));
        assert_eq!(bench.store.reviews(id, Some(second.id), 10).await.unwrap(), kept[1..]);
        assert_eq!(bench.store.orientation(id).await.unwrap().unwrap().review.as_deref(), Some("rejected"));
        // with the orientation they go
        bench.store.forget_orientation(id).await.unwrap();
        assert_eq!(bench.store.reviews(id, None, 10).await.unwrap(), []);
    }

    #[tokio::test]
    async fn what_has_no_result_cannot_be_decided() {
        let bench = Bench::new().await;
        let waiting = bench.queued(bench.image().await).await;
        for id in [waiting, Uuid::now_v7()] {
            assert_eq!(bench.store.add_review(&review(id, Decision::Rejected, None)).await.unwrap(), None);
            assert_eq!(bench.store.reviews(id, None, 10).await.unwrap(), []);
        }
    }

    #[tokio::test]
    async fn a_decision_gives_the_reference_of_its_image_until_another_one_takes_it_back() {
        let bench = Bench::new().await;
        let image = bench.image().await;
        let (first, second) = (bench.finished(image, "{}", &[]).await, bench.finished(image, "{}", &[]).await);
        let decide = async |id, decision, x_m: Option<f64>| {
            let reference = x_m.map(|x_m| reference(image, x_m));
            bench.store.add_review(&review(id, decision, reference)).await.unwrap().unwrap();
        };
        decide(first, Decision::Accepted, Some(1.0)).await;
        assert_eq!(references(&bench).await, [1.0]);
        decide(second, Decision::Accepted, Some(2.0)).await;
        assert_eq!(references(&bench).await, [2.0]);
        // it is not of this one any more
        decide(first, Decision::Rejected, None).await;
        assert_eq!(references(&bench).await, [2.0]);
        decide(second, Decision::Rejected, None).await;
        assert_eq!(references(&bench).await, [] as [f64; 0]);
    }

    #[tokio::test]
    async fn a_reference_from_outside_is_stronger_than_any_decision() {
        let bench = Bench::new().await;
        let image = bench.image().await;
        let id = bench.finished(image, "{}", &[]).await;
        bench.store.add_review(&review(id, Decision::Accepted, Some(reference(image, 1.0)))).await.unwrap();
        bench.store.put_references(&[reference(image, 9.0)]).await.unwrap();
        for decision in [Decision::Accepted, Decision::Rejected] {
            bench.store.add_review(&review(id, decision, Some(reference(image, 1.0)))).await.unwrap();
            assert_eq!(references(&bench).await, [9.0]);
        }
    }

    #[tokio::test]
    async fn what_was_rejected_is_found_unless_its_image_has_a_reference() {
        let bench = Bench::new().await;
        let (image, known) = (bench.image().await, bench.image().await);
        let (wrong, fine) = (bench.finished(image, "1", &[]).await, bench.finished(image, "2", &[]).await);
        let of_known = bench.finished(known, "3", &[]).await;
        bench.store.put_references(&[reference(known, 9.0)]).await.unwrap();
        for id in [wrong, of_known] {
            bench.store.add_review(&review(id, Decision::Rejected, None)).await.unwrap();
        }
        let found = bench.store.rejected_records(Uuid::nil(), 10).await.unwrap();
        let told: Vec<_> = found.iter().map(|row| (row.orientation_id, row.record.as_str())).collect();
        assert_eq!(told, [(wrong, "1")]);
        assert_eq!(bench.store.rejected_records(wrong, 10).await.unwrap(), []);
        // the same image, accepted in another orientation: that one tells what is right
        bench.store.add_review(&review(fine, Decision::Accepted, Some(reference(image, 1.0)))).await.unwrap();
        assert_eq!(bench.store.rejected_records(Uuid::nil(), 10).await.unwrap(), []);
    }
}
