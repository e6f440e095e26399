//! Import: one thread reads, all cores make control points of what it reads, and one connection writes them, some
//! thousands in a transaction. So much is in memory, however large the file is.

use std::ops::ControlFlow;

use rayon::iter::Either;
use rayon::prelude::*;
use tokio::sync::mpsc::{Sender, channel};

use super::resume::{self, Begun, FileIdentity};
use super::write::{NewRow, Target, remove_others, write_batch};
use crate::control::geojson::Rejection;
use crate::control::reading::{Raw, ReadError, Reading};
use crate::control::sets::{NewSet, found_or_made};
use crate::control::{ControlError, ImportReport, Mode};
use crate::database::{Database, Transaction, query};

/// So many control points are written in one transaction: large enough that waiting for the disk does not count and that
/// neighbours come together, small enough that others get to write in between.
const BATCH: usize = 20_000;
/// A batch of large buildings ends before: so many edges are in memory a few times over.
const BATCH_EDGES: usize = 800_000;
/// Memory for pages of SQLite while a batch is written, and at other times (its default): else each batch writes and
/// reads pages of the index of names again and again, which takes half as long once more.
const LARGE_CACHE: &str = "PRAGMA cache_size = -131072";
const USUAL_CACHE: &str = "PRAGMA cache_size = -2000";
/// Batches that wait to be written, beside the one that is gathered and the one that is written.
const WAITING: usize = 1;

/// What is to be imported.
#[derive(Debug, Clone, Default)]
pub struct Import {
    /// Where to.
    pub set: NewSet,
    /// What becomes of control points whose name is known in that set.
    pub mode: Mode,
    /// What the file is known by when it comes again after an interruption; `None` if it does not.
    pub file: Option<FileIdentity>,
    /// Whether it begins anew even if an import of this file was interrupted.
    pub anew: bool,
}

/// Why an import has not come to its end. What was written before stays.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The database failed.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// What is imported cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Reading has panicked.
    #[error("reading has panicked")]
    Panicked,
}

impl From<sqlx::Error> for ImportError {
    fn from(error: sqlx::Error) -> Self {
        Self::Control(error.into())
    }
}

/// How far an import has come.
#[derive(Debug)]
pub struct Step<'s> {
    /// Items of the file that are done.
    pub items_done: usize,
    /// What has come of them.
    pub report: &'s ImportReport,
    /// What was rejected since the last step, all of it.
    pub rejected: &'s [Rejection],
}

/// Writes what `read` gives, as `reading` understands it. `progress` is told after each batch.
///
/// With `replace`, what the set has beside is removed in the end: nothing is missing at any time, and nothing is removed
/// if there was not one good control point.
///
/// # Errors
/// [`ImportError`]; what was written in earlier batches stays, and is noted for a resumption if the file is known.
pub async fn import<F>(
    database: &Database,
    import: &Import,
    reading: Reading,
    read: F,
    mut progress: impl FnMut(Step<'_>),
) -> Result<ImportReport, ImportError>
where
    F: FnOnce(&Reading, &mut dyn FnMut(usize, Raw) -> ControlFlow<()>) -> Result<(), ReadError> + Send + 'static,
{
    let (sender, mut batches) = channel(WAITING);
    let set_id = found_or_made(database, &import.set).await?;
    let Begun { id, mut report, mut items_done } = resume::begun(database, import, &reading, set_id).await?;
    let target = Target { set_id, import_id: id, mode: import.mode };
    let reader = tokio::task::spawn_blocking(move || gather(&reading, read, items_done, &sender));
    while let Some(Batch { rows, mut rejected, items_done: done }) = batches.recv().await {
        let mut transaction = database.begin_alone().await?;
        set_cache(&mut transaction, LARGE_CACHE).await?;
        let written = write_batch(&mut transaction, target, rows).await?;
        rejected.extend(written.rejected);
        rejected.sort_by_key(|rejection| rejection.index);
        report.imported += written.imported;
        report.updated += written.updated;
        rejected.iter().cloned().for_each(|rejection| report.reject(rejection));
        items_done = done;
        resume::note(&mut transaction, id, &report, items_done).await?;
        set_cache(&mut transaction, USUAL_CACHE).await?;
        transaction.commit().await?;
        progress(Step { items_done, report: &report, rejected: &rejected });
    }
    reader.await.map_err(|_| ImportError::Panicked)??;
    if import.mode == Mode::Replace && report.imported + report.updated > 0 {
        remove_others(database, target).await?;
    }
    let mut transaction = database.begin_alone().await?;
    resume::end(&mut transaction, id).await?;
    transaction.commit().await?;
    Ok(report.sorted())
}

/// A connection keeps its cache after the transaction, among those that others take.
async fn set_cache(transaction: &mut Transaction, size: &'static str) -> Result<(), ControlError> {
    if let Transaction::Sqlite(_) = transaction {
        query(size).execute(transaction).await?;
    }
    Ok(())
}

/// Control points that are written together.
struct Batch {
    rows: Vec<NewRow>,
    rejected: Vec<Rejection>,
    /// Items of the file that are done with it.
    items_done: usize,
}

/// Reads to the end, or until nobody takes batches any more. Where it fails, the batch that was being gathered is lost:
/// a small file with an error in it leaves nothing.
fn gather<F>(reading: &Reading, read: F, skipped: usize, sender: &Sender<Batch>) -> Result<(), ReadError>
where
    F: FnOnce(&Reading, &mut dyn FnMut(usize, Raw) -> ControlFlow<()>) -> Result<(), ReadError>,
{
    let mut raws = Vec::new();
    let mut edges = 0;
    read(reading, &mut |index, raw| {
        if index < skipped {
            return ControlFlow::Continue(());
        }
        edges += raw.weight();
        raws.push((index, raw));
        if raws.len() < BATCH && edges < BATCH_EDGES {
            return ControlFlow::Continue(());
        }
        edges = 0;
        match sender.blocking_send(batch(reading, std::mem::take(&mut raws))) {
            Ok(()) => ControlFlow::Continue(()),
            // the database has failed, which is told there
            Err(_) => ControlFlow::Break(()),
        }
    })?;
    if !raws.is_empty() {
        let _ = sender.blocking_send(batch(reading, raws));
    }
    Ok(())
}

fn batch(reading: &Reading, raws: Vec<(usize, Raw)>) -> Batch {
    let items_done = raws.last().map_or(0, |(index, _)| index + 1);
    let (rows, rejected) = raws.into_par_iter().partition_map(|(index, raw)| match reading.control_point(index, raw) {
        Ok(point) => Either::Left(NewRow::of(index, point)),
        Err(rejection) => Either::Right(rejection),
    });
    Batch { rows, rejected, items_done }
}
