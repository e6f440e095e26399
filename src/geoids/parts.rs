//! Numbers that are read part by part, when they are first asked for.

use std::collections::HashMap;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use super::GeoidFileError;
use crate::geometry::geoid::Nodes;

/// A file whose numbers come in rectangles, tile by tile or strip by strip.
pub(super) trait Parts: Send {
    /// The numbers of a part, row by row; those that are none are NaN.
    fn read(&mut self, part: usize) -> Result<Vec<f32>, GeoidFileError>;
}

/// How the parts lie side by side. Those at the right and at the end may be smaller.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layout {
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) part_columns: usize,
    pub(super) part_rows: usize,
    /// Whether the first row of the file is the northernmost.
    pub(super) from_north: bool,
}

/// The most numbers of one part, and of all parts of a page that are kept: 64 MB.
pub(super) const MOST_NUMBERS: usize = 16 << 20;

/// The nodes of a page.
pub(super) struct PartwiseNodes {
    layout: Layout,
    inner: Mutex<Inner>,
}

struct Inner {
    source: Box<dyn Parts>,
    read: HashMap<usize, Arc<[f32]>>,
    numbers: usize,
}

impl PartwiseNodes {
    pub(super) fn new(layout: Layout, source: Box<dyn Parts>) -> Result<Self, GeoidFileError> {
        let numbers = layout.part_columns.checked_mul(layout.part_rows);
        if !numbers.is_some_and(|numbers| (1..=MOST_NUMBERS).contains(&numbers)) {
            return Err(GeoidFileError::NoGrid(format!(
                "its parts have {} x {} numbers, more than {MOST_NUMBERS} or none",
                layout.part_columns, layout.part_rows
            )));
        }
        Ok(Self { layout, inner: Mutex::new(Inner { source, read: HashMap::new(), numbers: 0 }) })
    }

    fn part(&self, part: usize) -> Result<Arc<[f32]>, GeoidFileError> {
        let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(numbers) = inner.read.get(&part) {
            return Ok(numbers.clone());
        }
        let numbers: Arc<[f32]> = inner.source.read(part)?.into();
        if inner.numbers + numbers.len() > MOST_NUMBERS {
            inner.read.clear();
            inner.numbers = 0;
        }
        inner.numbers += numbers.len();
        inner.read.insert(part, numbers.clone());
        Ok(numbers)
    }
}

impl Nodes for PartwiseNodes {
    fn undulation_m(&self, column: usize, row: usize) -> Result<Option<f32>, String> {
        let Layout { columns, rows, part_columns, part_rows, from_north } = self.layout;
        let row = if from_north { rows - 1 - row } else { row };
        let (part_column, part_row) = (column / part_columns, row / part_rows);
        let across = columns.div_ceil(part_columns);
        // the last part of a row ends with the grid
        let width = part_columns.min(columns - part_column * part_columns);
        let at = (row % part_rows) * width + column % part_columns;
        let numbers = self.part(part_row * across + part_column).map_err(|error| error.to_string())?;
        let number = numbers.get(at).ok_or_else(|| "a part of it has too few numbers".to_owned())?;
        Ok(Some(*number).filter(|number| number.is_finite()))
    }
}

impl fmt::Debug for PartwiseNodes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PartwiseNodes").field("layout", &self.layout).finish_non_exhaustive()
    }
}
