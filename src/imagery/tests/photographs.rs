//! The real photographs, if they are there.

use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

use super::pattern::rect;
use crate::features::Picture;
use crate::imagery::{ImageFile, Limits, probe};

/// The photographs of one place; empty, with a note, where they are absent.
fn photographs(place: &str) -> Vec<PathBuf> {
    let bench = std::env::var_os("GABLE_BENCH")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/bench"), PathBuf::from);
    let folder = bench.join(place).join("images");
    let Ok(entries) = std::fs::read_dir(&folder) else {
        // `eprintln!` would not be seen of a test that passes
        let note = format!("skipped: no photographs in {}\n", folder.display());
        std::io::stderr().write_all(note.as_bytes()).unwrap();
        return Vec::new();
    };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

#[test]
fn sizes_and_positions_of_caliterra() {
    for path in photographs("caliterra") {
        let probe = probe(&path, &Limits::default()).unwrap();
        assert_eq!([probe.width_px, probe.height_px], [4000, 3000]);
        let position = probe.position.unwrap();
        assert!((30.16..30.18).contains(&position.latitude_deg), "{position:?}");
        assert!((-98.10..-98.08).contains(&position.longitude_deg), "{position:?}");
        assert!((250.0..500.0).contains(&position.altitude_m.unwrap()), "{position:?}");
        assert_eq!(probe.heading, None);
    }
}

/// Their orientation tag says that they stand on their sides.
#[test]
fn sizes_of_boruszyn_are_as_stored() {
    for path in photographs("boruszyn") {
        let probe = probe(&path, &Limits::default()).unwrap();
        assert_eq!(([probe.width_px, probe.height_px], probe.position), ([4608, 3456], None));
    }
}

#[test]
fn windows_of_photographs() {
    for path in photographs("boruszyn").into_iter().chain(photographs("caliterra")).step_by(4) {
        let start = Instant::now();
        let file = ImageFile::open(&path, &Limits::default()).unwrap();
        let opened = start.elapsed();
        let [width, height] = file.size_px();
        let mut times = Vec::new();
        for reduction in [1, 2, 3, 4, 8] {
            let start = Instant::now();
            let window = file.window(rect(0, 0, width, height), reduction).unwrap();
            times.push((reduction, start.elapsed()));
            let mean = window.grey.iter().map(|&grey| f64::from(grey)).sum::<f64>() / window.grey.len() as f64;
            assert!((20.0..235.0).contains(&mean), "{}: mean grey {mean}", path.display());
        }
        eprintln!("{}: opened in {opened:?}, whole windows by reduction {times:?}", path.display());
    }
}

#[test]
fn cuts_of_a_photograph_are_noticed() {
    if let Some(path) = photographs("caliterra").first() {
        let bytes = std::fs::read(path).unwrap();
        for per_mille in [50, 500, 900, 990, 999] {
            let mut cut = bytes[..bytes.len() * per_mille / 1000].to_vec();
            let error = super::pattern::open(&cut).unwrap_err().to_string();
            assert!(error.contains("ends"), "{error}");
            cut.extend([0xFF, 0xD9]);
            let error = super::pattern::open(&cut).unwrap_err().to_string();
            eprintln!("cut to {per_mille} per mille: {error}");
        }
    }
}
