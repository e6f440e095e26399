//! Scanned aerial film with known truth, drawn from one seed: for the search of fiducial marks (`crate::interior`).
//!
//! [`SimulatedScan::draw`] makes a scan from a seed and [`ScanSettings`]; [`SimulatedScan::plate`] is what a
//! calibration knows, [`SimulatedScan::truth`] what is to be found out. As a `features::Picture` the scan is rendered
//! only where it is read, at the resolution that is asked for. [`write_tiff`] makes a file of it. The image on the film
//! is a texture of no place, or with [`SimulatedScan::with_content`] whatever a function gives.
//!
//! # What is exact
//! - The marks lie where [`TrueMark::drawn_px`] says: edges, bars and rings are blurred by the normal distribution's
//!   integral, not by sampling, so that the centre of a dot without grain is true to 0.03 pixels (a test measures it).
//!   The marks are drawn by shapes of their own; no template of the finder takes part.
//! - The linear part of laying, rotation, strain and scale. The errors of the plate's making and calibration and the
//!   irregular strain are normal deviates of just the standard deviations in the settings.
//! - Windows of one scan agree: a pixel has the same value in each, and reductions up to 3 are means of pixels.
//!   Larger reductions are means of 4 by 4 spots with softer edges and a grain of their own, as large as a mean's.
//! - A seed gives the same bytes on every machine.
//!
//! # What is left out
//! - The strain is linear but for what each mark has for itself: neither it nor the content is bent in between. The
//!   scanner has no errors of its own, such as stitching, stretched lines or a lens with distortion.
//! - The blur is a Gaussian, the same everywhere. The content is not blurred by it but made with few sharp edges; the
//!   corners of figures are rounded only as far as the blur rounds them.
//! - Grain does not depend on the density, and is the same in the scanner's empty background. Light falls off smoothly,
//!   without Newton's rings, reflections or fingerprints. There is no compression.
//! - All marks of a plate have the same widths and contrast, and none is worn, doubled or unevenly lit. An asymmetric
//!   feature is an arrow or a bar; there are no serial numbers or file names within the frame.
//! - Film edges are straight, without perforation, and parallel to the frame. Data strips, words and stamps look like
//!   writing from afar: their letters mean nothing.
//! - Colour is grey three times.

mod camera;
mod dirt;
mod figures;
mod painter;
mod scan;
mod scene;
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

pub use camera::{Make, PlateSettings};
pub use scan::{Content, Rendering, SimulatedScan};
pub use scene::{FilmScene, SCAN_FILE};
pub use settings::{Corruption, DirtSettings, Laying, ScanSettings, ScannerSettings, StrainSettings};
pub use tiff::{Pieces, TiffSettings, write_tiff};
pub use truth::{MarkState, ScanTruth, TrueMark};
