//! The tables of a GeoPackage that may hold roofs, and the statements that read them.
//!
//! Only real tables are read: a view runs what a stranger has written, and so does a generated column. Nothing that
//! stands in the file gets into a statement but as a name in quotes.

use std::sync::Arc;

use sqlx::{AssertSqlSafe, Row as _, SqliteConnection};

use super::GeoPackageError;
use super::record::MOST_BYTES;
use crate::control::reading::{KnownCrs, ReadError, Reading};
use crate::geometry::Crs;

/// Columns that may have the name of a building, the first one that is not empty counting.
const NAMES: [&str; 4] = ["name", "cp_id", "building_id", "gml_id"];
/// Columns with a number where there is no name, and what stands between the name of the table and the number: `roofs:7`.
/// The number alone would be that of a row in every other table too. That it is the `fid`, which programs count anew when
/// they write a file, the name says: `roofs:fid:7`.
const NUMBERS: [(&str, &str); 2] = [("id", ":"), ("fid", ":fid:")];
/// Columns that say which rows are one building.
const KEYS: [&str; 2] = ["cp_id", "building_id"];
/// The same of surfaces, of which a building as a rule has several.
const KEYS_OF_SURFACES: [&str; 3] = ["cp_id", "building_id", "gml_id"];
/// Tables that one file may have.
const MOST_TABLES: i64 = 1_000;
/// A longer text is none that is read here.
const LONGEST_TEXT: usize = 1_000;

/// What must be known of a table to read it.
#[derive(Debug)]
pub(super) struct Layer {
    /// Its name, which its statement takes.
    pub(super) table: String,
    /// The number of its CRS in the file.
    pub(super) srs_id: i64,
    /// Its CRS.
    pub(super) crs: Arc<Crs>,
    /// How many rows it has.
    pub(super) rows: u64,
    /// Reads them, those of a building after each other; its parameter is the name of the table.
    pub(super) sql: String,
}

impl Layer {
    /// Why a row has no name.
    pub(super) fn without_name(&self) -> String {
        let (table, names) = (&self.table, NAMES.join(", "));
        format!("it has no name: table \"{table}\" needs one in a column {names}, id or fid")
    }
}

/// A table of features as the GeoPackage lists it.
#[derive(Debug)]
struct Listed {
    table: String,
    column: String,
    kind: String,
    srs_id: i64,
    organization: Option<String>,
    code: Option<i64>,
}

/// The tables that may hold roofs, by name.
pub(super) async fn layers(connection: &mut SqliteConnection, reading: &Reading) -> Result<Vec<Layer>, ReadError> {
    for table in ["gpkg_contents", "gpkg_geometry_columns", "gpkg_spatial_ref_sys"] {
        if !is_table(connection, table).await? {
            return Err(GeoPackageError::NoGeoPackage { missing: table }.into());
        }
    }
    let (mut known, mut layers, mut others) = (KnownCrs::default(), Vec::new(), Vec::new());
    for listed in listed(connection).await? {
        if may_hold_roofs(&listed.kind) {
            layers.push(layer(connection, reading, &mut known, listed).await?);
        } else {
            let shown: String = format!("{} ({})", listed.table, listed.kind).chars().take(100).collect();
            others.push(shown);
        }
    }
    others.truncate(10);
    match layers.is_empty() {
        true => Err(GeoPackageError::NoTable { others }.into()),
        false => Ok(layers),
    }
}

/// What is declared as something general is seen row by row.
fn may_hold_roofs(kind: &str) -> bool {
    ["LINESTRING", "POLYGON", "GEOMETRY", "CURVE", "SURFACE"]
        .into_iter()
        .any(|known| kind == known || kind.strip_prefix("MULTI") == Some(known))
}

async fn is_table(connection: &mut SqliteConnection, name: &str) -> Result<bool, GeoPackageError> {
    let found: Option<i64> = sqlx::query_scalar(
        "SELECT 1 FROM pragma_table_list WHERE schema = 'main' AND type = 'table' AND wr = 0 AND lower(name) = lower($1)",
    )
    .bind(name)
    .fetch_optional(connection)
    .await?;
    Ok(found.is_some())
}

async fn listed(connection: &mut SqliteConnection) -> Result<Vec<Listed>, GeoPackageError> {
    let rows = sqlx::query(
        "SELECT CAST(c.table_name AS TEXT), CAST(g.column_name AS TEXT), upper(CAST(g.geometry_type_name AS TEXT)),
             CAST(g.srs_id AS INTEGER), CAST(s.organization AS TEXT), CAST(s.organization_coordsys_id AS INTEGER)
         FROM gpkg_contents c
             JOIN gpkg_geometry_columns g ON lower(g.table_name) = lower(c.table_name)
             LEFT JOIN gpkg_spatial_ref_sys s ON s.srs_id = g.srs_id
         WHERE c.data_type = 'features' AND g.column_name IS NOT NULL AND g.geometry_type_name IS NOT NULL
             AND g.srs_id IS NOT NULL
         ORDER BY c.table_name LIMIT $1",
    )
    .bind(MOST_TABLES)
    .fetch_all(connection)
    .await?;
    let listed = |row: &sqlx::sqlite::SqliteRow| {
        Ok(Listed {
            table: row.try_get(0)?,
            column: row.try_get(1)?,
            kind: row.try_get(2)?,
            srs_id: row.try_get(3)?,
            organization: row.try_get(4)?,
            code: row.try_get(5)?,
        })
    };
    rows.iter().map(listed).collect()
}

async fn layer(
    connection: &mut SqliteConnection,
    reading: &Reading,
    known: &mut KnownCrs,
    listed: Listed,
) -> Result<Layer, ReadError> {
    let Listed { table, column, kind, srs_id, organization, code } = listed;
    let crs = match (organization, code) {
        (Some(organization), Some(code)) if organization.trim().eq_ignore_ascii_case("EPSG") => {
            known.of(reading, Some(&Arc::from(format!("EPSG:{code}"))))?
        }
        // what was given is all that is known of it
        _ if reading.crs.is_some() => known.of(reading, None)?,
        (organization, code) => {
            let named = match (organization, code) {
                (Some(organization), Some(code)) => format!("{organization}:{code}"),
                _ => format!("srs_id {srs_id}"),
            };
            return Err(GeoPackageError::OtherCrs { table, named }.into());
        }
    };
    let unfit = |detail: &'static str| GeoPackageError::Table { table: table.clone(), detail };
    if !is_table(connection, &table).await? {
        return Err(unfit("it is a view, or no table with row numbers; store it as a table").into());
    }
    let columns = columns(connection, &table).await?;
    let geometry = columns.plain(&column).ok_or_else(|| unfit("it has no column of its geometry"))?;
    let row_id = ["rowid", "_rowid_", "oid"].into_iter().find(|name| !columns.has(name));
    let row_id = row_id.ok_or_else(|| unfit("its columns hide the row numbers"))?;
    let keys: &[&str] = if kind.ends_with("POLYGON") || kind.ends_with("SURFACE") { &KEYS_OF_SURFACES } else { &KEYS };
    let quoted = quoted(&table);
    let count = format!("SELECT count(*) FROM {quoted}");
    let rows: i64 =
        sqlx::query_scalar(AssertSqlSafe(count)).fetch_one(connection).await.map_err(GeoPackageError::from)?;
    let sql = columns.statement(&quoted, &geometry, row_id, keys);
    Ok(Layer { table, srs_id, crs, rows: rows.unsigned_abs(), sql })
}

/// The names of columns, with whether they are computed.
struct Columns(Vec<(String, bool)>);

async fn columns(connection: &mut SqliteConnection, table: &str) -> Result<Columns, GeoPackageError> {
    let columns: Vec<(String, bool)> = sqlx::query_as("SELECT name, hidden <> 0 FROM pragma_table_xinfo($1)")
        .bind(table)
        .fetch_all(connection)
        .await?;
    Ok(Columns(columns))
}

impl Columns {
    fn has(&self, name: &str) -> bool {
        self.0.iter().any(|(known, _)| known.eq_ignore_ascii_case(name))
    }

    /// A column that is not computed, as a statement names it.
    fn plain(&self, name: &str) -> Option<String> {
        let known = self.0.iter().find(|(known, computed)| !computed && known.eq_ignore_ascii_case(name));
        known.map(|(known, _)| format!("t.{}", quoted(known)))
    }

    /// A text that is not empty, or NULL.
    fn text(&self, name: &str) -> String {
        self.plain(name).map_or_else(
            || "NULL".to_owned(),
            |column| {
                format!("CASE WHEN octet_length({column}) <= {LONGEST_TEXT} THEN NULLIF(trim(CAST({column} AS TEXT)), '') END")
            },
        )
    }

    fn texts(&self, names: &[&str]) -> Vec<String> {
        names.iter().filter(|name| self.has(name)).map(|name| self.text(name)).collect()
    }

    /// What a row is called, in its table or by its number there.
    fn name(&self) -> String {
        let numbers = NUMBERS.iter().filter(|(column, _)| self.has(column));
        let numbered = numbers.map(|(column, between)| format!("$1 || '{between}' || {}", self.text(column)));
        first_of(&self.texts(&NAMES).into_iter().chain(numbered).collect::<Vec<_>>())
    }

    fn number(&self, name: &str) -> String {
        let (Some(column), text) = (self.plain(name), self.text(name)) else { return "NULL".to_owned() };
        // by way of a text a number would lose its last digits
        format!(
            "CASE WHEN typeof({column}) IN ('real', 'integer') THEN CAST({column} AS REAL) ELSE CAST({text} AS REAL) END"
        )
    }

    /// Reads the table with the rows of a building one after the other. What is sorted are the numbers of the rows, so
    /// that geometries need not be held for it.
    fn statement(&self, table: &str, geometry: &str, row_id: &str, keys: &[&str]) -> String {
        let (key, name) = (first_of(&self.texts(keys)), self.name());
        let [sigma, sigma_xy, sigma_z] = ["sigma_m", "sigma_xy", "sigma_z"].map(|name| self.number(name));
        let [kind, purpose, from, to] = ["edge_type", "use", "valid_from", "valid_to"].map(|name| self.text(name));
        let selected = format!(
            "SELECT t.{row_id},
                 CASE WHEN typeof({geometry}) = 'blob' AND length({geometry}) <= {MOST_BYTES} THEN {geometry} END,
                 {geometry} IS NULL, {key}, {name}, COALESCE({sigma}, max({sigma_xy}, {sigma_z}), {sigma_xy}, {sigma_z}),
                 {kind}, {purpose}, {from}, {to}"
        );
        match keys.iter().any(|name| self.plain(name).is_some()) {
            false => format!("{selected} FROM {table} AS t ORDER BY t.{row_id}"),
            true => format!(
                "{selected} FROM (SELECT t.{row_id} AS number FROM {table} AS t ORDER BY {key} COLLATE BINARY, t.{row_id}
                     LIMIT -1) AS sorted CROSS JOIN {table} AS t ON t.{row_id} = sorted.number"
            ),
        }
    }
}

/// The first of texts that is not NULL.
fn first_of(texts: &[String]) -> String {
    format!("COALESCE({}NULL, NULL)", texts.iter().map(|text| format!("{text}, ")).collect::<String>())
}

fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}
