//! A piece that comes in, and the end of an upload.

use axum::body::Body;
use axum::http::StatusCode;
use futures_util::StreamExt as _;
use sha2::{Digest as _, Sha256};

use super::declared::Metadata;
use super::{blocks, expiry, found};
use crate::http::extract::body_problem;
use crate::http::images::{format_of, keep, name};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::images::hexadecimal;
use crate::store::uploads::{Resumable, UploadError, Writer};

/// So much may be lost by a cut in the power, not more.
const ACKNOWLEDGED_BYTES: i64 = 8 << 20;

/// Appends a body, and brings the upload to its end if it is whole then. It is a task of its own: what has come is kept
/// even if the client goes away.
pub(super) async fn receive(
    state: &AppState,
    mut writer: Writer,
    body: Body,
    checksum: Option<[u8; 32]>,
) -> Result<Resumable, Problem> {
    let state = state.clone();
    let task = tokio::spawn(async move {
        append(&state, &mut writer, body, checksum).await?;
        if writer.upload.is_whole() { finish(&state, writer).await } else { Ok(writer.upload) }
    });
    task.await.map_err(|error| Problem::internal(&error))?
}

async fn append(state: &AppState, writer: &mut Writer, body: Body, checksum: Option<[u8; 32]>) -> Result<(), Problem> {
    let mut chunks = body.into_data_stream();
    let mut hash = Sha256::new();
    while let Some(chunk) = chunks.next().await {
        let chunk = match chunk {
            Ok(chunk) => chunk,
            Err(error) => {
                // a piece whose checksum cannot be verified is none
                if checksum.is_none() {
                    writer.acknowledge(expiry(state)).await?;
                }
                return Err(body_problem(&error, StatusCode::BAD_REQUEST));
            }
        };
        if writer.written_bytes().unsigned_abs() + chunk.len() as u64 > writer.upload.length_bytes.unsigned_abs() {
            return Err(Problem::too_large("The piece is longer than what Upload-Length leaves."));
        }
        writer.write(&chunk).await?;
        match checksum {
            Some(_) => hash.update(&chunk),
            None if writer.written_bytes() - writer.upload.received_bytes >= ACKNOWLEDGED_BYTES => {
                writer.acknowledge(expiry(state)).await?;
            }
            None => {}
        }
    }
    let sha256: [u8; 32] = hash.finalize().into();
    if checksum.is_some_and(|checksum| checksum != sha256) {
        let detail = format!("The SHA-256 of the piece is {}; it is dropped.", hexadecimal(&sha256));
        return Err(Problem::checksum_mismatch(detail));
    }
    Ok(writer.acknowledge(expiry(state)).await?)
}

/// Brings an upload to its end of which all bytes are there.
pub(super) async fn settle(state: &AppState, upload: Resumable) -> Result<Resumable, Problem> {
    if upload.done {
        return Ok(upload);
    }
    if upload.image_id.is_some() {
        return attach(state, upload).await;
    }
    match state.store.write_upload(upload.id).await {
        Ok(writer) => finish(state, writer).await,
        // another request has just brought it to its end, or does so now
        Err(UploadError::Gone) => match found(state, upload.id).await? {
            upload if upload.image_id.is_some() => attach(state, upload).await,
            _ => Err(UploadError::Gone.into()),
        },
        Err(error) => Err(error.into()),
    }
}

/// Makes an image of a whole upload. What is none is dropped: it would not become one by trying again.
async fn finish(state: &AppState, writer: Writer) -> Result<Resumable, Problem> {
    let mut upload = writer.upload.clone();
    let metadata = Metadata::stored(&upload)?;
    let received = writer.whole().await?;
    let sha256 = hexadecimal(&received.sha256);
    let kept = if metadata.sha256.is_some_and(|declared| declared != sha256) {
        Err(Problem::checksum_mismatch(format!("The SHA-256 of the file is {sha256}; it is dropped.")))
    } else {
        let declared = metadata.filetype.and_then(|kind| format_of(&kind).ok());
        let name = metadata.filename.as_deref().and_then(|filename| name::checked(filename).ok());
        keep(state, upload.id, received, name.as_deref(), declared).await
    };
    match kept {
        Ok((image, _)) => {
            upload.image_id = Some(image.id);
            state.store.note_upload(upload.id, image.id, false).await?;
            attach(state, upload).await
        }
        Err(problem) => {
            state.store.remove_upload(upload.id).await?;
            Err(problem)
        }
    }
}

/// Attaches the image of an upload to its block, if it is for one. That can be tried again, where the queue is full.
async fn attach(state: &AppState, mut upload: Resumable) -> Result<Resumable, Problem> {
    let Some(image_id) = upload.image_id else { return Ok(upload) };
    let metadata = Metadata::stored(&upload)?;
    if let (Some(block), Some(filename)) = (metadata.block, &metadata.filename) {
        let block = blocks::found(state, block).await?;
        let image = state.store.image(image_id).await?.ok_or_else(|| Problem::gone("The image was removed."))?;
        blocks::attach(state, &block, filename, &image).await?;
    }
    state.store.note_upload(upload.id, image_id, true).await?;
    upload.done = true;
    Ok(upload)
}
