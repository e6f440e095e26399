//! The nested arrays of indices that a geometry is, and which of its surfaces are roof.
//!
//! They are the bulk of a file, and `serde` would make four levels of vectors of them. The text has been through the
//! JSON parser already: it is well-formed, and only its meaning is open.

use super::IndexedRoof;
use crate::buildings::model::Limits;

/// All surfaces of a geometry. Each list says where each thing ends in the list before it.
#[derive(Debug, Default)]
pub(super) struct Boundaries {
    indices: Vec<u32>,
    rings: Vec<u32>,
    surfaces: Vec<u32>,
    shells: Vec<u32>,
    solids: Vec<u32>,
    /// How deep the numbers lie in the arrays: 3 in a surface, 4 in a solid, 5 in several.
    depth: usize,
}

impl Boundaries {
    /// Reads the text of `boundaries`.
    pub(super) fn parse(text: &str, depth: usize, limits: &Limits) -> Result<Self, String> {
        let mut all = Self { depth, ..Self::default() };
        all.indices.reserve(text.len() / 4);
        let mut level = 0;
        for token in Tokens(text.as_bytes()) {
            match token {
                Token::Open => level += 1,
                Token::Close => {
                    all.close(level);
                    level = level.saturating_sub(1);
                }
                Token::Number(index) if level == depth => all.indices.push(index),
                other => {
                    return Err(format!(
                        "boundaries hold {other} at depth {level}; indices of vertices, whole numbers from 0, are \
                         expected at depth {depth}"
                    ));
                }
            }
            if level > depth {
                return Err(format!("boundaries are arrays {level} deep; {depth} are right for this type of geometry"));
            }
        }
        if all.indices.len() > limits.building_vertices || all.surfaces.len() > limits.building_polygons {
            return Err(format!(
                "it has {} points in {} surfaces; at most {} in {} are accepted",
                all.indices.len(),
                all.surfaces.len(),
                limits.building_vertices,
                limits.building_polygons
            ));
        }
        Ok(all)
    }

    /// An array ends that lies so deep.
    fn close(&mut self, level: usize) {
        match self.depth - level.min(self.depth) {
            0 => self.rings.push(self.indices.len() as u32),
            1 => self.surfaces.push(self.rings.len() as u32),
            2 => self.shells.push(self.surfaces.len() as u32),
            3 => self.solids.push(self.shells.len() as u32),
            _ => {}
        }
    }

    /// Adds the surfaces whose value, in the text of `values`, points to a roof.
    pub(super) fn add_roof(&self, values: &str, is_roof: &[bool], roof: &mut IndexedRoof) -> Result<(), String> {
        for (surface, value) in self.values(values)?.into_iter().enumerate() {
            let Some(value) = value else {
                continue;
            };
            match is_roof.get(value as usize) {
                Some(true) => self.copy(surface, roof)?,
                Some(false) => {}
                None => {
                    return Err(format!(
                        "semantics.values refers to surface {value}; semantics.surfaces has {}, from 0",
                        is_roof.len()
                    ));
                }
            }
        }
        Ok(())
    }

    fn copy(&self, surface: usize, roof: &mut IndexedRoof) -> Result<(), String> {
        let start = |ends: &[u32], at: usize| if at == 0 { 0 } else { ends[at - 1] as usize };
        let rings = start(&self.surfaces, surface)..self.surfaces[surface] as usize;
        if rings.is_empty() {
            return Err(format!("surface {surface} of boundaries, a roof, is empty; it must have at least one ring"));
        }
        for ring in rings {
            roof.indices.extend_from_slice(&self.indices[start(&self.rings, ring)..self.rings[ring] as usize]);
            roof.rings.push(roof.indices.len() as u32);
        }
        roof.polygons.push(roof.rings.len() as u32);
        Ok(())
    }

    /// One value a surface. A `null` may stand for a surface, a shell, a solid or all.
    fn values(&self, text: &str) -> Result<Vec<Option<u32>>, String> {
        let leaf = self.depth - 2;
        let mut values = Vec::with_capacity(self.surfaces.len());
        let (mut level, mut shell, mut solid) = (0, 0, 0);
        for token in Tokens(text.as_bytes()) {
            match token {
                Token::Open => level += 1,
                Token::Close => {
                    if level == leaf {
                        shell += 1;
                    } else if level + 1 == leaf {
                        solid += 1;
                    }
                    level = level.saturating_sub(1);
                }
                Token::Number(value) if level == leaf => values.push(Some(value)),
                Token::Null if level == leaf => values.push(None),
                Token::Null if level < leaf => {
                    match leaf - level {
                        1 => shell += 1,
                        2 => {
                            shell = self.solids.get(solid).map_or(self.shells.len(), |end| *end as usize);
                            solid += 1;
                        }
                        _ => shell = self.shells.len(),
                    }
                    let end = shell.checked_sub(1).and_then(|last| self.shells.get(last));
                    values.resize(end.map_or(values.len(), |end| (*end as usize).max(values.len())), None);
                }
                other => {
                    return Err(format!(
                        "semantics.values hold {other} at depth {level}; whole numbers or null are expected at \
                         depth {leaf}"
                    ));
                }
            }
            if values.len() > self.surfaces.len() || level > leaf {
                break;
            }
        }
        if values.len() == self.surfaces.len() && level == 0 {
            Ok(values)
        } else {
            Err(format!(
                "semantics.values must have one value, in arrays {leaf} deep, for each of the {} surfaces of boundaries",
                self.surfaces.len()
            ))
        }
    }
}

/// What nested arrays of numbers consist of.
enum Token {
    Open,
    Close,
    /// A whole number from 0 that fits.
    Number(u32),
    Null,
    /// What has no place there; its first letter.
    Other(char),
}

impl std::fmt::Display for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Open | Self::Close => f.write_str("an array"),
            Self::Number(number) => write!(f, "{number}"),
            Self::Null => f.write_str("null"),
            Self::Other('"') => f.write_str("a text"),
            Self::Other('{') => f.write_str("an object"),
            Self::Other('-') => f.write_str("a negative number"),
            Self::Other('0'..='9') => f.write_str("a number that is not whole or too large"),
            Self::Other(_) => f.write_str("true or false"),
        }
    }
}

/// The tokens of JSON that is known to be well-formed, as far as arrays of numbers go.
struct Tokens<'a>(&'a [u8]);

impl Iterator for Tokens<'_> {
    type Item = Token;

    fn next(&mut self) -> Option<Token> {
        loop {
            let (first, rest) = self.0.split_first()?;
            self.0 = rest;
            return Some(match first {
                b',' | b' ' | b'\n' | b'\r' | b'\t' => continue,
                b'[' => Token::Open,
                b']' => Token::Close,
                b'n' => {
                    self.0 = self.0.get(3..).unwrap_or_default();
                    Token::Null
                }
                b'0'..=b'9' => self.number(u32::from(first - b'0')),
                other => Token::Other(char::from(*other)),
            });
        }
    }
}

impl Tokens<'_> {
    fn number(&mut self, first: u32) -> Token {
        let mut number = first;
        while let Some((digit @ b'0'..=b'9', rest)) = self.0.split_first() {
            let Some(longer) = number.checked_mul(10).and_then(|tens| tens.checked_add(u32::from(digit - b'0'))) else {
                return Token::Other('0');
            };
            number = longer;
            self.0 = rest;
        }
        match self.0.first() {
            Some(b'.' | b'e' | b'E') => Token::Other('0'),
            _ => Token::Number(number),
        }
    }
}
