//! The study by the built program: stopped at any moment, it goes on where it was.

#![allow(clippy::unwrap_used, reason = "a test fails by panic")]

use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use gable::study::Row;

fn simulate(folder: &Path, mixture: &str, images: u32) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gable"));
    command.args(["simulate", "--mixture", mixture, "--images", &images.to_string(), "--out"]).arg(folder);
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn run(folder: &Path, mixture: &str, images: u32) -> Output {
    simulate(folder, mixture, images).output().unwrap()
}

/// The rows without the times, which no two runs share.
fn rows(folder: &Path) -> Vec<Row> {
    let rows = csv::Reader::from_path(folder.join("rows.csv")).unwrap().into_deserialize();
    let timeless = |row: Result<Row, csv::Error>| Row {
        render_seconds: 0.0,
        pipeline_seconds: 0.0,
        paper_seconds: 0.0,
        ..row.unwrap()
    };
    rows.map(timeless).collect()
}

/// Lines that are whole.
fn lines(folder: &Path) -> usize {
    std::fs::read(folder.join("rows.csv")).map_or(0, |text| text.iter().filter(|byte| **byte == b'\n').count())
}

#[test]
fn a_study_that_was_killed_goes_on_and_ends_like_one_that_was_not() {
    let folder = tempfile::tempdir().unwrap();
    let (killed, whole) = (folder.path().join("killed"), folder.path().join("whole"));
    let mut first = simulate(&killed, "good", 4).spawn().unwrap();
    let patience = Instant::now() + Duration::from_secs(300);
    while lines(&killed) < 2 && first.try_wait().unwrap().is_none() {
        assert!(Instant::now() < patience, "no row is written");
        std::thread::sleep(Duration::from_millis(20));
    }
    first.kill().unwrap();
    first.wait().unwrap();
    let before = rows(&killed);
    assert!(!before.is_empty());
    // as if the kill had come in the middle of a line
    let torn = OpenOptions::new().append(true).open(killed.join("rows.csv")).unwrap();
    (&torn).write_all(b"3,good,0.2,1.").unwrap();

    let output = run(&killed, "good", 4);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let after = rows(&killed);
    assert_eq!(after.iter().map(|row| row.seed).collect::<Vec<_>>(), [1, 2, 3, 4]);
    assert!(before.iter().all(|row| after.contains(row)));
    assert!(run(&whole, "good", 4).status.success());
    assert_eq!(after, rows(&whole));

    let table = String::from_utf8(output.stdout).unwrap();
    assert!(table.starts_with("# 4 images of the mixture `good`"), "{table}");
    assert_eq!(std::fs::read_to_string(killed.join("table.md")).unwrap().trim(), table.trim());
    assert!(std::fs::read_to_string(killed.join("errors.svg")).unwrap().starts_with("<svg"));

    // with all rows there, nothing is left to do; another mixture does not belong here
    let again = Instant::now();
    assert!(run(&killed, "good", 4).status.success());
    assert!(again.elapsed() < Duration::from_secs(5));
    let refused = run(&killed, "poor", 4);
    let message = String::from_utf8(refused.stderr).unwrap();
    assert!(!refused.status.success() && message.contains("it is of the mixture good"), "{message}");
    assert_eq!(rows(&killed), after);
}

#[test]
fn rows_of_unknown_origin_are_not_continued() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("rows.csv"), "seed\n1\n").unwrap();
    let output = run(folder.path(), "good", 1);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && said.contains("study.json"), "{said}");
    assert_eq!(std::fs::read_to_string(folder.path().join("rows.csv")).unwrap(), "seed\n1\n");
    assert!(!folder.path().join("study.json").exists());
}

#[test]
fn one_run_at_a_time_works_in_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let mut first = simulate(folder.path(), "good", 50).spawn().unwrap();
    let patience = Instant::now() + Duration::from_secs(300);
    while !folder.path().join("rows.csv").exists() {
        assert!(Instant::now() < patience, "nothing is written");
        std::thread::sleep(Duration::from_millis(5));
    }
    let second = run(folder.path(), "good", 50);
    first.kill().unwrap();
    first.wait().unwrap();
    let said = String::from_utf8_lossy(&second.stderr).into_owned();
    assert!(!second.status.success() && said.contains("another run"), "{said}");
}
