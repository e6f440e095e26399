//! Files that end early, contradict themselves or want too much.

use std::time::{Duration, Instant};

use proptest::prelude::*;
use rstest::rstest;

use super::formats::encode_png;
use super::pattern::{HEIGHT, WIDTH, fixture, grey, interleaved, open, open_within, rect, with_file};
use super::tiff_writer::{Field, TiffBytes, Variant, write};
use crate::features::Picture;
use crate::imagery::{ImageryError, Limits, probe};

/// Opens a picture and reads all of it.
fn read_all(bytes: &[u8]) -> Result<(), String> {
    let file = open(bytes).map_err(|error| error.to_string())?;
    let [width, height] = file.size_px();
    file.window(rect(0, 0, width, height), 2).map(|_| ()).map_err(|error| error.to_string())
}

#[rstest]
#[case("444.jpg")]
#[case("420.jpg")]
#[case("420_progressive.jpg")]
#[case("420_restart.jpg")]
#[case("grey.jpg")]
#[case("rgb.jpg")]
#[case("palette.png")]
#[case("jpeg_tiles.tif")]
#[case("jpeg_strips.tif")]
#[case("deflate_tiles.tif")]
#[case("four_bands.tif")]
fn every_cut_is_noticed(#[case] name: &str) {
    let bytes = std::fs::read(fixture(name)).unwrap();
    read_all(&bytes).unwrap();
    let cuts = (0..100).map(|percent| bytes.len() * percent / 100);
    for length in cuts.chain([bytes.len() * 999 / 1000, bytes.len() - 2, bytes.len() - 1]) {
        // TIFF writers may end with a byte that belongs to nothing.
        if name.ends_with("tif") && length + 2 >= bytes.len() {
            continue;
        }
        assert!(read_all(&bytes[..length]).is_err(), "{name} cut to {length} of {} bytes", bytes.len());
    }
}

/// What tools do that "repair" a cut file. The progressive one is complete, if coarse, where a scan happens to end.
#[rstest]
#[case("444.jpg")]
#[case("420.jpg")]
#[case("420_restart.jpg")]
#[case("grey.jpg")]
#[case("rgb.jpg")]
fn a_cut_is_noticed_behind_an_end_marker(#[case] name: &str) {
    let bytes = std::fs::read(fixture(name)).unwrap();
    for percent in 40..99 {
        let mut cut = bytes[..bytes.len() * percent / 100].to_vec();
        cut.extend([0xFF, 0xD9]);
        assert!(read_all(&cut).is_err(), "{name} cut to {percent} %");
    }
}

#[test]
fn previews_behind_the_picture_are_ignored() {
    let mut bytes = std::fs::read(fixture("420.jpg")).unwrap();
    bytes.extend_from_within(..);
    read_all(&bytes).unwrap();
}

/// The decoder would take the first of the two scans, and say nothing.
#[test]
fn a_second_scan_of_the_same_components_is_noticed() {
    let bytes = std::fs::read(fixture("420.jpg")).unwrap();
    let scan = bytes.windows(2).position(|marker| marker == [0xFF, 0xDA]).unwrap();
    let (half, end) = (scan + (bytes.len() - scan) / 2, bytes.len() - 2);
    assert!(read_all(&[&bytes[..end], &bytes[scan..]].concat()).unwrap_err().contains("6 instead of 3 components"));
    assert!(read_all(&[&bytes[..half], &bytes[scan..]].concat()).is_err());
}

#[test]
fn messages_say_what_is_wrong() {
    let bytes = std::fs::read(fixture("420.jpg")).unwrap();
    let mut cut = bytes[..bytes.len() * 7 / 10].to_vec();
    assert!(read_all(&cut).unwrap_err().contains("ends early"));
    cut.extend([0xFF, 0xD9]);
    assert!(read_all(&cut).unwrap_err().contains("of its 53 rows"));
    assert!(read_all(b"").unwrap_err().contains("empty"));
    assert!(read_all(b"<html><body>").unwrap_err().contains("3C 68 74 6D"));
}

/// A JPEG of `size` that consists of headers and no data.
fn jpeg_header([width, height]: [u16; 2]) -> Vec<u8> {
    let template = std::fs::read(fixture("420.jpg")).unwrap();
    let frame = template.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
    let scan = template.windows(2).position(|marker| marker == [0xFF, 0xDA]).unwrap();
    let mut bytes = template[..scan + 14].to_vec();
    bytes[frame + 5..frame + 7].copy_from_slice(&height.to_be_bytes());
    bytes[frame + 7..frame + 9].copy_from_slice(&width.to_be_bytes());
    bytes.extend([0, 0xFF, 0xD9]);
    bytes
}

fn refused_at_once(bytes: &[u8]) -> ImageryError {
    let start = Instant::now();
    let error = open(bytes).unwrap_err();
    assert!(start.elapsed() < Duration::from_secs(1), "took {:?}", start.elapsed());
    assert!(with_file(bytes, |path| probe(path, &Limits::default())).is_err());
    error
}

#[rstest]
#[case([16_000, 16_000])]
#[case([65_500, 65_500])]
#[case([10_000, 10_000])]
fn a_jpeg_of_nothing_but_size_is_refused(#[case] size: [u16; 2]) {
    assert!(matches!(refused_at_once(&jpeg_header(size)), ImageryError::OverLimit { .. }));
}

#[test]
fn a_progressive_jpeg_of_many_scans_is_refused() {
    let bytes = std::fs::read(fixture("420_progressive.jpg")).unwrap();
    let last = bytes.windows(2).rposition(|marker| marker == [0xFF, 0xDA]).unwrap();
    let (head, scan) = (&bytes[..last], &bytes[last..bytes.len() - 2]);
    let many = [head, &scan.repeat(200), &[0xFF, 0xD9]].concat();
    let error = open(&many).unwrap_err();
    assert!(matches!(error, ImageryError::OverLimit { setting: "max_jpeg_scans", .. }), "{error}");
    let limits = Limits { max_decode_bytes: 20_000, ..Limits::default() };
    let error = open_within(&bytes, &limits).unwrap_err();
    assert!(matches!(error, ImageryError::OverLimit { setting: "max_decode_bytes", .. }), "{error}");
}

/// A TIFF directory of one strip that ends with the file.
fn tiff_header(width: u64, height: u64, rows: u64, extent: [u64; 2]) -> Vec<u8> {
    let mut tiff = TiffBytes::new(false, true);
    tiff.bytes.extend([0; 100]);
    let short = |value| Field::Shorts(vec![value]);
    let first = tiff.directory(&[
        (256, Field::Longs(vec![width])),
        (257, Field::Longs(vec![height])),
        (258, short(8)),
        (259, short(1)),
        (262, short(1)),
        (273, Field::Longs(vec![extent[0]])),
        (277, short(1)),
        (278, Field::Longs(vec![rows])),
        (279, Field::Longs(vec![extent[1]])),
    ]);
    tiff.finish(first)
}

#[rstest]
#[case(100_000, 100_000, 100_000, [16, 100])]
#[case(4_000_000_000, 4_000_000_000, 4_000_000_000, [16, 100])]
#[case(30_000, 30_000, 30_000, [16, 100])]
#[case(10, 10, 10, [1 << 40, 100])]
#[case(10, 10, 10, [u64::MAX, u64::MAX])]
#[case(10, 10, 10, [16, 0])]
#[case(1000, 1000, 1000, [16, 100])]
#[case(10, 10, 0, [16, 100])]
#[case(0, 10, 10, [16, 100])]
fn a_tiff_that_promises_what_it_has_not_is_refused(
    #[case] width: u64,
    #[case] height: u64,
    #[case] rows: u64,
    #[case] extent: [u64; 2],
) {
    refused_at_once(&tiff_header(width, height, rows, extent));
}

#[test]
fn the_tiff_header_of_these_tests_is_good_in_itself() {
    read_all(&tiff_header(10, 10, 10, [16, 100])).unwrap();
}

#[test]
fn large_strips_are_refused() {
    let bytes = write(&Variant { chunk: (None, 53), ..Variant::default() }, [WIDTH, HEIGHT], |_, _, _| 7);
    let limits = Limits { max_chunk_bytes: 12_242, ..Limits::default() };
    let error = open_within(&bytes, &limits).unwrap_err();
    assert!(matches!(error, ImageryError::OverLimit { found: 12_243, setting: "max_chunk_bytes", .. }), "{error}");
}

#[test]
fn a_tile_whose_jpeg_is_larger_than_the_tile_is_refused() {
    let bytes = std::fs::read(fixture("jpeg_tiles.tif")).unwrap();
    let frame = bytes.windows(2).position(|marker| marker == [0xFF, 0xC0]).unwrap();
    let mut larger = bytes.clone();
    larger[frame + 5..frame + 9].copy_from_slice(&[0x40, 0, 0x40, 0]);
    assert!(read_all(&larger).unwrap_err().contains("16384 x 16384"));
}

#[test]
fn a_damaged_png_is_noticed_by_its_checksum() {
    let mut bytes = encode_png(png::ColorType::Rgb, png::BitDepth::Eight, &interleaved());
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    assert!(read_all(&bytes).is_err());
}

#[test]
fn limits_come_from_the_configuration() {
    let limits: Limits = serde_json::from_str(r#"{"max_side_px": 5}"#).unwrap();
    assert_eq!(limits, Limits { max_side_px: 5, ..Limits::default() });
    assert!(serde_json::from_str::<Limits>(r#"{"max_side": 5}"#).is_err());
    let bytes = encode_png(png::ColorType::Grayscale, png::BitDepth::Eight, &grey());
    assert!(open_within(&bytes, &limits).unwrap_err().to_string().contains("max_side_px"));
}

fn any_fixture() -> impl Strategy<Value = Vec<u8>> {
    let names = ["420.jpg", "420_progressive.jpg", "420_restart.jpg", "palette.png", "jpeg_tiles.tif"];
    let more = ["deflate_tiles.tif", "lzw_tiles_16.tif", "planes_deflate.tif", "jpeg_strips.tif", "four_bands.tif"];
    let all: Vec<&str> = names.into_iter().chain(more).collect();
    prop::sample::select(all).prop_map(|name| std::fs::read(fixture(name)).unwrap())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    /// Either a picture or an error, never a panic and never a long wait.
    #[test]
    fn changed_bytes_never_panic(
        mut bytes in any_fixture(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let start = Instant::now();
        let _ = with_file(&bytes, |path| probe(path, &Limits::default()));
        let _ = read_all(&bytes);
        prop_assert!(start.elapsed() < Duration::from_secs(5));
    }

    #[test]
    fn random_bytes_never_panic(
        magic in prop::sample::select(vec![&b"\xFF\xD8\xFF"[..], b"\x89PNG\r\n\x1A\n", b"II*\0", b"MM\0+\0\x08\0\0"]),
        rest in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        let bytes = [magic, &rest].concat();
        let _ = with_file(&bytes, |path| probe(path, &Limits::default()));
        let _ = read_all(&bytes);
    }
}
