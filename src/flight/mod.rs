//! Lists of images with approximate positions, as flights are planned or recorded: a table with a header (CSV), GeoJSON
//! points, or the usual text files of exterior orientations. A list is read whole or not at all, and every bad line is
//! named with what would be right.

mod geojson;
mod table;
#[cfg(test)]
mod tests;
mod text;

use std::collections::HashMap;

use crate::geometry::{Crs, LocalFrame, rotation};

/// The most images of one list.
pub const MOST_IMAGES: usize = 20_000;
/// So many faults are told; more than that nobody reads.
pub const MOST_FAULTS: usize = 100;
const LONGEST_NAME: usize = 255;

/// How a list is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// A header and a line an image, separated by commas, semicolons or tabs.
    Table,
    /// A `FeatureCollection` of points.
    GeoJson,
    /// `name X Y Z [omega phi kappa [time]]`, separated by blanks; `#` begins a comment.
    Text,
}

/// The unit of omega, phi and kappa.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AngleUnit {
    /// 360 to a circle.
    #[default]
    Degrees,
    /// 400 to a circle.
    Gon,
}

impl AngleUnit {
    fn to_degrees(self, angle: f64) -> f64 {
        match self {
            Self::Degrees => angle,
            Self::Gon => angle * 0.9,
        }
    }
}

/// How the numbers of a list are meant.
#[derive(Debug, Clone)]
pub struct Source {
    /// The CRS of the positions.
    pub crs: Crs,
    /// What makes their heights ellipsoidal.
    pub geoid_undulation_m: Option<f64>,
    /// The unit of angles whose column does not say.
    pub angles: AngleUnit,
}

/// An image of a list.
#[derive(Debug, Clone, PartialEq)]
pub struct Listed {
    /// Where it stands: the line, or the feature, from 1.
    pub number: usize,
    /// Its name, unique in the list.
    pub name: String,
    /// The id of the uploaded image, if the list says.
    pub image: Option<String>,
    /// The SHA-256 of its file in hexadecimal digits, if the list says.
    pub sha256: Option<String>,
    /// The projection centre in the CRS of the list.
    pub position: [f64; 3],
    /// Its standard deviations east, north, up.
    pub sigma_position_m: Option<[f64; 3]>,
    /// Angles about the axes of the local east, north, up frame at the position.
    pub omega_deg: Option<f64>,
    /// The second angle.
    pub phi_deg: Option<f64>,
    /// The third angle.
    pub kappa_deg: Option<f64>,
    /// Standard deviation of omega and phi.
    pub sigma_tilt_deg: Option<f64>,
    /// Standard deviation of kappa.
    pub sigma_kappa_deg: Option<f64>,
}

/// A list that is whole.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Flight {
    /// Its images, in its order.
    pub images: Vec<Listed>,
    /// Columns or properties that mean nothing here.
    pub ignored: Vec<String>,
}

/// What is wrong with a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineFault {
    /// `line 7`, or the JSON pointer of a feature; empty if it is the list as a whole.
    pub place: String,
    /// What is wrong, and what would be right.
    pub detail: String,
}

/// The faults of a list: the first hundred, and how many there are.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct LineFaults {
    /// The first of them.
    pub first: Vec<LineFault>,
    /// All of them.
    pub count: usize,
}

impl LineFaults {
    /// Notes a fault.
    pub fn add(&mut self, place: impl Into<String>, detail: impl Into<String>) {
        self.count += 1;
        if self.first.len() < MOST_FAULTS {
            self.first.push(LineFault { place: place.into(), detail: detail.into() });
        }
    }

    /// Only one, of the list as a whole.
    fn whole(detail: impl Into<String>) -> Self {
        let mut faults = Self::default();
        faults.add("", detail);
        faults
    }
}

/// How a place in a list is named.
#[must_use]
pub fn place(format: Format, number: usize) -> String {
    match format {
        Format::GeoJson => format!("/features/{}", number - 1),
        Format::Table | Format::Text => format!("line {number}"),
    }
}

/// Reads a list.
///
/// # Errors
/// All that is wrong with it; then none of it is to be used.
pub fn parse(bytes: &[u8], format: Format, source: &Source) -> Result<Flight, LineFaults> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        let mut faults = LineFaults::default();
        faults.add(format!("line {line}"), "it is not UTF-8; save the list as UTF-8");
        faults
    })?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let mut faults = LineFaults::default();
    let mut flight = match format {
        Format::Table => table::parse(text, source, &mut faults)?,
        Format::GeoJson => geojson::parse(text, &mut faults)?,
        Format::Text => text::parse(text, source, &mut faults)?,
    };
    refuse_twice(&flight.images, format, &mut faults);
    for image in &mut flight.images {
        if let Err(detail) = image.checked(source) {
            faults.add(place(format, image.number), detail);
        }
    }
    if faults.count > 0 {
        return Err(faults);
    }
    if flight.images.is_empty() {
        return Err(LineFaults::whole("the list has no images"));
    }
    Ok(flight)
}

fn too_many() -> LineFaults {
    LineFaults::whole(format!("the list has more than {MOST_IMAGES} images; send it in parts"))
}

fn refuse_twice(images: &[Listed], format: Format, faults: &mut LineFaults) {
    let mut first: HashMap<&str, usize> = HashMap::new();
    for image in images {
        if let Some(earlier) = first.insert(&image.name, image.number) {
            let (here, there) = (place(format, image.number), place(format, earlier));
            faults.add(here, format!("the name {:?} is that of {there} too; names must be unique", image.name));
        }
    }
}

impl Listed {
    fn new(number: usize, name: String, position: [f64; 3]) -> Self {
        Self {
            number,
            name,
            image: None,
            sha256: None,
            position,
            sigma_position_m: None,
            omega_deg: None,
            phi_deg: None,
            kappa_deg: None,
            sigma_tilt_deg: None,
            sigma_kappa_deg: None,
        }
    }

    /// Checks the name and whether the position lies in the CRS, and turns the angles to the axes of the local frame.
    fn checked(&mut self, source: &Source) -> Result<(), String> {
        check_name(&self.name)?;
        let hexadecimal = |text: &String| text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        if self.sha256.as_ref().is_some_and(|text| !hexadecimal(text)) {
            return Err("sha256 must have 64 hexadecimal digits".to_owned());
        }
        let (crs, undulation_m) = (&source.crs, source.geoid_undulation_m);
        let centre_m = crs.geocentric_from_position(self.position, undulation_m).map_err(|e| e.to_string())?;
        let (Some(kappa_deg), false) = (self.kappa_deg, crs.is_geographic()) else { return Ok(()) };
        let radians = |angle: Option<f64>| angle.unwrap_or(0.0).to_radians();
        let camera_from_axes =
            rotation::camera_from_object(radians(self.omega_deg), radians(self.phi_deg), kappa_deg.to_radians());
        let axes_from_geocentric = crs.axes_from_geocentric(centre_m).map_err(|error| error.to_string())?;
        let local_from_geocentric = LocalFrame::about(centre_m).local_from_geocentric();
        let camera_from_local = camera_from_axes * axes_from_geocentric * local_from_geocentric.inverse();
        let [omega, phi, kappa] = rotation::angles(&camera_from_local).map(f64::to_degrees);
        self.kappa_deg = Some(kappa);
        self.omega_deg = self.omega_deg.map(|_| omega);
        self.phi_deg = self.phi_deg.map(|_| phi);
        Ok(())
    }
}

fn check_name(name: &str) -> Result<(), String> {
    let length = name.chars().count();
    if !(1..=LONGEST_NAME).contains(&length) || name.chars().any(char::is_control) {
        return Err(format!("the name must have 1 to {LONGEST_NAME} characters, none of them a control character"));
    }
    Ok(())
}

/// A number that is one: neither infinite nor NaN, which Rust would read too.
fn number(what: &str, text: &str) -> Result<f64, String> {
    let text = text.trim();
    let digits = text.bytes().all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(&byte));
    let value = if digits { text.parse::<f64>().ok().filter(|value| value.is_finite()) } else { None };
    value.ok_or_else(|| {
        let shown: String = text.chars().take(40).collect();
        let hint = if text.contains(',') { " with a decimal point, not a comma" } else { "" };
        format!("{what} is {shown:?}; it must be a number{hint}")
    })
}
