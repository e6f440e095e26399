//! Reference orientations of images: where the camera truly was, from a bundle adjustment.

use chrono::{DateTime, Utc};
use sqlx::FromRow;
use uuid::Uuid;

use super::{Store, StoreError, now};
use crate::database::{Transaction, query};

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

/// Stores a reference; `by_review_of` is the orientation that staff have accepted, if they have given it so.
async fn put(
    transaction: &mut Transaction,
    reference: &ReferenceOrientation,
    by_review_of: Option<Uuid>,
) -> Result<(), StoreError> {
    let rotation: Vec<u8> = reference.camera_from_geocentric.iter().flat_map(|v| v.to_le_bytes()).collect();
    let [x, y, z] = reference.centre_geocentric_m;
    query(
        "INSERT INTO reference_orientations
         (image_id, area, centre_x_m, centre_y_m, centre_z_m, rotation, updated_at, by_review_of)
         VALUES ($1, $2, $3, $4, $5, $6, $7, $8)
         ON CONFLICT (image_id) DO UPDATE SET area = excluded.area, centre_x_m = excluded.centre_x_m,
         centre_y_m = excluded.centre_y_m, centre_z_m = excluded.centre_z_m, rotation = excluded.rotation,
         updated_at = excluded.updated_at, by_review_of = excluded.by_review_of
         WHERE excluded.by_review_of IS NULL OR reference_orientations.by_review_of IS NOT NULL",
    )
    .bind(reference.image_id)
    .bind(&reference.area)
    .bind(x)
    .bind(y)
    .bind(z)
    .bind(rotation)
    .bind(reference.updated_at)
    .bind(by_review_of)
    .execute(transaction)
    .await?;
    Ok(())
}

/// In the place of what an earlier decision of the same orientation has given. What comes from outside stays.
pub(super) async fn replace_reviewed(
    transaction: &mut Transaction,
    orientation_id: Uuid,
    reference: Option<&ReferenceOrientation>,
) -> Result<(), StoreError> {
    query("DELETE FROM reference_orientations WHERE by_review_of = $1")
        .bind(orientation_id)
        .execute(&mut *transaction)
        .await?;
    match reference {
        Some(reference) => put(transaction, reference, Some(orientation_id)).await,
        None => Ok(()),
    }
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
            let there: bool = query("SELECT EXISTS (SELECT 1 FROM reference_orientations WHERE image_id = $1)")
                .bind(reference.image_id)
                .fetch_value(&mut transaction)
                .await?;
            put(&mut transaction, reference, None).await?;
            if there {
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
            query("SELECT * FROM reference_orientations WHERE image_id < $1 ORDER BY image_id DESC LIMIT $2")
                .bind(before.unwrap_or(Uuid::max()))
                .bind(limit)
                .fetch_all(&self.database)
                .await?;
        rows.into_iter().map(ReferenceOrientation::try_from).collect()
    }

    /// Removes the reference of an image; `false` if there is none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn remove_reference(&self, image_id: Uuid) -> Result<bool, StoreError> {
        let done = query("DELETE FROM reference_orientations WHERE image_id = $1")
            .bind(image_id)
            .execute(&self.database)
            .await?;
        Ok(done == 1)
    }

    /// The orientations that have a record and whose image has a reference, each with its prepared request, record and
    /// camera; one page of those with larger ids than `after`, in their order.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn referenced_records(&self, after: Uuid, limit: u32) -> Result<Vec<ReferencedRecord>, StoreError> {
        let rows: Vec<RecordRow> = query(
            "SELECT orientations.id, camera_id, prepared, record, reference_orientations.*
             FROM orientations JOIN reference_orientations USING (image_id)
             WHERE record IS NOT NULL AND orientations.id > $1 ORDER BY orientations.id LIMIT $2",
        )
        .bind(after)
        .bind(limit)
        .fetch_all(&self.database)
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

    /// The orientations that staff have rejected, have a record, and whose image has no reference; one page of those with
    /// larger ids than `after`, in their order.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn rejected_records(&self, after: Uuid, limit: u32) -> Result<Vec<RejectedRecord>, StoreError> {
        let sql = "SELECT id AS orientation_id, image_id, camera_id, prepared, record FROM orientations
                   WHERE review = 'rejected' AND record IS NOT NULL AND id > $1 AND NOT EXISTS
                   (SELECT 1 FROM reference_orientations WHERE reference_orientations.image_id = orientations.image_id)
                   ORDER BY id LIMIT $2";
        Ok(query(sql).bind(after).bind(limit).fetch_all(&self.database).await?)
    }

    /// The record of an orientation: what its verdict rested on.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn record(&self, orientation_id: Uuid) -> Result<Option<String>, StoreError> {
        let sql = "SELECT record FROM orientations WHERE id = $1 AND record IS NOT NULL";
        Ok(query(sql).bind(orientation_id).fetch_optional::<(String,)>(&self.database).await?.map(|(record,)| record))
    }

    /// The records of the latest orientations, the newest first, at most `limit`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn latest_records(&self, limit: u32) -> Result<Vec<String>, StoreError> {
        let sql = "SELECT record FROM orientations WHERE record IS NOT NULL ORDER BY id DESC LIMIT $1";
        Ok(query(sql).bind(limit).fetch_values(&self.database).await?)
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

/// An orientation that staff have rejected.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct RejectedRecord {
    /// The orientation.
    pub orientation_id: Uuid,
    /// Its image.
    pub image_id: Uuid,
    /// Its camera.
    pub camera_id: Uuid,
    /// The request with everything filled in.
    pub prepared: String,
    /// What its verdict rested on.
    pub record: String,
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

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::database::Database;
    use crate::geometry::{Brown, Camera};
    use crate::store::images::Header;
    use crate::store::orientations::{self, Claim, DiagnosisInShort, Finished, NewOrientation, Priority};
    use crate::store::sightings::Sighting;

    /// A fresh data folder with a camera.
    pub(in crate::store) struct Bench {
        pub(in crate::store) store: Store,
        pub(in crate::store) camera_id: Uuid,
        _folder: tempfile::TempDir,
    }

    impl Bench {
        pub(in crate::store) async fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let store = crate::store::scratch::store(folder.path()).await;
            let camera = Camera::new([60, 40], 50.0, Vector2::new(30.0, 20.0), Brown::default()).unwrap();
            let camera_id = Uuid::now_v7();
            store.add_camera(camera_id, "camera", &camera).await.unwrap();
            Self { store, camera_id, _folder: folder }
        }

        pub(in crate::store) async fn image(&self) -> Uuid {
            self.image_named(None).await
        }

        pub(in crate::store) async fn image_named(&self, name: Option<&str>) -> Uuid {
            let mut upload = self.store.begin_upload().unwrap();
            let id = Uuid::now_v7();
            upload.write(id.as_bytes()).await.unwrap();
            let header = Header {
                format: "png".into(),
                width_px: 60,
                height_px: 40,
                position: None,
                camera_model: None,
                taken_on: None,
            };
            self.store.keep_image(id, upload.complete().await.unwrap(), &header, name).await.unwrap().0.id
        }

        /// An orientation that waits.
        pub(in crate::store) async fn queued(&self, image_id: Uuid) -> Uuid {
            let new = NewOrientation {
                id: Uuid::now_v7(),
                image_id,
                camera_id: self.camera_id,
                prepared: "{}".into(),
                lane: String::new(),
                priority: Priority::Normal,
                webhook: None,
            };
            let mut transaction = self.store.begin_write().await.unwrap();
            assert!(orientations::insert(&mut transaction, &new).await.unwrap().is_some());
            transaction.commit().await.unwrap();
            new.id
        }

        /// An orientation that has succeeded.
        pub(in crate::store) async fn finished(
            &self,
            image_id: Uuid,
            record: &str,
            sightings: &[(&str, Sighting)],
        ) -> Uuid {
            let id = self.queued(image_id).await;
            let claim = Claim { id, lease: Uuid::now_v7() };
            self.store.begin_attempt(claim, Uuid::nil()).await.unwrap().unwrap();
            assert!(self.store.finish(claim, &finished(record, sightings)).await.unwrap());
            id
        }
    }

    pub(in crate::store) fn finished(record: &str, sightings: &[(&str, Sighting)]) -> Finished {
        Finished {
            verdict: "green".into(),
            diagnosis: DiagnosisInShort::default(),
            result: "{}".into(),
            drawing: "{}".into(),
            record: record.into(),
            sightings: sightings.iter().map(|(name, sighting)| ((*name).to_owned(), *sighting)).collect(),
        }
    }

    fn reference(image_id: Uuid, area: &str, shift: f64) -> ReferenceOrientation {
        let rotation = std::array::from_fn(|k| (k as f64 + shift) / 7.0);
        given_now(image_id, area.to_owned(), [4e6 + shift, 6e5 / 7.0, -4.9e6], rotation)
    }

    #[tokio::test]
    async fn a_reference_is_read_back_to_the_last_bit_and_replaced_by_another() {
        let bench = Bench::new().await;
        let (first, second) = (bench.image().await, bench.image().await);
        let added = [reference(first, "west", 0.1), reference(second, "west", 0.2)];
        let stored = bench.store.put_references(&added).await.unwrap();
        assert_eq!(stored, StoredReferences { added: 2, updated: 0 });
        let [a, b] = added;
        assert_eq!(bench.store.references(None, 10).await.unwrap(), [b.clone(), a]);
        let again = [reference(first, "east", 0.3), reference(bench.image().await, "east", 0.4)];
        let stored = bench.store.put_references(&again).await.unwrap();
        assert_eq!(stored, StoredReferences { added: 1, updated: 1 });
        let [a, c] = again;
        assert_eq!(bench.store.references(None, 10).await.unwrap(), [c.clone(), b.clone(), a.clone()]);
        // page by page
        assert_eq!(bench.store.references(None, 1).await.unwrap(), std::slice::from_ref(&c));
        assert_eq!(bench.store.references(Some(c.image_id), 1).await.unwrap(), std::slice::from_ref(&b));
        assert_eq!(bench.store.references(Some(b.image_id), 5).await.unwrap(), [a]);
        assert!(bench.store.remove_reference(second).await.unwrap());
        assert!(!bench.store.remove_reference(second).await.unwrap());
        assert_eq!(bench.store.references(None, 10).await.unwrap().len(), 2);
    }

    #[tokio::test]
    async fn of_references_with_an_unknown_image_none_is_stored() {
        let bench = Bench::new().await;
        let given = [reference(bench.image().await, "west", 0.1), reference(Uuid::now_v7(), "west", 0.2)];
        assert!(bench.store.put_references(&given).await.is_err());
        assert_eq!(bench.store.references(None, 10).await.unwrap(), []);
    }

    #[tokio::test]
    async fn a_rotation_that_is_none_is_not_taken_for_one() {
        let bench = Bench::new().await;
        let image = bench.image().await;
        bench.store.put_references(&[reference(image, "west", 0.1)]).await.unwrap();
        let damage = "PRAGMA ignore_check_constraints = ON; UPDATE reference_orientations SET rotation = x'00'";
        let Database::Sqlite(pool) = bench.store.database() else { return };
        sqlx::raw_sql(damage).execute(pool).await.unwrap();
        let error = bench.store.references(None, 10).await.unwrap_err().to_string();
        assert!(error.contains("rotation of a reference") && error.contains(&image.to_string()), "{error}");
    }

    #[tokio::test]
    async fn records_are_found_with_their_references_in_the_order_of_the_orientations() {
        let bench = Bench::new().await;
        let (known, unknown) = (bench.image().await, bench.image().await);
        bench.store.put_references(&[reference(known, "west", 0.1)]).await.unwrap();
        let first = bench.finished(known, "1", &[]).await;
        bench.finished(unknown, "2", &[]).await;
        bench.queued(known).await;
        let second = bench.finished(known, "3", &[]).await;
        let found = bench.store.referenced_records(Uuid::nil(), 10).await.unwrap();
        let told: Vec<(Uuid, &str)> = found.iter().map(|row| (row.orientation_id, row.record.as_str())).collect();
        assert_eq!(told, [(first, "1"), (second, "3")]);
        for row in &found {
            assert_eq!((row.camera_id, row.prepared.as_str()), (bench.camera_id, "{}"));
            assert_eq!((row.reference.image_id, row.reference.area.as_str()), (known, "west"));
            assert_eq!(row.reference.camera_from_geocentric, reference(known, "west", 0.1).camera_from_geocentric);
        }
        assert_eq!(bench.store.referenced_records(Uuid::nil(), 1).await.unwrap(), found[..1]);
        assert_eq!(bench.store.referenced_records(first, 10).await.unwrap(), found[1..]);
        assert_eq!(bench.store.referenced_records(second, 10).await.unwrap(), []);
        assert_eq!(bench.store.latest_records(2).await.unwrap(), ["3", "2"]);
        assert_eq!(bench.store.latest_records(9).await.unwrap(), ["3", "2", "1"]);
    }
}
