//! From an orientation to the files that other software reads.
//!
//! Most of that software takes a map grid for a Cartesian frame: what it gets is the orientation fitted to the ground in
//! the grid's coordinates ([`GridOrientation`]). Software that works in a local frame gets that frame, in which nothing
//! needs to be fitted; software that knows no cameras gets rational polynomials ([`Rational`]). The manifest tells of
//! every photograph the matrix, the angles, their convention, and five check points with their pixels.

mod footprints;
mod grid;
mod interior;
mod local;
mod manifest;
mod micmac;
mod names;
mod photograph;
mod rational;
mod rpc;
mod tables;
#[cfg(test)]
mod tests;
mod vendors;

use serde::{Deserialize, Serialize};

pub use grid::GridOrientation;
pub use photograph::{Judgement, Photograph, Sigma};
pub use rational::Rational;

use crate::geometry::{Crs, CrsError};
use interior::Corrections;
use nalgebra::Vector3;

/// What can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// JSON with matrices, angles, conventions and check points.
    Manifest,
    /// A table of positions and angles in degrees; orthority reads it too.
    OpkCsv,
    /// PATB: principal distance, projection centre and rotation matrix.
    Patb,
    /// A project of Inpho.
    Inpho,
    /// BINGO's records of orientations, in gon.
    Bingo,
    /// A text file of exterior orientations as Applanix writes it.
    Applanix,
    /// GeoJSON of orientations and YAML of cameras for orthority.
    Orthority,
    /// `reconstruction.json` of OpenSfM.
    Opensfm,
    /// `geo.txt` of OpenDroneMap.
    Odm,
    /// External and internal camera parameters as Pix4D writes them.
    Pix4d,
    /// COLMAP's model as text.
    Colmap,
    /// `Ori-` folder of MicMac.
    Micmac,
    /// Frames and cameras tables of ArcGIS.
    Esri,
    /// Rational polynomials, as `_RPC.TXT` and as GDAL's metadata.
    Rpc,
    /// GeoJSON of what the photographs show.
    Footprints,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 15] = [
        Self::Manifest,
        Self::OpkCsv,
        Self::Patb,
        Self::Inpho,
        Self::Bingo,
        Self::Applanix,
        Self::Orthority,
        Self::Opensfm,
        Self::Odm,
        Self::Pix4d,
        Self::Colmap,
        Self::Micmac,
        Self::Esri,
        Self::Rpc,
        Self::Footprints,
    ];

    /// Its word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Manifest => "manifest",
            Self::OpkCsv => "opk_csv",
            Self::Patb => "patb",
            Self::Inpho => "inpho",
            Self::Bingo => "bingo",
            Self::Applanix => "applanix",
            Self::Orthority => "orthority",
            Self::Opensfm => "opensfm",
            Self::Odm => "odm",
            Self::Pix4d => "pix4d",
            Self::Colmap => "colmap",
            Self::Micmac => "micmac",
            Self::Esri => "esri",
            Self::Rpc => "rpc",
            Self::Footprints => "footprints",
        }
    }

    /// The format of a word.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }
}

/// What a grid that is taken for a Cartesian frame may lose of a photograph at its worst point; more is refused. The Earth's
/// curvature takes 2 px of an aerial film at 1 : 30 000 in its own UTM zone, for which there is no better grid; web Mercator
/// takes 50 and more.
pub const MOST_RESIDUAL_PX: f64 = 5.0;

/// In which coordinates formats are written that want a map grid.
#[derive(Debug, Clone)]
pub struct Target {
    /// A map grid, or a topocentric frame.
    pub crs: Crs,
    /// What takes its heights off the ellipsoid.
    pub geoid_undulation_m: Option<f64>,
}

impl Target {
    /// # Errors
    /// [`ExportError::Geographic`] if the CRS has degrees, in which nothing can be adjusted; [`ExportError::Crs`] if its
    /// heights cannot be computed, or an undulation is given where it would have no effect.
    pub fn new(crs: Crs, geoid_undulation_m: Option<f64>) -> Result<Self, ExportError> {
        if crs.is_geographic() {
            return Err(ExportError::Geographic { crs: crs.to_string() });
        }
        crs.check_heights(geoid_undulation_m)?;
        // neither degrees nor a compound: a topocentric frame
        if geoid_undulation_m.is_some() && !crs.assumes_ellipsoidal_heights() {
            return Err(CrsError::UndulationWithoutHeight { crs: crs.to_string() }.into());
        }
        Ok(Self { crs, geoid_undulation_m })
    }

    fn position(&self, geocentric_m: Vector3<f64>) -> Result<[f64; 3], CrsError> {
        self.crs.position_from_geocentric(geocentric_m, self.geoid_undulation_m)
    }
}

/// A file of an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct File {
    /// Its name, with folders.
    pub name: String,
    /// What it is.
    pub media_type: &'static str,
    /// What it holds.
    pub text: String,
}

/// Why an export is not possible.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// A ray does not meet the ground.
    #[error("pixel ({:.0}, {:.0}) of {name} looks at or above the horizon: there is no ground to fit to", pixel[0], pixel[1])]
    Horizon {
        /// The photograph.
        name: String,
        /// The pixel.
        pixel: [f64; 2],
    },
    /// The normal equations are singular, or ground lies behind the camera.
    #[error("the orientation cannot be fitted to the ground; check the height of the ground")]
    NoFit,
    /// Degrees where metres are needed.
    #[error("{crs} has degrees; give a map grid, such as the UTM zone EPSG:25832, or a topocentric frame, as crs")]
    Geographic {
        /// What was given.
        crs: String,
    },
    /// The target does not reach.
    #[error(transparent)]
    Crs(#[from] CrsError),
    /// A grid that is no Cartesian frame by far.
    #[error(
        "{crs}, taken for a Cartesian frame, loses up to {residual_px:.1} px of {name}, and {MOST_RESIDUAL_PX} px may be \
         lost; give a grid made for the place, such as its UTM zone, or a topocentric frame, as crs"
    )]
    PoorFit {
        /// The photograph.
        name: String,
        /// The grid.
        crs: String,
        /// What remains at the worst point.
        residual_px: f64,
    },
    /// Two that would be written as one.
    #[error("{:?} and {:?} would both be called {called:?} in {format}; rename one, or export them apart", names[0], names[1])]
    Name {
        /// The format's word.
        format: &'static str,
        /// What both would be called.
        called: String,
        /// Both.
        names: [String; 2],
    },
    /// A format that cannot tell of such a camera.
    #[error("{format} cannot describe the camera {camera:?}: {why}")]
    Camera {
        /// The format's word.
        format: &'static str,
        /// The camera's name.
        camera: String,
        /// What it cannot describe, and what can.
        why: String,
    },
}

/// Writes photographs in a format, the positions of those that want a map grid in `target`.
///
/// # Errors
/// [`ExportError`]: where one photograph cannot be written, none is.
pub fn write(format: Format, photographs: &[Photograph], target: &Target) -> Result<Vec<File>, ExportError> {
    names::check(format, photographs)?;
    match format {
        Format::Manifest => Ok(vec![manifest::write(photographs, target)?]),
        Format::OpkCsv => tables::opk_csv(photographs, target),
        Format::Patb => tables::patb(photographs, target),
        Format::Bingo => tables::bingo(photographs, target),
        Format::Applanix => tables::applanix(photographs, target),
        Format::Odm => tables::odm(photographs, target),
        Format::Pix4d => vendors::pix4d(photographs, target),
        Format::Inpho => vendors::inpho(photographs, target),
        Format::Orthority => vendors::orthority(photographs, target),
        Format::Esri => vendors::esri(photographs, target),
        Format::Opensfm => local::opensfm(photographs),
        Format::Colmap => local::colmap(photographs),
        Format::Micmac => micmac::write(photographs),
        Format::Rpc => rpc::write(photographs),
        Format::Footprints => footprints::write(photographs),
    }
}

/// What is lost on the way into a format at the worst point of all photographs, in pixels; `None` where nothing is fitted.
///
/// # Errors
/// As [`write`].
pub fn residual_max_px(
    format: Format,
    photographs: &[Photograph],
    target: &Target,
) -> Result<Option<f64>, ExportError> {
    let mut worst_px: Option<f64> = None;
    for photograph in photographs {
        let in_grid = || GridOrientation::fitted(photograph, target).map(|grid| grid.residual_max_px);
        let residual_px = match format {
            Format::OpkCsv | Format::Patb | Format::Bingo | Format::Applanix | Format::Orthority | Format::Pix4d => {
                in_grid()?
            }
            Format::Inpho | Format::Esri => in_grid()? + Corrections::of(photograph, format)?.residual_max_px,
            Format::Rpc => Rational::fitted(photograph)?.residual_max_px,
            Format::Manifest | Format::Opensfm | Format::Odm | Format::Colmap | Format::Micmac | Format::Footprints => {
                return Ok(None);
            }
        };
        worst_px = Some(worst_px.unwrap_or(0.0).max(residual_px));
    }
    Ok(worst_px)
}

/// Each photograph with its orientation in the target, which it must fit.
fn in_grid<'a>(
    photographs: &'a [Photograph],
    target: &Target,
) -> Result<Vec<(&'a Photograph, GridOrientation)>, ExportError> {
    let fitted = |photograph: &'a Photograph| {
        let grid = GridOrientation::fitted(photograph, target)?;
        if grid.residual_max_px > MOST_RESIDUAL_PX {
            let (name, crs) = (photograph.name.clone(), target.crs.to_string());
            return Err(ExportError::PoorFit { name, crs, residual_px: grid.residual_max_px });
        }
        Ok((photograph, grid))
    };
    photographs.iter().map(fitted).collect()
}
