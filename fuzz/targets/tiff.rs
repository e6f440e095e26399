//! TIFF and BigTIFF, read by windows; a window must be the same part of the whole.
#![no_main]

use gable::imagery::Format;

libfuzzer_sys::fuzz_target!(|data: &[u8]| gable_fuzz::picture(data, Format::Tiff));
