//! Control near an image, the pictures of its scenes read: what the database keeps becomes what the pipeline takes.

use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;

use super::request::Work;
use crate::control::near::Reach;
use crate::control::scenes::{SceneContent, with_picture};
use crate::control::{self, ControlError, Wanted};
use crate::database::Database;
use crate::features::{Picture as _, PictureError, PixelRect};
use crate::geometry::LocalFrame;
use crate::imagery::{Format, ImageFile, ImageryError, Limits};
use crate::orientation::ControlPoint;

/// The picture of a scene, read.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePicture {
    /// The format, by the first bytes of the file.
    pub format: Format,
    /// Columns and rows.
    pub size_px: [u32; 2],
    /// Row by row, from 0 for black to 255 for white.
    pub grey: Vec<f32>,
}

/// Why the picture of a scene cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// It could not be put down for reading.
    #[error("a temporary file cannot be written: {0}")]
    File(#[from] std::io::Error),
    /// It is no picture, or more than is read here.
    #[error(transparent)]
    Imagery(#[from] ImageryError),
    /// It is damaged.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// Its size is not what was stored.
    #[error("the stored picture is not the one that was uploaded; upload the scene again")]
    Another,
}

impl ScenePicture {
    /// Reads the file of a picture. `folder` is one where it may stand for a moment.
    ///
    /// # Errors
    /// [`SceneError`] if it cannot be read, or is more than `limits` allow.
    pub fn read(file: &[u8], folder: &Path, limits: &Limits) -> Result<Self, SceneError> {
        let mut standing = tempfile::NamedTempFile::new_in(folder)?;
        standing.write_all(file)?;
        standing.flush()?;
        let picture = ImageFile::open(standing.path(), limits)?;
        let size_px @ [width, height] = picture.size_px();
        let window = picture.window(PixelRect { x: 0, y: 0, width, height }, 1)?;
        Ok(Self { format: picture.format(), size_px, grey: window.grey })
    }
}

/// A scene with the file of its picture.
#[derive(Debug, Clone)]
struct Unread {
    content: SceneContent,
    file: Vec<u8>,
}

impl Unread {
    fn control_point(&self, frame: &LocalFrame, folder: &Path, limits: &Limits) -> Result<ControlPoint, SceneError> {
        let picture = ScenePicture::read(&self.file, folder, limits)?;
        if picture.size_px != self.content.size_px {
            return Err(SceneError::Another);
        }
        Ok(self.content.in_frame(frame, picture.grey))
    }
}

/// The control that may be in view of an image, its pictures not read yet.
#[derive(Debug, Clone)]
pub struct ControlNear {
    lines: Vec<ControlPoint>,
    check: Arc<[ControlPoint]>,
    scenes: Vec<Unread>,
}

impl ControlNear {
    /// Looks for it in the database.
    ///
    /// # Errors
    /// [`ControlError`] if the database fails.
    pub async fn find(database: &Database, work: &Work, reach: Reach, wanted: &Wanted) -> Result<Self, ControlError> {
        let half_view_rad = work.camera.half_view_rad();
        let near = control::around(database, &work.frame, half_view_rad, &work.approximation, reach, wanted).await?;
        let mut scenes = Vec::new();
        for scene in near.scenes {
            // by now it may be another one, or deleted
            if let Some((scene, file)) = with_picture(database, scene.public_id).await? {
                scenes.push(Unread { content: scene.content, file });
            }
        }
        Ok(Self { lines: near.lines, check: near.check.into(), scenes })
    }

    /// Buildings that the orientation is to be checked with.
    #[must_use]
    pub fn check(&self) -> Arc<[ControlPoint]> {
        self.check.clone()
    }

    /// Buildings and scenes: how many there are of each.
    #[must_use]
    pub fn counts(&self) -> [usize; 2] {
        [self.lines.len(), self.scenes.len()]
    }

    /// Reads the pictures, which takes a while: the buildings, and after them the scenes. A scene whose picture cannot be
    /// read is left out, for the others may do without it. `folder` is one where pictures may stand for a moment.
    #[must_use]
    pub fn read(self, frame: &LocalFrame, folder: &Path, limits: &Limits) -> Vec<ControlPoint> {
        let mut control = self.lines;
        for scene in self.scenes {
            match scene.control_point(frame, folder, limits) {
                Ok(point) => control.push(point),
                Err(error) => tracing::warn!(name = scene.content.name, %error, "a control scene is left out"),
            }
        }
        control
    }
}
