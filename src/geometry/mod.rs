//! The ground floor: rotations, cameras, exterior orientations, line segments, and the way between coordinate
//! reference systems and the local tangent plane in which everything is computed.

pub mod camera;
pub mod exterior;
pub mod rotation;
pub mod segment;

pub use camera::{Brown, Camera, CameraError};
pub use exterior::ExteriorOrientation;
pub use segment::{Segment2, Segment3};
