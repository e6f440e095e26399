//! CityJSON in one piece, which may be a gigabyte.
//!
//! The vertices may come after the objects that refer to them, and the transform after both, so nothing can be handed
//! over before the end. What is held until then is 24 bytes a vertex and, for each building or part, four bytes for each
//! point of its roof, its name, that of its first parent and those of its children, of which no name is longer than 200
//! characters: about as much as the file has bytes if it is compact, and bounded by [`Limits::file_vertices`] and
//! [`Limits::file_objects`]. The text itself is held an object at a time.

use std::cell::RefCell;
use std::fmt;
use std::io::BufRead;
use std::ops::ControlFlow;

use serde::de::{DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};
use serde_json::value::RawValue;

use super::cityjsonseq::check_type;
use super::feature::{self, Frame, Metadata, Object, Transform, Written};
use super::meter::{Count, Meter};
use super::model::{Item, Limits, ModelError};

/// What has been read, and what went wrong beyond JSON.
struct Reading<'a> {
    limits: &'a Limits,
    count: Count,
    objects: Vec<Object>,
    /// How many children the objects list.
    children: usize,
    vertices: Vec<[f64; 3]>,
    transform: Option<Transform>,
    metadata: Option<Metadata>,
    kind: Option<String>,
    version: Option<serde_json::Value>,
    /// The error behind the one that the JSON parser was given.
    error: RefCell<Option<ModelError>>,
}

/// Reads a file.
pub(super) fn read(
    input: &mut dyn BufRead,
    limits: &Limits,
    each: &mut dyn FnMut(Item) -> ControlFlow<()>,
) -> Result<(), ModelError> {
    skip_mark(input)?;
    let meter = Meter::new(input, limits.building_bytes);
    let mut reading = Reading {
        limits,
        count: meter.count(),
        objects: Vec::new(),
        children: 0,
        vertices: Vec::new(),
        transform: None,
        metadata: None,
        kind: None,
        version: None,
        error: RefCell::new(None),
    };
    let mut deserializer = serde_json::Deserializer::from_reader(meter);
    let read = deserializer.deserialize_map(&mut reading).and_then(|()| deserializer.end());
    if let Err(error) = read {
        return Err(reading.explain(error));
    }
    let Some(kind) = &reading.kind else {
        let detail = "the file says no \"type\"; it must be \"CityJSON\"".to_owned();
        return Err(ModelError::OtherContent { detail });
    };
    check_type(kind, reading.version.as_ref())?;
    let system = reading.metadata.as_ref().and_then(Metadata::system);
    let frame = Frame { system, transform: reading.transform.unwrap_or_default() };
    let mut any = false;
    feature::items(&reading.objects, &reading.vertices, &frame, 0, &mut |item| {
        any = true;
        each(item).is_continue()
    });
    if any { Ok(()) } else { Err(ModelError::NoBuilding) }
}

/// A byte order mark may begin the file.
fn skip_mark(input: &mut dyn BufRead) -> Result<(), ModelError> {
    let marked = input.fill_buf().map_err(ModelError::Input)?.starts_with(b"\xef\xbb\xbf");
    if marked {
        input.consume(3);
    }
    Ok(())
}

impl Reading<'_> {
    /// The error as it is meant.
    fn explain(&self, error: serde_json::Error) -> ModelError {
        if let Some(error) = self.error.take() {
            return error;
        }
        if self.count.is_exhausted() {
            let place = format!("line {}, byte {}", self.count.line(), self.count.bytes());
            return ModelError::TooLarge { place, what: "one value", limit: self.limits.building_bytes };
        }
        if error.is_io() {
            return ModelError::Input(error.into());
        }
        ModelError::of_json("", &error)
    }

    /// Allows one more value.
    fn allow(&self) {
        self.count.allow(self.limits.building_bytes);
    }

    fn too_many<E: serde::de::Error>(&self, what: &'static str, limit: usize) -> E {
        self.error.replace(Some(ModelError::TooMany { what, limit }));
        E::custom("too many")
    }

    fn object(&mut self, name: &str, text: &RawValue) {
        match serde_json::from_str::<Written<'_>>(text.get()) {
            Ok(written) => {
                let object = Object::of(name, &written, self.limits);
                self.children += object.as_ref().map_or(0, |object| object.children.len());
                self.objects.extend(object);
            }
            // whether it was a building cannot be known, and silence would lose it
            Err(error) => {
                let line = self.count.line();
                self.objects.push(Object::broken(name, format!("the object that ends in line {line}: {error}")));
            }
        }
    }
}

impl<'de> Visitor<'de> for &mut Reading<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object with type CityJSON, CityObjects and vertices")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            self.allow();
            match key.as_str() {
                "type" => self.kind = Some(map.next_value()?),
                "version" => self.version = Some(map.next_value()?),
                "transform" => self.transform = Some(map.next_value()?),
                "metadata" => self.metadata = map.next_value()?,
                "CityObjects" => map.next_value_seed(Objects(self))?,
                "vertices" => map.next_value_seed(Vertices(self))?,
                _ => map.next_value_seed(Skip(self))?,
            }
        }
        Ok(())
    }
}

struct Objects<'r, 'a>(&'r mut Reading<'a>);

impl<'de> DeserializeSeed<'de> for Objects<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Objects<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object of CityObjects by their identifiers")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(name) = map.next_key::<String>()? {
            self.0.allow();
            let text: Box<RawValue> = map.next_value()?;
            self.0.object(&name, &text);
            let limit = self.0.limits.file_objects;
            if self.0.objects.len() > limit {
                return Err(self.0.too_many("buildings and parts", limit));
            }
            if self.0.children > limit {
                return Err(self.0.too_many("children of buildings", limit));
            }
            self.0.allow();
        }
        Ok(())
    }
}

struct Vertices<'r, 'a>(&'r mut Reading<'a>);

impl<'de> DeserializeSeed<'de> for Vertices<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Vertices<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an array of vertices [x, y, z]")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> Result<(), A::Error> {
        while let Some(vertex) = sequence.next_element()? {
            self.0.allow();
            if self.0.vertices.len() == self.0.limits.file_vertices {
                return Err(self.0.too_many("vertices", self.0.limits.file_vertices));
            }
            self.0.vertices.push(vertex);
        }
        Ok(())
    }
}

/// Passes over a value of any size without holding it: `serde`'s own way knows no bound on its depth.
struct Skip<'r, 'a>(&'r Reading<'a>);

impl<'de> DeserializeSeed<'de> for Skip<'_, '_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        self.0.allow();
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Skip<'_, '_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any value")
    }

    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_u64<E>(self, _: u64) -> Result<(), E> {
        Ok(())
    }

    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> Result<(), A::Error> {
        while sequence.next_element_seed(Skip(self.0))?.is_some() {}
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while map.next_key_seed(Skip(self.0))?.is_some() {
            map.next_value_seed(Skip(self.0))?;
        }
        Ok(())
    }
}
