//! How fast each dialect is read: `cargo test --release buildings::tests::speed -- --ignored --nocapture`.

use std::hint::black_box;

use super::*;

/// The time for which this thread has been on a core: others may be at work on the machine.
fn seconds_on_core() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split(' ').next().unwrap().parse::<f64>().unwrap() / 1e9
}

#[test]
#[ignore = "a measurement, not a test"]
fn speed() {
    let town = Town { seed: 3, buildings: 20_000 };
    for sample in Sample::ALL {
        let mut text = Vec::new();
        write(sample, town, &mut text, &mut |_| {}).unwrap();
        let best = (0..3)
            .map(|_| {
                let started = seconds_on_core();
                let mut count = 0;
                let mut input = BufReader::with_capacity(1 << 17, &text[..]);
                read(sample.format(), &mut input, &Limits::default(), &mut |item| {
                    count += usize::from(matches!(black_box(item), Item::Building(_)));
                    ControlFlow::Continue(())
                })
                .unwrap();
                assert_eq!(count, 20_000);
                seconds_on_core() - started
            })
            .fold(f64::INFINITY, f64::min);
        let bytes = text.len() as f64;
        eprintln!(
            "{sample:?}: {:.0} buildings/s on one core, {:.0} MB/s, {:.0} bytes a building",
            20_000.0 / best,
            bytes / best / 1e6,
            bytes / 20_000.0
        );
    }
}
