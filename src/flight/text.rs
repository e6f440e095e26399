//! The usual text files of exterior orientations.

use super::{Flight, LineFaults, Listed, MOST_IMAGES, Source, number, too_many};

const FORM: &str = "name X Y Z, name X Y Z omega phi kappa, or the latter with a time at its end, separated by blanks";

pub(super) fn parse(text: &str, source: &Source, faults: &mut LineFaults) -> Result<Flight, LineFaults> {
    let mut flight = Flight::default();
    for (index, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default();
        let fields: Vec<&str> = line.split_whitespace().take(9).collect();
        if fields.is_empty() {
            continue;
        }
        match listed(index + 1, &fields, source) {
            Ok(image) => flight.images.push(image),
            Err(detail) => faults.add(format!("line {}", index + 1), detail),
        }
        if flight.images.len() > MOST_IMAGES {
            return Err(too_many());
        }
    }
    Ok(flight)
}

fn listed(line: usize, fields: &[&str], source: &Source) -> Result<Listed, String> {
    if !matches!(fields.len(), 4 | 7 | 8) {
        let count = fields.len();
        let more = if count == 9 { " or more" } else { "" };
        return Err(format!("it has {count}{more} fields; it must be {FORM} (a comment begins with #)"));
    }
    let read = |index: usize, what: &str| number(what, fields[index]);
    let position = [read(1, "X")?, read(2, "Y")?, read(3, "Z")?];
    let mut image = Listed::new(line, fields[0].to_owned(), position);
    if fields.len() > 4 {
        image.omega_deg = Some(source.angles.to_degrees(read(4, "omega")?));
        image.phi_deg = Some(source.angles.to_degrees(read(5, "phi")?));
        image.kappa_deg = Some(source.angles.to_degrees(read(6, "kappa")?));
    }
    if fields.len() > 7 {
        read(7, "the time")?;
    }
    Ok(image)
}
