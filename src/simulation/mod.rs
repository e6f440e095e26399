//! Scenes with known truth: a small town, its control points, a flight over it and its aerial photograph, drawn from
//! one seed. For the demonstration, the tests, the benchmarks and the study of thousands of images (`crate::study`).
//! Scans of aerial film with fiducial marks are in [`film`].
//!
//! [`Scene::draw`] gives everything but the picture, [`Scene::render`] the picture, [`Scene::picture`] one that is
//! rendered only where it is read, [`Scene::write`] the files that the service and the command line read. A seed gives the same bytes on every machine: the draws are ChaCha8's, the
//! transcendental functions those of `libm`, and no result depends on the number of threads.
//!
//! # What is exact
//! Perspective, Brown's distortion, hidden surfaces and cast shadows: a roof edge projected with the true orientation
//! lies on its grey-value edge within some hundredths of a pixel (a test measures it). The errors of the approximate
//! orientation and of the control are normal deviates of just the standard deviations that they state, but for the
//! share of the control that is out of date, and for what the settings add to it: shifts of whole models and of single
//! edges, edges that were not measured, houses that are gone, flights whose navigation errs wildly. By default none is
//! added; what was added is recorded beside each control point.
//!
//! # What is left out
//! Success here is necessary, not sufficient. Compared with real photographs:
//! - Houses are single rectangles under a gable, a hip or a flat roof. There are no dormers, wings, half-hips, gutters
//!   or thick rims, so that few lines run parallel to a roof edge a few pixels beside it. What real control suffers
//!   from them is simulated in the control alone (`ControlSettings::sigma_shift_m`, `sigma_edge_m`), not in the picture.
//! - The errors of models are normal and, unless a strain is asked for, independent from building to building; a real
//!   block is slightly strained, so that neighbours err alike.
//! - All roofs are seen on one day in one light. There are no roofs of grass, no snow, no reflecting water or glass, no
//!   clouds' shadows and no penumbra. A tree in winter has fewer balls of leaves, not branches. Haze is even.
//! - Trees are heaps of balls without branches; few reach over roofs. A real village hides more of its eaves.
//! - The lens blurs all parts of the picture alike, without chromatic aberration or motion; the sensor is grey, its
//!   response linear and its noise independent from pixel to pixel. There is no compression, no rolling shutter and no
//!   error of the calibration: the pipeline is told the true camera.
//! - The ground is smooth; there are no embankments, walls or slopes steeper than a few per cent. Refraction,
//!   below a hundredth of a pixel at these heights, is not simulated.
//! - The errors of the navigation are normal, in a settable share of flights three times as large as stated. Real ones
//!   have longer tails: kappa from a compass can be far off.
//!
//! # How it works
//! A [`Town`] is a list of planar [`Face`]s, of [`Patch`]es painted on the analytic [`Terrain`], and of balls of leaves
//! ([`Puff`]s). The picture is made in square tiles: for several rays through each pixel `visibility` finds the first
//! surface, `sunlight` asks whether the sun sees it too, `shading` gives its grey value, and `photograph` adds lens and
//! sensor.

mod building;
mod control;
mod draws;
mod files;
pub mod film;
mod flight;
mod greenery;
mod lazy;
mod photograph;
mod plots;
mod scene;
mod shading;
mod streets;
mod sunlight;
mod surface;
mod terrain;
mod terrestrial;
mod town;
mod visibility;

#[cfg(test)]
mod tests;

pub use building::{Building, Roof, Use};
pub use control::{ControlSettings, Fault, LEAST_EDGES, SimulatedControlPoint, survey};
pub(crate) use draws::{Draws, Purpose};
pub use files::PHOTOGRAPH_FILE;
pub use flight::{FlightSettings, WILD, fly};
pub use lazy::LazyPhotograph;
pub use photograph::{Photograph, PhotographSettings, photograph, photograph_window};
pub use scene::{CameraSettings, ORIGIN_LON_LAT_H, Scene, SceneSettings, SimulationError};
pub use streets::Street;
pub use surface::{Face, Material, Patch, Puff, Stripes};
pub use terrain::Terrain;
pub use terrestrial::{TEMPLATE_M, TerrestrialView};
pub use town::{Town, TownSettings};
