//! Small pictures of images: overviews and thumbnails as files in the data folder. They are made of the images and can be
//! made again: they are local to a machine, and in no backup.

use std::fs;
use std::path::{Path, PathBuf};

use uuid::Uuid;

use super::images::{file_error, hexadecimal, remove_if_there};
use super::{Store, StoreError};

pub(super) const FOLDER: &str = "overviews";

/// A picture that is made of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Small {
    /// What the higher levels of a large image are cut from.
    Overview,
    /// What a list shows.
    Thumbnail,
}

impl Small {
    const ALL: [Self; 2] = [Self::Overview, Self::Thumbnail];

    /// What comes after the SHA-256 in the name of its file.
    fn ending(self) -> &'static str {
        match self {
            Self::Overview => ".overview.jpg",
            Self::Thumbnail => ".thumbnail.jpg",
        }
    }
}

impl Store {
    /// Where a small picture is, if it was made.
    #[must_use]
    pub fn small_file(&self, sha256: &[u8; 32], which: Small) -> PathBuf {
        self.folder.join(FOLDER).join(hexadecimal(sha256) + which.ending())
    }

    /// Keeps a small picture; it is never seen in part.
    ///
    /// # Errors
    /// [`StoreError::File`], for example when the disk is full.
    pub fn keep_small(&self, sha256: &[u8; 32], which: Small, jpeg: &[u8]) -> Result<(), StoreError> {
        let (whole, part) = (self.small_file(sha256, which), self.folder.join(FOLDER).join(part_name()));
        let written = fs::write(&part, jpeg).and_then(|()| fs::rename(&part, &whole));
        written.map_err(|source| {
            let _ = fs::remove_file(&part);
            file_error("cannot write", &whole, source)
        })
    }

    /// Removes the small pictures of an image.
    pub(super) async fn remove_small(&self, sha256: &[u8; 32]) -> Result<(), StoreError> {
        for which in Small::ALL {
            remove_if_there(&self.small_file(sha256, which)).await?;
        }
        Ok(())
    }
}

fn part_name() -> String {
    format!("{}.part", Uuid::now_v7().simple())
}

/// The hexadecimal digits of the SHA-256 that a file of the folder belongs to.
pub(super) fn digits_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.split('.').next().unwrap_or_default().to_owned()
}
