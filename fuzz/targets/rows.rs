//! Rows of studies as CSV, which `gable simulate` reads again to go on, and what is drawn and told of them.
#![no_main]

use gable::study::{Mixture, Row, plot, table};

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let rows: Result<Vec<Row>, _> = csv::Reader::from_reader(data).deserialize().collect();
    let Ok(rows) = rows else { return };
    if !rows.iter().all(Row::is_consistent) {
        return;
    }
    let _ = table::table(Mixture::Good, &rows);
    let _ = plot::plot(&rows);
});
