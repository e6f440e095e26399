//! The interior orientation of one scan: what the client asks for, and the work itself, with and without a service.

#[cfg(test)]
mod tests;

use std::path::Path;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::request::{Faults, FieldFault, Reading, ScanRequest, TransformationKind};
use crate::features::{Picture as _, PictureError};
use crate::imagery::{self, ImageFile, ImageryError, Limits};
use crate::interior::{FilmCamera, interior_orientation};
use crate::report::interior::{self, InteriorResult, MarkReport};

/// A scan whose interior orientation is wanted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct InteriorRequest {
    /// The image's id.
    pub image: String,
    /// The film camera's id or name.
    #[schema(example = "rc30-15-4")]
    pub camera: String,
    /// Side of a pixel on the film, 1 to 500. Default: what the TIFF's resolution says; without one, the film is taken to
    /// fill the scan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = 14.0, minimum = 1, maximum = 500)]
    pub pixel_size_um: Option<f64>,
    /// How the film may be deformed. Default: `affine`.
    #[serde(default)]
    pub transformation: TransformationKind,
    /// Whether the scan is known to be right-reading or wrong-reading (mirrored). Default: found out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reading: Option<Reading>,
    /// Known quarter turns of the film, counter-clockwise as one sees the scan, 0 to 3. Default: found out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(example = json!(null), maximum = 3)]
    pub quarter_turns: Option<u8>,
}

/// A request with everything filled in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PreparedInterior {
    /// Side of a pixel on the film that was stated; left out where nothing states it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel_size_um: Option<f64>,
    /// Who stated it.
    pub pixel_size_from: PixelSizeOrigin,
    /// How the film may be deformed.
    pub transformation: TransformationKind,
    /// Which side is said to be up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reading: Option<Reading>,
    /// How the film is said to be turned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quarter_turns: Option<u8>,
}

/// Where the size of a pixel comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum PixelSizeOrigin {
    /// The request.
    Request,
    /// The resolution in the file.
    File,
    /// Nobody says it, or the scan would be far too small or large for the film: that is taken to fill the scan.
    Unknown,
}

/// Why a scan has no interior orientation, not even a red one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InteriorError {
    /// The file cannot be used.
    #[error(transparent)]
    Imagery(#[from] ImageryError),
    /// The file is damaged.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// Fields of the request make no sense.
    #[error("{}", .0.iter().map(|fault| format!("{}: {}", fault.pointer, fault.detail)).collect::<Vec<_>>().join("; "))]
    Request(Vec<FieldFault>),
}

impl InteriorRequest {
    fn scan(&self) -> ScanRequest {
        let Self { pixel_size_um, transformation, reading, quarter_turns, .. } = *self;
        ScanRequest { pixel_size_um, transformation, reading, quarter_turns }
    }

    /// Checks everything, and fills in what the scan's file states of its pixels.
    ///
    /// # Errors
    /// All fields that make no sense.
    pub fn prepare(&self, file_pixel_size_um: Option<f64>) -> Result<PreparedInterior, Vec<FieldFault>> {
        let mut faults = Faults::default();
        self.scan().check("", &mut faults);
        if !faults.0.is_empty() {
            return Err(faults.0);
        }
        let (pixel_size_um, pixel_size_from) = match (self.pixel_size_um, file_pixel_size_um) {
            (Some(um), _) => (Some(um), PixelSizeOrigin::Request),
            (None, Some(um)) => (Some(um), PixelSizeOrigin::File),
            (None, None) => (None, PixelSizeOrigin::Unknown),
        };
        let (transformation, reading, quarter_turns) = (self.transformation, self.reading, self.quarter_turns);
        Ok(PreparedInterior { pixel_size_um, pixel_size_from, transformation, reading, quarter_turns })
    }
}

impl PreparedInterior {
    /// Says so where the pixels that were stated could not be those of the film, and others were assumed.
    fn note_assumed(&mut self, assumed_um: f64) {
        if self.pixel_size_um.is_some_and(|um| (um / assumed_um - 1.0).abs() > 1e-6) {
            self.pixel_size_from = PixelSizeOrigin::Unknown;
        }
    }
}

/// The interior orientation of a file, with the request as it was understood.
///
/// # Errors
/// [`InteriorError`] if the file cannot be used, or fields of the request make no sense.
pub fn oriented(
    path: &Path,
    limits: &Limits,
    camera: &FilmCamera,
    request: &InteriorRequest,
) -> Result<(PreparedInterior, InteriorResult), InteriorError> {
    let probe = imagery::probe(path, limits)?;
    let mut prepared = request.prepare(probe.pixel_size_um).map_err(InteriorError::Request)?;
    let picture = ImageFile::open(path, limits)?;
    let wanted = request.scan().wanted(probe.pixel_size_um);
    let found = interior_orientation(&picture, &camera.plate, &wanted)?;
    let result = InteriorResult::of(&found, &camera.plate, picture.size_px());
    prepared.note_assumed(result.pixel_size_um);
    Ok((prepared, result))
}

/// A mark in the scan's file, as [`interior::close_up`] draws it.
///
/// # Errors
/// [`InteriorError`] if the file cannot be used.
pub fn close_up(
    path: &Path,
    limits: &Limits,
    result: &InteriorResult,
    mark: &MarkReport,
) -> Result<Option<Vec<u8>>, InteriorError> {
    Ok(interior::close_up(&ImageFile::open(path, limits)?, result, mark)?)
}
