//! Gaussian blur in two passes, and the blur that also doubles the resolution.
//!
//! Most of the time of the scale space goes in here, so both passes keep 16 sums in registers while they go through
//! the taps, and a row goes through the second pass while it is still in the first cache.

/// Cells that are summed at once.
const LANES: usize = 16;
type Lanes = [f32; LANES];
/// Rows that are summed at once.
const ROWS: usize = 4;
/// Taps to a side at most: the reach of the last filter of an octave.
const MOST_TAPS: usize = 10;

/// A symmetric filter: the middle, then the taps to either side.
#[derive(Debug, Clone)]
pub(super) struct Kernel {
    middle: f32,
    /// At most [`MOST_TAPS`].
    sides: Vec<f32>,
}

impl Kernel {
    /// A Gaussian sampled out to three standard deviations. What is cut off would make it narrower by more than one
    /// percent, so the Gaussian sampled is wider by so much that the filter itself has the variance `sigma`².
    pub(super) fn gaussian(sigma: f64) -> Self {
        let reach = ((3.0 * sigma).ceil() as usize).min(MOST_TAPS);
        let mut sampled = sigma;
        let mut taps = Vec::new();
        for _ in 0..8 {
            taps = (0..=reach).map(|j| (-0.5 * (j as f64 / sampled).powi(2)).exp()).collect();
            let sum = 2.0 * taps.iter().sum::<f64>() - 1.0;
            let squares = 2.0 * taps.iter().enumerate().map(|(j, tap)| (j * j) as f64 * tap).sum::<f64>();
            taps.iter_mut().for_each(|tap| *tap /= sum);
            sampled *= sigma / (squares / sum).sqrt();
        }
        Self { middle: taps[0] as f32, sides: taps[1..].iter().map(|&tap| tap as f32).collect() }
    }

    /// The filter that interpolates linearly at half cells and then blurs by `sigma` of the finer cells, as two
    /// filters on the coarse cells: for the fine cells that lie on coarse ones, and for those between two. Of the
    /// latter, `sides` are the taps to either side and there is no middle.
    fn doubling(sigma: f64) -> [Self; 2] {
        let fine = Self::gaussian(sigma);
        let at = |k: i64| match k.unsigned_abs() as usize {
            0 => fine.middle,
            k => fine.sides.get(k - 1).copied().unwrap_or(0.0),
        };
        let blended = |k: i64| at(k) + 0.5 * (at(k - 1) + at(k + 1));
        // interpolation reaches one fine cell
        let reach = fine.sides.len() as i64 + 1;
        let even: Vec<f32> = (0..=reach / 2).map(|j| blended(2 * j)).collect();
        let odd: Vec<f32> = (0..(reach + 1) / 2).map(|j| blended(2 * j + 1)).collect();
        let scaled = |taps: &[f32], sum: f32| taps.iter().map(|tap| tap / sum).collect::<Vec<_>>();
        let (sum_even, sum_odd) = (2.0 * even.iter().sum::<f32>() - even[0], 2.0 * odd.iter().sum::<f32>());
        let even = scaled(&even, sum_even);
        [Self { middle: even[0], sides: even[1..].to_vec() }, Self { middle: 0.0, sides: scaled(&odd, sum_odd) }]
    }

    /// The taps to one side, and zeros beyond them.
    fn taps<const TAPS: usize>(&self) -> [f32; TAPS] {
        std::array::from_fn(|j| self.sides.get(j).copied().unwrap_or(0.0))
    }
}

/// The next `N` values from a place on; zeros where there are not so many.
#[inline(always)]
pub(super) fn lanes<const N: usize>(values: &[f32], at: usize) -> [f32; N] {
    values.get(at..).and_then(|values| values.first_chunk::<N>()).copied().unwrap_or([0.0; N])
}

/// Index of a cell beyond the rim, mirrored at the middle of the cell at the rim.
fn mirrored(at: isize, count: usize) -> usize {
    let last = count as isize - 1;
    if last <= 0 {
        return 0;
    }
    let at = at.rem_euclid(2 * last);
    at.min(2 * last - at) as usize
}

/// Calls a function whose first parameter is the number of taps to a side, so that for those that occur the loop over
/// them is unrolled.
macro_rules! with_taps {
    ($kernel:expr, $function:ident $(::<$further:literal>)? ($($argument:expr),*)) => {
        match $kernel.sides.len() {
            2 => $function::<2 $(, $further)?>($kernel, $($argument),*),
            3 => $function::<3 $(, $further)?>($kernel, $($argument),*),
            4 => $function::<4 $(, $further)?>($kernel, $($argument),*),
            5 => $function::<5 $(, $further)?>($kernel, $($argument),*),
            6 => $function::<6 $(, $further)?>($kernel, $($argument),*),
            8 => $function::<8 $(, $further)?>($kernel, $($argument),*),
            _ => $function::<MOST_TAPS $(, $further)?>($kernel, $($argument),*),
        }
    };
}

/// Calls `sum` with the first of each group of [`LANES`] columns; the last group may overlap that before. False if
/// there are not so many columns.
#[inline(always)]
fn by_lanes(width: usize, mut sum: impl FnMut(usize)) -> bool {
    let Some(last) = width.checked_sub(LANES) else { return false };
    (0..last).step_by(LANES).for_each(&mut sum);
    sum(last);
    true
}

/// Sums over pairs of rows for the rows of `out` (at most [`ROWS`]): each group of lanes of all of them before the next
/// group, so that a source row comes into the first cache once for all.
fn sum_across<const TAPS: usize>(kernel: &Kernel, pairs: &[Pairs<'_>], out: &mut [f32], width: usize) {
    let taps: [f32; TAPS] = kernel.taps();
    for group in 0..width.div_ceil(LANES) {
        for (out, (centre, pairs)) in out.chunks_exact_mut(width).zip(pairs) {
            let pairs: &[[&[Lanes]; 2]; TAPS] = pairs.first_chunk().unwrap_or(&[[&[]; 2]; TAPS]);
            let sums = sum_rows(kernel.middle, &taps, centre, pairs, group);
            let rest = &mut out[group * LANES..];
            if let Some(whole) = rest.first_chunk_mut() {
                *whole = sums;
            } else {
                rest.iter_mut().zip(sums).for_each(|(out, sum)| *out = sum);
            }
        }
    }
}

#[inline(always)]
fn sum_rows<const TAPS: usize>(
    middle: f32,
    taps: &[f32; TAPS],
    centre: &[Lanes],
    pairs: &[[&[Lanes]; 2]; TAPS],
    group: usize,
) -> Lanes {
    let mut sums = centre[group].map(|value| middle * value);
    for (tap, [a, b]) in taps.iter().zip(pairs) {
        let (a, b) = (&a[group], &b[group]);
        for k in 0..LANES {
            sums[k] += tap * (a[k] + b[k]);
        }
    }
    sums
}

/// The same along a row that has been extended by [`extend`]. `BETWEEN` is 0 for filters with a middle, and 1
/// for those that make the cells between.
fn sum_along<const TAPS: usize, const BETWEEN: usize>(kernel: &Kernel, padded: &[f32], out: &mut [f32]) {
    let taps: [f32; TAPS] = kernel.taps();
    let sum = |x: usize| {
        // not copied: the lanes are fetched where they lie
        let near = padded.get(x..).and_then(|padded| padded.first_chunk()).unwrap_or(&[0.0; NEAR]);
        sum_near::<TAPS, BETWEEN>(kernel.middle, &taps, near)
    };
    let done = by_lanes(out.len(), |x| out[x..x + LANES].copy_from_slice(&sum(x)));
    if !done {
        let sums = sum(0);
        out.iter_mut().zip(sums).for_each(|(out, sum)| *out = sum);
    }
}

/// What a group of lanes needs of a row.
const NEAR: usize = LANES + 2 * MOST_TAPS;

#[inline(always)]
fn sum_near<const TAPS: usize, const BETWEEN: usize>(
    middle: f32,
    taps: &[f32; TAPS],
    near: &[f32; NEAR],
) -> [f32; LANES] {
    let mut sums: [f32; LANES] = std::array::from_fn(|k| middle * near[MOST_TAPS + k]);
    for (j, tap) in taps.iter().take(MOST_TAPS).enumerate() {
        let (before, after) = (MOST_TAPS - 1 - j + BETWEEN, MOST_TAPS + 1 + j);
        for k in 0..LANES {
            sums[k] += tap * (near[before + k] + near[after + k]);
        }
    }
    sums
}

/// A row with [`MOST_TAPS`] mirrored cells before and after it. (And zeros for a whole group of lanes.)
fn extend(row: &[f32], padded: &mut [f32]) {
    let width = row.len();
    padded[MOST_TAPS..MOST_TAPS + width].copy_from_slice(row);
    for j in 1..=MOST_TAPS as isize {
        padded[MOST_TAPS - j as usize] = row[mirrored(-j, width)];
        padded[MOST_TAPS + width + j as usize - 1] = row[mirrored(width as isize - 1 + j, width)];
    }
}

/// Place for a row and what [`extend`] adds.
fn padded_row(width: usize) -> Vec<f32> {
    vec![0.0; width + 2 * MOST_TAPS + LANES]
}

/// A row, and those at the same distance before and after it.
type Pairs<'a> = (&'a [Lanes], [[&'a [Lanes]; 2]; MOST_TAPS]);

/// The last rows that went through the pass along them.
struct Recent {
    values: Vec<Lanes>,
    /// Groups of lanes from a row to the next. Odd: rows a power of two apart would throw one another out of the first
    /// cache.
    stride: usize,
    width: usize,
    /// Rows that the picture has, and rows done.
    height: usize,
    done: usize,
}

impl Recent {
    /// As many as are needed at once.
    const ROWS: usize = ROWS + 2 * MOST_TAPS;

    fn new(width: usize, height: usize) -> Self {
        let stride = width.div_ceil(LANES) | 1;
        Self { values: vec![[0.0; LANES]; stride * Self::ROWS], stride, width, height, done: 0 }
    }

    /// Goes on until there are so many.
    fn fill(&mut self, count: usize, mut filter: impl FnMut(usize, &mut [f32])) {
        while self.done < self.height.min(count) {
            let start = self.done % Self::ROWS * self.stride;
            let row = self.values[start..start + self.stride].as_flattened_mut();
            filter(self.done, &mut row[..self.width]);
            self.done += 1;
        }
    }

    fn row(&self, y: isize) -> &[Lanes] {
        let start = mirrored(y, self.height) % Self::ROWS * self.stride;
        &self.values[start..start + self.stride]
    }

    /// A row and the pairs about it, or about the middle between it and the next.
    fn pairs(&self, y: isize, between: isize) -> Pairs<'_> {
        let pair = |j: isize| [self.row(y - j + between), self.row(y + j)];
        (self.row(y), std::array::from_fn(|j| pair(j as isize + 1)))
    }
}

/// Blurs a picture, a few rows at a time: what follows finds them in the cache.
pub(super) struct Blur<'a> {
    kernel: &'a Kernel,
    recent: Recent,
    padded: Vec<f32>,
    /// Rows written.
    pub(super) written: usize,
}

impl<'a> Blur<'a> {
    pub(super) fn new(kernel: &'a Kernel, width: usize, height: usize) -> Self {
        Self { kernel, recent: Recent::new(width, height), padded: padded_row(width), written: 0 }
    }

    /// The next rows, if there are enough of the source's: so many are there.
    pub(super) fn advance(&mut self, from: &[f32], there: usize, to: &mut [f32]) {
        let Self { kernel, recent, padded, written } = self;
        let (width, height, first) = (recent.width, recent.height, *written);
        if first == height || there < height.min(first + ROWS + kernel.sides.len()) {
            return;
        }
        recent.fill(there.min(first + ROWS + kernel.sides.len()), |y, out| {
            extend(&from[y * width..(y + 1) * width], padded);
            with_taps!(kernel, sum_along::<0>(padded, out));
        });
        let pairs: [Pairs<'_>; ROWS] = std::array::from_fn(|k| recent.pairs((first + k) as isize, 0));
        *written = height.min(first + ROWS);
        with_taps!(kernel, sum_across(&pairs, &mut to[first * width..*written * width], width));
    }
}

/// Twice the resolution, interpolated linearly and blurred by `sigma` fine cells: 2·`width` − 1 columns and
/// 2·`height` − 1 rows, of which every other one lies on a coarse one.
pub(super) fn double(from: &[f32], to: &mut [f32], width: usize, height: usize, sigma: f64) {
    let [even, odd] = &Kernel::doubling(sigma);
    let fine_width = 2 * width - 1;
    let mut recent = Recent::new(fine_width, height);
    let mut padded = padded_row(width);
    let (mut on, mut between) = (vec![0.0; width], vec![0.0; width]);
    for (fine_y, out) in to.chunks_exact_mut(fine_width).take(2 * height - 1).enumerate() {
        let (y, shifted) = (fine_y / 2, fine_y % 2);
        recent.fill(y + 1 + MOST_TAPS, |y, out| {
            extend(&from[y * width..(y + 1) * width], &mut padded);
            with_taps!(even, sum_along::<0>(&padded, &mut on));
            with_taps!(odd, sum_along::<1>(&padded, &mut between));
            interleave(&on, &between, out);
        });
        let kernel = if shifted == 0 { even } else { odd };
        with_taps!(kernel, sum_across(&[recent.pairs(y as isize, shifted as isize)], out, fine_width));
    }
}

/// Values of two rows in turns, beginning and ending with the first.
fn interleave(on: &[f32], between: &[f32], out: &mut [f32]) {
    let (twos, rest) = out.as_chunks_mut::<2>();
    for ((two, on), between) in twos.iter_mut().zip(on).zip(between) {
        *two = [*on, *between];
    }
    if let (Some(rest), Some(on)) = (rest.first_mut(), on.last()) {
        *rest = *on;
    }
}
