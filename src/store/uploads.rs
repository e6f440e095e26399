//! Uploads that can be resumed: a file in `incoming/`, and a row that says how much of it is on disk for certain.
//!
//! Who writes holds the lock of the file. Bytes are synced before the row says that they are there; what is beyond that
//! in the file, from a process that has died, is cut off by the next writer.

use std::fs::{File, TryLockError};
use std::io::{ErrorKind, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use chrono::{DateTime, Utc};
use sqlx::FromRow;
use tokio::io::AsyncWriteExt as _;
use uuid::Uuid;

use super::images::{INCOMING, Received, file_error, remove_if_there, sha256_of, sync_folder};
use super::{Store, StoreError, now};
use crate::database::query;

/// An upload that can be resumed.
#[derive(Debug, Clone, PartialEq, FromRow)]
pub struct Resumable {
    /// UUIDv7.
    pub id: Uuid,
    /// How long the file is to be.
    pub length_bytes: i64,
    /// How much of it is on disk.
    pub received_bytes: i64,
    /// JSON: what the client says of the file. This room does not look into it.
    pub metadata: String,
    /// The image that has become of it.
    pub image_id: Option<Uuid>,
    /// Whether nothing is left to do.
    pub done: bool,
    /// When it was begun.
    pub created_at: DateTime<Utc>,
    /// When it is given up if nothing more comes.
    pub expires_at: DateTime<Utc>,
}

impl Resumable {
    /// Whether all its bytes are there.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.received_bytes == self.length_bytes
    }
}

/// Why nobody can write to an upload.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UploadError {
    /// Another request writes to it.
    #[error("another request is writing to it")]
    Locked,
    /// Its file is not here.
    #[error("its bytes are not here any more")]
    Gone,
    /// The store is at fault.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// The one who may write to an upload.
#[derive(Debug)]
pub struct Writer {
    store: Store,
    file: tokio::fs::File,
    path: PathBuf,
    /// As it stands in its row.
    pub upload: Resumable,
    written_bytes: i64,
}

impl Writer {
    /// Bytes of the file, those included that the row does not know yet.
    #[must_use]
    pub fn written_bytes(&self) -> i64 {
        self.written_bytes
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// [`StoreError::File`], for example when the disk is full.
    pub async fn write(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.file.write_all(bytes).await.map_err(|source| file_error("cannot write", &self.path, source))?;
        self.written_bytes += i64::try_from(bytes.len()).unwrap_or(i64::MAX);
        Ok(())
    }

    /// Makes what was written last: syncs it, and says so in the row.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn acknowledge(&mut self, expires_at: DateTime<Utc>) -> Result<(), StoreError> {
        let synced = async {
            self.file.flush().await?;
            self.file.sync_data().await
        };
        synced.await.map_err(|source| file_error("cannot sync", &self.path, source))?;
        query("UPDATE uploads SET received_bytes = $1, expires_at = $2 WHERE id = $3")
            .bind(self.written_bytes)
            .bind(expires_at)
            .bind(self.upload.id)
            .execute(&self.store.database)
            .await?;
        (self.upload.received_bytes, self.upload.expires_at) = (self.written_bytes, expires_at);
        Ok(())
    }

    /// Takes the whole file out of the upload. If it is not kept it is lost.
    ///
    /// # Errors
    /// [`StoreError::File`].
    pub async fn whole(self) -> Result<Received, StoreError> {
        let Self { file, path, upload, .. } = self;
        let failed = |source| file_error("cannot read", &path, source);
        let file = file.into_std().await;
        let hash = move || sha256_of(&file).map(|sha256| (file, sha256));
        let hashed = tokio::task::spawn_blocking(hash).await.map_err(std::io::Error::other).map_err(failed)?;
        let (file, sha256) = hashed.map_err(failed)?;
        Ok(Received::of(tokio::fs::File::from_std(file), path, sha256, upload.length_bytes.unsigned_abs()))
    }
}

impl Store {
    /// Begins an upload; one of this id that is there already, from a first try of the same request, is left as it is.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn create_upload(
        &self,
        id: Uuid,
        length_bytes: i64,
        metadata: &str,
        expires_at: DateTime<Utc>,
    ) -> Result<(), StoreError> {
        let path = self.resumable_path(id);
        let file = File::options().create(true).append(true).open(&path);
        let file = file.map_err(|source| file_error("cannot create", &path, source))?;
        // no sweep takes it before it has its row; a second try finds it locked by nobody
        file.lock().map_err(|source| file_error("cannot lock", &path, source))?;
        sync_folder(&self.folder.join(INCOMING)).await?;
        query(
            "INSERT INTO uploads (id, length_bytes, metadata, created_at, expires_at) VALUES ($1, $2, $3, $4, $5)
             ON CONFLICT (id) DO NOTHING",
        )
        .bind(id)
        .bind(length_bytes)
        .bind(metadata)
        .bind(now())
        .bind(expires_at)
        .execute(&self.database)
        .await?;
        Ok(())
    }

    /// The upload with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn upload(&self, id: Uuid) -> Result<Option<Resumable>, StoreError> {
        Ok(query("SELECT * FROM uploads WHERE id = $1").bind(id).fetch_optional(&self.database).await?)
    }

    /// The right to write to an upload, at the place up to which it is on disk.
    ///
    /// # Errors
    /// [`UploadError`].
    pub async fn write_upload(&self, id: Uuid) -> Result<Writer, UploadError> {
        let path = self.resumable_path(id);
        let file = match File::options().read(true).write(true).open(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Err(UploadError::Gone),
            opened => opened.map_err(|source| file_error("cannot open", &path, source))?,
        };
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(UploadError::Locked),
            Err(TryLockError::Error(source)) => return Err(file_error("cannot lock", &path, source).into()),
        }
        // only now: the one before may have written until a moment ago
        let upload = self.upload(id).await?.ok_or(UploadError::Gone)?;
        let acknowledged = upload.received_bytes.unsigned_abs();
        let cut = |mut file: &File| {
            file.set_len(acknowledged)?;
            file.seek(SeekFrom::Start(acknowledged))
        };
        cut(&file).map_err(|source| file_error("cannot cut", &path, source))?;
        let written_bytes = upload.received_bytes;
        Ok(Writer { store: self.clone(), file: tokio::fs::File::from_std(file), path, upload, written_bytes })
    }

    /// Notes which image has become of an upload, and whether nothing is left to do.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn note_upload(&self, id: Uuid, image: Uuid, done: bool) -> Result<(), StoreError> {
        let note = query("UPDATE uploads SET image_id = $1, done = $2 WHERE id = $3");
        note.bind(image).bind(done).bind(id).execute(&self.database).await?;
        Ok(())
    }

    /// Removes an upload with what has come of it; `false` if there is none. Who writes to it should hold its lock.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn remove_upload(&self, id: Uuid) -> Result<bool, StoreError> {
        let removed = query("DELETE FROM uploads WHERE id = $1").bind(id).execute(&self.database).await?;
        remove_if_there(&self.resumable_path(id)).await?;
        Ok(removed == 1)
    }

    /// At most `limit` uploads that were to be given up before a time.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn expired_uploads(&self, before: DateTime<Utc>, limit: u32) -> Result<Vec<Uuid>, StoreError> {
        let expired = query("SELECT id FROM uploads WHERE expires_at < $1 ORDER BY expires_at LIMIT $2");
        Ok(expired.bind(before).bind(limit).fetch_values(&self.database).await?)
    }

    /// Whether a file of `incoming/` belongs to an upload that can be resumed.
    pub(super) async fn is_resumable(&self, path: &Path) -> Result<bool, StoreError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let Ok(id) = Uuid::try_parse(&name) else { return Ok(false) };
        let there = query("SELECT EXISTS (SELECT 1 FROM uploads WHERE id = $1)").bind(id);
        Ok(there.fetch_value(&self.database).await?)
    }

    fn resumable_path(&self, id: Uuid) -> PathBuf {
        self.folder.join(INCOMING).join(id.simple().to_string())
    }
}
