//! Pictures of a known pattern in all variants, damaged ones, and the real photographs.

mod damage;
mod formats;
mod headers;
mod levels;
mod pattern;
mod photographs;
mod tiff_writer;
mod windows;
