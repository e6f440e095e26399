//! What headers tell: formats, sizes, positions and headings.

use rstest::rstest;

use super::formats::encode_png;
use super::pattern::{HEIGHT, WIDTH, fixture, grey, with_file};
use super::tiff_writer::{Field, TiffBytes, Variant, exif_block, write};
use crate::imagery::{ExifHeading, ExifPosition, Format, Limits, North, Probe, probe};

fn probed(bytes: &[u8]) -> Probe {
    with_file(bytes, |path| probe(path, &Limits::default())).unwrap()
}

/// 30° 10' 16.14" N, 98° 5' 23.526" W, 318.9 m, looking to 271.5° magnetic.
fn gps() -> Vec<(u16, Field)> {
    vec![
        (1, Field::Ascii("N")),
        (2, Field::Rationals(vec![(30, 1), (10, 1), (16_140, 1000)])),
        (3, Field::Ascii("W")),
        (4, Field::Rationals(vec![(98, 1), (5, 1), (23_526, 1000)])),
        (5, Field::Bytes(vec![0])),
        (6, Field::Rationals(vec![(3189, 10)])),
        (16, Field::Ascii("M")),
        (17, Field::Rationals(vec![(2715, 10)])),
        (31, Field::Rationals(vec![(45, 10)])),
    ]
}

fn with(tag: u16, field: &Field) -> Vec<(u16, Field)> {
    gps().into_iter().map(|(t, f)| if t == tag { (t, field.clone()) } else { (t, f) }).collect()
}

fn without(tag: u16) -> Vec<(u16, Field)> {
    gps().into_iter().filter(|&(t, _)| t != tag).collect()
}

/// A JPEG with these segments FF E1.
fn jpeg_with(segments: &[Vec<u8>]) -> Vec<u8> {
    let template = std::fs::read(fixture("420.jpg")).unwrap();
    let mut bytes = template[..2].to_vec();
    for segment in segments {
        bytes.extend([0xFF, 0xE1]);
        bytes.extend((segment.len() as u16 + 2).to_be_bytes());
        bytes.extend(segment);
    }
    bytes.extend(&template[2..]);
    bytes
}

fn jpeg_with_gps(gps: &[(u16, Field)]) -> Vec<u8> {
    jpeg_with(&[[b"Exif\0\0".to_vec(), exif_block(gps)].concat()])
}

fn png_with_gps(gps: &[(u16, Field)]) -> Vec<u8> {
    let mut bytes = encode_png(png::ColorType::Grayscale, png::BitDepth::Eight, &grey());
    let mut chunk = Vec::new();
    png::Writer::write_chunk(
        &mut png::Encoder::new(&mut chunk, 1, 1).write_header().unwrap(),
        png::chunk::ChunkType(*b"eXIf"),
        &exif_block(gps),
    )
    .unwrap();
    // Signature and header chunk take 33 bytes.
    let end = chunk.windows(4).position(|name| name == b"IEND").map_or(chunk.len(), |at| at - 4);
    bytes.splice(33..33, chunk[33..end].iter().copied());
    bytes
}

/// A TIFF whose GPS directory stands at its end.
fn tiff_with_gps(gps: &[(u16, Field)], big_endian: bool, big: bool) -> Vec<u8> {
    let variant = |pointer: u64| Variant {
        big_endian,
        big,
        more: vec![(0x8825, Field::Longs(vec![pointer]))],
        ..Variant::default()
    };
    let length = write(&variant(0), [WIDTH, HEIGHT], |_, _, _| 0).len();
    let mut tiff = TiffBytes::new(big_endian, big);
    tiff.bytes.resize(length, 0);
    let pointer = tiff.directory(gps);
    let mut bytes = write(&variant(pointer), [WIDTH, HEIGHT], |_, _, _| 0);
    bytes.extend(&tiff.bytes[length..]);
    bytes
}

fn assert_position(bytes: &[u8]) {
    let probe = probed(bytes);
    let position = probe.position.unwrap();
    approx::assert_abs_diff_eq!(position.latitude_deg, 30.0 + 10.0 / 60.0 + 16.14 / 3600.0, epsilon = 1e-12);
    approx::assert_abs_diff_eq!(position.longitude_deg, -(98.0 + 5.0 / 60.0 + 23.526 / 3600.0), epsilon = 1e-12);
    assert_eq!(position.altitude_m, Some(318.9));
    assert_eq!(position.horizontal_error_m, Some(4.5));
    assert_eq!(probe.heading, Some(ExifHeading { heading_deg: 271.5, north: North::Magnetic }));
}

#[test]
fn positions_in_all_formats() {
    assert_position(&jpeg_with_gps(&gps()));
    assert_position(&png_with_gps(&gps()));
    for (big_endian, big) in [(false, false), (true, false), (false, true), (true, true)] {
        assert_position(&tiff_with_gps(&gps(), big_endian, big));
    }
}

fn position(gps: &[(u16, Field)]) -> Option<ExifPosition> {
    let position = probed(&jpeg_with_gps(gps)).position;
    assert_eq!(probed(&tiff_with_gps(gps, true, false)).position, position);
    position
}

#[test]
fn signs_follow_the_references() {
    assert!(position(&with(1, &Field::Ascii("S"))).unwrap().latitude_deg < 0.0);
    assert!(position(&with(3, &Field::Ascii("E"))).unwrap().longitude_deg > 0.0);
    assert_eq!(position(&with(5, &Field::Bytes(vec![1]))).unwrap().altitude_m, Some(-318.9));
    assert_eq!(position(&without(6)).unwrap().altitude_m, None);
    assert_eq!(position(&without(31)).unwrap().horizontal_error_m, None);
}

#[rstest]
#[case(with(2, &Field::Rationals(vec![(30, 0), (10, 1), (16, 1)])))]
#[case(with(2, &Field::Rationals(vec![(90, 1), (10, 1), (16, 1)])))]
#[case(with(4, &Field::Rationals(vec![(181, 1), (0, 1), (0, 1)])))]
#[case(with(4, &Field::Rationals(vec![(98, 1), (5, 1), (23, 1), (7, 1)])))]
#[case(with(1, &Field::Ascii("?")))]
#[case(without(1))]
#[case(without(2))]
#[case(without(4))]
fn impossible_positions_are_none(#[case] gps: Vec<(u16, Field)>) {
    assert_eq!(position(&gps), None);
}

#[test]
fn a_receiver_without_a_fix_has_no_position() {
    let mut zero = with(2, &Field::Rationals(vec![(0, 1); 3]));
    zero.iter_mut().filter(|(tag, _)| *tag == 4).for_each(|(_, field)| *field = Field::Rationals(vec![(0, 1); 3]));
    assert_eq!(position(&zero), None);
}

#[rstest]
#[case(with(17, &Field::Rationals(vec![(400, 1)])), None)]
#[case(with(17, &Field::Rationals(vec![(1, 0)])), None)]
#[case(with(17, &Field::Rationals(vec![(360, 1)])), Some(ExifHeading { heading_deg: 0.0, north: North::Magnetic }))]
#[case(with(16, &Field::Ascii("T")), Some(ExifHeading { heading_deg: 271.5, north: North::True }))]
#[case(without(17), None)]
fn headings(#[case] gps: Vec<(u16, Field)>, #[case] expected: Option<ExifHeading>) {
    assert_eq!(probed(&jpeg_with_gps(&gps)).heading, expected);
}

#[rstest]
#[case(r#"<rdf drone-dji:FlightYawDegree="+12.5" drone-dji:GimbalYawDegree="-90.1"/>"#, Some(269.9))]
#[case("<drone-dji:FlightYawDegree>+12.5</drone-dji:FlightYawDegree>", Some(12.5))]
#[case(r#"<rdf drone-dji:FlightYawDegree="north"/>"#, None)]
#[case(r#"<rdf drone-dji:FlightYawDegree="inf"/>"#, None)]
#[case("drone-dji:GimbalYawDegree", None)]
fn yaw_of_drones(#[case] xmp: &str, #[case] heading_deg: Option<f64>) {
    let packet = |text: &str| [b"http://ns.adobe.com/xap/1.0/\0", text.as_bytes()].concat();
    let found = probed(&jpeg_with(&[packet(xmp)])).heading.map(|heading| heading.heading_deg);
    assert_eq!(found.map(|deg| (10.0 * deg).round() / 10.0), heading_deg);

    let more = vec![(700, Field::Bytes(xmp.as_bytes().to_vec()))];
    let tiff = write(&Variant { more, ..Variant::default() }, [WIDTH, HEIGHT], |_, _, _| 0);
    let found = probed(&tiff).heading.map(|heading| heading.heading_deg);
    assert_eq!(found.map(|deg| (10.0 * deg).round() / 10.0), heading_deg);
}

#[rstest]
#[case("DJI", "FC6310", Some("DJI FC6310"))]
#[case("Canon", "Canon EOS 5D", Some("Canon EOS 5D"))]
#[case("  Phase One ", "IXM-100", Some("Phase One IXM-100"))]
#[case("", "P1", Some("P1"))]
#[case("Leica", "", Some("Leica"))]
#[case("a\tb\r\nc", "d", Some("a b c d"))]
#[case("", " ", None)]
fn make_and_model_are_one_text(#[case] make: &'static str, #[case] model: &'static str, #[case] both: Option<&str>) {
    let entries = vec![(271, Field::Ascii(make)), (272, Field::Ascii(model))];
    let mut exif = TiffBytes::new(false, false);
    let first = exif.directory(&entries);
    let jpeg = jpeg_with(&[[b"Exif\0\0".to_vec(), exif.finish(first)].concat()]);
    assert_eq!(probed(&jpeg).camera_model.as_deref(), both);
    let tiff = write(&Variant { more: entries, ..Variant::default() }, [WIDTH, HEIGHT], |_, _, _| 0);
    assert_eq!(probed(&tiff).camera_model.as_deref(), both);
}

#[test]
fn a_make_without_end_is_cut() {
    let long: &'static str = "x".repeat(5000).leak();
    let more = vec![(271, Field::Ascii(long)), (272, Field::Ascii(long))];
    let tiff = write(&Variant { more, ..Variant::default() }, [WIDTH, HEIGHT], |_, _, _| 0);
    assert_eq!(probed(&tiff).camera_model, Some("x".repeat(64)));
}

#[rstest]
#[case("420.jpg", Format::Jpeg, 8)]
#[case("palette.png", Format::Png, 8)]
#[case("lzw_tiles_16.tif", Format::Tiff, 16)]
fn formats_and_sizes(#[case] name: &str, #[case] format: Format, #[case] bits: u8) {
    let found = probed(&std::fs::read(fixture(name)).unwrap());
    let expected = Probe {
        format,
        width_px: WIDTH,
        height_px: HEIGHT,
        bits,
        position: None,
        heading: None,
        pixel_size_um: None,
        camera_model: None,
        taken: None,
    };
    assert_eq!(found, expected);
}

#[rstest]
#[case::micrometres_by_centimetres([(1_000_000, 1_400); 2], Some(3), Some(14.0))]
#[case::inches([(1_270, 1); 2], Some(2), Some(20.0))]
#[case::inches_where_nothing_is_said([(1_270, 1); 2], None, Some(20.0))]
#[case::of_a_screen([(72, 1); 2], Some(2), None)]
#[case::oblong([(1_270, 1), (1_280, 1)], Some(2), None)]
#[case::without_unit([(1_270, 1); 2], Some(1), None)]
#[case::without_sense([(1_270, 0); 2], Some(2), None)]
fn resolutions_of_scans(
    #[case] resolutions: [(u32, u32); 2],
    #[case] unit: Option<u16>,
    #[case] pixel_size_um: Option<f64>,
) {
    let [across, down] = resolutions;
    let mut more = vec![(282, Field::Rationals(vec![across])), (283, Field::Rationals(vec![down]))];
    more.extend(unit.map(|unit| (296, Field::Shorts(vec![unit]))));
    let tiff = write(&Variant { more, ..Variant::default() }, [WIDTH, HEIGHT], |_, _, _| 0);
    let found = probed(&tiff).pixel_size_um;
    assert_eq!(found.map(|um| (1e6 * um).round() / 1e6), pixel_size_um);
}
