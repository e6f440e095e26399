//! What became of the control points that accepted images should show.

use chrono::{DateTime, Utc};
use sqlx::{FromRow, Sqlite, Transaction};
use uuid::Uuid;

use super::{Store, StoreError};

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
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct SightingCounts {
    /// Images in which it was found.
    pub found: u32,
    /// Images in which it was not.
    pub missed: u32,
    /// Images in which it contradicts the others.
    pub contradicts: u32,
    /// When it was last found.
    pub last_found_at: Option<DateTime<Utc>>,
    /// When it was last missed or contradicted.
    pub last_failed_at: Option<DateTime<Utc>>,
}

/// Notes the sightings of an accepted image.
pub(super) async fn note(
    transaction: &mut Transaction<'_, Sqlite>,
    orientation_id: Uuid,
    seen_at: DateTime<Utc>,
    sightings: &[(String, Sighting)],
) -> Result<(), StoreError> {
    for (control_point, sighting) in sightings {
        sqlx::query(
            "INSERT INTO sightings (control_point, orientation_id, image_id, outcome, seen_at)
             SELECT ?, id, image_id, ?, ? FROM orientations WHERE id = ? ON CONFLICT DO NOTHING",
        )
        .bind(control_point)
        .bind(sighting.name())
        .bind(seen_at)
        .bind(orientation_id)
        .execute(&mut **transaction)
        .await?;
    }
    Ok(())
}

/// Of several orientations of one image only the last.
const LAST_OF_EACH_IMAGE: &str = "SELECT control_point, outcome, max(seen_at) AS seen_at FROM sightings";

impl Store {
    /// What accepted images say of a control point.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn sightings(&self, control_point: &str) -> Result<SightingCounts, StoreError> {
        let query = format!(
            "SELECT count(*) FILTER (WHERE outcome = 'found') AS found,
             count(*) FILTER (WHERE outcome = 'missed') AS missed,
             count(*) FILTER (WHERE outcome = 'contradicts') AS contradicts,
             max(seen_at) FILTER (WHERE outcome = 'found') AS last_found_at,
             max(seen_at) FILTER (WHERE outcome <> 'found') AS last_failed_at
             FROM ({LAST_OF_EACH_IMAGE} WHERE control_point = ? GROUP BY image_id)"
        );
        Ok(sqlx::query_as(sqlx::AssertSqlSafe(query)).bind(control_point).fetch_one(&self.pool).await?)
    }

    /// The share of the latest sightings in which a control point was found where it is expected; `None` without any.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn found_share(&self) -> Result<Option<f64>, StoreError> {
        let query = "SELECT avg(found) FROM
             (SELECT outcome = 'found' AS found FROM sightings ORDER BY orientation_id DESC LIMIT 10000)";
        Ok(sqlx::query_scalar(query).fetch_one(&self.pool).await?)
    }
}
