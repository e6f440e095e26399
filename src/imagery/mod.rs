//! Pictures on disk, read as grey windows, and what their headers tell.
//!
//! Nothing in a file is believed before it is checked: the format comes from the first bytes, sizes are held against
//! [`Limits`] before anything is allocated, and a file that ends early is an error, never a grey area. Pixels stay as
//! they are stored; an EXIF orientation tag never rotates them.

mod error;
mod exif;
pub mod georeference;
mod grey;
mod jpeg;
pub mod levels;
mod limits;
mod png;
mod probe;
mod reduce;
mod tiff;

#[cfg(test)]
mod tests;

use std::path::Path;

pub use self::error::ImageryError;
pub use self::exif::{ExifHeading, ExifPosition, North};
pub use self::limits::Limits;
pub use self::probe::{Format, Probe, probe};

use self::grey::{Grey, Sample, Samples};
use self::reduce::BoxAverage;
use self::tiff::TiffWindows;
use crate::features::{GreyWindow, Picture, PictureError, PixelRect};

/// A picture file that is ready to give grey windows, from any thread.
///
/// JPEG and PNG have no random access: they are decoded once, when they are opened, into one or two bytes a pixel.
/// TIFF stays on disk; its windows are read strip by strip or tile by tile.
#[derive(Debug)]
pub struct ImageFile {
    format: Format,
    size_px: [u32; 2],
    pixels: Pixels,
}

#[derive(Debug)]
enum Pixels {
    Frame { grey: Grey, white: f32 },
    Tiff(Box<TiffWindows>),
}

impl ImageFile {
    /// Opens the picture at `path`; the name says nothing, the first bytes decide the format.
    ///
    /// # Errors
    /// [`ImageryError`] if the file cannot be read, is of another format, is damaged or cut off (a damaged strip or
    /// tile of a TIFF shows only when it is read), or exceeds `limits`.
    pub fn open(path: &Path, limits: &Limits) -> Result<Self, ImageryError> {
        let mut file = probe::open(path)?;
        let format = probe::format(&mut file)?;
        let (size_px, grey) = match format {
            Format::Jpeg => jpeg::read(file, limits)?,
            Format::Png => png::read(file, limits)?,
            Format::Tiff => {
                let windows = TiffWindows::open(file, limits)?;
                return Ok(Self { format, size_px: windows.size_px(), pixels: Pixels::Tiff(Box::new(windows)) });
            }
        };
        let white = grey::white(grey.samples.brightest());
        Ok(Self { format, size_px, pixels: Pixels::Frame { grey, white } })
    }

    /// A picture that was made of others, of one byte a pixel, row by row.
    fn of_grey(size_px: [u32; 2], samples: Vec<u8>) -> Self {
        let grey = Grey { width: size_px[0] as usize, samples: Samples::Eight(samples) };
        Self { format: Format::Jpeg, size_px, pixels: Pixels::Frame { grey, white: 255.0 } }
    }

    /// The most memory that it keeps as long as it is open.
    #[must_use]
    pub fn memory_bytes(&self) -> u64 {
        match &self.pixels {
            Pixels::Frame { grey, .. } => grey.bytes(),
            Pixels::Tiff(windows) => windows.memory_bytes(),
        }
    }

    /// Whether its pixels are read when they are asked for.
    fn is_on_disk(&self) -> bool {
        matches!(self.pixels, Pixels::Tiff(_))
    }

    /// Memory that reading a window over its whole width takes beside the window.
    fn band_bytes(&self) -> u64 {
        match &self.pixels {
            Pixels::Frame { .. } => 0,
            Pixels::Tiff(windows) => windows.band_bytes(),
        }
    }

    /// The format that the file's first bytes announced.
    #[must_use]
    pub fn format(&self) -> Format {
        self.format
    }
}

impl Picture for ImageFile {
    fn size_px(&self) -> [u32; 2] {
        self.size_px
    }

    fn window(&self, rect: PixelRect, reduction: u32) -> Result<GreyWindow, PictureError> {
        if reduction == 0 {
            return Err(PictureError { detail: "a window needs a reduction of at least 1".into() });
        }
        let rect = clipped(rect, self.size_px);
        match &self.pixels {
            Pixels::Frame { grey, white } => Ok(frame_window(grey, *white, rect, reduction)),
            Pixels::Tiff(windows) => Ok(windows.window(rect, reduction)?),
        }
    }
}

/// The part of `rect` that lies in a picture of this size; without any pixels where there is none.
fn clipped(rect: PixelRect, [width, height]: [u32; 2]) -> PixelRect {
    let (x, y) = (rect.x.min(width), rect.y.min(height));
    PixelRect { x, y, width: rect.width.min(width - x), height: rect.height.min(height - y) }
}

fn frame_window(frame: &Grey, white: f32, rect: PixelRect, reduction: u32) -> GreyWindow {
    let mut average = BoxAverage::new(rect, reduction, white);
    match &frame.samples {
        Samples::Eight(samples) => push_rows(samples, frame.width, rect, &mut average),
        Samples::Sixteen(samples) => push_rows(samples, frame.width, rect, &mut average),
    }
    average.finish()
}

fn push_rows<S: Sample>(samples: &[S], width: usize, rect: PixelRect, average: &mut BoxAverage) {
    let columns = rect.x as usize..(rect.x + rect.width) as usize;
    let rows = samples.chunks_exact(width).skip(rect.y as usize).take(rect.height as usize);
    rows.for_each(|row| average.push_row(&row[columns.clone()]));
}
