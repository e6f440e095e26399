//! What is removed: images with their files, and orientations that have ended.
//!
//! The row goes first, then the file. A crash in between leaves a file without a row, which the sweep takes.

use chrono::{DateTime, Utc};
use sqlx::AssertSqlSafe;
use uuid::Uuid;

use super::{Store, StoreError, now};
use crate::database::query;

/// What became of a wish to remove something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Removal {
    /// It is gone.
    Done,
    /// There is none.
    Missing,
    /// It is still needed: an orientation waits or runs.
    InUse,
}

/// Which of the orientations that have ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// Green ones.
    Green,
    /// Yellow ones.
    Yellow,
    /// Red ones, and those without a verdict: failed or cancelled.
    Other,
}

impl Ended {
    fn condition(self) -> &'static str {
        match self {
            Self::Green => "verdict = 'green'",
            Self::Yellow => "verdict = 'yellow'",
            Self::Other => "(verdict IS NULL OR verdict = 'red')",
        }
    }
}

const UNFINISHED: &str = "SELECT 1 FROM orientations WHERE image_id = images.id AND status IN ('queued', 'running')";

impl Store {
    /// Removes an image with its file, unless an orientation of it waits or runs. Its row stays, for the orientations that
    /// refer to it; the same bytes uploaded again bring it back.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn remove_image(&self, id: Uuid) -> Result<Removal, StoreError> {
        let mut transaction = self.begin_write().await?;
        let sql = format!("SELECT sha256, EXISTS ({UNFINISHED}) FROM images WHERE id = $1 AND deleted_at IS NULL");
        let found = query(AssertSqlSafe(sql)).bind(id).fetch_optional::<(Vec<u8>, bool)>(&mut transaction).await?;
        let sha256 = match found {
            None => return Ok(Removal::Missing),
            Some((_, true)) => return Ok(Removal::InUse),
            Some((sha256, false)) => sha256,
        };
        query("UPDATE images SET deleted_at = $1 WHERE id = $2").bind(now()).bind(id).execute(&mut transaction).await?;
        transaction.commit().await?;
        self.remove_file(id, sha256).await?;
        Ok(Removal::Done)
    }

    /// Removes the file of an image that is removed. It may have come back meanwhile: who keeps an image and who removes
    /// it take turns, and each looks what the other has done.
    async fn remove_file(&self, id: Uuid, sha256: Vec<u8>) -> Result<(), StoreError> {
        let mut transaction = self.begin_write().await?;
        let removed = query("SELECT EXISTS (SELECT 1 FROM images WHERE id = $1 AND deleted_at IS NOT NULL)");
        let removed: bool = removed.bind(id).fetch_value(&mut transaction).await?;
        if let (true, Ok(sha256)) = (removed, <[u8; 32]>::try_from(sha256)) {
            self.remove_image_file(&sha256).await?;
        }
        transaction.commit().await?;
        Ok(())
    }

    /// At most `limit` images that were uploaded before a time, and that no orientation waits for.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn old_images(&self, before: DateTime<Utc>, limit: u32) -> Result<Vec<Uuid>, StoreError> {
        let sql = format!(
            "SELECT id FROM images WHERE deleted_at IS NULL AND created_at < $1 AND NOT EXISTS ({UNFINISHED})
             ORDER BY created_at LIMIT $2"
        );
        Ok(query(AssertSqlSafe(sql)).bind(before).bind(limit).fetch_values(&self.database).await?)
    }

    /// The length of all files of images together.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn images_bytes(&self) -> Result<u64, StoreError> {
        let sum = query("SELECT CAST(COALESCE(sum(size_bytes), 0) AS BIGINT) FROM images WHERE deleted_at IS NULL");
        Ok(sum.fetch_value::<i64>(&self.database).await?.unsigned_abs())
    }

    /// Removes an orientation that has ended, with its result.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn forget_orientation(&self, id: Uuid) -> Result<Removal, StoreError> {
        let removed = query("DELETE FROM orientations WHERE id = $1 AND status NOT IN ('queued', 'running')");
        if removed.bind(id).execute(&self.database).await? == 1 {
            return Ok(Removal::Done);
        }
        let there = query("SELECT EXISTS (SELECT 1 FROM orientations WHERE id = $1)").bind(id);
        Ok(if there.fetch_value(&self.database).await? { Removal::InUse } else { Removal::Missing })
    }

    /// Removes at most `limit` orientations that came to their end before a time: how many.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn forget_ended(&self, which: Ended, before: DateTime<Utc>, limit: u32) -> Result<u64, StoreError> {
        let sql = format!(
            "DELETE FROM orientations WHERE id IN
             (SELECT id FROM orientations WHERE finished_at < $1 AND status NOT IN ('queued', 'running') AND {}
              ORDER BY finished_at LIMIT $2)",
            which.condition()
        );
        Ok(query(AssertSqlSafe(sql)).bind(before).bind(limit).execute(&self.database).await?)
    }
}
