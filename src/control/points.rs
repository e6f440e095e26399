//! The control points in the database: what lies in a rectangle of longitude and latitude, and import in batches. SQLite
//! has an R*Tree for it, PostgreSQL an index of boxes.

mod import;
mod listed;
mod resume;
mod rows;
mod write;

use chrono::NaiveDate;
use rayon::prelude::*;

use super::ControlError;
use super::model::StoredControlPoint;
use super::region::GeodeticBox;
use super::sets::counted;
use crate::database::{Database, Dialects, Query, Record, Transaction, query};
use rows::Row;

pub use import::{Import, ImportError, Step, import};
pub use listed::{extent, listed};
pub use resume::FileIdentity;

pub(super) use write::remove_numbers;

/// A control point of the database.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// The number of its row.
    pub id: i64,
    /// The number of its set's row.
    pub set_id: i64,
    /// What it is.
    pub point: StoredControlPoint,
}

/// Which control points are asked for.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Filter {
    /// Only those of the sets of these names.
    pub sets: Option<Vec<String>>,
    /// Only those that stand like this on that day.
    pub date: Option<NaiveDate>,
    /// Only those with this in their name, in small or capital letters.
    pub name: Option<String>,
}

/// The control points whose box touches `region`, by ascending id, from the first one after `after`, at most `limit`;
/// the boxes being rounded outward, some may lie just outside.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn in_box(
    database: &Database,
    region: GeodeticBox,
    filter: &Filter,
    after: i64,
    limit: usize,
) -> Result<Vec<Kept>, ControlError> {
    let rows: Vec<Row> = rows_in_box(database, IN_BOX, region, (after, limit), |query| filter.bound(query)).await?;
    rows.into_par_iter().map(Kept::try_from).collect()
}

/// The parameters are those of the box, the id after which the rows begin, how many there are at most, and those of the
/// [`Filter`]. SQLite puts only ids in order: rows carry all their edges. CROSS JOIN keeps it from walking through all
/// points in the order that is wanted; the materialized part keeps PostgreSQL from it.
const IN_BOX: Dialects = Dialects {
    sqlite: "WITH wanted AS MATERIALIZED (
                 SELECT p.id
                 FROM control_point_boxes b CROSS JOIN control_points p ON p.id = b.id
                 WHERE b.max_lon_deg >= $1 AND b.min_lon_deg <= $2 AND b.max_lat_deg >= $3 AND b.min_lat_deg <= $4
                     AND b.id > $5
                     AND ($7 IS NULL OR set_id IN
                         (SELECT id FROM control_sets WHERE name IN (SELECT value FROM json_each($7))))
                     AND ($8 IS NULL OR COALESCE(valid_from, $8) <= $8 AND COALESCE(valid_to, $8) >= $8)
                     AND ($9 IS NULL OR lower(name) LIKE lower($9) ESCAPE '\\')
                 ORDER BY p.id LIMIT $6)
             SELECT p.id, set_id, name, is_check, valid_from, valid_to, sigma_m, reference_x_m, reference_y_m,
                 reference_z_m, edges
             FROM wanted CROSS JOIN control_points p ON p.id = wanted.id",
    postgres: "WITH near AS MATERIALIZED (
                   SELECT id, set_id, name, is_check, valid_from, valid_to, sigma_m, reference_x_m, reference_y_m,
                       reference_z_m, edges
                   FROM control_points WHERE extent && box(point($1, $3), point($2, $4)))
               SELECT * FROM near
               WHERE id > $5
                   AND ($7::text IS NULL OR set_id IN
                       (SELECT id FROM control_sets WHERE name IN (SELECT json_array_elements_text($7::json))))
                   AND ($8::date IS NULL OR COALESCE(valid_from, $8) <= $8 AND COALESCE(valid_to, $8) >= $8)
                   AND ($9::text IS NULL OR lower(name) LIKE lower($9) ESCAPE '\\')
               ORDER BY id LIMIT $6",
};

impl Filter {
    /// Binds what [`IN_BOX`] has after the box.
    fn bound(&self, query: Query) -> Query {
        let sets = self.sets.as_ref().map(|sets| serde_json::json!(sets).to_string());
        let pattern = self.name.as_deref().map(crate::database::containing);
        query.bind(sets).bind(self.date).bind(pattern)
    }
}

/// The search of one box, to look at how it is answered.
#[cfg(test)]
pub(super) fn searched(database: &Database, region: GeodeticBox) -> Query {
    let query = with_box(query(database.dialect(IN_BOX)), region).bind(0_i64).bind(i64::MAX);
    Filter::default().bound(query)
}

/// The four parameters of a box: least and largest longitude, least and largest latitude.
pub(super) fn with_box(query: Query, bounds: GeodeticBox) -> Query {
    query.bind(bounds.min_lon_deg).bind(bounds.max_lon_deg).bind(bounds.min_lat_deg).bind(bounds.max_lat_deg)
}

/// A row with its number.
pub(super) trait Numbered {
    /// The number, by which rows are ordered.
    fn id(&self) -> i64;
}

/// Rows, by ascending id, of a query for what lies in a box: its parameters are least and largest longitude, least and
/// largest latitude, the id after which the rows begin, how many there are at most, and those that `more` binds.
pub(super) async fn rows_in_box<R: Record + Numbered>(
    database: &Database,
    sql: Dialects,
    region: GeodeticBox,
    (after, limit): (i64, usize),
    more: impl Fn(Query) -> Query,
) -> Result<Vec<R>, sqlx::Error> {
    let limit_rows = i64::try_from(limit).unwrap_or(i64::MAX);
    let mut found: Vec<R> = Vec::new();
    for part in region.unwrapped() {
        let rows = with_box(query(database.dialect(sql)), part).bind(after).bind(limit_rows);
        found.extend(more(rows).fetch_all(database).await?);
    }
    // a region across the antimeridian is asked for in two parts
    found.sort_by_key(Numbered::id);
    found.dedup_by_key(|row| row.id());
    found.truncate(limit);
    Ok(found)
}

/// The control point of a name in a set.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn by_name(database: &Database, set: &str, name: &str) -> Result<Option<Kept>, ControlError> {
    let row: Option<Row> = query(
        "SELECT * FROM control_points WHERE set_id = (SELECT id FROM control_sets WHERE name = $1) AND name = $2",
    )
    .bind(set)
    .bind(name)
    .fetch_optional(database)
    .await?;
    row.map(Kept::try_from).transpose()
}

/// Removes the control point of a name in a set; `false` if there is none.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn remove(database: &Database, set: &str, name: &str) -> Result<bool, ControlError> {
    let mut transaction = database.begin().await?;
    let removed: Option<(i64, i64)> = query(
        "DELETE FROM control_points WHERE set_id = (SELECT id FROM control_sets WHERE name = $1) AND name = $2
         RETURNING id, set_id",
    )
    .bind(set)
    .bind(name)
    .fetch_optional(&mut transaction)
    .await?;
    let Some((id, set_id)) = removed else { return Ok(false) };
    if let Transaction::Sqlite(_) = &transaction {
        query("DELETE FROM control_point_boxes WHERE id = $1").bind(id).execute(&mut transaction).await?;
    }
    counted(&mut transaction, set_id, -1).await?;
    transaction.commit().await?;
    Ok(true)
}

/// How many control points there are.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn count(database: &Database) -> Result<u64, ControlError> {
    let count: Option<i64> =
        query("SELECT CAST(sum(points) AS BIGINT) FROM control_sets").fetch_value(database).await?;
    Ok(count.unwrap_or_default().unsigned_abs())
}
