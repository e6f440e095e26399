//! What a file of control points is, by what it begins with.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, Visitor};

use super::geopackage;
use crate::buildings;

/// Formats of files of control points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileFormat {
    /// A GeoJSON `FeatureCollection` of `MultiLineString`s.
    GeoJson,
    /// A building model.
    Model(buildings::Format),
    /// A GeoPackage with tables of lines or of the surfaces of roofs.
    GeoPackage,
}

impl FileFormat {
    /// So many bytes should be given to [`Self::recognise`]: a JSON may have long metadata before what tells what it is.
    pub const FIRST_BYTES: u64 = 1 << 20;

    /// The format by the first bytes of a file and, where these leave it open, by its name; `None` if that does too.
    #[must_use]
    pub fn recognise(first: &[u8], name: Option<&str>) -> Option<Self> {
        if first.starts_with(geopackage::MAGIC) {
            return Some(Self::GeoPackage);
        }
        let model = buildings::Format::recognise(first, name)?;
        if model == buildings::Format::CityGml {
            return Some(Self::Model(model));
        }
        match content(first).or_else(|| named(name?))? {
            Content::City => Some(Self::Model(model)),
            // which may have no byte order mark
            Content::Features => (first.trim_ascii_start().first() == Some(&b'{')).then_some(Self::GeoJson),
        }
    }
}

/// What a JSON is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Content {
    /// A city, in one piece or as a sequence.
    City,
    /// Features, which the reader may find to be no collection.
    Features,
}

fn named(name: &str) -> Option<Content> {
    let name = name.to_ascii_lowercase();
    match name.contains(".city.json") {
        true => Some(Content::City),
        false => name.ends_with(".geojson").then_some(Content::Features),
    }
}

/// What a JSON that begins so is about, by the first of its own members that tells; they may come in any order.
fn content(first: &[u8]) -> Option<Content> {
    let mut found = None;
    let text = first.strip_prefix(b"\xef\xbb\xbf").unwrap_or(first);
    // that it ends in the middle is an error which comes after all that was found
    let _ = Members(&mut found).deserialize(&mut serde_json::Deserializer::from_slice(text));
    found
}

/// Reads the members of an object up to the first that tells.
struct Members<'f>(&'f mut Option<Content>);

impl<'de> DeserializeSeed<'de> for Members<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Members<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            *self.0 = match key.as_str() {
                "CityObjects" | "vertices" | "transform" => Some(Content::City),
                "features" => Some(Content::Features),
                "type" => match map.next_value::<String>()?.as_str() {
                    "CityJSON" | "CityJSONFeature" => Some(Content::City),
                    _ => Some(Content::Features),
                },
                _ => {
                    map.next_value::<IgnoredAny>()?;
                    continue;
                }
            };
            break;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::buildings::Format;

    const CITY: Option<FileFormat> = Some(FileFormat::Model(Format::CityJson));

    fn format(text: &str, name: &str) -> Option<FileFormat> {
        FileFormat::recognise(text.as_bytes(), Some(name))
    }

    #[test]
    fn json_is_a_building_model_only_where_it_says_so() {
        // members may stand in any order
        let features = r#"{"features": [{"type": "Feature"}], "type": "FeatureCollection"}"#;
        assert_eq!(format(features, "roofs.json"), Some(FileFormat::GeoJson));
        assert_eq!(
            format(features, "roofs.city.json"),
            Some(FileFormat::GeoJson),
            "what it holds goes before its name"
        );
        let city = r#"{"CityObjects": {}, "type": "CityJSON", "version": "2.0"}"#;
        assert_eq!(format(city, "roofs.json"), CITY);
        let sequence = "{\"type\": \"CityJSON\"}\n{\"type\": \"CityJSONFeature\"}\n";
        assert_eq!(format(sequence, "tile"), Some(FileFormat::Model(Format::CityJsonSeq)));
        assert_eq!(format("<?xml version=\"1.0\"?>", "a"), Some(FileFormat::Model(Format::CityGml)));
        assert_eq!(format("lines", "a"), None);
    }

    #[test]
    fn what_tells_may_come_after_long_members() {
        let numbers = "[1,2,3],".repeat(1_000);
        assert_eq!(format(&format!("{{\"vertices\":[{numbers}"), "roofs.json"), CITY);
        let metadata = format!("{{\"metadata\":{{\"a\":[{numbers}0],\"type\":\"FeatureCollection\"}}");
        assert_eq!(format(&format!("{metadata},\"type\":\"CityJSON\",\"CityObjects\":{{"), "roofs.json"), CITY);
        let features = format!("{metadata},\"features\":[{{\"CityObjects\":0}}");
        assert_eq!(format(&features, "roofs.json"), Some(FileFormat::GeoJson));
        // what leaves it open is not guessed
        assert_eq!(format(&metadata, "roofs.json"), None);
        assert_eq!(format(&metadata, "roofs.city.json"), CITY);
        assert_eq!(format(&metadata, "roofs.GeoJSON"), Some(FileFormat::GeoJson));
        assert_eq!(format("{\"a\":1}", "roofs.json"), None);
    }
}
