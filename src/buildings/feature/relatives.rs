//! The names by which objects refer to each other: as few of them, and as much of each, as can be of use.

use std::fmt;

use serde::Deserialize;
use serde::de::{Deserializer, Error, IgnoredAny, SeqAccess, Visitor};

use crate::buildings::model::shortened_name;

/// Parts that one object may list; the largest blocks of flats have some hundreds.
const MOST_CHILDREN: usize = 10_000;

/// The first of an object's parents, the only one that counts.
#[derive(Debug, Default)]
pub(super) struct Parents(pub(super) Option<Box<str>>);

/// An object's children.
#[derive(Debug, Default)]
pub(super) struct Children(pub(super) Vec<Box<str>>);

impl<'de> Deserialize<'de> for Parents {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ParentsVisitor)
    }
}

struct ParentsVisitor;

impl<'de> Visitor<'de> for ParentsVisitor {
    type Value = Parents;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an array of identifiers")
    }

    fn visit_unit<E>(self) -> Result<Parents, E> {
        Ok(Parents(None))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> Result<Parents, A::Error> {
        let first = sequence.next_element()?.map(name);
        while sequence.next_element::<IgnoredAny>()?.is_some() {}
        Ok(Parents(first))
    }
}

impl<'de> Deserialize<'de> for Children {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ChildrenVisitor)
    }
}

struct ChildrenVisitor;

impl<'de> Visitor<'de> for ChildrenVisitor {
    type Value = Children;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an array of identifiers")
    }

    fn visit_unit<E>(self) -> Result<Children, E> {
        Ok(Children::default())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut sequence: A) -> Result<Children, A::Error> {
        let mut children = Vec::new();
        while let Some(child) = sequence.next_element()? {
            if children.len() == MOST_CHILDREN {
                return Err(A::Error::custom(format_args!("it has more than {MOST_CHILDREN} children")));
            }
            children.push(name(child));
        }
        Ok(Children(children))
    }
}

/// A longer name is none of a building that is read.
fn name(written: String) -> Box<str> {
    shortened_name(written).into()
}
