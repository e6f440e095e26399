//! Accepts connections, and ends in time.
//!
//! axum's own loop has no limit on how long a client may take to send the head of its request, and one client that
//! does not finish its head can hold up the end of the service for ever.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::http::Request;
use axum::response::Response;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;
use tower::{Service, ServiceExt as _};

use super::pace::Unstalled;
use super::rate::ClientAddress;
use super::state::AppState;

/// After a failed accept (no file descriptors left, for example) trying again at once would only burn the processor.
const PAUSE_AFTER_FAILED_ACCEPT: Duration = Duration::from_millis(100);

/// Serves until `stop` is cancelled; then accepts nothing more, lets the requests under way come to their end, and
/// returns at the latest after `shutdown_timeout_s`.
pub async fn serve(listener: TcpListener, app: Router, state: &AppState, stop: CancellationToken) {
    let configuration = &state.configuration;
    let slots = Arc::new(Semaphore::new(slots_within_limits(configuration.connections_max)));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(Duration::from_secs(configuration.head_timeout_s));
    let stall_max = Duration::from_secs(configuration.answer_idle_timeout_s);
    let mut connections = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            () = stop.cancelled() => break,
            accepted = accept(&listener, &slots) => accepted,
            // finished ones must not pile up
            Some(_) = connections.join_next(), if !connections.is_empty() => continue,
        };
        match accepted {
            Ok((stream, address, slot)) => {
                let stream = Unstalled::new(stream, stall_max);
                let from = move |mut request: Request<Incoming>| {
                    request.extensions_mut().insert(address);
                    request
                };
                let app = app.clone().map_request(from);
                connections.spawn(connection(http.clone(), stream, slot, app, stop.clone()));
            }
            Err(error) => {
                tracing::warn!(%error, "a connection could not be accepted");
                tokio::time::sleep(PAUSE_AFTER_FAILED_ACCEPT).await;
            }
        }
    }
    drop(listener);
    state.readiness.block("service", "is ending");
    drain(connections, Duration::from_secs(configuration.shutdown_timeout_s)).await;
}

/// Every connection needs a file descriptor, and a part of them must be left for the database and the pictures.
fn slots_within_limits(wanted: usize) -> usize {
    let limit = getrlimit(Resource::Nofile);
    // the lower of the two limits is only a default, which a process may raise for itself
    let raised = Rlimit { current: limit.maximum, ..limit };
    let limit = if setrlimit(Resource::Nofile, raised).is_ok() { raised } else { limit };
    let possible = limit.current.map_or(usize::MAX, |files| usize::try_from(files / 5 * 4).unwrap_or(usize::MAX));
    if possible < wanted {
        tracing::warn!(wanted, possible, "the limit of open files allows fewer connections than are configured");
    }
    wanted.min(possible)
}

type Accepted = (TcpStream, ClientAddress, OwnedSemaphorePermit);

/// Waits for a free slot first: what cannot be served stays in the queue of the operating system.
async fn accept(listener: &TcpListener, slots: &Arc<Semaphore>) -> std::io::Result<Accepted> {
    let slot = slots.clone().acquire_owned().await.map_err(std::io::Error::other)?;
    let (stream, address) = listener.accept().await?;
    stream.set_nodelay(true)?;
    Ok((stream, ClientAddress(address.ip()), slot))
}

async fn connection<S>(
    http: http1::Builder,
    stream: Unstalled<TcpStream>,
    slot: OwnedSemaphorePermit,
    app: S,
    stop: CancellationToken,
) where
    S: Service<Request<Incoming>, Response = Response, Error = Infallible, Future: Send> + Clone,
{
    metrics::gauge!("gable_connections").increment(1);
    let served = http.serve_connection(TokioIo::new(stream), TowerToHyperService::new(app));
    tokio::pin!(served);
    let result = tokio::select! {
        result = served.as_mut() => result,
        () = stop.cancelled() => {
            served.as_mut().graceful_shutdown();
            served.await
        }
    };
    if let Err(error) = result {
        tracing::debug!(%error, "a connection ended early");
    }
    metrics::gauge!("gable_connections").decrement(1);
    drop(slot);
}

async fn drain(mut connections: JoinSet<()>, patience: Duration) {
    tracing::info!(connections = connections.len(), "ending: no new connections");
    let all = async { while connections.join_next().await.is_some() {} };
    if tokio::time::timeout(patience, all).await.is_err() {
        tracing::warn!(connections = connections.len(), "ending: the rest has taken too long and is cut off");
        connections.shutdown().await;
    }
}

/// A token that is cancelled by the first SIGTERM or SIGINT; the second one ends the process at once.
///
/// # Errors
/// If the signals cannot be caught.
pub fn stop_on_signals() -> std::io::Result<CancellationToken> {
    use tokio::signal::unix::{SignalKind, signal};
    let (mut terminate, mut interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
    let stop = CancellationToken::new();
    let stopping = stop.clone();
    tokio::spawn(async move {
        loop {
            tokio::select! {
                _ = terminate.recv() => {}
                _ = interrupt.recv() => {}
            }
            if stopping.is_cancelled() {
                tracing::warn!("second signal: ending at once");
                std::process::exit(1);
            }
            stopping.cancel();
        }
    });
    Ok(stop)
}
