//! GeoJSON points. Their coordinates are in the CRS that is given beside the list.

use serde_json::{Map, Value};

use super::{Flight, LineFaults, Listed, MOST_IMAGES, too_many};

const KNOWN: [&str; 9] = [
    "name",
    "image_id",
    "sha256",
    "omega_deg",
    "phi_deg",
    "kappa_deg",
    "sigma_position_m",
    "sigma_tilt_deg",
    "sigma_kappa_deg",
];

pub(super) fn parse(text: &str, faults: &mut LineFaults) -> Result<Flight, LineFaults> {
    let collection: Value =
        serde_json::from_str(text).map_err(|error| LineFaults::whole(format!("the list is not JSON: {error}")))?;
    let features = match (&collection["type"], &collection["features"]) {
        (Value::String(kind), Value::Array(features)) if kind == "FeatureCollection" => features,
        _ => return Err(LineFaults::whole("the list must be a GeoJSON FeatureCollection with an array `features`")),
    };
    if features.len() > MOST_IMAGES {
        return Err(too_many());
    }
    let mut flight = Flight::default();
    for (index, feature) in features.iter().enumerate() {
        match listed(index + 1, feature) {
            Ok(image) => flight.images.push(image),
            Err((pointer, detail)) => faults.add(format!("/features/{index}{pointer}"), detail),
        }
        for name in feature["properties"].as_object().into_iter().flat_map(Map::keys) {
            // each is told once, and not more than a reader can take in
            if !KNOWN.contains(&name.as_str()) && !flight.ignored.contains(name) && flight.ignored.len() < 50 {
                flight.ignored.push(name.clone());
            }
        }
    }
    Ok(flight)
}

/// The rest of the pointer, and what is wrong there.
type Fault = (String, String);

fn listed(number: usize, feature: &Value) -> Result<Listed, Fault> {
    let fault = |pointer: &str, detail: &str| (pointer.to_owned(), detail.to_owned());
    if feature["type"] != "Feature" || feature["geometry"]["type"] != "Point" {
        return Err(fault("/geometry", "it must be a Feature whose geometry is a Point"));
    }
    let position = triple(&feature["geometry"]["coordinates"]);
    let position = position.ok_or_else(|| {
        fault("/geometry/coordinates", "it must be [x, y, z]: east or longitude, north or latitude, height")
    })?;
    let properties = &feature["properties"];
    let name = text(properties, "name")?.ok_or_else(|| fault("/properties/name", "every image needs a name"))?;
    let mut image = Listed::new(number, name, position);
    image.image = text(properties, "image_id")?;
    image.sha256 = text(properties, "sha256")?.map(|digits| digits.to_ascii_lowercase());
    image.omega_deg = finite(properties, "omega_deg")?;
    image.phi_deg = finite(properties, "phi_deg")?;
    image.kappa_deg = finite(properties, "kappa_deg")?;
    image.sigma_tilt_deg = finite(properties, "sigma_tilt_deg")?;
    image.sigma_kappa_deg = finite(properties, "sigma_kappa_deg")?;
    image.sigma_position_m = match &properties["sigma_position_m"] {
        Value::Null => None,
        given => Some(triple(given).ok_or_else(|| {
            fault("/properties/sigma_position_m", "it must be three numbers, metres east, north and up")
        })?),
    };
    Ok(image)
}

fn triple(value: &Value) -> Option<[f64; 3]> {
    let numbers: Vec<f64> = value.as_array()?.iter().map(Value::as_f64).collect::<Option<_>>()?;
    numbers.try_into().ok()
}

fn text(properties: &Value, name: &str) -> Result<Option<String>, Fault> {
    match &properties[name] {
        Value::Null => Ok(None),
        Value::String(text) => Ok(Some(text.trim().to_owned())),
        _ => Err((format!("/properties/{name}"), "it must be a text".to_owned())),
    }
}

fn finite(properties: &Value, name: &str) -> Result<Option<f64>, Fault> {
    match &properties[name] {
        Value::Null => Ok(None),
        value => {
            value.as_f64().map(Some).ok_or_else(|| (format!("/properties/{name}"), "it must be a number".to_owned()))
        }
    }
}
