//! Gaussian blur in two passes, and the blur that also doubles the resolution.
//!
//! Most of the time of the scale space goes in here, so both passes keep 16 sums in registers while they go through
//! the taps, and a row goes through the second pass while it is still in the first cache.

/// Cells that are summed at once.
const LANES: usize = 16;
/// The filters reach at most so far; those of the scale space reach 10 cells.
const MOST_TAPS: usize = 16;

/// A symmetric filter: the middle, then the taps to either side.
#[derive(Debug, Clone)]
pub(super) struct Kernel {
    middle: f32,
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
        let reach = fine.sides.len() as i64 / 2 + 1;
        let even: Vec<f32> = (0..=reach).map(|j| blended(2 * j)).collect();
        let odd: Vec<f32> = (0..=reach).map(|j| blended(2 * j + 1)).collect();
        let scaled = |taps: &[f32], sum: f32| taps.iter().map(|tap| tap / sum).collect::<Vec<_>>();
        let (sum_even, sum_odd) = (2.0 * even.iter().sum::<f32>() - even[0], 2.0 * odd.iter().sum::<f32>());
        let even = scaled(&even, sum_even);
        [
            Self { middle: even[0], sides: even[1..].to_vec() },
            Self { middle: 0.0, sides: scaled(&odd[..reach as usize], sum_odd) },
        ]
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

/// `out` = middle · `centre` + Σ side · (pair), over whole rows.
#[inline(always)]
fn sum_rows(kernel: &Kernel, centre: &[f32], pairs: &[[&[f32]; 2]], out: &mut [f32]) {
    if out.len() < LANES {
        return (0..out.len()).for_each(|x| sum_rows_at::<1>(kernel, centre, pairs, out, x));
    }
    let last = out.len() - LANES;
    for x in (0..last).step_by(LANES) {
        sum_rows_at::<LANES>(kernel, centre, pairs, out, x);
    }
    // the last ones may be summed twice
    sum_rows_at::<LANES>(kernel, centre, pairs, out, last);
}

#[inline(always)]
fn sum_rows_at<const N: usize>(
    kernel: &Kernel,
    centre: &[f32],
    pairs: &[[&[f32]; 2]],
    out: &mut [f32],
    x: usize,
) {
    let mut sums = lanes::<N>(centre, x).map(|value| kernel.middle * value);
    for (&tap, [a, b]) in kernel.sides.iter().zip(pairs) {
        let (a, b) = (lanes::<N>(a, x), lanes::<N>(b, x));
        for k in 0..N {
            sums[k] += tap * (a[k] + b[k]);
        }
    }
    out[x..x + N].copy_from_slice(&sums);
}

/// A row with so many mirrored cells before and after it.
fn extend(row: &[f32], reach: usize, padded: &mut [f32]) {
    let width = row.len();
    padded[reach..reach + width].copy_from_slice(row);
    extend_in_place(width, reach, padded);
}

fn extend_in_place(width: usize, reach: usize, padded: &mut [f32]) {
    for j in 1..=reach as isize {
        padded[reach - j as usize] = padded[reach + mirrored(-j, width)];
        padded[reach + width + j as usize - 1] = padded[reach + mirrored(width as isize - 1 + j, width)];
    }
}

/// Along a row of `width + 2 · reach` cells.
fn sum_along(kernel: &Kernel, padded: &[f32], reach: usize, out: &mut [f32]) {
    let mut pairs: [[&[f32]; 2]; MOST_TAPS] = [[&[]; 2]; MOST_TAPS];
    let count = kernel.sides.len();
    for (j, pair) in pairs[..count].iter_mut().enumerate() {
        *pair = [&padded[reach - j - 1..], &padded[reach + j + 1..]];
    }
    sum_rows(kernel, &padded[reach..], &pairs[..count], out);
}

/// Blurs a picture. `to` holds at least `width` · `height` cells.
pub(super) fn blur(from: &[f32], to: &mut [f32], width: usize, height: usize, kernel: &Kernel) {
    let reach = kernel.sides.len();
    let mut padded = vec![0.0; width + 2 * reach];
    let row = |y: isize| {
        let y = mirrored(y, height);
        &from[y * width..(y + 1) * width]
    };
    let mut pairs: [[&[f32]; 2]; MOST_TAPS] = [[&[]; 2]; MOST_TAPS];
    for (y, out) in to.chunks_exact_mut(width).take(height).enumerate() {
        let y = y as isize;
        for (j, pair) in pairs[..reach].iter_mut().enumerate() {
            let j = j as isize + 1;
            *pair = [row(y - j), row(y + j)];
        }
        sum_rows(kernel, row(y), &pairs[..reach], &mut padded[reach..reach + width]);
        extend_in_place(width, reach, &mut padded);
        sum_along(kernel, &padded, reach, out);
    }
}

/// Twice the resolution, interpolated linearly and blurred by `sigma` fine cells: 2·`width` − 1 columns and
/// 2·`height` − 1 rows, of which every other one lies on a coarse one.
pub(super) fn double(from: &[f32], to: &mut [f32], width: usize, height: usize, sigma: f64) {
    let [even, odd] = Kernel::doubling(sigma);
    let reach = even.sides.len();
    let row = |y: isize| {
        let y = mirrored(y, height);
        &from[y * width..(y + 1) * width]
    };
    let fine_width = 2 * width - 1;
    let (mut across, mut padded) = (vec![0.0; width], vec![0.0; width + 2 * reach]);
    let (mut on, mut between) = (vec![0.0; width], vec![0.0; width]);
    let mut pairs: [[&[f32]; 2]; MOST_TAPS] = [[&[]; 2]; MOST_TAPS];
    for (fine_y, out) in to.chunks_exact_mut(fine_width).take(2 * height - 1).enumerate() {
        let (y, shifted) = (fine_y as isize / 2, fine_y as isize % 2);
        let kernel = if shifted == 0 { &even } else { &odd };
        let count = kernel.sides.len();
        for (j, pair) in pairs[..count].iter_mut().enumerate() {
            let j = j as isize + 1;
            *pair = [row(y - j + shifted), row(y + j)];
        }
        sum_rows(kernel, row(y), &pairs[..count], &mut across);
        extend(&across, reach, &mut padded);
        sum_along(&even, &padded, reach, &mut on);
        let mut sides: [[&[f32]; 2]; MOST_TAPS] = [[&[]; 2]; MOST_TAPS];
        for (j, pair) in sides[..odd.sides.len()].iter_mut().enumerate() {
            *pair = [&padded[reach - j..], &padded[reach + j + 1..]];
        }
        sum_rows(&odd, &padded[reach..], &sides[..odd.sides.len()], &mut between);
        let (twos, rest) = out.as_chunks_mut::<2>();
        for ((two, on), between) in twos.iter_mut().zip(&on).zip(&between) {
            *two = [*on, *between];
        }
        if let (Some(rest), Some(on)) = (rest.first_mut(), on.last()) {
            *rest = *on;
        }
    }
}
