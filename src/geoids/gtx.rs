//! NOAA's GTX: a head of 40 bytes and the numbers from the south-west, all with the high byte first.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;

use super::GeoidFileError;
use super::parts::{Layout, Parts, PartwiseNodes};
use crate::geometry::GeoidGrid;
use crate::geometry::geoid::{GridPage, GridPlace};

const HEAD_BYTES: u64 = 40;
/// What stands where there is no number.
const NOTHING: f32 = -88.8888;
/// No undulation is that large: PROJ takes such numbers for none, and so is it done here.
const LARGEST_M: f32 = 1000.0;
/// About so many numbers are read at a time.
const NUMBERS_AT_A_TIME: usize = 1 << 16;

pub(super) fn open(path: &Path) -> Result<GeoidGrid, GeoidFileError> {
    let mut file = File::open(path)?;
    let mut head = [0; HEAD_BYTES as usize];
    file.read_exact(&mut head)
        .map_err(|_| GeoidFileError::NoGrid("it is shorter than the head of a GTX".to_owned()))?;
    let double = |at: usize| f64::from_be_bytes(std::array::from_fn(|k| head[at + k]));
    let count = |at: usize| usize::try_from(i32::from_be_bytes(std::array::from_fn(|k| head[at + k]))).unwrap_or(0);
    let place = GridPlace {
        south_deg: double(0),
        west_deg: double(8),
        step_latitude_deg: double(16),
        step_longitude_deg: double(24),
        rows: count(32),
        columns: count(36),
    };
    place.check().map_err(GeoidFileError::NoGrid)?;
    let expected = HEAD_BYTES + 4 * place.rows as u64 * place.columns as u64;
    let length = file.metadata()?.len();
    if length != expected {
        let detail = format!("it has {length} bytes; {} x {} numbers make {expected}", place.columns, place.rows);
        return Err(GeoidFileError::NoGrid(detail));
    }
    let rows_at_a_time = (NUMBERS_AT_A_TIME / place.columns).clamp(1, place.rows);
    let layout = Layout {
        columns: place.columns,
        rows: place.rows,
        part_columns: place.columns,
        part_rows: rows_at_a_time,
        from_north: false,
    };
    let nodes = PartwiseNodes::new(layout, Box::new(Gtx { file, layout }))?;
    let page = GridPage::new(place, Box::new(nodes)).map_err(GeoidFileError::NoGrid)?;
    Ok(GeoidGrid::new(vec![page]))
}

struct Gtx {
    file: File,
    layout: Layout,
}

impl Parts for Gtx {
    fn read(&mut self, part: usize) -> Result<Vec<f32>, GeoidFileError> {
        let first_row = part * self.layout.part_rows;
        let rows = self.layout.part_rows.min(self.layout.rows.saturating_sub(first_row));
        let mut bytes = vec![0; 4 * rows * self.layout.columns];
        self.file.seek(SeekFrom::Start(HEAD_BYTES + 4 * (first_row * self.layout.columns) as u64))?;
        self.file.read_exact(&mut bytes)?;
        let number = |bytes: &[u8; 4]| {
            let number = f32::from_be_bytes(*bytes);
            if number == NOTHING || number.abs() > LARGEST_M { f32::NAN } else { number }
        };
        Ok(bytes.as_chunks::<4>().0.iter().map(number).collect())
    }
}
