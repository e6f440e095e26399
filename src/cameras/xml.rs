//! XML as a small tree, for files of a few kilobytes.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::CameraFileError;

/// An element with what is in it.
#[derive(Debug, Default)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) attributes: Vec<(String, String)>,
    pub(super) text: String,
    pub(super) children: Vec<Element>,
}

/// Deeper files are not met; without a bound they would overflow the stack when they are dropped.
const DEEPEST: usize = 64;

impl Element {
    /// The root of a document.
    pub(super) fn read(text: &str) -> Result<Self, CameraFileError> {
        let mut reader = Reader::from_str(text);
        let mut open = vec![Self::default()];
        loop {
            let event = reader.read_event().map_err(|error| {
                let line =
                    text.as_bytes().iter().take(reader.error_position() as usize).filter(|c| **c == b'\n').count();
                wrong(format!("line {}", line + 1), format!("it is no XML: {error}"))
            })?;
            match event {
                Event::Start(start) if open.len() > DEEPEST => {
                    return Err(wrong(named(&start), format!("it is nested more than {DEEPEST} deep")));
                }
                Event::Start(start) => open.push(Self::of(&start)),
                Event::Empty(start) => {
                    let child = Self::of(&start);
                    if let Some(parent) = open.last_mut() {
                        parent.children.push(child);
                    }
                }
                Event::Text(found) => {
                    let found = found.decode().unwrap_or_default();
                    if let Some(element) = open.last_mut() {
                        element.text.push_str(&found);
                    }
                }
                Event::End(_) => {
                    let closed = open.pop().unwrap_or_default();
                    match open.last_mut() {
                        Some(parent) => parent.children.push(closed),
                        None => return Err(wrong("file".into(), "it closes what was not opened".into())),
                    }
                }
                Event::Eof => break,
                _ => {}
            }
        }
        let unclosed = open.len() > 1;
        let mut top = open.swap_remove(0).children;
        if unclosed || top.len() != 1 {
            return Err(wrong("file".into(), "it is no XML with one root".into()));
        }
        Ok(top.swap_remove(0))
    }

    fn of(start: &BytesStart<'_>) -> Self {
        let attributes = start.attributes().flatten().map(|attribute| {
            let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
            (text(attribute.key.as_ref()), text(&attribute.value))
        });
        Self { name: named(start), attributes: attributes.collect(), ..Self::default() }
    }

    /// The first child of this name.
    pub(super) fn child(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    /// An attribute.
    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }

    /// All elements of this name below, in the order of the file.
    pub(super) fn all<'a>(&'a self, name: &str, found: &mut Vec<&'a Self>) {
        for child in &self.children {
            if child.name == name {
                found.push(child);
            }
            child.all(name, found);
        }
    }
}

fn named(start: &BytesStart<'_>) -> String {
    String::from_utf8_lossy(start.name().as_ref()).into_owned()
}

fn wrong(place: String, detail: String) -> CameraFileError {
    CameraFileError::Text { place, detail }
}
