//! The geometry of a row: the header of GeoPackage, and well-known binary (WKB) after it.
//!
//! It comes from strangers: no count is believed beyond what the bytes can hold, and nothing lies deeper than the parts
//! of a geometry of many.

use crate::buildings::FARTHEST;

/// Lines or surfaces, in the order east or longitude, north or latitude, up, which is that of every GeoPackage.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Shape {
    /// The points of each line.
    Lines(Vec<Vec<[f64; 3]>>),
    /// The rings of each polygon, the outer one first, without their first point once more at their end.
    Polygons(Vec<Vec<Vec<[f64; 3]>>>),
}

/// What a geometry has at least: its byte order, its type, and a count.
const LEAST_GEOMETRY: usize = 9;
/// What a ring has at least: its count.
const LEAST_RING: usize = 4;

const LINE: u32 = 2;
const POLYGON: u32 = 3;
const LINES: u32 = 5;
const POLYGONS: u32 = 6;

/// Reads the geometry of a row in a table whose CRS has the number `srs_id` in its file.
///
/// # Errors
/// What is wrong with it and what would be right.
pub(super) fn shape(blob: &[u8], srs_id: i64) -> Result<Shape, String> {
    let mut bytes = Bytes { rest: blob, little_endian: true };
    header(&mut bytes, srs_id)?;
    let Head { kind, dimensions } = bytes.head()?;
    let shape = match kind {
        LINE => Shape::Lines(vec![bytes.line(dimensions)?]),
        POLYGON => Shape::Polygons(vec![bytes.polygon(dimensions)?]),
        LINES => Shape::Lines(bytes.parts(LINE, Bytes::line)?),
        POLYGONS => Shape::Polygons(bytes.parts(POLYGON, Bytes::polygon)?),
        other => {
            return Err(format!(
                "its geometry is a {}; it must be a LineString, MultiLineString, Polygon or MultiPolygon with Z",
                kind_name(other)
            ));
        }
    };
    match bytes.rest.len() {
        0 => Ok(shape),
        more => Err(format!("its geometry has {more} bytes after its end")),
    }
}

/// Passes over the header of GeoPackage.
fn header(bytes: &mut Bytes<'_>, srs_id: i64) -> Result<(), String> {
    let magic: [u8; 2] = bytes.array()?;
    if magic != *b"GP" {
        return Err("its geometry does not begin with GP, so it is none of a GeoPackage".to_owned());
    }
    let [version, flags] = bytes.array()?;
    if version != 0 {
        return Err(format!("its geometry has version {version} of GeoPackage's binary; 0 is read"));
    }
    if flags & 0b10_0000 != 0 {
        return Err("its geometry is of an extension of GeoPackage, which is not read".to_owned());
    }
    if flags & 0b1_0000 != 0 {
        return Err("its geometry is empty".to_owned());
    }
    bytes.little_endian = flags & 1 == 1;
    let own = i64::from(bytes.number()?.cast_signed());
    // 0 and -1 say nothing
    if own != srs_id && own != 0 && own != -1 {
        return Err(format!("its geometry is in the CRS of srs_id {own}, but its table is in that of {srs_id}"));
    }
    let envelope = match flags >> 1 & 0b111 {
        0 => 0,
        1 => 32,
        2 | 3 => 48,
        4 => 64,
        other => return Err(format!("its geometry has an envelope of kind {other}; there are 0 to 4")),
    };
    bytes.take(envelope).map(|_| ())
}

fn kind_name(kind: u32) -> String {
    match kind {
        1 => "Point".to_owned(),
        LINE => "LineString".to_owned(),
        POLYGON => "Polygon".to_owned(),
        4 => "MultiPoint".to_owned(),
        LINES => "MultiLineString".to_owned(),
        POLYGONS => "MultiPolygon".to_owned(),
        7 => "GeometryCollection".to_owned(),
        other => format!("geometry of type {other}"),
    }
}

/// What a geometry of WKB begins with.
struct Head {
    kind: u32,
    /// Numbers of a position: three, or four if each has a measure.
    dimensions: usize,
}

/// What is still to be read, and in which order its bytes are.
struct Bytes<'b> {
    rest: &'b [u8],
    little_endian: bool,
}

impl<'b> Bytes<'b> {
    fn take(&mut self, count: usize) -> Result<&'b [u8], String> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or("its geometry ends too early")?;
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (taken, rest) = self.rest.split_first_chunk().ok_or("its geometry ends too early")?;
        self.rest = rest;
        Ok(*taken)
    }

    fn number(&mut self) -> Result<u32, String> {
        let bytes = self.array()?;
        Ok(if self.little_endian { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    /// A count of things that have at least `least` bytes each.
    fn count(&mut self, least: usize) -> Result<usize, String> {
        let count = self.number()? as usize;
        match count <= self.rest.len() / least {
            true => Ok(count),
            false => Err(format!("its geometry claims {count} parts or points, for which it has not enough bytes")),
        }
    }

    /// Byte order and type, as ISO writes them or with the flags of EWKB.
    fn head(&mut self) -> Result<Head, String> {
        const Z: u32 = 0x8000_0000;
        const M: u32 = 0x4000_0000;
        const SRID: u32 = 0x2000_0000;
        self.little_endian = match self.array()? {
            [0] => false,
            [1] => true,
            [other] => return Err(format!("its geometry has the byte order {other}; it may be 0 or 1")),
        };
        let code = self.number()?;
        if code & SRID != 0 {
            self.number()?;
        }
        let base = code & !(Z | M | SRID);
        let (of_iso, kind) = (base / 1_000, base % 1_000);
        if of_iso > 3 {
            return Err(format!("its geometry has the type {code}, which is not known"));
        }
        let with_height = code & Z != 0 || of_iso == 1 || of_iso == 3;
        let with_measure = code & M != 0 || of_iso >= 2;
        // what is no line and no surface would not be of use with heights either
        if !with_height && matches!(kind, LINE | POLYGON | LINES | POLYGONS) {
            return Err(format!("its {} has two dimensions: the heights are missing, Z is needed", kind_name(kind)));
        }
        Ok(Head { kind, dimensions: if with_measure { 4 } else { 3 } })
    }

    /// The parts of a geometry of many, all of one kind. They have no parts.
    fn parts<T>(&mut self, kind: u32, read: impl Fn(&mut Self, usize) -> Result<T, String>) -> Result<Vec<T>, String> {
        let count = self.count(LEAST_GEOMETRY)?;
        (0..count)
            .map(|part| {
                let head = self.head()?;
                match head.kind == kind {
                    true => read(self, head.dimensions),
                    false => Err(format!(
                        "part {part} of its geometry is a {}; it must be a {}",
                        kind_name(head.kind),
                        kind_name(kind)
                    )),
                }
            })
            .collect()
    }

    fn line(&mut self, dimensions: usize) -> Result<Vec<[f64; 3]>, String> {
        let count = self.count(8 * dimensions)?;
        (0..count).map(|_| self.position(dimensions)).collect()
    }

    fn polygon(&mut self, dimensions: usize) -> Result<Vec<Vec<[f64; 3]>>, String> {
        let rings = self.count(LEAST_RING)?;
        if rings == 0 {
            return Err("its geometry has a polygon without a ring".to_owned());
        }
        (0..rings)
            .map(|_| {
                let mut ring = self.line(dimensions)?;
                if ring.len() > 1 && ring.first() == ring.last() {
                    ring.pop();
                }
                Ok(ring)
            })
            .collect()
    }

    fn position(&mut self, dimensions: usize) -> Result<[f64; 3], String> {
        let mut position = [0.0; 3];
        for value in &mut position {
            let bytes = self.array()?;
            *value = if self.little_endian { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) };
            // not a number is none of them either
            if !(-FARTHEST..=FARTHEST).contains(value) {
                return Err(format!("its geometry has the coordinate {value}; all must be within ±{FARTHEST:e}"));
            }
        }
        self.take(8 * (dimensions - 3))?;
        Ok(position)
    }
}
