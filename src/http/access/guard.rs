//! The one layer that lets requests through to their routes, and notes what has become of them in the audit log.
//!
//! What is guaranteed of the log: a request that is refused with 403, and a login that is refused, have a row before the
//! client hears of it. A request that has changed something has its row before the client hears of it, too, and gets it
//! even if the client goes away once its body has arrived; but the change and the row are two transactions. If the row cannot be written
//! after the change was, the change stays and is told, the log of the service says so as an error, and
//! `gable_audit_failures_total` counts it; the same if the process dies between the two, but without a trace.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};

use axum::body::{Body, Bytes, HttpBody as _};
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt as _;
use futures_util::future::BoxFuture;
use tokio::runtime::Handle;
use tracing::Instrument as _;

use super::identify::identify;
use super::{Access, Caller, NOBODY, access};
use crate::http::problem::Problem;
use crate::http::rate::{self, ClientAddress};
use crate::http::request_id;
use crate::http::state::AppState;
use crate::store::audit::NewEntry;

/// Put into an answer by a handler that knows better than the guard who it was: a login.
#[derive(Debug, Clone)]
struct Who(pub String);

/// Lets a request through to its route, or refuses it.
///
/// # Errors
/// 401 without a valid key or session, 403 where the role is too low or the route is not in the table, 429 where the
/// caller asks too often.
pub async fn guard(
    State(state): State<AppState>,
    path: MatchedPath,
    mut request: Request,
    next: Next,
) -> Result<Response, Problem> {
    let deed = Deed::of(&request, &path);
    let caller = match deed.admitted(&state, request.method(), path.as_str(), request.headers()).await {
        Ok(caller) => caller,
        Err(Refused { problem, who }) => {
            if problem.status() == StatusCode::FORBIDDEN {
                deed.note(&state, who, problem.status(), None).await;
            }
            return Err(*problem);
        }
    };
    let who = caller.as_ref().map(|caller| caller.credential.clone());
    if let Some(caller) = caller {
        request.extensions_mut().insert(caller);
    }
    if request.method().is_safe() {
        return Ok(next.run(request).await);
    }
    let (request, arrived) = watched(request);
    let work = async move {
        let answer = next.run(request).await;
        deed.note_answer(&state, who, answer).await
    };
    let id = request_id::current().unwrap_or_default();
    let work = request_id::scope(id, work).in_current_span();
    Ok(Deferred { work: Some(Box::pin(work)), arrived }.await)
}

/// The work for a request. If its client goes away before its body has arrived, it ends: it has changed nothing yet. After
/// that it goes on by itself to its end.
struct Deferred {
    work: Option<BoxFuture<'static, Response>>,
    arrived: Arc<AtomicBool>,
}

impl Future for Deferred {
    type Output = Response;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Response> {
        let Some(work) = &mut self.work else { return Poll::Pending };
        let answer = std::task::ready!(work.as_mut().poll(context));
        self.work = None;
        Poll::Ready(answer)
    }
}

impl Drop for Deferred {
    fn drop(&mut self) {
        let work = self.work.take().filter(|_| self.arrived.load(Ordering::SeqCst));
        if let (Some(work), Ok(runtime)) = (work, Handle::try_current()) {
            runtime.spawn(work);
        }
    }
}

/// A request that says when its body has arrived.
fn watched(request: Request) -> (Request, Arc<AtomicBool>) {
    let (parts, body) = request.into_parts();
    let arrived = Arc::new(AtomicBool::new(body.is_end_stream()));
    let (size, mut read) = (body.size_hint().exact(), 0);
    let (reading, ending) = (arrived.clone(), arrived.clone());
    let chunks = body.into_data_stream().inspect(move |chunk| {
        read += chunk.as_ref().map_or(0, |chunk| chunk.len() as u64);
        if size == Some(read) {
            reading.store(true, Ordering::SeqCst);
        }
    });
    let end = futures_util::stream::poll_fn(move |_| {
        ending.store(true, Ordering::SeqCst);
        Poll::Ready(None::<Result<Bytes, axum::Error>>)
    });
    (Request::from_parts(parts, Body::from_stream(chunks.chain(end))), arrived)
}

/// Why somebody was not let through, and who it was as far as that is known.
struct Refused {
    problem: Box<Problem>,
    who: Option<String>,
}

impl From<Problem> for Refused {
    fn from(problem: Problem) -> Self {
        Self { problem: Box::new(problem), who: None }
    }
}

/// What somebody wants to do.
struct Deed {
    action: String,
    object: String,
    from: Option<ClientAddress>,
}

impl Deed {
    fn of(request: &Request, path: &MatchedPath) -> Self {
        let action = format!("{} {}", request.method(), path.as_str());
        let from = request.extensions().get().copied();
        Self { action, object: request.uri().path().to_owned(), from }
    }

    /// The caller, if the route may be called by it; none of a public route.
    async fn admitted(
        &self,
        state: &AppState,
        method: &Method,
        path: &str,
        headers: &HeaderMap,
    ) -> Result<Option<Caller>, Refused> {
        let address = self.from.map(ClientAddress::caller);
        let too_often = |wait| Refused::from(rate::refused("You ask too often.", wait));
        let take = |caller: Option<&str>| caller.map_or(Ok(()), |caller| state.rates.take(caller)).map_err(too_often);
        let role = match access(method, path) {
            Some(Access::Public) if path.starts_with("/health/") => return Ok(None),
            Some(Access::Public) => return take(address.as_deref()).map(|()| None),
            Some(Access::AtLeast(role)) => role,
            None => {
                tracing::error!(%method, path, "route without access rule");
                return Err(Problem::forbidden("Nobody may call this.").into());
            }
        };
        let caller = match identify(state, method, headers).await {
            Ok(caller) => caller,
            Err(problem) => {
                take(address.as_deref())?;
                return Err(problem.into());
            }
        };
        // who has made no key yet sits at this machine, and slows down nobody else
        take(Some(caller.credential.as_str()).filter(|who| *who != super::LOOPBACK))?;
        if caller.role < role {
            let problem = Problem::forbidden(format!("Your role is {}; this needs {role}.", caller.role));
            return Err(Refused { problem: Box::new(problem), who: Some(caller.credential) });
        }
        Ok(Some(caller))
    }

    /// Notes what has changed something, and what was refused by the handler: a login.
    async fn note_answer(&self, state: &AppState, who: Option<String>, answer: Response) -> Response {
        let status = answer.status();
        let told = answer.extensions().get::<Who>().map(|Who(who)| who.clone());
        let refused = status == StatusCode::FORBIDDEN || (status == StatusCode::UNAUTHORIZED && told.is_some());
        if status.is_success() || refused {
            let made = answer.headers().get(header::LOCATION).and_then(|location| location.to_str().ok());
            let made = made.map(str::to_owned);
            let who = told.filter(|told| told != NOBODY).or(who);
            self.note(state, who, status, made).await;
        }
        answer
    }

    async fn note(&self, state: &AppState, who: Option<String>, status: StatusCode, made: Option<String>) {
        let from = self.from.filter(|_| who.is_none()).map(|ClientAddress(address)| format!("{NOBODY} at {address}"));
        let entry = NewEntry {
            who: who.or(from).unwrap_or_else(|| NOBODY.to_owned()),
            action: self.action.clone(),
            object: made.unwrap_or_else(|| self.object.clone()),
            status: status.as_u16(),
            request_id: request_id::current().unwrap_or_default(),
        };
        if let Err(error) = state.store.note(entry).await {
            metrics::counter!("gable_audit_failures_total").increment(1);
            tracing::error!(%error, action = self.action, status = status.as_u16(), "not noted in the audit log");
        }
    }
}

/// An answer that says who it was, for the audit log.
pub(in crate::http) fn by(who: String, answer: impl IntoResponse) -> Response {
    let mut answer = answer.into_response();
    answer.extensions_mut().insert(Who(who));
    answer
}
