//! The same pattern in every format and variant that is read.

use std::io::Cursor;

use rstest::rstest;

use super::pattern::{HEIGHT, WIDTH, assert_shows, fixture, grey, interleaved, luma, open, open_within, rgb};
use super::tiff_writer::{Variant, write};
use crate::imagery::{Format, ImageFile, ImageryError, Limits};

/// Half a grey value for the rounding of the luma, and what the weights of 16 bits lose.
const EXACT: f64 = 0.51;

fn opened(name: &str) -> Result<ImageFile, ImageryError> {
    ImageFile::open(&fixture(name), &Limits::default())
}

#[rstest]
#[case("444.jpg", 3.0)]
#[case("422.jpg", 3.0)]
#[case("420.jpg", 3.0)]
#[case("420_progressive.jpg", 3.0)]
#[case("420_restart.jpg", 3.0)]
#[case("rgb.jpg", 3.0)]
#[case("grey.jpg", 3.0)]
#[case("palette.png", 1.0)]
#[case("jpeg_strips.tif", 3.0)]
#[case("jpeg_ycbcr_strips.tif", 3.0)]
#[case("jpeg_tiles.tif", 3.0)]
#[case("jpeg_rgb_tiles.tif", 3.0)]
#[case("deflate_tiles.tif", EXACT)]
#[case("lzw_tiles_16.tif", EXACT)]
#[case("planes_deflate.tif", EXACT)]
#[case("four_bands.tif", EXACT)]
fn files_of_other_encoders(#[case] name: &str, #[case] tolerance: f64) {
    assert_shows(&opened(name).unwrap(), tolerance, luma);
}

#[rstest]
#[case("cmyk.jpg", "4 colour components")]
#[case("float.tif", "floating-point")]
#[case("palette.tif", "RGBPalette")]
#[case("four_bands_predictor.tif", "predictor")]
fn kinds_that_are_refused(#[case] name: &str, #[case] words: &str) {
    let error = opened(name).unwrap_err();
    assert!(matches!(error, ImageryError::Unsupported { .. }), "{error:?}");
    assert!(error.to_string().contains(words), "{error}");
}

/// Photometric interpretation and samples of a pixel.
#[rstest]
#[case(0, 1)]
#[case(1, 1)]
#[case(1, 2)]
#[case(2, 3)]
#[case(2, 4)]
fn tiff_without_compression(
    #[case] photometric: u16,
    #[case] samples: u16,
    #[values((None, 10), (None, 1000), (None, 1), (Some(16), 32), (Some(128), 64))] chunk: (Option<u32>, u32),
) {
    for choice in 0..16 {
        let [big_endian, big, deep, planar] = [1, 2, 4, 8].map(|bit| choice & bit != 0);
        let variant = Variant { big_endian, big, chunk, deep, photometric, samples, planar, more: vec![] };
        let bytes = write(&variant, [WIDTH, HEIGHT], |x, y, sample| {
            let value = match (photometric, sample) {
                (0, _) => 255 - luma(x, y).round() as u16,
                (1, 0) => luma(x, y).round() as u16,
                (2, 0..3) => rgb(x, y)[usize::from(sample)].into(),
                _ => 99,
            };
            if deep { value * 257 } else { value }
        });
        let file = open(&bytes).unwrap();
        assert_eq!(file.format(), Format::Tiff);
        assert_shows(&file, EXACT, luma);
    }
}

#[test]
fn a_cache_that_holds_nothing_changes_nothing() {
    let bytes = std::fs::read(fixture("deflate_tiles.tif")).unwrap();
    let limits = Limits { chunk_cache_bytes: 0, ..Limits::default() };
    assert_shows(&open_within(&bytes, &limits).unwrap(), EXACT, luma);
}

#[rstest]
fn tiff_with_compression(
    #[values("lzw", "deflate", "packbits", "none")] name: &str,
    #[values(false, true)] predictor: bool,
) {
    use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder, colortype::RGB16};
    let compression = match name {
        "lzw" => Compression::Lzw,
        "deflate" => Compression::Deflate(DeflateLevel::Fast),
        "packbits" => Compression::Packbits,
        _ => Compression::Uncompressed,
    };
    let mut bytes = Cursor::new(Vec::new());
    let predictor = if predictor { Predictor::Horizontal } else { Predictor::None };
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap().with_compression(compression).with_predictor(predictor);
    let mut image = encoder.new_image::<RGB16>(WIDTH, HEIGHT).unwrap();
    image.rows_per_strip(9).unwrap();
    let samples: Vec<u16> = interleaved().into_iter().map(|sample| u16::from(sample) * 257).collect();
    image.write_data(&samples).unwrap();
    assert_shows(&open(&bytes.into_inner()).unwrap(), EXACT, luma);
}

#[rstest]
#[case(png::ColorType::Grayscale, 8)]
#[case(png::ColorType::Rgb, 8)]
#[case(png::ColorType::Rgba, 8)]
#[case(png::ColorType::GrayscaleAlpha, 16)]
#[case(png::ColorType::Rgb, 16)]
fn png_of_any_colour_type(#[case] colour: png::ColorType, #[case] bits: u8) {
    let pixels = interleaved();
    let samples: Vec<u8> = match colour {
        png::ColorType::Grayscale => grey(),
        png::ColorType::GrayscaleAlpha => grey().iter().flat_map(|&grey| [grey, 7]).collect(),
        png::ColorType::Rgba => pixels.chunks(3).flat_map(|pixel| [pixel[0], pixel[1], pixel[2], 7]).collect(),
        _ => pixels,
    };
    // The same byte twice is the value times 257.
    let data: Vec<u8> = samples.iter().flat_map(|&sample| vec![sample; usize::from(bits / 8)]).collect();
    let depth = if bits == 16 { png::BitDepth::Sixteen } else { png::BitDepth::Eight };
    let file = open(&encode_png(colour, depth, &data)).unwrap();
    assert_eq!(file.format(), Format::Png);
    assert_shows(&file, EXACT, luma);
}

pub(super) fn encode_png(colour: png::ColorType, depth: png::BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, WIDTH, HEIGHT);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    bytes
}

#[test]
fn jpeg_of_the_encoder_at_hand() {
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 98);
    image::ImageEncoder::write_image(encoder, &interleaved(), WIDTH, HEIGHT, image::ExtendedColorType::Rgb8).unwrap();
    assert_shows(&open(&bytes).unwrap(), 3.0, luma);
}

/// A camera of 12 bits writes 0 to 4095 into 16 bits.
#[rstest]
fn deep_pictures_are_scaled_by_the_bits_that_they_use(#[values((None, 10), (Some(16), 16))] chunk: (Option<u32>, u32)) {
    let variant = Variant { chunk, deep: true, photometric: 1, samples: 1, ..Variant::default() };
    let twelve_bits = |x: u32, y: u32| if (x, y) == (25, 15) { 4095 } else { (16.0 * luma(x, y)) as u16 };
    let bytes = write(&variant, [WIDTH, HEIGHT], |x, y, _| twelve_bits(x, y));
    assert_shows(&open(&bytes).unwrap(), 0.01, |x, y| f64::from(twelve_bits(x, y)) * 255.0 / 4095.0);
}
