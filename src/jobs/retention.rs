//! How long things are kept: a sweep, now and then, of what is older than the settings say and of what was left behind.

use std::time::Duration;

use chrono::{DateTime, TimeDelta, Utc};

use crate::store::removal::{Ended, Removal};
use crate::store::{Store, StoreError, now};

/// Between sweeps.
const INTERVAL: Duration = Duration::from_secs(3600);
/// So much is removed at a time, and others get to write in between.
const BATCH: u32 = 100;
const BREATH: Duration = Duration::from_millis(20);
/// So long an upload that has expired is remembered as such.
const EXPIRED_TOLD: TimeDelta = TimeDelta::hours(1);

/// How long things are kept, in days; 0 is for ever.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Retention {
    /// Images, from their upload; not while an orientation waits for them.
    pub images_days: u32,
    /// Orientations with a green verdict, from their end.
    pub green_days: u32,
    /// Yellow ones.
    pub yellow_days: u32,
    /// Red ones, and those that have failed or were cancelled.
    pub red_days: u32,
}

/// What a sweep has removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Swept {
    /// Images with their files.
    pub images: u64,
    /// Orientations with their results.
    pub orientations: u64,
    /// Uploads that were not resumed in time.
    pub uploads: u64,
    /// Files that nothing refers to.
    pub files: u64,
}

/// Sweeps every hour, for ever.
pub async fn keep_sweeping(store: Store, retention: Retention) {
    loop {
        tokio::time::sleep(INTERVAL).await;
        match sweep(&store, retention, now()).await {
            Ok(swept) if swept == Swept::default() => {}
            Ok(Swept { images, orientations, uploads, files }) => {
                tracing::info!(images, orientations, uploads, files, "removed what is not kept any longer");
            }
            Err(error) => tracing::warn!(%error, "what is not kept any longer could not be removed"),
        }
    }
}

/// Removes what is not kept any longer at the time `at`.
///
/// # Errors
/// [`StoreError`]; what was removed by then stays so.
pub async fn sweep(store: &Store, retention: Retention, at: DateTime<Utc>) -> Result<Swept, StoreError> {
    let mut swept = Swept::default();
    let of_verdicts = [
        (Ended::Green, retention.green_days),
        (Ended::Yellow, retention.yellow_days),
        (Ended::Other, retention.red_days),
    ];
    for (which, days) in of_verdicts {
        if let Some(before) = days_before(at, days) {
            swept.orientations += forget(store, which, before).await?;
        }
    }
    if let Some(before) = days_before(at, retention.images_days) {
        swept.images = remove_images(store, before).await?;
    }
    swept.uploads = remove_uploads(store, at - EXPIRED_TOLD).await?;
    swept.files = store.sweep_uploads().await? as u64;
    Ok(swept)
}

fn days_before(at: DateTime<Utc>, days: u32) -> Option<DateTime<Utc>> {
    (days > 0).then(|| at - TimeDelta::days(days.into()))
}

async fn forget(store: &Store, which: Ended, before: DateTime<Utc>) -> Result<u64, StoreError> {
    let mut removed = 0;
    loop {
        let count = store.forget_ended(which, before, BATCH).await?;
        removed += count;
        if count < u64::from(BATCH) {
            return Ok(removed);
        }
        tokio::time::sleep(BREATH).await;
    }
}

async fn remove_images(store: &Store, before: DateTime<Utc>) -> Result<u64, StoreError> {
    let mut removed = 0;
    loop {
        let old = store.old_images(before, BATCH).await?;
        let mut progress = false;
        for id in &old {
            let done = store.remove_image(*id).await? == Removal::Done;
            removed += u64::from(done);
            progress |= done;
        }
        // those that are in use again come another time
        if old.len() < BATCH as usize || !progress {
            return Ok(removed);
        }
        tokio::time::sleep(BREATH).await;
    }
}

async fn remove_uploads(store: &Store, before: DateTime<Utc>) -> Result<u64, StoreError> {
    let mut removed = 0;
    loop {
        let expired = store.expired_uploads(before, BATCH).await?;
        for id in &expired {
            removed += u64::from(store.remove_upload(*id).await?);
        }
        if expired.len() < BATCH as usize {
            return Ok(removed);
        }
        tokio::time::sleep(BREATH).await;
    }
}
