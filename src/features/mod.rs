//! Pixels in, image features out, each with its covariance.

pub mod picture;

pub use picture::{GreyWindow, Picture, PictureError, PixelRect};
