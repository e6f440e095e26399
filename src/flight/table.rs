//! Tables with a header.

use super::{AngleUnit, Flight, LineFaults, Listed, MOST_IMAGES, Source, number, too_many};

/// What a column means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Column {
    Name,
    Image,
    Sha256,
    Coordinate(usize),
    Angle(usize, Option<AngleUnit>),
    SigmaPosition(usize),
    SigmaTilt(Option<AngleUnit>),
    SigmaKappa(Option<AngleUnit>),
    Ignored,
}

const COORDINATES: [&str; 3] = ["x (or lon, easting)", "y (or lat, northing)", "z (or height)"];
const ANGLES: [&str; 3] = ["omega", "phi", "kappa"];
const SIGMAS: [&str; 3] = ["sigma_x", "sigma_y", "sigma_z"];

pub(super) fn parse(text: &str, source: &Source, faults: &mut LineFaults) -> Result<Flight, LineFaults> {
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(separator(text))
        .has_headers(false)
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let mut records = reader.records();
    let header = records.next().and_then(Result::ok).ok_or_else(|| LineFaults::whole("the list is empty"))?;
    let columns = columns(&header, source)?;
    let ignored = header.iter().zip(&columns).filter(|(_, column)| **column == Column::Ignored);
    let mut flight = Flight { ignored: ignored.map(|(name, _)| name.to_owned()).collect(), ..Flight::default() };
    let mut lines = Lines { text, at: 0, line: 1 };
    for record in records {
        let record = record.map_err(|error| LineFaults::whole(format!("the table cannot be read: {error}")))?;
        let line = lines.of(record.position().map_or(0, |position| usize::try_from(position.byte()).unwrap_or(0)));
        // as spreadsheets write below their last row
        if record.iter().all(str::is_empty) {
            continue;
        }
        match listed(line, &record, &columns, source) {
            Ok(image) => flight.images.push(image),
            Err(detail) => faults.add(format!("line {line}"), detail),
        }
        if flight.images.len() > MOST_IMAGES {
            return Err(too_many());
        }
    }
    Ok(flight)
}

/// Which line a byte is in. The reader's own count is one behind where lines end by CR LF.
struct Lines<'t> {
    text: &'t str,
    at: usize,
    line: usize,
}

impl Lines<'_> {
    /// The line of a record that begins at or before the first character from `byte` on that does not end a line.
    fn of(&mut self, byte: usize) -> usize {
        let bytes = self.text.as_bytes();
        let ends = bytes[byte.min(bytes.len())..].iter().take_while(|byte| b"\r\n".contains(byte)).count();
        let begin = (byte + ends).clamp(self.at, bytes.len());
        self.line += bytes[self.at..begin].iter().filter(|byte| **byte == b'\n').count();
        self.at = begin;
        self.line
    }
}

/// The one of the three that is most often in the first line.
fn separator(text: &str) -> u8 {
    let header = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let count = |separator: u8| header.bytes().filter(|byte| *byte == separator).count();
    [b',', b';', b'\t'].into_iter().rev().max_by_key(|separator| count(*separator)).unwrap_or(b',')
}

fn columns(header: &csv::StringRecord, source: &Source) -> Result<Vec<Column>, LineFaults> {
    let mut faults = LineFaults::default();
    let mut columns: Vec<Column> = Vec::with_capacity(header.len());
    for name in header {
        let column = column(name);
        if column != Column::Ignored && columns.contains(&column) {
            faults.add("line 1", format!("the column {name:?} is there twice, or another one means the same"));
        }
        if let Some(detail) = contradiction(name, source) {
            faults.add("line 1", detail);
        }
        columns.push(column);
    }
    let wanted = [Column::Name, Column::Coordinate(0), Column::Coordinate(1), Column::Coordinate(2)];
    for (column, name) in wanted.into_iter().zip([&["name (or image, filename)"][..], &COORDINATES[..]].concat()) {
        if !columns.contains(&column) {
            faults.add("line 1", format!("there is no column {name}; the first line must name the columns"));
        }
    }
    let sigmas = (0..3).filter(|axis| columns.contains(&Column::SigmaPosition(*axis))).count();
    if sigmas != 0 && sigmas != 3 {
        faults.add("line 1", "sigma_x, sigma_y and sigma_z belong together");
    }
    if faults.count > 0 { Err(faults) } else { Ok(columns) }
}

fn column(header: &str) -> Column {
    let name = header.to_ascii_lowercase().replace([' ', '-'], "_");
    let (name, unit) = match name.trim_end_matches([')', ']']).rsplit_once(['_', '(', '[']) {
        Some((name, "deg")) => (name, Some(AngleUnit::Degrees)),
        Some((name, "gon")) => (name, Some(AngleUnit::Gon)),
        Some((name, "m")) => (name, None),
        _ => (name.as_str(), None),
    };
    match name.trim_end_matches('_') {
        "name" | "image" | "filename" | "file" | "file_name" | "image_name" => Column::Name,
        "image_id" => Column::Image,
        "sha256" => Column::Sha256,
        "x" | "lon" | "long" | "longitude" | "east" | "easting" => Column::Coordinate(0),
        "y" | "lat" | "latitude" | "north" | "northing" => Column::Coordinate(1),
        "z" | "height" | "altitude" | "up" | "elevation" => Column::Coordinate(2),
        "omega" => Column::Angle(0, unit),
        "phi" => Column::Angle(1, unit),
        "kappa" => Column::Angle(2, unit),
        "sigma_x" => Column::SigmaPosition(0),
        "sigma_y" => Column::SigmaPosition(1),
        "sigma_z" => Column::SigmaPosition(2),
        "sigma_tilt" => Column::SigmaTilt(unit),
        "sigma_kappa" => Column::SigmaKappa(unit),
        _ => Column::Ignored,
    }
}

/// Degrees where the CRS has metres, or the other way round.
fn contradiction(header: &str, source: &Source) -> Option<String> {
    let name = header.to_ascii_lowercase();
    let degrees = ["lon", "lat"].iter().any(|begin| name.starts_with(begin));
    let metres = ["east", "north"].iter().any(|begin| name.starts_with(begin));
    match source.crs.is_geographic() {
        false if degrees => Some(format!("the column {header:?} is in degrees, but {} has metres", source.crs)),
        true if metres => {
            Some(format!("the column {header:?} is in metres, but {} has degrees; give the CRS as `crs`", source.crs))
        }
        _ => None,
    }
}

fn listed(line: usize, record: &csv::StringRecord, columns: &[Column], source: &Source) -> Result<Listed, String> {
    if record.len() != columns.len() {
        return Err(format!("it has {} fields; the header has {}", record.len(), columns.len()));
    }
    let mut image = Listed::new(line, String::new(), [f64::NAN; 3]);
    let mut sigma_position_m = [None; 3];
    for (column, text) in columns.iter().zip(record) {
        let degrees = |what: &str, unit: Option<AngleUnit>| -> Result<Option<f64>, String> {
            optional(what, text).map(|angle| angle.map(|angle| unit.unwrap_or(source.angles).to_degrees(angle)))
        };
        match *column {
            Column::Name => text.clone_into(&mut image.name),
            Column::Image => image.image = (!text.is_empty()).then(|| text.to_owned()),
            Column::Sha256 => image.sha256 = (!text.is_empty()).then(|| text.to_ascii_lowercase()),
            Column::Coordinate(axis) => image.position[axis] = number(COORDINATES[axis], text)?,
            Column::Angle(which, unit) => {
                let angle = degrees(ANGLES[which], unit)?;
                *[&mut image.omega_deg, &mut image.phi_deg, &mut image.kappa_deg][which] = angle;
            }
            Column::SigmaPosition(axis) => sigma_position_m[axis] = optional(SIGMAS[axis], text)?,
            Column::SigmaTilt(unit) => image.sigma_tilt_deg = degrees("sigma_tilt", unit)?,
            Column::SigmaKappa(unit) => image.sigma_kappa_deg = degrees("sigma_kappa", unit)?,
            Column::Ignored => {}
        }
    }
    image.sigma_position_m = match sigma_position_m {
        [Some(x), Some(y), Some(z)] => Some([x, y, z]),
        [None, None, None] => None,
        _ => return Err("sigma_x, sigma_y and sigma_z belong together".to_owned()),
    };
    Ok(image)
}

/// Nothing, or a number.
fn optional(what: &str, text: &str) -> Result<Option<f64>, String> {
    if text.is_empty() { Ok(None) } else { number(what, text).map(Some) }
}
