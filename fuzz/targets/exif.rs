//! An EXIF block alone, in a frame that costs nothing: a JPEG header of 8 x 8 px. With `XMP` before it, an XMP packet.
#![no_main]

use gable::imagery::probe;
use gable_fuzz::{LIMITS, as_file};

const EXIF: &[u8] = b"Exif\0\0";
const XMP: &[u8] = b"http://ns.adobe.com/xap/1.0/\0";
/// The frame of a grey JPEG, and the begin of its one scan.
const FRAME: [u8; 23] = [0xFF, 0xC0, 0, 11, 8, 0, 8, 0, 8, 1, 1, 0x11, 0, 0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 63, 0];

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let (name, body) = data.strip_prefix(b"XMP").map_or((EXIF, data), |packet| (XMP, packet));
    let body = &body[..body.len().min(65_000)];
    let mut file = vec![0xFF, 0xD8, 0xFF, 0xE1];
    file.extend(((name.len() + body.len() + 2) as u16).to_be_bytes());
    file.extend(name.iter().chain(body).chain(&FRAME).chain(&[0, 0xFF, 0xD9]));
    let header = probe(as_file(&file), &LIMITS).expect("the frame is always the same");
    if let Some(position) = header.position {
        assert!((-180.0..=180.0).contains(&position.longitude_deg), "{position:?}");
        assert!((-90.0..=90.0).contains(&position.latitude_deg), "{position:?}");
        assert!(position.altitude_m.is_none_or(f64::is_finite), "{position:?}");
        assert!(position.horizontal_error_m.is_none_or(|error| error.is_finite() && error >= 0.0), "{position:?}");
    }
    if let Some(heading) = header.heading {
        assert!((0.0..360.0).contains(&heading.heading_deg), "{heading:?}");
    }
});
