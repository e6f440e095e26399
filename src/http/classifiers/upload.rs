//! A labelled set that is uploaded to train from: written to disk as it comes, and read once before it is accepted.

use axum::body::Body;
use axum::http::StatusCode;
use futures_util::StreamExt as _;
use tokio::io::AsyncWriteExt as _;
use uuid::Uuid;

use crate::http::extract::body_problem;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::jobs::training::{parse_set, upload_path};
use crate::store::StoreError;

/// Takes the set in; nothing is left of one that is refused.
pub(super) async fn receive(state: &AppState, id: Uuid, body: Body) -> Result<(), Problem> {
    let received = received(state, id, body).await;
    if received.is_err() {
        forget(state, id).await;
    }
    received
}

/// Removes the set, if it is there.
pub(super) async fn forget(state: &AppState, id: Uuid) {
    let _ = tokio::fs::remove_file(upload_path(&state.store, id)).await;
}

async fn received(state: &AppState, id: Uuid, body: Body) -> Result<(), Problem> {
    // each is read into memory in the end
    let _permit = state.imports.acquire().await.map_err(|error| Problem::internal(&error))?;
    let (path, max_bytes) = (upload_path(&state.store, id), state.configuration.training_max_bytes);
    let fails = |source| StoreError::File { action: "cannot write", path: path.clone(), source };
    let mut file = tokio::fs::File::create(&path).await.map_err(fails)?;
    let (mut stream, mut bytes) = (body.into_data_stream(), 0_usize);
    while let Some(chunk) = stream.next().await {
        let chunk = chunk.map_err(|error| body_problem(&error, StatusCode::BAD_REQUEST))?;
        bytes += chunk.len();
        if bytes > max_bytes {
            let detail = format!("The set is larger than the {max_bytes} bytes that this service accepts.");
            return Err(Problem::too_large(detail));
        }
        file.write_all(&chunk).await.map_err(fails)?;
    }
    file.sync_all().await.map_err(fails)?;
    let read = path.clone();
    let checked = tokio::task::spawn_blocking(move || std::fs::read(read).map(|content| parse_set(&content))).await;
    let images = checked.map_err(|error| Problem::internal(&error))?.map_err(fails)?;
    match images {
        Err(detail) => Err(Problem::invalid_field("", format!("This is not a labelled set: {detail}"))),
        Ok(images) if images.is_empty() => Err(Problem::invalid_field("", "The labelled set is empty.")),
        Ok(_) => Ok(()),
    }
}
