//! The pictures that are open.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::OnceCell;

use super::LookError;
use crate::imagery::ImageFile;

/// Which picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Key {
    /// Of the image's file.
    pub(super) sha256: [u8; 32],
    /// The overview instead of the file.
    pub(super) small: bool,
}

pub(super) type Opened = Result<Arc<ImageFile>, LookError>;

/// Pictures that are open, up to a number of bytes, and the one used last in any case.
#[derive(Debug)]
pub(super) struct Kept {
    max_bytes: u64,
    pictures: Arc<Mutex<Pictures>>,
}

#[derive(Debug, Default)]
struct Pictures {
    uses: u64,
    entries: HashMap<Key, Entry>,
}

#[derive(Debug)]
struct Entry {
    last_use: u64,
    picture: Arc<OnceCell<Opened>>,
}

impl Entry {
    fn bytes(&self) -> u64 {
        self.picture.get().and_then(|opened| opened.as_ref().ok()).map_or(0, |picture| picture.memory_bytes())
    }
}

impl Kept {
    pub(super) fn new(max_bytes: u64) -> Self {
        Self { max_bytes, pictures: Arc::default() }
    }

    /// The picture. If it is not open `open` is run, once for all who ask meanwhile, even if they go away; what could not
    /// be opened is tried again by who asks later.
    pub(super) async fn get(&self, key: Key, open: impl Future<Output = Opened> + Send + 'static) -> Opened {
        let picture = locked(&self.pictures).entry(key);
        if let Some(opened) = picture.get() {
            return opened.clone();
        }
        let (pictures, max_bytes) = (self.pictures.clone(), self.max_bytes);
        let opening = tokio::spawn(async move {
            let opened = picture.get_or_init(|| open).await.clone();
            locked(&pictures).settle(key, opened.is_ok(), max_bytes);
            opened
        });
        opening.await?
    }

    /// Closes what is open of an image.
    pub(super) fn forget(&self, sha256: &[u8; 32]) {
        locked(&self.pictures).entries.retain(|key, _| key.sha256 != *sha256);
    }
}

impl Pictures {
    fn entry(&mut self, key: Key) -> Arc<OnceCell<Opened>> {
        self.uses += 1;
        let entry = self.entries.entry(key).or_insert_with(|| Entry { last_use: 0, picture: Arc::default() });
        entry.last_use = self.uses;
        entry.picture.clone()
    }

    /// After a picture was opened: closes those that were not used for longest, until the rest is small enough.
    fn settle(&mut self, key: Key, usable: bool, max_bytes: u64) {
        if !usable {
            self.entries.remove(&key);
        }
        while self.entries.values().map(Entry::bytes).sum::<u64>() > max_bytes {
            let open = self.entries.iter().filter(|(other, entry)| **other != key && entry.bytes() > 0);
            let Some(oldest) = open.min_by_key(|(_, entry)| entry.last_use).map(|(key, _)| *key) else { return };
            self.entries.remove(&oldest);
        }
    }
}

/// A lock is never left with half-made contents.
fn locked(pictures: &Mutex<Pictures>) -> MutexGuard<'_, Pictures> {
    pictures.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::time::Duration;

    use super::*;
    use crate::features::PictureError;
    use crate::imagery::Limits;

    const A: Key = Key { sha256: [1; 32], small: false };
    const B: Key = Key { sha256: [2; 32], small: false };
    const C: Key = Key { sha256: [3; 32], small: false };

    /// A picture of a hundred bytes.
    fn picture() -> Arc<ImageFile> {
        let file = tempfile::Builder::new().suffix(".png").tempfile().unwrap();
        image::GrayImage::new(10, 10).save(file.path()).unwrap();
        Arc::new(ImageFile::open(file.path(), &Limits::default()).unwrap())
    }

    async fn opened_anew(kept: &Kept, key: Key) -> bool {
        let count = Arc::new(AtomicU32::new(0));
        let counted = count.clone();
        let open = async move {
            counted.fetch_add(1, Ordering::SeqCst);
            Ok(picture())
        };
        kept.get(key, open).await.unwrap();
        count.load(Ordering::SeqCst) == 1
    }

    #[tokio::test]
    async fn what_was_not_used_for_longest_makes_room() {
        let kept = Kept::new(250);
        assert!(opened_anew(&kept, A).await);
        assert!(opened_anew(&kept, B).await);
        assert!(!opened_anew(&kept, A).await);
        assert!(opened_anew(&kept, C).await, "takes the place of B");
        assert!(!opened_anew(&kept, A).await);
        assert!(!opened_anew(&kept, C).await);
        assert!(opened_anew(&kept, B).await);
        kept.forget(&B.sha256);
        assert!(opened_anew(&kept, B).await);
        // the one used last stays, whatever it takes
        let small = Kept::new(50);
        assert!(opened_anew(&small, A).await);
        assert!(!opened_anew(&small, A).await);
        assert!(opened_anew(&small, B).await);
        assert!(opened_anew(&small, A).await);
    }

    #[tokio::test]
    async fn it_is_opened_once_for_all_who_ask_and_also_if_they_go_away() {
        let (kept, count) = (Kept::new(1000), Arc::new(AtomicU32::new(0)));
        let ask = || {
            let count = count.clone();
            kept.get(A, async move {
                count.fetch_add(1, Ordering::SeqCst);
                tokio::time::sleep(Duration::from_millis(50)).await;
                Ok(picture())
            })
        };
        let gone = tokio::time::timeout(Duration::from_millis(10), ask()).await;
        assert!(gone.is_err());
        let asked = futures_util::future::join_all((0..8).map(|_| ask())).await;
        assert!(asked.iter().all(Result::is_ok));
        assert_eq!(count.load(Ordering::SeqCst), 1);
    }

    #[tokio::test]
    async fn what_cannot_be_opened_is_told_to_all_who_wait_and_tried_again_later() {
        let (kept, count) = (Kept::new(1000), Arc::new(AtomicU32::new(0)));
        let ask = || {
            let count = count.clone();
            kept.get(A, async move {
                count.fetch_add(1, Ordering::SeqCst);
                tokio::time::sleep(Duration::from_millis(20)).await;
                Err(PictureError { detail: "broken".into() }.into())
            })
        };
        for tries in 1..=2 {
            let asked = futures_util::future::join_all((0..8).map(|_| ask())).await;
            assert!(asked.iter().all(|opened| opened.as_ref().is_err_and(|error| error.to_string() == "broken")));
            assert_eq!(count.load(Ordering::SeqCst), tries);
        }
        assert!(opened_anew(&kept, A).await);
    }
}
