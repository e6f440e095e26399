//! What is exported of orientations: their results, or what staff have corrected them to.

use sqlx::FromRow;
use uuid::Uuid;

use super::{Store, StoreError};
use crate::database::query;

/// An orientation to be exported.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct ExportedRow {
    /// What its image is called.
    pub name: Option<String>,
    /// Its image, if it is uploaded.
    pub image_id: Option<Uuid>,
    /// Its camera, once there is an orientation.
    pub camera_id: Option<Uuid>,
    /// How far it is.
    pub status: Option<String>,
    /// What the system thinks of it.
    pub verdict: Option<String>,
    /// What staff have decided: `accepted` or `rejected`.
    pub review: Option<String>,
    /// What was found.
    pub result: Option<String>,
    /// What staff made of it, where they have accepted a correction.
    pub corrected: Option<String>,
}

impl Store {
    /// An orientation as it is exported; `None` if there is none.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn exported(&self, orientation: Uuid) -> Result<Option<ExportedRow>, StoreError> {
        Ok(query(
            "SELECT i.name, o.image_id, o.camera_id, o.status, o.verdict, o.review, o.result,
                 CASE WHEN o.review = 'accepted' THEN (SELECT r.result FROM reviews r WHERE r.orientation_id = o.id
                     ORDER BY r.id DESC LIMIT 1) END AS corrected
             FROM orientations o LEFT JOIN images i ON i.id = o.image_id WHERE o.id = $1",
        )
        .bind(orientation)
        .fetch_optional(&self.database)
        .await?)
    }

    /// The images of a block as they are exported, in the order of its list, at most `limit`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn exported_of_block(&self, block: Uuid, limit: u32) -> Result<Vec<ExportedRow>, StoreError> {
        Ok(query(
            "SELECT b.name, b.image_id, o.camera_id, o.status, o.verdict, o.review, o.result,
                 CASE WHEN o.review = 'accepted' THEN (SELECT r.result FROM reviews r WHERE r.orientation_id = o.id
                     ORDER BY r.id DESC LIMIT 1) END AS corrected
             FROM block_images b LEFT JOIN orientations o ON o.id = b.orientation_id
             WHERE b.block_id = $1 ORDER BY b.number LIMIT $2",
        )
        .bind(block)
        .bind(limit)
        .fetch_all(&self.database)
        .await?)
    }
}
