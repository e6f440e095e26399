//! The id of the request that is being answered, known to everything that happens for its sake.

use std::future::Future;

tokio::task_local! {
    static REQUEST_ID: String;
}

/// The header that carries it.
pub const HEADER: &str = "x-request-id";

const LONGEST: usize = 64;

/// The id of the request that is being answered; `None` outside of one.
#[must_use]
pub fn current() -> Option<String> {
    REQUEST_ID.try_with(Clone::clone).ok()
}

/// Runs `work` for the request `id`.
pub async fn scope<F: Future>(id: String, work: F) -> F::Output {
    REQUEST_ID.scope(id, work).await
}

/// Takes over the id that a client or a proxy has given, if it is one that may stand in a log; else makes one.
#[must_use]
pub fn accept_or_make(given: Option<&str>) -> String {
    let fit = |id: &&str| {
        (1..=LONGEST).contains(&id.len()) && id.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_')
    };
    given.filter(fit).map_or_else(|| uuid::Uuid::now_v7().to_string(), str::to_owned)
}
