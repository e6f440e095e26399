//! What the service remembers: cameras, templates of marks, images, keys, orientations with their references, classifiers,
//! and the answers to repeated requests, in one data folder.
//!
//! With SQLite, `gable.db` is a database in write-ahead mode that syncs every commit; `images/` holds the uploaded files by
//! their SHA-256; `overviews/` small pictures of them; `incoming/` the uploads under way. Other rooms keep their own tables in the same database through
//! [`Store::database`].

pub mod accounts;
pub mod audit;
pub mod blocks;
pub mod cameras;
pub mod classifiers;
pub mod exported;
pub mod idempotency;
pub mod images;
pub mod interior_orientations;
pub mod keys;
pub mod mark_templates;
mod objects;
pub mod orientations;
pub mod overviews;
pub mod passwords;
pub mod recent;
pub mod references;
pub mod removal;
pub mod reviews;
pub mod sightings;
pub mod statistics;
pub mod uploads;
pub mod webhooks;

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use chrono::{DateTime, SubsecRound, Utc};

use self::objects::Bucket;
use self::recent::Recent;
use crate::database::{Database, OpenError, Transaction, query};

/// Why the store could not do what was asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// A file or folder of the data folder could not be used.
    #[error("{action} {}: {source}", path.display())]
    File {
        /// What was tried, as in "cannot create".
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The database refused.
    #[error("database: {source}")]
    Database {
        /// The cause.
        #[from]
        source: sqlx::Error,
    },
    /// The database cannot be used as it is.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The object store failed.
    #[error("the object store failed: {source}")]
    Objects {
        /// The cause.
        #[from]
        source: object_store::Error,
    },
    /// The setting is not the address of a bucket.
    #[error("objects_url is {url:?}; it must be s3://bucket/prefix")]
    ObjectsUrl {
        /// As given.
        url: String,
    },
    /// Another service works with this data folder.
    #[error("{} is in use by another gable service; end it, or give this one a folder of its own", folder.display())]
    InUse {
        /// The data folder.
        folder: PathBuf,
    },
    /// An image came while the same bytes were being removed.
    #[error("these bytes were being removed at this moment; send them again")]
    JustRemoved,
    /// A stored value is not what this version writes.
    #[error("the stored {what} {value:?} is not known to this version")]
    Unknown {
        /// Kind of value.
        what: &'static str,
        /// As found.
        value: String,
    },
}

/// The data folder, opened. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Store {
    database: Database,
    folder: PathBuf,
    bucket: Option<Bucket>,
    /// Keys that were let in a moment ago: most requests come from the same few.
    recent_keys: Arc<Recent<[u8; 32], keys::Presented>>,
}

/// Where a store is.
#[derive(Debug, Clone, Copy)]
pub struct Place<'a> {
    /// The data folder.
    pub folder: &'a Path,
    /// A PostgreSQL server in place of SQLite in the folder.
    pub database_url: Option<&'a str>,
    /// A bucket for the images in place of the folder: `s3://bucket/prefix`.
    pub objects_url: Option<&'a str>,
}

/// Held by the one service of a data folder; the operating system takes it back when the process ends, however it ends.
#[derive(Debug)]
pub struct FolderLock {
    _file: File,
}

/// The folder of labelled sets that were uploaded to train from, until that is done.
pub const TRAINING: &str = "training";

impl Store {
    /// Opens a store that lives in its folder alone, makes what is missing, and brings the tables up to date.
    ///
    /// # Errors
    /// [`StoreError`] if the folder cannot be used, or the database is damaged, newer than this version or not durable.
    pub async fn open(folder: &Path) -> Result<Self, StoreError> {
        Self::connect(&Place { folder, database_url: None, objects_url: None }).await
    }

    /// Opens a store. The tables of SQLite are brought up to date; those of a server must be so already.
    ///
    /// # Errors
    /// [`StoreError`] if a part of it cannot be used.
    pub async fn connect(place: &Place<'_>) -> Result<Self, StoreError> {
        let folder = place.folder;
        let parts = ["", images::FOLDER, images::INCOMING, overviews::FOLDER, TRAINING].map(|part| folder.join(part));
        for part in parts {
            std::fs::create_dir_all(&part).map_err(|source| StoreError::File {
                action: "cannot create",
                path: part.clone(),
                source,
            })?;
        }
        let database = match place.database_url {
            None => Database::sqlite(&folder.join("gable.db")).await?,
            Some(url) => {
                let database = Database::postgres(url).await?;
                database.assert_migrated().await?;
                database
            }
        };
        let bucket = place.objects_url.map(Bucket::open).transpose()?;
        Ok(Self { database, folder: folder.to_owned(), bucket, recent_keys: Arc::default() })
    }

    /// Makes this process the one service of the data folder, as long as the lock is kept. Tools that only read and
    /// write rows need no lock.
    ///
    /// # Errors
    /// [`StoreError::InUse`] if there is another one.
    pub fn lock(&self) -> Result<FolderLock, StoreError> {
        let path = self.folder.join("service.lock");
        let file = File::options().create(true).append(true).open(&path);
        let file = file.map_err(|source| StoreError::File { action: "cannot open", path: path.clone(), source })?;
        match file.try_lock() {
            Ok(()) => Ok(FolderLock { _file: file }),
            Err(TryLockError::WouldBlock) => Err(StoreError::InUse { folder: self.folder.clone() }),
            Err(TryLockError::Error(source)) => Err(StoreError::File { action: "cannot lock", path, source }),
        }
    }

    /// The database, for the tables of other rooms.
    #[must_use]
    pub fn database(&self) -> &Database {
        &self.database
    }

    /// The data folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// A transaction that will write. It takes the write lock at once: a transaction that begins by reading and writes
    /// later fails in SQLite when another one has written in between.
    ///
    /// # Errors
    /// [`StoreError::Database`] if the lock is not had in time.
    pub async fn begin_write(&self) -> Result<Transaction, StoreError> {
        Ok(self.database.begin_alone().await?)
    }

    /// Room that is left on the disk of the data folder.
    ///
    /// # Errors
    /// [`StoreError::File`] if the operating system does not say.
    pub fn free_bytes(&self) -> Result<u64, StoreError> {
        let facts = rustix::fs::statvfs(&self.folder).map_err(|source| StoreError::File {
            action: "cannot ask for the free space of",
            path: self.folder.clone(),
            source: source.into(),
        })?;
        Ok(facts.f_bavail.saturating_mul(facts.f_frsize))
    }

    /// Whether the database answers, and the object store if there is one.
    ///
    /// # Errors
    /// [`StoreError::Database`] if it does not.
    pub async fn ping(&self) -> Result<(), StoreError> {
        query("SELECT EXISTS (SELECT 1 FROM cameras)").fetch_value::<bool>(&self.database).await?;
        match &self.bucket {
            Some(bucket) => bucket.ping().await,
            None => Ok(()),
        }
    }

    /// Waits for the connections to be given back, and closes them.
    pub async fn close(&self) {
        self.database.close().await;
    }
}

/// What `count(*)` has given.
pub(crate) fn count_of(count: i64) -> Result<u32, StoreError> {
    u32::try_from(count).map_err(|_| StoreError::Unknown { what: "count", value: count.to_string() })
}

/// The present, to the microsecond: what is stored is what is told.
#[must_use]
pub fn now() -> DateTime<Utc> {
    Utc::now().trunc_subsecs(6)
}

#[cfg(test)]
#[path = "../../tests/shared/scratch.rs"]
pub(crate) mod scratch;
