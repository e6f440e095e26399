//! Images to look at: tiles, thumbnails and windows as grey JPEGs.
//!
//! What is looked at stays open for a while, up to a bound on its memory, and is opened once however many ask. Of a large
//! image an overview is made when it is first looked at, and kept as a file. All of it is blocking work, of which only so
//! much is done at a time.

mod kept;

use std::sync::Arc;

use tokio::sync::Semaphore;

use self::kept::{Kept, Key, Opened};
use crate::features::{Picture as _, PictureError, PixelRect};
use crate::imagery::levels::{self, Levels};
use crate::imagery::{ImageFile, ImageryError, Limits};
use crate::store::images::Image;
use crate::store::overviews::Small;
use crate::store::{Store, StoreError};

/// Files opened, and overviews made, at a time: an opened JPEG is decoded as a whole, and an overview needs all cores.
const OPENED_AT_A_TIME: usize = 2;
/// Longer side of a thumbnail at the most.
const THUMBNAIL_SIDE_PX: u32 = 256;
/// Quality of what is shown.
const SHOWN_QUALITY: u8 = 88;
/// Quality of an overview, which is compressed once more when it is shown.
const OVERVIEW_QUALITY: u8 = 95;

/// Why an image cannot be looked at. All who wait for one file are told the same.
#[derive(Debug, Clone, thiserror::Error)]
#[non_exhaustive]
pub enum LookError {
    /// The file cannot be used.
    #[error(transparent)]
    Imagery(Arc<ImageryError>),
    /// The file is damaged there.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// The file cannot be had.
    #[error(transparent)]
    Store(Arc<StoreError>),
    /// Reading has panicked.
    #[error("looking at an image has panicked: {0}")]
    Panic(Arc<str>),
}

impl From<ImageryError> for LookError {
    fn from(error: ImageryError) -> Self {
        Self::Imagery(Arc::new(error))
    }
}

impl From<StoreError> for LookError {
    fn from(error: StoreError) -> Self {
        Self::Store(Arc::new(error))
    }
}

impl From<tokio::task::JoinError> for LookError {
    fn from(error: tokio::task::JoinError) -> Self {
        Self::Panic(error.to_string().into())
    }
}

/// Images that are looked at. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Pictures(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    store: Store,
    limits: Limits,
    /// Room that is left on the disk.
    reserve_bytes: u64,
    kept: Kept,
    opening: Arc<Semaphore>,
    cutting: Arc<Semaphore>,
}

impl Pictures {
    /// Pictures of the images of a store. Those that are open take up to `cache_bytes`, and overviews are kept as long as
    /// `reserve_bytes` are left on the disk.
    #[must_use]
    pub fn new(store: Store, limits: &Limits, cache_bytes: u64, reserve_bytes: u64) -> Self {
        // of several images that are looked at by turns none is to drive the others out
        let chunk_cache_bytes = limits.chunk_cache_bytes.min(cache_bytes / 4);
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self(Arc::new(Inner {
            store,
            limits: Limits { chunk_cache_bytes, ..limits.clone() },
            reserve_bytes,
            kept: Kept::new(cache_bytes),
            opening: Arc::new(Semaphore::new(OPENED_AT_A_TIME)),
            cutting: Arc::new(Semaphore::new(cores)),
        }))
    }

    /// A tile of a level; `None` where there is none.
    ///
    /// # Errors
    /// [`LookError`] if the file is damaged or cannot be had.
    pub async fn tile(&self, image: &Image, [level, column, row]: [u32; 3]) -> Result<Option<Vec<u8>>, LookError> {
        let levels = levels_of(image);
        let Some(tile) = levels.tile(level, column, row) else { return Ok(None) };
        let (picture, base) = match levels.overview() {
            Some(base) if base <= level => (self.overview(image, base).await?, base),
            _ => (self.file(image).await?, 0),
        };
        let reduction = 1 << (level - base);
        let rect = levels::enlarged(tile, reduction, picture.size_px());
        self.cut(picture, rect, reduction).await.map(Some)
    }

    /// The part of a rectangle that lies in the image, in the pixels of the file.
    ///
    /// # Errors
    /// [`LookError`] if the file is damaged or cannot be had.
    pub async fn window(&self, image: &Image, rect: PixelRect) -> Result<Vec<u8>, LookError> {
        self.cut(self.file(image).await?, rect, 1).await
    }

    /// The whole image, small.
    ///
    /// # Errors
    /// [`LookError`] if the file is damaged or cannot be had.
    pub async fn thumbnail(&self, image: &Image) -> Result<Vec<u8>, LookError> {
        if let Ok(jpeg) = tokio::fs::read(self.0.store.small_file(&image.sha256, Small::Thumbnail)).await {
            return Ok(jpeg);
        }
        let picture = match levels_of(image).overview() {
            Some(base) => self.overview(image, base).await?,
            None => self.file(image).await?,
        };
        let [width, height] = picture.size_px();
        let reduction = width.max(height).div_ceil(THUMBNAIL_SIDE_PX).max(1);
        let jpeg = self.cut(picture, PixelRect { x: 0, y: 0, width, height }, reduction).await?;
        let (this, sha256) = (self.0.clone(), image.sha256);
        Ok(tokio::task::spawn_blocking(move || {
            this.keep(&sha256, Small::Thumbnail, &jpeg);
            jpeg
        })
        .await?)
    }

    /// Closes what is open of an image that was removed, so that the disk gets its room back.
    pub fn forget(&self, sha256: &[u8; 32]) {
        self.0.kept.forget(sha256);
    }

    async fn cut(&self, picture: Arc<ImageFile>, rect: PixelRect, reduction: u32) -> Result<Vec<u8>, LookError> {
        let permit = self.0.cutting.clone().acquire_owned().await;
        let cut = move || {
            let _permit = permit;
            Ok(levels::jpeg(&picture.window(rect, reduction)?, SHOWN_QUALITY)?)
        };
        tokio::task::spawn_blocking(cut).await?
    }

    async fn file(&self, image: &Image) -> Opened {
        let (inner, sha256) = (self.0.clone(), image.sha256);
        self.0.kept.get(Key { sha256, small: false }, async move { inner.open(&sha256).await }).await
    }

    async fn overview(&self, image: &Image, level: u32) -> Opened {
        let key = Key { sha256: image.sha256, small: true };
        let (this, image) = (self.clone(), image.clone());
        let made = async move {
            let size_px = levels_of(&image).level_px(level);
            if let Some(kept) = this.0.kept_overview(&image.sha256, size_px).await? {
                return Ok(Arc::new(kept));
            }
            let file = this.file(&image).await?;
            this.0.make_overview(file, image.sha256, 1 << level).await
        };
        self.0.kept.get(key, made).await
    }
}

impl Inner {
    async fn open(&self, sha256: &[u8; 32]) -> Opened {
        let (path, limits) = (self.store.image_file(sha256).await?, self.limits.clone());
        self.one_of_few(move || Ok(Arc::new(ImageFile::open(&path, &limits)?))).await
    }

    /// The overview that was made before; one that cannot be read, or is another one's, is none.
    async fn kept_overview(&self, sha256: &[u8; 32], size_px: [u32; 2]) -> Result<Option<ImageFile>, LookError> {
        let path = self.store.small_file(sha256, Small::Overview);
        if !tokio::fs::try_exists(&path).await.unwrap_or_default() {
            return Ok(None);
        }
        // its limits are those of a file of ours
        let opened = self.one_of_few(move || Ok(ImageFile::open(&path, &Limits::default()).ok())).await?;
        Ok(opened.filter(|picture| picture.size_px() == size_px))
    }

    async fn make_overview(self: &Arc<Self>, file: Arc<ImageFile>, sha256: [u8; 32], reduction: u32) -> Opened {
        let (path, limits) = (self.store.image_file(&sha256).await?, self.limits.clone());
        let make = move || Ok(Arc::new(levels::overview(&file, &path, &limits, reduction)?));
        let overview = self.one_of_few(make).await?;
        // whoever waits for the first tile does not wait for the file too
        let (this, made) = (self.clone(), overview.clone());
        tokio::spawn(async move {
            let inner = this.clone();
            let keep = move || {
                let [width, height] = made.size_px();
                let whole = made.window(PixelRect { x: 0, y: 0, width, height }, 1)?;
                inner.keep(&sha256, Small::Overview, &levels::jpeg(&whole, OVERVIEW_QUALITY)?);
                Ok(())
            };
            if let Err(error) = this.one_of_few(keep).await {
                tracing::warn!(%error, "the overview of an image was not kept");
            }
        });
        Ok(overview)
    }

    /// Keeps a small picture as a file, if there is room: it is only faster so.
    fn keep(&self, sha256: &[u8; 32], which: Small, jpeg: &[u8]) {
        let room =
            self.store.free_bytes().is_ok_and(|free| free > self.reserve_bytes.saturating_add(jpeg.len() as u64));
        let kept = if room { self.store.keep_small(sha256, which, jpeg) } else { Ok(()) };
        if let Err(error) = kept {
            tracing::warn!(%error, "a small picture of an image was not kept");
        }
    }

    async fn one_of_few<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> Result<T, LookError> + Send + 'static,
    ) -> Result<T, LookError> {
        let permit = self.opening.clone().acquire_owned().await;
        let alone = move || {
            let _permit = permit;
            work()
        };
        tokio::task::spawn_blocking(alone).await?
    }
}

fn levels_of(image: &Image) -> Levels {
    Levels { size_px: [image.header.width_px, image.header.height_px] }
}
