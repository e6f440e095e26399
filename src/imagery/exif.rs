//! Where the camera was and where it looked, as Exif and XMP tell it.

use std::ops::RangeInclusive;

use chrono::{Datelike as _, NaiveDate};
use nom_exif::{EntryValue, Exif, IfdIndex, IfdKind, MediaParser, MediaSource};

/// Where the camera says that it was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExifPosition {
    /// Longitude (WGS 84), east positive.
    pub longitude_deg: f64,
    /// Latitude (WGS 84), north positive.
    pub latitude_deg: f64,
    /// Height above the geoid; Exif says "sea level", and receivers mean it, more or less.
    pub altitude_m: Option<f64>,
    /// The receiver's own estimate of its horizontal error.
    pub horizontal_error_m: Option<f64>,
}

/// Which north a heading counts from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum North {
    /// Geographic north.
    True,
    /// Magnetic north; the declination is not taken off.
    Magnetic,
}

/// Where the top of a picture points that was taken looking down: clockwise from north, so that kappa = -heading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExifHeading {
    /// 0 up to, not including, 360 degrees.
    pub heading_deg: f64,
    /// What it counts from.
    pub north: North,
}

/// What a header knows of the camera, of the orientation and of the scan.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Clues {
    pub(super) camera_model: Option<String>,
    pub(super) position: Option<ExifPosition>,
    pub(super) heading: Option<ExifHeading>,
    pub(super) pixel_size_um: Option<f64>,
    pub(super) taken: Option<NaiveDate>,
}

/// The tags of the GPS directory that matter here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub(super) enum GpsTag {
    LatitudeRef = 1,
    Latitude = 2,
    LongitudeRef = 3,
    Longitude = 4,
    AltitudeRef = 5,
    Altitude = 6,
    DirectionRef = 16,
    Direction = 17,
    HorizontalError = 31,
}

/// A source of GPS tags: the Exif segment of a JPEG or PNG, or the directories of a TIFF.
pub(super) trait GpsDirectory {
    /// The numbers of a tag; rationals with denominator zero are not finite.
    fn numbers(&mut self, tag: GpsTag) -> Option<Vec<f64>>;
    /// The first letter of a tag.
    fn letter(&mut self, tag: GpsTag) -> Option<u8>;
}

/// What an Exif block (a TIFF structure) and an XMP packet tell.
pub(super) fn clues(exif: Option<Vec<u8>>, xmp: Option<&[u8]>) -> Clues {
    let of_exif = |mut exif: Exif| {
        let text = |tag| exif.get_by_code_in(IfdIndex::MAIN, IfdKind::Tiff, tag).and_then(EntryValue::as_str);
        let camera_model = camera_model(text(MAKE), text(MODEL));
        let taken = exif.get_by_code_in(IfdIndex::MAIN, IfdKind::Exif, TAKEN).and_then(EntryValue::as_datetime);
        let taken = taken.map(|taken| taken.into_naive().date()).filter(|date| PHOTOGRAPHED.contains(&date.year()));
        Clues { camera_model, taken, ..clues_of(&mut exif) }
    };
    with_xmp(exif.and_then(parse).map(of_exif).unwrap_or_default(), xmp)
}

/// Tags of the main directory.
const MAKE: u16 = 0x010F;
const MODEL: u16 = 0x0110;
/// `DateTimeOriginal`, of the Exif directory.
const TAKEN: u16 = 0x9003;
/// Years in which digital cameras have written it; a clock that was never set begins before.
const PHOTOGRAPHED: RangeInclusive<i32> = 1990..=2200;
/// The most characters of make and model each: real ones are far shorter.
const CHARACTERS_MAX: usize = 64;

/// Make and model in one text, the make only where the model does not begin with it.
pub(super) fn camera_model(make: Option<&str>, model: Option<&str>) -> Option<String> {
    let clean = |text: &str| {
        let printable: String =
            text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(CHARACTERS_MAX).collect();
        printable.split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let (make, model) = (clean(make.unwrap_or_default()), clean(model.unwrap_or_default()));
    let repeated = model.to_lowercase().starts_with(&make.to_lowercase());
    let both = if repeated { model } else { format!("{make} {model}").trim().to_owned() };
    (!both.is_empty()).then_some(both)
}

/// What a GPS directory tells.
pub(super) fn clues_of(gps: &mut impl GpsDirectory) -> Clues {
    Clues { position: position(gps), heading: heading(gps), ..Clues::default() }
}

/// The heading of the drone where Exif has none.
pub(super) fn with_xmp(clues: Clues, xmp: Option<&[u8]>) -> Clues {
    Clues { heading: clues.heading.or_else(|| xmp.and_then(drone_heading)), ..clues }
}

fn position(gps: &mut impl GpsDirectory) -> Option<ExifPosition> {
    let latitude_deg = angle(gps, GpsTag::Latitude, GpsTag::LatitudeRef, b'N', b'S')?;
    let longitude_deg = angle(gps, GpsTag::Longitude, GpsTag::LongitudeRef, b'E', b'W')?;
    // Zero, zero is what receivers write that have no position yet.
    let possible = latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 180.0;
    if !possible || (latitude_deg == 0.0 && longitude_deg == 0.0) {
        return None;
    }
    let below_sea_level = gps.numbers(GpsTag::AltitudeRef).is_some_and(|reference| reference.first() == Some(&1.0));
    let altitude_m = number(gps, GpsTag::Altitude).map(|altitude| if below_sea_level { -altitude } else { altitude });
    let horizontal_error_m = number(gps, GpsTag::HorizontalError).filter(|&error| error > 0.0);
    // Deeper and higher than this no aerial camera works.
    let altitude_m = altitude_m.filter(|altitude| (-1_000.0..=100_000.0).contains(altitude));
    Some(ExifPosition { longitude_deg, latitude_deg, altitude_m, horizontal_error_m })
}

/// Degrees, minutes and seconds with their hemisphere; without the hemisphere nothing is known.
fn angle(gps: &mut impl GpsDirectory, value: GpsTag, reference: GpsTag, positive: u8, negative: u8) -> Option<f64> {
    let parts = gps.numbers(value)?;
    let angle: f64 = match *parts.as_slice() {
        [degrees, minutes, seconds] => degrees + minutes / 60.0 + seconds / 3600.0,
        [degrees, minutes] => degrees + minutes / 60.0,
        [degrees] => degrees,
        _ => return None,
    };
    let letter = gps.letter(reference)?.to_ascii_uppercase();
    let sign = if letter == positive {
        1.0
    } else if letter == negative {
        -1.0
    } else {
        return None;
    };
    angle.is_finite().then_some(sign * angle)
}

fn number(gps: &mut impl GpsDirectory, tag: GpsTag) -> Option<f64> {
    gps.numbers(tag)?.first().copied().filter(|number| number.is_finite())
}

fn heading(gps: &mut impl GpsDirectory) -> Option<ExifHeading> {
    let direction = number(gps, GpsTag::Direction)?;
    let heading_deg = (0.0..=360.0).contains(&direction).then(|| direction.rem_euclid(360.0))?;
    let north = match gps.letter(GpsTag::DirectionRef).map(|letter| letter.to_ascii_uppercase()) {
        Some(b'M') => North::Magnetic,
        _ => North::True,
    };
    Some(ExifHeading { heading_deg, north })
}

/// The yaw that DJI drones write into XMP: that of the gimbal, which carries the camera, before that of the airframe.
fn drone_heading(xmp: &[u8]) -> Option<ExifHeading> {
    let text = String::from_utf8_lossy(xmp);
    let yaw = |name| xmp_number(&text, name).filter(|yaw| (-360.0..=360.0).contains(yaw));
    let yaw_deg = yaw("drone-dji:GimbalYawDegree").or_else(|| yaw("drone-dji:FlightYawDegree"))?;
    Some(ExifHeading { heading_deg: yaw_deg.rem_euclid(360.0), north: North::True })
}

/// The number in `name="…"` or `<name>…</name>`.
fn xmp_number(text: &str, name: &str) -> Option<f64> {
    let (_, rest) = text.split_once(name)?;
    let value = rest.trim_start().strip_prefix('=').map(str::trim_start).unwrap_or(rest);
    let value = value.strip_prefix(['"', '\'', '>'])?;
    let (value, _) = value.split_once(['"', '\'', '<'])?;
    value.trim().parse().ok().filter(|number: &f64| number.is_finite())
}

fn parse(block: Vec<u8>) -> Option<Exif> {
    let source = MediaSource::from_memory(block).ok()?;
    Some(MediaParser::new().parse_exif(source).ok()?.into())
}

impl GpsDirectory for Exif {
    fn numbers(&mut self, tag: GpsTag) -> Option<Vec<f64>> {
        let ratio = |numerator: f64, denominator: f64| numerator / denominator;
        Some(match self.get_by_code_in(IfdIndex::MAIN, IfdKind::Gps, tag as u16)? {
            EntryValue::URational(r) => vec![ratio(r.numerator().into(), r.denominator().into())],
            EntryValue::URationalArray(list) => {
                list.iter().map(|r| ratio(r.numerator().into(), r.denominator().into())).collect()
            }
            EntryValue::U8Array(list) => list.iter().copied().map(f64::from).collect(),
            EntryValue::Undefined(list) => list.iter().copied().map(f64::from).collect(),
            EntryValue::U8(number) => vec![f64::from(*number)],
            _ => return None,
        })
    }

    fn letter(&mut self, tag: GpsTag) -> Option<u8> {
        self.get_by_code_in(IfdIndex::MAIN, IfdKind::Gps, tag as u16)?.as_str()?.bytes().next()
    }
}
