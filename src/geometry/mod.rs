//! The ground floor: rotations, cameras, exterior orientations, line segments, and the way between coordinate
//! reference systems and the local tangent plane in which everything is computed.

mod brown;
pub mod camera;
pub mod crs;
mod digital;
pub mod ellipsoid;
pub mod exterior;
pub mod film;
pub mod fisheye;
pub mod geoid;
pub mod local_frame;
pub mod pixel_from_plate;
pub mod rotation;
mod scan;
pub mod segment;

pub use brown::Brown;
pub use camera::{Camera, CameraError};
pub use crs::{Crs, CrsError, HeightSystem};
pub use ellipsoid::{Ellipsoid, Geodetic};
pub use exterior::ExteriorOrientation;
pub use film::{Film, FilmError, Smac};
pub use fisheye::{Fisheye, Projection};
pub use geoid::{GeoidGrid, Geoids};
pub use local_frame::LocalFrame;
pub use pixel_from_plate::PixelFromPlate;
pub use segment::{Segment2, Segment3};
