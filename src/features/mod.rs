//! Pixels in, image features out, each with its covariance.

pub mod edgels;
pub mod picture;
pub mod segments;
pub mod sift;
pub(crate) mod smooth;

pub use picture::{GreyWindow, Picture, PictureError, PixelRect, Tiling};
pub use segments::{Detection, LineSegment, line_segments};
