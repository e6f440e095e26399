//! Images: the uploaded bytes as files named by their SHA-256, and a row for each that is complete.
//!
//! An upload is written to `incoming/` and locked there. When it is whole it is synced, moved to its name in
//! `images/`, the folder is synced, and only then is its row written: what has a row has its file, on disk.

use std::fmt::Write as _;
use std::fs;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::Duration;

use chrono::{DateTime, NaiveDate, Utc};
use sha2::{Digest as _, Sha256};
use sqlx::FromRow;
use tokio::io::AsyncWriteExt as _;
use uuid::Uuid;

use super::{Store, StoreError, now, overviews};
use crate::database::query;

pub(super) const FOLDER: &str = "images";
pub(crate) const INCOMING: &str = "incoming";
/// A file without a row may belong to an upload that another process is just finishing; later than this it does not.
const FILE_WITHOUT_ROW_KEPT: Duration = Duration::from_secs(3600);

/// A stored image.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// UUIDv7.
    pub id: Uuid,
    /// Of the file's bytes.
    pub sha256: [u8; 32],
    /// Length of the file.
    pub size_bytes: u64,
    /// What its file was called where it came from, if anybody has said.
    pub name: Option<String>,
    /// What the file is.
    pub header: Header,
    /// When it was first uploaded.
    pub created_at: DateTime<Utc>,
}

/// What the head of an image file tells.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// `jpeg`, `png` or `tiff`.
    pub format: String,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Where it was taken, if EXIF says.
    pub position: Option<GeographicPosition>,
    /// Make and model of the camera, if EXIF says.
    pub camera_model: Option<String>,
    /// When it was taken, if EXIF says.
    pub taken_on: Option<NaiveDate>,
}

/// A position as EXIF gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GeographicPosition {
    /// East of Greenwich, WGS 84.
    pub longitude_deg: f64,
    /// North of the equator, WGS 84.
    pub latitude_deg: f64,
    /// Above the geoid, if there is a height.
    pub height_m: Option<f64>,
}

#[derive(FromRow)]
struct Row {
    id: Uuid,
    sha256: Vec<u8>,
    size_bytes: i64,
    format: String,
    #[sqlx(try_from = "i64")]
    width_px: u32,
    #[sqlx(try_from = "i64")]
    height_px: u32,
    longitude_deg: Option<f64>,
    latitude_deg: Option<f64>,
    height_m: Option<f64>,
    created_at: DateTime<Utc>,
    name: Option<String>,
    camera_model: Option<String>,
    taken_on: Option<NaiveDate>,
}

impl TryFrom<Row> for Image {
    type Error = StoreError;

    fn try_from(row: Row) -> Result<Self, StoreError> {
        let unknown = |what, value: String| StoreError::Unknown { what, value };
        let position = match (row.longitude_deg, row.latitude_deg) {
            (Some(longitude_deg), Some(latitude_deg)) => {
                Some(GeographicPosition { longitude_deg, latitude_deg, height_m: row.height_m })
            }
            _ => None,
        };
        let Row { format, width_px, height_px, camera_model, taken_on, .. } = row;
        Ok(Self {
            id: row.id,
            sha256: row.sha256.try_into().map_err(|bytes: Vec<u8>| unknown("SHA-256", hexadecimal(&bytes)))?,
            size_bytes: u64::try_from(row.size_bytes).map_err(|_| unknown("size", row.size_bytes.to_string()))?,
            name: row.name,
            header: Header { format, width_px, height_px, position, camera_model, taken_on },
            created_at: row.created_at,
        })
    }
}

/// An upload under way. Dropped before it is kept, its file goes too.
#[derive(Debug)]
pub struct Upload {
    file: tokio::fs::File,
    temporary: Temporary,
    hash: Sha256,
    size_bytes: u64,
}

/// An upload that has come to its end and is on disk, but has no row yet.
#[derive(Debug)]
pub struct Received {
    // open and locked until the row is written
    _file: tokio::fs::File,
    temporary: Temporary,
    /// Of its bytes.
    pub sha256: [u8; 32],
    /// Its length.
    pub size_bytes: u64,
}

#[derive(Debug)]
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        if let Err(error) = fs::remove_file(&self.0)
            && error.kind() != std::io::ErrorKind::NotFound
        {
            tracing::warn!(%error, path = %self.0.display(), "an abandoned upload could not be removed");
        }
    }
}

impl Upload {
    /// Appends bytes.
    ///
    /// # Errors
    /// [`StoreError::File`], for example when the disk is full.
    pub async fn write(&mut self, bytes: &[u8]) -> Result<(), StoreError> {
        self.hash.update(bytes);
        self.size_bytes += bytes.len() as u64;
        self.file.write_all(bytes).await.map_err(|source| file_error("cannot write", &self.temporary.0, source))
    }

    /// Bytes written so far.
    #[must_use]
    pub fn size_bytes(&self) -> u64 {
        self.size_bytes
    }

    /// Ends the upload: when this returns, its bytes are on disk.
    ///
    /// # Errors
    /// [`StoreError::File`].
    pub async fn complete(mut self) -> Result<Received, StoreError> {
        let synced = async {
            self.file.flush().await?;
            self.file.sync_all().await
        };
        synced.await.map_err(|source| file_error("cannot sync", &self.temporary.0, source))?;
        let Self { file, temporary, hash, size_bytes } = self;
        Ok(Received { _file: file, temporary, sha256: hash.finalize().into(), size_bytes })
    }
}

impl Received {
    /// A file of `incoming/` that is whole and synced, under a lock that `file` holds.
    pub(super) fn of(file: tokio::fs::File, path: PathBuf, sha256: [u8; 32], size_bytes: u64) -> Self {
        Self { _file: file, temporary: Temporary(path), sha256, size_bytes }
    }

    /// Where the bytes are for now.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.temporary.0
    }
}

impl Store {
    /// Makes room for an upload. Its file is locked as long as it grows, so that no sweep takes it away.
    ///
    /// # Errors
    /// [`StoreError::File`].
    pub fn begin_upload(&self) -> Result<Upload, StoreError> {
        let path = self.folder.join(INCOMING).join(Uuid::now_v7().simple().to_string());
        let file = fs::File::create_new(&path).map_err(|source| file_error("cannot create", &path, source))?;
        let temporary = Temporary(path);
        file.lock().map_err(|source| file_error("cannot lock", &temporary.0, source))?;
        Ok(Upload { file: tokio::fs::File::from_std(file), temporary, hash: Sha256::new(), size_bytes: 0 })
    }

    /// Makes an upload visible as `id`, unless the same bytes are there already; whether it is new comes with it. An image
    /// that was removed comes back under the id that it had. The first name that it was given stays.
    ///
    /// # Errors
    /// [`StoreError`]; then nothing is visible.
    pub async fn keep_image(
        &self,
        id: Uuid,
        received: Received,
        header: &Header,
        name: Option<&str>,
    ) -> Result<(Image, bool), StoreError> {
        match &self.bucket {
            Some(bucket) => bucket.put(&received.sha256, received.path()).await?,
            None => {
                let kept = self.image_path(&received.sha256);
                let renamed = tokio::fs::rename(received.path(), &kept).await;
                renamed.map_err(|source| file_error("cannot create", &kept, source))?;
                sync_folder(&self.folder.join(FOLDER)).await?;
            }
        }
        let size_bytes = i64::try_from(received.size_bytes)
            .map_err(|_| StoreError::Unknown { what: "size", value: received.size_bytes.to_string() })?;
        let mut transaction = self.begin_write().await?;
        // a removal of these bytes may just have taken the file away, see `remove_image`
        if !self.holds_file(&received.sha256).await? {
            return Err(StoreError::JustRemoved);
        }
        let revived =
            query("UPDATE images SET deleted_at = NULL, created_at = $1 WHERE sha256 = $2 AND deleted_at IS NOT NULL")
                .bind(now())
                .bind(received.sha256.as_slice())
                .execute(&mut transaction)
                .await?;
        let inserted = query(
            "INSERT INTO images (id, sha256, size_bytes, format, width_px, height_px, longitude_deg, latitude_deg,
             height_m, camera_model, taken_on, created_at)
             VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12)
             ON CONFLICT DO NOTHING",
        )
        .bind(id)
        .bind(received.sha256.as_slice())
        .bind(size_bytes)
        .bind(&header.format)
        .bind(header.width_px)
        .bind(header.height_px)
        .bind(header.position.map(|p| p.longitude_deg))
        .bind(header.position.map(|p| p.latitude_deg))
        .bind(header.position.and_then(|p| p.height_m))
        .bind(&header.camera_model)
        .bind(header.taken_on)
        .bind(now())
        .execute(&mut transaction)
        .await?;
        if let Some(name) = name {
            query("UPDATE images SET name = $1 WHERE sha256 = $2 AND name IS NULL")
                .bind(name)
                .bind(received.sha256.as_slice())
                .execute(&mut transaction)
                .await?;
        }
        let row: Row = query("SELECT * FROM images WHERE sha256 = $1")
            .bind(received.sha256.as_slice())
            .fetch_one(&mut transaction)
            .await?;
        transaction.commit().await?;
        Ok((row.try_into()?, inserted + revived == 1))
    }

    /// The image with this id.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn image(&self, id: Uuid) -> Result<Option<Image>, StoreError> {
        let row: Option<Row> = query("SELECT * FROM images WHERE id = $1 AND deleted_at IS NULL")
            .bind(id)
            .fetch_optional(&self.database)
            .await?;
        row.map(Image::try_from).transpose()
    }

    /// At most `limit` images, the newest first, those older than `before`.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn images(&self, before: Option<Uuid>, limit: u32) -> Result<Vec<Image>, StoreError> {
        let rows: Vec<Row> =
            query("SELECT * FROM images WHERE id < $1 AND deleted_at IS NULL ORDER BY id DESC LIMIT $2")
                .bind(before.unwrap_or(Uuid::max()))
                .bind(limit)
                .fetch_all(&self.database)
                .await?;
        rows.into_iter().map(Image::try_from).collect()
    }

    /// The file of a stored image; with an object store a copy of it, which is fetched if it is not there yet.
    ///
    /// # Errors
    /// [`StoreError`] if it cannot be fetched.
    pub async fn image_file(&self, sha256: &[u8; 32]) -> Result<PathBuf, StoreError> {
        match &self.bucket {
            Some(bucket) => bucket.copy(sha256, &self.folder.join(FOLDER)).await,
            None => Ok(self.image_path(sha256)),
        }
    }

    async fn holds_file(&self, sha256: &[u8; 32]) -> Result<bool, StoreError> {
        match &self.bucket {
            Some(bucket) => bucket.holds(sha256).await,
            None => Ok(tokio::fs::try_exists(self.image_path(sha256)).await.unwrap_or_default()),
        }
    }

    /// Removes the file of an image, with an object store its object and the copy of it that is here, and its small
    /// pictures; nothing if it is not there.
    pub(super) async fn remove_image_file(&self, sha256: &[u8; 32]) -> Result<(), StoreError> {
        self.remove_small(sha256).await?;
        if let Some(bucket) = &self.bucket {
            bucket.remove(sha256).await?;
        }
        remove_if_there(&self.image_path(sha256)).await
    }

    fn image_path(&self, sha256: &[u8; 32]) -> PathBuf {
        self.folder.join(FOLDER).join(hexadecimal(sha256))
    }

    /// Removes what uploads have left behind that were cut off by the end of a process: the number of files removed.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn sweep_uploads(&self) -> Result<usize, StoreError> {
        let mut removed = 0;
        for path in files_of(&self.folder.join(INCOMING))? {
            let living = self.is_resumable(&path).await? || !is_unlocked(&path);
            removed += usize::from(!living && fs::remove_file(&path).is_ok());
        }
        for path in files_of(&self.folder.join(FOLDER))? {
            // with an object store they are copies, which make room by themselves
            if is_old(&path) && self.bucket.is_none() && !self.has_row(&path).await? {
                removed += usize::from(fs::remove_file(&path).is_ok());
            }
        }
        // another machine may have removed the image
        for path in files_of(&self.folder.join(overviews::FOLDER))? {
            if is_old(&path) && !self.has_row(Path::new(&overviews::digits_of(&path))).await? {
                removed += usize::from(fs::remove_file(&path).is_ok());
            }
        }
        Ok(removed)
    }

    async fn has_row(&self, path: &Path) -> Result<bool, StoreError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let Some(sha256) = from_hexadecimal(&name) else { return Ok(false) };
        Ok(query("SELECT EXISTS (SELECT 1 FROM images WHERE sha256 = $1 AND deleted_at IS NULL)")
            .bind(sha256)
            .fetch_value(&self.database)
            .await?)
    }
}

/// Bytes as lower-case hexadecimal digits.
#[must_use]
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// The bytes of hexadecimal digits.
#[must_use]
pub fn from_hexadecimal(text: &str) -> Option<Vec<u8>> {
    let digits = text.as_bytes();
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok();
    let hexadecimal = digits.iter().all(u8::is_ascii_hexdigit) && digits.len().is_multiple_of(2);
    hexadecimal.then(|| digits.chunks(2).map(byte).collect()).flatten()
}

/// The SHA-256 of a file, from its beginning.
///
/// # Errors
/// If it cannot be read.
pub fn sha256_of(mut file: &fs::File) -> std::io::Result<[u8; 32]> {
    file.seek(SeekFrom::Start(0))?;
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(hash.finalize().into()),
            count => hash.update(&buffer[..count]),
        }
    }
}

/// Removes a file, if it is there.
pub(super) async fn remove_if_there(path: &Path) -> Result<(), StoreError> {
    match tokio::fs::remove_file(path).await {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => Err(file_error("cannot remove", path, source)),
        _ => Ok(()),
    }
}

/// Whether a file is older than any upload or drawing that is just coming to its end.
fn is_old(path: &Path) -> bool {
    let modified = fs::metadata(path).and_then(|facts| facts.modified());
    modified.is_ok_and(|time| time.elapsed().is_ok_and(|age| age > FILE_WITHOUT_ROW_KEPT))
}

fn is_unlocked(path: &Path) -> bool {
    fs::File::open(path).is_ok_and(|file| file.try_lock().is_ok())
}

fn files_of(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let listed = fs::read_dir(folder).and_then(|entries| entries.map(|entry| Ok(entry?.path())).collect());
    listed.map_err(|source| file_error("cannot list", folder, source))
}

pub(super) async fn sync_folder(folder: &Path) -> Result<(), StoreError> {
    let synced = async { tokio::fs::File::open(folder).await?.sync_all().await };
    synced.await.map_err(|source| file_error("cannot sync", folder, source))
}

pub(super) fn file_error(action: &'static str, path: &Path, source: std::io::Error) -> StoreError {
    StoreError::File { action, path: path.to_owned(), source }
}
