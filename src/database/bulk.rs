//! Many rows by one statement: a statement that reads from a table `given`, which exists as long as it runs.
//!
//! SQLite gets the rows as `VALUES`, PostgreSQL a list for each column. Ten thousand rows one by one would cost ten
//! thousand ways to the database and back.

use chrono::NaiveDate;
use sqlx::postgres::PgArguments;
use sqlx::sqlite::SqliteArguments;
use sqlx::{Arguments as _, AssertSqlSafe};

use super::Transaction;

/// A column of `given`.
#[derive(Debug, Clone)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Column {
    Booleans(Vec<bool>),
    Integers(Vec<i64>),
    Reals(Vec<f64>),
    Texts(Vec<String>),
    Bytes(Vec<Vec<u8>>),
    Dates(Vec<Option<NaiveDate>>),
}

/// So many parameters SQLite gets in one statement: it allows 32 766, and prepares one of a few thousand faster than it
/// runs it.
const PARAMETERS: usize = 6_000;

impl Column {
    fn len(&self) -> usize {
        match self {
            Self::Booleans(values) => values.len(),
            Self::Integers(values) => values.len(),
            Self::Reals(values) => values.len(),
            Self::Texts(values) => values.len(),
            Self::Bytes(values) => values.len(),
            Self::Dates(values) => values.len(),
        }
    }

    fn postgres_type(&self) -> &'static str {
        match self {
            Self::Booleans(_) => "boolean[]",
            Self::Integers(_) => "bigint[]",
            Self::Reals(_) => "double precision[]",
            Self::Texts(_) => "text[]",
            Self::Bytes(_) => "bytea[]",
            Self::Dates(_) => "date[]",
        }
    }

    /// Takes a value out: each row is written once.
    fn take(&mut self, row: usize, arguments: &mut SqliteArguments) -> Result<(), sqlx::Error> {
        match self {
            Self::Booleans(values) => arguments.add(values[row]),
            Self::Integers(values) => arguments.add(values[row]),
            Self::Reals(values) => arguments.add(values[row]),
            Self::Texts(values) => arguments.add(std::mem::take(&mut values[row])),
            Self::Bytes(values) => arguments.add(std::mem::take(&mut values[row])),
            Self::Dates(values) => arguments.add(values[row]),
        }
        .map_err(sqlx::Error::Encode)
    }

    fn give(self, arguments: &mut PgArguments) -> Result<(), sqlx::Error> {
        match self {
            Self::Booleans(values) => arguments.add(values),
            Self::Integers(values) => arguments.add(values),
            Self::Reals(values) => arguments.add(values),
            Self::Texts(values) => arguments.add(values),
            Self::Bytes(values) => arguments.add(values),
            Self::Dates(values) => arguments.add(values),
        }
        .map_err(sqlx::Error::Encode)
    }
}

impl Transaction {
    /// Runs `statement` with the table `given` of these columns, each with its name. All columns have the same number of
    /// rows. With SQLite it runs several times, each time with some of the rows, in their order.
    ///
    /// # Errors
    /// [`sqlx::Error`].
    pub async fn execute_many(
        &mut self,
        statement: &'static str,
        columns: Vec<(&'static str, Column)>,
    ) -> Result<(), sqlx::Error> {
        let rows = columns.first().map_or(0, |(_, column)| column.len());
        debug_assert!(columns.iter().all(|(_, column)| column.len() == rows));
        let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        let names = names.join(", ");
        match self {
            Self::Sqlite(inner) => {
                let mut columns: Vec<Column> = columns.into_iter().map(|(_, column)| column).collect();
                let at_once = (PARAMETERS / columns.len().max(1)).max(1);
                let row = format!("({})", vec!["?"; columns.len()].join(", "));
                for first in (0..rows).step_by(at_once) {
                    let last = rows.min(first + at_once);
                    let values = vec![row.as_str(); last - first].join(", ");
                    let mut arguments = SqliteArguments::default();
                    for row in first..last {
                        columns.iter_mut().try_for_each(|column| column.take(row, &mut arguments))?;
                    }
                    let sql = format!("WITH given ({names}) AS (VALUES {values}) {statement}");
                    // only the statement of whole chunks comes again
                    let again = last - first == at_once;
                    let query = sqlx::query_with(AssertSqlSafe(sql), arguments).persistent(again);
                    query.execute(&mut **inner).await?;
                }
            }
            Self::Postgres(inner) => {
                let lists: Vec<String> =
                    (1..).zip(&columns).map(|(k, (_, column))| format!("${k}::{}", column.postgres_type())).collect();
                let sql = format!("WITH given ({names}) AS (SELECT * FROM unnest({})) {statement}", lists.join(", "));
                let mut arguments = PgArguments::default();
                columns.into_iter().try_for_each(|(_, column)| column.give(&mut arguments))?;
                sqlx::query_with(AssertSqlSafe(sql), arguments).execute(&mut **inner).await?;
            }
        }
        Ok(())
    }
}
