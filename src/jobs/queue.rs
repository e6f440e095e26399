//! The queue, by apalis on our own database: which orientation is looked at next. Everything that knows apalis is here.
//!
//! What is in the queue is only a hint; the row of the orientation is the truth. So the queue is filled anew at every
//! start, and what it delivers twice or too late does no harm. Its own `setup()` is never called: it would switch off
//! the syncing of commits (`PRAGMA synchronous = OFF`).

use std::sync::Arc;
use std::time::Duration;

use apalis::prelude::{
    BackendExt as _, Data, Strategy, TaskBuilder, WorkerBuilder, WorkerBuilderExt as _, WorkerError,
};
use apalis_sqlite::{Config, SqliteStorage, queries};
use futures_util::future::{BoxFuture, FutureExt as _};
use futures_util::stream;
use sqlx::{Sqlite, SqlitePool, Transaction};
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use crate::store::StoreError;

const NAME: &str = "orientations";
/// How often the database is asked although nobody has called: only another process can have added something.
const POLL_INTERVAL: Duration = Duration::from_secs(5);
/// After the database failed, before it is tried again.
const PAUSE_AFTER_FAILURE: Duration = Duration::from_secs(1);

/// What is done with an orientation that is taken out of the queue. It answers for its own failures.
#[derive(Clone)]
pub(super) struct Handler(Arc<dyn Fn(Uuid) -> BoxFuture<'static, ()> + Send + Sync>);

impl Handler {
    pub(super) fn new(work: impl Fn(Uuid) -> BoxFuture<'static, ()> + Send + Sync + 'static) -> Self {
        Self(Arc::new(work))
    }
}

/// The queue.
#[derive(Debug, Clone)]
pub(super) struct Queue {
    pool: SqlitePool,
    added: Arc<Notify>,
}

impl Queue {
    pub(super) fn new(pool: SqlitePool) -> Self {
        Self { pool, added: Arc::default() }
    }

    /// Makes its tables, or brings them up to date.
    pub(super) async fn migrate(&self) -> Result<(), StoreError> {
        // its migrations are counted in the same table as ours
        let mut migrations = SqliteStorage::migrations();
        migrations.set_ignore_missing(true);
        Ok(migrations.run(&self.pool).await?)
    }

    /// Adds an orientation, as a part of the transaction that makes it wait.
    pub(super) async fn push(&self, transaction: &mut Transaction<'_, Sqlite>, id: Uuid) -> Result<(), StoreError> {
        let task = TaskBuilder::new(serde_json::json!(id).to_string().into_bytes()).max_attempts(1).build();
        queries::push_tasks(&mut **transaction, NAME, &[task])
            .await
            .map_err(|error| StoreError::from(sqlx::Error::Protocol(error.to_string())))
    }

    /// Forgets everything: the tasks of former runs, done or not, and their workers.
    pub(super) async fn clear(&self, transaction: &mut Transaction<'_, Sqlite>) -> Result<(), StoreError> {
        sqlx::query("DELETE FROM Jobs").execute(&mut **transaction).await?;
        sqlx::query("DELETE FROM Workers").execute(&mut **transaction).await?;
        Ok(())
    }

    /// Forgets the tasks that are done.
    pub(super) async fn forget_done(&self) -> Result<(), StoreError> {
        sqlx::query("DELETE FROM Jobs WHERE status IN ('Done', 'Failed', 'Killed')").execute(&self.pool).await?;
        Ok(())
    }

    /// Says that something was added, once its transaction is complete.
    pub(super) fn announce(&self) {
        self.added.notify_one();
    }

    /// Hands orientations to `handler`, at most `workers` at a time, until `stop`; then waits for those under way.
    pub(super) async fn deliver(&self, workers: usize, handler: Handler, stop: CancellationToken) {
        while !stop.is_cancelled() {
            if let Err(error) = self.worker(workers, handler.clone(), stop.clone()).await {
                tracing::error!(%error, "the queue has failed and is started again");
                tokio::time::sleep(PAUSE_AFTER_FAILURE).await;
            }
        }
    }

    fn worker(
        &self,
        workers: usize,
        handler: Handler,
        stop: CancellationToken,
    ) -> BoxFuture<'static, Result<(), WorkerError>> {
        // one task at a time: what is fetched ahead could not be taken by a worker that is free earlier
        let config = Config::default().queue(NAME).batch_size(1).persist_results(false);
        let calls = stream::unfold(self.added.clone(), |added| async {
            added.notified().await;
            Some(((), added))
        });
        let backend = SqliteStorage::<Uuid>::new(&self.pool)
            .with_config(config)
            .poll_with_strategy(Strategy::new().stream(Box::pin(calls)).interval(POLL_INTERVAL));
        WorkerBuilder::new(format!("gable-{}", Uuid::now_v7()))
            .backend(backend)
            .data(handler)
            .concurrency(workers)
            .build(handle)
            .run_until(async move {
                stop.cancelled().await;
                Ok::<_, std::io::Error>(())
            })
            .boxed()
    }
}

async fn handle(id: Uuid, handler: Data<Handler>) {
    let Handler(work) = &*handler;
    work(id).await;
}
