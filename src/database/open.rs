//! Opens the database, brings its tables up to date, and refuses settings that would lose what was acknowledged.

use std::path::Path;
use std::str::FromStr as _;
use std::time::Duration;

use sqlx::migrate::{MigrateError, Migrator};
use sqlx::postgres::{PgConnectOptions, PgPoolOptions};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection as _, PgConnection};

use super::{Database, query};

const CONNECTIONS: u32 = 8;
const BUSY_TIMEOUT: Duration = Duration::from_secs(5);
/// So many rows SQLite's thread reads ahead of the one that takes them: with few, the two wake each other for every row,
/// which takes longer than to read it.
const ROWS_AHEAD: usize = 1_000;
/// How long a request waits for a connection before the service says that it is not available.
const PATIENCE: Duration = Duration::from_secs(5);
/// The key of the lock that the one holds who changes the tables.
const MIGRATING: i64 = 0x6761_626c_6502;

/// Why the database cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OpenError {
    /// It does not answer, or not as it should.
    #[error("database: {0}")]
    Database(#[from] sqlx::Error),
    /// The tables could not be brought up to date.
    #[error("migration of the database: {0}")]
    Migration(#[from] MigrateError),
    /// It does not keep what it has acknowledged.
    #[error("the database runs with {setting} = {value}, which would lose acknowledged data; it must be {wanted}")]
    NotDurable {
        /// The setting.
        setting: &'static str,
        /// As found.
        value: String,
        /// As needed.
        wanted: &'static str,
    },
    /// The queue needs extensions that this user may not make.
    #[error("the database has no extension {missing}; have an administrator run in it: CREATE EXTENSION {missing}")]
    Extension {
        /// Its name.
        missing: &'static str,
    },
    /// The tables are of another version.
    #[error("the tables of the database are not those of this version: run `gable migrate` first")]
    NotMigrated,
}

/// A lock of the database's, held as long as the connection lives.
#[derive(Debug)]
pub struct Session(#[expect(dead_code, reason = "held, not read")] Option<PgConnection>);

impl Database {
    /// Opens the file, makes it if there is none, and brings its tables up to date.
    ///
    /// # Errors
    /// [`OpenError`] if it is damaged, newer than this version, or not durable.
    pub async fn sqlite(file: &Path) -> Result<Self, OpenError> {
        let options = SqliteConnectOptions::new()
            .filename(file)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(BUSY_TIMEOUT)
            .row_buffer_size(ROWS_AHEAD);
        // When the disk is full SQLite ends a transaction by itself; sqlx does not notice, and could never begin another
        // one on that connection.
        let pool = SqlitePoolOptions::new()
            .max_connections(CONNECTIONS)
            .before_acquire(|connection, _| Box::pin(async { Ok(!connection.is_in_transaction()) }))
            .connect_with(options)
            .await?;
        let database = Self::Sqlite(pool);
        database.assert_durable().await?;
        database.migrate().await?;
        Ok(database)
    }

    /// A database in memory, which ends with its connections.
    ///
    /// # Errors
    /// [`OpenError`] if SQLite cannot make it.
    pub async fn in_memory() -> Result<Self, OpenError> {
        // one connection, that never ends: each one would have its own memory
        let options = SqlitePoolOptions::new().max_connections(1).idle_timeout(None).max_lifetime(None);
        let database = Self::Sqlite(options.connect("sqlite::memory:").await?);
        database.migrate().await?;
        Ok(database)
    }

    /// Connects to a server; the tables are left as they are, and may be missing.
    ///
    /// # Errors
    /// [`OpenError`] if it cannot be reached, or is not durable.
    pub async fn postgres(url: &str) -> Result<Self, OpenError> {
        let options = PgConnectOptions::from_str(url)?.application_name("gable");
        // A replica that was cut off must not hold its locks for ever. Of ten million rows PostgreSQL believes that a query
        // by their index is worth compiling, which takes four times as long as to answer it.
        let settings = [("idle_in_transaction_session_timeout", "60s"), ("lock_timeout", "10s"), ("jit", "off")];
        let options = options.options(settings);
        let pool =
            PgPoolOptions::new().max_connections(CONNECTIONS).acquire_timeout(PATIENCE).connect_with(options).await?;
        let database = Self::Postgres(pool);
        database.assert_durable().await?;
        Ok(database)
    }

    /// Brings the tables up to date, those of the queue too. Of several processes one does it, and the others wait.
    ///
    /// # Errors
    /// [`OpenError`].
    pub async fn migrate(&self) -> Result<(), OpenError> {
        match self {
            Self::Sqlite(pool) => {
                ours(sqlx::migrate!("migrations/sqlite")).run(pool).await?;
                // its migrations are counted in the same table as ours
                ours(apalis_sqlite::SqliteStorage::<()>::migrations()).run(pool).await?;
            }
            Self::Postgres(pool) => {
                let mut connection = pool.acquire().await?;
                // another one's migration may take longer than other locks are waited for
                sqlx::query("SET lock_timeout = 0").execute(&mut *connection).await?;
                sqlx::query("SELECT pg_advisory_lock($1)").bind(MIGRATING).execute(&mut *connection).await?;
                let done = async {
                    for extension in ["pgcrypto", "hstore"] {
                        extend(&mut connection, extension).await?;
                    }
                    ours(sqlx::migrate!("migrations/postgres")).run(&mut *connection).await?;
                    ours(apalis_postgres::PostgresStorage::<()>::migrations()).run(&mut *connection).await?;
                    Ok(())
                }
                .await;
                sqlx::query("SELECT pg_advisory_unlock($1)").bind(MIGRATING).execute(&mut *connection).await?;
                sqlx::query("RESET lock_timeout").execute(&mut *connection).await?;
                return done;
            }
        }
        Ok(())
    }

    /// Whether the tables are those of this version.
    ///
    /// # Errors
    /// [`OpenError::NotMigrated`] if they are not.
    pub async fn assert_migrated(&self) -> Result<(), OpenError> {
        let migrator = match self {
            Self::Sqlite(_) => sqlx::migrate!("migrations/sqlite"),
            Self::Postgres(_) => sqlx::migrate!("migrations/postgres"),
        };
        let newest = migrator.iter().map(|migration| migration.version).max().unwrap_or_default();
        // those of the queue are numbered by date
        let applied = query("SELECT max(version) FROM _sqlx_migrations WHERE success AND version < 10000")
            .fetch_value::<Option<i64>>(self)
            .await;
        match applied {
            Ok(Some(applied)) if applied == newest => Ok(()),
            _ => Err(OpenError::NotMigrated),
        }
    }

    /// A lock by name among all processes of a shared database, held as long as the answer is; `None` if another one
    /// holds it. A file has one service anyway.
    ///
    /// # Errors
    /// [`OpenError`].
    pub async fn try_lock(&self, name: i64) -> Result<Option<Session>, OpenError> {
        let Self::Postgres(pool) = self else { return Ok(Some(Session(None))) };
        let mut connection = PgConnection::connect_with(&pool.connect_options()).await?;
        let held: bool =
            sqlx::query_scalar("SELECT pg_try_advisory_lock($1)").bind(name).fetch_one(&mut connection).await?;
        Ok(held.then_some(Session(Some(connection))))
    }

    async fn assert_durable(&self) -> Result<(), OpenError> {
        match self {
            Self::Sqlite(_) => {
                let synchronous: i64 = query("PRAGMA synchronous").fetch_value(self).await?;
                let journal: String = query("PRAGMA journal_mode").fetch_value(self).await?;
                demand("synchronous", &synchronous.to_string(), &["2"])?;
                demand("journal_mode", &journal, &["wal"])
            }
            Self::Postgres(_) => {
                let commit: String = query("SHOW synchronous_commit").fetch_value(self).await?;
                let fsync: String = query("SHOW fsync").fetch_value(self).await?;
                demand("synchronous_commit", &commit, &["on", "local", "remote_write", "remote_apply"])?;
                demand("fsync", &fsync, &["on"])
            }
        }
    }
}

fn demand(setting: &'static str, value: &str, allowed: &[&'static str]) -> Result<(), OpenError> {
    match allowed {
        [wanted, ..] if !allowed.contains(&value) => {
            Err(OpenError::NotDurable { setting, value: value.to_owned(), wanted })
        }
        _ => Ok(()),
    }
}

/// Trusted extensions, which the owner of a database may make; if he may not, an administrator is asked for by name.
async fn extend(connection: &mut PgConnection, extension: &'static str) -> Result<(), OpenError> {
    let there: bool = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM pg_extension WHERE extname = $1)")
        .bind(extension)
        .fetch_one(&mut *connection)
        .await?;
    if there {
        return Ok(());
    }
    let make = sqlx::AssertSqlSafe(format!("CREATE EXTENSION {extension}"));
    sqlx::query(make).execute(connection).await.map_err(|_| OpenError::Extension { missing: extension })?;
    Ok(())
}

/// Our migrations are numbered from 1, those of the queue by date, in one table: each must ignore the other's.
fn ours(mut migrator: Migrator) -> Migrator {
    migrator.set_ignore_missing(true);
    migrator
}
