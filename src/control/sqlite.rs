//! The control points of the embedded database: import in batches, and what lies in a rectangle of longitude and
//! latitude, by its R*Tree.

use std::collections::HashMap;

use nalgebra::Vector3;
use sqlx::sqlite::{SqlitePoolOptions, SqliteRow};
use sqlx::{Row, Sqlite, SqlitePool, Transaction};

use super::geojson::{Parsed, Rejection};
use super::model::StoredControlPoint;
use super::region::{GeodeticBox, longitude_latitude_deg};
use super::{ControlError, ImportReport, Mode};

/// So many control points are written in one transaction: large enough that waiting for the disk does not count,
/// small enough that others get to write in between.
const BATCH: usize = 2_000;

/// A database of control alone, in memory, which ends with the pool.
///
/// # Errors
/// [`ControlError`] if SQLite cannot make it.
pub async fn in_memory() -> Result<SqlitePool, ControlError> {
    // one connection, that never ends: each one would have its own memory
    let options = SqlitePoolOptions::new().max_connections(1).idle_timeout(None).max_lifetime(None);
    let pool = options.connect("sqlite::memory:").await?;
    for tables in [
        include_str!("../../migrations/sqlite/0050_control_points.sql"),
        include_str!("../../migrations/sqlite/0055_control_scenes.sql"),
    ] {
        sqlx::raw_sql(tables).execute(&pool).await?;
    }
    Ok(pool)
}

/// Writes the good features of a collection. `progress` is told how many are done after each batch.
///
/// `replace` is one transaction: all control points that are not in the collection are removed, but only if the
/// collection has at least one good feature.
///
/// # Errors
/// [`ControlError`] if the database fails; what was written in earlier batches stays.
pub async fn import(
    pool: &SqlitePool,
    parsed: Parsed,
    mode: Mode,
    mut progress: impl FnMut(usize),
) -> Result<ImportReport, ControlError> {
    let mut report = ImportReport { rejected: parsed.rejected, ..ImportReport::default() };
    let batch = if mode == Mode::Replace { parsed.control_points.len().max(1) } else { BATCH };
    let mut done = 0;
    for (number, points) in parsed.control_points.chunks(batch).enumerate() {
        let mut transaction = pool.begin_with("BEGIN IMMEDIATE").await?;
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
    transaction: &mut Transaction<'_, Sqlite>,
    points: &[(usize, StoredControlPoint)],
    mode: Mode,
    report: &mut ImportReport,
) -> Result<(), ControlError> {
    let known = known_names(transaction, points).await?;
    for (index, point) in points {
        let before = known.get(point.name.as_str()).copied();
        if before.is_some() && mode == Mode::Insert {
            let detail = "a control point of this name exists already; mode=upsert would update it".to_owned();
            report.rejected.push(Rejection { index: *index, name: Some(point.name.clone()), detail });
            continue;
        }
        write(transaction, before, point).await?;
        match before {
            Some(_) => report.updated += 1,
            None => report.imported += 1,
        }
    }
    Ok(())
}

fn names_as_json(points: &[(usize, StoredControlPoint)]) -> String {
    serde_json::json!(points.iter().map(|(_, point)| &point.name).collect::<Vec<_>>()).to_string()
}

async fn known_names(
    transaction: &mut Transaction<'_, Sqlite>,
    points: &[(usize, StoredControlPoint)],
) -> Result<HashMap<String, i64>, ControlError> {
    let rows: Vec<(String, i64)> =
        sqlx::query_as("SELECT name, id FROM control_points WHERE name IN (SELECT value FROM json_each(?1))")
            .bind(names_as_json(points))
            .fetch_all(&mut **transaction)
            .await?;
    Ok(rows.into_iter().collect())
}

async fn remove_all_but(
    transaction: &mut Transaction<'_, Sqlite>,
    points: &[(usize, StoredControlPoint)],
) -> Result<(), ControlError> {
    let kept = names_as_json(points);
    sqlx::query(
        "DELETE FROM control_point_boxes WHERE id IN
             (SELECT id FROM control_points WHERE name NOT IN (SELECT value FROM json_each(?1)))",
    )
    .bind(&kept)
    .execute(&mut **transaction)
    .await?;
    sqlx::query("DELETE FROM control_points WHERE name NOT IN (SELECT value FROM json_each(?1))")
        .bind(&kept)
        .execute(&mut **transaction)
        .await?;
    Ok(())
}

async fn write(
    transaction: &mut Transaction<'_, Sqlite>,
    before: Option<i64>,
    point: &StoredControlPoint,
) -> Result<(), ControlError> {
    let reference = point.reference_geocentric_m;
    let id: i64 = sqlx::query_scalar(
        "INSERT INTO control_points (id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)
         ON CONFLICT (name) DO UPDATE SET sigma_m = excluded.sigma_m, reference_x_m = excluded.reference_x_m,
             reference_y_m = excluded.reference_y_m, reference_z_m = excluded.reference_z_m, edges = excluded.edges
         RETURNING id",
    )
    .bind(before)
    .bind(&point.name)
    .bind(point.sigma_m)
    .bind(reference.x)
    .bind(reference.y)
    .bind(reference.z)
    .bind(point.edges_to_bytes())
    .fetch_one(&mut **transaction)
    .await?;
    let bounds = GeodeticBox::around_points(point.points().map(longitude_latitude_deg));
    sqlx::query(
        "INSERT OR REPLACE INTO control_point_boxes (id, min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg)
         VALUES (?1, ?2, ?3, ?4, ?5)",
    )
    .bind(id)
    .bind(bounds.min_lon_deg)
    .bind(bounds.max_lon_deg)
    .bind(bounds.min_lat_deg)
    .bind(bounds.max_lat_deg)
    .execute(&mut **transaction)
    .await?;
    Ok(())
}

/// The control points whose box touches `region`, by ascending id, from the first one after `after`, at most `limit`;
/// the boxes being rounded outward, some may lie just outside.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn in_box(
    pool: &SqlitePool,
    region: GeodeticBox,
    after: i64,
    limit: usize,
) -> Result<Vec<(i64, StoredControlPoint)>, ControlError> {
    // CROSS JOIN keeps SQLite from walking through all points in the order that is wanted
    let sql = "SELECT p.id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges
               FROM control_point_boxes b CROSS JOIN control_points p ON p.id = b.id
               WHERE b.max_lon_deg >= ?1 AND b.min_lon_deg <= ?2 AND b.max_lat_deg >= ?3 AND b.min_lat_deg <= ?4
                   AND b.id > ?5
               ORDER BY p.id LIMIT ?6";
    with_ids(&rows_in_box(pool, sql, region, after, limit).await?)
}

/// Rows, by ascending `id`, of a query for what lies in a box: its parameters are least and largest longitude, least
/// and largest latitude, the id after which the rows begin, and how many there are at most.
pub(super) async fn rows_in_box(
    pool: &SqlitePool,
    sql: &'static str,
    region: GeodeticBox,
    after: i64,
    limit: usize,
) -> Result<Vec<SqliteRow>, sqlx::Error> {
    let limit_rows = i64::try_from(limit).unwrap_or(i64::MAX);
    let mut found: Vec<(i64, SqliteRow)> = Vec::new();
    for part in region.unwrapped() {
        let rows = sqlx::query(sql)
            .bind(part.min_lon_deg)
            .bind(part.max_lon_deg)
            .bind(part.min_lat_deg)
            .bind(part.max_lat_deg)
            .bind(after)
            .bind(limit_rows)
            .fetch_all(pool)
            .await?;
        for row in rows {
            found.push((row.try_get("id")?, row));
        }
    }
    // a region across the antimeridian is asked for in two parts
    found.sort_by_key(|(id, _)| *id);
    found.dedup_by_key(|(id, _)| *id);
    found.truncate(limit);
    Ok(found.into_iter().map(|(_, row)| row).collect())
}

/// The control points by ascending id, from the first one after `after`, at most `limit`.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn all(pool: &SqlitePool, after: i64, limit: usize) -> Result<Vec<(i64, StoredControlPoint)>, ControlError> {
    let rows = sqlx::query(
        "SELECT id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges
         FROM control_points WHERE id > ?1 ORDER BY id LIMIT ?2",
    )
    .bind(after)
    .bind(i64::try_from(limit).unwrap_or(i64::MAX))
    .fetch_all(pool)
    .await?;
    with_ids(&rows)
}

fn with_ids(rows: &[SqliteRow]) -> Result<Vec<(i64, StoredControlPoint)>, ControlError> {
    rows.iter().map(|row| Ok((row.try_get("id")?, stored(row)?))).collect()
}

/// The control point of a name.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn by_name(pool: &SqlitePool, name: &str) -> Result<Option<StoredControlPoint>, ControlError> {
    let row = sqlx::query(
        "SELECT name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges FROM control_points WHERE name = ?1",
    )
    .bind(name)
    .fetch_optional(pool)
    .await?;
    row.as_ref().map(stored).transpose()
}

/// How many control points there are.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn count(pool: &SqlitePool) -> Result<u64, ControlError> {
    let count: i64 = sqlx::query_scalar("SELECT count(*) FROM control_points").fetch_one(pool).await?;
    Ok(count.unsigned_abs())
}

fn stored(row: &SqliteRow) -> Result<StoredControlPoint, ControlError> {
    let name: String = row.try_get("name")?;
    let edges_geocentric_m = StoredControlPoint::edges_from_bytes(row.try_get("edges")?)
        .ok_or_else(|| ControlError::Damaged { name: name.clone() })?;
    Ok(StoredControlPoint {
        sigma_m: row.try_get("sigma_m")?,
        reference_geocentric_m: Vector3::new(
            row.try_get("reference_x_m")?,
            row.try_get("reference_y_m")?,
            row.try_get("reference_z_m")?,
        ),
        edges_geocentric_m,
        name,
    })
}
