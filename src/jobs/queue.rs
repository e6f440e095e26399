//! The queue, by apalis on our own database: which orientation is looked at next. Everything that knows apalis is here, but
//! for its tables, which `database::open` makes. Its own `setup()` is never called: it would switch off the syncing of
//! commits of SQLite (`PRAGMA synchronous = OFF`).
//!
//! What is in the queue is only a hint; the row of the orientation is the truth. What it delivers twice or too late does
//! no harm, and what a process had taken out of it when it died is delivered to another one.

use std::sync::Arc;
use std::time::Duration;

use apalis::prelude::{
    BackendExt as _, Data, Strategy, TaskBuilder, WorkerBuilder, WorkerBuilderExt as _, WorkerError,
};
use apalis_postgres::PostgresStorage;
use apalis_sqlite::SqliteStorage;
use futures_util::future::{BoxFuture, FutureExt as _};
use futures_util::stream;
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use crate::database::{Database, Dialects, Transaction, query};
use crate::store::StoreError;
use crate::store::orientations::Turn;

const NAME: &str = "orientations";
/// How often the database is asked although nobody has called: a call can be lost with a connection.
const POLL_INTERVAL: Duration = Duration::from_secs(5);
/// How often a process says that it lives, and after how many silent times what it had taken is given to another.
const HEARTBEAT: Duration = Duration::from_secs(5);
const MISSED_HEARTBEATS: usize = 5;
/// Priorities of the queue are 31-bit numbers, the largest first: three classes, and turns within each.
const TURNS: i64 = 700_000_000;
/// After the database failed, before it is tried again.
const PAUSE_AFTER_FAILURE: Duration = Duration::from_secs(1);

const DONE: Dialects = Dialects {
    sqlite: "DELETE FROM Jobs WHERE status IN ('Done', 'Failed', 'Killed')",
    postgres: "DELETE FROM apalis.jobs WHERE status IN ('Done', 'Failed', 'Killed')",
};
const SILENT: Dialects = Dialects {
    sqlite: "DELETE FROM Workers WHERE last_seen < unixepoch() - 3600
             AND NOT EXISTS (SELECT 1 FROM Jobs WHERE lock_by = Workers.id)",
    postgres: "DELETE FROM apalis.workers w WHERE last_seen < now() - interval '1 hour'
               AND NOT EXISTS (SELECT 1 FROM apalis.jobs WHERE lock_by = w.id)",
};

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
    database: Database,
    added: Arc<Notify>,
}

impl Queue {
    pub(super) fn new(database: Database) -> Self {
        Self { database, added: Arc::default() }
    }

    /// Adds an orientation, as a part of the transaction that makes it wait.
    pub(super) async fn push(&self, transaction: &mut Transaction, id: Uuid, turn: Turn) -> Result<(), StoreError> {
        let task = serde_json::json!(id).to_string().into_bytes();
        match transaction {
            Transaction::Sqlite(inner) => {
                let task = TaskBuilder::new(task).max_attempts(1).priority(rank(turn)).build();
                let pushed = apalis_sqlite::queries::push_tasks(&mut **inner, NAME, &[task]).await;
                pushed.map_err(|error| sqlx::Error::Protocol(error.to_string()))?;
            }
            // its own way of adding tasks takes a connection of its own, outside of our transaction
            Transaction::Postgres(_) => {
                query(
                    "INSERT INTO apalis.jobs (id, job_type, job, status, attempts, max_attempts, run_at, priority, metadata)
                     VALUES (apalis.generate_ulid(), $1, $2, 'Pending', 0, 1, now(), CAST($3 AS INTEGER), '')",
                )
                .bind(NAME)
                .bind(task)
                .bind(i64::try_from(rank(turn)).unwrap_or_default())
                .execute(transaction)
                .await?;
            }
        }
        Ok(())
    }

    /// Forgets everything: the tasks of former runs, done or not, and their workers. Only where no other process works.
    pub(super) async fn clear(&self, transaction: &mut Transaction) -> Result<(), StoreError> {
        query("DELETE FROM Jobs").execute(&mut *transaction).await?;
        query("DELETE FROM Workers").execute(transaction).await?;
        Ok(())
    }

    /// Forgets the tasks that are done, and the workers that have long been silent.
    pub(super) async fn forget_done(&self) -> Result<(), StoreError> {
        for forgotten in [DONE, SILENT] {
            query(self.database.dialect(forgotten)).execute(&self.database).await?;
        }
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
        let name = format!("gable-{}", Uuid::now_v7());
        let calls = stream::unfold(self.added.clone(), |added| async {
            added.notified().await;
            Some(((), added))
        });
        let strategy = Strategy::new().stream(Box::pin(calls)).interval(POLL_INTERVAL);
        // one task at a time: what is fetched ahead could not be taken by a worker that is free earlier
        macro_rules! run {
            ($storage:ident, $config:path, $pool:expr) => {{
                let config = <$config>::default()
                    .queue(NAME)
                    .batch_size(1)
                    .persist_results(false)
                    .heartbeat_interval(HEARTBEAT)
                    .missed_heartbeats(MISSED_HEARTBEATS);
                let backend = $storage::<Uuid>::new($pool).with_config(config).poll_with_strategy(strategy);
                WorkerBuilder::new(name)
                    .backend(backend)
                    .data(handler)
                    .concurrency(workers)
                    .build(handle)
                    .run_until(async move {
                        stop.cancelled().await;
                        Ok::<_, std::io::Error>(())
                    })
                    .boxed()
            }};
        }
        match &self.database {
            Database::Sqlite(pool) => run!(SqliteStorage, apalis_sqlite::Config, pool),
            Database::Postgres(pool) => run!(PostgresStorage, apalis_postgres::Config, pool),
        }
    }
}

/// The place of a turn in the queue.
fn rank(turn: Turn) -> usize {
    let before = TURNS - 1 - turn.number.clamp(0, TURNS - 1);
    usize::try_from(i64::from(turn.priority) * TURNS + before).unwrap_or_default()
}

async fn handle(id: Uuid, handler: Data<Handler>) {
    let Handler(work) = &*handler;
    work(id).await;
}
