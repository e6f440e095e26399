//! What became of the control points that accepted images should show.

use std::collections::HashMap;

use chrono::{DateTime, Utc};
use sqlx::{AssertSqlSafe, FromRow};
use uuid::Uuid;

use super::{Store, StoreError};
use crate::database::{TEXTS, Transaction, query};

/// What an accepted image says of a control point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sighting {
    /// It was found where it is expected.
    Found,
    /// It is in view, and nothing was found of it.
    Missed,
    /// It was found, but not where all others expect it.
    Contradicts,
}

impl Sighting {
    fn name(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::Missed => "missed",
            Self::Contradicts => "contradicts",
        }
    }
}

/// Counts of sightings of a control point. Of several orientations of one image the last one counts.
#[derive(Debug, Clone, Default, PartialEq, FromRow)]
pub struct SightingCounts {
    /// Images in which it was found.
    #[sqlx(try_from = "i64")]
    pub found: u32,
    /// Images in which it was not.
    #[sqlx(try_from = "i64")]
    pub missed: u32,
    /// Images in which it contradicts the others.
    #[sqlx(try_from = "i64")]
    pub contradicts: u32,
    /// When it was last found.
    pub last_found_at: Option<DateTime<Utc>>,
    /// When it was last missed or contradicted.
    pub last_failed_at: Option<DateTime<Utc>>,
}

/// Notes the sightings of an accepted image.
pub(super) async fn note(
    transaction: &mut Transaction,
    orientation_id: Uuid,
    seen_at: DateTime<Utc>,
    sightings: &[(String, Sighting)],
) -> Result<(), StoreError> {
    for (control_point, sighting) in sightings {
        query(
            "INSERT INTO sightings (control_point, orientation_id, image_id, outcome, seen_at)
             SELECT $1, id, image_id, $2, $3 FROM orientations WHERE id = $4 ON CONFLICT DO NOTHING",
        )
        .bind(control_point)
        .bind(sighting.name())
        .bind(seen_at)
        .bind(orientation_id)
        .execute(&mut *transaction)
        .await?;
    }
    Ok(())
}

/// The columns of [`SightingCounts`].
const COUNTS: &str = "count(*) FILTER (WHERE outcome = 'found') AS found,
     count(*) FILTER (WHERE outcome = 'missed') AS missed,
     count(*) FILTER (WHERE outcome = 'contradicts') AS contradicts,
     max(seen_at) FILTER (WHERE outcome = 'found') AS last_found_at,
     max(seen_at) FILTER (WHERE outcome <> 'found') AS last_failed_at";

impl Store {
    /// What accepted images say of a control point.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn sightings(&self, control_point: &str) -> Result<SightingCounts, StoreError> {
        // of several orientations of one image only the last
        let sql = format!(
            "SELECT {COUNTS}
             FROM (SELECT outcome, seen_at,
                       row_number() OVER (PARTITION BY image_id ORDER BY seen_at DESC, orientation_id DESC) AS place
                   FROM sightings WHERE control_point = $1) AS told WHERE place = 1"
        );
        Ok(query(AssertSqlSafe(sql)).bind(control_point).fetch_one(&self.database).await?)
    }

    /// What accepted images say of each of these control points; those that none should show are left out.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn sightings_of(&self, control_points: &[&str]) -> Result<HashMap<String, SightingCounts>, StoreError> {
        #[derive(FromRow)]
        struct Row {
            control_point: String,
            #[sqlx(flatten)]
            counts: SightingCounts,
        }
        let sql = format!(
            "SELECT control_point, {COUNTS}
             FROM (SELECT control_point, outcome, seen_at,
                       row_number() OVER (PARTITION BY control_point, image_id ORDER BY seen_at DESC, orientation_id DESC)
                           AS place
                   FROM sightings WHERE control_point IN {}) AS told WHERE place = 1 GROUP BY control_point",
            self.database.dialect(TEXTS)
        );
        let names = serde_json::json!(control_points).to_string();
        let rows: Vec<Row> = query(AssertSqlSafe(sql)).bind(names).fetch_all(&self.database).await?;
        Ok(rows.into_iter().map(|row| (row.control_point, row.counts)).collect())
    }

    /// The share of the latest sightings in which a control point was found where it is expected; `None` without any.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn found_share(&self) -> Result<Option<f64>, StoreError> {
        let share = query(
            "SELECT CAST(avg(found) AS DOUBLE PRECISION) FROM
             (SELECT CASE WHEN outcome = 'found' THEN 1.0 ELSE 0.0 END AS found
              FROM sightings ORDER BY orientation_id DESC LIMIT 10000) AS latest",
        );
        Ok(share.fetch_value(&self.database).await?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::orientations::Claim;
    use crate::store::references::tests::{Bench, finished};

    async fn counts(bench: &Bench, control_point: &str) -> [u32; 3] {
        let SightingCounts { found, missed, contradicts, .. } = bench.store.sightings(control_point).await.unwrap();
        [found, missed, contradicts]
    }

    #[tokio::test]
    async fn sightings_are_counted_by_what_became_of_them() {
        let bench = Bench::new().await;
        for (church, barn) in [
            (Sighting::Found, Sighting::Missed),
            (Sighting::Found, Sighting::Missed),
            (Sighting::Contradicts, Sighting::Missed),
            (Sighting::Found, Sighting::Found),
        ] {
            bench.finished(bench.image().await, "{}", &[("church", church), ("barn", barn)]).await;
        }
        assert_eq!(counts(&bench, "church").await, [3, 0, 1]);
        assert_eq!(counts(&bench, "barn").await, [1, 3, 0]);
        assert_eq!(bench.store.sightings("mill").await.unwrap(), SightingCounts::default());
        assert_eq!(bench.store.found_share().await.unwrap(), Some(0.5));
    }

    #[tokio::test]
    async fn of_several_orientations_of_an_image_the_last_counts() {
        let bench = Bench::new().await;
        let image = bench.image().await;
        let first = bench.finished(image, "{}", &[("church", Sighting::Missed), ("barn", Sighting::Found)]).await;
        let other = bench.finished(bench.image().await, "{}", &[("church", Sighting::Missed)]).await;
        let last = bench.finished(image, "{}", &[("church", Sighting::Found)]).await;
        assert_eq!(counts(&bench, "church").await, [1, 1, 0]);
        assert_eq!(counts(&bench, "barn").await, [1, 0, 0]);
        let finished_at = async |id| bench.store.orientation(id).await.unwrap().unwrap().finished_at;
        let church = bench.store.sightings("church").await.unwrap();
        assert_eq!((church.last_found_at, church.last_failed_at), (finished_at(last).await, finished_at(other).await));
        let barn = bench.store.sightings("barn").await.unwrap();
        assert_eq!((barn.last_found_at, barn.last_failed_at), (finished_at(first).await, None));
        // several at once
        let all = bench.store.sightings_of(&["church", "barn", "mill", "o'clock \""]).await.unwrap();
        assert_eq!(all, HashMap::from([("church".to_owned(), church), ("barn".to_owned(), barn)]));
        assert_eq!(bench.store.sightings_of(&[]).await.unwrap(), HashMap::new());
    }

    #[tokio::test]
    async fn who_comes_too_late_has_seen_nothing() {
        let bench = Bench::new().await;
        let id = bench.queued(bench.image().await).await;
        let claim = Claim { id, lease: Uuid::now_v7() };
        bench.store.begin_attempt(claim, Uuid::nil()).await.unwrap().unwrap();
        let late = finished("{}", &[("church", Sighting::Found)]);
        assert!(!bench.store.finish(Claim { lease: Uuid::now_v7(), ..claim }, &late).await.unwrap());
        assert_eq!(counts(&bench, "church").await, [0, 0, 0]);
        assert_eq!(bench.store.found_share().await.unwrap(), None);
        assert!(bench.store.finish(claim, &late).await.unwrap());
        assert_eq!(counts(&bench, "church").await, [1, 0, 0]);
    }
}
