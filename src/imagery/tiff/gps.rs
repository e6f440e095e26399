//! The GPS directory of a TIFF, read where it stands: the file may be far too large to be searched as a whole.

use tiff::Directory;
use tiff::decoder::ifd::Value;
use tiff::tags::{IfdPointer, Tag};

use super::TiffDecoder;
use crate::imagery::exif::{self, Clues, GpsDirectory, GpsTag};

/// What the GPS directory tells; nothing if there is none or it cannot be read.
pub(super) fn clues(decoder: &mut TiffDecoder) -> Clues {
    let pointer = decoder.find_tag(Tag::GpsDirectory).ok().flatten().and_then(|value| value.into_u64().ok());
    let directory = pointer.and_then(|pointer| decoder.read_directory(IfdPointer(pointer)).ok());
    directory.map(|directory| exif::clues_of(&mut TiffGps { decoder, directory })).unwrap_or_default()
}

struct TiffGps<'a> {
    decoder: &'a mut TiffDecoder,
    directory: Directory,
}

impl TiffGps<'_> {
    fn value(&mut self, tag: GpsTag) -> Option<Value> {
        let tag = Tag::from_u16_exhaustive(tag as u16);
        self.decoder.read_directory_tags(&self.directory).find_tag(tag).ok().flatten()
    }
}

impl GpsDirectory for TiffGps<'_> {
    fn numbers(&mut self, tag: GpsTag) -> Option<Vec<f64>> {
        match self.value(tag)? {
            Value::List(list) => list.iter().map(number).collect(),
            single => Some(vec![number(&single)?]),
        }
    }

    fn letter(&mut self, tag: GpsTag) -> Option<u8> {
        match self.value(tag)? {
            Value::Ascii(text) => text.bytes().next(),
            _ => None,
        }
    }
}

fn number(value: &Value) -> Option<f64> {
    match *value {
        Value::Rational(numerator, denominator) => Some(f64::from(numerator) / f64::from(denominator)),
        Value::Byte(number) => Some(f64::from(number)),
        _ => None,
    }
}
