//! How fast each dialect is read: `cargo test --release buildings::tests::speed -- --ignored --nocapture`.

use std::hint::black_box;
use std::time::Instant;

use super::*;

#[test]
#[ignore = "a measurement, not a test"]
fn speed() {
    let town = Town { seed: 3, buildings: 20_000 };
    for sample in Sample::ALL {
        let mut text = Vec::new();
        write(sample, town, &mut text, &mut |_| {}).unwrap();
        let best = (0..3)
            .map(|_| {
                let started = Instant::now();
                let mut count = 0;
                let mut input = BufReader::with_capacity(1 << 17, &text[..]);
                read(sample.format(), &mut input, &Limits::default(), &mut |item| {
                    count += usize::from(matches!(black_box(item), Item::Building(_)));
                    ControlFlow::Continue(())
                })
                .unwrap();
                assert_eq!(count, 20_000);
                started.elapsed().as_secs_f64()
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
