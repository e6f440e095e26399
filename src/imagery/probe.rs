//! What the header of a picture tells, read without decoding it.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use chrono::NaiveDate;

use super::exif::{self, Clues, ExifHeading, ExifPosition};
use super::{ImageryError, Limits, jpeg, png, tiff};

/// A format that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Baseline or progressive JPEG.
    Jpeg,
    /// PNG.
    Png,
    /// TIFF or BigTIFF.
    Tiff,
}

impl Format {
    /// Its short name in answers and messages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Jpeg => "JPEG",
            Self::Png => "PNG",
            Self::Tiff => "TIFF",
        }
    }

    /// Its media type (RFC 6838).
    #[must_use]
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Jpeg => "image/jpeg",
            Self::Png => "image/png",
            Self::Tiff => "image/tiff",
        }
    }
}

/// What the header of a picture tells.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// The format, by the first bytes.
    pub format: Format,
    /// Columns as stored.
    pub width_px: u32,
    /// Rows as stored.
    pub height_px: u32,
    /// Bits of a stored sample.
    pub bits: u8,
    /// Where the camera says that it was.
    pub position: Option<ExifPosition>,
    /// Where the camera, or the drone, says that the top of the picture points.
    pub heading: Option<ExifHeading>,
    /// Side of a pixel on the film, of a TIFF whose resolution is one that film is scanned with.
    pub pixel_size_um: Option<f64>,
    /// Make and model of the camera.
    pub camera_model: Option<String>,
    /// When it was taken, in local time. A TIFF may have been scanned, or worked upon, long after: its times are not read.
    pub taken: Option<NaiveDate>,
}

/// Reads the header of the picture at `path`. That does not prove that the picture is complete: only
/// [`ImageFile::open`](super::ImageFile::open) does.
///
/// # Errors
/// [`ImageryError`] if the file cannot be read, is of another format, its header is damaged, or it exceeds `limits`.
/// What is known besides and is missing, damaged or impossible is `None`.
pub fn probe(path: &Path, limits: &Limits) -> Result<Probe, ImageryError> {
    let mut file = open(path)?;
    let format = format(&mut file)?;
    let file_bytes = file.get_ref().metadata()?.len();
    let (size_px, bits, clues) = match format {
        Format::Jpeg => {
            let header = jpeg::read_header(&mut file)?;
            limits.check_whole(header.size_px(), file_bytes)?;
            let clues = exif::clues(header.exif, header.xmp.as_deref());
            ([header.width.into(), header.height.into()], header.bits, clues)
        }
        Format::Png => {
            let reader = png::read_header(file)?;
            let info = reader.info();
            limits.check_whole([info.width, info.height], file_bytes)?;
            let clues = exif::clues(info.exif_metadata.as_ref().map(|exif| exif.to_vec()), None);
            ([info.width, info.height], info.bit_depth as u8, clues)
        }
        Format::Tiff => tiff::read_header(file, limits)?,
    };
    let [width_px, height_px] = size_px;
    let Clues { camera_model, position, heading, pixel_size_um, taken } = clues;
    Ok(Probe { format, width_px, height_px, bits, position, heading, pixel_size_um, camera_model, taken })
}

/// Opens a file for reading from its beginning.
pub(super) fn open(path: &Path) -> Result<BufReader<File>, ImageryError> {
    Ok(BufReader::new(File::open(path)?))
}

/// The format by the first bytes; leaves the file at its beginning.
pub(super) fn format(file: &mut BufReader<File>) -> Result<Format, ImageryError> {
    let mut first = Vec::new();
    file.take(8).read_to_end(&mut first)?;
    file.rewind()?;
    match first.as_slice() {
        [0xFF, 0xD8, 0xFF, ..] => Ok(Format::Jpeg),
        b"\x89PNG\r\n\x1A\n" => Ok(Format::Png),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Ok(Format::Tiff),
        [] => Err(ImageryError::UnknownFormat { first_bytes: "no bytes at all: it is empty".into() }),
        other => {
            let hexadecimal: Vec<String> = other.iter().map(|byte| format!("{byte:02X}")).collect();
            Err(ImageryError::UnknownFormat { first_bytes: hexadecimal.join(" ") })
        }
    }
}
