//! JPEG: the segments before the first scan, the extent of the scans, and strict decoding to grey.
//!
//! Where a file is cut off, most decoders fill the rest with grey and say that all is well. Two things prevent that
//! here: the markers are walked to the end of the image first, and the decoder is then given a stream in which the
//! data of the last scan are followed by a code that no JPEG may contain.

mod segments;

use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek};

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

pub(super) use self::segments::read_header;
use self::segments::{Header, walk_scans};
use super::grey::{Grey, PixelLayout, Samples, append_grey};
use super::{Format, ImageryError, Limits};

/// Reads a whole file.
pub(super) fn read(mut file: BufReader<File>, limits: &Limits) -> Result<([u32; 2], Grey), ImageryError> {
    let header = read_header(&mut file)?;
    let file_bytes = file.get_ref().metadata()?.len();
    limits.check_whole(header.size_px(), file_bytes)?;
    limits.check_decode_bytes(decode_bytes(&header, 1, file_bytes))?;
    let mut bytes = Vec::with_capacity(file_bytes as usize);
    file.rewind()?;
    file.take(file_bytes).read_to_end(&mut bytes)?;
    let samples = decode(bytes, &header, ColourModel::AsDeclared, limits)?;
    Ok((header.size_px(), Grey { width: header.width.into(), samples: Samples::Eight(samples) }))
}

/// How the components of a colour JPEG are to be understood.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColourModel {
    /// As its own segments say; without a word YCbCr.
    AsDeclared,
    /// Red, green and blue, as the TIFF says that it is a part of.
    Rgb,
}

/// Decodes the bytes to which `header` belongs, to one grey value a pixel.
pub(super) fn decode(
    mut bytes: Vec<u8>,
    header: &Header,
    model: ColourModel,
    limits: &Limits,
) -> Result<Vec<u8>, ImageryError> {
    let scans = walk_scans(&bytes, header)?;
    limits.check_scans(scans.count)?;
    limits.check_decode_bytes(decode_bytes(header, scans.count, bytes.len() as u64))?;
    forbid_overrun(&mut bytes, scans.end);

    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(usize::from(header.width))
        .set_max_height(usize::from(header.height))
        .jpeg_set_max_scans(limits.max_jpeg_scans)
        .jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|error| damaged(error.to_string()))?;
    let stored = match (decoder.input_colorspace(), model) {
        (Some(ColorSpace::Luma), _) | (Some(ColorSpace::YCbCr), ColourModel::AsDeclared) => ColorSpace::Luma,
        // To ask for what is stored switches any conversion off.
        (Some(same @ (ColorSpace::YCbCr | ColorSpace::RGB)), _) => same,
        (other, _) => return Err(unsupported(format!("colour space {other:?}; save it as grey or RGB"))),
    };
    decoder.set_options(options.jpeg_set_out_colorspace(stored));

    let (width, height) = (usize::from(header.width), usize::from(header.height));
    let channels = stored.num_components();
    let mut samples = vec![0; width * height * channels];
    decoder.decode_into(&mut samples).map_err(|error| {
        let rows = rows_before_blank(&samples, width * channels);
        damaged(format!("only about {rows} of its {height} rows can be decoded ({error}); send the complete file"))
    })?;
    if channels == 1 {
        return Ok(samples);
    }
    let mut grey = Vec::with_capacity(width * height);
    append_grey(&samples, PixelLayout { samples: channels, colour: true }, &mut grey);
    Ok(grey)
}

/// Memory that decoding takes: the file, the grey picture, and where the components come in several scans, two bytes
/// for each of their samples.
fn decode_bytes(header: &Header, scans: usize, file_bytes: u64) -> u64 {
    let pixels = u64::from(header.width) * u64::from(header.height);
    let in_several_scans = header.progressive || scans > 1;
    let bytes_per_pixel = 1 + if in_several_scans { 2 * u64::from(header.components) } else { 0 };
    file_bytes + pixels * bytes_per_pixel
}

/// Replaces all that follows the data of the last scan by one-bits and an end-of-image marker. No Huffman code may
/// consist of ones only, so a decoder that is short of data fails here; after the marker it would make up zeros.
fn forbid_overrun(bytes: &mut Vec<u8>, end_of_data: usize) {
    bytes.truncate(end_of_data);
    bytes.extend_from_slice(&[0xFF, 0x00].repeat(16));
    bytes.extend_from_slice(&[0xFF, 0xD9]);
}

/// Rows above the blank area that a failed decoder leaves.
fn rows_before_blank(samples: &[u8], row_length: usize) -> usize {
    let Some(&blank) = samples.last() else { return 0 };
    let blank_rows = samples.chunks_exact(row_length).rev().take_while(|row| row.iter().all(|&s| s == blank));
    samples.len() / row_length - blank_rows.count()
}

/// Decodes a JPEG inside a strip or tile, `tables` being the tables that all of them share.
///
/// # Errors
/// As [`decode`], and if the JPEG is larger than `longest_px` or smaller than `shortest_px`.
pub(super) fn decode_part(
    tables: Option<&[u8]>,
    data: &[u8],
    shortest_px: [u32; 2],
    longest_px: [u32; 2],
    model: ColourModel,
    limits: &Limits,
) -> Result<Grey, ImageryError> {
    // Both parts are complete streams: the first loses its end marker, the second its start marker.
    let bytes = match tables.and_then(|tables| tables.strip_suffix(&[0xFF, 0xD9])) {
        Some(tables) => [tables, data.get(2..).unwrap_or_default()].concat(),
        None => data.to_vec(),
    };
    let header = read_header(&mut Cursor::new(&bytes))?;
    let size = header.size_px();
    let fits = |i: usize| (shortest_px[i]..=longest_px[i]).contains(&size[i]);
    if !fits(0) || !fits(1) {
        let ([w, h], [tw, th]) = (size, longest_px);
        return Err(damaged(format!("a part of {w} x {h} pixels in a strip or tile of {tw} x {th}")));
    }
    let samples = decode(bytes, &header, model, limits)?;
    Ok(Grey { width: header.width.into(), samples: Samples::Eight(samples) })
}

fn damaged(detail: impl Into<String>) -> ImageryError {
    ImageryError::Damaged { format: Format::Jpeg, detail: detail.into() }
}

fn unsupported(detail: impl Into<String>) -> ImageryError {
    ImageryError::Unsupported { format: Format::Jpeg, detail: detail.into() }
}
