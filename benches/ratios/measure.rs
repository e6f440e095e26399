//! CPU time, medians and the machine's name.

use anyhow::Result;
use rustix::time::{ClockId, clock_gettime};
use serde_json::Value;

use super::peer::Peer;

/// Runs of peer and ours.
pub const RUNS: usize = 7;

fn seconds(clock: ClockId) -> f64 {
    let time = clock_gettime(clock);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

/// What `work` makes, and the CPU time that the whole process needed meanwhile.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let began = seconds(ClockId::ProcessCPUTime);
    let made = work();
    (made, seconds(ClockId::ProcessCPUTime) - began)
}

/// Medians of peer and ours, and what both made the last time.
pub struct Comparison<T> {
    pub peer_s: f64,
    pub ours_s: f64,
    pub told: Value,
    pub made: T,
}

/// Lets peer and ours take turns. `request` is what the peer is asked in each run.
pub fn compare<T>(peer: &mut Peer, request: &str, mut ours: impl FnMut() -> Result<T>) -> Result<Comparison<T>> {
    // once without looking at the clock: caches, pages and lazily made tables
    let (mut told, _) = peer.run(request)?;
    let mut made = ours()?;
    let (mut peer_s, mut ours_s) = (Vec::new(), Vec::new());
    for _ in 0..RUNS {
        let (answer, used) = peer.run(request)?;
        peer_s.push(used);
        told = answer;
        let (result, used) = timed(&mut ours);
        ours_s.push(used);
        made = result?;
    }
    Ok(Comparison { peer_s: median(peer_s), ours_s: median(ours_s), told, made })
}

pub fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Processor, cores and how busy they are: figures of another machine, or of a busy one, say little.
pub fn machine() -> String {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let cpu = read("/proc/cpuinfo");
    let field = |name: &str| {
        let line = cpu.lines().find(|line| line.starts_with(name));
        line.and_then(|line| line.split(':').nth(1)).map_or("?", str::trim).to_owned()
    };
    let cores = std::thread::available_parallelism().map_or(0, usize::from);
    let load = read("/proc/loadavg");
    let load = load.split(' ').next().unwrap_or("?");
    let (name, family, model) = (field("model name"), field("cpu family"), field("model\t"));
    format!(
        "{name}, family {family} model {model}, {cores} cores, load average {load}; medians of {RUNS} runs, CPU time"
    )
}
