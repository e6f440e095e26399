//! The control points that a list asks for, and where all of them lie.

use super::{COLUMNS, IN_BOX, Row, rows_in_box};
use crate::control::ControlError;
use crate::control::model::StoredControlPoint;
use crate::control::region::GeodeticBox;
use crate::database::{Database, Dialects, containing, query};

/// What a list of control points is restricted to.
#[derive(Debug, Clone, Copy, Default)]
pub struct Wanted<'w> {
    /// Only those whose box touches it.
    pub region: Option<GeodeticBox>,
    /// Only those with this in their name, in small or capital letters.
    pub name: Option<&'w str>,
}

/// The control points that are wanted, by ascending id, from the first one after `after`, at most `limit`; the boxes being
/// rounded outward, some may lie just outside of the region.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn listed(
    database: &Database,
    wanted: Wanted<'_>,
    after: i64,
    limit: usize,
) -> Result<Vec<(i64, StoredControlPoint)>, ControlError> {
    let pattern = wanted.name.map(containing);
    let rows: Vec<Row> = match wanted.region {
        Some(region) => match pattern {
            None => rows_in_box(database, IN_BOX, region, (after, limit), |query| query).await?,
            Some(name) => {
                rows_in_box(database, NAMED_IN_BOX, region, (after, limit), |query| query.bind(&name)).await?
            }
        },
        None => {
            query("SELECT ")
                .then(COLUMNS)
                .then(" FROM control_points WHERE id > ?")
                .bind(after)
                .and("lower(name) LIKE lower(?) ESCAPE '\\'", pattern)
                .then(" ORDER BY id LIMIT ?")
                .bind(i64::try_from(limit).unwrap_or(i64::MAX))
                .fetch_all(database)
                .await?
        }
    };
    rows.into_iter().map(Row::with_id).collect()
}

/// As [`IN_BOX`], with the pattern of the name as its last parameter.
const NAMED_IN_BOX: Dialects = Dialects {
    sqlite: "SELECT p.id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges
             FROM control_point_boxes b CROSS JOIN control_points p ON p.id = b.id
             WHERE b.max_lon_deg >= $1 AND b.min_lon_deg <= $2 AND b.max_lat_deg >= $3 AND b.min_lat_deg <= $4
                 AND b.id > $5 AND lower(name) LIKE lower($7) ESCAPE '\\'
             ORDER BY p.id LIMIT $6",
    postgres: "WITH near AS MATERIALIZED (
                   SELECT id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges FROM control_points
                   WHERE extent && box(point($1, $3), point($2, $4)))
               SELECT * FROM near WHERE id > $5 AND lower(name) LIKE lower($7) ESCAPE '\\' ORDER BY id LIMIT $6",
};

/// How many control points there are, and a box around them, if there are any.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn extent(database: &Database) -> Result<(u64, Option<GeodeticBox>), ControlError> {
    type Bounds = (i64, Option<f64>, Option<f64>, Option<f64>, Option<f64>);
    let (count, west, east, south, north): Bounds = query(database.dialect(EXTENT)).fetch_one(database).await?;
    let bounds = match (west, east, south, north) {
        (Some(min_lon_deg), Some(max_lon_deg), Some(min_lat_deg), Some(max_lat_deg)) => {
            Some(GeodeticBox { min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg })
        }
        _ => None,
    };
    Ok((count.unsigned_abs(), bounds))
}

/// Of a box PostgreSQL's first corner is the upper right one.
const EXTENT: Dialects = Dialects {
    sqlite: "SELECT count(*), min(min_lon_deg), max(max_lon_deg), min(min_lat_deg), max(max_lat_deg)
             FROM control_point_boxes",
    postgres: "SELECT count(*), min((extent[1])[0]), max((extent[0])[0]), min((extent[1])[1]), max((extent[0])[1])
               FROM control_points",
};
