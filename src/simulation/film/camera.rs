//! The film cameras, and plates of them as a calibration knows them and as they are.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use nalgebra::Vector2;

use crate::interior::{AsymmetricFeature, Fiducial, Library, Mark, Plate, Side};
use crate::simulation::draws::Draws;

/// A kind of film camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Make {
    /// Diagonal crosses in the four corners.
    WildRc5,
    /// Ring, cross and dot, in the corners and amid the sides.
    WildRc10,
    /// Dot and cross, in the corners and amid the sides.
    WildRc20,
    /// Dot, ring and arms, in the corners and amid the sides.
    LeicaRc30,
    /// Wedges amid the sides.
    ZeissRmk,
    /// Dot, square and cross, in the corners and amid the sides.
    ZeissRmkTop,
    /// Pinholes amid the sides.
    FairchildT11,
    /// Wings amid the sides.
    FairchildK17,
}

impl Make {
    /// Every kind.
    pub const ALL: [Self; 8] = [
        Self::WildRc5,
        Self::WildRc10,
        Self::WildRc20,
        Self::LeicaRc30,
        Self::ZeissRmk,
        Self::ZeissRmkTop,
        Self::FairchildT11,
        Self::FairchildK17,
    ];

    /// Width and height of the image on the film.
    #[must_use]
    pub fn format_mm(self) -> [f64; 2] {
        match self {
            Self::FairchildT11 => [240.0, 238.0],
            Self::FairchildK17 => [228.6, 228.6],
            _ => [230.0, 230.0],
        }
    }

    /// Half the width and height of the opening that is drawn: a T-11's frame begins 1 mm beside its pinholes.
    pub(super) fn opening_mm(self) -> [f32; 2] {
        match self {
            Self::FairchildT11 => [119.5, 118.5],
            _ => self.format_mm().map(|side_mm| (0.5 * side_mm) as f32),
        }
    }

    pub(super) fn figure(self) -> Library {
        match self {
            Self::WildRc5 => Library::WildRc5,
            Self::WildRc10 => Library::WildRc10,
            Self::WildRc20 => Library::WildRc20,
            Self::LeicaRc30 => Library::LeicaRc30,
            Self::ZeissRmk => Library::ZeissRmk,
            Self::ZeissRmkTop => Library::ZeissRmkTop,
            Self::FairchildT11 => Library::FairchildPinhole,
            Self::FairchildK17 => Library::FairchildWing,
        }
    }

    /// Distance of the marks in the corners, along each axis.
    fn corners_mm(self) -> Option<f64> {
        match self {
            Self::WildRc5 | Self::WildRc10 | Self::WildRc20 | Self::LeicaRc30 => Some(106.0),
            Self::ZeissRmkTop => Some(104.0),
            _ => None,
        }
    }

    /// Distance of the marks amid the sides, along x and y.
    fn sides_mm(self) -> Option<[f64; 2]> {
        match self {
            Self::WildRc5 => None,
            Self::WildRc10 | Self::WildRc20 | Self::LeicaRc30 => Some([110.0, 110.0]),
            Self::ZeissRmk | Self::ZeissRmkTop => Some([113.0, 113.0]),
            Self::FairchildT11 => Some([118.5, 117.5]),
            Self::FairchildK17 => Some([111.2, 111.2]),
        }
    }

    /// Whether its marks are turned with the side that they are at.
    fn turns_with_the_side(self) -> bool {
        matches!(self, Self::ZeissRmk | Self::FairchildT11 | Self::FairchildK17)
    }

    /// Whether the marks may lie in dark pieces that are joined to the frame.
    pub(super) fn has_dark_pieces(self) -> bool {
        matches!(self, Self::WildRc5 | Self::WildRc10 | Self::WildRc20 | Self::LeicaRc30)
    }

    /// Where the marks are by design, and how they are turned.
    fn design(self) -> Vec<(Vector2<f64>, f64)> {
        let corners = self
            .corners_mm()
            .into_iter()
            .flat_map(|at| [[-at, -at], [at, at], [-at, at], [at, -at]].map(|[x, y]| (Vector2::new(x, y), 0.0)));
        let turned = |quarters: f64| if self.turns_with_the_side() { quarters * FRAC_PI_2 } else { 0.0 };
        let sides = self.sides_mm().into_iter().flat_map(|[x, y]| {
            [([x, 0.0], 0.0), ([0.0, y], 1.0), ([-x, 0.0], 2.0), ([0.0, -y], 3.0)]
                .map(|([x, y], quarters)| (Vector2::new(x, y), turned(quarters)))
        });
        corners.chain(sides).collect()
    }
}

/// How well a plate was made and measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateSettings {
    /// Standard deviation of each mark's coordinates about the design.
    pub sigma_made_mm: f64,
    /// Standard deviation of the calibration.
    pub sigma_calibration_mm: f64,
    /// Standard deviation to which the place of the asymmetric feature is known.
    pub sigma_asymmetric_mm: f64,
    /// Line widths and radii differ from the design by up to this share.
    pub tolerance: f64,
}

impl Default for PlateSettings {
    fn default() -> Self {
        Self { sigma_made_mm: 0.01, sigma_calibration_mm: 0.002, sigma_asymmetric_mm: 0.2, tolerance: 0.04 }
    }
}

/// A plate as it is.
#[derive(Debug, Clone)]
pub(super) struct TruePlate {
    /// What is known of it.
    pub(super) known: Plate,
    /// Where its marks really are.
    pub(super) marks_mm: Vec<Vector2<f64>>,
    /// Where the asymmetric feature really is.
    pub(super) asymmetric_mm: Option<Vector2<f64>>,
}

impl TruePlate {
    pub(super) fn draw(
        camera: Make,
        asymmetric: bool,
        data_strip: Option<Side>,
        settings: &PlateSettings,
        draws: &mut Draws,
    ) -> Self {
        let mark = Arc::new(Mark::Library(camera.figure()));
        let mut marks_mm = Vec::new();
        let mut fiducials = Vec::new();
        for (number, (design_mm, rotation_rad)) in (1..).zip(camera.design()) {
            let true_mm = design_mm + deviation(settings.sigma_made_mm, draws);
            marks_mm.push(true_mm);
            fiducials.push(Fiducial {
                name: number.to_string(),
                position_mm: true_mm + deviation(settings.sigma_calibration_mm, draws),
                sigma_mm: settings.sigma_calibration_mm,
                mark: Arc::clone(&mark),
                rotation_rad,
            });
        }
        let feature = asymmetric.then(|| asymmetric_feature(camera, data_strip, settings, draws));
        let asymmetric_mm =
            feature.as_ref().map(|feature| feature.position_mm + deviation(settings.sigma_asymmetric_mm, draws));
        let known = Plate { fiducials, asymmetric: feature, data_strip, format_mm: camera.format_mm() };
        Self { known, marks_mm, asymmetric_mm }
    }
}

fn deviation(sigma_mm: f64, draws: &mut Draws) -> Vector2<f64> {
    Vector2::new(draws.normal(), draws.normal()) * sigma_mm
}

/// An arrow or a bar off the axes, in the image's rim or beside it (but not in the data strip).
fn asymmetric_feature(
    camera: Make,
    data_strip: Option<Side>,
    settings: &PlateSettings,
    draws: &mut Draws,
) -> AsymmetricFeature {
    let figure = if draws.chance(0.5) { Library::Arrow } else { Library::Bar };
    let sides = [Side::Right, Side::Top, Side::Left, Side::Bottom];
    let quarters = draws.below(4);
    let side = sides[quarters as usize % 4];
    let outside = draws.chance(0.35) && data_strip != Some(side);
    let half_mm = camera.opening_mm().map(f64::from);
    let edge_mm = if matches!(side, Side::Left | Side::Right) { half_mm[0] } else { half_mm[1] };
    // the feature's dark ground reaches 3 mm at most; with 0.2 mm of error it stays clear of the edge
    let across_mm = if outside { edge_mm + draws.between(3.8, 4.5) } else { edge_mm - draws.between(3.8, 5.0) };
    let along_mm = draws.between(22.0, 60.0) * if draws.chance(0.5) { 1.0 } else { -1.0 };
    let position_mm = turned_quarters(Vector2::new(across_mm, along_mm), quarters);
    AsymmetricFeature {
        position_mm,
        sigma_mm: settings.sigma_asymmetric_mm,
        mark: Arc::new(Mark::Library(figure)),
        rotation_rad: f64::from(draws.below(4)) * FRAC_PI_2,
    }
}

/// A vector turned counter-clockwise, without rounding.
pub(super) fn turned_quarters(vector: Vector2<f64>, quarters: u32) -> Vector2<f64> {
    match quarters % 4 {
        0 => vector,
        1 => Vector2::new(-vector.y, vector.x),
        2 => -vector,
        _ => Vector2::new(vector.y, -vector.x),
    }
}
