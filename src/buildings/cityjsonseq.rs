//! CityJSON text sequences: a line of metadata, then a line for each feature. Several may follow each other in one file,
//! as `cat` makes of them: a further line of metadata holds for what comes after it.

use std::borrow::Cow;
use std::fmt;
use std::io::{BufRead, ErrorKind};
use std::ops::ControlFlow;

use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde_json::value::RawValue;

use super::feature::{self, Frame, Metadata, Object, Transform, Written};
use super::model::{Item, Limits, ModelError, Refused};

/// The line of metadata: what holds for all features after it.
#[derive(Debug)]
struct Header {
    frame: Frame,
    /// Whether the line has buildings itself.
    has_objects: bool,
}

#[derive(Deserialize)]
struct MetadataLine<'a> {
    #[serde(borrow)]
    r#type: Cow<'a, str>,
    version: Option<serde_json::Value>,
    transform: Option<Transform>,
    metadata: Option<Metadata>,
    #[serde(borrow, rename = "CityObjects")]
    objects: Option<&'a RawValue>,
}

impl Header {
    /// Reads the line of this number.
    fn parse(line: &[u8], number: u64) -> Result<Self, ModelError> {
        let line = std::str::from_utf8(line).map_err(|_| ModelError::NotUtf8 { line: number })?;
        let read: MetadataLine<'_> = serde_json::from_str(line)
            .map_err(|error| ModelError::of_json(&format!("the metadata in line {number} of the file: "), &error))?;
        check_type(&read.r#type, read.version.as_ref())?;
        let system = read.metadata.as_ref().and_then(Metadata::system);
        let transform = read.transform.unwrap_or_default();
        let is_empty = |text: &str| text.bytes().all(|byte| byte.is_ascii_whitespace() || b"{}".contains(&byte));
        let has_objects = read.objects.is_some_and(|objects| !is_empty(objects.get()));
        Ok(Self { frame: Frame { system, transform }, has_objects })
    }
}

/// Whether a line says that it is one of metadata.
fn is_metadata(line: &[u8]) -> bool {
    #[derive(Deserialize)]
    struct OnlyType<'a> {
        #[serde(borrow)]
        r#type: Cow<'a, str>,
    }
    // hardly any other line has the word, and none is read twice for it
    std::str::from_utf8(line).is_ok_and(|line| {
        line.contains("\"CityJSON\"")
            && serde_json::from_str::<OnlyType<'_>>(line).is_ok_and(|line| line.r#type == "CityJSON")
    })
}

/// Whether a file says that it is CityJSON of a version that is read.
pub(super) fn check_type(kind: &str, version: Option<&serde_json::Value>) -> Result<(), ModelError> {
    let other = |detail: String| Err(ModelError::OtherContent { detail });
    if kind != "CityJSON" {
        let shown: String = kind.chars().take(50).collect();
        return other(format!("the \"type\" of the file is \"{shown}\"; it must be \"CityJSON\""));
    }
    match version {
        Some(serde_json::Value::String(version)) if version.starts_with("1.") || version.starts_with("2.") => Ok(()),
        Some(version) => {
            let shown: String = version.to_string().chars().take(50).collect();
            other(format!("the version of CityJSON is {shown}; \"1.0\", \"1.1\" and \"2.0\" are read"))
        }
        None => other("the file says no \"version\" of CityJSON; it must be \"1.0\", \"1.1\" or \"2.0\"".to_owned()),
    }
}

#[derive(Deserialize)]
struct Feature<'a> {
    #[serde(borrow)]
    r#type: Cow<'a, str>,
    #[serde(borrow, rename = "CityObjects")]
    objects: Objects<'a>,
    vertices: Vec<[f64; 3]>,
}

/// The objects of a feature in their order, each with its name.
struct Objects<'a>(Vec<(Cow<'a, str>, Written<'a>)>);

impl<'de: 'a, 'a> Deserialize<'de> for Objects<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(ObjectsVisitor)
    }
}

struct ObjectsVisitor;

/// A text that is borrowed where it has no escapes.
#[derive(Deserialize)]
struct Name<'a>(#[serde(borrow)] Cow<'a, str>);

impl<'de> Visitor<'de> for ObjectsVisitor {
    type Value = Objects<'de>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object of CityObjects by their identifiers")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut objects = Vec::new();
        while let Some(Name(name)) = map.next_key()? {
            objects.push((name, map.next_value()?));
        }
        Ok(Objects(objects))
    }
}

/// The identifier of a line that cannot be read otherwise.
#[derive(Deserialize)]
struct OnlyName {
    id: String,
}

/// The buildings of one line, and what is wrong with it; `index` is the number of its first item. A line that has none
/// of either gives nothing.
fn read_line(header: &Header, line: &[u8], index: usize, limits: &Limits) -> Vec<Item> {
    let refused = |detail: String, name: Option<String>| vec![Item::Refused(Refused::new(index, name, detail))];
    let Ok(line) = std::str::from_utf8(line) else {
        return refused("the line is not UTF-8".to_owned(), None);
    };
    let name = || serde_json::from_str::<OnlyName>(line).ok().map(|only| only.id);
    let feature: Feature<'_> = match serde_json::from_str(line) {
        Ok(feature) => feature,
        Err(error) => {
            // every text is one line
            let place = format!("column {}", error.column());
            let text = error.to_string();
            let what = text.split(" at line ").next().unwrap_or(&text);
            return refused(format!("the line is no CityJSONFeature: {what}, {place}"), name());
        }
    };
    if feature.r#type != "CityJSONFeature" && feature.r#type != "CityJSON" {
        let shown: String = feature.r#type.chars().take(50).collect();
        return refused(format!("the \"type\" of the line is \"{shown}\"; it must be \"CityJSONFeature\""), name());
    }
    if feature.vertices.len() > limits.building_vertices {
        let (given, limit) = (feature.vertices.len(), limits.building_vertices);
        return refused(format!("the line has {given} vertices; at most {limit} are accepted"), name());
    }
    let objects: Vec<Object> =
        feature.objects.0.iter().filter_map(|(name, written)| Object::of(name, written, limits)).collect();
    let mut items = Vec::with_capacity(1);
    feature::items(&objects, &feature.vertices, &header.frame, index, &mut |item| {
        items.push(item);
        true
    });
    items
}

/// A line of the input.
enum Line {
    Whole,
    TooLong,
    End,
}

/// Reads a line without its end; one that is too long is passed over.
fn next_line(input: &mut dyn BufRead, longest: u64, line: &mut Vec<u8>) -> Result<Line, ModelError> {
    line.clear();
    let (mut any, mut too_long) = (false, false);
    loop {
        let bytes = match input.fill_buf() {
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            other => other.map_err(ModelError::Input)?,
        };
        if bytes.is_empty() {
            break;
        }
        any = true;
        let end = bytes.iter().position(|byte| *byte == b'\n');
        let content = &bytes[..end.unwrap_or(bytes.len())];
        too_long |= (line.len() + content.len()) as u64 > longest;
        if !too_long {
            line.extend_from_slice(content);
        }
        let read = content.len() + usize::from(end.is_some());
        input.consume(read);
        if end.is_some() {
            break;
        }
    }
    Ok(match (any, too_long) {
        (false, _) => Line::End,
        (true, true) => Line::TooLong,
        (true, false) => Line::Whole,
    })
}

/// Reads a sequence. What is wrong with a line refuses that line; its number is in the detail.
pub(super) fn read(
    input: &mut dyn BufRead,
    limits: &Limits,
    each: &mut dyn FnMut(Item) -> ControlFlow<()>,
) -> Result<(), ModelError> {
    let mut line = Vec::new();
    let mut header: Option<Header> = None;
    let mut index = 0;
    for number in 1_u64.. {
        let content = match next_line(input, limits.building_bytes, &mut line)? {
            Line::End => break,
            Line::TooLong if header.is_none() => {
                let (place, what) = (format!("line {number}"), "the line of metadata");
                return Err(ModelError::TooLarge { place, what, limit: limits.building_bytes });
            }
            Line::TooLong => None,
            Line::Whole => Some(without_mark(&line, number)),
        };
        if content.is_some_and(|content| content.trim_ascii().is_empty()) {
            continue;
        }
        let items = match (&mut header, content) {
            (Some(header), Some(content)) if !is_metadata(content) => read_line(header, content, index, limits),
            (Some(_), None) => {
                let detail = format!("the line is longer than {} bytes", limits.building_bytes);
                vec![Item::Refused(Refused::new(index, None, detail))]
            }
            (header, content) => {
                let content = content.unwrap_or_default();
                let header = header.insert(Header::parse(content, number)?);
                if header.has_objects { read_line(header, content, index, limits) } else { Vec::new() }
            }
        };
        for item in items {
            index += 1;
            if each(with_line(item, number)).is_break() {
                return Ok(());
            }
        }
    }
    if index == 0 { Err(ModelError::NoBuilding) } else { Ok(()) }
}

/// A byte order mark may begin the file.
fn without_mark(line: &[u8], number: u64) -> &[u8] {
    if number == 1 { line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line) } else { line }
}

fn with_line(item: Item, number: u64) -> Item {
    match item {
        Item::Refused(refused) => {
            Item::Refused(Refused::new(refused.index, refused.name, format!("line {number}: {}", refused.detail)))
        }
        building => building,
    }
}
