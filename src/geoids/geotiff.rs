//! The GeoTIFF grids of PROJ (<https://proj.org/en/stable/specifications/geodetictiffgrids.html>).

mod metadata;

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

use self::metadata::Metadata;
use super::GeoidFileError;
use super::parts::{Layout, MOST_NUMBERS, Parts, PartwiseNodes};
use crate::geometry::GeoidGrid;
use crate::geometry::geoid::{GridPage, GridPlace};

/// More pages in one file are not met: such a file is refused, as its last ones might be those that are needed.
const MOST_PAGES: usize = 256;

const MODEL_TYPE: u16 = 1024;
const GEOGRAPHIC: u16 = 2;
const RASTER_TYPE: u16 = 1025;
const PIXEL_IS_POINT: u16 = 2;
/// GDAL's description of what the numbers mean, as XML.
const GDAL_METADATA: Tag = Tag::Unknown(42112);
/// Bits of a page's kind: it repeats another one with fewer pixels, or masks it.
const REDUCED_OR_MASK: u32 = 0b101;

type Reader = Decoder<BufReader<File>>;

pub(super) fn open(path: &Path) -> Result<GeoidGrid, GeoidFileError> {
    let mut pages = Vec::new();
    for number in 0.. {
        if number == MOST_PAGES {
            return Err(no_grid(format!("it has more than {MOST_PAGES} pages; a geoid grid has at most that many")));
        }
        let mut reader = reader(path)?;
        if number > 0 {
            reader.seek_to_image(number)?;
        }
        let more = reader.more_images();
        if reader.find_tag_unsigned::<u32>(Tag::NewSubfileType)?.unwrap_or(0) & REDUCED_OR_MASK == 0 {
            pages.push(page(reader)?);
        }
        if !more {
            break;
        }
    }
    if pages.is_empty() { Err(no_grid("it has no page with numbers of its own")) } else { Ok(GeoidGrid::new(pages)) }
}

fn reader(path: &Path) -> Result<Reader, GeoidFileError> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = 8 * MOST_NUMBERS;
    limits.intermediate_buffer_size = 8 * MOST_NUMBERS;
    Ok(Decoder::new(BufReader::new(File::open(path)?))?.with_limits(limits))
}

fn page(mut reader: Reader) -> Result<GridPage, GeoidFileError> {
    let samples = reader.find_tag_unsigned::<u32>(Tag::SamplesPerPixel)?.unwrap_or(1);
    if samples != 1 {
        return Err(no_grid(format!("it has {samples} numbers a pixel; a geoid grid has one")));
    }
    let text = |tag, reader: &mut Reader| match reader.find_tag(tag) {
        Ok(Some(value)) => value.into_string().map(Some),
        Ok(None) => Ok(None),
        Err(error) => Err(error),
    };
    let metadata = Metadata::read(&text(GDAL_METADATA, &mut reader)?.unwrap_or_default()).map_err(no_grid)?;
    if let Some(other) = metadata.kind.as_deref().filter(|kind| *kind != "VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL") {
        return Err(no_grid(format!("it is of the TYPE {other}, not VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL")));
    }
    let nothing = text(Tag::GdalNodata, &mut reader)?;
    let nothing = nothing.and_then(|text| text.trim_matches(['\0', ' ']).parse::<f64>().ok());
    let (columns, rows) = reader.dimensions()?;
    let place = place(&mut reader, columns as usize, rows as usize)?;
    let (part_columns, part_rows) = reader.chunk_dimensions();
    let layout = Layout {
        columns: place.columns,
        rows: place.rows,
        // a strip may say that it is wider or higher than the whole
        part_columns: part_columns as usize,
        part_rows: (part_rows as usize).min(place.rows),
        from_north: true,
    };
    let source = GeoTiff { reader, nothing, scale: metadata.scale, offset: metadata.offset };
    let nodes = PartwiseNodes::new(layout, Box::new(source))?;
    GridPage::new(place, Box::new(nodes)).map_err(no_grid)
}

/// Where the nodes lie, by the tags of GeoTIFF (OGC 19-008r4).
fn place(reader: &mut Reader, columns: usize, rows: usize) -> Result<GridPlace, GeoidFileError> {
    let mut numbers = |tag| match reader.find_tag(tag) {
        Ok(Some(value)) => value.into_f64_vec(),
        Ok(None) => Ok(Vec::new()),
        Err(error) => Err(error),
    };
    let (scale, tie) = (numbers(Tag::ModelPixelScaleTag)?, numbers(Tag::ModelTiepointTag)?);
    let transformation = numbers(Tag::ModelTransformationTag)?;
    let keys = reader.find_tag_unsigned_vec::<u16>(Tag::GeoKeyDirectoryTag)?.unwrap_or_default();
    let key = |wanted: u16| {
        let entries = keys.as_chunks::<4>().0.iter().skip(1);
        entries.copied().find_map(|[key, place, _, value]| (key == wanted && place == 0).then_some(value))
    };
    if key(MODEL_TYPE).is_some_and(|model| model != GEOGRAPHIC) {
        return Err(no_grid("it is not in longitude and latitude"));
    }
    let (east, south, [west_deg, north_deg]) = match (transformation.as_slice(), scale.as_slice()) {
        (&[a, b, _, x, d, e, _, y, ..], _) => {
            if b != 0.0 || d != 0.0 {
                return Err(no_grid("its rows do not run along the parallels"));
            }
            (a, -e, [x, y])
        }
        (_, &[across, along, ..]) => match tie.as_slice() {
            &[column, row, _, x, y, ..] => (across, along, [x - column * across, y + row * along]),
            _ => return Err(no_grid("it does not say where on Earth it lies")),
        },
        _ => return Err(no_grid("it does not say where on Earth it lies")),
    };
    // the centres of the pixels are the nodes
    let half = if key(RASTER_TYPE) == Some(PIXEL_IS_POINT) { 0.0 } else { 0.5 };
    Ok(GridPlace {
        west_deg: west_deg + half * east,
        south_deg: north_deg - half * south - south * (rows.max(1) - 1) as f64,
        step_longitude_deg: east,
        step_latitude_deg: south,
        columns,
        rows,
    })
}

struct GeoTiff {
    reader: Reader,
    nothing: Option<f64>,
    scale: f64,
    offset: f64,
}

impl Parts for GeoTiff {
    fn read(&mut self, part: usize) -> Result<Vec<f32>, GeoidFileError> {
        let part = u32::try_from(part).map_err(|_| no_grid("it has too many parts"))?;
        Ok(match self.reader.read_chunk(part)? {
            DecodingResult::F32(numbers) => self.undulations(numbers),
            DecodingResult::F64(numbers) => self.undulations(numbers),
            DecodingResult::I16(numbers) => self.undulations(numbers),
            DecodingResult::U16(numbers) => self.undulations(numbers),
            DecodingResult::I32(numbers) => self.undulations(numbers),
            DecodingResult::U32(numbers) => self.undulations(numbers),
            _ => return Err(no_grid("its numbers are of a kind that no geoid grid has")),
        })
    }
}

impl GeoTiff {
    fn undulations<T: Copy + Into<f64>>(&self, numbers: Vec<T>) -> Vec<f32> {
        let undulation = |number: T| {
            let number: f64 = number.into();
            // the text may have fewer digits than the number
            let is_nothing = self.nothing.is_some_and(|nothing| nothing == number || nothing as f32 == number as f32);
            if is_nothing { f32::NAN } else { (number * self.scale + self.offset) as f32 }
        };
        numbers.into_iter().map(undulation).collect()
    }
}

fn no_grid(detail: impl Into<String>) -> GeoidFileError {
    GeoidFileError::NoGrid(detail.into())
}
