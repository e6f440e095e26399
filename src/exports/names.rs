//! What photographs and cameras are called in the formats, which do not bear every name; two must not become one.

use std::collections::BTreeMap;

use super::{ExportError, Format, Photograph};

/// The name of a file without its extension.
pub(super) fn stem(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(stem, _)| stem)
}

/// A name as a field among blanks.
pub(super) fn word(name: &str) -> String {
    name.chars().map(|c| if c.is_whitespace() || c.is_control() { '_' } else { c }).collect()
}

/// A name without folders and what a file must not be called.
pub(super) fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || ".-_".contains(c) { c } else { '_' }).collect()
}

/// The name under which files beside an image go.
pub(super) fn beside(name: &str, ending: &str) -> String {
    format!("{}{ending}", file_name(stem(name)))
}

/// Refuses photographs of the same name, and different cameras of the same name, as a format writes names.
///
/// # Errors
/// [`ExportError::Name`] with the first two.
pub(super) fn check(format: Format, photographs: &[Photograph]) -> Result<(), ExportError> {
    let mut names: BTreeMap<String, &str> = BTreeMap::new();
    let mut cameras: BTreeMap<String, &Photograph> = BTreeMap::new();
    let refused = |called: String, first: &str, second: &str| {
        Err(ExportError::Name { format: format.name(), called, names: [first.to_owned(), second.to_owned()] })
    };
    for photograph in photographs {
        let called = photograph_called(format, &photograph.name);
        if let Some(first) = names.insert(called.clone(), &photograph.name) {
            return refused(called, first, &photograph.name);
        }
        // a scan is a camera of its own, which formats that describe cameras refuse for that
        let described = camera_called(format, &photograph.camera_name).filter(|_| !photograph.is_film());
        let Some(called) = described else { continue };
        let first = *cameras.entry(called.clone()).or_insert(photograph);
        if (&first.camera_name, first.camera) != (&photograph.camera_name, photograph.camera) {
            return refused(called, &first.camera_name, &photograph.camera_name);
        }
    }
    Ok(())
}

fn photograph_called(format: Format, name: &str) -> String {
    match format {
        Format::Rpc => beside(name, ""),
        Format::Inpho => word(stem(name)),
        Format::Micmac => file_name(name),
        Format::Patb | Format::Bingo | Format::Applanix | Format::Odm | Format::Pix4d | Format::Colmap => word(name),
        Format::Manifest | Format::OpkCsv | Format::Orthority | Format::Opensfm | Format::Esri | Format::Footprints => {
            name.to_owned()
        }
    }
}

/// `None` of formats that describe no cameras, or each with its photograph.
fn camera_called(format: Format, name: &str) -> Option<String> {
    match format {
        Format::Inpho | Format::Pix4d => Some(word(name)),
        Format::Micmac => Some(file_name(name)),
        Format::Orthority | Format::Opensfm | Format::Colmap | Format::Esri => Some(name.to_owned()),
        Format::Manifest
        | Format::OpkCsv
        | Format::Patb
        | Format::Bingo
        | Format::Applanix
        | Format::Odm
        | Format::Rpc
        | Format::Footprints => None,
    }
}
