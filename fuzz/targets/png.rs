//! PNG, decoded as a whole.
#![no_main]

use gable::imagery::Format;

libfuzzer_sys::fuzz_target!(|data: &[u8]| gable_fuzz::picture(data, Format::Png));
