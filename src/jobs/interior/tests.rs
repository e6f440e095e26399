use super::*;
use crate::interior::{Kind, Wanted};

fn request(json: &str) -> Result<InteriorRequest, serde_json::Error> {
    serde_json::from_str(json)
}

#[test]
fn what_the_request_leaves_out_comes_from_the_file_or_is_found_out() {
    let plain = request(r#"{"image": "i", "camera": "c"}"#).unwrap();
    let prepared = plain.prepare(None).unwrap();
    assert_eq!((prepared.pixel_size_um, prepared.pixel_size_from), (None, PixelSizeOrigin::Unknown));
    assert_eq!(plain.scan().wanted(None), Wanted::default());
    let prepared = plain.prepare(Some(14.0)).unwrap();
    assert_eq!((prepared.pixel_size_um, prepared.pixel_size_from), (Some(14.0), PixelSizeOrigin::File));
    let given = r#"{"image": "i", "camera": "c", "pixel_size_um": 20, "transformation": "projective",
                    "reading": "wrong", "quarter_turns": 3}"#;
    let given = request(given).unwrap();
    let mut prepared = given.prepare(Some(14.0)).unwrap();
    assert_eq!(prepared.pixel_size_from, PixelSizeOrigin::Request);
    let wanted = Wanted { pixel_mm: Some(0.02), kind: Kind::Projective, mirrored: Some(true), quarter_turns: Some(3) };
    assert_eq!(given.scan().wanted(Some(14.0)), wanted);
    let kept: PreparedInterior = serde_json::from_str(&serde_json::to_string(&prepared).unwrap()).unwrap();
    assert_eq!(kept, prepared);
    prepared.note_assumed(20.0);
    assert_eq!(prepared.pixel_size_from, PixelSizeOrigin::Request);
    prepared.note_assumed(31.0);
    assert_eq!(prepared.pixel_size_from, PixelSizeOrigin::Unknown);
}

#[test]
fn all_that_makes_no_sense_is_told() {
    let faults = request(r#"{"image": "i", "camera": "c", "pixel_size_um": 0.1, "quarter_turns": 4}"#).unwrap();
    let faults = faults.prepare(None).unwrap_err();
    let pointers: Vec<&str> = faults.iter().map(|fault| fault.pointer.as_str()).collect();
    assert_eq!(pointers, ["/pixel_size_um", "/quarter_turns"]);
    assert!(InteriorError::Request(faults).to_string().contains("from 2 to 200"));
    for unknown in [r#"{"image": "i", "camera": "c", "turns": 1}"#, r#"{"image": "i", "camera": "c", "reading": "up"}"#]
    {
        assert!(request(unknown).is_err());
    }
}
