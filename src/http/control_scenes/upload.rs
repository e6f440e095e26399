//! The form of a scene.

use axum::body::Bytes;
use axum::extract::multipart::{Field, MultipartError};
use axum::extract::{FromRequest as _, Multipart, Request};

use super::request::{CheckedScene, ControlSceneRequest};
use crate::http::extract::{body_problem, media_type, parse_json, refuse_encoded};
use crate::http::images::{content_length, refuse_if_no_room};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::images::INCOMING;

/// What is said of a scene never needs as much.
const DESCRIPTION_MAX_BYTES: usize = 64 << 10;

/// A scene that may be stored.
pub(super) struct Received {
    pub(super) request: ControlSceneRequest,
    pub(super) checked: CheckedScene,
    pub(super) file: Bytes,
}

/// Reads the form and checks all of it.
pub(super) async fn receive(state: &AppState, request: Request) -> Result<Received, Problem> {
    let kind = media_type(request.headers()).unwrap_or_default();
    if kind != "multipart/form-data" {
        let detail = format!("Content-Type is {kind:?}; it must be multipart/form-data with the parts file and scene");
        return Err(Problem::unsupported_type(detail));
    }
    refuse_encoded(request.headers())?;
    refuse_if_no_room(state, content_length(request.headers()).unwrap_or(0))?;
    let (file, scene) = parts(request, state.configuration.scene_max_bytes).await?;
    let request: ControlSceneRequest = parse_json(&scene)?;
    let (incoming, limits) = (state.store.folder().join(INCOMING), state.configuration.scene_limits());
    let check = move || request.check(&file, &incoming, &limits).map(|checked| Received { request, checked, file });
    tokio::task::spawn_blocking(check).await.map_err(|error| Problem::internal(&error))?
}

async fn parts(request: Request, file_max_bytes: usize) -> Result<(Bytes, Bytes), Problem> {
    let mut form = Multipart::from_request(request, &())
        .await
        .map_err(|error| Problem::bad_request(format!("The form is malformed: {}", error.body_text())))?;
    let (mut file, mut scene) = (None, None);
    while let Some(part) = form.next_field().await.map_err(malformed)? {
        let name = part.name().unwrap_or_default().to_owned();
        let (place, max_bytes) = match name.as_str() {
            "file" => (&mut file, file_max_bytes),
            "scene" => (&mut scene, DESCRIPTION_MAX_BYTES),
            _ => {
                let detail = format!("The form has a part {name:?}; it must have two parts, `file` and `scene`.");
                return Err(Problem::invalid(detail));
            }
        };
        if place.is_some() {
            return Err(Problem::invalid(format!("The form has more than one part {name:?}.")));
        }
        *place = Some(whole(part, &name, max_bytes).await?);
    }
    let missing = |name: &str| Problem::invalid(format!("The form has no part `{name}`."));
    Ok((file.ok_or_else(|| missing("file"))?, scene.ok_or_else(|| missing("scene"))?))
}

async fn whole(mut part: Field<'_>, name: &str, max_bytes: usize) -> Result<Bytes, Problem> {
    let mut content = Vec::new();
    while let Some(chunk) = part.chunk().await.map_err(malformed)? {
        if content.len() + chunk.len() > max_bytes {
            let setting = if name == "file" { " (set by `scene_max_bytes`)" } else { "" };
            let detail = format!("The part {name:?} is larger than the {max_bytes} bytes that are accepted{setting}.");
            return Err(Problem::too_large(detail));
        }
        content.extend_from_slice(&chunk);
    }
    Ok(content.into())
}

#[expect(clippy::needless_pass_by_value, reason = "it stands where errors are mapped")]
fn malformed(error: MultipartError) -> Problem {
    body_problem(&error, error.status())
}
