//! Control points out of a GeoPackage: tables of lines, or of the surfaces of roofs, with heights.
//!
//! A GeoPackage is an SQLite file, and comes from strangers: it is opened for reading only, nothing in it is run (no
//! view, trigger, generated column or extension), and a row at a time is in memory.
//!
//! A row is a control point, or several of one table with the same `cp_id` or `building_id` are one; of surfaces those with
//! the same `gml_id` too. What another table has under the same name is refused, as whatever a file has twice is: tables
//! are not merged. Lines of more than two positions are as many edges; the edges of surfaces are found as in a building
//! model.

mod blob;
mod layer;
mod record;
#[cfg(test)]
mod tests;

use std::io;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use futures_util::TryStreamExt as _;
use sqlx::sqlite::{SqliteConnectOptions, SqliteRow};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Connection as _, Row as _, SqliteConnection};

use super::reading::{Raw, ReadError, Reading};
pub use record::Record;
use record::Row;

/// With these bytes every SQLite file begins.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";
/// Rows that are read ahead.
const ROWS_AHEAD: usize = 16;
/// After so many rows it is told how far reading has come.
const ROWS_TOLD: u64 = 256;

/// Why a GeoPackage cannot be read, or not to its end.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GeoPackageError {
    /// The bytes do not come.
    #[error("the file cannot be read: {0}")]
    Input(#[source] io::Error),
    /// Something else.
    #[error("this is no GeoPackage: it is no SQLite file")]
    NoSqlite,
    /// SQLite, but something else.
    #[error("this SQLite file is no GeoPackage: it has no table {missing}")]
    NoGeoPackage {
        /// What every GeoPackage with features has.
        missing: &'static str,
    },
    /// What is in the file itself is not all there is.
    #[error("another program has the GeoPackage open for writing ({beside} lies beside it); close it there first")]
    Busy {
        /// The name of the file.
        beside: String,
    },
    /// It came as a stream.
    #[error("a GeoPackage can only be read from a file")]
    Streamed,
    /// Only other things in it.
    #[error(
        "the GeoPackage has no table of lines or surfaces; LINESTRING, MULTILINESTRING, POLYGON or MULTIPOLYGON with Z \
         is needed, and there is {}", if others.is_empty() { "none of features".to_owned() } else { others.join(", ") }
    )]
    NoTable {
        /// The tables that it has, with the types of their geometries.
        others: Vec<String>,
    },
    /// Nothing in it.
    #[error("the tables of lines and surfaces in the GeoPackage have no rows")]
    NoRow,
    /// A table that is not as it should be.
    #[error("table {table:?} cannot be read: {detail}")]
    Table {
        /// Its name.
        table: String,
        /// What is wrong and what would be right.
        detail: &'static str,
    },
    /// A CRS that only the file knows.
    #[error("table {table:?} is in the CRS {named:?}, which is none of EPSG; give crs")]
    OtherCrs {
        /// Its name.
        table: String,
        /// The CRS as the file names it.
        named: String,
    },
    /// SQLite cannot read it, or not to its end.
    #[error("the GeoPackage is damaged, or not as it should be: {0}")]
    Database(#[source] sqlx::Error),
}

impl From<sqlx::Error> for GeoPackageError {
    fn from(error: sqlx::Error) -> Self {
        const NOT_A_DATABASE: &str = "26";
        let code = error.as_database_error().and_then(|error| error.code());
        match code.as_deref() {
            Some(NOT_A_DATABASE) => Self::NoSqlite,
            _ => Self::Database(error),
        }
    }
}

/// Reads `file` and gives `each` what it finds with its place, until that breaks off. `progress` is told which share of
/// the rows is read. It blocks, and so must not be called where futures run.
pub(super) fn read(
    reading: &Reading,
    file: &Path,
    progress: &mut dyn FnMut(f64),
    each: &mut dyn FnMut(usize, Raw) -> ControlFlow<()>,
) -> Result<(), ReadError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(GeoPackageError::Input)?;
    let (mut connection, layers) = runtime.block_on(async {
        let mut connection = open(file).await?;
        let layers = layer::layers(&mut connection, reading).await?;
        Ok::<_, ReadError>((connection, layers))
    })?;
    let all: u64 = layers.iter().map(|layer| layer.rows).sum();
    if all == 0 {
        return Err(GeoPackageError::NoRow.into());
    }
    let (mut done, mut index) = (0_u64, 0);
    let mut give = |record: Record| {
        index += 1;
        each(index - 1, Raw::Rows(Box::new(record)))
    };
    for layer in layers.into_iter().map(Arc::new) {
        let mut rows = sqlx::query(AssertSqlSafe(layer.sql.clone())).bind(&layer.table).fetch(&mut connection);
        let mut building: Option<Record> = None;
        // row by row, since `each` may wait for others, which it must not where a future runs
        while let Some(found) = runtime.block_on(rows.try_next()).map_err(GeoPackageError::from)? {
            done += 1;
            if done.is_multiple_of(ROWS_TOLD) {
                progress(done as f64 / all as f64);
            }
            let row = row(&found).map_err(GeoPackageError::from)?;
            if let Some(record) = &mut building
                && record.has(&row)
            {
                record.push(row);
            } else if let Some(whole) = building.replace(Record::of(layer.clone(), row))
                && give(whole).is_break()
            {
                return Ok(());
            }
        }
        if let Some(whole) = building
            && give(whole).is_break()
        {
            return Ok(());
        }
    }
    // whatever closing says, all was read
    let _ = runtime.block_on(connection.close());
    Ok(())
}

async fn open(file: &Path) -> Result<SqliteConnection, GeoPackageError> {
    // a missing file is told as such, and no SQLite asked for it
    std::fs::metadata(file).map_err(GeoPackageError::Input)?;
    for suffix in ["-wal", "-journal"] {
        let mut beside = file.as_os_str().to_owned();
        beside.push(suffix);
        if std::fs::metadata(&beside).is_ok_and(|beside| beside.len() > 0) {
            return Err(GeoPackageError::Busy { beside: beside.to_string_lossy().into_owned() });
        }
    }
    // immutable: no lock, and no file beside it
    let options = SqliteConnectOptions::new()
        .filename(file)
        .read_only(true)
        .immutable(true)
        .foreign_keys(false)
        .pragma("trusted_schema", "OFF")
        .pragma("cell_size_check", "ON")
        .pragma("query_only", "ON")
        .row_buffer_size(ROWS_AHEAD)
        .disable_statement_logging();
    Ok(options.connect().await?)
}

/// The row of a [`layer::Layer`]'s statement.
fn row(found: &SqliteRow) -> Result<Row, sqlx::Error> {
    let geometry = match (found.try_get::<Option<Vec<u8>>, _>(1)?, found.try_get(2)?) {
        (Some(geometry), _) => Ok(geometry),
        (None, true) => Err("it has no geometry".to_owned()),
        (None, false) => Err(format!("its geometry is no blob, or larger than {} bytes", record::MOST_BYTES)),
    };
    let (key, name, kind, purpose, valid_from, valid_to) = Default::default();
    let (id, sigma_m) = (found.try_get(0)?, found.try_get(5)?);
    let mut row = Row { id, key, name, geometry, sigma_m, kind, purpose, valid_from, valid_to };
    let texts = [
        (3, &mut row.key),
        (4, &mut row.name),
        (6, &mut row.kind),
        (7, &mut row.purpose),
        (8, &mut row.valid_from),
        (9, &mut row.valid_to),
    ];
    for (column, text) in texts {
        match found.try_get(column) {
            Ok(read) => *text = read,
            Err(_) => row.geometry = Err("one of its texts is not UTF-8".to_owned()),
        }
    }
    Ok(row)
}
