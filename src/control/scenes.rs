//! Control scenes as they are kept: geocentric like all control, with the file of the picture as it came.

use std::sync::Arc;

use chrono::{DateTime, Utc};
use nalgebra::{Vector2, Vector3};
use sqlx::sqlite::SqliteRow;
use sqlx::{Row as _, Sqlite, SqlitePool, Transaction};
use uuid::Uuid;

use super::ControlError;
use super::region::{GeodeticBox, longitude_latitude_deg};
use super::sqlite::rows_in_box;
use crate::geometry::LocalFrame;
use crate::orientation::ControlPoint;
use crate::scenes::Scene;

/// What is said of the picture of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneContent {
    /// Unique among the scenes.
    pub name: String,
    /// Columns and rows of the picture.
    pub size_px: [u32; 2],
    /// Ground sample distance of the picture.
    pub gsd_m: f64,
    /// Where the upper edge of the picture points to: clockwise from true north.
    pub azimuth_of_image_up_deg: f64,
    /// Its standard deviation.
    pub sigma_azimuth_deg: f64,
    /// The reference point in the picture: x right, y down, from the corner of the top-left pixel.
    pub reference_px: [f64; 2],
    /// The reference point on the ground.
    pub reference_geocentric_m: Vector3<f64>,
    /// Standard deviation of its coordinates, the accuracy of the transformation from its CRS included.
    pub sigma_m: f64,
    /// What the file of the picture is.
    pub media_type: String,
    /// Length of that file.
    pub size_bytes: u64,
    /// SHA-256 of that file.
    pub sha256: [u8; 32],
}

/// A control scene, without its picture.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredScene {
    /// UUIDv7; stays the same when the scene is replaced.
    pub public_id: Uuid,
    /// What it is.
    pub content: SceneContent,
    /// When it was first given.
    pub created_at: DateTime<Utc>,
    /// When it was last given.
    pub updated_at: DateTime<Utc>,
}

impl SceneContent {
    /// Where the corners of the picture lie on the ground, on the plane of the reference point.
    #[must_use]
    pub fn corners_geocentric_m(&self) -> [Vector3<f64>; 4] {
        let [width, height] = self.size_px.map(f64::from);
        let (there, scene) = (LocalFrame::about(self.reference_geocentric_m), self.scene(Vec::new()));
        [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(|corner| {
            let ground_m = scene.ground_from_pixel_m(Vector2::from(corner));
            there.to_geocentric(Vector3::new(ground_m.x, ground_m.y, 0.0))
        })
    }

    fn bounds(&self) -> GeodeticBox {
        let points = self.corners_geocentric_m().into_iter().chain([self.reference_geocentric_m]);
        GeodeticBox::around_points(points.map(longitude_latitude_deg))
    }

    /// The control point in the local frame in which an image is oriented. `grey` are the values of the picture, row by
    /// row, from 0 for black to 255 for white.
    #[must_use]
    pub fn in_frame(&self, frame: &LocalFrame, grey: Vec<f32>) -> ControlPoint {
        let there = LocalFrame::about(self.reference_geocentric_m);
        let (sin, cos) = self.azimuth_of_image_up_deg.to_radians().sin_cos();
        // north there and in the frame differ by the convergence of the meridians
        let up =
            frame.local_from_geocentric() * (there.local_from_geocentric().inverse() * Vector3::new(sin, cos, 0.0));
        let scene = Scene { azimuth_of_image_up_rad: up.x.atan2(up.y), ..self.scene(grey) };
        ControlPoint {
            name: self.name.clone(),
            sigma_m: self.sigma_m,
            reference_m: frame.from_geocentric(self.reference_geocentric_m),
            edges_m: Vec::new(),
            scene: Some(Arc::new(scene)),
        }
    }

    fn scene(&self, grey: Vec<f32>) -> Scene {
        let [width, height] = self.size_px.map(|side| side as usize);
        Scene {
            width,
            height,
            grey,
            gsd_m: self.gsd_m,
            azimuth_of_image_up_rad: self.azimuth_of_image_up_deg.to_radians(),
            sigma_azimuth_rad: self.sigma_azimuth_deg.to_radians(),
            reference_px: Vector2::from(self.reference_px),
        }
    }
}

/// What became of a scene that was to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct Written {
    /// As it is now.
    pub scene: StoredScene,
    /// Whether there was none of its name.
    pub new: bool,
}

/// Writes a scene with the file of its picture. Where there is one of its name it is replaced, and keeps its id.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn write(
    pool: &SqlitePool,
    id: Uuid,
    content: &SceneContent,
    file: &[u8],
    now: DateTime<Utc>,
) -> Result<Written, ControlError> {
    let mut transaction = pool.begin_with("BEGIN IMMEDIATE").await?;
    let row_id = write_row(&mut transaction, id, content, now).await?;
    sqlx::query("INSERT OR REPLACE INTO control_scene_pictures (scene_id, file) VALUES (?1, ?2)")
        .bind(row_id)
        .bind(file)
        .execute(&mut *transaction)
        .await?;
    let bounds = content.bounds();
    sqlx::query(
        "INSERT OR REPLACE INTO control_scene_boxes (id, min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg)
         VALUES (?1, ?2, ?3, ?4, ?5)",
    )
    .bind(row_id)
    .bind(bounds.min_lon_deg)
    .bind(bounds.max_lon_deg)
    .bind(bounds.min_lat_deg)
    .bind(bounds.max_lat_deg)
    .execute(&mut *transaction)
    .await?;
    let row =
        sqlx::query("SELECT * FROM control_scenes WHERE id = ?").bind(row_id).fetch_one(&mut *transaction).await?;
    let scene = stored(&row)?;
    transaction.commit().await?;
    // under the same id it is the second try of a request whose first one was cut off
    let new = scene.public_id == id;
    Ok(Written { scene, new })
}

async fn write_row(
    transaction: &mut Transaction<'_, Sqlite>,
    id: Uuid,
    content: &SceneContent,
    now: DateTime<Utc>,
) -> Result<i64, ControlError> {
    let reference = content.reference_geocentric_m;
    let row_id = sqlx::query_scalar(
        "INSERT INTO control_scenes (public_id, name, width_px, height_px, gsd_m, azimuth_of_image_up_deg,
             sigma_azimuth_deg, reference_column_px, reference_row_px, reference_x_m, reference_y_m, reference_z_m,
             sigma_m, media_type, size_bytes, sha256, created_at, updated_at)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17, ?17)
         ON CONFLICT (name) DO UPDATE SET width_px = excluded.width_px, height_px = excluded.height_px,
             gsd_m = excluded.gsd_m, azimuth_of_image_up_deg = excluded.azimuth_of_image_up_deg,
             sigma_azimuth_deg = excluded.sigma_azimuth_deg, reference_column_px = excluded.reference_column_px,
             reference_row_px = excluded.reference_row_px, reference_x_m = excluded.reference_x_m,
             reference_y_m = excluded.reference_y_m, reference_z_m = excluded.reference_z_m,
             sigma_m = excluded.sigma_m, media_type = excluded.media_type, size_bytes = excluded.size_bytes,
             sha256 = excluded.sha256, updated_at = excluded.updated_at
         RETURNING id",
    )
    .bind(id)
    .bind(&content.name)
    .bind(content.size_px[0])
    .bind(content.size_px[1])
    .bind(content.gsd_m)
    .bind(content.azimuth_of_image_up_deg)
    .bind(content.sigma_azimuth_deg)
    .bind(content.reference_px[0])
    .bind(content.reference_px[1])
    .bind(reference.x)
    .bind(reference.y)
    .bind(reference.z)
    .bind(content.sigma_m)
    .bind(&content.media_type)
    .bind(content.size_bytes.cast_signed())
    .bind(content.sha256.as_slice())
    .bind(now)
    .fetch_one(&mut **transaction)
    .await?;
    Ok(row_id)
}

/// Removes the scene with this id or, failing that, this name: whether there was one.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn remove(pool: &SqlitePool, id_or_name: &str) -> Result<bool, ControlError> {
    let mut transaction = pool.begin_with("BEGIN IMMEDIATE").await?;
    let row_id: Option<i64> =
        sqlx::query_scalar(sqlx::AssertSqlSafe(format!("SELECT id FROM control_scenes {BY_ID_OR_NAME}")))
            .bind(Uuid::try_parse(id_or_name).ok())
            .bind(id_or_name)
            .fetch_optional(&mut *transaction)
            .await?;
    let Some(row_id) = row_id else { return Ok(false) };
    remove_rows(&mut transaction, &[row_id]).await?;
    transaction.commit().await?;
    Ok(true)
}

/// Removes all scenes but those of these names: how many there were.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn remove_all_but(pool: &SqlitePool, names: &[&str]) -> Result<usize, ControlError> {
    let mut transaction = pool.begin_with("BEGIN IMMEDIATE").await?;
    let others: Vec<i64> =
        sqlx::query_scalar("SELECT id FROM control_scenes WHERE name NOT IN (SELECT value FROM json_each(?1))")
            .bind(serde_json::json!(names).to_string())
            .fetch_all(&mut *transaction)
            .await?;
    remove_rows(&mut transaction, &others).await?;
    transaction.commit().await?;
    Ok(others.len())
}

async fn remove_rows(transaction: &mut Transaction<'_, Sqlite>, row_ids: &[i64]) -> Result<(), ControlError> {
    let row_ids = serde_json::json!(row_ids).to_string();
    for statement in [
        "DELETE FROM control_scene_boxes WHERE id IN (SELECT value FROM json_each(?1))",
        "DELETE FROM control_scene_pictures WHERE scene_id IN (SELECT value FROM json_each(?1))",
        "DELETE FROM control_scenes WHERE id IN (SELECT value FROM json_each(?1))",
    ] {
        sqlx::query(statement).bind(&row_ids).execute(&mut **transaction).await?;
    }
    Ok(())
}

/// A name may look like the id of another scene: the id comes first.
const BY_ID_OR_NAME: &str = "WHERE public_id = ?1 OR name = ?2 ORDER BY public_id = ?1 DESC LIMIT 1";

/// The scene with this id or, failing that, this name.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn by_id_or_name(pool: &SqlitePool, id_or_name: &str) -> Result<Option<StoredScene>, ControlError> {
    let row = sqlx::query(sqlx::AssertSqlSafe(format!("SELECT * FROM control_scenes {BY_ID_OR_NAME}")))
        .bind(Uuid::try_parse(id_or_name).ok())
        .bind(id_or_name)
        .fetch_optional(pool)
        .await?;
    row.as_ref().map(stored).transpose()
}

/// A scene with the file of its picture, as it was uploaded: both of one moment.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn with_picture(pool: &SqlitePool, public_id: Uuid) -> Result<Option<(StoredScene, Vec<u8>)>, ControlError> {
    let row = sqlx::query(
        "SELECT s.*, p.file FROM control_scenes s JOIN control_scene_pictures p ON p.scene_id = s.id
         WHERE s.public_id = ?",
    )
    .bind(public_id)
    .fetch_optional(pool)
    .await?;
    row.map(|row| Ok((stored(&row)?, row.try_get("file")?))).transpose()
}

/// The scenes whose box touches `region`, by ascending number of their rows, from the first one after `after`, at most
/// `limit`; the boxes being rounded outward, some may lie just outside.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn in_box(
    pool: &SqlitePool,
    region: GeodeticBox,
    after: i64,
    limit: usize,
) -> Result<Vec<(i64, StoredScene)>, ControlError> {
    // CROSS JOIN for the same reason as with control points
    let sql = "SELECT s.* FROM control_scene_boxes b CROSS JOIN control_scenes s ON s.id = b.id
               WHERE b.max_lon_deg >= ?1 AND b.min_lon_deg <= ?2 AND b.max_lat_deg >= ?3 AND b.min_lat_deg <= ?4
                   AND b.id > ?5
               ORDER BY s.id LIMIT ?6";
    with_row_ids(&rows_in_box(pool, sql, region, after, limit).await?)
}

/// The scenes by ascending number of their rows, from the first one after `after`, at most `limit`.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn all(pool: &SqlitePool, after: i64, limit: usize) -> Result<Vec<(i64, StoredScene)>, ControlError> {
    let rows = sqlx::query("SELECT * FROM control_scenes WHERE id > ?1 ORDER BY id LIMIT ?2")
        .bind(after)
        .bind(i64::try_from(limit).unwrap_or(i64::MAX))
        .fetch_all(pool)
        .await?;
    with_row_ids(&rows)
}

fn with_row_ids(rows: &[SqliteRow]) -> Result<Vec<(i64, StoredScene)>, ControlError> {
    rows.iter().map(|row| Ok((row.try_get("id")?, stored(row)?))).collect()
}

fn stored(row: &SqliteRow) -> Result<StoredScene, ControlError> {
    let name: String = row.try_get("name")?;
    let sha256: Vec<u8> = row.try_get("sha256")?;
    let sha256 = sha256.try_into().map_err(|_| ControlError::Damaged { name: name.clone() })?;
    let number = |column: &str| row.try_get::<f64, _>(column);
    let content = SceneContent {
        size_px: [row.try_get("width_px")?, row.try_get("height_px")?],
        gsd_m: number("gsd_m")?,
        azimuth_of_image_up_deg: number("azimuth_of_image_up_deg")?,
        sigma_azimuth_deg: number("sigma_azimuth_deg")?,
        reference_px: [number("reference_column_px")?, number("reference_row_px")?],
        reference_geocentric_m: Vector3::new(
            number("reference_x_m")?,
            number("reference_y_m")?,
            number("reference_z_m")?,
        ),
        sigma_m: number("sigma_m")?,
        media_type: row.try_get("media_type")?,
        size_bytes: row.try_get::<i64, _>("size_bytes")?.unsigned_abs(),
        sha256,
        name,
    };
    Ok(StoredScene {
        public_id: row.try_get("public_id")?,
        content,
        created_at: row.try_get("created_at")?,
        updated_at: row.try_get("updated_at")?,
    })
}
