//! `gable simulate --mixture film`: the study of scans of film.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Mutex;

use crate::features::Picture as _;
use crate::simulation::film::{SimulatedScan, TiffSettings, write_scan};
use crate::study::film::{ScanRow, settings, table};
use anyhow::Context as _;

use super::super::print;
use super::lines::replace;
use super::study::{Timed, bar, in_parallel, thread_seconds};

/// Brings the scans of seeds to their plates, and leaves rows and table in a folder.
pub(super) fn study(seeds: std::ops::Range<u64>, corrupt: bool, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let bar = bar(seeds.end - seeds.start, 0);
    let rows = Mutex::new(Vec::new());
    let all: Vec<u64> = seeds.collect();
    let first_error = in_parallel(&all, |seed| {
        let settings = settings(seed, corrupt);
        let scan = SimulatedScan::draw(seed, &settings);
        let picture = Timed::new(&scan);
        let begin = thread_seconds();
        let row = ScanRow::of(seed, &settings, &scan, &picture).with_context(|| format!("seed {seed}"))?;
        let seconds = thread_seconds() - begin - picture.seconds();
        rows.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push(ScanRow { seconds, ..row });
        bar.inc(1);
        Ok(())
    });
    bar.finish_and_clear();
    first_error?;
    let mut rows = rows.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    rows.sort_by_key(|row| row.seed);
    let seconds = rows.iter().map(|row| row.seconds).sum::<f64>() / rows.len().max(1) as f64;
    let table = format!("{}\n{seconds:.2} s of processor time for a scan, without rendering it.\n", table(&rows));
    replace(&folder.join("scans.csv"), lines(&rows).as_bytes())?;
    replace(&folder.join("table.md"), table.as_bytes())?;
    print(&table)
}

/// Writes the scan of a seed with its camera into a folder of its own.
pub(super) fn write(seed: u64, deflate: bool, folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let scan = SimulatedScan::draw(seed, &settings(seed, false));
    write_scan(seed, &scan, &TiffSettings { deflate, ..TiffSettings::default() }, folder)?;
    let [width, height] = scan.size_px();
    let place = folder.display();
    print(&format!(
        "{place}: {width} x {height} px; try\n  gable interior {place}/scan.tif --camera {place}/camera.json"
    ))
}

fn lines(rows: &[ScanRow]) -> String {
    let mut text = String::from(
        "seed,make,good,feature,strip,verdict,reason,basis,decided,laying_right,error_px,promised_px,seconds\n",
    );
    for row in rows {
        let ScanRow { seed, make, good, feature, strip, verdict, reason, basis, decided, laying_right, .. } = row;
        let _ = writeln!(
            text,
            "{seed},{make:?},{good},{feature},{strip},{verdict:?},{reason},{basis},{decided},{laying_right},{:.4},{:.3},{:.3}",
            row.error_px, row.promised_px, row.seconds
        );
    }
    text
}
