//! A scan as a TIFF file, written a row of tiles or a strip at a time, so that it is never held whole.

use std::io::{self, Seek, SeekFrom, Write};

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::scan::{SimulatedScan, rounded};
use crate::features::{Picture, PixelRect};

/// How the pixels are cut into pieces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pieces {
    /// Squares of so many pixels a side, a multiple of 16.
    Tiles(u32),
    /// So many rows at a time.
    Strips(u32),
}

/// How a scan is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TiffSettings {
    /// Tiles or strips.
    pub pieces: Pieces,
    /// 16 bits a sample instead of 8; white is 65535.
    pub deep: bool,
    /// Red, green and blue (all the same) instead of grey.
    pub colour: bool,
    /// Compressed by Deflate.
    pub deflate: bool,
}

impl Default for TiffSettings {
    fn default() -> Self {
        Self { pieces: Pieces::Tiles(256), deep: false, colour: false, deflate: false }
    }
}

impl TiffSettings {
    fn samples(&self) -> u16 {
        if self.colour { 3 } else { 1 }
    }

    /// The bytes of pixels, little-endian.
    fn bytes(&self, pixels: impl Iterator<Item = f32>, bytes: &mut Vec<u8>) {
        for grey in pixels {
            for _ in 0..self.samples() {
                if self.deep {
                    // the conversion cuts off at both ends
                    bytes.extend(((257.0 * grey + 0.5) as u16).to_le_bytes());
                } else {
                    bytes.push(rounded(grey) as u8);
                }
            }
        }
    }
}

/// Where the pieces lie in the file.
#[derive(Debug, Default)]
struct Written {
    offsets: Vec<u32>,
    lengths: Vec<u32>,
}

/// Writes a scan as a TIFF (little-endian, below 4 GB), with the resolution that its stated pixel size makes.
///
/// # Errors
/// What the target answers; [`io::ErrorKind::FileTooLarge`] where 32 bits do not hold an offset.
pub fn write_tiff<W: Write + Seek>(scan: &SimulatedScan, settings: &TiffSettings, target: &mut W) -> io::Result<()> {
    let [width, height] = scan.size_px();
    let (columns, rows) = match settings.pieces {
        Pieces::Tiles(side) => (side.max(16), side.max(16)),
        Pieces::Strips(rows) => (width.max(1), rows.max(1)),
    };
    // the place of the directory is filled in at the end
    target.write_all(b"II*\0\0\0\0\0")?;
    let mut written = Written::default();
    for top in (0..height).step_by(rows as usize) {
        let band = PixelRect { x: 0, y: top, width, height: rows.min(height - top) };
        let pixels = scan.pixels(band);
        for left in (0..width).step_by(columns as usize) {
            let bytes = piece(&pixels, width, [left, columns, rows], settings);
            written.offsets.push(position(target)?);
            written.lengths.push(write_piece(&bytes, settings.deflate, target)?);
        }
    }
    let directory = directory(scan, settings, [columns, rows], &written);
    write_directory(&directory, target)?;
    target.flush()
}

/// The bytes of a tile, filled up beyond the scan by its last pixels, or of a strip.
fn piece(pixels: &[f32], width: u32, [left, columns, rows]: [u32; 3], settings: &TiffSettings) -> Vec<u8> {
    let mut bytes = Vec::new();
    let lines = pixels.chunks(width as usize);
    let missing = match settings.pieces {
        Pieces::Tiles(_) => (rows as usize).saturating_sub(lines.len()),
        Pieces::Strips(_) => 0,
    };
    let last = lines.clone().last().into_iter().cycle().take(missing);
    for line in lines.chain(last) {
        let part = (left..left + columns).map(|x| line.get(x.min(width - 1) as usize).copied().unwrap_or_default());
        settings.bytes(part, &mut bytes);
    }
    bytes
}

fn write_piece<W: Write + Seek>(bytes: &[u8], deflate: bool, target: &mut W) -> io::Result<u32> {
    let begin = position(target)?;
    if deflate {
        let mut encoder = ZlibEncoder::new(&mut *target, Compression::fast());
        encoder.write_all(bytes)?;
        encoder.finish()?;
    } else {
        target.write_all(bytes)?;
    }
    Ok(position(target)? - begin)
}

fn position(target: &mut impl Seek) -> io::Result<u32> {
    u32::try_from(target.stream_position()?).map_err(|_| io::Error::from(io::ErrorKind::FileTooLarge))
}

/// The values of a tag.
#[derive(Debug)]
enum Values {
    Short(Vec<u16>),
    Long(Vec<u32>),
    Rational([u32; 2]),
}

impl Values {
    /// Kind, count and bytes.
    fn encoded(&self) -> (u16, usize, Vec<u8>) {
        let longs = |values: &[u32]| values.iter().flat_map(|value| value.to_le_bytes()).collect();
        match self {
            Self::Short(values) => (3, values.len(), values.iter().flat_map(|value| value.to_le_bytes()).collect()),
            Self::Long(values) => (4, values.len(), longs(values)),
            Self::Rational(values) => (5, 1, longs(values)),
        }
    }
}

/// The tags in ascending order.
fn directory(
    scan: &SimulatedScan,
    settings: &TiffSettings,
    [columns, rows]: [u32; 2],
    written: &Written,
) -> Vec<(u16, Values)> {
    let [width, height] = scan.size_px();
    let short = |value: u16| Values::Short(vec![value]);
    let long = |value: u32| Values::Long(vec![value]);
    let bits = if settings.deep { 16 } else { 8 };
    // pixels in a centimetre, to a hundred-thousandth of a micrometre
    let resolution = [1_000_000_000, (scan.nominal_pixel_um() * 100_000.0).round() as u32];
    let mut tags = vec![
        (256, long(width)),
        (257, long(height)),
        (258, Values::Short(vec![bits; settings.samples().into()])),
        (259, short(if settings.deflate { 8 } else { 1 })),
        (262, short(if settings.colour { 2 } else { 1 })),
        (277, short(settings.samples())),
        (282, Values::Rational(resolution)),
        (283, Values::Rational(resolution)),
        (284, short(1)),
        // centimetres
        (296, short(3)),
    ];
    let (offsets, lengths) = (Values::Long(written.offsets.clone()), Values::Long(written.lengths.clone()));
    match settings.pieces {
        Pieces::Tiles(_) => {
            tags.extend([(322, long(columns)), (323, long(rows)), (324, offsets), (325, lengths)]);
        }
        Pieces::Strips(_) => tags.extend([(273, offsets), (278, long(rows)), (279, lengths)]),
    }
    tags.sort_by_key(|&(tag, _)| tag);
    tags
}

/// Appends the directory, and enters its place in the header.
fn write_directory<W: Write + Seek>(directory: &[(u16, Values)], target: &mut W) -> io::Result<()> {
    let mut lines = Vec::new();
    for (tag, values) in directory {
        let (kind, count, mut bytes) = values.encoded();
        if bytes.len() > 4 {
            let place = position(target)?;
            target.write_all(&bytes)?;
            bytes = place.to_le_bytes().to_vec();
        }
        bytes.resize(4, 0);
        lines.extend(tag.to_le_bytes());
        lines.extend(kind.to_le_bytes());
        lines.extend((count as u32).to_le_bytes());
        lines.extend(bytes);
    }
    // a directory begins on an even byte
    if position(target)? % 2 == 1 {
        target.write_all(&[0])?;
    }
    let place = position(target)?;
    target.write_all(&(directory.len() as u16).to_le_bytes())?;
    target.write_all(&lines)?;
    target.write_all(&[0; 4])?;
    target.seek(SeekFrom::Start(4))?;
    target.write_all(&place.to_le_bytes())?;
    target.seek(SeekFrom::End(0))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulation::film::{Laying, Make, ScanSettings};
    use std::io::Cursor;
    use tiff::decoder::{Decoder, DecodingResult};
    use tiff::tags::Tag;

    #[test]
    fn all_ways_of_storing_a_scan_hold_its_pixels_and_its_resolution() {
        let mut settings = ScanSettings::good(Make::WildRc20, Laying::default());
        settings.scanner.pixel_um = [400.0, 400.0];
        let scan = SimulatedScan::draw(4, &settings);
        let [width, height] = scan.size_px();
        let whole = PixelRect { x: 0, y: 0, width, height };
        let (grey, fine) = (scan.window(whole, 1).unwrap().grey, scan.pixels(whole));
        for k in 0..16 {
            let [deep, colour, deflate, tiles] = [1, 2, 4, 8].map(|bit| k & bit != 0);
            let pieces = if tiles { Pieces::Tiles(256) } else { Pieces::Strips(100) };
            let mut file = Cursor::new(Vec::new());
            write_tiff(&scan, &TiffSettings { pieces, deep, colour, deflate }, &mut file).unwrap();
            file.set_position(0);
            let mut decoder = Decoder::new(file).unwrap();
            assert_eq!(decoder.dimensions().unwrap(), (width, height));
            let samples = if colour { 3 } else { 1 };
            match decoder.read_image().unwrap() {
                DecodingResult::U8(stored) => {
                    assert!(!deep && stored.len() == samples * grey.len());
                    assert!(stored.chunks(samples).zip(&grey).all(|(pixel, grey)| f32::from(pixel[0]) == *grey));
                }
                DecodingResult::U16(stored) => {
                    assert!(deep && stored.len() == samples * grey.len());
                    let near = |pixel: &[u16], grey: f32| (f32::from(pixel[0]) / 257.0 - grey.clamp(0.0, 255.0)).abs();
                    assert!(stored.chunks(samples).zip(&fine).all(|(pixel, grey)| near(pixel, *grey) < 0.01));
                }
                other => panic!("{other:?}"),
            }
            assert_eq!(decoder.get_tag_u32(Tag::ResolutionUnit).unwrap(), 3);
            let resolution = format!("{:?}", decoder.get_tag(Tag::XResolution).unwrap());
            assert!(resolution.contains("1000000000") && resolution.contains("40000000"), "{resolution}");
        }
    }
}
