//! One try to tell one event.
//!
//! The name of the receiver is looked up once, and connected to is what that has given, if all of it is public: a name
//! that leads elsewhere a moment later leads nowhere. Redirections are not followed and proxies not asked.

use std::error::Error;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use futures_util::future::BoxFuture;
use reqwest::dns::{Addrs, Name, Resolve, Resolving};
use reqwest::{Client, StatusCode, redirect};
use serde_json::json;

use super::signature::Secret;
use super::target::Policy;
use crate::store::now;
use crate::store::webhooks::Due;

/// From the look-up of the name to the end of the answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// What is read of an answer, at the most. Nothing in it counts.
const ANSWER_MAX_BYTES: usize = 64 << 10;

/// What a name stands for.
pub type Lookup = Arc<dyn Fn(String) -> BoxFuture<'static, std::io::Result<Vec<IpAddr>>> + Send + Sync>;

/// Tells events.
#[derive(Debug)]
pub struct Sender {
    client: Client,
    policy: Policy,
    secret: Secret,
}

/// Why an event was not received.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SendError {
    /// The address may not be told.
    #[error("{0}")]
    Refused(String),
    /// The receiver does not take it.
    #[error("the receiver has answered {0}")]
    Status(StatusCode),
    /// It was not reached in time, or not as it should be.
    #[error("{0}")]
    Connection(String),
}

impl Sender {
    /// One that signs with `secret` and looks names up by `lookup`.
    ///
    /// # Errors
    /// [`SendError::Connection`] if there are no certificates of authorities on this machine.
    pub fn new(policy: Policy, secret: Secret, lookup: Lookup) -> Result<Self, SendError> {
        // someone else may have done so
        let _ = rustls::crypto::ring::default_provider().install_default();
        let client = Client::builder()
            .dns_resolver(Vetted { policy: policy.clone(), lookup })
            .redirect(redirect::Policy::none())
            .no_proxy()
            .pool_max_idle_per_host(0)
            .timeout(PATIENCE)
            .user_agent(concat!("gable/", env!("CARGO_PKG_VERSION")))
            .build()
            .map_err(|error| SendError::Connection(told(&error)))?;
        Ok(Self { client, policy, secret })
    }

    /// Tells an event: when this returns, the receiver has said that it has it.
    ///
    /// # Errors
    /// [`SendError`]; then it may have it or not.
    pub async fn send(&self, due: &Due) -> Result<(), SendError> {
        let url = self.policy.check(&due.url).map_err(SendError::Refused)?;
        let (id, body, timestamp_s) = (due.id.to_string(), body(due), now().timestamp());
        let request = self
            .client
            .post(url)
            .header("content-type", "application/json")
            .header("webhook-timestamp", timestamp_s)
            .header("webhook-signature", self.secret.sign(&id, timestamp_s, body.as_bytes()))
            .header("webhook-id", id)
            .body(body);
        let mut answer = request.send().await.map_err(|error| SendError::Connection(told(&error)))?;
        let status = answer.status();
        // a receiver that is cut off while it answers may take that for a failure of its own
        let mut read = 0;
        while let Ok(Some(chunk)) = answer.chunk().await {
            read += chunk.len();
            if read > ANSWER_MAX_BYTES {
                break;
            }
        }
        if status.is_success() { Ok(()) } else { Err(SendError::Status(status)) }
    }
}

/// The same in every try.
fn body(due: &Due) -> String {
    let mut data = json!({"id": due.orientation_id, "status": due.status, "verdict": due.verdict});
    if let Some(block) = due.block {
        data["block"] = json!(block);
    }
    json!({"type": "orientation.finished", "timestamp": due.created_at, "data": data}).to_string()
}

/// An error with its causes, without the address: the client has given it.
fn told(error: &(dyn Error + 'static)) -> String {
    let mut text = String::new();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = if text.is_empty() { error.to_string() } else { format!("{text}: {error}") };
        cause = error.source();
    }
    if text.is_empty() { String::from("the receiver was not reached") } else { text }
}

/// The system's own way.
#[must_use]
pub fn by_the_system() -> Lookup {
    Arc::new(|name| {
        Box::pin(async move { Ok(tokio::net::lookup_host((name, 0)).await?.map(|address| address.ip()).collect()) })
    })
}

/// Looks names up, and gives nothing if any of what they stand for may not be connected to.
struct Vetted {
    policy: Policy,
    lookup: Lookup,
}

impl Resolve for Vetted {
    fn resolve(&self, name: Name) -> Resolving {
        let (policy, found) = (self.policy.clone(), (self.lookup)(name.as_str().to_owned()));
        Box::pin(async move {
            let found = found.await?;
            if let Some(address) = found.iter().find(|address| !policy.allows(**address)) {
                return Err(format!("{} stands for {address}, which is not public", name.as_str()).into());
            }
            Ok(Box::new(found.into_iter().map(|address| SocketAddr::new(address, 0))) as Addrs)
        })
    }
}
