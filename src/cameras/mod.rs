//! Calibrations of cameras as other programs write them, made into cameras of the contract.
//!
//! Every program has its own origin of pixels, its own direction of axes, and its own side from which it looks at the
//! distortion; a file a program says which. Where its model is not the contract's, the contract's is fitted to it over the
//! whole image ([`conversion`]), and what is left between the two is told, place by place.

mod australis;
mod colmap;
pub mod conversion;
mod inpho;
mod metashape;
mod opencv;
mod opensfm;
mod pix4d;
#[cfg(test)]
mod tests;
mod text;
pub mod usgs;
mod xml;

use std::fmt;
use std::str::FromStr;

pub use self::conversion::{Conversion, Residual};

/// A program whose calibrations are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// OpenCV: `camera_matrix` and `distortion_coefficients` as YAML, JSON or XML; also `camera_info` of ROS.
    OpenCv,
    /// COLMAP: `cameras.txt`.
    Colmap,
    /// OpenSfM and OpenDroneMap: `cameras.json`, `camera_models.json`.
    OpenSfm,
    /// Agisoft Metashape: XML of a calibration, or of the cameras of a project.
    Metashape,
    /// Pix4D: `…_pix4d_calibrated_internal_camera_parameters.cam`.
    Pix4d,
    /// Australis, iWitness and reports in their form: C, XP, YP, K1 to K3, P1, P2, B1, B2.
    Australis,
    /// Inpho: the cameras of a project, `.prj`.
    Inpho,
}

/// The name in the contract of the reports of film cameras, which [`usgs`] reads.
pub const USGS: &str = "usgs";

/// The formats of digital cameras with their names in the contract.
pub const FORMATS: [(&str, Format); 7] = [
    ("opencv", Format::OpenCv),
    ("colmap", Format::Colmap),
    ("opensfm", Format::OpenSfm),
    ("metashape", Format::Metashape),
    ("pix4d", Format::Pix4d),
    ("australis", Format::Australis),
    ("inpho", Format::Inpho),
];

/// A calibration, and what is said beside it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Given<'a> {
    /// The file.
    pub text: &'a str,
    /// Which of the cameras in it, where there are several.
    pub camera: Option<&'a str>,
    /// Columns and rows of the images, where the file does not tell.
    pub image_size_px: Option<[u32; 2]>,
    /// Side of a pixel, where the file does not tell.
    pub pixel_size_mm: Option<f64>,
}

/// A camera that was read.
#[derive(Debug, Clone)]
pub struct Converted {
    /// What the file calls it.
    pub name: Option<String>,
    /// The camera, and how well it does what the file says.
    pub conversion: Conversion,
    /// What should be known before it is used.
    pub warnings: Vec<String>,
}

/// Why a calibration is not made into a camera.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraFileError {
    /// The text is not of its format.
    #[error("{place}: {detail}")]
    Text {
        /// Where: a line, or an element.
        place: String,
        /// What is wrong.
        detail: String,
    },
    /// A value is missing or makes no sense.
    #[error("{field}: {detail}")]
    Field {
        /// Its name in the file.
        field: String,
        /// What is wrong.
        detail: String,
    },
    /// There are several cameras, and none of them was named.
    #[error("there are {} cameras in it: {}; name one of them", names.len(), listed(names))]
    Several {
        /// Their names.
        names: Vec<String>,
    },
    /// There is no camera of the name that was given.
    #[error("there is no camera {wanted:?} in it; there are: {}", listed(names))]
    NoSuchCamera {
        /// The name that was given.
        wanted: String,
        /// Those in the file.
        names: Vec<String>,
    },
    /// Something that the file does not tell must be given beside it.
    #[error("the file does not tell {what}: give {parameter}")]
    Missing {
        /// What is not told.
        what: &'static str,
        /// The parameter that tells it.
        parameter: &'static str,
    },
    /// What is given beside the file contradicts it.
    #[error("{parameter} contradicts the file: {detail}")]
    Contradiction {
        /// The parameter.
        parameter: &'static str,
        /// How.
        detail: String,
    },
    /// The model of the lens is not one that can be converted.
    #[error("the camera model {model} cannot be converted: {detail}")]
    Model {
        /// Its name in the file.
        model: String,
        /// Why.
        detail: String,
    },
    /// The contract's model does not fit.
    #[error("{0}")]
    Conversion(#[from] conversion::ConversionError),
    /// It does not look like any of the formats.
    #[error("the format is not recognised; name one of {}", format_names())]
    UnknownFormat,
}

/// So many names are told.
const MOST_NAMES: usize = 20;

fn listed(names: &[String]) -> String {
    let told: Vec<String> = names.iter().take(MOST_NAMES).map(|name| format!("{name:?}")).collect();
    let more = if names.len() > MOST_NAMES { ", …" } else { "" };
    format!("{}{more}", told.join(", "))
}

fn format_names() -> String {
    FORMATS.map(|(name, _)| name).into_iter().chain([USGS]).collect::<Vec<_>>().join(", ")
}

/// What says whether a text is of a format.
type Look = (fn(&str) -> bool, Format);

impl Format {
    /// The format of a text, where it cannot be mistaken.
    #[must_use]
    pub fn detect(text: &str) -> Option<Self> {
        let looks: [Look; 7] = [
            (opensfm::is_one, Self::OpenSfm),
            (pix4d::is_one, Self::Pix4d),
            (inpho::is_one, Self::Inpho),
            (metashape::is_one, Self::Metashape),
            (opencv::is_one, Self::OpenCv),
            (colmap::is_one, Self::Colmap),
            (australis::is_one, Self::Australis),
        ];
        looks.into_iter().find(|(is_one, _)| is_one(text)).map(|(_, format)| format)
    }

    /// Reads a calibration of this format and converts it.
    ///
    /// # Errors
    /// [`CameraFileError`] names the line or the value that is at fault.
    pub fn read(self, given: &Given<'_>) -> Result<Converted, CameraFileError> {
        match self {
            Self::OpenCv => opencv::read(given),
            Self::Colmap => colmap::read(given),
            Self::OpenSfm => opensfm::read(given),
            Self::Metashape => metashape::read(given),
            Self::Pix4d => pix4d::read(given),
            Self::Australis => australis::read(given),
            Self::Inpho => inpho::read(given),
        }
    }
}

impl FromStr for Format {
    type Err = CameraFileError;

    fn from_str(name: &str) -> Result<Self, CameraFileError> {
        let found = FORMATS.iter().find(|(known, _)| known.eq_ignore_ascii_case(name));
        found.map(|(_, format)| *format).ok_or(CameraFileError::UnknownFormat)
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = FORMATS.iter().find(|(_, format)| format == self).map_or("", |(name, _)| name);
        f.write_str(name)
    }
}

impl Given<'_> {
    /// The size of the images: the file's, which one given beside it must not contradict.
    fn size_px(&self, told: Option<[u32; 2]>) -> Result<[u32; 2], CameraFileError> {
        match (told, self.image_size_px) {
            (Some(told), Some(given)) if told != given => Err(CameraFileError::Contradiction {
                parameter: "image_size_px",
                detail: format!("{} x {} px, not {} x {} px", told[0], told[1], given[0], given[1]),
            }),
            (Some(size), _) | (None, Some(size)) => Ok(size),
            (None, None) => {
                Err(CameraFileError::Missing { what: "the size of the images", parameter: "image_size_px" })
            }
        }
    }

    /// The one camera that is wanted of those in the file.
    fn choose<T>(&self, mut cameras: Vec<(String, T)>) -> Result<(String, T), CameraFileError> {
        let names = || cameras.iter().map(|(name, _)| name.clone()).collect();
        let at = match self.camera {
            Some(wanted) => cameras
                .iter()
                .position(|(name, _)| name == wanted)
                .ok_or_else(|| CameraFileError::NoSuchCamera { wanted: wanted.to_owned(), names: names() })?,
            None if cameras.len() > 1 => return Err(CameraFileError::Several { names: names() }),
            None if cameras.is_empty() => {
                return Err(CameraFileError::Text { place: "file".into(), detail: "there is no camera in it".into() });
            }
            None => 0,
        };
        Ok(cameras.swap_remove(at))
    }
}

fn field(name: impl Into<String>, detail: impl Into<String>) -> CameraFileError {
    CameraFileError::Field { field: name.into(), detail: detail.into() }
}
