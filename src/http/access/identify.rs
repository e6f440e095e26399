//! Who is calling: by a key, by the cookie of a session, or as a program on this machine.

use std::net::IpAddr;

use axum::http::{HeaderMap, Method, header};

use super::Caller;
use crate::http::problem::Problem;
use crate::http::session;
use crate::http::state::AppState;
use crate::store::keys::{Presented, Role};

/// The caller of a request.
///
/// # Errors
/// 401 if it shows nothing that is valid, 403 if it comes from another site or through a proxy.
pub(super) async fn identify(state: &AppState, method: &Method, headers: &HeaderMap) -> Result<Caller, Problem> {
    if headers.contains_key(header::AUTHORIZATION) {
        return by_key(state, headers).await;
    }
    let open = state.listens_on_loopback() && !state.any_key().await?;
    if let Some(cookie) = session::cookie(state, headers).filter(|_| !open) {
        let lasting = state.configuration.sessions_last();
        let session = state.store.session(&cookie, lasting).await?;
        let session = session.ok_or_else(|| Problem::unauthorized("The session has ended: log in again."))?;
        if !method.is_safe() && !comes_from_our_pages(state, headers) {
            let detail =
                "What changes something must come from a page of this service: Origin or Sec-Fetch-Site tells.";
            return Err(Problem::forbidden(detail));
        }
        if session.use_is_worth_a_note {
            state
                .note_use(format!("session {cookie}"), |store| async move { store.note_use_of_session(&cookie).await });
        }
        return Ok(Caller { credential: format!("account:{}", session.name), role: session.role });
    }
    if !open {
        return Err(Problem::unauthorized("This needs a key, in the header Authorization: Bearer <key>."));
    }
    if !comes_from_this_machine(headers) {
        let detail = "As long as no key is made, only requests to a loopback host are answered, none from the pages of \
                      other sites or through a proxy. Make a key with `gable key new`.";
        return Err(Problem::forbidden(detail));
    }
    Ok(Caller { credential: String::from(super::LOOPBACK), role: Role::Admin })
}

async fn by_key(state: &AppState, headers: &HeaderMap) -> Result<Caller, Problem> {
    let authorization = headers.get(header::AUTHORIZATION).and_then(|value| value.to_str().ok());
    let secret = authorization.and_then(|text| text.split_once(' '));
    let secret = secret.filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer")).map(|(_, secret)| secret.trim());
    let Some(secret) = secret else {
        return Err(Problem::unauthorized("Authorization must be: Bearer <key>"));
    };
    match state.store.key(secret).await? {
        Presented::Valid(key) => {
            if key.use_is_worth_a_note() {
                state.note_use(
                    format!("key {}", key.id),
                    move |store| async move { store.note_use_of_key(key.id).await },
                );
            }
            Ok(Caller { credential: key.id.to_string(), role: key.role })
        }
        Presented::Expired(_) => Err(Problem::unauthorized("This key has expired.")),
        Presented::Unknown => Err(Problem::unauthorized("This key is not valid, or was revoked.")),
    }
}

/// Whether a browser says that the request comes from a page of this service. One that says nothing is no browser of
/// today, or is made to keep silent.
pub(in crate::http) fn comes_from_our_pages(state: &AppState, headers: &HeaderMap) -> bool {
    let text = |name: header::HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or_default());
    let site = text(header::HeaderName::from_static("sec-fetch-site"));
    let scheme = if state.configuration.cookies_are_secure() { "https://" } else { "http://" };
    let origin = text(header::ORIGIN).map(|origin| {
        let host = text(header::HOST).unwrap_or_default();
        origin.strip_prefix(scheme).is_some_and(|origin| !host.is_empty() && origin.eq_ignore_ascii_case(host))
    });
    match (site, origin) {
        (Some(site), Some(ours)) => site == "same-origin" && ours,
        (Some(site), None) => site == "same-origin",
        (None, Some(ours)) => ours,
        (None, None) => false,
    }
}

/// A page of another site can make a browser call us (`Origin` tells), or give its own name our address (`Host` tells);
/// a proxy can make the whole world look local.
fn comes_from_this_machine(headers: &HeaderMap) -> bool {
    let Some(host) = headers.get(header::HOST).and_then(|host| host.to_str().ok()) else {
        return false;
    };
    let origin_is_ours = match headers.get(header::ORIGIN).map(|origin| origin.to_str()) {
        None => true,
        Some(Ok(origin)) => origin.strip_prefix("http://").is_some_and(|origin| origin.eq_ignore_ascii_case(host)),
        Some(Err(_)) => false,
    };
    let forwarded = ["forwarded", "x-forwarded-for", "x-real-ip", "via"].iter().any(|name| headers.contains_key(*name));
    is_loopback(host) && origin_is_ours && !forwarded
}

fn is_loopback(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}
