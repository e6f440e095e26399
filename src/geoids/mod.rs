//! Geoid grids in a folder, by the names that PROJ gives them: GeoTIFF as <https://cdn.proj.org> has it, and GTX.
//!
//! A grid is opened when it is first asked for, and its parts are decoded when they are first looked at: of a model of the
//! whole Earth an image needs one tile. What is decoded stays, up to a bound.
//!
//! A height system without a grid finds one that is put into the folder later. One that has been served keeps the grids that
//! it was served by: a better one is taken when the process starts anew, and until then all heights come from one model.

mod geotiff;
mod gtx;
mod parts;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::geometry::geoid::{GridFileFault, NamedGrid};
use crate::geometry::{Crs, GeoidGrid, Geoids, HeightSystem};

/// The grids of a folder.
#[derive(Debug)]
pub struct GeoidFolder {
    folder: PathBuf,
    open: Mutex<Open>,
}

#[derive(Debug, Default)]
struct Open {
    grids: HashMap<&'static str, Arc<GeoidGrid>>,
    /// What was told for a list of names, once any was there.
    told: HashMap<&'static [&'static str], Arc<[NamedGrid]>>,
}

/// Why a file is no geoid grid.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GeoidFileError {
    /// It cannot be read.
    #[error("it cannot be read: {0}")]
    Unreadable(#[from] std::io::Error),
    /// Its TIFF is damaged or of a kind that is not understood.
    #[error("its TIFF cannot be read: {0}")]
    Tiff(#[from] tiff::TiffError),
    /// It is something else than a grid of undulations in longitude and latitude.
    #[error("{0}")]
    NoGrid(String),
}

/// A grid that lies in the folder.
#[derive(Debug)]
pub struct Found {
    /// Its name without the ending.
    pub name: &'static str,
    /// The height systems that it serves.
    pub systems: Vec<&'static str>,
    /// What is wrong with it, if anything.
    pub fault: Option<String>,
}

/// The grid that a system uses first, of those that were found; `None` if it has none.
#[must_use]
pub fn first_used(system: HeightSystem, found: &[Found]) -> Option<&'static str> {
    system.grids.iter().copied().find(|name| found.iter().any(|found| found.name == *name))
}

/// The endings that grids have, the one to be preferred first.
const ENDINGS: [&str; 2] = ["tif", "gtx"];

impl GeoidFolder {
    /// The grids that lie in a folder, which need not be there.
    #[must_use]
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into(), open: Mutex::default() }
    }

    /// The known grids that lie in the folder, each opened for a look at its head.
    #[must_use]
    pub fn found(&self) -> Vec<Found> {
        let mut found: Vec<Found> = Vec::new();
        for system in Crs::height_systems() {
            for &name in system.grids {
                if let Some(known) = found.iter_mut().find(|known| known.name == name) {
                    known.systems.push(system.name);
                    continue;
                }
                let fault = match self.grid(name, &mut self.lock().grids) {
                    Ok(None) => continue,
                    Ok(Some(_)) => None,
                    Err(fault) => Some(fault),
                };
                found.push(Found { name, systems: vec![system.name], fault });
            }
        }
        found
    }

    fn file(&self, name: &str) -> Option<PathBuf> {
        ENDINGS.iter().map(|ending| self.folder.join(format!("{name}.{ending}"))).find(|file| file.is_file())
    }

    fn lock(&self) -> MutexGuard<'_, Open> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn grid(
        &self,
        name: &'static str,
        open: &mut HashMap<&'static str, Arc<GeoidGrid>>,
    ) -> Result<Option<Arc<GeoidGrid>>, String> {
        if let Some(grid) = open.get(name) {
            return Ok(Some(grid.clone()));
        }
        let Some(file) = self.file(name) else { return Ok(None) };
        let grid = Arc::new(read(&file).map_err(|error| error.to_string())?);
        open.insert(name, grid.clone());
        Ok(Some(grid))
    }
}

impl Geoids for GeoidFolder {
    fn grids(&self, names: &'static [&'static str]) -> Result<Arc<[NamedGrid]>, GridFileFault> {
        let mut open = self.lock();
        if let Some(told) = open.told.get(names) {
            return Ok(told.clone());
        }
        let mut found = Vec::new();
        for &name in names {
            let grid = self.grid(name, &mut open.grids);
            let grid = grid.map_err(|reason| GridFileFault { name: name.to_owned(), reason })?;
            found.extend(grid.map(|grid| NamedGrid { name, grid }));
        }
        let found: Arc<[NamedGrid]> = found.into();
        if let (Some(used), Some(preferred)) = (found.first(), names.first()) {
            if used.name != *preferred {
                tracing::warn!(
                    grid = used.name,
                    preferred,
                    "heights come from a geoid grid that is not the one to be preferred"
                );
            }
            open.told.insert(names, found.clone());
        }
        Ok(found)
    }
}

/// Opens a grid; its ending says what it is.
///
/// # Errors
/// [`GeoidFileError`] unless its head is that of a grid. A damaged part shows when it is first looked at.
pub fn read(file: &Path) -> Result<GeoidGrid, GeoidFileError> {
    if file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("gtx")) {
        gtx::open(file)
    } else {
        geotiff::open(file)
    }
}
