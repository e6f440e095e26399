//! Control scenes as they are kept: geocentric like all control, with the file of the picture as it came.

use std::sync::Arc;

use chrono::{DateTime, Utc};
use nalgebra::{Vector2, Vector3};
use sqlx::{AssertSqlSafe, FromRow};
use uuid::Uuid;

use super::ControlError;
use super::points::{Numbered, rows_in_box, with_box};
use super::region::{GeodeticBox, longitude_latitude_deg};
use crate::database::{Database, Dialects, TEXTS, Transaction, query};
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
            edge_sigmas_m: Vec::new(),
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
    database: &Database,
    id: Uuid,
    content: &SceneContent,
    file: &[u8],
    now: DateTime<Utc>,
) -> Result<Written, ControlError> {
    let mut transaction = database.begin_alone().await?;
    let row_id = write_row(&mut transaction, id, content, now).await?;
    query(
        "INSERT INTO control_scene_pictures (scene_id, file) VALUES ($1, $2)
         ON CONFLICT (scene_id) DO UPDATE SET file = excluded.file",
    )
    .bind(row_id)
    .bind(file)
    .execute(&mut transaction)
    .await?;
    let row: Row = query("SELECT * FROM control_scenes WHERE id = $1").bind(row_id).fetch_one(&mut transaction).await?;
    let scene = StoredScene::try_from(row)?;
    transaction.commit().await?;
    // under the same id it is the second try of a request whose first one was cut off
    let new = scene.public_id == id;
    Ok(Written { scene, new })
}

async fn write_row(
    transaction: &mut Transaction,
    id: Uuid,
    content: &SceneContent,
    now: DateTime<Utc>,
) -> Result<i64, ControlError> {
    let reference = content.reference_geocentric_m;
    let row = query(transaction.dialect(WRITE))
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
        .bind(now);
    let bounds = content.bounds();
    if let Transaction::Postgres(_) = transaction {
        return Ok(with_box(row, bounds).fetch_value(transaction).await?);
    }
    let row_id: i64 = row.fetch_value(&mut *transaction).await?;
    let boxes = "INSERT OR REPLACE INTO control_scene_boxes (id, min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg)
                 VALUES ($1, $2, $3, $4, $5)";
    with_box(query(boxes).bind(row_id), bounds).execute(transaction).await?;
    Ok(row_id)
}

macro_rules! written {
    ($columns:literal, $values:literal, $set:literal) => {
        concat!(
            "INSERT INTO control_scenes (public_id, name, width_px, height_px, gsd_m, azimuth_of_image_up_deg,
                 sigma_azimuth_deg, reference_column_px, reference_row_px, reference_x_m, reference_y_m, reference_z_m,
                 sigma_m, media_type, size_bytes, sha256, created_at, updated_at", $columns, ")
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17, $17", $values, ")
             ON CONFLICT (name) DO UPDATE SET width_px = excluded.width_px, height_px = excluded.height_px,
                 gsd_m = excluded.gsd_m, azimuth_of_image_up_deg = excluded.azimuth_of_image_up_deg,
                 sigma_azimuth_deg = excluded.sigma_azimuth_deg, reference_column_px = excluded.reference_column_px,
                 reference_row_px = excluded.reference_row_px, reference_x_m = excluded.reference_x_m,
                 reference_y_m = excluded.reference_y_m, reference_z_m = excluded.reference_z_m,
                 sigma_m = excluded.sigma_m, media_type = excluded.media_type, size_bytes = excluded.size_bytes,
                 sha256 = excluded.sha256, updated_at = excluded.updated_at", $set, "
             RETURNING id"
        )
    };
}

/// PostgreSQL keeps the box in the row, SQLite in its R*Tree.
const WRITE: Dialects = Dialects {
    sqlite: written!("", "", ""),
    postgres: written!(", extent", ", box(point($18, $20), point($19, $21))", ", extent = excluded.extent"),
};

/// Removes the scene with this id or, failing that, this name: whether there was one.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn remove(database: &Database, id_or_name: &str) -> Result<bool, ControlError> {
    let mut transaction = database.begin_alone().await?;
    let row_id: Option<i64> = query(AssertSqlSafe(format!("SELECT id FROM control_scenes {BY_ID_OR_NAME}")))
        .bind(Uuid::try_parse(id_or_name).ok())
        .bind(id_or_name)
        .fetch_optional_value(&mut transaction)
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
pub async fn remove_all_but(database: &Database, names: &[&str]) -> Result<usize, ControlError> {
    let mut transaction = database.begin_alone().await?;
    let others: Vec<i64> =
        query(AssertSqlSafe(format!("SELECT id FROM control_scenes WHERE name NOT IN {}", transaction.dialect(TEXTS))))
            .bind(serde_json::json!(names).to_string())
            .fetch_values(&mut transaction)
            .await?;
    remove_rows(&mut transaction, &others).await?;
    transaction.commit().await?;
    Ok(others.len())
}

async fn remove_rows(transaction: &mut Transaction, row_ids: &[i64]) -> Result<(), ControlError> {
    for row_id in row_ids {
        if let Transaction::Sqlite(_) = transaction {
            query("DELETE FROM control_scene_boxes WHERE id = $1").bind(*row_id).execute(&mut *transaction).await?;
        }
        query("DELETE FROM control_scene_pictures WHERE scene_id = $1")
            .bind(*row_id)
            .execute(&mut *transaction)
            .await?;
        query("DELETE FROM control_scenes WHERE id = $1").bind(*row_id).execute(&mut *transaction).await?;
    }
    Ok(())
}

/// A name may look like the id of another scene: the id comes first.
const BY_ID_OR_NAME: &str = "WHERE public_id = $1 OR name = $2 ORDER BY public_id = $1 DESC LIMIT 1";

/// The scene with this id or, failing that, this name.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn by_id_or_name(database: &Database, id_or_name: &str) -> Result<Option<StoredScene>, ControlError> {
    let row: Option<Row> = query(AssertSqlSafe(format!("SELECT * FROM control_scenes {BY_ID_OR_NAME}")))
        .bind(Uuid::try_parse(id_or_name).ok())
        .bind(id_or_name)
        .fetch_optional(database)
        .await?;
    row.map(StoredScene::try_from).transpose()
}

/// A scene with the file of its picture, as it was uploaded: both of one moment.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn with_picture(
    database: &Database,
    public_id: Uuid,
) -> Result<Option<(StoredScene, Vec<u8>)>, ControlError> {
    let row: Option<WithPicture> = query(
        "SELECT s.*, p.file FROM control_scenes s JOIN control_scene_pictures p ON p.scene_id = s.id
         WHERE s.public_id = $1",
    )
    .bind(public_id)
    .fetch_optional(database)
    .await?;
    row.map(|row| Ok((row.scene.try_into()?, row.file))).transpose()
}

/// The scenes whose box touches `region`, by ascending number of their rows, from the first one after `after`, at most
/// `limit`; the boxes being rounded outward, some may lie just outside.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn in_box(
    database: &Database,
    region: GeodeticBox,
    after: i64,
    limit: usize,
) -> Result<Vec<(i64, StoredScene)>, ControlError> {
    let rows: Vec<Row> = rows_in_box(database, IN_BOX, region, (after, limit), |query| query).await?;
    rows.into_iter().map(Row::with_id).collect()
}

/// As with control points.
const IN_BOX: Dialects = Dialects {
    sqlite: "SELECT s.* FROM control_scene_boxes b CROSS JOIN control_scenes s ON s.id = b.id
             WHERE b.max_lon_deg >= $1 AND b.min_lon_deg <= $2 AND b.max_lat_deg >= $3 AND b.min_lat_deg <= $4
                 AND b.id > $5
             ORDER BY s.id LIMIT $6",
    postgres: "WITH near AS MATERIALIZED (
                   SELECT * FROM control_scenes WHERE extent && box(point($1, $3), point($2, $4)))
               SELECT * FROM near WHERE id > $5 ORDER BY id LIMIT $6",
};

/// The scenes by ascending number of their rows, from the first one after `after`, at most `limit`.
///
/// # Errors
/// [`ControlError`] if the database fails.
pub async fn all(database: &Database, after: i64, limit: usize) -> Result<Vec<(i64, StoredScene)>, ControlError> {
    let rows: Vec<Row> = query("SELECT * FROM control_scenes WHERE id > $1 ORDER BY id LIMIT $2")
        .bind(after)
        .bind(i64::try_from(limit).unwrap_or(i64::MAX))
        .fetch_all(database)
        .await?;
    rows.into_iter().map(Row::with_id).collect()
}

#[derive(FromRow)]
struct Row {
    id: i64,
    public_id: Uuid,
    name: String,
    #[sqlx(try_from = "i64")]
    width_px: u32,
    #[sqlx(try_from = "i64")]
    height_px: u32,
    gsd_m: f64,
    azimuth_of_image_up_deg: f64,
    sigma_azimuth_deg: f64,
    reference_column_px: f64,
    reference_row_px: f64,
    reference_x_m: f64,
    reference_y_m: f64,
    reference_z_m: f64,
    sigma_m: f64,
    media_type: String,
    #[sqlx(try_from = "i64")]
    size_bytes: u64,
    sha256: Vec<u8>,
    created_at: DateTime<Utc>,
    updated_at: DateTime<Utc>,
}

#[derive(FromRow)]
struct WithPicture {
    #[sqlx(flatten)]
    scene: Row,
    file: Vec<u8>,
}

impl Numbered for Row {
    fn id(&self) -> i64 {
        self.id
    }
}

impl Row {
    fn with_id(self) -> Result<(i64, StoredScene), ControlError> {
        Ok((self.id, self.try_into()?))
    }
}

impl TryFrom<Row> for StoredScene {
    type Error = ControlError;

    fn try_from(row: Row) -> Result<Self, ControlError> {
        let sha256 = row.sha256.try_into().map_err(|_| ControlError::Damaged { name: row.name.clone() })?;
        let content = SceneContent {
            name: row.name,
            size_px: [row.width_px, row.height_px],
            gsd_m: row.gsd_m,
            azimuth_of_image_up_deg: row.azimuth_of_image_up_deg,
            sigma_azimuth_deg: row.sigma_azimuth_deg,
            reference_px: [row.reference_column_px, row.reference_row_px],
            reference_geocentric_m: Vector3::new(row.reference_x_m, row.reference_y_m, row.reference_z_m),
            sigma_m: row.sigma_m,
            media_type: row.media_type,
            size_bytes: row.size_bytes,
            sha256,
        };
        Ok(Self { public_id: row.public_id, content, created_at: row.created_at, updated_at: row.updated_at })
    }
}
