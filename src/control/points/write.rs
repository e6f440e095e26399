//! Writing a batch of control points: a handful of statements, whatever its size.

use std::collections::HashMap;

use nalgebra::Vector3;

use crate::control::geojson::Rejection;
use crate::control::model::{StoredControlPoint, Use, Validity};
use crate::control::region::GeodeticBox;
use crate::control::sets::{REMOVED_AT_ONCE, counted, widened};
use crate::control::{ControlError, Mode, encoding, hilbert};
use crate::database::{Column, Database, Dialects, TEXTS, Transaction, query};

/// A control point that is ready to be written: all that can be done by other threads than the one that writes is done.
#[derive(Debug)]
pub(super) struct NewRow {
    /// Its place in the file.
    index: usize,
    name: String,
    sigma_m: f64,
    reference_m: Vector3<f64>,
    edges: Vec<u8>,
    purpose: Use,
    validity: Validity,
    bounds: GeodeticBox,
    /// How far along a curve through space: neighbours are to be near one another in the table and in its indices.
    curve: u64,
}

impl NewRow {
    pub(super) fn of(index: usize, point: StoredControlPoint) -> Self {
        let reference_m = point.reference_geocentric_m;
        let bounds = GeodeticBox::around_building(reference_m, point.points());
        let GeodeticBox { min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg } = bounds;
        Self {
            index,
            edges: encoding::to_bytes(&point.edges, point.sigma_m, reference_m),
            bounds,
            curve: hilbert::place([(min_lon_deg + max_lon_deg) / 2.0, (min_lat_deg + max_lat_deg) / 2.0]),
            name: point.name,
            sigma_m: point.sigma_m,
            reference_m,
            purpose: point.purpose,
            validity: point.validity,
        }
    }
}

/// Fewer rows than this stay in the order in which they were given, which is that of lists.
const CURVED: usize = 1_000;

/// Under which import, into which set, rows are written.
#[derive(Debug, Clone, Copy)]
pub(super) struct Target {
    pub(super) set_id: i64,
    pub(super) import_id: i64,
    pub(super) mode: Mode,
}

/// What became of a batch.
#[derive(Debug, Default)]
pub(super) struct Written {
    pub(super) imported: usize,
    pub(super) updated: usize,
    pub(super) rejected: Vec<Rejection>,
}

/// Writes the rows, but for those whose name is taken.
pub(super) async fn write_batch(
    transaction: &mut Transaction,
    target: Target,
    rows: Vec<NewRow>,
) -> Result<Written, ControlError> {
    let mut known = known(transaction, target.set_id, &rows).await?;
    let mut written = Written::default();
    let mut good: Vec<(Option<i64>, NewRow)> = Vec::with_capacity(rows.len());
    for row in rows {
        let before = known.insert(row.name.clone(), Known { id: None, import_id: target.import_id });
        let detail = match before {
            Some(before) if before.import_id == target.import_id => {
                "the name occurs earlier in this collection; names are unique"
            }
            Some(_) if target.mode == Mode::Insert => {
                "a control point of this name exists already; mode=upsert would update it"
            }
            before => {
                let id = before.and_then(|before| before.id);
                *(if id.is_some() { &mut written.updated } else { &mut written.imported }) += 1;
                good.push((id, row));
                continue;
            }
        };
        written.rejected.push(Rejection::new(row.index, Some(row.name), detail.to_owned()));
    }
    if good.len() >= CURVED {
        good.sort_by_key(|(_, row)| row.curve);
    }
    let mut numbers = new_numbers(transaction, written.imported).await?.into_iter();
    let rows: Vec<(i64, NewRow)> =
        good.into_iter().filter_map(|(id, row)| Some((id.or_else(|| numbers.next())?, row))).collect();
    if let Some(region) = rows.iter().map(|(_, row)| row.bounds).reduce(GeodeticBox::around_both) {
        widened(transaction, target.set_id, region).await?;
    }
    write(transaction, target, rows).await?;
    counted(transaction, target.set_id, written.imported as i64).await?;
    Ok(written)
}

/// A control point that is there already.
struct Known {
    /// `None` for one of this batch.
    id: Option<i64>,
    import_id: i64,
}

async fn known(
    transaction: &mut Transaction,
    set_id: i64,
    rows: &[NewRow],
) -> Result<HashMap<String, Known>, ControlError> {
    let names = serde_json::json!(rows.iter().map(|row| &row.name).collect::<Vec<_>>()).to_string();
    let sql = format!(
        "SELECT id, import_id, name FROM control_points WHERE name IN {} AND set_id = $2",
        transaction.dialect(TEXTS)
    );
    let found: Vec<(i64, i64, String)> =
        query(sqlx::AssertSqlSafe(sql)).bind(names).bind(set_id).fetch_all(transaction).await?;
    Ok(found.into_iter().map(|(id, import_id, name)| (name, Known { id: Some(id), import_id })).collect())
}

/// Numbers for new rows, one after the other.
async fn new_numbers(transaction: &mut Transaction, count: usize) -> Result<Vec<i64>, ControlError> {
    let count = count as i64;
    let last: i64 = match transaction {
        Transaction::Sqlite(_) => {
            let last: Option<i64> = query("SELECT max(id) FROM control_points").fetch_value(transaction).await?;
            last.unwrap_or(0) + count
        }
        // nobody else writes at this time
        Transaction::Postgres(_) if count > 0 => {
            query(
                "SELECT setval(of_ids, nextval(of_ids) + $1 - 1)
                 FROM CAST(pg_get_serial_sequence('control_points', 'id') AS regclass) AS of_ids",
            )
            .bind(count)
            .fetch_value(transaction)
            .await?
        }
        Transaction::Postgres(_) => 0,
    };
    Ok((last - count + 1..=last).collect())
}

async fn write(transaction: &mut Transaction, target: Target, rows: Vec<(i64, NewRow)>) -> Result<(), ControlError> {
    if rows.is_empty() {
        return Ok(());
    }
    let integers = |value: i64| Column::Integers(vec![value; rows.len()]);
    let ids = || Column::Integers(rows.iter().map(|(id, _)| *id).collect());
    let reals = |value: fn(&NewRow) -> f64| Column::Reals(rows.iter().map(|(_, row)| value(row)).collect());
    let boxes = [
        ("west", reals(|row| row.bounds.min_lon_deg)),
        ("east", reals(|row| row.bounds.max_lon_deg)),
        ("south", reals(|row| row.bounds.min_lat_deg)),
        ("north", reals(|row| row.bounds.max_lat_deg)),
    ];
    let dates = |value: fn(&Validity) -> Option<chrono::NaiveDate>| {
        Column::Dates(rows.iter().map(|(_, row)| value(&row.validity)).collect())
    };
    let mut columns = vec![
        ("id", ids()),
        ("set_id", integers(target.set_id)),
        ("import_id", integers(target.import_id)),
        ("is_check", Column::Booleans(rows.iter().map(|(_, row)| row.purpose == Use::Check).collect())),
        ("valid_from", dates(|validity| validity.from)),
        ("valid_to", dates(|validity| validity.to)),
        ("sigma_m", reals(|row| row.sigma_m)),
        ("reference_x_m", reals(|row| row.reference_m.x)),
        ("reference_y_m", reals(|row| row.reference_m.y)),
        ("reference_z_m", reals(|row| row.reference_m.z)),
    ];
    let ids = ids();
    let (names, edges) = rows.into_iter().map(|(_, row)| (row.name, row.edges)).unzip();
    columns.extend([("name", Column::Texts(names)), ("edges", Column::Bytes(edges))]);
    if let Transaction::Postgres(_) = transaction {
        columns.extend(boxes);
        transaction.execute_many(WRITE.postgres, columns).await?;
        return Ok(());
    }
    transaction.execute_many(WRITE.sqlite, columns).await?;
    let boxes = std::iter::once(("id", ids)).chain(boxes).collect();
    transaction.execute_many(WRITE_BOXES, boxes).await?;
    Ok(())
}

macro_rules! written {
    ($columns:literal, $values:literal, $set:literal) => {
        concat!(
            "INSERT INTO control_points (id, set_id, import_id, name, is_check, valid_from, valid_to, sigma_m,
                 reference_x_m, reference_y_m, reference_z_m, edges", $columns, ")
             SELECT id, set_id, import_id, name, is_check, valid_from, valid_to, sigma_m, reference_x_m, reference_y_m,
                 reference_z_m, edges", $values, " FROM given WHERE true
             ON CONFLICT (id) DO UPDATE SET import_id = excluded.import_id, is_check = excluded.is_check,
                 valid_from = excluded.valid_from, valid_to = excluded.valid_to, sigma_m = excluded.sigma_m,
                 reference_x_m = excluded.reference_x_m, reference_y_m = excluded.reference_y_m,
                 reference_z_m = excluded.reference_z_m, edges = excluded.edges", $set
        )
    };
}

/// PostgreSQL keeps the box in the row, SQLite in its R*Tree.
const WRITE: Dialects = Dialects {
    sqlite: written!("", "", ""),
    postgres: written!(", extent", ", box(point(west, south), point(east, north))", ", extent = excluded.extent"),
};

const WRITE_BOXES: &str = "INSERT OR REPLACE INTO control_point_boxes
         (id, min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg)
     SELECT id, west, east, south, north FROM given";

/// Removes what an import has not written from its set, some thousands at a time, so that others get to write in between.
pub(super) async fn remove_others(database: &Database, target: Target) -> Result<(), ControlError> {
    let mut after = 0_i64;
    loop {
        let mut transaction = database.begin_alone().await?;
        let others: Vec<i64> = query(
            "SELECT id FROM control_points WHERE id > $1 AND set_id = $2 AND import_id <> $3 ORDER BY id LIMIT $4",
        )
        .bind(after)
        .bind(target.set_id)
        .bind(target.import_id)
        .bind(REMOVED_AT_ONCE)
        .fetch_values(&mut transaction)
        .await?;
        let Some(last) = others.last() else { return Ok(()) };
        after = *last;
        remove_numbers(&mut transaction, target.set_id, others).await?;
        transaction.commit().await?;
    }
}

/// Removes control points of a set by the numbers of their rows.
pub(in crate::control) async fn remove_numbers(
    transaction: &mut Transaction,
    set_id: i64,
    numbers: Vec<i64>,
) -> Result<(), ControlError> {
    let removed = numbers.len() as i64;
    let given = || vec![("id", Column::Integers(numbers.clone()))];
    if let Transaction::Sqlite(_) = transaction {
        let boxes = "DELETE FROM control_point_boxes WHERE id IN (SELECT id FROM given)";
        transaction.execute_many(boxes, given()).await?;
    }
    transaction.execute_many("DELETE FROM control_points WHERE id IN (SELECT id FROM given)", given()).await?;
    counted(transaction, set_id, -removed).await
}
