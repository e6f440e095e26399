//! What GDAL's XML says of the numbers of a grid.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Scale and offset of the numbers, and what they are.
#[derive(Debug, PartialEq)]
pub(super) struct Metadata {
    /// The item `TYPE`.
    pub(super) kind: Option<String>,
    pub(super) scale: f64,
    pub(super) offset: f64,
}

impl Metadata {
    /// Reads `<GDALMetadata><Item name="…" sample="0" role="…">…</Item>…`; an empty text says nothing.
    pub(super) fn read(text: &str) -> Result<Self, String> {
        let mut metadata = Self { kind: None, scale: 1.0, offset: 0.0 };
        let mut reader = Reader::from_str(text.trim_end_matches('\0'));
        let mut item = None;
        loop {
            match reader.read_event().map_err(|error| format!("its GDAL metadata are no XML: {error}"))? {
                Event::Start(element) if element.name().as_ref() == b"Item" => {
                    item = Some((attribute(&element, "name"), attribute(&element, "role"), String::new()));
                }
                Event::Text(found) => {
                    if let Some((.., text)) = &mut item {
                        text.push_str(&found.decode().unwrap_or_default());
                    }
                }
                Event::End(_) => {
                    if let Some((name, role, text)) = item.take() {
                        metadata.take(&name, &role, text.trim())?;
                    }
                }
                Event::Eof => return Ok(metadata),
                _ => {}
            }
        }
    }

    fn take(&mut self, name: &str, role: &str, text: &str) -> Result<(), String> {
        let number = || text.parse::<f64>().ok().filter(|v| v.is_finite());
        let number = || number().ok_or_else(|| format!("its {role} is {text:?}, which is no number"));
        match (name, role) {
            ("TYPE", _) => self.kind = Some(text.to_owned()),
            (_, "scale") => self.scale = number()?,
            (_, "offset") => self.offset = number()?,
            (_, "unittype") if !matches!(text, "metre" | "meter" | "m") => {
                return Err(format!("its numbers are in {text}, not in metres"));
            }
            _ => {}
        }
        Ok(())
    }
}

fn attribute(element: &BytesStart<'_>, name: &str) -> String {
    let found = element.try_get_attribute(name).ok().flatten();
    found.map(|found| String::from_utf8_lossy(&found.value).into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_offset_and_type_are_read() {
        let text = "<GDALMetadata>\n  <Item name=\"TYPE\">VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL</Item>\n  \
                    <Item name=\"OFFSET\" sample=\"0\" role=\"offset\">40</Item>\n  \
                    <Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.001</Item>\n  \
                    <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">metre</Item>\n</GDALMetadata>\0";
        let kind = Some("VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL".to_owned());
        assert_eq!(Metadata::read(text), Ok(Metadata { kind, scale: 0.001, offset: 40.0 }));
        assert_eq!(Metadata::read(""), Ok(Metadata { kind: None, scale: 1.0, offset: 0.0 }));
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for text in [
            "<GDALMetadata><Item role=\"scale\">much</Item></GDALMetadata>",
            "<GDALMetadata><Item role=\"unittype\">foot</Item></GDALMetadata>",
            "<GDALMetadata><Item></GDALMetadata>",
        ] {
            assert!(Metadata::read(text).is_err(), "{text}");
        }
    }
}
