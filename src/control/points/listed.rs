//! The control points that a list asks for, and where all of them lie.

use super::rows::Row;
use super::{Filter, Kept, in_box};
use crate::control::ControlError;
use crate::control::region::GeodeticBox;
use crate::database::{Database, containing, query};

/// The control points that are wanted, by ascending id, from the first one after `after`, at most `limit`: those whose
/// box touches the region, if there is one. The boxes being rounded outward, some may lie just outside of it.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn listed(
    database: &Database,
    region: Option<GeodeticBox>,
    filter: &Filter,
    after: i64,
    limit: usize,
) -> Result<Vec<Kept>, ControlError> {
    if let Some(region) = region {
        return in_box(database, region, filter, after, limit).await;
    }
    let sets = filter.sets.as_ref().map(|sets| serde_json::json!(sets).to_string());
    let of_sets = match database {
        Database::Sqlite(_) => "set_id IN (SELECT id FROM control_sets WHERE name IN (SELECT value FROM json_each(?)))",
        Database::Postgres(_) => {
            "set_id IN (SELECT id FROM control_sets WHERE name IN (SELECT json_array_elements_text(?::json)))"
        }
    };
    let rows: Vec<Row> = query("SELECT * FROM control_points WHERE id > $1")
        .bind(after)
        .and(of_sets, sets)
        .and("(valid_from IS NULL OR valid_from <= ?)", filter.date.map(Some))
        .and("(valid_to IS NULL OR valid_to >= ?)", filter.date.map(Some))
        .and("lower(name) LIKE lower(?) ESCAPE '\\'", filter.name.as_deref().map(containing))
        .then(" ORDER BY id LIMIT ?")
        .bind(i64::try_from(limit).unwrap_or(i64::MAX))
        .fetch_all(database)
        .await?;
    rows.into_iter().map(Kept::try_from).collect()
}

/// How many control points there are, and a box around all that was imported, if there are any left of it.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn extent(database: &Database) -> Result<(u64, Option<GeodeticBox>), ControlError> {
    type Bounds = (Option<i64>, Option<f64>, Option<f64>, Option<f64>, Option<f64>);
    let (count, west, east, south, north): Bounds = query(
        "SELECT CAST(sum(points) AS BIGINT), min(min_lon_deg), max(max_lon_deg), min(min_lat_deg), max(max_lat_deg)
         FROM control_sets WHERE points > 0",
    )
    .fetch_one(database)
    .await?;
    let bounds = match (west, east, south, north) {
        (Some(min_lon_deg), Some(max_lon_deg), Some(min_lat_deg), Some(max_lat_deg)) => {
            Some(GeodeticBox { min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg })
        }
        _ => None,
    };
    Ok((count.unwrap_or_default().unsigned_abs(), bounds))
}
