//! CityGML 1.0, 2.0 and 3.0, read as a stream of XML: one building is in memory at a time.
//!
//! What matters is known by its local name and the namespace to which its prefix is bound. Everything within each other
//! is counted rather than kept: a stack of depths at which the few elements that matter were opened says where one is.

mod house;
mod tag;

use std::io::BufRead;
use std::ops::ControlFlow;

use quick_xml::Error;
use quick_xml::NsReader;
use quick_xml::escape::EscapeError;
use quick_xml::events::{BytesDecl, BytesStart, Event};
use quick_xml::name::NamespaceResolver;

use self::house::House;
use self::tag::Tag;
use super::meter::{Count, Meter};
use super::model::{Item, Limits, ModelError, Refused};
use super::reference_system::ReferenceSystem;

/// Reads a file.
pub(super) fn read(
    input: &mut dyn BufRead,
    limits: &Limits,
    each: &mut dyn FnMut(Item) -> ControlFlow<()>,
) -> Result<(), ModelError> {
    let meter = Meter::new(input, limits.building_bytes);
    let count = meter.count();
    let mut reader = NsReader::from_reader(meter);
    let mut town = Town { limits, count: count.clone(), depth: 0, root: None, system: None, house: None, index: 0 };
    let mut buffer = Vec::new();
    loop {
        buffer.clear();
        count.allow(limits.building_bytes);
        let event = reader.read_event_into(&mut buffer).map_err(|error| town.explain(error))?;
        if std::str::from_utf8(&event).is_err() {
            return Err(ModelError::NotUtf8 { line: count.line() });
        }
        let item = match event {
            Event::Start(element) => town.open(&element, reader.resolver()).map(|()| None)?,
            Event::Empty(element) => {
                town.open(&element, reader.resolver())?;
                town.close()
            }
            Event::End(_) => town.close(),
            Event::Text(text) => town.text(&text).map(|()| None)?,
            Event::CData(text) => town.text(&text).map(|()| None)?,
            Event::GeneralRef(reference) => town.reference(&reference).map(|()| None)?,
            Event::Decl(declaration) => town.declaration(&declaration).map(|()| None)?,
            Event::DocType(_) => return Err(town.entity("a document type (DOCTYPE)")),
            Event::Eof => return town.end(),
            Event::Comment(_) | Event::PI(_) => None,
        };
        if let Some(item) = item
            && each(item).is_break()
        {
            return Ok(());
        }
    }
}

/// Where the reading is.
struct Town<'a> {
    limits: &'a Limits,
    count: Count,
    /// How many elements are open.
    depth: usize,
    /// The name of the outermost element.
    root: Option<String>,
    /// The CRS of the whole file.
    system: Option<ReferenceSystem>,
    /// The building that is being read.
    house: Option<House>,
    /// The number of the next item.
    index: usize,
}

/// The attributes that matter.
#[derive(Debug, Default)]
struct Attributes {
    id: Option<String>,
    href: Option<String>,
    srs_name: Option<String>,
    srs_dimension: Option<String>,
}

impl Town<'_> {
    fn open(&mut self, element: &BytesStart<'_>, namespaces: &NamespaceResolver) -> Result<(), ModelError> {
        self.depth += 1;
        if self.depth > self.limits.depth {
            return Err(ModelError::TooDeep { line: self.count.line(), limit: self.limits.depth });
        }
        if self.depth == 1 {
            self.root = Some(String::from_utf8_lossy(element.local_name().as_ref()).into_owned());
        }
        if self.house.as_ref().is_some_and(House::passes_over) {
            return Ok(());
        }
        let tag = Tag::of(element.name(), namespaces);
        let wanted = match &self.house {
            None => matches!(tag, Tag::Building) || (tag == Tag::Envelope && self.depth == 3),
            Some(house) => house.wants_attributes(tag, self.depth),
        };
        let attributes = if wanted { self.attributes(element)? } else { Attributes::default() };
        let bytes = self.count.bytes();
        match &mut self.house {
            Some(house) => house.open(tag, self.depth, attributes, self.count.line()),
            None if tag == Tag::Building => {
                self.house = Some(House::new(attributes.id, self.depth, bytes, self.count.line()));
            }
            None if tag == Tag::Envelope && wanted && self.system.is_none() => {
                self.system = attributes.srs_name.as_deref().and_then(ReferenceSystem::parse);
            }
            None => {}
        }
        Ok(())
    }

    fn attributes(&self, element: &BytesStart<'_>) -> Result<Attributes, ModelError> {
        let mut found = Attributes::default();
        if element.attributes_raw().is_empty() {
            return Ok(found);
        }
        for attribute in element.attributes().with_checks(false) {
            let attribute = attribute.map_err(|error| self.explain(error.into()))?;
            let slot = match attribute.key.local_name().as_ref() {
                b"id" => &mut found.id,
                b"href" => &mut found.href,
                b"srsName" => &mut found.srs_name,
                b"srsDimension" => &mut found.srs_dimension,
                _ => continue,
            };
            let text =
                std::str::from_utf8(&attribute.value).map_err(|_| ModelError::NotUtf8 { line: self.count.line() })?;
            let text = quick_xml::escape::unescape(text).map_err(|error| self.explain(error.into()))?;
            *slot = Some(text.into_owned());
        }
        Ok(found)
    }

    fn close(&mut self) -> Option<Item> {
        let depth = self.depth;
        self.depth = depth.saturating_sub(1);
        let house = self.house.as_mut()?;
        if house.bytes_before() + self.limits.building_bytes < self.count.bytes() {
            house.refuse(format!("the building is larger than {} bytes", self.limits.building_bytes));
        }
        if !house.close(depth, self.limits) {
            return None;
        }
        let index = self.index;
        self.index += 1;
        let house = self.house.take()?;
        let line = house.line();
        let name = house.name().map(str::to_owned);
        Some(house.finish(index, self.system.as_ref(), self.limits).unwrap_or_else(|detail| {
            let detail = format!("the building that begins in line {line}: {detail}");
            Item::Refused(Refused::new(index, name, detail))
        }))
    }

    fn text(&mut self, text: &[u8]) -> Result<(), ModelError> {
        if self.depth == 0 && !text.trim_ascii().is_empty() && text.trim_ascii() != b"\xef\xbb\xbf" {
            return Err(self.malformed("there is text outside of all elements".to_owned()));
        }
        if let Some(house) = &mut self.house
            && house.takes_text()
        {
            house.text(text, self.limits, self.count.line());
        }
        Ok(())
    }

    fn reference(&mut self, name: &[u8]) -> Result<(), ModelError> {
        if name.starts_with(b"#") || [&b"amp"[..], b"lt", b"gt", b"apos", b"quot"].contains(&name) {
            // in the middle of coordinates it is no number
            return self.text(b"&");
        }
        let shown: String = String::from_utf8_lossy(name).chars().take(50).collect();
        Err(self.entity(&format!("the entity &{shown};")))
    }

    fn declaration(&self, declaration: &BytesDecl<'_>) -> Result<(), ModelError> {
        let Some(Ok(encoding)) = declaration.encoding() else {
            return Ok(());
        };
        if [&b"utf-8"[..], b"utf8", b"us-ascii"].contains(&encoding.to_ascii_lowercase().as_slice()) {
            return Ok(());
        }
        Err(ModelError::Encoding { encoding: String::from_utf8_lossy(&encoding).chars().take(50).collect() })
    }

    fn end(&self) -> Result<(), ModelError> {
        match &self.root {
            None => Err(self.malformed("there is no element in it".to_owned())),
            Some(_) if self.depth > 0 => {
                Err(self.malformed(format!("the file ends within {} open elements: it is cut off", self.depth)))
            }
            Some(_) if self.index > 0 => Ok(()),
            Some(root) if root == "CityModel" => Err(ModelError::NoBuilding),
            Some(root) => {
                let shown: String = root.chars().take(50).collect();
                let detail = format!(
                    "the outermost element is <{shown}> and there is no Building of CityGML 1.0, 2.0 or 3.0 in it; it \
                     must be a CityModel"
                );
                Err(ModelError::OtherContent { detail })
            }
        }
    }

    fn malformed(&self, detail: String) -> ModelError {
        ModelError::Xml { line: self.count.line(), detail }
    }

    fn entity(&self, what: &str) -> ModelError {
        ModelError::Entity { line: self.count.line(), what: what.to_owned() }
    }

    fn explain(&self, error: Error) -> ModelError {
        let line = self.count.line();
        match error {
            Error::Io(_) if self.count.is_exhausted() => {
                let (place, what) = (format!("line {line}"), "one piece of text or one tag");
                ModelError::TooLarge { place, what, limit: self.limits.building_bytes }
            }
            Error::Io(error) => ModelError::Input(std::io::Error::new(error.kind(), error)),
            Error::Escape(EscapeError::UnrecognizedEntity(_, name)) => {
                let shown: String = name.chars().take(50).collect();
                self.entity(&format!("the entity &{shown};"))
            }
            other => {
                let text = other.to_string();
                self.malformed(text.chars().take(300).collect())
            }
        }
    }
}
