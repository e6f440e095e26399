//! What the service remembers: cameras, templates of marks, images, keys, orientations with their references, classifiers,
//! and the answers to repeated requests, in one data folder.
//!
//! `gable.db` is an SQLite database in write-ahead mode that syncs every commit; `images/` holds the uploaded files by
//! their SHA-256; `incoming/` the uploads under way. Other rooms keep their own tables in the same database through
//! [`Store::pool`].

pub mod cameras;
pub mod classifiers;
pub mod idempotency;
pub mod images;
pub mod interior_orientations;
pub mod keys;
pub mod mark_templates;
pub mod orientations;
pub mod references;
pub mod sightings;

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

use chrono::{DateTime, SubsecRound, Utc};
use sqlx::migrate::{MigrateError, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection as _, Sqlite, SqlitePool, Transaction};

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
    /// The tables could not be brought up to date.
    #[error("migration of the database: {source}")]
    Migration {
        /// The cause.
        #[from]
        source: MigrateError,
    },
    /// The database does not keep what it has acknowledged.
    #[error("the database runs with {pragma} = {value}, which would lose acknowledged data; it must be {wanted}")]
    NotDurable {
        /// The setting.
        pragma: &'static str,
        /// As found.
        value: String,
        /// As needed.
        wanted: &'static str,
    },
    /// Another service works with this data folder.
    #[error("{} is in use by another gable service; end it, or give this one a folder of its own", folder.display())]
    InUse {
        /// The data folder.
        folder: PathBuf,
    },
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
    pool: SqlitePool,
    folder: PathBuf,
}

/// Held by the one service of a data folder; the operating system takes it back when the process ends, however it ends.
#[derive(Debug)]
pub struct FolderLock {
    _file: File,
}

/// The folder of labelled sets that were uploaded to train from, until that is done.
pub const TRAINING: &str = "training";
const CONNECTIONS: u32 = 8;
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);

impl Store {
    /// Opens the data folder, makes what is missing, and brings the tables up to date.
    ///
    /// # Errors
    /// [`StoreError`] if the folder cannot be used, or the database is damaged, newer than this version or not durable.
    pub async fn open(folder: &Path) -> Result<Self, StoreError> {
        for part in
            [folder.to_owned(), folder.join(images::FOLDER), folder.join(images::INCOMING), folder.join(TRAINING)]
        {
            std::fs::create_dir_all(&part).map_err(|source| StoreError::File {
                action: "cannot create",
                path: part.clone(),
                source,
            })?;
        }
        let options = SqliteConnectOptions::new()
            .filename(folder.join("gable.db"))
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(BUSY_TIMEOUT);
        // When the disk is full SQLite ends a transaction by itself; sqlx does not notice, and could never begin another
        // one on that connection.
        let pool = SqlitePoolOptions::new()
            .max_connections(CONNECTIONS)
            .before_acquire(|connection, _| Box::pin(async { Ok(!connection.is_in_transaction()) }))
            .connect_with(options)
            .await?;
        let store = Self { pool, folder: folder.to_owned() };
        store.assert_durable().await?;
        migrations().run(&store.pool).await?;
        Ok(store)
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

    /// The connections, for the tables of other rooms.
    #[must_use]
    pub fn pool(&self) -> &SqlitePool {
        &self.pool
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
    pub async fn begin_write(&self) -> Result<Transaction<'static, Sqlite>, StoreError> {
        Ok(self.pool.begin_with("BEGIN IMMEDIATE").await?)
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

    /// Whether the database answers.
    ///
    /// # Errors
    /// [`StoreError::Database`] if it does not.
    pub async fn ping(&self) -> Result<(), StoreError> {
        sqlx::query("SELECT 1 FROM cameras LIMIT 1").fetch_optional(&self.pool).await?;
        Ok(())
    }

    /// Waits for the connections to be given back, and closes them.
    pub async fn close(&self) {
        self.pool.close().await;
    }

    async fn assert_durable(&self) -> Result<(), StoreError> {
        let synchronous: i64 = sqlx::query_scalar("PRAGMA synchronous").fetch_one(&self.pool).await?;
        let journal: String = sqlx::query_scalar("PRAGMA journal_mode").fetch_one(&self.pool).await?;
        if synchronous != 2 {
            return Err(StoreError::NotDurable { pragma: "synchronous", value: synchronous.to_string(), wanted: "2" });
        }
        if journal != "wal" {
            return Err(StoreError::NotDurable { pragma: "journal_mode", value: journal, wanted: "wal" });
        }
        Ok(())
    }
}

/// Our migrations are numbered from 1; those of the job queue, in the same table, by date. Each must ignore the other's.
fn migrations() -> Migrator {
    let mut migrator = sqlx::migrate!("migrations/sqlite");
    migrator.set_ignore_missing(true);
    migrator
}

/// The present, to the microsecond: what is stored is what is told.
#[must_use]
pub fn now() -> DateTime<Utc> {
    Utc::now().trunc_subsecs(6)
}
