//! What can be wrong with a picture file.

use std::io;

use super::Format;
use crate::features::PictureError;

/// A picture that cannot be used, and what would be right.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageryError {
    /// The file system refused.
    #[error("the picture cannot be read: {source}")]
    Read {
        /// The system's own words.
        source: io::Error,
    },
    /// The first bytes belong to none of the formats that are read.
    #[error("this is not a JPEG, PNG or TIFF file (it begins with {first_bytes}); convert it to one of these")]
    UnknownFormat {
        /// The first bytes of the file, in hexadecimal, or words saying that there are none.
        first_bytes: String,
    },
    /// A variety of the format that is not read.
    #[error("this {} is of a kind that is not read: {detail}", .format.name())]
    Unsupported {
        /// The format.
        format: Format,
        /// What is not read, and what would be.
        detail: String,
    },
    /// The file contradicts its format, or ends early.
    #[error("the {} is damaged: {detail}", .format.name())]
    Damaged {
        /// The format.
        format: Format,
        /// What is wrong.
        detail: String,
    },
    /// More than this service is set to read.
    #[error("the picture has {found} {what}, but at most {limit} are read here (set by `{setting}`)")]
    OverLimit {
        /// The unit that `found` and `limit` count.
        what: &'static str,
        /// What the picture has.
        found: u64,
        /// What it may have.
        limit: u64,
        /// The name of the limit in the configuration.
        setting: &'static str,
    },
}

impl From<io::Error> for ImageryError {
    fn from(source: io::Error) -> Self {
        Self::Read { source }
    }
}

impl From<ImageryError> for PictureError {
    fn from(error: ImageryError) -> Self {
        Self { detail: error.to_string() }
    }
}
