//! The resolution of a scan.

use std::ops::RangeInclusive;

use tiff::decoder::ifd::Value;
use tiff::tags::Tag;

use super::TiffDecoder;

/// Film is scanned with pixels of some micrometres. Programs that know of no scan write 72 or 96 pixels an inch, which
/// are beyond this.
const PLAUSIBLE_UM: RangeInclusive<f64> = 2.0..=200.0;
/// The two resolutions of square pixels may differ by rounding.
const SQUARE: f64 = 0.002;

/// Side of a pixel on the film, if the pixels are square and it is plausible.
pub(super) fn pixel_size_um(decoder: &mut TiffDecoder) -> Option<f64> {
    let across = resolution(decoder, Tag::XResolution)?;
    let down = resolution(decoder, Tag::YResolution)?;
    let unit = decoder.find_tag(Tag::ResolutionUnit).ok().flatten().map(|unit| unit.into_u16());
    // inches where nothing is said (TIFF 6.0)
    let unit_um = match unit {
        None | Some(Ok(2)) => 25_400.0,
        Some(Ok(3)) => 10_000.0,
        Some(_) => return None,
    };
    let size_um = unit_um / (across * down).sqrt();
    let is_square = (across / down - 1.0).abs() < SQUARE;
    (is_square && PLAUSIBLE_UM.contains(&size_um)).then_some(size_um)
}

fn resolution(decoder: &mut TiffDecoder, tag: Tag) -> Option<f64> {
    let value = match decoder.find_tag(tag).ok().flatten()? {
        Value::Rational(numerator, denominator) => f64::from(numerator) / f64::from(denominator),
        Value::Float(value) => f64::from(value),
        Value::Double(value) => value,
        _ => return None,
    };
    (value.is_finite() && value > 0.0).then_some(value)
}
