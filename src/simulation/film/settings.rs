//! What a simulated scan is drawn from.

use nalgebra::Vector2;

use super::camera::{Make, PlateSettings};
use crate::interior::Side;
use crate::simulation::draws::{Draws, Purpose};

/// How the film lies on the scanner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Laying {
    /// Quarter turns, 0 to 3, by which the plate's x axis is turned counter-clockwise from the picture's right, as the
    /// picture is seen (that is, with rows running down).
    pub turns: u8,
    /// Whether the film lies upside down: then the plate's y axis is a quarter turn clockwise of its x axis, as seen.
    pub mirrored: bool,
}

impl Laying {
    /// All eight.
    #[must_use]
    pub fn all() -> [Self; 8] {
        std::array::from_fn(|k| Self { turns: (k % 4) as u8, mirrored: k >= 4 })
    }
}

/// How the film was strained since it was exposed. All but the last are linear, drawn evenly within the bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StrainSettings {
    /// Shrinkage is within plus or minus this share.
    pub scale: f64,
    /// The scales along x and y differ by up to this share.
    pub difference: f64,
    /// Shear, within plus or minus.
    pub shear: f64,
    /// Standard deviation of each coordinate of every mark, for itself.
    pub sigma_irregular_mm: f64,
}

impl Default for StrainSettings {
    fn default() -> Self {
        Self { scale: 0.001, difference: 0.0003, shear: 0.0002, sigma_irregular_mm: 0.0015 }
    }
}

/// What the scanner makes of the film. Pairs are bounds of even draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScannerSettings {
    /// Size of a pixel as the file states it.
    pub pixel_um: [f64; 2],
    /// By up to which share the true size differs from it.
    pub pixel_error: f64,
    /// The film lies within plus or minus this of a quarter turn.
    pub rotation_rad: f64,
    /// The plate's centre is within plus or minus this of the scan's, along both axes.
    pub off_centre_mm: f64,
    /// Standard deviation of the blur.
    pub blur_px: [f64; 2],
    /// Grey value of black.
    pub black_grey: [f64; 2],
    /// Grey value of white.
    pub white_grey: [f64; 2],
    /// Exponent between light and grey value.
    pub gamma: [f64; 2],
    /// Grey values between a mark's figure and its dark ground.
    pub mark_contrast_grey: [f64; 2],
    /// Standard deviation of the grain.
    pub grain_grey: [f64; 2],
    /// Share of the scans whose grain is correlated over a pixel.
    pub correlated_share: f64,
    /// Loss of light where it is darkest.
    pub uneven_light: [f64; 2],
}

/// How much lies on the film. Pairs are bounds of even draws.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DirtSettings {
    /// Specks of dust and fibres (in the border three times as many).
    pub specks_per_mm2: [f64; 2],
    /// Long thin scratches.
    pub scratches: [u32; 2],
    /// Words written by hand in the border and the rim.
    pub words: [u32; 2],
    /// Stamps in the rim.
    pub stamps: [u32; 2],
    /// Chance that a corner or a strip of the film is cut off with the marks that it bears.
    pub cut_off: f64,
}

impl DirtSettings {
    /// Nothing.
    pub const NONE: Self =
        Self { specks_per_mm2: [0.0; 2], scratches: [0; 2], words: [0; 2], stamps: [0; 2], cut_off: 0.0 };
}

/// What is done to a single mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Corruption {
    /// A blob, white or black, lies over it.
    Covered,
    /// It is at another place, so far off in the plate.
    Shifted {
        /// Off its place, along the plate's axes.
        by_mm: [f64; 2],
    },
    /// Scratches run through it.
    Scratched,
    /// There is nothing but the dark ground.
    Missing,
}

impl Corruption {
    /// A shift of a given length in a direction drawn from a seed.
    #[must_use]
    pub fn shifted(distance_mm: f64, seed: u64) -> Self {
        let mut draws = Draws::new(seed, Purpose::FilmCorruption);
        let direction = crate::simulation::draws::direction(draws.between(0.0, std::f64::consts::TAU));
        Self::Shifted { by_mm: (direction * distance_mm).into() }
    }
}

/// What a scan is drawn from, together with a seed.
#[derive(Debug, Clone, PartialEq)]
pub struct ScanSettings {
    /// The camera.
    pub camera: Make,
    /// Whether there is an asymmetric feature.
    pub asymmetric: bool,
    /// Where the camera writes its data.
    pub data_strip: Option<Side>,
    /// How the film lies.
    pub laying: Laying,
    /// Whether the film is a negative.
    pub negative: bool,
    /// Making and calibration.
    pub plate: PlateSettings,
    /// What became of the film.
    pub strain: StrainSettings,
    /// The scanner.
    pub scanner: ScannerSettings,
    /// Dirt.
    pub dirt: DirtSettings,
    /// What is done to one of the marks (its place among the plate's fiducials).
    pub corrupt: Option<(usize, Corruption)>,
}

impl ScanSettings {
    /// A positive of good contrast with little dirt, with an asymmetric feature and no data strip.
    #[must_use]
    pub fn good(camera: Make, laying: Laying) -> Self {
        let scanner = ScannerSettings {
            pixel_um: [10.0, 30.0],
            pixel_error: 0.003,
            rotation_rad: 3_f64.to_radians(),
            off_centre_mm: 3.0,
            blur_px: [0.5, 1.2],
            black_grey: [5.0, 30.0],
            white_grey: [200.0, 250.0],
            gamma: [0.7, 1.4],
            mark_contrast_grey: [90.0, 190.0],
            grain_grey: [2.0, 5.0],
            correlated_share: 0.3,
            uneven_light: [0.0, 0.1],
        };
        let dirt = DirtSettings {
            specks_per_mm2: [0.002, 0.05],
            scratches: [0, 4],
            words: [0, 2],
            stamps: [0, 1],
            cut_off: 0.0,
        };
        Self {
            camera,
            asymmetric: true,
            data_strip: None,
            laying,
            negative: false,
            plate: PlateSettings::default(),
            strain: StrainSettings::default(),
            scanner,
            dirt,
            corrupt: None,
        }
    }

    /// The same with low contrast, coarse grain and much dirt.
    #[must_use]
    pub fn poor(camera: Make, laying: Laying) -> Self {
        let mut settings = Self::good(camera, laying);
        settings.scanner = ScannerSettings {
            black_grey: [10.0, 60.0],
            white_grey: [130.0, 220.0],
            mark_contrast_grey: [25.0, 80.0],
            grain_grey: [4.0, 10.0],
            correlated_share: 0.5,
            uneven_light: [0.05, 0.3],
            ..settings.scanner
        };
        settings.dirt = DirtSettings {
            specks_per_mm2: [0.05, 0.4],
            scratches: [4, 30],
            words: [1, 8],
            stamps: [0, 3],
            cut_off: 0.1,
        };
        settings
    }

    /// Without grain, dirt and uneven light, of linear response: for tests.
    #[must_use]
    pub fn clean(camera: Make, laying: Laying) -> Self {
        let mut settings = Self::good(camera, laying);
        settings.scanner.grain_grey = [0.0; 2];
        settings.scanner.uneven_light = [0.0; 2];
        settings.scanner.gamma = [1.0; 2];
        settings.dirt = DirtSettings::NONE;
        settings
    }

    /// The mixture of a study: all layings and polarities and all cameras alike, 70 % good and 30 % poor, half with an
    /// asymmetric feature, a third of the others with a data strip, one in ten turned by up to 8 degrees.
    #[must_use]
    pub fn draw(seed: u64) -> Self {
        let mut draws = Draws::new(seed, Purpose::FilmMixture);
        let camera = Make::ALL[draws.below(8) as usize % 8];
        let laying = Laying::all()[draws.below(8) as usize % 8];
        let mut settings = if draws.chance(0.7) { Self::good(camera, laying) } else { Self::poor(camera, laying) };
        settings.negative = draws.chance(0.5);
        settings.asymmetric = draws.chance(0.5);
        let sides = [Side::Left, Side::Right, Side::Top, Side::Bottom];
        let side = sides[draws.below(4) as usize % 4];
        settings.data_strip = (!settings.asymmetric && draws.chance(1.0 / 3.0)).then_some(side);
        if draws.chance(0.1) {
            settings.scanner.rotation_rad = 8_f64.to_radians();
        }
        settings
    }
}

/// The direction of a side, out of the image.
pub(super) fn outwards(side: Side) -> Vector2<f64> {
    match side {
        Side::Left => -Vector2::x(),
        Side::Right => Vector2::x(),
        Side::Top => Vector2::y(),
        Side::Bottom => -Vector2::y(),
    }
}
