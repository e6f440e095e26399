//! Averages over square blocks of pixels, row by row.

use super::grey::Sample;
use crate::features::{GreyWindow, PixelRect};

/// Collects the rows of a rectangle and averages them over blocks.
///
/// The rows of a block are first added column by column, which needs no look at the neighbours and so runs at the
/// speed of memory; the columns are added up only once for each row of blocks.
#[derive(Debug)]
pub(super) struct BoxAverage {
    window: GreyWindow,
    column_sums: Vec<u32>,
    rows_summed: usize,
    scale: f32,
}

impl BoxAverage {
    /// An empty window of `rect`, whose sides are at most 65 535. Samples of `white` become 255, brighter ones as well.
    pub(super) fn new(rect: PixelRect, reduction: u32, white: f32) -> Self {
        let width = rect.width.div_ceil(reduction) as usize;
        let height = rect.height.div_ceil(reduction) as usize;
        let grey = Vec::with_capacity(width * height);
        Self {
            window: GreyWindow { origin_px: [rect.x, rect.y], reduction, width, height, grey },
            column_sums: vec![0; rect.width as usize],
            rows_summed: 0,
            scale: 255.0 / white,
        }
    }

    /// Takes the next row of the rectangle.
    pub(super) fn push_row<S: Sample>(&mut self, row: &[S]) {
        let scale = self.scale;
        if self.window.reduction == 1 {
            self.window.grey.extend(row.iter().map(|&sample| (scale * Into::<f32>::into(sample)).min(255.0)));
            return;
        }
        for (sum, &sample) in self.column_sums.iter_mut().zip(row) {
            *sum += Into::<u32>::into(sample);
        }
        self.rows_summed += 1;
        if self.rows_summed == self.window.reduction as usize {
            self.close_blocks();
        }
    }

    /// The window, after the last row.
    pub(super) fn finish(mut self) -> GreyWindow {
        if self.rows_summed > 0 {
            self.close_blocks();
        }
        self.window
    }

    /// Ends a row of blocks; the last block may have fewer columns than the others.
    fn close_blocks(&mut self) {
        let columns = self.window.reduction as usize;
        let scale = self.scale / self.rows_summed as f32;
        match columns {
            2 => self.append_blocks::<2>(scale),
            4 => self.append_blocks::<4>(scale),
            _ => self.window.grey.extend(self.column_sums.chunks_exact(columns).map(|sums| mean(sums, scale))),
        }
        let rest = self.column_sums.chunks_exact(columns).remainder();
        if !rest.is_empty() {
            self.window.grey.push(mean(rest, scale));
        }
        self.column_sums.fill(0);
        self.rows_summed = 0;
    }

    /// With the width of a block known to the compiler, which can then do several blocks at once.
    fn append_blocks<const N: usize>(&mut self, scale: f32) {
        let scale = scale / N as f32;
        let blocks = self.column_sums.as_chunks::<N>().0;
        self.window.grey.extend(blocks.iter().map(|sums| (scale * sums.iter().sum::<u32>() as f32).min(255.0)));
    }
}

/// The mean of the column sums, scaled.
fn mean(sums: &[u32], scale: f32) -> f32 {
    let sum: u64 = sums.iter().map(|&sum| u64::from(sum)).sum();
    (scale / sums.len() as f32 * sum as f32).min(255.0)
}
