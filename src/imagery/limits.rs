//! How much of a picture is believed.

use serde::Deserialize;

use super::ImageryError;

/// JPEG knows no longer side, and the column sums of a window are exact up to here.
const LONGEST_SIDE_PX: u32 = 65_535;

/// Bounds on the pictures that are read, so that no file, however made, takes the service down.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Longest side (values above 65 535 count as 65 535).
    pub max_side_px: u32,
    /// Pixels of a TIFF, which is read in windows.
    pub max_pixels: u64,
    /// Pixels of a JPEG or PNG, which must be decoded as a whole.
    pub max_whole_pixels: u64,
    /// Memory that decoding a JPEG or PNG may take; a progressive JPEG needs up to seven bytes a pixel, others one.
    pub max_decode_bytes: u64,
    /// Scans of a JPEG: a progressive one has about ten, each costs a pass over the picture.
    pub max_jpeg_scans: usize,
    /// Memory that one strip or tile of a TIFF may take when it is decompressed.
    pub max_chunk_bytes: u64,
    /// Memory for decoded strips and tiles that each open TIFF keeps (never less than one strip or tile).
    pub chunk_cache_bytes: u64,
    /// Pixels for each byte of the file: real photographs have fewer than 50.
    pub max_pixels_per_byte: u64,
    /// Pictures of up to so many pixels are exempt from `max_pixels_per_byte`: drawings compress without bound.
    pub small_picture_pixels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_side_px: 60_000,
            max_pixels: 1_000_000_000,
            max_whole_pixels: 120_000_000,
            max_decode_bytes: 512 << 20,
            max_jpeg_scans: 100,
            max_chunk_bytes: 256 << 20,
            chunk_cache_bytes: 64 << 20,
            max_pixels_per_byte: 400,
            small_picture_pixels: 4_000_000,
        }
    }
}

impl Limits {
    /// Whether a picture that must be decoded as a whole may be.
    pub(super) fn check_whole(&self, size_px: [u32; 2], file_bytes: u64) -> Result<(), ImageryError> {
        self.check(size_px, file_bytes, self.max_whole_pixels, "max_whole_pixels")
    }

    /// Whether a picture that is read in windows may be.
    pub(super) fn check_windowed(&self, size_px: [u32; 2], file_bytes: u64) -> Result<(), ImageryError> {
        self.check(size_px, file_bytes, self.max_pixels, "max_pixels")
    }

    fn check(
        &self,
        size_px: [u32; 2],
        file_bytes: u64,
        max_pixels: u64,
        setting: &'static str,
    ) -> Result<(), ImageryError> {
        let [width, height] = size_px.map(u64::from);
        let side_limit = u64::from(self.max_side_px.min(LONGEST_SIDE_PX));
        at_most(width.max(height), side_limit, "pixels along its longer side", "max_side_px")?;
        let pixels = width * height;
        at_most(pixels, max_pixels, "pixels", setting)?;
        if pixels > self.small_picture_pixels {
            let per_byte = pixels / file_bytes.max(1);
            at_most(per_byte, self.max_pixels_per_byte, "pixels for each byte of the file", "max_pixels_per_byte")?;
        }
        Ok(())
    }

    /// Whether decoding may take so much memory.
    pub(super) fn check_decode_bytes(&self, bytes: u64) -> Result<(), ImageryError> {
        at_most(bytes, self.max_decode_bytes, "bytes to hold in memory while it is decoded", "max_decode_bytes")
    }

    /// Whether one strip or tile may take so much memory.
    pub(super) fn check_chunk_bytes(&self, bytes: u64) -> Result<(), ImageryError> {
        at_most(bytes, self.max_chunk_bytes, "bytes in one strip or tile", "max_chunk_bytes")
    }

    /// Whether a JPEG may have so many scans.
    pub(super) fn check_scans(&self, scans: usize) -> Result<(), ImageryError> {
        at_most(scans as u64, self.max_jpeg_scans as u64, "scans", "max_jpeg_scans")
    }
}

fn at_most(found: u64, limit: u64, what: &'static str, setting: &'static str) -> Result<(), ImageryError> {
    if found > limit {
        return Err(ImageryError::OverLimit { what, found, limit, setting });
    }
    Ok(())
}
