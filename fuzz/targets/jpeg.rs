//! JPEG, decoded as a whole; its EXIF and XMP segments too.
#![no_main]

use gable::imagery::Format;

libfuzzer_sys::fuzz_target!(|data: &[u8]| gable_fuzz::picture(data, Format::Jpeg));
