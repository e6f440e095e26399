//! Cameras as they come out of the store, ready for use.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::Vector2;
use uuid::Uuid;

use super::film_camera::{DefinitionError, FilmCameraDefinition, Templates};
use super::request::CameraModel;
use crate::interior::{Cut, Mark};
use crate::store::cameras::{CameraKind, NamedCamera};
use crate::store::mark_templates::{MarkTemplate, TemplateContent};
use crate::store::{Store, StoreError};

/// Why a stored camera cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CameraModelError {
    /// The store failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Its definition cannot be read.
    #[error("JSON of a film camera: {0}")]
    Json(#[from] serde_json::Error),
    /// Its definition makes no sense any more.
    #[error(transparent)]
    Definition(#[from] DefinitionError),
}

/// The camera with this id or name, ready for use; `None` if there is none.
///
/// # Errors
/// [`CameraModelError`] if the store fails, or holds what this version does not understand.
pub async fn camera_model(store: &Store, id_or_name: &str) -> Result<Option<CameraModel>, CameraModelError> {
    match store.camera(id_or_name).await? {
        Some(named) => Ok(Some(model_of(store, named).await?)),
        None => Ok(None),
    }
}

async fn model_of(store: &Store, named: NamedCamera) -> Result<CameraModel, CameraModelError> {
    match named.kind {
        CameraKind::Digital(camera) => Ok(CameraModel::Digital(camera)),
        CameraKind::Film(definition) => {
            let definition: FilmCameraDefinition = serde_json::from_str(&definition)?;
            let uploaded = uploaded_templates(store, &definition.uploaded_templates()).await?;
            Ok(CameraModel::Film(Arc::new(definition.camera(&uploaded.marks)?)))
        }
    }
}

/// Templates from the store.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Uploaded {
    /// What they look like.
    pub marks: Templates,
    /// Their ids, in no particular order.
    pub ids: Vec<Uuid>,
}

/// Those of the templates with these names that are in the store.
///
/// # Errors
/// [`StoreError`].
pub async fn uploaded_templates(store: &Store, names: &BTreeSet<&str>) -> Result<Uploaded, StoreError> {
    let mut uploaded = Uploaded::default();
    for name in names {
        let Some(MarkTemplate { id, content, .. }) = store.mark_template(name).await? else { continue };
        let grey = store.mark_template_grey(id).await?;
        // cameras refer by the name alone: an id would not say in a camera's definition what it stands for
        if let Some(grey) = grey.filter(|_| content.name == *name) {
            uploaded.marks.insert(content.name.clone(), Arc::new(Mark::Cut(cut(&content, &grey))));
            uploaded.ids.push(id);
        }
    }
    Ok(uploaded)
}

/// The template as the interior orientation wants it.
#[must_use]
pub fn cut(content: &TemplateContent, grey: &[u16]) -> Cut {
    let [width, height] = content.size_px.map(|size| size as usize);
    Cut {
        width,
        height,
        grey: grey.iter().map(|grey| f32::from(*grey) * (255.0 / f32::from(u16::MAX))).collect(),
        care: care(content),
        centre_px: Vector2::from(content.centre_px),
        pixel_mm: content.pixel_size_um * 1e-3,
    }
}

/// Which pixels of a template belong to the mark, row by row.
#[must_use]
pub fn care(content: &TemplateContent) -> Vec<bool> {
    let [width, height] = content.size_px;
    let left_out = |column: u32, row: u32| {
        let within = |[x, y, columns, rows]: &[u32; 4]| {
            (*x..x.saturating_add(*columns)).contains(&column) && (*y..y.saturating_add(*rows)).contains(&row)
        };
        content.dont_care.iter().any(within)
    };
    (0..height).flat_map(|row| (0..width).map(move |column| (column, row))).map(|(x, y)| !left_out(x, y)).collect()
}
