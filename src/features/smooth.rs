//! The binomial filter.

/// A grid of values, row by row.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grid<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl<'a> Grid<'a> {
    pub(crate) fn row(&self, row: usize) -> &'a [f32] {
        &self.values[row * self.width..(row + 1) * self.width]
    }

    /// One row after the filter (1 2 1)/4 in both directions; values on the rim are not filtered across it. `buffer`
    /// and `smooth` are a row long.
    pub(crate) fn smooth_row(&self, row: usize, buffer: &mut [f32], smooth: &mut [f32]) {
        if row == 0 || row == self.height - 1 {
            buffer.copy_from_slice(self.row(row));
        } else {
            let (above, here, below) = (self.row(row - 1), self.row(row), self.row(row + 1));
            for (((out, a), h), b) in buffer.iter_mut().zip(above).zip(here).zip(below) {
                *out = 0.25 * (a + b) + 0.5 * h;
            }
        }
        smooth.copy_from_slice(buffer);
        if self.width < 3 {
            return;
        }
        for (out, near) in smooth[1..self.width - 1].iter_mut().zip(buffer.windows(3)) {
            *out = 0.25 * (near[0] + near[2]) + 0.5 * near[1];
        }
    }
}
