//! `Idempotency-Key`: the same `POST` sent again gets the first answer again, and does nothing a second time.
//!
//! The first request runs in a task of its own, so that it comes to its end even if its client goes away, and its answer
//! is kept. Its body is hashed as the handler reads it, and never held. If the service dies in between, the next try
//! goes on under the id that the first one had ([`NewId`]): a handler that inserts under this id, or finds what is there,
//! makes nothing twice.

use std::sync::{Arc, Mutex, PoisonError};

use axum::body::{Body, Bytes, to_bytes};
use axum::extract::{FromRequestParts, MatchedPath, Request, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use futures_util::StreamExt as _;
use sha2::{Digest as _, Sha256};
use tracing::Instrument as _;
use uuid::Uuid;

use super::access::Caller;
use super::extract::body_problem;
use super::problem::Problem;
use super::request_id;
use super::state::AppState;
use crate::store::Store;
use crate::store::idempotency::{Answer, Claim};

const KEY: &str = "idempotency-key";
/// Says that an answer is the first one again.
const REPLAYED: HeaderName = HeaderName::from_static("idempotency-replayed");
const KEY_MAX_CHARACTERS: usize = 255;
/// Routes whose answers hold what is nowhere kept.
const SHOWN_ONCE: [&str; 2] = ["/api/v1/keys", "/api/v1/session"];

/// The id for what this request makes: a new one or, in the second try after a crash, that of the first.
#[derive(Debug, Clone, Copy)]
pub struct NewId(pub Uuid);

impl<S: Send + Sync> FromRequestParts<S> for NewId {
    type Rejection = std::convert::Infallible;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<Self, Self::Rejection> {
        Ok(parts.extensions.get().copied().unwrap_or_else(|| Self(Uuid::now_v7())))
    }
}

/// Answers a repeated request as it was answered first; lets all others through.
///
/// # Errors
/// 400 for a malformed key, 409 while the first request is under way, 422 for another request with the same key.
pub async fn replay(State(state): State<AppState>, request: Request, next: Next) -> Result<Response, Problem> {
    let Some(key) = request.headers().get(KEY).filter(|_| request.method() == Method::POST) else {
        return Ok(next.run(request).await);
    };
    let key = checked(key)?;
    let route = request.extensions().get::<MatchedPath>().map_or("", MatchedPath::as_str);
    if SHOWN_ONCE.contains(&route) {
        let detail = "What this answers is shown once and not kept: it takes no Idempotency-Key.";
        return Err(Problem::bad_request(detail).with_error("Idempotency-Key", detail));
    }
    let Some(Caller { credential, .. }) = request.extensions().get().cloned() else {
        return Ok(next.run(request).await);
    };
    match state.store.claim_idempotency(&credential, &key, state.configuration.idempotency_kept()).await? {
        Claim::Granted { resource_id } => {
            let claimed = Claimed { store: state.store, credential, key };
            claimed.answer(NewId(resource_id), request, next).await
        }
        Claim::UnderWay => {
            let detail = "A request with this Idempotency-Key is being answered; repeat it later.";
            Err(Problem::conflict(detail).with_retry_after(1))
        }
        Claim::Answered(answer) => again(answer, request, state.configuration.upload_max_bytes).await,
    }
}

fn checked(key: &HeaderValue) -> Result<String, Problem> {
    let text = key.to_str().ok().filter(|text| (1..=KEY_MAX_CHARACTERS).contains(&text.len()));
    text.map(str::to_owned).ok_or_else(|| {
        let detail = format!("Idempotency-Key must have from 1 to {KEY_MAX_CHARACTERS} visible ASCII characters");
        Problem::bad_request(detail.clone()).with_error("Idempotency-Key", detail)
    })
}

struct Claimed {
    store: Store,
    credential: String,
    key: String,
}

impl Claimed {
    async fn answer(self, id: NewId, mut request: Request, next: Next) -> Result<Response, Problem> {
        request.extensions_mut().insert(id);
        let (request, fingerprint) = fingerprinted(request);
        let work = async move {
            let response = next.run(request).await;
            self.keep(response, &fingerprint).await
        };
        let id = request_id::current().unwrap_or_default();
        let task = tokio::spawn(request_id::scope(id, work).in_current_span());
        task.await.map_err(|error| Problem::internal(&error))?
    }

    /// Keeps the answer, unless the request may well succeed when it is sent again as it is.
    async fn keep(self, response: Response, fingerprint: &Fingerprint) -> Result<Response, Problem> {
        let status = response.status();
        let transient = matches!(status, StatusCode::REQUEST_TIMEOUT | StatusCode::TOO_MANY_REQUESTS);
        let whole = status.is_success() || fingerprint.is_whole();
        if status.is_server_error() || transient || !whole {
            self.store.release_idempotency(&self.credential, &self.key).await?;
            return Ok(response);
        }
        let (parts, body) = response.into_parts();
        let body = to_bytes(body, usize::MAX).await.map_err(|error| Problem::internal(&error))?;
        let answer = Answer {
            fingerprint: fingerprint.value(),
            status: status.as_u16(),
            content_type: text(&parts.headers, header::CONTENT_TYPE),
            location: text(&parts.headers, header::LOCATION),
            body: body.to_vec(),
        };
        self.store.settle_idempotency(&self.credential, &self.key, &answer).await?;
        Ok(Response::from_parts(parts, Body::from(body)))
    }
}

async fn again(answer: Answer, request: Request, max_bytes: u64) -> Result<Response, Problem> {
    let (request, fingerprint) = fingerprinted(request);
    let mut chunks = request.into_body().into_data_stream();
    let mut size_bytes = 0;
    while let Some(chunk) = chunks.next().await {
        size_bytes += chunk.map_err(|error| body_problem(&error, StatusCode::BAD_REQUEST))?.len() as u64;
        if size_bytes > max_bytes {
            return Err(Problem::too_large("The body is larger than this service accepts."));
        }
    }
    if fingerprint.value() != answer.fingerprint {
        let detail = "This Idempotency-Key was used for another request; choose a new one for each request.";
        return Err(Problem::invalid(detail).with_error("Idempotency-Key", "belongs to another request"));
    }
    let status = StatusCode::from_u16(answer.status).map_err(|error| Problem::internal(&error))?;
    let mut response = (status, answer.body).into_response();
    let headers = response.headers_mut();
    headers.remove(header::CONTENT_TYPE);
    for (name, value) in [(header::CONTENT_TYPE, answer.content_type), (header::LOCATION, answer.location)] {
        if let Some(value) = value.and_then(|value| HeaderValue::try_from(value).ok()) {
            headers.insert(name, value);
        }
    }
    headers.insert(REPLAYED, HeaderValue::from_static("true"));
    Ok(response)
}

fn text(headers: &HeaderMap, name: HeaderName) -> Option<String> {
    headers.get(name)?.to_str().ok().map(str::to_owned)
}

/// SHA-256 over what makes a request the same: method, address, type, body.
#[derive(Clone)]
struct Fingerprint(Arc<Mutex<(Sha256, bool)>>);

impl Fingerprint {
    fn update(&self, bytes: &[u8]) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).0.update(bytes);
    }

    fn end(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).1 = true;
    }

    /// Whether the body was read to its end.
    fn is_whole(&self) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).1
    }

    fn value(&self) -> [u8; 32] {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).0.clone().finalize().into()
    }
}

fn fingerprinted(request: Request) -> (Request, Fingerprint) {
    let (parts, body) = request.into_parts();
    let kind = parts.headers.get(header::CONTENT_TYPE).map(HeaderValue::as_bytes).unwrap_or_default();
    let head = Sha256::new()
        .chain_update(parts.method.as_str())
        .chain_update([0])
        .chain_update(parts.uri.to_string())
        .chain_update([0])
        .chain_update(kind)
        .chain_update([0]);
    let fingerprint = Fingerprint(Arc::new(Mutex::new((head, false))));
    let (reading, ending) = (fingerprint.clone(), fingerprint.clone());
    let chunks = body.into_data_stream().inspect(move |chunk| {
        if let Ok(bytes) = chunk {
            reading.update(bytes);
        }
    });
    let end = futures_util::stream::poll_fn(move |_| {
        ending.end();
        std::task::Poll::Ready(None::<Result<Bytes, axum::Error>>)
    });
    (Request::from_parts(parts, Body::from_stream(chunks.chain(end))), fingerprint)
}
