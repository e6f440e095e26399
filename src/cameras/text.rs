//! Numbers and names out of YAML, JSON and XML, flat: `camera_matrix.data` and its text.
//!
//! Of YAML only what calibrations use is understood: keys, one level below them, and lists of numbers. That is less than a
//! reader of YAML would take, and OpenCV's own `%YAML:1.0` is more than such a reader takes.

use std::collections::BTreeMap;

use serde_json::Value;

use super::xml::Element;
use super::{CameraFileError, field};

/// What stands at a name. Names are in small letters without underscores: they are not written the same everywhere.
#[derive(Debug, Default)]
pub(super) struct Flat(BTreeMap<String, String>);

impl Flat {
    /// Reads one of the three, by its first character.
    pub(super) fn read(text: &str) -> Result<Self, CameraFileError> {
        match text.trim_start_matches('\u{feff}').trim_start().chars().next() {
            Some('{') => Self::of_json(text),
            Some('<') => Self::of_xml(text),
            _ => Self::of_yaml(text),
        }
    }

    fn of_json(text: &str) -> Result<Self, CameraFileError> {
        let value: Value = serde_json::from_str(text.trim_start_matches('\u{feff}')).map_err(|error| {
            CameraFileError::Text { place: format!("line {}", error.line()), detail: format!("it is no JSON: {error}") }
        })?;
        let mut flat = Self::default();
        flat.take_json("", &value);
        Ok(flat)
    }

    fn take_json(&mut self, name: &str, value: &Value) {
        match value {
            Value::Object(members) => {
                for (key, value) in members {
                    self.take_json(&joined(name, key), value);
                }
            }
            Value::Null => {}
            Value::String(text) => self.put(name, text),
            // brackets are no separators between numbers, commas are
            other => self.put(name, &other.to_string()),
        }
    }

    fn of_xml(text: &str) -> Result<Self, CameraFileError> {
        let mut flat = Self::default();
        for child in &Element::read(text)?.children {
            flat.take_xml("", child);
        }
        Ok(flat)
    }

    fn take_xml(&mut self, name: &str, element: &Element) {
        let name = joined(name, &element.name);
        self.put(&name, &element.text);
        for child in &element.children {
            self.take_xml(&name, child);
        }
    }

    fn of_yaml(text: &str) -> Result<Self, CameraFileError> {
        let mut flat = Self::default();
        // the key at the margin, the one that a list belongs to, and whether the list is still open
        let (mut top, mut name, mut open) = (String::new(), String::new(), false);
        for (number, line) in text.lines().enumerate() {
            let content = line.split(" #").next().unwrap_or_default().trim();
            if content.is_empty() || content.starts_with(['%', '#']) || content == "---" || content == "..." {
                continue;
            }
            if open || content.starts_with('-') && !content.starts_with("---") {
                flat.add(&name, content.strip_prefix("- ").unwrap_or(content));
                open &= !content.ends_with(']') || unclosed(flat.text(&name).unwrap_or_default());
                continue;
            }
            let Some((key, value)) = content.split_once(':') else {
                let place = format!("line {}", number + 1);
                return Err(CameraFileError::Text { place, detail: format!("{content:?} is no key with a value") });
            };
            let key = key.trim_matches(['"', '\'', ' ']);
            if line.starts_with(char::is_whitespace) {
                name = joined(&top, key);
            } else {
                top = plain(key);
                name.clone_from(&top);
            }
            let value = value.trim();
            // a tag such as !!opencv-matrix says how to read what follows, which is known
            let value = if value.starts_with('!') { "" } else { value };
            flat.put(&name, value.trim_matches(['"', '\'']));
            open = unclosed(value);
        }
        Ok(flat)
    }

    fn put(&mut self, name: &str, text: &str) {
        self.0.insert(name.to_owned(), text.trim().to_owned());
    }

    fn add(&mut self, name: &str, text: &str) {
        let known = self.0.entry(name.to_owned()).or_default();
        known.push_str(if known.is_empty() || known.ends_with(',') { " " } else { ", " });
        known.push_str(text);
    }

    /// What stands at the first of these names that is there.
    pub(super) fn first(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|name| self.text(name))
    }

    fn text(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str).filter(|text| !text.is_empty())
    }

    /// The numbers of the first of these matrices that is there: in its `data`, or at its name.
    pub(super) fn matrix(&self, names: &[&str]) -> Result<Option<Vec<f64>>, CameraFileError> {
        for name in names {
            if let Some(text) = self.text(&format!("{name}.data")).or_else(|| self.text(name)) {
                return numbers(name, text).map(Some);
            }
        }
        Ok(None)
    }
}

/// The numbers of a list, whatever stands between them.
pub(super) fn numbers(name: &str, text: &str) -> Result<Vec<f64>, CameraFileError> {
    let words = text.split(|c: char| c.is_whitespace() || matches!(c, ',' | '[' | ']' | ';'));
    words.filter(|word| !word.is_empty()).map(|word| number(name, word)).collect()
}

/// A finite number.
pub(super) fn number(name: &str, text: &str) -> Result<f64, CameraFileError> {
    let value = text.trim().parse().ok().filter(|value: &f64| value.is_finite());
    value.ok_or_else(|| field(name, format!("{:?} is no finite number", text.chars().take(40).collect::<String>())))
}

/// A count of pixels.
pub(super) fn pixels(name: &str, value: f64) -> Result<u32, CameraFileError> {
    if value.fract() == 0.0 && (1.0..=1e6).contains(&value) {
        Ok(value as u32)
    } else {
        Err(field(name, format!("{value} is no number of pixels")))
    }
}

fn unclosed(text: &str) -> bool {
    text.matches('[').count() > text.matches(']').count()
}

fn joined(name: &str, key: &str) -> String {
    if name.is_empty() { plain(key) } else { format!("{name}.{}", plain(key)) }
}

fn plain(key: &str) -> String {
    key.chars().filter(|c| *c != '_').flat_map(char::to_lowercase).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_three_forms_say_the_same() {
        let yaml = "%YAML:1.0\n---\nimage_width: 640 # columns\nCamera_Matrix: !!opencv-matrix\n   rows: 2\n   cols: 2\n   dt: d\n   \
                    data: [ 1., 2.,\n       3., -4.e-1 ]\ndist:\n- 5\n- 6\nname: \"a\"\n";
        let json = "{\"image_width\": 640, \"camera_matrix\": {\"rows\": 2, \"data\": [[1, 2], [3, -0.4]]}, \"dist\": [5, 6], \"name\": \"a\"}";
        let xml = "<?xml version=\"1.0\"?>\n<opencv_storage><image_width>640</image_width>\n<camera_matrix type_id=\"opencv-matrix\">\
                   <rows>2</rows><data>1. 2. 3.\n -4e-1</data></camera_matrix><dist>5 6</dist><name>a</name></opencv_storage>";
        for text in [yaml, json, xml] {
            let flat = Flat::read(text).unwrap();
            assert_eq!(flat.first(&["nothing", "imagewidth"]), Some("640"), "{text}");
            assert_eq!(flat.matrix(&["cameramatrix"]).unwrap(), Some(vec![1.0, 2.0, 3.0, -0.4]), "{text}");
            assert_eq!(flat.matrix(&["dist"]).unwrap(), Some(vec![5.0, 6.0]), "{text}");
            assert_eq!(flat.first(&["name"]), Some("a"));
            assert_eq!(flat.matrix(&["other"]).unwrap(), None);
        }
    }

    #[test]
    fn what_is_none_of_them_is_told_with_its_line() {
        for (text, named) in [("a: 1\nno key\n", "line 2"), ("{\n\"a\" 1}", "line 2"), ("<a>\n<b></a>", "line 2")] {
            let error = Flat::read(text).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
        let flat = Flat::read("camera_matrix: [1, x]").unwrap();
        assert!(flat.matrix(&["cameramatrix"]).unwrap_err().to_string().contains("\"x\""));
    }
}
