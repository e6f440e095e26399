//! Reference orientations of images: where the camera truly was, from a bundle adjustment.

use chrono::{DateTime, Utc};
use sqlx::FromRow;
use uuid::Uuid;

use super::{Store, StoreError, now};

/// The reference orientation of an image. Geocentric: it serves every local frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceOrientation {
    /// The image.
    pub image_id: Uuid,
    /// The block or flight.
    pub area: String,
    /// The projection centre.
    pub centre_geocentric_m: [f64; 3],
    /// Camera from geocentric, row by row.
    pub camera_from_geocentric: [f64; 9],
    /// When it was given.
    pub updated_at: DateTime<Utc>,
}

#[derive(FromRow)]
struct Row {
    image_id: Uuid,
    area: String,
    centre_x_m: f64,
    centre_y_m: f64,
    centre_z_m: f64,
    rotation: Vec<u8>,
    updated_at: DateTime<Utc>,
}

impl TryFrom<Row> for ReferenceOrientation {
    type Error = StoreError;

    fn try_from(row: Row) -> Result<Self, StoreError> {
        let (numbers, _) = row.rotation.as_chunks::<8>();
        let numbers: Vec<f64> = numbers.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
        let unknown = || StoreError::Unknown { what: "rotation of a reference", value: row.image_id.to_string() };
        Ok(Self {
            image_id: row.image_id,
            area: row.area,
            centre_geocentric_m: [row.centre_x_m, row.centre_y_m, row.centre_z_m],
            camera_from_geocentric: numbers.try_into().map_err(|_| unknown())?,
            updated_at: row.updated_at,
        })
    }
}

/// What storing references did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StoredReferences {
    /// Images that had none.
    pub added: usize,
    /// Images whose reference was replaced.
    pub updated: usize,
}

impl Store {
    /// Stores references, all or none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn put_references(&self, references: &[ReferenceOrientation]) -> Result<StoredReferences, StoreError> {
        let mut transaction = self.begin_write().await?;
        let mut stored = StoredReferences::default();
        for reference in references {
            let there: Option<i64> = sqlx::query_scalar("SELECT 1 FROM reference_orientations WHERE image_id = ?")
                .bind(reference.image_id)
                .fetch_optional(&mut *transaction)
                .await?;
            let rotation: Vec<u8> = reference.camera_from_geocentric.iter().flat_map(|v| v.to_le_bytes()).collect();
            let [x, y, z] = reference.centre_geocentric_m;
            sqlx::query(
                "INSERT INTO reference_orientations
                 (image_id, area, centre_x_m, centre_y_m, centre_z_m, rotation, updated_at) VALUES (?, ?, ?, ?, ?, ?, ?)
                 ON CONFLICT (image_id) DO UPDATE SET area = excluded.area, centre_x_m = excluded.centre_x_m,
                 centre_y_m = excluded.centre_y_m, centre_z_m = excluded.centre_z_m, rotation = excluded.rotation,
                 updated_at = excluded.updated_at",
            )
            .bind(reference.image_id)
            .bind(&reference.area)
            .bind(x)
            .bind(y)
            .bind(z)
            .bind(rotation)
            .bind(reference.updated_at)
            .execute(&mut *transaction)
            .await?;
            if there.is_some() {
                stored.updated += 1;
            } else {
                stored.added += 1;
            }
        }
        transaction.commit().await?;
        Ok(stored)
    }

    /// At most `limit` references, of images with smaller ids than `before`, the newest images first.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn references(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<ReferenceOrientation>, StoreError> {
        let rows: Vec<Row> =
            sqlx::query_as("SELECT * FROM reference_orientations WHERE image_id < ? ORDER BY image_id DESC LIMIT ?")
                .bind(before.unwrap_or(Uuid::max()))
                .bind(limit)
                .fetch_all(&self.pool)
                .await?;
        rows.into_iter().map(ReferenceOrientation::try_from).collect()
    }

    /// Removes the reference of an image; `false` if there is none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn remove_reference(&self, image_id: Uuid) -> Result<bool, StoreError> {
        let done = sqlx::query("DELETE FROM reference_orientations WHERE image_id = ?")
            .bind(image_id)
            .execute(&self.pool)
            .await?;
        Ok(done.rows_affected() == 1)
    }

    /// The orientations that have a record and whose image has a reference, each with its prepared request, record and
    /// camera; one page of those with larger ids than `after`, in their order.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn referenced_records(&self, after: Uuid, limit: u32) -> Result<Vec<ReferencedRecord>, StoreError> {
        let rows: Vec<RecordRow> = sqlx::query_as(
            "SELECT orientations.id, camera_id, prepared, record, reference_orientations.*
             FROM orientations JOIN reference_orientations USING (image_id)
             WHERE record IS NOT NULL AND orientations.id > ? ORDER BY orientations.id LIMIT ?",
        )
        .bind(after)
        .bind(limit)
        .fetch_all(&self.pool)
        .await?;
        let record = |row: RecordRow| {
            Ok(ReferencedRecord {
                orientation_id: row.id,
                camera_id: row.camera_id,
                prepared: row.prepared,
                record: row.record,
                reference: row.reference.try_into()?,
            })
        };
        rows.into_iter().map(record).collect()
    }

    /// The records of the latest orientations, the newest first, at most `limit`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn latest_records(&self, limit: u32) -> Result<Vec<String>, StoreError> {
        let query = "SELECT record FROM orientations WHERE record IS NOT NULL ORDER BY id DESC LIMIT ?";
        Ok(sqlx::query_scalar(query).bind(limit).fetch_all(&self.pool).await?)
    }
}

#[derive(FromRow)]
struct RecordRow {
    id: Uuid,
    camera_id: Uuid,
    prepared: String,
    record: String,
    #[sqlx(flatten)]
    reference: Row,
}

/// An orientation whose image has a reference.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencedRecord {
    /// The orientation.
    pub orientation_id: Uuid,
    /// Its camera.
    pub camera_id: Uuid,
    /// The request with everything filled in.
    pub prepared: String,
    /// What its verdict rested on.
    pub record: String,
    /// Where the camera truly was.
    pub reference: ReferenceOrientation,
}

/// A reference given now.
#[must_use]
pub fn given_now(
    image_id: Uuid,
    area: String,
    centre_geocentric_m: [f64; 3],
    camera_from_geocentric: [f64; 9],
) -> ReferenceOrientation {
    ReferenceOrientation { image_id, area, centre_geocentric_m, camera_from_geocentric, updated_at: now() }
}
