//! Tells others that an orientation has ended, by a `POST` to the address that the request named.
//!
//! What is to be told is in the rows of `store::webhooks`. Each event is told at least once, and possibly more than once,
//! always under the same id; the order of events is not promised. A try that fails is repeated after a pause that grows
//! from a second to an hour, for a day; then the event is given up, and can be sent again by hand.

mod address;
mod sender;
mod signature;
mod target;
#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::time::Duration;

use rand::Rng as _;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

pub use address::is_public;
pub use sender::{Lookup, SendError, Sender, by_the_system};
pub use signature::{Secret, SecretError};
pub use target::Policy;

use crate::store::webhooks::Due;
use crate::store::{Store, StoreError};

/// Events told at a time.
const AT_A_TIME: u32 = 16;
/// How often the rows are looked at.
const LOOK_INTERVAL: Duration = Duration::from_millis(500);
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);
/// For how long an event is tried.
const TRIED_FOR: Duration = Duration::from_secs(24 * 3600);
/// The name under which the secret is kept that the service has drawn for itself.
const SECRET: &str = "webhooks";

/// The secret that signs: the one that is given or, without, one that is drawn once and kept in the database.
///
/// # Errors
/// [`SecretError`] if it is malformed, or cannot be drawn or kept.
pub async fn secret(store: &Store, given: Option<&str>) -> Result<Secret, SecretError> {
    match given {
        Some(text) => text.parse(),
        None => store.secret(SECRET, &Secret::random()?.to_string()).await?.parse(),
    }
}

/// Tells what is to be told until `stop`. Tries under way come to their end.
pub async fn run(store: Store, sender: Sender, stop: CancellationToken) {
    let sender = Arc::new(sender);
    let mut tries = JoinSet::new();
    while !stop.is_cancelled() {
        let free = AT_A_TIME.saturating_sub(u32::try_from(tries.len()).unwrap_or(AT_A_TIME));
        match store.take_due_webhooks(free).await {
            Ok(due) => {
                for due in due {
                    let (store, sender) = (store.clone(), sender.clone());
                    tries.spawn(async move { told(&store, &sender, &due).await });
                }
            }
            Err(error) => tracing::warn!(%error, "webhooks cannot be read"),
        }
        tokio::select! {
            () = tokio::time::sleep(LOOK_INTERVAL) => {}
            () = stop.cancelled() => {}
        }
        while let Some(ended) = tries.try_join_next() {
            if let Err(error) = ended {
                tracing::error!(%error, "a webhook has panicked");
            }
        }
    }
    while tries.join_next().await.is_some() {}
}

async fn told(store: &Store, sender: &Sender, due: &Due) {
    let noted = match sender.send(due).await {
        Ok(()) => {
            count("delivered");
            store.webhook_delivered(due.id).await
        }
        Err(error) => failed(store, due, &error).await,
    };
    if let Err(error) = noted {
        // its lease runs out, and it is told once more
        tracing::warn!(id = %due.id, %error, "what became of a webhook could not be noted");
    }
}

async fn failed(store: &Store, due: &Due, error: &SendError) -> Result<(), StoreError> {
    let given_up = Duration::from_millis(due.tried_for_ms.try_into().unwrap_or(0)) >= TRIED_FOR;
    count(if given_up { "given_up" } else { "failed" });
    tracing::info!(id = %due.id, attempts = due.attempts, given_up, %error, "a webhook was not received");
    let pause = (!given_up).then(|| pause(due.attempts));
    store.webhook_failed(due, &error.to_string(), pause).await
}

/// How long to wait after so many tries: twice as long each time, with up to a half taken off at random, so that what has
/// failed together does not come again together.
fn pause(attempts: u32) -> Duration {
    let doubled = FIRST_PAUSE.saturating_mul(2_u32.saturating_pow(attempts.saturating_sub(1).min(20)));
    doubled.min(LONGEST_PAUSE).mul_f64(rand::rng().random_range(0.5..=1.0)).max(FIRST_PAUSE)
}

fn count(outcome: &'static str) {
    metrics::counter!("gable_webhooks_total", "outcome" => outcome).increment(1);
}
