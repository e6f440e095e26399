//! What a simulated scan really is.

use nalgebra::{Matrix2, Matrix2x3, Vector2, Vector3};

use super::settings::{Corruption, Laying, ScanSettings};
use crate::simulation::draws::{Draws, Purpose};

/// What became of a mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MarkState {
    /// It is there (though dirt may lie on it by chance).
    Whole,
    /// It was tampered with as the settings ask.
    Corrupted(Corruption),
    /// The film was cut off there.
    CutOff,
}

/// A mark in the scan.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueMark {
    /// Its name in the plate.
    pub name: String,
    /// Where its centre should be: with the film's irregular strain, without a shift that was asked for.
    pub position_px: Vector2<f64>,
    /// Where its figure is drawn: the same unless it was shifted.
    pub drawn_px: Vector2<f64>,
    /// What became of it.
    pub state: MarkState,
}

/// The truth about a scan. Pixel (0, 0) is the corner of the top-left pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanTruth {
    /// From the plate (x, y, 1), millimetres, to the scan, pixels: laying, rotation and the linear part of the strain.
    /// The determinant of its left part is negative where the film is not mirrored, since rows run down.
    pub pixel_from_plate: Matrix2x3<f64>,
    /// The marks, in the order of the plate's fiducials.
    pub marks: Vec<TrueMark>,
    /// The centre of the asymmetric feature.
    pub asymmetric_px: Option<Vector2<f64>>,
    /// Quarter turns of the plate's x axis, as in [`Laying::turns`].
    pub turns: u8,
    /// Whether the film lies upside down, as in [`Laying::mirrored`].
    pub mirrored: bool,
    /// Whether the scan is that of a negative.
    pub negative: bool,
    /// The true size of a pixel on the scanner's glass.
    pub pixel_um: f64,
}

impl ScanTruth {
    /// Where a place of the plate lies in the scan, but for the irregular strain.
    #[must_use]
    pub fn pixel(&self, place_mm: Vector2<f64>) -> Vector2<f64> {
        self.pixel_from_plate * Vector3::new(place_mm.x, place_mm.y, 1.0)
    }
}

/// How the plate lies in the scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layout {
    pub(super) size_px: [u32; 2],
    pub(super) nominal_pixel_um: f64,
    pub(super) pixel_um: f64,
    pub(super) pixel_from_plate: Matrix2x3<f64>,
    plate_from_pixel: Matrix2x3<f64>,
}

impl Layout {
    /// A scan that holds an opening of half the given size, and so much beside it.
    pub(super) fn draw(settings: &ScanSettings, half_mm: [f32; 2], margin_mm: f64, seed: u64) -> Self {
        let mut draws = Draws::new(seed, Purpose::FilmLaying);
        let scanner = &settings.scanner;
        let nominal_pixel_um = drawn(scanner.pixel_um, &mut draws);
        let pixel_um = nominal_pixel_um * (1.0 + draws.within(scanner.pixel_error));
        let rotation_rad = draws.within(scanner.rotation_rad);
        let off_centre_mm = Vector2::new(draws.within(scanner.off_centre_mm), draws.within(scanner.off_centre_mm));
        let strain = &settings.strain;
        let (scale, difference) = (1.0 + draws.within(strain.scale), 0.5 * draws.within(strain.difference));
        let strained = Matrix2::new(scale + difference, draws.within(strain.shear), 0.0, scale - difference);

        let (sin, cos) = (libm::sin(rotation_rad), libm::cos(rotation_rad));
        // as seen, y up; rows run down
        let seen = Matrix2::new(cos, -sin, sin, cos) * laid(settings.laying) * strained;
        let px_per_mm = 1000.0 / pixel_um;
        let linear = Matrix2::new(px_per_mm, 0.0, 0.0, -px_per_mm) * seen;

        let [mut across, mut up] = half_mm.map(f64::from);
        if settings.laying.turns % 2 == 1 {
            (across, up) = (up, across);
        }
        let half = |along: f64, beside: f64| along * cos + beside * sin.abs() + margin_mm;
        let size_px = [half(across, up), half(up, across)].map(|half_mm| (2.0 * half_mm * px_per_mm) as u32);
        let centre_px = 0.5 * Vector2::from(size_px.map(f64::from)) + off_centre_mm * px_per_mm;
        let pixel_from_plate = Matrix2x3::from_columns(&[linear.column(0), linear.column(1), centre_px.column(0)]);

        let [[a, c], [b, d]] = linear.data.0;
        let inverse = Matrix2::new(d, -b, -c, a) / (a * d - b * c);
        let origin_mm = -(inverse * centre_px);
        let plate_from_pixel = Matrix2x3::from_columns(&[inverse.column(0), inverse.column(1), origin_mm.column(0)]);
        Self { size_px, nominal_pixel_um, pixel_um, pixel_from_plate, plate_from_pixel }
    }

    pub(super) fn plate(&self, place_px: Vector2<f64>) -> Vector2<f64> {
        self.plate_from_pixel * Vector3::new(place_px.x, place_px.y, 1.0)
    }

    /// A step of one pixel to the right and of one down, in the plate.
    pub(super) fn steps_mm(&self) -> [Vector2<f64>; 2] {
        [self.plate_from_pixel.column(0).into_owned(), self.plate_from_pixel.column(1).into_owned()]
    }

    pub(super) fn pixel(&self, place_mm: Vector2<f64>) -> Vector2<f64> {
        self.pixel_from_plate * Vector3::new(place_mm.x, place_mm.y, 1.0)
    }

    pub(super) fn pixel_mm(&self) -> f64 {
        self.pixel_um / 1000.0
    }
}

/// The plate's axes as they are seen when the film lies exactly so, y up.
fn laid(laying: Laying) -> Matrix2<f64> {
    let y = if laying.mirrored { -1.0 } else { 1.0 };
    let turned = match laying.turns % 4 {
        0 => Matrix2::new(1.0, 0.0, 0.0, 1.0),
        1 => Matrix2::new(0.0, -1.0, 1.0, 0.0),
        2 => Matrix2::new(-1.0, 0.0, 0.0, -1.0),
        _ => Matrix2::new(0.0, 1.0, -1.0, 0.0),
    };
    turned * Matrix2::new(1.0, 0.0, 0.0, y)
}

/// Evenly between bounds.
pub(super) fn drawn([low, high]: [f64; 2], draws: &mut Draws) -> f64 {
    draws.between(low, high)
}
