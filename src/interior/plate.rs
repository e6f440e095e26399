//! What is known of a film camera's plate beforehand: the calibrated marks, and what tells its sides apart.
//!
//! The plate frame is that of the calibration report: millimetres, x in the direction of flight, y to the left of it,
//! seen as the scene is seen (right-reading).

use std::sync::Arc;

use nalgebra::Vector2;

use super::mark::Mark;
use crate::geometry::Film;

/// A calibrated fiducial mark.
#[derive(Debug, Clone, PartialEq)]
pub struct Fiducial {
    /// Its name in the calibration report, unique in the plate.
    pub name: String,
    /// Calibrated position in the plate.
    pub position_mm: Vector2<f64>,
    /// Standard deviation of each coordinate.
    pub sigma_mm: f64,
    /// What it looks like.
    pub mark: Arc<Mark>,
    /// How the mark is turned in the plate, counter-clockwise.
    pub rotation_rad: f64,
}

/// A figure that is on one side of the plate only, so that it tells the eight ways of laying the film apart.
#[derive(Debug, Clone, PartialEq)]
pub struct AsymmetricFeature {
    /// Its place in the plate.
    pub position_mm: Vector2<f64>,
    /// Standard deviation of each coordinate: such figures are not calibrated.
    pub sigma_mm: f64,
    /// What it looks like.
    pub mark: Arc<Mark>,
    /// How it is turned in the plate, counter-clockwise.
    pub rotation_rad: f64,
}

/// A side of the plate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Towards negative x, where the picture's rear is.
    Left,
    /// Towards positive x.
    Right,
    /// Towards positive y.
    Top,
    /// Towards negative y.
    Bottom,
}

/// The plate with everything on it that helps to find it in a scan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plate {
    /// At least two.
    pub fiducials: Vec<Fiducial>,
    /// The figure that is on one side only.
    pub asymmetric: Option<AsymmetricFeature>,
    /// The side beside which the camera writes its data (clock, counter, text), beyond the image.
    pub data_strip: Option<Side>,
    /// Width (x) and height (y) of the image on the film, about the plate's origin.
    pub format_mm: [f64; 2],
}

/// A film camera: its lens, and its plate.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmCamera {
    /// The lens.
    pub film: Film,
    /// The plate, of the same format.
    pub plate: Plate,
}
