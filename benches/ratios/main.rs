//! Ours against the best of what others have, in one run and on the same inputs: `just bench`, or
//! `cargo bench -- F1 F9` for some of the rows.
//!
//! Figures are CPU seconds: of one thread of ours, and of the peer's process, which is kept to one thread. Peer and
//! ours take turns, and the medians are compared. `gate` is what must be held, `moonshot` what is aimed at
//! (`../shared/design/performance.md`, section 9).

#![allow(clippy::print_stdout, reason = "a bench prints")]
#![allow(unreachable_pub, reason = "a program of its own: nothing of it can be reached")]

mod classifier;
mod clustering;
#[allow(dead_code, reason = "tests/control_scenes.rs reads the scenes")]
mod dataset;
mod measure;
mod peer;
mod pipeline;
mod resection;
mod segments;
mod sift;
mod table;
mod windows;

use anyhow::Result;

use self::peer::Peers;
use self::table::Row;

type Bench = fn(&Peers) -> Result<Vec<Row>>;

/// In the order in which an image goes through.
const BENCHES: &[(&str, Bench)] = &[
    ("F1", segments::bench),
    ("F3", windows::bench),
    ("F4", clustering::bench),
    ("F5", resection::bench_all_quadruples),
    ("F6", resection::bench_ransac),
    ("F7", resection::bench_lines),
    ("F8", resection::bench_subsets),
    ("F9", pipeline::bench),
    ("F10", sift::bench),
    ("F11", classifier::bench),
];

fn main() -> Result<()> {
    // two threads on the two halves of one core would each count the time in which the other has it
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let wanted: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    let peers = match Peers::find() {
        Ok(peers) => peers,
        Err(missing) => {
            println!("nothing to compare with: {missing}");
            return Ok(());
        }
    };
    println!("{}", measure::machine());
    println!("{}", table::HEAD);
    for (name, bench) in BENCHES {
        if wanted.is_empty() || wanted.iter().any(|w| w == name) {
            for row in bench(&peers)? {
                println!("{row}");
            }
        }
    }
    Ok(())
}
