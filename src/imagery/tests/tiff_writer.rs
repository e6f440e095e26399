//! Writes TIFF structures byte by byte: the variants that no encoder at hand can write.

/// The values of a directory entry.
#[derive(Debug, Clone)]
pub(super) enum Field {
    Bytes(Vec<u8>),
    Ascii(&'static str),
    Shorts(Vec<u16>),
    /// Offsets and lengths: 32 bits, or 64 in a BigTIFF.
    Longs(Vec<u64>),
    Rationals(Vec<(u32, u32)>),
}

/// A TIFF or BigTIFF in the making.
#[derive(Debug)]
pub(super) struct TiffBytes {
    pub(super) bytes: Vec<u8>,
    big_endian: bool,
    big: bool,
}

impl TiffBytes {
    /// The header, whose offset of the first directory is still open.
    pub(super) fn new(big_endian: bool, big: bool) -> Self {
        let mut tiff = Self { bytes: if big_endian { b"MM".to_vec() } else { b"II".to_vec() }, big_endian, big };
        tiff.short(if big { 43 } else { 42 });
        if big {
            tiff.short(8);
            tiff.short(0);
        }
        tiff.long(0);
        tiff
    }

    pub(super) fn short(&mut self, value: u16) {
        self.bytes.extend(if self.big_endian { value.to_be_bytes() } else { value.to_le_bytes() });
    }

    fn word(&mut self, value: u32) {
        self.bytes.extend(if self.big_endian { value.to_be_bytes() } else { value.to_le_bytes() });
    }

    fn long(&mut self, value: u64) {
        if self.big {
            self.bytes.extend(if self.big_endian { value.to_be_bytes() } else { value.to_le_bytes() });
        } else {
            self.word(value as u32);
        }
    }

    /// Appends a directory, its entries in the order of their tags, and returns where it begins.
    pub(super) fn directory(&mut self, entries: &[(u16, Field)]) -> u64 {
        let inline = if self.big { 8 } else { 4 };
        let mut lines = Vec::new();
        for (tag, field) in entries {
            let start = self.bytes.len();
            let (kind, count) = self.values(field);
            let mut value = self.bytes.split_off(start);
            if value.len() > inline {
                self.bytes.append(&mut value);
                self.long(start as u64);
                value = self.bytes.split_off(self.bytes.len() - inline);
            }
            value.resize(inline, 0);
            lines.push((*tag, kind, count, value));
        }
        let offset = self.bytes.len() as u64;
        if self.big {
            self.long(lines.len() as u64);
        } else {
            self.short(lines.len() as u16);
        }
        for (tag, kind, count, value) in lines {
            self.short(tag);
            self.short(kind);
            self.long(count as u64);
            self.bytes.extend(value);
        }
        self.long(0);
        offset
    }

    fn values(&mut self, field: &Field) -> (u16, usize) {
        match field {
            Field::Bytes(values) => {
                self.bytes.extend(values);
                (1, values.len())
            }
            Field::Ascii(text) => {
                self.bytes.extend(text.bytes().chain([0]));
                (2, text.len() + 1)
            }
            Field::Shorts(values) => {
                values.iter().for_each(|&value| self.short(value));
                (3, values.len())
            }
            Field::Longs(values) => {
                values.iter().for_each(|&value| self.long(value));
                (if self.big { 16 } else { 4 }, values.len())
            }
            Field::Rationals(values) => {
                values.iter().for_each(|&(numerator, denominator)| {
                    self.word(numerator);
                    self.word(denominator);
                });
                (5, values.len())
            }
        }
    }

    /// The file, whose first directory begins at `offset`.
    pub(super) fn finish(mut self, offset: u64) -> Vec<u8> {
        let rest = self.bytes.split_off(if self.big { 8 } else { 4 });
        self.long(offset);
        let header = self.bytes.len();
        self.bytes.extend(&rest[header - if self.big { 8 } else { 4 }..]);
        self.bytes
    }
}

/// An Exif block with this GPS directory.
pub(super) fn exif_block(gps: &[(u16, Field)]) -> Vec<u8> {
    let mut tiff = TiffBytes::new(false, false);
    let gps = tiff.directory(gps);
    let first = tiff.directory(&[(0x8825, Field::Longs(vec![gps]))]);
    tiff.finish(first)
}

/// How a picture is to be stored.
#[derive(Debug, Clone)]
pub(super) struct Variant {
    pub(super) big_endian: bool,
    pub(super) big: bool,
    /// Columns and rows of a tile; strips of so many rows where there are no columns.
    pub(super) chunk: (Option<u32>, u32),
    pub(super) deep: bool,
    /// 0 white is zero, 1 black is zero, 2 RGB.
    pub(super) photometric: u16,
    pub(super) samples: u16,
    pub(super) planar: bool,
    /// Entries beyond the usual ones.
    pub(super) more: Vec<(u16, Field)>,
}

impl Default for Variant {
    fn default() -> Self {
        let chunk = (None, 10);
        let (photometric, samples) = (2, 3);
        Self { big_endian: false, big: false, chunk, deep: false, photometric, samples, planar: false, more: vec![] }
    }
}

/// Writes a picture without compression; `sample(x, y, s)` is its sample `s`, of which 8-bit files take the lower half.
pub(super) fn write(variant: &Variant, [width, height]: [u32; 2], sample: impl Fn(u32, u32, u16) -> u16) -> Vec<u8> {
    let mut tiff = TiffBytes::new(variant.big_endian, variant.big);
    let (tile_width, rows) = variant.chunk;
    let columns = tile_width.unwrap_or(width);
    let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
    let samples_in_plane = if variant.planar { 1 } else { variant.samples };
    for first in (0..variant.samples).step_by(samples_in_plane.into()) {
        for top in (0..height).step_by(rows as usize) {
            for left in (0..width).step_by(columns as usize) {
                let start = tiff.bytes.len();
                let bottom = if tile_width.is_some() { top + rows } else { height.min(top + rows) };
                for (y, x) in (top..bottom).flat_map(|y| (left..left + columns).map(move |x| (y, x))) {
                    for s in first..first + samples_in_plane {
                        let value = if x < width && y < height { sample(x, y, s) } else { 0xAAAA };
                        if variant.deep { tiff.short(value) } else { tiff.bytes.push(value as u8) }
                    }
                }
                offsets.push(start as u64);
                lengths.push((tiff.bytes.len() - start) as u64);
            }
        }
    }
    let bits = if variant.deep { 16 } else { 8 };
    let short = |value: u16| Field::Shorts(vec![value]);
    let long = |value: u32| Field::Longs(vec![value.into()]);
    let mut entries = vec![
        (256, long(width)),
        (257, long(height)),
        (258, Field::Shorts(vec![bits; variant.samples.into()])),
        (259, short(1)),
        (262, short(variant.photometric)),
        (277, short(variant.samples)),
        (284, short(if variant.planar { 2 } else { 1 })),
    ];
    if tile_width.is_some() {
        let tile =
            [(322, long(columns)), (323, long(rows)), (324, Field::Longs(offsets)), (325, Field::Longs(lengths))];
        entries.extend(tile);
    } else {
        entries.extend([(273, Field::Longs(offsets)), (278, long(rows)), (279, Field::Longs(lengths))]);
    }
    let colours = if variant.photometric == 2 { 3 } else { 1 };
    if variant.samples > colours {
        entries.push((338, Field::Shorts(vec![2; (variant.samples - colours).into()])));
    }
    entries.extend(variant.more.iter().cloned());
    entries.sort_by_key(|&(tag, _)| tag);
    let first = tiff.directory(&entries);
    tiff.finish(first)
}
