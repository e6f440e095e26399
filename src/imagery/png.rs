//! PNG: decoded once, row by row, to grey.

use std::fs::File;
use std::io::BufReader;

use png::{ColorType, Decoder, DecodingError, InterlaceInfo, Limits as PngLimits, Reader, Transformations};

use super::grey::{Grey, PixelLayout, Samples, append_grey};
use super::{Format, ImageryError, Limits};

/// Memory for the chunks beside the pixels.
const ANCILLARY_BYTES: usize = 16 << 20;

/// Starts reading: all chunks before the pixels.
pub(super) fn read_header(file: BufReader<File>) -> Result<Reader<BufReader<File>>, ImageryError> {
    let mut decoder = Decoder::new_with_limits(file, PngLimits { bytes: ANCILLARY_BYTES });
    // Palettes become colours, and less than 8 bits become 8.
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder.read_info().map_err(damaged)
}

/// Reads a whole file.
pub(super) fn read(file: BufReader<File>, limits: &Limits) -> Result<([u32; 2], Grey), ImageryError> {
    let file_bytes = file.get_ref().metadata()?.len();
    let mut reader = read_header(file)?;
    let (width, height) = reader.info().size();
    limits.check_whole([width, height], file_bytes)?;
    let (colour, depth) = reader.output_color_type();
    let bytes = depth as usize / 8;
    let pixels = u64::from(width) * u64::from(height);
    let layout = PixelLayout { samples: colour.samples(), colour: matches!(colour, ColorType::Rgb | ColorType::Rgba) };

    // Deep samples are kept as pairs of bytes until the last row is in its place.
    limits.check_decode_bytes(pixels * if bytes == 2 { 4 } else { 1 })?;
    let row_bytes = width as usize * bytes;
    let mut frame = vec![0; row_bytes * height as usize];
    let mut next_row = 0;
    let mut grey_row = Vec::with_capacity(row_bytes);
    while let Some(row) = reader.next_interlaced_row().map_err(damaged)? {
        grey_row.clear();
        match bytes {
            1 => append_grey(row.data(), layout, &mut grey_row),
            _ => append_grey_pairs(row.data(), layout, &mut grey_row),
        }
        match row.interlace() {
            InterlaceInfo::Null(_) => {
                let Some(target) = frame.get_mut(next_row * row_bytes..(next_row + 1) * row_bytes) else { break };
                target.copy_from_slice(&grey_row);
                next_row += 1;
            }
            InterlaceInfo::Adam7(pass) => {
                png::expand_interlaced_row(&mut frame, row_bytes, &grey_row, pass, 8 * bytes as u8);
            }
        }
    }
    // The end of the file with its checksums.
    reader.finish().map_err(damaged)?;

    let samples = match bytes {
        1 => Samples::Eight(frame),
        _ => Samples::Sixteen(frame.as_chunks::<2>().0.iter().map(|&pair| u16::from_be_bytes(pair)).collect()),
    };
    Ok(([width, height], Grey { width: width as usize, samples }))
}

/// As [`append_grey`], for samples of two bytes, the higher one first.
fn append_grey_pairs(row: &[u8], layout: PixelLayout, grey: &mut Vec<u8>) {
    let samples: Vec<u16> = row.as_chunks::<2>().0.iter().map(|&pair| u16::from_be_bytes(pair)).collect();
    let mut deep = Vec::with_capacity(samples.len() / layout.samples);
    append_grey(&samples, layout, &mut deep);
    grey.extend(deep.iter().flat_map(|sample| sample.to_be_bytes()));
}

fn damaged(error: DecodingError) -> ImageryError {
    match error {
        DecodingError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => source.into(),
        DecodingError::IoError(_) => {
            let detail = "it ends early; send the complete file".into();
            ImageryError::Damaged { format: Format::Png, detail }
        }
        other => ImageryError::Damaged { format: Format::Png, detail: other.to_string() },
    }
}
