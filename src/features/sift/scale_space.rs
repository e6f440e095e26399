//! The scale space: each octave a stack of ever more blurred pictures (Lowe 2004, section 3).

use super::blur::{Blur, Kernel, double};

/// Scales at which key points are looked for in an octave (Lowe's s).
pub(super) const INTERVALS: usize = 3;
/// Pictures of an octave: the differences of neighbours must reach one beyond the intervals at either end.
pub(super) const LEVELS: usize = INTERVALS + 3;
/// Blur of the first picture of an octave, in its cells.
pub(super) const SIGMA: f64 = 1.6;
/// Blur that the picture is taken to have already, in its own cells.
pub(super) const SIGMA_OF_PICTURE: f64 = 0.5;
/// Cells beyond the last that may be read (and are not used), so that whole groups of lanes are read everywhere.
pub(super) const SPARE: usize = 32;

/// Blur of a level, in cells of its octave; levels between two have a fractional number.
pub(super) fn sigma_at(level: f64) -> f64 {
    SIGMA * (level / INTERVALS as f64).exp2()
}

/// The levels of one octave. Its first cell is centred on that of the picture.
pub(super) struct Octave {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Cells of the picture along a side of one cell of this octave.
    pub(super) cell_px: f64,
    /// Row by row, and [`SPARE`] cells.
    pub(super) levels: [Vec<f32>; LEVELS],
    kernels: [Kernel; LEVELS - 1],
}

impl Octave {
    /// The first octave, at the picture's size or at twice that.
    pub(super) fn first(grey: &[f32], width: usize, height: usize, upsampled: bool) -> Self {
        let (fine_width, fine_height) = if upsampled { (2 * width - 1, 2 * height - 1) } else { (width, height) };
        let levels = std::array::from_fn(|_| vec![0.0; fine_width * fine_height + SPARE]);
        let kernels = std::array::from_fn(|k| {
            let (from, to) = (sigma_at(k as f64), sigma_at(k as f64 + 1.0));
            Kernel::gaussian((to * to - from * from).sqrt())
        });
        let cell_px = if upsampled { 0.5 } else { 1.0 };
        let mut octave = Self { width: fine_width, height: fine_height, cell_px, levels, kernels };
        let missing = (SIGMA * SIGMA - (SIGMA_OF_PICTURE / cell_px).powi(2)).sqrt();
        if upsampled {
            double(grey, &mut octave.levels[0], width, height, missing);
        } else {
            let kernel = Kernel::gaussian(missing);
            let mut blur = Blur::new(&kernel, width, height);
            while blur.written < height {
                blur.advance(grey, height, &mut octave.levels[0]);
            }
        }
        octave.blur_further();
        octave
    }

    /// Becomes the octave of half the resolution: every other cell of the level that has twice the first one's blur.
    pub(super) fn halve(&mut self) {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let [first, .., doubled, _, _] = &mut self.levels;
        let rows = doubled.chunks_exact(self.width).take(self.height).step_by(2);
        for (out, row) in first.chunks_exact_mut(width).zip(rows) {
            out.iter_mut().zip(row.iter().step_by(2)).for_each(|(out, value)| *out = *value);
        }
        (self.width, self.height) = (width, height);
        self.cell_px *= 2.0;
        self.blur_further();
    }

    /// All levels but the first, in step, a few rows of each in turn.
    fn blur_further(&mut self) {
        let mut blurs = self.kernels.each_ref().map(|kernel| Blur::new(kernel, self.width, self.height));
        while blurs.last().is_some_and(|last| last.written < self.height) {
            let mut there = self.height;
            for (k, blur) in blurs.iter_mut().enumerate() {
                let (done, to_do) = self.levels.split_at_mut(k + 1);
                if let (Some(from), Some(to)) = (done.last(), to_do.first_mut()) {
                    blur.advance(from, there, to);
                }
                there = blur.written;
            }
        }
    }
}
