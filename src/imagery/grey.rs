//! Grey values as they are kept in memory, and the one formula that makes them out of colours.

/// Grey values row by row, at the depth in which they were stored.
#[derive(Debug)]
pub(super) enum Samples {
    /// 0 to 255.
    Eight(Vec<u8>),
    /// 0 to 65 535.
    Sixteen(Vec<u16>),
}

impl Samples {
    /// The largest sample.
    pub(super) fn brightest(&self) -> u16 {
        match self {
            Self::Eight(samples) => samples.iter().copied().max().unwrap_or(0).into(),
            Self::Sixteen(samples) => samples.iter().copied().max().unwrap_or(0),
        }
    }
}

/// The sample that stands for white where the brightest is `brightest`: the largest number of as many bits, at least
/// eight. Cameras of 10 to 14 bits write their numbers into 16-bit files as they are; scaled by 65 535, such a picture
/// would be all but black.
pub(super) fn white(brightest: u16) -> f32 {
    let bits = (u16::BITS - brightest.leading_zeros()).max(8);
    f32::from(u16::MAX >> (u16::BITS - bits))
}

/// A grey frame: a whole picture, or a strip or tile of one.
#[derive(Debug)]
pub(super) struct Grey {
    /// Pixels in a row, at least one.
    pub(super) width: usize,
    /// The rows, without gaps.
    pub(super) samples: Samples,
}

impl Grey {
    /// Memory taken by the samples.
    pub(super) fn bytes(&self) -> u64 {
        match &self.samples {
            Samples::Eight(samples) => samples.len() as u64,
            Samples::Sixteen(samples) => 2 * samples.len() as u64,
        }
    }
}

/// An unsigned sample of 8 or 16 bits.
pub(super) trait Sample: Copy + Into<u32> + Into<f32> {
    /// The samples of `grey` if they are of this depth.
    fn samples(grey: &Grey) -> Option<&[Self]>;
    /// Luma of a colour (ITU-R BT.601, as in the Y of JPEG), rounded to the nearest.
    fn luma(red: Self, green: Self, blue: Self) -> Self;
}

impl Sample for u8 {
    fn samples(grey: &Grey) -> Option<&[Self]> {
        match &grey.samples {
            Samples::Eight(samples) => Some(samples),
            Samples::Sixteen(_) => None,
        }
    }

    fn luma(red: Self, green: Self, blue: Self) -> Self {
        luma(red.into(), green.into(), blue.into()) as u8
    }
}

impl Sample for u16 {
    fn samples(grey: &Grey) -> Option<&[Self]> {
        match &grey.samples {
            Samples::Sixteen(samples) => Some(samples),
            Samples::Eight(_) => None,
        }
    }

    fn luma(red: Self, green: Self, blue: Self) -> Self {
        luma(red.into(), green.into(), blue.into()) as u16
    }
}

/// 0.299 R + 0.587 G + 0.114 B in units of 2^-16. The weights add up to one, so the result is no larger than the
/// largest of the three, and 16-bit samples just fit into the sum.
fn luma(red: u32, green: u32, blue: u32) -> u32 {
    (19_595 * red + 38_470 * green + 7_471 * blue + 32_768) >> 16
}

/// How the samples of one pixel lie beside each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelLayout {
    /// Samples in a pixel, those that are of no use here (alpha, infrared) included.
    pub(super) samples: usize,
    /// Whether the first three are red, green and blue; else the first is the grey value.
    pub(super) colour: bool,
}

/// Appends the grey values of the pixels in `row`; a rest that is less than a pixel is left out.
pub(super) fn append_grey<S: Sample>(row: &[S], layout: PixelLayout, grey: &mut Vec<S>) {
    match (layout.colour, layout.samples) {
        (true, 3) => append_luma::<S, 3>(row, grey),
        (true, 4) => append_luma::<S, 4>(row, grey),
        (true, n) => grey.extend(row.chunks_exact(n).map(|pixel| S::luma(pixel[0], pixel[1], pixel[2]))),
        (false, 1) => grey.extend_from_slice(row),
        (false, n) => grey.extend(row.chunks_exact(n).map(|pixel| pixel[0])),
    }
}

/// With the number of samples known to the compiler, which can then do several pixels at once.
fn append_luma<S: Sample, const N: usize>(row: &[S], grey: &mut Vec<S>) {
    grey.extend(row.as_chunks::<N>().0.iter().map(|pixel| S::luma(pixel[0], pixel[1], pixel[2])));
}
