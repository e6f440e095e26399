//! A statement with its parameters, for either database.

use chrono::{DateTime, NaiveDate, Utc};
use sqlx::postgres::{PgArguments, PgRow};
use sqlx::sqlite::{SqliteArguments, SqliteRow};
use sqlx::{Arguments as _, AssertSqlSafe, FromRow, SqlSafeStr, SqlStr};
use uuid::Uuid;

use super::{Database, Transaction};

/// What a row is read into. A tuple or a struct with `#[derive(FromRow)]` is one if its fields are types of both
/// databases.
pub trait Record: for<'r> FromRow<'r, SqliteRow> + for<'r> FromRow<'r, PgRow> + Send + Unpin {}

impl<T> Record for T where T: for<'r> FromRow<'r, SqliteRow> + for<'r> FromRow<'r, PgRow> + Send + Unpin {}

/// A parameter.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Value {
    Boolean(bool),
    Integer(Option<i64>),
    Real(Option<f64>),
    Text(Option<String>),
    Bytes(Option<Vec<u8>>),
    Id(Option<Uuid>),
    Time(Option<DateTime<Utc>>),
    Date(Option<NaiveDate>),
}

macro_rules! values {
    ($($type:ty => |$value:ident| $made:expr;)*) => {
        $(impl From<$type> for Value {
            fn from($value: $type) -> Self {
                $made
            }
        })*
    };
}

values! {
    bool => |value| Self::Boolean(value);
    i64 => |value| Self::Integer(Some(value));
    u32 => |value| Self::Integer(Some(value.into()));
    u16 => |value| Self::Integer(Some(value.into()));
    Option<i64> => |value| Self::Integer(value);
    f64 => |value| Self::Real(Some(value));
    Option<f64> => |value| Self::Real(value);
    &str => |value| Self::Text(Some(value.to_owned()));
    &String => |value| Self::Text(Some(value.clone()));
    String => |value| Self::Text(Some(value));
    Option<String> => |value| Self::Text(value);
    Option<&str> => |value| Self::Text(value.map(str::to_owned));
    &Option<String> => |value| Self::Text(value.clone());
    &[u8] => |value| Self::Bytes(Some(value.to_vec()));
    Vec<u8> => |value| Self::Bytes(Some(value));
    &Vec<u8> => |value| Self::Bytes(Some(value.clone()));
    Option<Vec<u8>> => |value| Self::Bytes(value);
    Uuid => |value| Self::Id(Some(value));
    &Uuid => |value| Self::Id(Some(*value));
    Option<Uuid> => |value| Self::Id(value);
    DateTime<Utc> => |value| Self::Time(Some(value));
    Option<DateTime<Utc>> => |value| Self::Time(value);
    Option<NaiveDate> => |value| Self::Date(value);
}

/// Where a statement runs: by itself, or as a part of a transaction.
#[derive(Debug)]
pub enum Executor<'e> {
    /// By itself.
    Alone(&'e Database),
    /// As a part of a transaction.
    Within(&'e mut Transaction),
}

impl<'e> From<&'e Database> for Executor<'e> {
    fn from(database: &'e Database) -> Self {
        Self::Alone(database)
    }
}

impl<'e> From<&'e mut Transaction> for Executor<'e> {
    fn from(transaction: &'e mut Transaction) -> Self {
        Self::Within(transaction)
    }
}

/// A statement with its parameters.
#[derive(Debug)]
#[must_use = "a statement that is not run does nothing"]
pub struct Query {
    sql: SqlStr,
    values: Vec<Value>,
}

/// A statement whose parameters are `$1`, `$2`, … in the order in which they are bound.
pub fn query(sql: impl SqlSafeStr) -> Query {
    Query { sql: sql.into_sql_str(), values: Vec::new() }
}

/// Runs the same on whatever the executor is; `$row` names the row type, where `$with` makes a query of it.
macro_rules! run {
    ($query:ident, $executor:expr, $with:path, $run:ident) => {
        match $executor.into() {
            Executor::Alone(Database::Sqlite(pool)) => $with($query.sql, sqlite($query.values)?).$run(pool).await,
            Executor::Alone(Database::Postgres(pool)) => $with($query.sql, postgres($query.values)?).$run(pool).await,
            Executor::Within(Transaction::Sqlite(inner)) => {
                $with($query.sql, sqlite($query.values)?).$run(&mut **inner).await
            }
            Executor::Within(Transaction::Postgres(inner)) => {
                $with($query.sql, postgres($query.values)?).$run(&mut **inner).await
            }
        }
    };
}

impl Query {
    /// Adds the value of the next parameter.
    pub fn bind(mut self, value: impl Into<Value>) -> Self {
        self.values.push(value.into());
        self
    }

    /// Adds ` AND condition`, in which `?` stands for the value; nothing if there is none.
    pub fn and<V: Into<Value>>(self, condition: &'static str, value: Option<V>) -> Self {
        match value {
            Some(value) => self.then(" AND ").then(condition).bind(value),
            None => self,
        }
    }

    /// Adds text, in which the number of the next parameter stands for each `?`.
    pub fn then(mut self, text: &'static str) -> Self {
        let next = format!("${}", self.values.len() + 1);
        self.sql = AssertSqlSafe(format!("{}{}", self.sql.as_str(), text.replace('?', &next))).into_sql_str();
        self
    }

    /// Puts text before it.
    #[cfg(test)]
    pub(crate) fn before(mut self, text: &'static str) -> Self {
        self.sql = AssertSqlSafe(format!("{text}{}", self.sql.as_str())).into_sql_str();
        self
    }

    /// Runs it: the number of rows that it has written.
    ///
    /// # Errors
    /// [`sqlx::Error`].
    pub async fn execute<'e>(self, on: impl Into<Executor<'e>>) -> Result<u64, sqlx::Error> {
        Ok(match on.into() {
            Executor::Alone(Database::Sqlite(pool)) => {
                sqlx::query_with(self.sql, sqlite(self.values)?).execute(pool).await?.rows_affected()
            }
            Executor::Alone(Database::Postgres(pool)) => {
                sqlx::query_with(self.sql, postgres(self.values)?).execute(pool).await?.rows_affected()
            }
            Executor::Within(Transaction::Sqlite(inner)) => {
                sqlx::query_with(self.sql, sqlite(self.values)?).execute(&mut **inner).await?.rows_affected()
            }
            Executor::Within(Transaction::Postgres(inner)) => {
                sqlx::query_with(self.sql, postgres(self.values)?).execute(&mut **inner).await?.rows_affected()
            }
        })
    }

    /// All its rows.
    ///
    /// # Errors
    /// [`sqlx::Error`].
    pub async fn fetch_all<'e, T: Record>(self, on: impl Into<Executor<'e>>) -> Result<Vec<T>, sqlx::Error> {
        run!(self, on, sqlx::query_as_with, fetch_all)
    }

    /// Its first row, if there is one.
    ///
    /// # Errors
    /// [`sqlx::Error`].
    pub async fn fetch_optional<'e, T: Record>(self, on: impl Into<Executor<'e>>) -> Result<Option<T>, sqlx::Error> {
        run!(self, on, sqlx::query_as_with, fetch_optional)
    }

    /// Its first row.
    ///
    /// # Errors
    /// [`sqlx::Error`], also if there is none.
    pub async fn fetch_one<'e, T: Record>(self, on: impl Into<Executor<'e>>) -> Result<T, sqlx::Error> {
        run!(self, on, sqlx::query_as_with, fetch_one)
    }

    /// The first column of its first row.
    ///
    /// # Errors
    /// [`sqlx::Error`], also if there is none.
    pub async fn fetch_value<'e, T>(self, on: impl Into<Executor<'e>>) -> Result<T, sqlx::Error>
    where
        (T,): Record,
    {
        self.fetch_one::<(T,)>(on).await.map(|(value,)| value)
    }

    /// The first column of all its rows.
    ///
    /// # Errors
    /// [`sqlx::Error`].
    pub async fn fetch_values<'e, T>(self, on: impl Into<Executor<'e>>) -> Result<Vec<T>, sqlx::Error>
    where
        (T,): Record,
    {
        Ok(self.fetch_all::<(T,)>(on).await?.into_iter().map(|(value,)| value).collect())
    }

    /// The first column of its first row, if there is one.
    ///
    /// # Errors
    /// [`sqlx::Error`].
    pub async fn fetch_optional_value<'e, T>(self, on: impl Into<Executor<'e>>) -> Result<Option<T>, sqlx::Error>
    where
        (T,): Record,
    {
        Ok(self.fetch_optional::<(T,)>(on).await?.map(|(value,)| value))
    }
}

macro_rules! arguments {
    ($name:ident, $arguments:ty) => {
        fn $name(values: Vec<Value>) -> Result<$arguments, sqlx::Error> {
            let mut arguments = <$arguments>::default();
            for value in values {
                match value {
                    Value::Boolean(value) => arguments.add(value),
                    Value::Integer(value) => arguments.add(value),
                    Value::Real(value) => arguments.add(value),
                    Value::Text(value) => arguments.add(value),
                    Value::Bytes(value) => arguments.add(value),
                    Value::Id(value) => arguments.add(value),
                    Value::Time(value) => arguments.add(value),
                    Value::Date(value) => arguments.add(value),
                }
                .map_err(sqlx::Error::Encode)?;
            }
            Ok(arguments)
        }
    };
}

arguments!(sqlite, SqliteArguments);
arguments!(postgres, PgArguments);
