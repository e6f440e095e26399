//! CityGML in the dialects of North Rhine-Westphalia, PLATEAU and of version 3.0.

use std::io::{Result, Write};

use super::house::{Body, House, Point};
use super::{Sample, SampleBuilding, Town};

/// What differs.
struct Dialect {
    sample: Sample,
    /// Of core, building and the roof surfaces.
    namespaces: [&'static str; 3],
    gml: &'static str,
    srs_name: &'static str,
    /// Prefix of the surfaces.
    surface: &'static str,
    /// The properties that hold surfaces and parts, and the prefix of those that hold geometry.
    boundary: &'static str,
    part: &'static str,
    geometry: &'static str,
}

impl Dialect {
    fn of(sample: Sample) -> Self {
        let two = Self {
            sample,
            namespaces: [
                "http://www.opengis.net/citygml/2.0",
                "http://www.opengis.net/citygml/building/2.0",
                "http://www.opengis.net/citygml/generics/2.0",
            ],
            gml: "http://www.opengis.net/gml",
            srs_name: "urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH",
            surface: "bldg",
            boundary: "bldg:boundedBy",
            part: "bldg:consistsOfBuildingPart",
            geometry: "bldg",
        };
        match sample {
            Sample::NrwCityGml1 => Self {
                namespaces: [
                    "http://www.opengis.net/citygml/1.0",
                    "http://www.opengis.net/citygml/building/1.0",
                    "http://www.opengis.net/citygml/generics/1.0",
                ],
                ..two
            },
            Sample::Plateau => Self { srs_name: "http://www.opengis.net/def/crs/EPSG/0/6697", ..two },
            Sample::CityGml3 => Self {
                namespaces: [
                    "http://www.opengis.net/citygml/3.0",
                    "http://www.opengis.net/citygml/building/3.0",
                    "http://www.opengis.net/citygml/construction/3.0",
                ],
                gml: "http://www.opengis.net/gml/3.2",
                srs_name: "urn:ogc:def:crs,crs:EPSG::25833,crs:EPSG::5783",
                surface: "con",
                boundary: "core:boundary",
                part: "bldg:buildingPart",
                geometry: "core",
                ..two
            },
            _ => two,
        }
    }

    fn positions(&self, ring: &[Point]) -> String {
        let mut text = String::with_capacity(ring.len() * 36);
        for point in ring.iter().chain(ring.first()) {
            let [first, second, up] = self.sample.place(*point);
            let separator = if text.is_empty() { "" } else { " " };
            text += &match self.sample {
                // latitude first, as the register has it
                Sample::Plateau => format!("{separator}{second:.11} {first:.11} {up:.3}"),
                _ => format!("{separator}{first:.3} {second:.3} {up:.3}"),
            };
        }
        text
    }

    fn polygon(&self, id: &str, ring: &[Point]) -> String {
        format!(
            "<gml:surfaceMember><gml:Polygon gml:id=\"{id}\"><gml:exterior><gml:LinearRing><gml:posList>{}</gml:posList>\
             </gml:LinearRing></gml:exterior></gml:Polygon></gml:surfaceMember>",
            self.positions(ring)
        )
    }
}

pub(super) fn write(
    sample: Sample,
    town: Town,
    out: &mut dyn Write,
    truth: &mut dyn FnMut(&SampleBuilding),
) -> Result<()> {
    let dialect = Dialect::of(sample);
    let [core, building, third] = dialect.namespaces;
    let third_prefix = if sample == Sample::CityGml3 { "con" } else { "gen" };
    writeln!(
        out,
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<core:CityModel xmlns:core=\"{core}\" xmlns:bldg=\"{building}\" \
         xmlns:{third_prefix}=\"{third}\" xmlns:gml=\"{}\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" \
         xmlns:uro=\"https://www.geospatial.jp/iur/uro/3.1\">\n<gml:boundedBy><gml:Envelope srsName=\"{}\" \
         srsDimension=\"3\"><gml:lowerCorner>0 0 0</gml:lowerCorner><gml:upperCorner>0 0 0</gml:upperCorner>\
         </gml:Envelope></gml:boundedBy>",
        dialect.gml, dialect.srs_name
    )?;
    for number in 0..town.buildings {
        let house = House::of(town, number);
        write_house(&dialect, number, &house, out)?;
        truth(&sample.truth(number, &house));
    }
    writeln!(out, "</core:CityModel>")
}

fn write_house(dialect: &Dialect, number: u64, house: &House, out: &mut dyn Write) -> Result<()> {
    let name = dialect.sample.name(number);
    writeln!(out, "<core:cityObjectMember><bldg:Building gml:id=\"{name}\">")?;
    write_attributes(dialect, &name, out)?;
    match house.bodies.as_slice() {
        [body] => write_body(dialect, &name, body, out)?,
        bodies => {
            for (part, body) in bodies.iter().enumerate() {
                let id = format!("{name}_{part}");
                writeln!(out, "<{}><bldg:BuildingPart gml:id=\"{id}\">", dialect.part)?;
                write_body(dialect, &id, body, out)?;
                writeln!(out, "</bldg:BuildingPart></{}>", dialect.part)?;
            }
        }
    }
    if dialect.sample == Sample::Plateau {
        writeln!(
            out,
            "<uro:buildingIDAttribute><uro:BuildingIDAttribute><uro:buildingID>{name}</uro:buildingID>\
             <uro:prefecture codeSpace=\"../../codelists/Common_localPublicAuthorities.xml\">13</uro:prefecture>\
             </uro:BuildingIDAttribute></uro:buildingIDAttribute>"
        )?;
    }
    writeln!(out, "</bldg:Building></core:cityObjectMember>")
}

fn write_attributes(dialect: &Dialect, name: &str, out: &mut dyn Write) -> Result<()> {
    writeln!(out, "<core:creationDate>2024-05-01</core:creationDate>")?;
    if matches!(dialect.sample, Sample::NrwCityGml1 | Sample::NrwCityGml2) {
        for (attribute, value) in
            [("DatenquelleDachhoehe", "1000"), ("DatenquelleLage", "1000"), ("Gemeindeschluessel", name)]
        {
            writeln!(
                out,
                "<gen:stringAttribute name=\"{attribute}\"><gen:value>{value}</gen:value></gen:stringAttribute>"
            )?;
        }
        writeln!(out, "<bldg:measuredHeight uom=\"urn:adv:uom:m\">8.4</bldg:measuredHeight>")?;
    }
    Ok(())
}

fn write_body(dialect: &Dialect, id: &str, body: &Body, out: &mut dyn Write) -> Result<()> {
    let geometry = dialect.geometry;
    if dialect.sample == Sample::Plateau {
        let lifted: Vec<Point> = body.ground.iter().map(|[x, y, _]| [*x, *y, body.mean_height_m]).collect();
        writeln!(
            out,
            "<bldg:lod0RoofEdge><gml:MultiSurface>{}</gml:MultiSurface></bldg:lod0RoofEdge><bldg:lod1Solid><gml:Solid>\
             <gml:exterior><gml:CompositeSurface>{}</gml:CompositeSurface></gml:exterior></gml:Solid></bldg:lod1Solid>",
            dialect.polygon(&format!("{id}_edge"), &body.ground),
            dialect.polygon(&format!("{id}_block"), &lifted)
        )?;
    }
    let mut surfaces: Vec<(&str, Vec<Point>)> = vec![("GroundSurface", body.ground.clone())];
    surfaces.extend(body.roof.iter().map(|ring| ("RoofSurface", ring.clone())));
    surfaces.extend(House::walls(body).map(|ring| ("WallSurface", ring)));
    let reference = |at: usize| format!("<gml:surfaceMember xlink:href=\"#{id}_poly{at}\"/>");
    let references: String = (0..surfaces.len()).map(reference).collect();
    writeln!(
        out,
        "<{geometry}:lod2Solid><gml:Solid><gml:exterior><gml:CompositeSurface>{references}</gml:CompositeSurface>\
         </gml:exterior></gml:Solid></{geometry}:lod2Solid>"
    )?;
    for (at, (kind, ring)) in surfaces.iter().enumerate() {
        let (boundary, prefix) = (dialect.boundary, dialect.surface);
        writeln!(
            out,
            "<{boundary}><{prefix}:{kind} gml:id=\"{id}_{at}\"><{geometry}:lod2MultiSurface><gml:MultiSurface>{}\
             </gml:MultiSurface></{geometry}:lod2MultiSurface></{prefix}:{kind}></{boundary}>",
            dialect.polygon(&format!("{id}_poly{at}"), ring)
        )?;
    }
    Ok(())
}
