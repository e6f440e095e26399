//! Building models of towns that were never built, in the dialects in which states publish theirs, with the edges that
//! a reader must find: for tests, benchmarks and demonstrations.
//!
//! A town is written as a stream, the same for the same seed, however large it is.

mod house;
mod json;
mod xml;

use std::io::{Result, Write};

use super::model::{Format, RoofEdge};
use house::House;

/// A town on a grid of 30 m, with gable roofs, hip roofs, flat roofs, L-shaped houses and houses of two parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Town {
    /// The same seed gives the same town.
    pub seed: u64,
    /// How many buildings it has.
    pub buildings: u64,
}

/// A dialect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sample {
    /// CityGML 1.0 as North Rhine-Westphalia publishes it: `urn:adv` for the CRS, solids that refer to the surfaces.
    NrwCityGml1,
    /// The same in CityGML 2.0.
    NrwCityGml2,
    /// CityGML 2.0 as Japan's PLATEAU publishes it: latitude and longitude, block and roof, attributes of i-UR.
    Plateau,
    /// CityGML 3.0.
    CityGml3,
    /// CityJSON 2.0 like 3DBAG of the Netherlands: four LoDs, the roof in the parts.
    CityJson,
    /// The same as a CityJSON text sequence.
    CityJsonSeq,
}

/// What a reader must find of one building.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleBuilding {
    /// Its identifier.
    pub name: String,
    /// Its edges, in the CRS of the sample and as its numbers are rounded.
    pub edges: Vec<RoofEdge>,
}

impl Sample {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::NrwCityGml1, Self::NrwCityGml2, Self::Plateau, Self::CityGml3, Self::CityJson, Self::CityJsonSeq];

    /// The format of the file.
    #[must_use]
    pub const fn format(self) -> Format {
        match self {
            Self::NrwCityGml1 | Self::NrwCityGml2 | Self::Plateau | Self::CityGml3 => Format::CityGml,
            Self::CityJson => Format::CityJson,
            Self::CityJsonSeq => Format::CityJsonSeq,
        }
    }

    /// The CRS that a reader must find.
    #[must_use]
    pub const fn crs(self) -> &'static str {
        match self {
            Self::NrwCityGml1 | Self::NrwCityGml2 => "EPSG:25832+7837",
            Self::Plateau => "EPSG:6697",
            Self::CityGml3 => "EPSG:25833+5783",
            Self::CityJson | Self::CityJsonSeq => "EPSG:7415",
        }
    }

    /// The identifier of a building.
    fn name(self, number: u64) -> String {
        match self {
            Self::NrwCityGml1 | Self::NrwCityGml2 => format!("DENW{number:012}"),
            Self::Plateau => format!("bldg_{number:08x}-0000-4000-8000-000000000000"),
            Self::CityGml3 => format!("UUID_{number:08x}"),
            Self::CityJson | Self::CityJsonSeq => format!("NL.IMBAG.Pand.{number:016}"),
        }
    }

    /// From metres in the town to the CRS of the sample, rounded as it is written.
    fn place(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let round = |value: f64, digits: f64| (value * digits).round() / digits;
        match self {
            Self::Plateau => {
                // the middle of the town lies a little north of where a degree of longitude is taken
                let degrees = [139.2 + x / (111_320.0 * 0.8131), 35.6 + y / 111_320.0];
                [round(degrees[0], 1e11), round(degrees[1], 1e11), round(z, 1e3)]
            }
            _ => {
                let [east, north] = match self {
                    Self::CityJson | Self::CityJsonSeq => [80_000.0, 430_000.0],
                    Self::CityGml3 => [370_000.0, 5_800_000.0],
                    _ => [300_000.0, 5_600_000.0],
                };
                [round(x + east, 1e3), round(y + north, 1e3), round(z, 1e3)]
            }
        }
    }

    fn truth(self, number: u64, house: &House) -> SampleBuilding {
        let place = |edge: &RoofEdge| RoofEdge { start: self.place(edge.start), end: self.place(edge.end), ..*edge };
        let edges = house.bodies.iter().flat_map(|body| &body.edges).map(place).collect();
        SampleBuilding { name: self.name(number), edges }
    }
}

/// Writes a town, and tells of each building, in the order of the file, what must be found.
///
/// # Errors
/// Those of `out`.
pub fn write(sample: Sample, town: Town, out: &mut dyn Write, truth: &mut dyn FnMut(&SampleBuilding)) -> Result<()> {
    match sample.format() {
        Format::CityGml => xml::write(sample, town, out, truth),
        Format::CityJson => json::write(sample, town, out, truth),
        Format::CityJsonSeq => json::write_sequence(sample, town, out, truth),
    }
}
