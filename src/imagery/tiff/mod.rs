//! TIFF and BigTIFF: grey windows straight out of strips and tiles.

mod chunk_cache;
mod gps;
mod layout;
mod resolution;

use std::fs::File;
use std::io::{BufReader, Read};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tiff::TiffError;
use tiff::decoder::{Decoder, DecodingResult, Limits as TiffLimits};
use tiff::tags::Tag;

use self::chunk_cache::ChunkCache;
use self::layout::Layout;
use super::exif::{self, Clues};
use super::georeference::GeoTags;
use super::grey::{self, Grey, PixelLayout, Sample, Samples, append_grey};
use super::jpeg::{self, ColourModel};
use super::reduce::BoxAverage;
use super::{Format, ImageryError, Limits};
use crate::features::{GreyWindow, PixelRect};

type TiffDecoder = Decoder<BufReader<File>>;

/// Strips or tiles that are read to learn how many bits a deep picture really uses.
const SAMPLED_CHUNKS: usize = 16;

/// A TIFF on disk. Only the strips and tiles used last are in memory.
#[derive(Debug)]
pub(super) struct TiffWindows {
    layout: Layout,
    white: f32,
    limits: Limits,
    decoder: Mutex<TiffDecoder>,
    cache: Mutex<ChunkCache>,
}

/// Size, bits of a sample and what is known of the orientation.
pub(super) fn read_header(file: BufReader<File>, limits: &Limits) -> Result<([u32; 2], u8, Clues), ImageryError> {
    let (mut decoder, layout) = start(file, limits)?;
    let mut text = |tag| decoder.find_tag(tag).ok().flatten().and_then(|value| value.into_string().ok());
    let camera_model = exif::camera_model(text(Tag::Make).as_deref(), text(Tag::Model).as_deref());
    let pixel_size_um = resolution::pixel_size_um(&mut decoder);
    let clues = Clues { camera_model, pixel_size_um, ..gps::clues(&mut decoder) };
    let xmp = decoder.find_tag(Tag::Unknown(700)).ok().flatten().and_then(|value| value.into_u8_vec().ok());
    Ok((layout.size_px, layout.bits, exif::with_xmp(clues, xmp.as_deref())))
}

/// The tags of a GeoTIFF.
pub(super) fn geo_tags(file: BufReader<File>, limits: &Limits) -> Result<GeoTags, ImageryError> {
    let (mut decoder, _) = start(file, limits)?;
    let mut value = |tag| decoder.find_tag(tag).ok().flatten();
    let mut numbers = |tag| value(tag).and_then(|value| value.into_f64_vec().ok()).unwrap_or_default();
    let (pixel_scale, tie_points) = (numbers(Tag::ModelPixelScaleTag), numbers(Tag::ModelTiepointTag));
    let transformation = numbers(Tag::ModelTransformationTag);
    let keys = value(Tag::GeoKeyDirectoryTag).and_then(|value| value.into_u16_vec().ok()).unwrap_or_default();
    Ok(GeoTags { pixel_scale, tie_points, transformation, keys })
}

/// Reads the first directory and nothing else: other pages are previews or masks.
fn start(file: BufReader<File>, limits: &Limits) -> Result<(TiffDecoder, Layout), ImageryError> {
    let file_bytes = file.get_ref().metadata()?.len();
    let chunk_bytes = usize::try_from(limits.max_chunk_bytes).unwrap_or(usize::MAX);
    let mut tiff_limits = TiffLimits::default();
    tiff_limits.decoding_buffer_size = chunk_bytes;
    tiff_limits.intermediate_buffer_size = chunk_bytes;
    let mut decoder = Decoder::new(file).map_err(failed)?.with_limits(tiff_limits);
    let layout = Layout::read(&mut decoder, file_bytes, limits)?;
    Ok((decoder, layout))
}

impl TiffWindows {
    pub(super) fn open(file: BufReader<File>, limits: &Limits) -> Result<Self, ImageryError> {
        let (decoder, layout) = start(file, limits)?;
        let cache = Mutex::new(ChunkCache::new(limits.chunk_cache_bytes));
        let mut windows = Self { layout, white: 255.0, limits: limits.clone(), decoder: Mutex::new(decoder), cache };
        if windows.layout.bits == 16 {
            windows.white = grey::white(windows.brightest_of_some()?);
        }
        Ok(windows)
    }

    pub(super) fn size_px(&self) -> [u32; 2] {
        self.layout.size_px
    }

    /// Memory for the strips and tiles used last.
    pub(super) fn memory_bytes(&self) -> u64 {
        let layout = &self.layout;
        let chunk_px: u64 = layout.chunk_px.into_iter().map(u64::from).product();
        self.limits.chunk_cache_bytes.max(chunk_px * u64::from(layout.bits / 8))
    }

    /// Memory for one row of strips or tiles as they are decoded.
    pub(super) fn band_bytes(&self) -> u64 {
        let Layout { size_px, chunk_px, bits, pixel, .. } = &self.layout;
        let columns = u64::from(size_px[0].next_multiple_of(chunk_px[0]));
        columns * u64::from(chunk_px[1]) * u64::from(bits / 8) * pixel.samples as u64
    }

    /// The window of a rectangle that lies in the picture.
    pub(super) fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, ImageryError> {
        let mut average = BoxAverage::new(rect, reduction, self.white);
        if rect.width > 0 && rect.height > 0 {
            match self.layout.bits {
                8 => self.push_rows::<u8>(rect, &mut average)?,
                _ => self.push_rows::<u16>(rect, &mut average)?,
            }
        }
        Ok(average.finish())
    }

    fn push_rows<S: Sample>(&self, rect: PixelRect, average: &mut BoxAverage) -> Result<(), ImageryError> {
        let [chunk_width, chunk_height] = self.layout.chunk_px.map(|side| side as usize);
        let (left, top) = (rect.x as usize, rect.y as usize);
        let (right, bottom) = (left + rect.width as usize, top + rect.height as usize);
        let chunk_columns = left / chunk_width..right.div_ceil(chunk_width);
        let mut row = Vec::with_capacity(rect.width as usize);
        for chunk_row in top / chunk_height..bottom.div_ceil(chunk_height) {
            let band: Vec<Arc<Grey>> =
                chunk_columns.clone().map(|column| self.chunk(column, chunk_row)).collect::<Result<_, _>>()?;
            let above = chunk_row * chunk_height;
            for y in top.max(above)..bottom.min(above + chunk_height) {
                row.clear();
                for (column, chunk) in chunk_columns.clone().zip(&band) {
                    let before = column * chunk_width;
                    let start = (y - above) * chunk.width;
                    let from = start + left.max(before) - before;
                    let to = start + right.min(before + chunk_width) - before;
                    let part = S::samples(chunk).and_then(|samples| samples.get(from..to));
                    row.extend_from_slice(part.ok_or_else(|| damaged("a strip or tile holds too few pixels"))?);
                }
                average.push_row(&row);
            }
        }
        Ok(())
    }

    /// A strip or tile, from the cache or from disk.
    fn chunk(&self, column: usize, row: usize) -> Result<Arc<Grey>, ImageryError> {
        let index = row * self.layout.chunks_across + column;
        if let Some(chunk) = locked(&self.cache).find(index) {
            return Ok(chunk);
        }
        let mut decoder = locked(&self.decoder);
        // Another thread may have read it while this one waited.
        if let Some(chunk) = locked(&self.cache).find(index) {
            return Ok(chunk);
        }
        let chunk = Arc::new(self.decode(&mut decoder, index)?);
        locked(&self.cache).insert(index, Arc::clone(&chunk));
        Ok(chunk)
    }

    /// Decodes a strip or tile, all its planes if they lie apart.
    fn decode(&self, decoder: &mut TiffDecoder, index: usize) -> Result<Grey, ImageryError> {
        let first = self.decode_plane(decoder, index)?;
        if !self.layout.colour_in_planes {
            return Ok(first);
        }
        let per_plane = self.layout.chunks_per_plane;
        let second = self.decode_plane(decoder, index + per_plane)?;
        let third = self.decode_plane(decoder, index + 2 * per_plane)?;
        let width = first.width;
        let samples = match (first.samples, second.samples, third.samples) {
            (Samples::Eight(r), Samples::Eight(g), Samples::Eight(b)) => Samples::Eight(joined(&r, &g, &b)),
            (Samples::Sixteen(r), Samples::Sixteen(g), Samples::Sixteen(b)) => Samples::Sixteen(joined(&r, &g, &b)),
            _ => return Err(damaged("its colour planes are of different depths")),
        };
        Ok(Grey { width, samples })
    }

    fn decode_plane(&self, decoder: &mut TiffDecoder, index: usize) -> Result<Grey, ImageryError> {
        if let Some(model) = self.layout.jpeg {
            return self.decode_jpeg(decoder, index, model);
        }
        let number = u32::try_from(index).map_err(|_| damaged("it has too many strips or tiles"))?;
        let width = decoder.chunk_data_dimensions(number).0 as usize;
        let samples = match decoder.read_chunk(number).map_err(failed)? {
            DecodingResult::U8(samples) => Samples::Eight(grey_of(samples, self.layout.pixel)),
            DecodingResult::U16(samples) => Samples::Sixteen(grey_of(samples, self.layout.pixel)),
            _ => return Err(damaged("its samples are not of the kind that its directory says")),
        };
        Ok(Grey { width, samples })
    }

    /// Decodes a strip or tile that is a JPEG. The TIFF library would do it as well, but leniently, with the chroma
    /// that is of no use here, and with whatever size the JPEG claims to have.
    fn decode_jpeg(&self, decoder: &mut TiffDecoder, index: usize, model: ColourModel) -> Result<Grey, ImageryError> {
        let (offset, bytes) = self.layout.extents[index];
        decoder.goto_offset_u64(offset)?;
        let mut data = Vec::new();
        decoder.inner().take(bytes).read_to_end(&mut data)?;
        let [smallest, largest] = self.layout.stored_px(index);
        let tables = self.layout.jpeg_tables.as_deref();
        let mut grey = jpeg::decode_part(tables, &data, smallest, largest, model, &self.limits)?;
        if let (true, Samples::Eight(samples)) = (self.layout.white_is_zero, &mut grey.samples) {
            samples.iter_mut().for_each(|sample| *sample = !*sample);
        }
        Ok(grey)
    }

    /// The brightest sample of a few strips or tiles, spread over the picture.
    fn brightest_of_some(&self) -> Result<u16, ImageryError> {
        let (across, all) = (self.layout.chunks_across, self.layout.chunks_per_plane);
        let mut brightest = 0;
        for index in (0..all).step_by(all.div_ceil(SAMPLED_CHUNKS)) {
            brightest = brightest.max(self.chunk(index % across, index / across)?.samples.brightest());
        }
        Ok(brightest)
    }
}

/// A lock is never left with half-made contents, so one that a panic has poisoned can still be used.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn grey_of<S: Sample>(samples: Vec<S>, layout: PixelLayout) -> Vec<S> {
    if layout.samples == 1 {
        return samples;
    }
    let mut grey = Vec::with_capacity(samples.len() / layout.samples);
    append_grey(&samples, layout, &mut grey);
    grey
}

fn joined<S: Sample>(red: &[S], green: &[S], blue: &[S]) -> Vec<S> {
    red.iter().zip(green).zip(blue).map(|((&red, &green), &blue)| S::luma(red, green, blue)).collect()
}

/// Our words for an error of the library.
fn failed(error: TiffError) -> ImageryError {
    match error {
        TiffError::IoError(source) if source.raw_os_error().is_some() => source.into(),
        TiffError::IoError(source) if source.kind() == std::io::ErrorKind::UnexpectedEof => {
            damaged("it ends early, or a strip or tile holds too few bytes; send the complete file")
        }
        TiffError::UnsupportedError(kind) => unsupported(format!("{kind}; save it as 8 or 16-bit grey or RGB")),
        TiffError::LimitsExceeded => unsupported("a list of strips or tiles, or one of them, is too large"),
        other => damaged(other.to_string()),
    }
}

fn damaged(detail: impl Into<String>) -> ImageryError {
    ImageryError::Damaged { format: Format::Tiff, detail: detail.into() }
}

fn unsupported(detail: impl Into<String>) -> ImageryError {
    ImageryError::Unsupported { format: Format::Tiff, detail: detail.into() }
}
