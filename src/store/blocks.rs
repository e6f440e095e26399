//! Blocks: flights whose images are oriented alike. A row for each image that is listed, to which the image and its
//! orientation are attached as they come.

use std::collections::HashMap;

use chrono::{DateTime, Utc};
use sqlx::FromRow;
use uuid::Uuid;

use super::{Store, StoreError, now, webhooks};
use crate::database::{Dialects, Transaction, query};

/// A block.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Block {
    /// UUIDv7.
    pub id: Uuid,
    /// For people.
    pub name: String,
    /// JSON: what all orientations of the block have in common. This room does not look into it.
    pub settings: String,
    /// The CRS of the list.
    pub crs: String,
    /// Images listed.
    pub images: i64,
    /// When it was posted.
    pub created_at: DateTime<Utc>,
}

/// An image of a block, as listed, with what is attached to it.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct BlockImage {
    /// Its place in the list, from 1.
    pub number: i64,
    /// Unique in the block.
    pub name: String,
    /// JSON: the approximation of its orientation.
    pub approximation: String,
    /// What the list says of its file.
    pub sha256: Option<Vec<u8>>,
    /// The image, once it is uploaded.
    pub image_id: Option<Uuid>,
    /// Its orientation, as long as it is kept.
    pub orientation_id: Option<Uuid>,
}

/// An image of a block with the state of its orientation.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct BlockRow {
    /// Its place in the list, from 1.
    pub number: i64,
    /// Unique in the block.
    pub name: String,
    /// The image, once it is uploaded.
    pub image_id: Option<Uuid>,
    /// Its orientation.
    pub orientation_id: Option<Uuid>,
    /// How far that is.
    pub status: Option<String>,
    /// Its verdict.
    pub verdict: Option<String>,
    /// Why it has failed.
    pub error_code: Option<String>,
    /// JSON, as the contract has it.
    pub result: Option<String>,
}

/// How many images of a block have an orientation of this status and verdict.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Tally {
    /// None if there is no orientation.
    pub status: Option<String>,
    /// None if there is no result.
    pub verdict: Option<String>,
    /// How many.
    pub images: i64,
    /// How many of them are uploaded.
    pub uploaded: i64,
    /// When the first of them was last begun.
    pub started_at: Option<DateTime<Utc>>,
    /// When the last of them came to its end.
    pub finished_at: Option<DateTime<Utc>>,
}

/// Adds a block; `false` if it is there already, from a first try of the same request.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn insert(transaction: &mut Transaction, block: &Block) -> Result<bool, StoreError> {
    let inserted = query(
        "INSERT INTO blocks (id, name, settings, crs, images, created_at) VALUES ($1, $2, $3, $4, $5, $6)
         ON CONFLICT (id) DO NOTHING",
    )
    .bind(block.id)
    .bind(&block.name)
    .bind(&block.settings)
    .bind(&block.crs)
    .bind(block.images)
    .bind(block.created_at)
    .execute(transaction)
    .await?;
    Ok(inserted == 1)
}

/// Adds an image to a block.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn insert_image(transaction: &mut Transaction, block: Uuid, image: &BlockImage) -> Result<(), StoreError> {
    query(
        "INSERT INTO block_images (block_id, number, name, approximation, sha256, image_id, orientation_id)
         VALUES ($1, $2, $3, $4, $5, $6, $7)",
    )
    .bind(block)
    .bind(image.number)
    .bind(&image.name)
    .bind(&image.approximation)
    .bind(image.sha256.clone())
    .bind(image.image_id)
    .bind(image.orientation_id)
    .execute(transaction)
    .await?;
    Ok(())
}

/// Attaches an image and its orientation to its place in a block; `false` if another orientation was attached since
/// `former` was.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn attach(
    transaction: &mut Transaction,
    block: Uuid,
    image: &BlockImage,
    former: Option<Uuid>,
) -> Result<bool, StoreError> {
    let attached = query(
        "UPDATE block_images SET image_id = $1, orientation_id = $2
         WHERE block_id = $3 AND number = $4 AND (orientation_id = $5 OR (orientation_id IS NULL AND $6))",
    )
    .bind(image.image_id)
    .bind(image.orientation_id)
    .bind(block)
    .bind(image.number)
    .bind(former)
    .bind(former.is_none())
    .execute(transaction)
    .await?;
    Ok(attached == 1)
}

/// Cancels all orientations of a block that have not ended: which ones. Whoever is to be told of their end is told.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn cancel(transaction: &mut Transaction, block: Uuid) -> Result<Vec<Uuid>, StoreError> {
    let cancelled = query(
        "UPDATE orientations SET status = 'cancelled', finished_at = $1, lease = NULL
         WHERE status IN ('queued', 'running')
         AND id IN (SELECT orientation_id FROM block_images WHERE block_id = $2) RETURNING id",
    )
    .bind(now())
    .bind(block)
    .fetch_values(&mut *transaction)
    .await?;
    for id in &cancelled {
        webhooks::note_end(transaction, *id).await?;
    }
    Ok(cancelled)
}

/// Removes a block with its list; `false` if there is none.
///
/// # Errors
/// [`StoreError::Database`].
pub async fn remove(transaction: &mut Transaction, block: Uuid) -> Result<bool, StoreError> {
    Ok(query("DELETE FROM blocks WHERE id = $1").bind(block).execute(transaction).await? == 1)
}

impl Store {
    /// The block with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn block(&self, id: Uuid) -> Result<Option<Block>, StoreError> {
        Ok(query("SELECT * FROM blocks WHERE id = $1").bind(id).fetch_optional(&self.database).await?)
    }

    /// At most `limit` blocks, the newest first, those older than `before`.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn blocks(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<Block>, StoreError> {
        let blocks = query("SELECT * FROM blocks WHERE id < $1 ORDER BY id DESC LIMIT $2");
        Ok(blocks.bind(before.unwrap_or(Uuid::max())).bind(limit).fetch_all(&self.database).await?)
    }

    /// The image of this name in a block.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn block_image(&self, block: Uuid, name: &str) -> Result<Option<BlockImage>, StoreError> {
        let image = query(
            "SELECT number, name, approximation, sha256, image_id, orientation_id FROM block_images
             WHERE block_id = $1 AND name = $2",
        );
        Ok(image.bind(block).bind(name).fetch_optional(&self.database).await?)
    }

    /// At most `limit` images of a block as listed, those after number `after`.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn block_rows(&self, block: Uuid, after: i64, limit: u32) -> Result<Vec<BlockRow>, StoreError> {
        Ok(query(
            "SELECT b.number, b.name, b.image_id, b.orientation_id, o.status, o.verdict, o.error_code, o.result
             FROM block_images b LEFT JOIN orientations o ON o.id = b.orientation_id
             WHERE b.block_id = $1 AND b.number > $2 ORDER BY b.number LIMIT $3",
        )
        .bind(block)
        .bind(after)
        .bind(limit)
        .fetch_all(&self.database)
        .await?)
    }

    /// How many images of a block there are of each status and verdict.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn block_tallies(&self, block: Uuid) -> Result<Vec<Tally>, StoreError> {
        Ok(query(
            "SELECT o.status, o.verdict, count(*) AS images, count(b.image_id) AS uploaded,
             min(o.started_at) AS started_at, max(o.finished_at) AS finished_at
             FROM block_images b LEFT JOIN orientations o ON o.id = b.orientation_id
             WHERE b.block_id = $1 GROUP BY o.status, o.verdict",
        )
        .bind(block)
        .fetch_all(&self.database)
        .await?)
    }

    /// The images whose files have these SHA-256, given in hexadecimal digits: their ids by the digits.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn images_by_sha256(&self, digits: &[String]) -> Result<HashMap<String, Uuid>, StoreError> {
        let found = query(self.database.dialect(BY_SHA256)).bind(serde_json::json!(digits).to_string());
        let found: Vec<(String, Uuid)> = found.fetch_all(&self.database).await?;
        Ok(found.into_iter().collect())
    }
}

/// The bytes are made of the digits, not the other way round: so the index of the digests serves.
const BY_SHA256: Dialects = Dialects {
    sqlite: "SELECT lower(hex(sha256)), id FROM images
             WHERE sha256 IN (SELECT unhex(value) FROM json_each($1)) AND deleted_at IS NULL",
    postgres: "SELECT encode(sha256, 'hex'), id FROM images
               WHERE sha256 IN (SELECT decode(t, 'hex') FROM json_array_elements_text($1::json) AS t)
               AND deleted_at IS NULL",
};
