//! The database of control: buildings from files, scenes with their pictures, and what may be in view of an image.

pub mod accuracy;
mod choice;
mod encoding;
mod format;
pub mod geojson;
mod geopackage;
mod hilbert;
pub mod model;
pub mod near;
pub mod points;
pub mod reading;
pub mod region;
pub mod report;
pub mod scenes;
#[cfg(test)]
mod set_tests;
pub mod sets;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use choice::chosen_of_many;
pub use format::FileFormat;
pub use geojson::{CollectionError, Rejection, Source};
pub use geopackage::{GeoPackageError, Record};
pub use model::{StoredControlPoint, Use, Validity};
pub use near::{Kinds, Near, Wanted, around};
pub use reading::{ReadError, Reading};
pub use region::GeodeticBox;
pub use report::ImportReport;
pub use scenes::{SceneContent, StoredScene};

/// What becomes of control points whose name is known already.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// They are rejected.
    Insert,
    /// They are updated.
    #[default]
    Upsert,
    /// They are updated, and all control points of the set that are not in the collection are removed.
    Replace,
}

/// Why the control points cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ControlError {
    /// The database failed.
    #[error("the database of control points failed")]
    Database(#[from] sqlx::Error),
    /// The set that is imported to is no longer there.
    #[error("the set was removed while it was imported to; import again")]
    SetRemoved,
    /// A row is not what was written.
    #[error("what is stored of the control {name:?} is damaged; import it again")]
    Damaged {
        /// Its name.
        name: String,
    },
}
