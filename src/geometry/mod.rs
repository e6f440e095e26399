//! The ground floor: rotations, cameras, exterior orientations, line segments, and the way between coordinate
//! reference systems and the local tangent plane in which everything is computed.

pub mod camera;
pub mod crs;
pub mod ellipsoid;
pub mod exterior;
pub mod film;
pub mod local_frame;
pub mod rotation;
pub mod segment;

pub use camera::{Brown, Camera, CameraError};
pub use crs::{Crs, CrsError};
pub use ellipsoid::{Ellipsoid, Geodetic};
pub use exterior::ExteriorOrientation;
pub use film::{Film, FilmError, Smac};
pub use local_frame::LocalFrame;
pub use segment::{Segment2, Segment3};
