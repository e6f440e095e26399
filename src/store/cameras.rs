//! Cameras, by id or by name.

use chrono::{DateTime, Utc};
use nalgebra::Vector2;
use sqlx::FromRow;
use sqlx::sqlite::SqliteRow;
use uuid::Uuid;

use super::{Store, StoreError, now};
use crate::geometry::{Brown, Camera};

/// A camera with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCamera {
    /// UUIDv7.
    pub id: Uuid,
    /// Unique.
    pub name: String,
    /// Its interior orientation.
    pub camera: Camera,
    /// When it was first given.
    pub created_at: DateTime<Utc>,
}

/// What became of a camera that was to be added.
#[derive(Debug, Clone, PartialEq)]
pub enum Added {
    /// It is new.
    New(NamedCamera),
    /// It was there already, the same to the last bit.
    Same(NamedCamera),
    /// The name belongs to a camera with other values.
    Different(NamedCamera),
}

/// What became of a camera that was to be removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Removed {
    /// It is gone.
    Gone,
    /// There was none.
    Missing,
    /// Something else refers to it.
    InUse,
}

#[derive(FromRow)]
struct Row {
    id: Uuid,
    name: String,
    width_px: u32,
    height_px: u32,
    principal_distance_px: f64,
    principal_point_x_px: f64,
    principal_point_y_px: f64,
    k1: f64,
    k2: f64,
    k3: f64,
    p1: f64,
    p2: f64,
    b1_px: f64,
    b2_px: f64,
    created_at: DateTime<Utc>,
}

impl FromRow<'_, SqliteRow> for NamedCamera {
    fn from_row(row: &SqliteRow) -> Result<Self, sqlx::Error> {
        let row = Row::from_row(row)?;
        let Row { k1, k2, k3, p1, p2, b1_px, b2_px, .. } = row;
        let camera = Camera::new(
            [row.width_px, row.height_px],
            row.principal_distance_px,
            Vector2::new(row.principal_point_x_px, row.principal_point_y_px),
            Brown { k1, k2, k3, p1, p2, b1_px, b2_px },
        );
        // none was stored that could not be used
        let camera = camera.map_err(|error| sqlx::Error::Decode(error.into()))?;
        Ok(Self { id: row.id, name: row.name, camera, created_at: row.created_at })
    }
}

impl Store {
    /// Adds a camera under its name, as `id`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn add_camera(&self, id: Uuid, name: &str, camera: &Camera) -> Result<Added, StoreError> {
        let d = camera.distortion().copied().unwrap_or_default();
        let principal_point_px = camera.principal_point_px();
        let mut transaction = self.begin_write().await?;
        let inserted = sqlx::query(
            "INSERT INTO cameras (id, name, width_px, height_px, principal_distance_px, principal_point_x_px,
             principal_point_y_px, k1, k2, k3, p1, p2, b1_px, b2_px, created_at)
             VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT DO NOTHING",
        )
        .bind(id)
        .bind(name)
        .bind(camera.width_px)
        .bind(camera.height_px)
        .bind(camera.principal_distance_px)
        .bind(principal_point_px.x)
        .bind(principal_point_px.y)
        .bind(d.k1)
        .bind(d.k2)
        .bind(d.k3)
        .bind(d.p1)
        .bind(d.p2)
        .bind(d.b1_px)
        .bind(d.b2_px)
        .bind(now())
        .execute(&mut *transaction)
        .await?
        .rows_affected();
        let stored: NamedCamera =
            sqlx::query_as("SELECT * FROM cameras WHERE name = ?").bind(name).fetch_one(&mut *transaction).await?;
        transaction.commit().await?;
        Ok(match (inserted, stored.camera == *camera) {
            (1, _) => Added::New(stored),
            (_, true) => Added::Same(stored),
            (_, false) => Added::Different(stored),
        })
    }

    /// The camera with this id or, failing that, this name.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn camera(&self, id_or_name: &str) -> Result<Option<NamedCamera>, StoreError> {
        let id = Uuid::try_parse(id_or_name).ok();
        Ok(sqlx::query_as("SELECT * FROM cameras WHERE id = ? OR name = ?")
            .bind(id)
            .bind(id_or_name)
            .fetch_optional(&self.pool)
            .await?)
    }

    /// At most `limit` cameras, the newest first, those older than `before`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn cameras(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<NamedCamera>, StoreError> {
        Ok(sqlx::query_as("SELECT * FROM cameras WHERE ?1 IS NULL OR id < ?1 ORDER BY id DESC LIMIT ?2")
            .bind(before)
            .bind(limit)
            .fetch_all(&self.pool)
            .await?)
    }

    /// Removes the camera with this id or name, unless something refers to it.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn remove_camera(&self, id_or_name: &str) -> Result<Removed, StoreError> {
        let Some(NamedCamera { id, .. }) = self.camera(id_or_name).await? else {
            return Ok(Removed::Missing);
        };
        match sqlx::query("DELETE FROM cameras WHERE id = ?").bind(id).execute(&self.pool).await {
            Ok(done) if done.rows_affected() == 0 => Ok(Removed::Missing),
            Ok(_) => Ok(Removed::Gone),
            Err(sqlx::Error::Database(error)) if error.is_foreign_key_violation() => Ok(Removed::InUse),
            Err(error) => Err(error.into()),
        }
    }
}
