//! Interior orientations of scanned film. They are worked out at once, so that each has its result.

use chrono::{DateTime, Utc};
use sqlx::FromRow;
use uuid::Uuid;

use super::{Store, StoreError, now};
use crate::database::query;

/// What came out of a scan. Requests and results are JSON that this room does not look into.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewInteriorOrientation {
    /// UUIDv7.
    pub id: Uuid,
    /// The scan.
    pub image_id: Uuid,
    /// The film camera.
    pub camera_id: Uuid,
    /// The request with everything filled in.
    pub prepared: String,
    /// `green`, `yellow` or `red`.
    pub verdict: String,
    /// The result as the contract has it.
    pub result: String,
}

/// A stored interior orientation.
#[derive(Debug, Clone, PartialEq, Eq, FromRow)]
pub struct InteriorOrientation {
    /// UUIDv7.
    pub id: Uuid,
    /// The scan.
    pub image_id: Uuid,
    /// The film camera.
    pub camera_id: Uuid,
    /// The request with everything filled in.
    pub prepared: String,
    /// `green`, `yellow` or `red`.
    pub verdict: String,
    /// The result; `None` in lists.
    pub result: Option<String>,
    /// When it was made.
    pub created_at: DateTime<Utc>,
}

/// What a list of interior orientations is restricted to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Filter {
    /// Only of this image.
    pub image_id: Option<Uuid>,
    /// Only with the camera of this id or name.
    pub camera: Option<String>,
    /// Only with this verdict.
    pub verdict: Option<String>,
    /// Only those with a smaller id.
    pub before: Option<Uuid>,
}

impl Store {
    /// Keeps an interior orientation. If there is one under its id, from a first try of the same request, that one stays
    /// and is given.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn add_interior_orientation(
        &self,
        new: &NewInteriorOrientation,
    ) -> Result<InteriorOrientation, StoreError> {
        let mut transaction = self.begin_write().await?;
        query(
            "INSERT INTO interior_orientations (id, image_id, camera_id, prepared, verdict, result, created_at)
             VALUES ($1, $2, $3, $4, $5, $6, $7) ON CONFLICT (id) DO NOTHING",
        )
        .bind(new.id)
        .bind(new.image_id)
        .bind(new.camera_id)
        .bind(&new.prepared)
        .bind(&new.verdict)
        .bind(&new.result)
        .bind(now())
        .execute(&mut transaction)
        .await?;
        let kept =
            query("SELECT * FROM interior_orientations WHERE id = $1").bind(new.id).fetch_one(&mut transaction).await?;
        transaction.commit().await?;
        Ok(kept)
    }

    /// The interior orientation with this id.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn interior_orientation(&self, id: Uuid) -> Result<Option<InteriorOrientation>, StoreError> {
        let sql = "SELECT * FROM interior_orientations WHERE id = $1";
        Ok(query(sql).bind(id).fetch_optional(&self.database).await?)
    }

    /// At most `limit` interior orientations, the newest first, without their results.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn interior_orientations(
        &self,
        filter: &Filter,
        limit: u32,
    ) -> Result<Vec<InteriorOrientation>, StoreError> {
        let camera_id = match &filter.camera {
            // no camera has the id that is none
            Some(camera) => Some(self.camera(camera).await?.map_or(Uuid::nil(), |camera| camera.id)),
            None => None,
        };
        let rows = query(
            "SELECT id, image_id, camera_id, prepared, verdict, CAST(NULL AS TEXT) AS result, created_at
             FROM interior_orientations WHERE TRUE",
        )
        .and("image_id = ?", filter.image_id)
        .and("camera_id = ?", camera_id)
        .and("verdict = ?", filter.verdict.as_deref())
        .and("id < ?", filter.before)
        .then(" ORDER BY id DESC LIMIT ?")
        .bind(limit);
        Ok(rows.fetch_all(&self.database).await?)
    }

    /// Removes an interior orientation; `false` if there is none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn remove_interior_orientation(&self, id: Uuid) -> Result<bool, StoreError> {
        let done = query("DELETE FROM interior_orientations WHERE id = $1").bind(id).execute(&self.database).await?;
        Ok(done == 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::cameras::Removed;
    use crate::store::references::tests::Bench;

    fn new(bench: &Bench, image_id: Uuid, verdict: &str) -> NewInteriorOrientation {
        NewInteriorOrientation {
            id: Uuid::now_v7(),
            image_id,
            camera_id: bench.camera_id,
            prepared: "{}".into(),
            verdict: verdict.into(),
            result: "{\"marks\": []}".into(),
        }
    }

    #[tokio::test]
    async fn what_is_kept_is_read_back_listed_and_removed() {
        let bench = Bench::new().await;
        let (first, second) = (bench.image().await, bench.image().await);
        let (green, red) = (new(&bench, first, "green"), new(&bench, second, "red"));
        let kept = bench.store.add_interior_orientation(&green).await.unwrap();
        assert_eq!((kept.id, kept.image_id, kept.result.as_deref()), (green.id, first, Some(green.result.as_str())));
        bench.store.add_interior_orientation(&red).await.unwrap();
        assert_eq!(bench.store.interior_orientation(green.id).await.unwrap(), Some(kept.clone()));
        let listed = async |filter: Filter| {
            let rows = bench.store.interior_orientations(&filter, 10).await.unwrap();
            assert!(rows.iter().all(|row| row.result.is_none()));
            rows.into_iter().map(|row| row.id).collect::<Vec<_>>()
        };
        assert_eq!(listed(Filter::default()).await, [red.id, green.id]);
        assert_eq!(listed(Filter { image_id: Some(first), ..Filter::default() }).await, [green.id]);
        assert_eq!(listed(Filter { verdict: Some("red".into()), ..Filter::default() }).await, [red.id]);
        assert_eq!(listed(Filter { before: Some(red.id), ..Filter::default() }).await, [green.id]);
        for camera in ["camera", &bench.camera_id.to_string()] {
            assert_eq!(listed(Filter { camera: Some(camera.into()), ..Filter::default() }).await.len(), 2);
        }
        assert_eq!(listed(Filter { camera: Some("another".into()), ..Filter::default() }).await, Vec::<Uuid>::new());
        assert_eq!(bench.store.remove_camera("camera").await.unwrap(), Removed::InUse);
        assert!(bench.store.remove_interior_orientation(red.id).await.unwrap());
        assert!(!bench.store.remove_interior_orientation(red.id).await.unwrap());
        assert_eq!(bench.store.interior_orientation(red.id).await.unwrap(), None);
    }

    #[tokio::test]
    async fn the_second_try_of_a_request_keeps_what_the_first_has_made() {
        let bench = Bench::new().await;
        let first = new(&bench, bench.image().await, "yellow");
        let kept = bench.store.add_interior_orientation(&first).await.unwrap();
        let again = NewInteriorOrientation { verdict: "red".into(), ..first };
        assert_eq!(bench.store.add_interior_orientation(&again).await.unwrap(), kept);
    }
}
