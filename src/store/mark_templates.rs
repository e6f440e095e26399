//! Pictures of fiducial marks that users cut from scans, by id or by name.

use chrono::{DateTime, Utc};
use sqlx::FromRow;
use uuid::Uuid;

use super::cameras::Removed;
use super::{Store, StoreError, now};
use crate::database::query;

/// A template, without its picture.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkTemplate {
    /// UUIDv7.
    pub id: Uuid,
    /// What it is.
    pub content: TemplateContent,
    /// When it was first given.
    pub created_at: DateTime<Utc>,
}

/// What is said of the picture of a mark.
#[derive(Debug, Clone, PartialEq)]
pub struct TemplateContent {
    /// Unique.
    pub name: String,
    /// Columns and rows.
    pub size_px: [u32; 2],
    /// Side of a pixel on the film.
    pub pixel_size_um: f64,
    /// The mark's centre, from the corner of the top-left pixel.
    pub centre_px: [f64; 2],
    /// Rectangles that do not belong to the mark: first column, first row, columns, rows.
    pub dont_care: Vec<[u32; 4]>,
    /// Whether it was cut from a negative; the grey values are a positive's nevertheless.
    pub negative: bool,
}

/// What became of a template that was to be added.
#[derive(Debug, Clone, PartialEq)]
pub enum TemplateAdded {
    /// It is new.
    New(MarkTemplate),
    /// It was there already, the same to the last bit.
    Same(MarkTemplate),
    /// The name belongs to another one.
    Different(MarkTemplate),
}

const COLUMNS: &str = "id, name, width_px, height_px, pixel_size_um, centre_x_px, centre_y_px, dont_care, negative,
                       created_at";

#[derive(FromRow)]
struct Row {
    id: Uuid,
    name: String,
    #[sqlx(try_from = "i64")]
    width_px: u32,
    #[sqlx(try_from = "i64")]
    height_px: u32,
    pixel_size_um: f64,
    centre_x_px: f64,
    centre_y_px: f64,
    dont_care: String,
    negative: bool,
    created_at: DateTime<Utc>,
}

impl TryFrom<Row> for MarkTemplate {
    type Error = StoreError;

    fn try_from(row: Row) -> Result<Self, StoreError> {
        let dont_care = serde_json::from_str(&row.dont_care);
        let content = TemplateContent {
            name: row.name,
            size_px: [row.width_px, row.height_px],
            pixel_size_um: row.pixel_size_um,
            centre_px: [row.centre_x_px, row.centre_y_px],
            dont_care: dont_care.map_err(|_| StoreError::Unknown { what: "rectangles", value: row.dont_care })?,
            negative: row.negative,
        };
        Ok(Self { id: row.id, content, created_at: row.created_at })
    }
}

fn bytes(grey: &[u16]) -> Vec<u8> {
    grey.iter().flat_map(|grey| grey.to_le_bytes()).collect()
}

impl Store {
    /// Adds a template with its grey values, row by row, as `id`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn add_mark_template(
        &self,
        id: Uuid,
        content: &TemplateContent,
        grey: &[u16],
    ) -> Result<TemplateAdded, StoreError> {
        let grey = bytes(grey);
        let mut transaction = self.begin_write().await?;
        let inserted = query(
            "INSERT INTO mark_templates (id, name, width_px, height_px, grey, pixel_size_um, centre_x_px, centre_y_px,
             dont_care, negative, created_at) VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11) ON CONFLICT DO NOTHING",
        )
        .bind(id)
        .bind(&content.name)
        .bind(content.size_px[0])
        .bind(content.size_px[1])
        .bind(&grey)
        .bind(content.pixel_size_um)
        .bind(content.centre_px[0])
        .bind(content.centre_px[1])
        .bind(serde_json::json!(content.dont_care).to_string())
        .bind(content.negative)
        .bind(now())
        .execute(&mut transaction)
        .await?;
        let stored: Row = query(sqlx::AssertSqlSafe(format!("SELECT {COLUMNS} FROM mark_templates WHERE name = $1")))
            .bind(&content.name)
            .fetch_one(&mut transaction)
            .await?;
        let stored = MarkTemplate::try_from(stored)?;
        let same_grey: bool = query("SELECT grey = $1 FROM mark_templates WHERE id = $2")
            .bind(&grey)
            .bind(stored.id)
            .fetch_value(&mut transaction)
            .await?;
        transaction.commit().await?;
        Ok(match (inserted, same_grey && stored.content == *content) {
            (1, _) => TemplateAdded::New(stored),
            (_, true) => TemplateAdded::Same(stored),
            (_, false) => TemplateAdded::Different(stored),
        })
    }

    /// The template with this id or, failing that, this name.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn mark_template(&self, id_or_name: &str) -> Result<Option<MarkTemplate>, StoreError> {
        let sql = format!("SELECT {COLUMNS} FROM mark_templates WHERE id = $1 OR name = $2");
        let row: Option<Row> = query(sqlx::AssertSqlSafe(sql))
            .bind(Uuid::try_parse(id_or_name).ok())
            .bind(id_or_name)
            .fetch_optional(&self.database)
            .await?;
        row.map(MarkTemplate::try_from).transpose()
    }

    /// The grey values of a template, row by row, from 0 for black to 65 535 for white.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn mark_template_grey(&self, id: Uuid) -> Result<Option<Vec<u16>>, StoreError> {
        let bytes: Option<Vec<u8>> = query("SELECT grey FROM mark_templates WHERE id = $1")
            .bind(id)
            .fetch_optional_value(&self.database)
            .await?;
        Ok(bytes.map(|bytes| bytes.as_chunks::<2>().0.iter().map(|two| u16::from_le_bytes(*two)).collect()))
    }

    /// At most `limit` templates, the newest first, those older than `before`.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn mark_templates(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<MarkTemplate>, StoreError> {
        let sql = format!("SELECT {COLUMNS} FROM mark_templates WHERE id < $1 ORDER BY id DESC LIMIT $2");
        let rows: Vec<Row> = query(sqlx::AssertSqlSafe(sql))
            .bind(before.unwrap_or(Uuid::max()))
            .bind(limit)
            .fetch_all(&self.database)
            .await?;
        rows.into_iter().map(MarkTemplate::try_from).collect()
    }

    /// Removes the template with this id or name, unless a camera needs it.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn remove_mark_template(&self, id_or_name: &str) -> Result<Removed, StoreError> {
        let Some(MarkTemplate { id, .. }) = self.mark_template(id_or_name).await? else {
            return Ok(Removed::Missing);
        };
        let done = query("DELETE FROM mark_templates WHERE id = $1").bind(id).execute(&self.database).await;
        Removed::of(done)
    }
}
