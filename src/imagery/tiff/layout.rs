//! What the first directory of a TIFF says of its pixels, checked before any of them is read.

use tiff::ColorType;
use tiff::decoder::ChunkType;
use tiff::tags::{CompressionMethod, PhotometricInterpretation, PlanarConfiguration, Predictor, SampleFormat, Tag};

use super::{TiffDecoder, damaged, failed, unsupported};
use crate::imagery::grey::PixelLayout;
use crate::imagery::jpeg::ColourModel;
use crate::imagery::{ImageryError, Limits};

/// How the pixels lie in the file.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) size_px: [u32; 2],
    /// 8 or 16.
    pub(super) bits: u8,
    /// Columns and rows of a strip or tile; those at the rims may have fewer.
    pub(super) chunk_px: [u32; 2],
    tiled: bool,
    pub(super) chunks_across: usize,
    pub(super) chunks_per_plane: usize,
    /// Red, green and blue have strips or tiles of their own.
    pub(super) colour_in_planes: bool,
    /// The samples of a pixel in one strip or tile, as the library hands them out.
    pub(super) pixel: PixelLayout,
    pub(super) white_is_zero: bool,
    /// Strips or tiles are JPEGs of this colour model.
    pub(super) jpeg: Option<ColourModel>,
    /// Tables that the JPEGs share.
    pub(super) jpeg_tables: Option<Vec<u8>>,
    /// Offset and length in the file of each strip or tile.
    pub(super) extents: Vec<(u64, u64)>,
}

impl Layout {
    /// Reads the directory.
    ///
    /// # Errors
    /// If the picture is of a kind that is not read, exceeds `limits`, or points outside the file.
    pub(super) fn read(decoder: &mut TiffDecoder, file_bytes: u64, limits: &Limits) -> Result<Self, ImageryError> {
        let (width, height) = decoder.dimensions().map_err(failed)?;
        limits.check_windowed([width, height], file_bytes)?;
        let photometric = photometric(decoder)?;
        let colour = decoder.colortype().map_err(failed)?;
        let bits = bits(decoder, colour)?;
        let compression = compression(decoder)?;
        let planar = tag(decoder, Tag::PlanarConfiguration)?.and_then(PlanarConfiguration::from_u16)
            == Some(PlanarConfiguration::Planar);
        let samples = tag(decoder, Tag::SamplesPerPixel)?.unwrap_or(1);
        let is_rgb = matches!(colour, ColorType::RGB(_) | ColorType::RGBA(_));
        check_combination(decoder, photometric, colour, samples, planar)?;

        let tiled = decoder.get_chunk_type() == ChunkType::Tile;
        let (chunk_width, chunk_height) = decoder.chunk_dimensions();
        let chunk_px = [chunk_width, if tiled { chunk_height } else { chunk_height.min(height) }];
        let samples_in_chunk = if planar { 1 } else { samples };
        let sample_bytes = u64::from(samples_in_chunk) * u64::from(bits / 8);
        let chunk_bytes = chunk_px.map(u64::from).iter().fold(sample_bytes, |bytes, &side| bytes.saturating_mul(side));
        limits.check_chunk_bytes(chunk_bytes)?;

        let jpeg = (compression == CompressionMethod::ModernJPEG).then_some(match photometric {
            PhotometricInterpretation::RGB => ColourModel::Rgb,
            _ => ColourModel::AsDeclared,
        });
        let jpeg_tables = match jpeg {
            Some(_) => decoder.find_tag(Tag::JPEGTables).and_then(|tables| tables.map(|t| t.into_u8_vec()).transpose()),
            None => Ok(None),
        };
        let pixel = match planar {
            true => PixelLayout { samples: 1, colour: false },
            false => PixelLayout { samples: colour.num_samples().into(), colour: is_rgb },
        };
        let chunks_across = width.div_ceil(chunk_px[0]) as usize;
        let layout = Self {
            size_px: [width, height],
            bits,
            chunk_px,
            tiled,
            chunks_across,
            chunks_per_plane: chunks_across * height.div_ceil(chunk_px[1]) as usize,
            colour_in_planes: planar && is_rgb,
            pixel,
            white_is_zero: photometric == PhotometricInterpretation::WhiteIsZero,
            jpeg,
            jpeg_tables: jpeg_tables.map_err(failed)?,
            extents: extents(decoder, tiled)?,
        };
        let raw_row_bytes = (compression == CompressionMethod::None).then_some(u64::from(chunk_px[0]) * sample_bytes);
        layout.check_extents(file_bytes, raw_row_bytes)?;
        Ok(layout)
    }

    /// The smallest and the largest size that the strip or tile `index` may have where it is stored: the part of it
    /// that lies in the picture, and all of it. A strip is as wide as the picture; the last one may be stored whole.
    pub(super) fn stored_px(&self, index: usize) -> [[u32; 2]; 2] {
        let in_plane = index % self.chunks_per_plane;
        let column = (in_plane % self.chunks_across) as u32;
        let row = (in_plane / self.chunks_across) as u32;
        let inside = |i: usize, number: u32| self.chunk_px[i].min(self.size_px[i] - number * self.chunk_px[i]);
        [[inside(0, column), inside(1, row)], self.chunk_px]
    }

    /// Whether all strips or tiles are there and end within the file. Those without compression must hold their rows.
    fn check_extents(&self, file_bytes: u64, raw_row_bytes: Option<u64>) -> Result<(), ImageryError> {
        let planes = if self.colour_in_planes { 3 } else { 1 };
        if self.extents.len() < planes * self.chunks_per_plane {
            return Err(damaged("its directory lists too few strips or tiles"));
        }
        let kind = if self.tiled { "tile" } else { "strip" };
        for (index, &(offset, bytes)) in self.extents.iter().enumerate() {
            if bytes == 0 {
                return Err(damaged(format!("{kind} {index} is empty; save the picture without gaps")));
            }
            let rows = if self.tiled { self.chunk_px[1] } else { self.stored_px(index)[0][1] };
            let needed = raw_row_bytes.map_or(bytes, |row_bytes| row_bytes * u64::from(rows));
            if offset.checked_add(needed).is_none_or(|end| end > file_bytes) {
                let detail = format!(
                    "it ends early: {file_bytes} bytes, but {kind} {index} has {needed} bytes from {offset} on; \
                     send the complete file"
                );
                return Err(damaged(detail));
            }
        }
        Ok(())
    }
}

fn tag(decoder: &mut TiffDecoder, tag: Tag) -> Result<Option<u16>, ImageryError> {
    decoder.find_tag_unsigned(tag).map_err(failed)
}

fn photometric(decoder: &mut TiffDecoder) -> Result<PhotometricInterpretation, ImageryError> {
    use PhotometricInterpretation::{BlackIsZero, RGB, WhiteIsZero, YCbCr};
    let code = tag(decoder, Tag::PhotometricInterpretation)?;
    match code.and_then(PhotometricInterpretation::from_u16) {
        Some(kind @ (BlackIsZero | WhiteIsZero | RGB | YCbCr)) => Ok(kind),
        Some(kind) => Err(unsupported(format!("colour space {kind:?}; save it as grey or RGB"))),
        None => Err(damaged("it does not say in which colour space it is")),
    }
}

fn bits(decoder: &mut TiffDecoder, colour: ColorType) -> Result<u8, ImageryError> {
    let formats: Vec<u16> = decoder.find_tag_unsigned_vec(Tag::SampleFormat).map_err(failed)?.unwrap_or_default();
    if formats.iter().any(|&format| format != SampleFormat::Uint.to_u16()) {
        return Err(unsupported("signed or floating-point samples; save it with 8 or 16 bits, unsigned"));
    }
    match colour.bit_depth() {
        bits @ (8 | 16) => Ok(bits),
        bits => Err(unsupported(format!("{bits} bits a sample; save it with 8 or 16"))),
    }
}

fn compression(decoder: &mut TiffDecoder) -> Result<CompressionMethod, ImageryError> {
    use CompressionMethod::{Deflate, LZW, ModernJPEG, None, OldDeflate, PackBits};
    match CompressionMethod::from_u16_exhaustive(tag(decoder, Tag::Compression)?.unwrap_or(1)) {
        known @ (None | LZW | Deflate | OldDeflate | PackBits | ModernJPEG) => Ok(known),
        other => Err(unsupported(format!(
            "compression {other:?}; save it with none, LZW, Deflate, PackBits or JPEG (method 7)"
        ))),
    }
}

/// Refuses what the library would read wrongly, or not at all.
fn check_combination(
    decoder: &mut TiffDecoder,
    photometric: PhotometricInterpretation,
    colour: ColorType,
    samples: u16,
    planar: bool,
) -> Result<(), ImageryError> {
    if photometric == PhotometricInterpretation::WhiteIsZero && samples > 1 {
        return Err(unsupported("several samples a pixel with white as zero; save it with black as zero"));
    }
    let predicted = tag(decoder, Tag::Predictor)?.unwrap_or(1) != Predictor::None.to_u16();
    if predicted && !planar && samples > colour.num_samples() {
        return Err(unsupported("a predictor with samples beyond the colours; save it without the predictor"));
    }
    Ok(())
}

fn extents(decoder: &mut TiffDecoder, tiled: bool) -> Result<Vec<(u64, u64)>, ImageryError> {
    let (offsets, counts) = match tiled {
        true => (Tag::TileOffsets, Tag::TileByteCounts),
        false => (Tag::StripOffsets, Tag::StripByteCounts),
    };
    let offsets = decoder.get_tag_u64_vec(offsets).map_err(failed)?;
    let counts = decoder.get_tag_u64_vec(counts).map_err(failed)?;
    Ok(offsets.into_iter().zip(counts).collect())
}
