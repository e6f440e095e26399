//! The pages for staff, out of the binary: a shell of HTML, modules of JavaScript that call the API like any other client,
//! styles, and the texts in every language. Nothing is built: what lies in `assets` is what the browser gets.
//!
//! All assets lie under an address that contains their common hash, so that a browser keeps them for ever and never
//! mixes those of two versions.

use std::sync::LazyLock;

use axum::Router;
use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use rust_embed::RustEmbed;
use sha2::{Digest as _, Sha256};

/// Where pages are; the shell finds out by itself which one is wanted.
pub const PAGES: [&str; 9] = [
    "/",
    "/upload",
    "/orientations/{id}",
    "/control",
    "/diagnosis",
    "/diagnosis/{id}",
    "/dashboard",
    "/login",
    "/help",
];
/// Where the files of the pages are.
pub const ASSETS: &str = "/assets/{version}/{*path}";

/// Scripts, styles and pictures of this service alone; nothing inline; nobody may frame a page or be sent a form.
/// Pictures from `blob:` are those that a page has made itself, such as a preview of a file before its upload.
pub const POLICY: HeaderValue = HeaderValue::from_static(
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; font-src 'self'; \
     base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
);

#[derive(RustEmbed)]
#[folder = "src/web/assets"]
struct Assets;

const SHELL: &str = "shell.html";
/// In the shell, where the version belongs.
const VERSION_HERE: &str = "{version}";

/// The routes of the pages. They need no state and no caller: all that is worth keeping comes from the API.
pub fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    let pages = PAGES.iter().fold(Router::new(), |router, page| router.route(page, get(shell)));
    pages.route(ASSETS, get(asset))
}

/// A hash of all assets.
static VERSION: LazyLock<String> = LazyLock::new(|| {
    let mut names: Vec<_> = Assets::iter().collect();
    names.sort();
    let mut hash = Sha256::new();
    for name in &names {
        hash.update(name.as_bytes());
        hash.update(Assets::get(name).map(|file| file.metadata.sha256_hash()).unwrap_or_default());
    }
    hash.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect()
});

async fn shell() -> Response {
    let Some(file) = Assets::get(SHELL) else { return StatusCode::NOT_FOUND.into_response() };
    let text = String::from_utf8_lossy(&file.data).replace(VERSION_HERE, &VERSION);
    let headers = [
        (header::CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8")),
        (header::CACHE_CONTROL, HeaderValue::from_static("no-cache")),
    ];
    (headers, text).into_response()
}

/// An asset of this version. That of another one may be asked for by a page that was opened before the service was
/// renewed: it gets the present one, to be asked for again.
async fn asset(Path((version, path)): Path<(String, String)>) -> Response {
    let Some(file) = Assets::get(&path).filter(|_| path != SHELL) else {
        return StatusCode::NOT_FOUND.into_response();
    };
    let kept = if version == *VERSION { "public, max-age=31536000, immutable" } else { "no-cache" };
    let mut headers = HeaderMap::new();
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(kept));
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type(&path)));
    (headers, file.data).into_response()
}

fn media_type(path: &str) -> &'static str {
    match path.rsplit('.').next() {
        Some("js") => "text/javascript; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("svg") => "image/svg+xml",
        Some("txt") => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_asset_has_a_media_type() {
        for name in Assets::iter().filter(|name| name != SHELL) {
            assert_ne!(media_type(&name), "application/octet-stream", "{name}");
        }
    }

    #[test]
    fn the_shell_holds_no_script_and_no_style_of_its_own() {
        let shell = Assets::get(SHELL).unwrap();
        let text = String::from_utf8_lossy(&shell.data).into_owned();
        assert!(text.contains(VERSION_HERE));
        for tag in ["script", "style"] {
            for opened in text.split(&format!("<{tag}")).skip(1) {
                let (attributes, rest) = opened.split_once('>').unwrap();
                assert!(attributes.contains("src=") && rest.starts_with(&format!("</{tag}>")), "{opened}");
            }
        }
        assert!(!text.contains(" style=") && !text.contains(" on"), "nothing inline");
    }
}
