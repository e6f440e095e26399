//! The interior orientation of scanned film: from the scan's pixels to the plate's millimetres, after Schickler and
//! Poth, "The Automatic Interior Orientation and its Daily Use" (1996).

pub mod mark;
pub mod plate;

pub use mark::{Cut, Library, Mark};
pub use plate::{AsymmetricFeature, Fiducial, Plate, Side};
