//! Where the bytes of images are: in the data folder, or in a bucket of an S3-compatible object store that several machines
//! share.
//!
//! Pictures are read by windows from a local file. With a bucket the data folder keeps copies of what was read last, up
//! to a size; a copy is made whole under another name first, so that it is never seen in part.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use futures_util::StreamExt as _;
use object_store::aws::AmazonS3Builder;
use object_store::buffered::BufWriter;
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt as _, PutPayload};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use uuid::Uuid;

use super::StoreError;
use super::images::hexadecimal;

/// Copies of objects that the data folder keeps.
const COPIES_MAX_BYTES: u64 = 20_000_000_000;
/// So much of a file is handed on at a time.
const PIECE_BYTES: usize = 1 << 20;

/// A bucket, and the part of it that is ours. Cheap to clone.
#[derive(Debug, Clone)]
pub(super) struct Bucket {
    store: Arc<dyn ObjectStore>,
    prefix: Key,
}

impl Bucket {
    /// The bucket of a URL `s3://bucket/prefix`. Keys, region and address come from `AWS_ACCESS_KEY_ID`,
    /// `AWS_SECRET_ACCESS_KEY`, `AWS_REGION` and `AWS_ENDPOINT_URL`.
    pub(super) fn open(url: &str) -> Result<Self, StoreError> {
        let place = url.strip_prefix("s3://").filter(|place| !place.is_empty());
        let place = place.ok_or_else(|| StoreError::ObjectsUrl { url: url.to_owned() })?;
        let (bucket, prefix) = place.split_once('/').unwrap_or((place, ""));
        // of two that rustls knows; once it is chosen, it is
        let _ = rustls::crypto::ring::default_provider().install_default();
        let plain = std::env::var("AWS_ENDPOINT_URL").is_ok_and(|address| address.starts_with("http://"));
        let store = AmazonS3Builder::from_env().with_bucket_name(bucket).with_allow_http(plain).build()?;
        Ok(Self { store: Arc::new(store), prefix: Key::from(prefix) })
    }

    fn key(&self, sha256: &[u8; 32]) -> Key {
        self.prefix.clone().join(hexadecimal(sha256).as_str())
    }

    /// Puts a file there; it is visible only as a whole.
    pub(super) async fn put(&self, sha256: &[u8; 32], file: &Path) -> Result<(), StoreError> {
        let unreadable = |source| StoreError::File { action: "cannot read", path: file.to_owned(), source };
        let mut from = tokio::fs::File::open(file).await.map_err(unreadable)?;
        let mut to = BufWriter::new(self.store.clone(), self.key(sha256));
        let mut piece = vec![0; PIECE_BYTES];
        loop {
            let bytes = from.read(&mut piece).await.map_err(unreadable)?;
            if bytes == 0 {
                break;
            }
            to.write_all(&piece[..bytes]).await.map_err(not_stored)?;
        }
        to.shutdown().await.map_err(not_stored)
    }

    /// Whether it is there.
    pub(super) async fn holds(&self, sha256: &[u8; 32]) -> Result<bool, StoreError> {
        match self.store.head(&self.key(sha256)).await {
            Ok(_) => Ok(true),
            Err(object_store::Error::NotFound { .. }) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Removes it; nothing if it is not there.
    pub(super) async fn remove(&self, sha256: &[u8; 32]) -> Result<(), StoreError> {
        match self.store.delete(&self.key(sha256)).await {
            Ok(()) | Err(object_store::Error::NotFound { .. }) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    /// The file of the copy in `folder`, which is fetched if it is not there.
    pub(super) async fn copy(&self, sha256: &[u8; 32], folder: &Path) -> Result<PathBuf, StoreError> {
        let copy = folder.join(hexadecimal(sha256));
        if tokio::fs::try_exists(&copy).await.unwrap_or_default() {
            // what was used last goes last; where that cannot be noted, it goes earlier
            let _ = std::fs::File::open(&copy).and_then(|file| file.set_modified(SystemTime::now()));
            return Ok(copy);
        }
        let part = folder.join(format!("{}.part", Uuid::now_v7().simple()));
        let unwritable = |source| StoreError::File { action: "cannot write", path: part.clone(), source };
        let fetched = async {
            let mut bytes = self.store.get(&self.key(sha256)).await?.into_stream();
            let mut file = tokio::fs::File::create_new(&part).await.map_err(unwritable)?;
            while let Some(piece) = bytes.next().await {
                file.write_all(&piece?).await.map_err(unwritable)?;
            }
            file.flush().await.map_err(unwritable)?;
            tokio::fs::rename(&part, &copy).await.map_err(unwritable)
        };
        let fetched: Result<(), StoreError> = fetched.await;
        if fetched.is_err() {
            let _ = tokio::fs::remove_file(&part).await;
        }
        fetched?;
        make_room(folder, COPIES_MAX_BYTES);
        Ok(copy)
    }

    /// Whether it answers; the first time in its life also whether it can be written to.
    pub(super) async fn ping(&self) -> Result<(), StoreError> {
        let key = self.prefix.clone().join("ping");
        if let Err(error) = self.store.head(&key).await {
            let object_store::Error::NotFound { .. } = error else { return Err(error.into()) };
            self.store.put(&key, PutPayload::from_static(b"gable")).await?;
        }
        Ok(())
    }
}

fn not_stored(source: std::io::Error) -> StoreError {
    StoreError::Objects { source: object_store::Error::Generic { store: "S3", source: source.into() } }
}

/// Removes the copies that were used longest ago, until the rest is small enough. A copy that is being read stays on disk
/// until its reader closes it.
fn make_room(folder: &Path, most_bytes: u64) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    let facts = |entry: std::fs::DirEntry| {
        let facts = entry.metadata().ok()?;
        Some((facts.modified().ok()?, facts.len(), entry.path()))
    };
    let mut copies: Vec<(SystemTime, u64, PathBuf)> = entries.flatten().filter_map(facts).collect();
    copies.sort();
    let mut bytes: u64 = copies.iter().map(|(_, bytes, _)| bytes).sum();
    for (_, size, path) in copies {
        if bytes <= most_bytes {
            break;
        }
        if std::fs::remove_file(path).is_ok() {
            bytes -= size;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn copies_that_were_used_longest_ago_make_room() {
        let folder = tempfile::tempdir().unwrap();
        for (name, age_s) in [("old", 300), ("older", 600), ("new", 1)] {
            let path = folder.path().join(name);
            std::fs::write(&path, [0; 100]).unwrap();
            let used = SystemTime::now() - Duration::from_secs(age_s);
            std::fs::File::open(&path).unwrap().set_modified(used).unwrap();
        }
        let there = || ["old", "older", "new"].map(|name| folder.path().join(name).exists());
        make_room(folder.path(), 300);
        assert_eq!(there(), [true, true, true]);
        make_room(folder.path(), 299);
        assert_eq!(there(), [true, false, true]);
        make_room(folder.path(), 100);
        assert_eq!(there(), [false, false, true]);
    }

    #[test]
    fn a_url_of_another_kind_is_refused() {
        for url in ["http://x/y", "s3://", "/tmp"] {
            let error = Bucket::open(url).unwrap_err().to_string();
            assert!(error.contains("s3://bucket/prefix"), "{error}");
        }
    }
}
