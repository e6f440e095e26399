//! The control points in the database: import in batches, and what lies in a rectangle of longitude and latitude. SQLite
//! has an R*Tree for it, PostgreSQL an index of boxes.

mod listed;

use std::collections::HashSet;

use nalgebra::Vector3;
use sqlx::{AssertSqlSafe, FromRow};

use super::geojson::{Parsed, Rejection};
use super::model::StoredControlPoint;
use super::region::{GeodeticBox, longitude_latitude_deg};
use super::{ControlError, ImportReport, Mode};
use crate::database::{Database, Dialects, Query, Record, TEXTS, Transaction, query};

pub use listed::{Wanted, extent, listed};

/// So many control points are written in one transaction: large enough that waiting for the disk does not count,
/// small enough that others get to write in between.
const BATCH: usize = 2_000;

/// Writes the good features of a collection. `progress` is told how many are done after each batch.
///
/// `replace` is one transaction: all control points that are not in the collection are removed, but only if the
/// collection has at least one good feature.
///
/// # Errors
/// [`ControlError`] if the database fails; what was written in earlier batches stays.
pub async fn import(
    database: &Database,
    parsed: Parsed,
    mode: Mode,
    mut progress: impl FnMut(usize),
) -> Result<ImportReport, ControlError> {
    let mut report = ImportReport { rejected: parsed.rejected, ..ImportReport::default() };
    let batch = if mode == Mode::Replace { parsed.control_points.len().max(1) } else { BATCH };
    let mut done = 0;
    for (number, points) in parsed.control_points.chunks(batch).enumerate() {
        let mut transaction = database.begin_alone().await?;
        if mode == Mode::Replace && number == 0 {
            remove_all_but(&mut transaction, points).await?;
        }
        write_batch(&mut transaction, points, mode, &mut report).await?;
        transaction.commit().await?;
        done += points.len();
        progress(done);
    }
    report.rejected.sort_by_key(|rejection| rejection.index);
    Ok(report)
}

async fn write_batch(
    transaction: &mut Transaction,
    points: &[(usize, StoredControlPoint)],
    mode: Mode,
    report: &mut ImportReport,
) -> Result<(), ControlError> {
    let known = known_names(transaction, points).await?;
    for (index, point) in points {
        let known = known.contains(point.name.as_str());
        if known && mode == Mode::Insert {
            let detail = "a control point of this name exists already; mode=upsert would update it".to_owned();
            report.rejected.push(Rejection { index: *index, name: Some(point.name.clone()), detail });
            continue;
        }
        write(transaction, point).await?;
        match known {
            true => report.updated += 1,
            false => report.imported += 1,
        }
    }
    Ok(())
}

fn names_as_json(points: &[(usize, StoredControlPoint)]) -> String {
    serde_json::json!(points.iter().map(|(_, point)| &point.name).collect::<Vec<_>>()).to_string()
}

async fn known_names(
    transaction: &mut Transaction,
    points: &[(usize, StoredControlPoint)],
) -> Result<HashSet<String>, ControlError> {
    let names: Vec<String> =
        query(AssertSqlSafe(format!("SELECT name FROM control_points WHERE name IN {}", transaction.dialect(TEXTS))))
            .bind(names_as_json(points))
            .fetch_values(transaction)
            .await?;
    Ok(names.into_iter().collect())
}

async fn remove_all_but(
    transaction: &mut Transaction,
    points: &[(usize, StoredControlPoint)],
) -> Result<(), ControlError> {
    let kept = names_as_json(points);
    let others = format!("SELECT id FROM control_points WHERE name NOT IN {}", transaction.dialect(TEXTS));
    if let Transaction::Sqlite(_) = transaction {
        let boxes = format!("DELETE FROM control_point_boxes WHERE id IN ({others})");
        query(AssertSqlSafe(boxes)).bind(&kept).execute(&mut *transaction).await?;
    }
    let points = format!("DELETE FROM control_points WHERE id IN ({others})");
    query(AssertSqlSafe(points)).bind(&kept).execute(transaction).await?;
    Ok(())
}

async fn write(transaction: &mut Transaction, point: &StoredControlPoint) -> Result<(), ControlError> {
    let bounds = GeodeticBox::around_points(point.points().map(longitude_latitude_deg));
    let reference = point.reference_geocentric_m;
    let row = query(transaction.dialect(WRITE))
        .bind(&point.name)
        .bind(point.sigma_m)
        .bind(reference.x)
        .bind(reference.y)
        .bind(reference.z)
        .bind(point.edges_to_bytes());
    if let Transaction::Postgres(_) = transaction {
        with_box(row, bounds).execute(transaction).await?;
        return Ok(());
    }
    let id: i64 = row.fetch_value(&mut *transaction).await?;
    let boxes = "INSERT OR REPLACE INTO control_point_boxes (id, min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg)
                 VALUES ($1, $2, $3, $4, $5)";
    with_box(query(boxes).bind(id), bounds).execute(transaction).await?;
    Ok(())
}

/// PostgreSQL keeps the box in the row, SQLite in its R*Tree.
const WRITE: Dialects = Dialects {
    sqlite: "INSERT INTO control_points (name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges)
             VALUES ($1, $2, $3, $4, $5, $6)
             ON CONFLICT (name) DO UPDATE SET sigma_m = excluded.sigma_m, reference_x_m = excluded.reference_x_m,
                 reference_y_m = excluded.reference_y_m, reference_z_m = excluded.reference_z_m,
                 edges = excluded.edges
             RETURNING id",
    postgres: "INSERT INTO control_points
                   (name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges, extent)
               VALUES ($1, $2, $3, $4, $5, $6, box(point($7, $9), point($8, $10)))
               ON CONFLICT (name) DO UPDATE SET sigma_m = excluded.sigma_m, reference_x_m = excluded.reference_x_m,
                   reference_y_m = excluded.reference_y_m, reference_z_m = excluded.reference_z_m,
                   edges = excluded.edges, extent = excluded.extent",
};

/// The four parameters of a box: least and largest longitude, least and largest latitude.
pub(super) fn with_box(query: Query, bounds: GeodeticBox) -> Query {
    query.bind(bounds.min_lon_deg).bind(bounds.max_lon_deg).bind(bounds.min_lat_deg).bind(bounds.max_lat_deg)
}

/// The control points whose box touches `region`, by ascending id, from the first one after `after`, at most `limit`;
/// the boxes being rounded outward, some may lie just outside.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn in_box(
    database: &Database,
    region: GeodeticBox,
    after: i64,
    limit: usize,
) -> Result<Vec<(i64, StoredControlPoint)>, ControlError> {
    let rows: Vec<Row> = rows_in_box(database, IN_BOX, region, (after, limit), |query| query).await?;
    rows.into_iter().map(Row::with_id).collect()
}

/// The parameters are those of the box, the id after which the rows begin, and how many there are at most. CROSS JOIN
/// keeps SQLite from walking through all points in the order that is wanted; the materialized part keeps PostgreSQL from
/// it.
const IN_BOX: Dialects = Dialects {
    sqlite: "SELECT p.id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges
             FROM control_point_boxes b CROSS JOIN control_points p ON p.id = b.id
             WHERE b.max_lon_deg >= $1 AND b.min_lon_deg <= $2 AND b.max_lat_deg >= $3 AND b.min_lat_deg <= $4
                 AND b.id > $5
             ORDER BY p.id LIMIT $6",
    postgres: "WITH near AS MATERIALIZED (
                   SELECT id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges FROM control_points
                   WHERE extent && box(point($1, $3), point($2, $4)))
               SELECT * FROM near WHERE id > $5 ORDER BY id LIMIT $6",
};

/// The search of one box, to look at how it is answered.
#[cfg(test)]
pub(super) fn searched(database: &Database, region: GeodeticBox) -> Query {
    with_box(query(database.dialect(IN_BOX)), region).bind(0_i64).bind(i64::MAX)
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

/// The control point of a name.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn by_name(database: &Database, name: &str) -> Result<Option<StoredControlPoint>, ControlError> {
    let named = query("SELECT ").then(COLUMNS).then(" FROM control_points WHERE name = ?").bind(name);
    let row: Option<Row> = named.fetch_optional(database).await?;
    row.map(|row| Ok(row.with_id()?.1)).transpose()
}

/// Removes the control point of a name; `false` if there is none.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn remove(database: &Database, name: &str) -> Result<bool, ControlError> {
    let mut transaction = database.begin().await?;
    let removed = query("DELETE FROM control_points WHERE name = $1 RETURNING id").bind(name);
    let id: Option<i64> = removed.fetch_optional_value(&mut transaction).await?;
    if let (Some(id), Transaction::Sqlite(_)) = (id, &transaction) {
        query("DELETE FROM control_point_boxes WHERE id = $1").bind(id).execute(&mut transaction).await?;
    }
    transaction.commit().await?;
    Ok(id.is_some())
}

/// How many control points there are.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn count(database: &Database) -> Result<u64, ControlError> {
    let count: i64 = query("SELECT count(*) FROM control_points").fetch_value(database).await?;
    Ok(count.unsigned_abs())
}

/// The columns of a [`Row`].
const COLUMNS: &str = "id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges";

#[derive(FromRow)]
struct Row {
    id: i64,
    name: String,
    sigma_m: f64,
    reference_x_m: f64,
    reference_y_m: f64,
    reference_z_m: f64,
    edges: Vec<u8>,
}

impl Numbered for Row {
    fn id(&self) -> i64 {
        self.id
    }
}

impl Row {
    fn with_id(self) -> Result<(i64, StoredControlPoint), ControlError> {
        let edges_geocentric_m = StoredControlPoint::edges_from_bytes(&self.edges)
            .ok_or_else(|| ControlError::Damaged { name: self.name.clone() })?;
        let point = StoredControlPoint {
            name: self.name,
            sigma_m: self.sigma_m,
            reference_geocentric_m: Vector3::new(self.reference_x_m, self.reference_y_m, self.reference_z_m),
            edges_geocentric_m,
        };
        Ok((self.id, point))
    }
}
