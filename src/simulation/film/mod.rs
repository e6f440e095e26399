//! Scanned aerial film with known truth, drawn from one seed: for the search of fiducial marks (`crate::interior`).

mod camera;
mod dirt;
mod figures;
mod painter;
mod scan;
mod settings;
mod shape;
mod sheet;
mod strip;
mod texture;
mod tiff;
mod tone;
mod truth;

#[cfg(test)]
mod tests;

pub use camera::{FilmCamera, PlateSettings};
pub use scan::{Content, Rendering, SimulatedScan};
pub use settings::{Corruption, DirtSettings, Laying, ScanSettings, ScannerSettings, StrainSettings};
pub use tiff::{Pieces, TiffSettings, write_tiff};
pub use truth::{MarkState, ScanTruth, TrueMark};
