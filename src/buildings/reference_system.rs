//! The names under which files give their CRS, and in which order their coordinates come.

use std::sync::Arc;

use super::model::shortened_name;

/// Geographic systems of the EPSG register in which models are published; those whose heights are in the same code too.
const GEOGRAPHIC: &[u32] = &[
    4156, 4171, 4230, 4258, 4267, 4269, 4275, 4277, 4283, 4289, 4301, 4312, 4314, 4326, 4612, 4619, 4937, 4939, 4947,
    4955, 4957, 4965, 4979, 5498, 6318, 6319, 6667, 6668, 6697, 7409, 7423, 7843, 7844, 9286, 9518, 9707, 9924,
];

/// The names of the surveying authorities of the German states (AdV), and the EPSG codes of the same systems.
const OF_ADV: &[(&str, u32)] = &[
    ("ETRS89_UTM31", 25831),
    ("ETRS89_UTM32", 25832),
    ("ETRS89_UTM33", 25833),
    ("ETRS89_LAT-LON", 4258),
    ("DE_DHDN_3GK2", 31466),
    ("DE_DHDN_3GK3", 31467),
    ("DE_DHDN_3GK4", 31468),
    ("DE_DHDN_3GK5", 31469),
    ("DE_DHHN2016_NH", 7837),
    ("DE_DHHN92_NH", 5783),
    ("DE_DHHN85_NOH", 5784),
    ("DE_DHHN12_NOH", 7699),
    // the Polish authority's, in its models of buildings
    ("PL-KRON86-NH", 9650),
    ("PL-EVRF2007-NH", 9651),
];

/// Whether coordinates in a CRS that a file names are taken as degrees; in one that is not known here as metres.
#[must_use]
pub fn is_geographic(name: &str) -> bool {
    ReferenceSystem::parse(name).is_some_and(|system| system.geographic)
}

/// A CRS as a file names it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ReferenceSystem {
    /// `EPSG:25832`, `EPSG:25832+7837`, or the text of the file if it is none that is known here.
    pub(super) text: Arc<str>,
    /// Whether it is in degrees.
    pub(super) geographic: bool,
    /// Whether the latitude comes first.
    latitude_first: bool,
    /// Between which values its eastings lie, where its northings do not.
    eastings: Option<(f64, f64)>,
}

impl ReferenceSystem {
    /// Reads `srsName` or `referenceSystem`; `None` if it is empty.
    pub(super) fn parse(name: &str) -> Option<Self> {
        let name = name.trim();
        if name.is_empty() {
            return None;
        }
        let upper = name.to_ascii_uppercase();
        let codes: Option<Vec<u32>> = parts(&upper).map(code).collect();
        let Some([horizontal, vertical @ ..]) = codes.as_deref() else {
            return Some(Self::unknown(name));
        };
        let mut text = format!("EPSG:{horizontal}");
        for code in vertical {
            text.push_str(&format!("+{code}"));
        }
        let geographic = GEOGRAPHIC.contains(horizontal);
        // the register's order holds where the register is named by a URN or URI; `EPSG:4326` alone has always meant
        // longitude first in GML, and CRS84 says so
        let by_register = upper.starts_with("URN:") || upper.contains("/DEF/CRS");
        let latitude_first = geographic && by_register && !upper.contains("CRS84");
        Some(Self { text: text.into(), geographic, latitude_first, eastings: eastings(*horizontal) })
    }

    fn unknown(name: &str) -> Self {
        let text = shortened_name(name.to_owned());
        Self { text: text.into(), geographic: false, latitude_first: false, eastings: None }
    }

    /// Brings points into the order east or longitude, north or latitude, up.
    ///
    /// The register has the northings of some systems first, and so hardly any publisher writes them: what cannot be
    /// an easting decides. A first coordinate above 90° is no latitude either.
    pub(super) fn order(&self, points: &mut [[f64; 3]]) {
        let Some([first, second, _]) = points.first().copied() else {
            return;
        };
        let swapped = match self.eastings {
            Some((least, most)) => {
                let easting = |value: f64| (least..=most).contains(&value);
                easting(second) && !easting(first)
            }
            None => self.latitude_first && first.abs() <= 90.0,
        };
        if swapped {
            for point in points {
                point.swap(0, 1);
            }
        }
    }
}

/// The parts of a name: the horizontal system and, of a compound, the vertical one.
fn parts(name: &str) -> impl Iterator<Item = &str> {
    let (_, listed) = name.split_once("CRS-COMPOUND?").unwrap_or(("", name));
    let listed = listed.strip_prefix("URN:OGC:DEF:CRS,").unwrap_or(listed);
    listed.split([',', '&', '*', '+']).map(str::trim)
}

/// The EPSG code of one part, in whatever form it is written.
fn code(part: &str) -> Option<u32> {
    let last = part.rsplit([':', '/', '#', '=']).next().unwrap_or(part);
    match last {
        "CRS84" => return Some(4326),
        "CRS84H" => return Some(4979),
        _ => {}
    }
    if let Some((_, code)) = OF_ADV.iter().find(|(name, _)| *name == last) {
        return Some(*code);
    }
    let digits = !last.is_empty() && last.bytes().all(|byte| byte.is_ascii_digit());
    // the second part of `EPSG:25832+7837` stands alone
    let of_epsg = part.contains("EPSG") || part == last;
    if digits && of_epsg { last.parse().ok() } else { None }
}

/// Between which values the eastings of a system lie: with the number of the strip before them, or of UTM.
fn eastings(code: u32) -> Option<(f64, f64)> {
    let strip = |number: u32| {
        let million = f64::from(number) * 1e6;
        Some((million + 200_000.0, million + 800_000.0))
    };
    match code {
        2176..=2179 => strip(code - 2171),
        31466..=31469 => strip(code - 31464),
        25828..=25838 | 32601..=32660 | 32701..=32760 => Some((0.0, 1_000_000.0)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_names_that_states_use_are_understood() {
        for (name, expected) in [
            ("urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH", "EPSG:25832+7837"),
            ("urn:adv:crs:ETRS89_UTM33*DE_DHHN92_NH", "EPSG:25833+5783"),
            ("urn:adv:crs:ETRS89_UTM32", "EPSG:25832"),
            ("urn:adv:crs:DE_DHDN_3GK3*DE_DHHN92_NH", "EPSG:31467+5783"),
            ("EPSG:25832", "EPSG:25832"),
            ("epsg:25832", "EPSG:25832"),
            ("EPSG:25832+7837", "EPSG:25832+7837"),
            ("EPSG:25832+EPSG:7837", "EPSG:25832+7837"),
            ("urn:ogc:def:crs:EPSG::25832", "EPSG:25832"),
            ("urn:ogc:def:crs:EPSG:6.12:25833", "EPSG:25833"),
            ("urn:x-ogc:def:crs:EPSG:25833", "EPSG:25833"),
            ("urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::5783", "EPSG:25832+5783"),
            ("urn:ogc:def:crs,crs:EPSG:6.12:25833,crs:EPSG:6.12:5783", "EPSG:25833+5783"),
            ("urn:ogc:def:crs,crs:EPSG::25832,crs:DE_DHHN2016_NH", "EPSG:25832+7837"),
            ("urn:ogc:def:crs,crs:EPSG::2180,crs:PL-KRON86-NH", "EPSG:2180+9650"),
            ("http://www.opengis.net/def/crs/EPSG/0/6697", "EPSG:6697"),
            ("https://www.opengis.net/def/crs/EPSG/0/7415", "EPSG:7415"),
            ("http://www.opengis.net/gml/srs/epsg.xml#31467", "EPSG:31467"),
            (
                "https://www.opengis.net/def/crs-compound?1=http://www.opengis.net/def/crs/EPSG/0/25832&2=http://www.opengis.net/def/crs/EPSG/0/7837",
                "EPSG:25832+7837",
            ),
            ("http://www.opengis.net/def/crs/OGC/1.3/CRS84", "EPSG:4326"),
            ("  EPSG:7415 ", "EPSG:7415"),
            // what is not known stays as it is, and is not taken for nothing
            ("my local grid", "my local grid"),
            ("urn:adv:crs:ETRS89_UTM32*DE_MOON", "urn:adv:crs:ETRS89_UTM32*DE_MOON"),
            ("EPSG:99999999999", "EPSG:99999999999"),
        ] {
            let found = ReferenceSystem::parse(name).map(|system| system.text);
            assert_eq!(found.as_deref(), Some(expected), "{name}");
        }
        assert_eq!(ReferenceSystem::parse(" "), None);
    }

    fn ordered(name: &str, point: [f64; 3]) -> [f64; 3] {
        let mut points = [point];
        if let Some(system) = ReferenceSystem::parse(name) {
            system.order(&mut points);
        }
        points[0]
    }

    #[test]
    fn longitude_and_easting_come_first_whatever_the_file_has() {
        let tokyo = [139.7, 35.6, 40.0];
        for name in ["http://www.opengis.net/def/crs/EPSG/0/6697", "urn:ogc:def:crs:EPSG::6697"] {
            assert_eq!(ordered(name, [35.6, 139.7, 40.0]), tokyo, "{name}");
            assert_eq!(ordered(name, tokyo), tokyo, "{name}, although the file has it the wrong way round");
        }
        assert_eq!(ordered("EPSG:4326", [-15.4, 27.9, 1.0]), [-15.4, 27.9, 1.0]);
        assert_eq!(ordered("urn:ogc:def:crs:OGC:1.3:CRS84", [7.1, 50.7, 1.0]), [7.1, 50.7, 1.0]);
        assert_eq!(ordered("urn:ogc:def:crs:EPSG::4258", [50.7, 7.1, 1.0]), [7.1, 50.7, 1.0]);
        let bonn = [2_577_000.0, 5_622_000.0, 60.0];
        for name in ["EPSG:31466", "urn:ogc:def:crs:EPSG::31466"] {
            assert_eq!(ordered(name, bonn), bonn);
            assert_eq!(ordered(name, [bonn[1], bonn[0], bonn[2]]), bonn);
        }
        let cologne = [356_000.0, 5_645_000.0, 50.0];
        assert_eq!(ordered("urn:ogc:def:crs:EPSG::25832", cologne), cologne);
    }
}
