//! The database: SQLite in the data folder, or PostgreSQL for many machines. One text of a statement serves both.
//!
//! Statements are written in the SQL that both understand, with parameters `$1`, `$2`, …, and run by [`query`]. Where the
//! two differ (the index of boxes, lists as parameters, clocks) a statement is given as a pair. Whole numbers are `i64`
//! on both sides: PostgreSQL knows no unsigned ones.

mod bulk;
mod open;
mod query;

use sqlx::{PgPool, Postgres, Sqlite, SqlitePool};

pub use bulk::Column;
pub use open::{OpenError, Session};
pub use query::{Executor, Query, Record, Value, query};

/// Connections to one of the two. Cheap to clone.
#[derive(Debug, Clone)]
pub enum Database {
    /// A file in the data folder.
    Sqlite(SqlitePool),
    /// A server.
    Postgres(PgPool),
}

/// What of a pair of statements is meant for which database.
#[derive(Debug, Clone, Copy)]
pub struct Dialects {
    /// For SQLite.
    pub sqlite: &'static str,
    /// For PostgreSQL.
    pub postgres: &'static str,
}

/// A transaction of one of the two. Dropped without a commit it leaves nothing.
#[derive(Debug)]
pub enum Transaction {
    /// In a file.
    Sqlite(sqlx::Transaction<'static, Sqlite>),
    /// On a server.
    Postgres(sqlx::Transaction<'static, Postgres>),
}

/// The key of the lock that those hold who read before they write.
const WRITERS: i64 = 0x6761_626c_6501;

impl Database {
    /// A transaction that reads before it writes. One at a time has the right to do so: what it has read holds until it
    /// commits, as in SQLite, which has one writer anyway.
    ///
    /// # Errors
    /// [`sqlx::Error`] if the lock is not had in time.
    pub async fn begin_alone(&self) -> Result<Transaction, sqlx::Error> {
        let mut transaction = self.begin().await?;
        if let Transaction::Postgres(inner) = &mut transaction {
            sqlx::query("SELECT pg_advisory_xact_lock($1)").bind(WRITERS).execute(&mut **inner).await?;
        }
        Ok(transaction)
    }

    /// A transaction whose every statement is right whatever others write meanwhile. In SQLite it takes the write lock
    /// at once: one that begins by reading and writes later fails when another one has written in between.
    ///
    /// # Errors
    /// [`sqlx::Error`] if the lock is not had in time.
    pub async fn begin(&self) -> Result<Transaction, sqlx::Error> {
        Ok(match self {
            Self::Sqlite(pool) => Transaction::Sqlite(pool.begin_with("BEGIN IMMEDIATE").await?),
            Self::Postgres(pool) => Transaction::Postgres(pool.begin().await?),
        })
    }

    /// The one of two statements that this database understands.
    #[must_use]
    pub fn dialect(&self, dialects: Dialects) -> &'static str {
        match self {
            Self::Sqlite(_) => dialects.sqlite,
            Self::Postgres(_) => dialects.postgres,
        }
    }

    /// Whether several machines may work with it.
    #[must_use]
    pub fn is_shared(&self) -> bool {
        matches!(self, Self::Postgres(_))
    }

    /// Waits for the connections to be given back, and closes them.
    pub async fn close(&self) {
        match self {
            Self::Sqlite(pool) => pool.close().await,
            Self::Postgres(pool) => pool.close().await,
        }
    }
}

impl Transaction {
    /// Makes it last.
    ///
    /// # Errors
    /// [`sqlx::Error`]; then nothing of it is there, unless the connection broke while the answer was awaited.
    pub async fn commit(self) -> Result<(), sqlx::Error> {
        match self {
            Self::Sqlite(inner) => inner.commit().await,
            Self::Postgres(inner) => inner.commit().await,
        }
    }

    /// The one of two statements that this database understands.
    #[must_use]
    pub fn dialect(&self, dialects: Dialects) -> &'static str {
        match self {
            Self::Sqlite(_) => dialects.sqlite,
            Self::Postgres(_) => dialects.postgres,
        }
    }
}

/// A list of names as one parameter, a JSON array of texts: the rows of a sub-select.
pub const TEXTS: Dialects =
    Dialects { sqlite: "(SELECT value FROM json_each($1))", postgres: "(SELECT json_array_elements_text($1::json))" };

/// The pattern of `LIKE … ESCAPE '\\'` for texts that contain this one.
#[must_use]
pub fn containing(text: &str) -> String {
    let escaped = text.replace('\\', "\\\\").replace('%', "\\%").replace('_', "\\_");
    format!("%{escaped}%")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wildcards_of_a_text_stand_for_themselves() {
        assert_eq!(containing("a"), "%a%");
        assert_eq!(containing("50%_\\x"), "%50\\%\\_\\\\x%");
    }
}
