//! What the headers of tus say.

use axum::http::{HeaderMap, HeaderName};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use uuid::Uuid;

use super::METADATA;
use crate::http::blocks;
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::store::images::from_hexadecimal;
use crate::store::uploads::Resumable;

const LONGEST_METADATA: usize = 4096;

/// What the client says of the file.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Metadata {
    /// The header as it was given.
    pub(super) given: String,
    pub(super) filename: Option<String>,
    pub(super) filetype: Option<String>,
    /// In hexadecimal digits.
    pub(super) sha256: Option<String>,
    pub(super) block: Option<Uuid>,
}

impl Metadata {
    /// Reads `Upload-Metadata`. Keys that mean nothing here are left unread.
    pub(super) fn of(headers: &HeaderMap) -> Result<Self, Problem> {
        let Some(given) = headers.get(&METADATA) else { return Ok(Self::default()) };
        let given = given.to_str().ok().filter(|given| given.len() <= LONGEST_METADATA);
        let given = given.ok_or_else(|| {
            malformed("Upload-Metadata", format!("it must have at most {LONGEST_METADATA} ASCII characters"))
        })?;
        let mut metadata = Self { given: given.to_owned(), ..Self::default() };
        for pair in given.split(',').map(str::trim).filter(|pair| !pair.is_empty()) {
            let (key, value) = pair.split_once(' ').unwrap_or((pair, ""));
            let text = STANDARD.decode(value.trim()).ok().and_then(|bytes| String::from_utf8(bytes).ok());
            let text = text.ok_or_else(|| malformed("Upload-Metadata", format!("{key:?} is not base64 of a text")))?;
            match key {
                "filename" => metadata.filename = Some(text),
                "filetype" => metadata.filetype = Some(text),
                "sha256" => metadata.sha256 = Some(digits(&text)?),
                "block" => metadata.block = Some(id(&text)?),
                _ => {}
            }
        }
        Ok(metadata)
    }

    /// Checks that the block is there, and lists the file.
    pub(super) async fn check(&self, state: &AppState) -> Result<(), Problem> {
        let Some(block) = self.block else { return Ok(()) };
        let Some(filename) = &self.filename else {
            return Err(Problem::invalid_field("Upload-Metadata", "with a block, filename must be a name of its list"));
        };
        blocks::found(state, block).await.map_err(|_| unknown_block())?;
        match state.store.block_image(block, filename).await? {
            Some(_) => Ok(()),
            None => {
                Err(Problem::invalid_field("Upload-Metadata", "the list of the block has no image of this filename"))
            }
        }
    }

    /// As it was kept with an upload.
    pub(super) fn stored(upload: &Resumable) -> Result<Self, Problem> {
        serde_json::from_str(&upload.metadata).map_err(|error| Problem::internal(&error))
    }
}

fn unknown_block() -> Problem {
    Problem::invalid_field("Upload-Metadata", "there is no block with this id")
}

fn id(text: &str) -> Result<Uuid, Problem> {
    Uuid::try_parse(text).map_err(|_| unknown_block())
}

fn digits(text: &str) -> Result<String, Problem> {
    match from_hexadecimal(text) {
        Some(bytes) if bytes.len() == 32 => Ok(text.to_ascii_lowercase()),
        _ => Err(Problem::invalid_field("Upload-Metadata", "sha256 must have 64 hexadecimal digits")),
    }
}

fn malformed(name: &str, detail: impl Into<String>) -> Problem {
    let detail = detail.into();
    Problem::bad_request(format!("{name}: {detail}")).with_error(name, detail)
}

/// A header that must be a number of bytes.
pub(super) fn whole_number(headers: &HeaderMap, name: &HeaderName) -> Result<i64, Problem> {
    let value = headers.get(name).and_then(|value| value.to_str().ok());
    let digits = value.filter(|text| text.bytes().all(|byte| byte.is_ascii_digit()));
    let number = digits.and_then(|text| text.parse().ok());
    number.ok_or_else(|| malformed(name.as_str(), "it must be given, as a whole number of bytes"))
}

/// The SHA-256 of `Upload-Checksum`.
pub(super) fn checksum(headers: &HeaderMap) -> Result<Option<[u8; 32]>, Problem> {
    let Some(value) = headers.get("upload-checksum") else { return Ok(None) };
    let sha256 = value.to_str().ok().and_then(|text| text.split_once(' ')).filter(|(name, _)| *name == "sha256");
    let sha256 = sha256.and_then(|(_, base64)| STANDARD.decode(base64.trim()).ok()?.try_into().ok());
    let detail = "it must be sha256, a blank, and the base64 of 32 bytes";
    sha256.map(Some).ok_or_else(|| malformed("Upload-Checksum", detail))
}
