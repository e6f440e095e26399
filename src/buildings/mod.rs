//! Building models as states publish them, CityGML and CityJSON, and the edges of the roofs in them.
//!
//! A model is read as a stream: a building at a time is handed over and forgotten. What is wrong with one building
//! refuses that building and never loses the others; only what makes the rest of the file unreadable ends the reading.
//! The files come from strangers: everything that could grow is bounded by [`Limits`].
//!
//! Roof surfaces of level of detail (LoD) 2 and above count. Those of LoD 1 are blocks whose tops lie at some mean
//! height, where no camera sees a line.

mod citygml;
mod cityjson;
mod cityjsonseq;
mod feature;
mod meter;
mod model;
mod reference_system;
mod roof;
pub mod samples;

use std::io::BufRead;
use std::ops::ControlFlow;

pub use model::{Building, EdgeKind, Format, Item, Limits, ModelError, Refused, RoofEdge};
pub(crate) use model::{FARTHEST, LONGEST_NAME, shortened_detail, shortened_name};
pub use reference_system::is_geographic;

/// Reads a model and hands over its buildings, each with its roof edges or with what is wrong with it, in the order of
/// the file. Ends early, and well, where `each` breaks.
///
/// # Errors
/// [`ModelError`] if the file as a whole cannot be read, or not to its end. What was handed over before was read well.
pub fn read(
    format: Format,
    input: &mut dyn BufRead,
    limits: &Limits,
    each: &mut dyn FnMut(Item) -> ControlFlow<()>,
) -> Result<(), ModelError> {
    match format {
        Format::CityJson => cityjson::read(input, limits, each),
        Format::CityJsonSeq => cityjsonseq::read(input, limits, each),
        Format::CityGml => citygml::read(input, limits, each),
    }
}

/// The edges of the roof that is made of these polygons, each of which has rings, the outer one first; `geographic` if
/// they are in degrees.
///
/// # Errors
/// Why it has none.
pub(crate) fn roof_edges(polygons: &[Vec<Vec<[f64; 3]>>], geographic: bool) -> Result<Vec<RoofEdge>, String> {
    let mut surfaces = roof::Surfaces::default();
    for rings in polygons {
        for ring in rings {
            ring.iter().for_each(|point| surfaces.point(*point));
            surfaces.end_ring();
        }
        surfaces.end_polygon();
    }
    roof::edges(&surfaces, geographic).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests;
