//! The picture of a template: from a file of a user, and back.

use std::io::Write as _;
use std::path::Path;

use image::ImageEncoder as _;

use crate::features::{Picture as _, PixelRect};
use crate::http::images::imagery_problem;
use crate::http::problem::Problem;
use crate::imagery::{ImageFile, Limits};

/// Sides of pictures, px: smaller ones show nothing, larger ones are no marks.
const SIDES_PX: std::ops::RangeInclusive<u32> = 8..=512;
const WHITE: f32 = 255.0;

/// Size and grey values of a picture file, 0 to 65 535. `incoming` is a folder where it may stand for a moment.
pub(super) fn decode(content: &[u8], incoming: &Path, limits: &Limits) -> Result<([u32; 2], Vec<u16>), Problem> {
    let mut file = tempfile::NamedTempFile::new_in(incoming).map_err(|error| Problem::internal(&error))?;
    file.write_all(content).and_then(|()| file.flush()).map_err(|error| Problem::internal(&error))?;
    let picture = ImageFile::open(file.path(), limits).map_err(|error| imagery_problem(&error))?;
    let [width, height] = picture.size_px();
    let (least, most) = SIDES_PX.into_inner();
    if width.max(height) > most {
        return Err(Problem::too_large(format!(
            "The picture of a mark has {width} x {height} px; it may have {most} px a side. Cut the mark out of the scan."
        )));
    }
    if width.min(height) < least {
        return Err(Problem::invalid(format!(
            "The picture of a mark has {width} x {height} px; it must have at least {least} px a side."
        )));
    }
    let window = picture.window(PixelRect { x: 0, y: 0, width, height }, 1);
    let window = window.map_err(|error| Problem::invalid(format!("The picture of the mark is damaged: {error}")))?;
    // scaled by a whole number, so that eight bits stay what they are
    let grey = |grey: &f32| (grey.clamp(0.0, WHITE) * (f32::from(u16::MAX) / WHITE)).round() as u16;
    Ok(([width, height], window.grey.iter().map(grey).collect()))
}

/// A PNG of grey values.
pub(super) fn png([width, height]: [u32; 2], grey: &[u16]) -> image::ImageResult<Vec<u8>> {
    // the encoder takes numbers as this machine stores them
    let native: Vec<u8> = grey.iter().flat_map(|grey| grey.to_ne_bytes()).collect();
    let mut file = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut file);
    encoder.write_image(&native, width, height, image::ExtendedColorType::L16)?;
    Ok(file)
}
