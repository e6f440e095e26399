//! The segments of a JPEG: what stands before the first scan, and where the scans end.

use std::io::{BufRead, ErrorKind, Read, Seek};

use super::{damaged, unsupported};
use crate::imagery::ImageryError;

/// What stands before the first scan.
#[derive(Debug)]
pub(in crate::imagery) struct Header {
    pub(in crate::imagery) width: u16,
    pub(in crate::imagery) height: u16,
    /// Bits of a sample.
    pub(in crate::imagery) bits: u8,
    pub(in crate::imagery) components: u8,
    pub(in crate::imagery) progressive: bool,
    /// Where the marker of the first scan begins.
    first_scan: u64,
    /// The TIFF structure inside the Exif segment.
    pub(in crate::imagery) exif: Option<Vec<u8>>,
    /// The XMP packet.
    pub(in crate::imagery) xmp: Option<Vec<u8>>,
}

/// More segments than any camera writes before the first scan.
const MAX_SEGMENTS: usize = 4096;

const EXIF_PREFIX: &[u8] = b"Exif\0\0";
const XMP_PREFIX: &[u8] = b"http://ns.adobe.com/xap/1.0/\0";

/// Reads the segments before the first scan, and skips those that are of no use.
pub(in crate::imagery) fn read_header(stream: &mut (impl BufRead + Seek)) -> Result<Header, ImageryError> {
    stream.rewind()?;
    let start: [u8; 2] = read_bytes(stream)?;
    if start != [0xFF, 0xD8] {
        return Err(damaged("it does not begin with FF D8"));
    }
    let mut frame = None;
    let (mut exif, mut xmp) = (None, None);
    for _ in 0..MAX_SEGMENTS {
        let at = stream.stream_position()?;
        let marker = read_marker(stream)?;
        if marker == 0xD9 {
            return Err(damaged("it ends before its first scan; send the complete file"));
        }
        let length = u16::from_be_bytes(read_bytes(stream)?);
        let Some(length) = length.checked_sub(2) else {
            return Err(damaged(format!("segment FF {marker:02X} has length {length}")));
        };
        match marker {
            0xC4 | 0xC8 | 0xCC => skip(stream, length)?,
            0xC0..=0xCF => {
                if frame.is_some() {
                    return Err(damaged("it has two frame headers"));
                }
                frame = Some(parse_frame(marker, &read_vec(stream, length)?)?);
            }
            0xE1 => {
                let segment = read_vec(stream, length)?;
                if let Some(body) = segment.strip_prefix(EXIF_PREFIX) {
                    exif.get_or_insert_with(|| body.to_vec());
                } else if let Some(body) = segment.strip_prefix(XMP_PREFIX) {
                    xmp.get_or_insert_with(|| body.to_vec());
                }
            }
            0xDA => {
                let Some(frame) = frame else {
                    return Err(damaged("its first scan comes before its frame header"));
                };
                return Ok(Header { first_scan: at, exif, xmp, ..frame });
            }
            _ => skip(stream, length)?,
        }
    }
    Err(damaged(format!("it has more than {MAX_SEGMENTS} segments before its first scan")))
}

/// Reads a start-of-frame segment without its marker and length.
fn parse_frame(marker: u8, segment: &[u8]) -> Result<Header, ImageryError> {
    let &[bits, h1, h0, w1, w0, components, ..] = segment else {
        return Err(damaged("its frame header is too short"));
    };
    if !matches!(marker, 0xC0..=0xC2) {
        return Err(unsupported(format!(
            "process FF {marker:02X} (lossless, hierarchical or arithmetic); save it as a baseline or progressive JPEG"
        )));
    }
    if bits != 8 {
        return Err(unsupported(format!("{bits} bits a sample; save it with 8, or as a 16-bit TIFF")));
    }
    if !matches!(components, 1 | 3) {
        return Err(unsupported(format!("{components} colour components; save it as grey or RGB")));
    }
    let (height, width) = (u16::from_be_bytes([h1, h0]), u16::from_be_bytes([w1, w0]));
    if height == 0 || width == 0 {
        return Err(damaged(format!("its size is given as {width} x {height}")));
    }
    let progressive = marker == 0xC2;
    Ok(Header { width, height, bits, components, progressive, first_scan: 0, exif: None, xmp: None })
}

impl Header {
    /// Columns and rows.
    pub(in crate::imagery) fn size_px(&self) -> [u32; 2] {
        [self.width.into(), self.height.into()]
    }
}

/// Where the compressed data end.
#[derive(Debug, PartialEq, Eq)]
pub(in crate::imagery) struct Scans {
    pub(in crate::imagery) count: usize,
    /// Just behind the data of the last scan.
    pub(in crate::imagery) end: usize,
}

/// Walks the scans up to the end of the image; what follows there (cameras append previews) is ignored.
pub(in crate::imagery) fn walk_scans(bytes: &[u8], header: &Header) -> Result<Scans, ImageryError> {
    let ends_early = || {
        let length = bytes.len();
        damaged(format!("it ends early: {length} bytes without an end-of-image marker; send the complete file"))
    };
    let mut at = header.first_scan as usize;
    let mut scans = Scans { count: 0, end: 0 };
    let mut components = 0;
    loop {
        // Fill bytes before a marker are allowed.
        while bytes.get(at) == Some(&0xFF) && bytes.get(at + 1) == Some(&0xFF) {
            at += 1;
        }
        let &[0xFF, marker] = bytes.get(at..at + 2).ok_or_else(ends_early)? else {
            return Err(damaged(format!("no marker where one is due, at byte {at}")));
        };
        match marker {
            0xD9 if header.progressive || components == usize::from(header.components) => return Ok(scans),
            0xC4 | 0xDA | 0xDB | 0xDD | 0xE0..=0xFE => {}
            // Only a progressive JPEG has its components more than once.
            0xD9 => {
                return Err(damaged(format!("{components} instead of {} components in its scans", header.components)));
            }
            _ => return Err(damaged(format!("marker FF {marker:02X} between its scans, at byte {at}"))),
        }
        let &[l1, l0, first] = bytes.get(at + 2..at + 5).ok_or_else(ends_early)? else { return Err(ends_early()) };
        at += 2 + usize::from(u16::from_be_bytes([l1, l0]));
        if marker == 0xDA {
            components += usize::from(first);
            at = end_of_entropy_coded_data(bytes, at).ok_or_else(ends_early)?;
            scans = Scans { count: scans.count + 1, end: at };
        }
    }
}

/// The next FF that is neither stuffing nor a restart marker.
fn end_of_entropy_coded_data(bytes: &[u8], mut at: usize) -> Option<usize> {
    loop {
        at += bytes.get(at..)?.iter().position(|&byte| byte == 0xFF)?;
        match bytes.get(at + 1)? {
            0x00 | 0xD0..=0xD7 => at += 2,
            _ => return Some(at),
        }
    }
}

/// The code of the next marker, after any fill bytes.
fn read_marker(stream: &mut impl BufRead) -> Result<u8, ImageryError> {
    let [prefix] = read_bytes(stream)?;
    if prefix != 0xFF {
        return Err(damaged("no marker where a segment should begin"));
    }
    loop {
        match read_bytes(stream)? {
            [0xFF] => {}
            [code] => return Ok(code),
        }
    }
}

fn read_bytes<const N: usize>(stream: &mut impl Read) -> Result<[u8; N], ImageryError> {
    let mut bytes = [0; N];
    stream.read_exact(&mut bytes).map_err(early_end)?;
    Ok(bytes)
}

fn read_vec(stream: &mut impl Read, length: u16) -> Result<Vec<u8>, ImageryError> {
    let mut bytes = vec![0; length.into()];
    stream.read_exact(&mut bytes).map_err(early_end)?;
    Ok(bytes)
}

fn skip(stream: &mut impl Seek, length: u16) -> Result<(), ImageryError> {
    Ok(stream.seek_relative(length.into())?)
}

fn early_end(error: std::io::Error) -> ImageryError {
    if error.kind() == ErrorKind::UnexpectedEof {
        return damaged("it ends before its first scan; send the complete file");
    }
    error.into()
}
