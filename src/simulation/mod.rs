//! Scenes with known truth: a small town, its control points, a flight over it and its aerial photograph, drawn from
//! one seed. For the demonstration, the tests and the benchmarks.
//!
//! [`Scene::draw`] gives everything but the picture, [`Scene::render`] the picture, [`Scene::write`] the files that the
//! service and the command line read. A seed gives the same bytes on every machine: the draws are ChaCha8's, the
//! transcendental functions those of `libm`, and no result depends on the number of threads.
//!
//! # What is exact
//! Perspective, Brown's distortion, hidden surfaces and cast shadows: a roof edge projected with the true orientation
//! lies on its grey-value edge within some hundredths of a pixel (a test measures it). The errors of the approximate
//! orientation and of the control are normal deviates of just the standard deviations that they state, but for the
//! share of the control that is out of date.
//!
//! # What is left out
//! Success here is necessary, not sufficient. Compared with real photographs:
//! - Houses are single rectangles under a gable, a hip or a flat roof. There are no dormers, wings, half-hips, gutters
//!   or thick rims, so that few lines run parallel to a roof edge a few pixels beside it. Real control suffers from
//!   exactly these: the shifts of 1 to 3 px that all edges of one building share are not simulated.
//! - The edges of a control point err independently at each corner, and every control point has all edges of its roof.
//! - All roofs are seen on one day in one light. There are no roofs of grass, no snow, no bare trees, no reflecting
//!   water or glass, no clouds' shadows and no penumbra.
//! - Trees are heaps of balls without branches; few reach over roofs. A real village hides more of its eaves.
//! - The lens blurs all parts of the picture alike, without chromatic aberration or motion; the sensor is grey, its
//!   response linear and its noise independent from pixel to pixel. There is no compression, no rolling shutter and no
//!   error of the calibration: the pipeline is told the true camera.
//! - The ground is smooth; there are no embankments, walls or slopes steeper than a few per cent. Refraction,
//!   below a hundredth of a pixel at these heights, is not simulated.
//! - The errors of the navigation are normal. Real ones have long tails: kappa from a compass can be far off.
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
pub use town::{Town, TownSettings};
