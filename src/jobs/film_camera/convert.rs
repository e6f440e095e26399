//! From a definition to what the interior orientation works with.

use std::sync::Arc;

use nalgebra::Vector2;

use super::{FilmCameraDefinition, FilmDistortion, FilmModel, StripSide, Templates};
use crate::geometry::{Film, FilmError, Smac};
use crate::interior::{AsymmetricFeature, Fiducial, FilmCamera, Library, Mark, Plate, Side};

/// Why a stored definition cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DefinitionError {
    /// Its lens makes no sense.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// A template is neither one that Gable brings along nor an uploaded one.
    #[error("there is no template {name:?}")]
    NoTemplate {
        /// Its name.
        name: String,
    },
}

impl FilmDistortion {
    pub(super) fn smac(&self) -> Result<Smac, FilmError> {
        match self.model {
            FilmModel::Smac => Ok(Smac {
                k: [self.k0, self.k1, self.k2, self.k3, self.k4].map(Option::unwrap_or_default),
                p: [self.p1, self.p2, self.p3, self.p4].map(Option::unwrap_or_default),
            }),
            FilmModel::Table => {
                let um = self.distortion_um.as_deref().unwrap_or_default();
                let mm: Vec<f64> = um.iter().map(|um| um * 1e-3).collect();
                Smac::of_table(self.radius_mm.as_deref().unwrap_or_default(), &mm)
            }
        }
    }
}

impl From<StripSide> for Side {
    fn from(side: StripSide) -> Self {
        match side {
            StripSide::Left => Self::Left,
            StripSide::Right => Self::Right,
            StripSide::Top => Self::Top,
            StripSide::Bottom => Self::Bottom,
        }
    }
}

fn mark(name: &str, templates: &Templates) -> Result<Arc<Mark>, DefinitionError> {
    if let Some(library) = Library::from_name(name) {
        return Ok(Arc::new(Mark::Library(library)));
    }
    templates.get(name).cloned().ok_or_else(|| DefinitionError::NoTemplate { name: name.to_owned() })
}

impl FilmCameraDefinition {
    pub(super) fn film(&self) -> Result<Film, FilmError> {
        Film::new(
            self.principal_distance_mm,
            Vector2::from(self.principal_point_mm),
            Vector2::from(self.symmetry_point_mm),
            self.distortion.smac()?,
            self.format_mm,
        )
    }

    /// The camera, with the uploaded templates that it refers to.
    ///
    /// # Errors
    /// [`DefinitionError`] if a template is not there, or a lens that was right is not any more.
    pub fn camera(&self, templates: &Templates) -> Result<FilmCamera, DefinitionError> {
        let fiducial = |given: &super::FiducialDefinition| {
            Ok(Fiducial {
                name: given.name.clone(),
                position_mm: Vector2::from(given.position_mm),
                sigma_mm: given.sigma_mm,
                mark: mark(&given.template, templates)?,
                rotation_rad: given.rotation_deg.to_radians(),
            })
        };
        let fiducials = self.fiducials.iter().map(fiducial).collect::<Result<_, DefinitionError>>()?;
        let asymmetric = |given: &super::AsymmetricDefinition| {
            Ok::<_, DefinitionError>(AsymmetricFeature {
                position_mm: Vector2::from(given.position_mm),
                sigma_mm: given.sigma_mm,
                mark: mark(&given.template, templates)?,
                rotation_rad: given.rotation_deg.to_radians(),
            })
        };
        let asymmetric = self.asymmetric_feature.as_ref().map(asymmetric).transpose()?;
        let data_strip = self.data_strip.map(Side::from);
        let plate = Plate { fiducials, asymmetric, data_strip, format_mm: self.format_mm };
        Ok(FilmCamera { film: self.film()?, plate })
    }
}
