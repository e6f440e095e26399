//! Cameras, by id or by name.

use chrono::{DateTime, Utc};
use nalgebra::Vector2;
use sqlx::FromRow;
use uuid::Uuid;

use super::{Store, StoreError, now};
use crate::database::{Transaction, query};
use crate::geometry::{Brown, Camera};

/// A camera with its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCamera {
    /// UUIDv7.
    pub id: Uuid,
    /// Unique.
    pub name: String,
    /// What it is.
    pub kind: CameraKind,
    /// When it was first given.
    pub created_at: DateTime<Utc>,
}

/// The two kinds of cameras.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a camera is small enough to be copied, and there are few at a time")]
pub enum CameraKind {
    /// A digital camera with its interior orientation.
    Digital(Camera),
    /// A film camera: its definition as JSON.
    Film(String),
}

impl NamedCamera {
    /// Its interior orientation, if it is a digital camera.
    #[must_use]
    pub fn digital(&self) -> Option<&Camera> {
        match &self.kind {
            CameraKind::Digital(camera) => Some(camera),
            CameraKind::Film(_) => None,
        }
    }

    /// Columns and rows of its images; scans of film differ.
    #[must_use]
    pub fn image_size_px(&self) -> Option<[u32; 2]> {
        self.digital().map(|camera| [camera.width_px, camera.height_px])
    }
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
    /// A template that it needs was removed meanwhile.
    TemplateGone,
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

impl Removed {
    /// From what the database says of a row that was to be deleted.
    pub(super) fn of(done: Result<u64, sqlx::Error>) -> Result<Self, StoreError> {
        match done {
            Ok(0) => Ok(Self::Missing),
            Ok(_) => Ok(Self::Gone),
            Err(sqlx::Error::Database(error)) if error.is_foreign_key_violation() => Ok(Self::InUse),
            Err(error) => Err(error.into()),
        }
    }
}

#[derive(FromRow)]
struct Row {
    id: Uuid,
    name: String,
    #[sqlx(try_from = "i64")]
    width_px: u32,
    #[sqlx(try_from = "i64")]
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
    film: Option<String>,
}

impl<'r, R: sqlx::Row> FromRow<'r, R> for NamedCamera
where
    Row: FromRow<'r, R>,
{
    fn from_row(row: &'r R) -> Result<Self, sqlx::Error> {
        let row = Row::from_row(row)?;
        let (id, name, created_at) = (row.id, row.name.clone(), row.created_at);
        let kind = row.kind()?;
        Ok(Self { id, name, kind, created_at })
    }
}

impl Row {
    fn kind(self) -> Result<CameraKind, sqlx::Error> {
        if let Some(film) = self.film {
            return Ok(CameraKind::Film(film));
        }
        let Self { k1, k2, k3, p1, p2, b1_px, b2_px, .. } = self;
        let camera = Camera::new(
            [self.width_px, self.height_px],
            self.principal_distance_px,
            Vector2::new(self.principal_point_x_px, self.principal_point_y_px),
            Brown { k1, k2, k3, p1, p2, b1_px, b2_px },
        );
        // none was stored that could not be used
        camera.map(CameraKind::Digital).map_err(|error| sqlx::Error::Decode(error.into()))
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
        let inserted = query(
            "INSERT INTO cameras (id, name, width_px, height_px, principal_distance_px, principal_point_x_px,
             principal_point_y_px, k1, k2, k3, p1, p2, b1_px, b2_px, created_at)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15) ON CONFLICT DO NOTHING",
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
        .execute(&mut transaction)
        .await?;
        let added = added(&mut transaction, inserted, name, &CameraKind::Digital(*camera)).await?;
        transaction.commit().await?;
        Ok(added)
    }

    /// Adds a film camera under its name, as `id`: its definition as JSON, and the uploaded templates that it needs.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn add_film_camera(
        &self,
        id: Uuid,
        name: &str,
        definition: &str,
        templates: &[Uuid],
    ) -> Result<Added, StoreError> {
        let mut transaction = self.begin_write().await?;
        let inserted = query(
            "INSERT INTO cameras (id, name, width_px, height_px, principal_distance_px, principal_point_x_px,
             principal_point_y_px, k1, k2, k3, p1, p2, b1_px, b2_px, film, created_at)
             VALUES ($1, $2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, $3, $4) ON CONFLICT DO NOTHING",
        )
        .bind(id)
        .bind(name)
        .bind(definition)
        .bind(now())
        .execute(&mut transaction)
        .await?;
        // what is dropped without a commit leaves nothing
        if inserted == 1 && !refer(&mut transaction, id, templates).await? {
            return Ok(Added::TemplateGone);
        }
        let added = added(&mut transaction, inserted, name, &CameraKind::Film(definition.to_owned())).await?;
        transaction.commit().await?;
        Ok(added)
    }

    /// The camera with this id or, failing that, this name.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn camera(&self, id_or_name: &str) -> Result<Option<NamedCamera>, StoreError> {
        let id = Uuid::try_parse(id_or_name).ok();
        Ok(query("SELECT * FROM cameras WHERE id = $1 OR name = $2")
            .bind(id)
            .bind(id_or_name)
            .fetch_optional(&self.database)
            .await?)
    }

    /// At most `limit` cameras, the newest first, those older than `before`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn cameras(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<NamedCamera>, StoreError> {
        Ok(query("SELECT * FROM cameras WHERE id < $1 ORDER BY id DESC LIMIT $2")
            .bind(before.unwrap_or(Uuid::max()))
            .bind(limit)
            .fetch_all(&self.database)
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
        let done = query("DELETE FROM cameras WHERE id = $1").bind(id).execute(&self.database).await;
        Removed::of(done)
    }
}

/// What the camera's name now belongs to.
async fn added(
    transaction: &mut Transaction,
    inserted: u64,
    name: &str,
    kind: &CameraKind,
) -> Result<Added, StoreError> {
    let stored: NamedCamera =
        query("SELECT * FROM cameras WHERE name = $1").bind(name).fetch_one(&mut *transaction).await?;
    Ok(match (inserted, stored.kind == *kind) {
        (1, _) => Added::New(stored),
        (_, true) => Added::Same(stored),
        (_, false) => Added::Different(stored),
    })
}

/// Notes which templates a camera needs; `false` if one is not there.
async fn refer(transaction: &mut Transaction, camera: Uuid, templates: &[Uuid]) -> Result<bool, StoreError> {
    for template in templates {
        let done = query("INSERT INTO camera_mark_templates (camera_id, template_id) VALUES ($1, $2)")
            .bind(camera)
            .bind(template)
            .execute(&mut *transaction)
            .await;
        match done {
            Ok(_) => {}
            Err(sqlx::Error::Database(error)) if error.is_foreign_key_violation() => return Ok(false),
            Err(error) => return Err(error.into()),
        }
    }
    Ok(true)
}
